"""A scenario to a recording, without middleware: what the sonde node would publish, as the recorder would store it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import Scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_metadata import qos_profile
from mwd_surface.bags.bag_writer import BagWriter

_BLOCK_S = 1.0
# As `mwd_sensors.ros.qos` names them: STREAM, and EVENT for the rig.
_STREAM = qos_profile(depth=200)
_EVENT = qos_profile(durability="transient_local", depth=100)


def record(
    scenario: Scenario,
    path: Path,
    namespace: str = "",
    source: bytes = b"",
    progress: Callable[[float], None] = lambda _share: None,
) -> tuple[int, float]:
    """
    Write the bag of a scenario.

    Parameters
    ----------
    scenario : Scenario
    path : Path
        Folder of the bag.
    namespace : str
        Before the topics' relative names.
    source : bytes
        The scenario as its author wrote it, kept inside the bag.
    progress : callable
        Called with the share that is done, 0 to 1.

    Returns
    -------
    (messages, seconds of the run)

    Raises
    ------
    FileExistsError
        `path` exists.
    OSError
        It cannot be written.
    """
    sonde = Sonde(scenario)
    prefix = "/" + namespace.strip("/") + "/" if namespace.strip("/") else "/"
    with BagWriter(path, custom={"scenario": scenario.name, "seed": str(scenario.seed)}) as bag:
        channels = {
            name: bag.topic(prefix + name, layout.type_name, [_EVENT if name == "rig/state" else _STREAM])
            for name, layout in wire.SONDE_TOPICS.items()
        }
        if source:
            bag.attach("scenario.yaml", "application/yaml", source, sonde.epoch_ns)
        done = 0.0
        for block in sonde.blocks(_BLOCK_S):
            for name, samples in block.items():
                frame = prefix[1:] + (wire.RIG_FRAME if name == "rig/state" else wire.SONDE_FRAME)
                rows = wire.SONDE_TOPICS[name].encode(samples, frame)
                bag.write_rows(channels[name], rows, samples["stamp_ns"])
            done += _BLOCK_S
            progress(min(done / sonde.duration, 1.0))
        count = bag.messages
    return count, sonde.duration

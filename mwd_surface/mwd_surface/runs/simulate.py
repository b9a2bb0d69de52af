# SPDX-License-Identifier: Apache-2.0
"""Simulation of a scenario to a recording, without middleware, with the messages that the sonde node would publish."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.simulator.link_channels import Heard
from mwd_sensors.simulator.scenario import Scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_metadata import qos_profile
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs import launch_plan
from mwd_surface.runs.simulated_tool import SimulatedTool
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE

_BLOCK_S = 1.0
# QoS profiles as named in `mwd_sensors.ros.qos`: STREAM, and EVENT for the rig.
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
        Prefix of the relative topic names.
    source : bytes
        The scenario file, stored inside the bag.
    progress : callable
        Called with the completed share, 0 to 1.

    Returns
    -------
    (messages, seconds of the run)

    Raises
    ------
    FileExistsError
        `path` exists.
    OSError
        The bag cannot be written.
    """
    sonde = Sonde(scenario)
    prefix = "/" + namespace.strip("/") + "/" if namespace.strip("/") else "/"
    with BagWriter(path, custom={"scenario": scenario.name, "seed": str(scenario.seed)}) as bag:
        channels = {
            name: bag.topic(prefix + name, layout.type_name, [_EVENT if name == "rig/state" else _STREAM])
            for name, layout in sonde.topics.items()
        }
        if source:
            bag.attach("scenario.yaml", "application/yaml", source, sonde.epoch_ns)
        link = None if sonde.link is None else _LinkWriter(sonde, bag, prefix)
        done = 0.0
        for block in sonde.blocks(_BLOCK_S):
            for name, samples in block.items():
                frame = prefix[1:] + (wire.RIG_FRAME if name == "rig/state" else wire.SONDE_FRAME)
                rows = sonde.topics[name].encode(samples, frame)
                bag.write_rows(channels[name], rows, samples["stamp_ns"])
            done += _BLOCK_S
            if link is not None:
                link.take(block, min(done, sonde.duration))
            progress(min(done / sonde.duration, 1.0))
        if link is not None:
            link.finish()
        for name, table in _parameters(scenario, namespace).items():
            bag.add_metadata(name, {key: str(value) for key, value in table.items()})
        count = bag.messages
    return count, sonde.duration


def _parameters(scenario: Scenario, namespace: str) -> dict[str, dict[str, Any]]:
    """Return place, day and well of a scenario, as `mwd run` sets them and the surface node records them."""
    surface = launch_plan.surface_parameters(scenario)
    if namespace.strip("/"):
        surface["well.name"] = namespace.strip("/")
    return {ESTIMATOR: launch_plan.estimator_parameters(scenario), SURFACE: surface}


class _LinkWriter:
    """
    Writer of the flow at the tool and the signal received at the surface.

    The estimator runs to provide the words.
    """

    def __init__(self, sonde: Sonde, bag: BagWriter, prefix: str) -> None:
        self._sonde, self._bag = sonde, bag
        self._tool = SimulatedTool(sonde)
        self._flow = bag.topic(prefix + "tool/flow", wire.TOOL_FLOW.type_name, [_EVENT])
        self._heard = {link: bag.topic(prefix + name, kind, [_EVENT]) for link, (name, kind) in _topics(sonde)}
        if "mud_pulse" in self._heard:
            self._strokes = bag.topic(prefix + "rig/strokes", gauge_burst.STROKES, [_EVENT])

    def take(self, block: Mapping[str, Samples], until_s: float) -> None:
        """Process the samples of a block that ends at run time `until_s`, s."""
        flow, heard = self._tool.take(block, until_s)
        self._bag.write_rows(self._flow, wire.TOOL_FLOW.encode(flow, wire.SONDE_FRAME), flow["stamp_ns"])
        self._write(heard)

    def finish(self) -> None:
        """Write the rest of the received signal."""
        self._write(self._tool.finish())

    def _write(self, heard: list[Heard]) -> None:
        for one in heard:
            stamp_ns = self._sonde.stamp_ns(one.start_s, of_tool=False)
            data = gauge_burst.encode(stamp_ns, one.period_s, one.values)
            self._bag.write(self._heard[one.link], data, stamp_ns)
            if one.link == "mud_pulse":
                until_ns = stamp_ns + round(len(one.values) * one.period_s * wire.NANOSECONDS)
                strokes = [(pump, self._sonde.stamp_ns(at, of_tool=False)) for pump, at in one.strokes]
                self._bag.write(self._strokes, gauge_burst.encode_strokes(until_ns, strokes), until_ns)


def _topics(sonde: Sonde) -> list[tuple[str, tuple[str, str]]]:
    """Return the links of a run with topic and type of the received signal."""
    tools = () if sonde.scenario.telemetry is None else sonde.scenario.telemetry.tools
    return [(tool.link, gauge_burst.TOPICS[tool.link]) for tool in tools]

# SPDX-License-Identifier: Apache-2.0
"""Memory of a tool, made from the raw data of a simulated run: all log channels at a higher rate, and rotation."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_estimation.pipeline.output import Output
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry.log_channels import LogChannel, LogSample
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.logs.memory_merge import GRAVITY
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.log_estimate import computed_samples
from mwd_surface.processing.thinner import Thinner
from mwd_surface.surveys.recorded_settings import Recorded

_ROTATION_HZ = 10.0


@dataclasses.dataclass(frozen=True)
class DumpClock:
    """Error of the clock of a memory: offset at the begin, s, and drift, s/s, beyond that of the recorded stamps."""

    offset_s: float = 0.0
    drift: float = 0.0

    def stamps(self, stamp_ns: np.ndarray, begin_ns: int) -> np.ndarray:
        """Return stamps of the memory, ns."""
        since = (stamp_ns - begin_ns).astype(float)
        return np.asarray(stamp_ns + np.round(self.offset_s * 1e9 + self.drift * since).astype(np.int64))


def dump(
    bag: Bag,
    path: Path,
    channels: dict[str, LogChannel],
    clock: DumpClock,
    *,
    interval_s: int = 2,
    recorded: Recorded | None = None,
) -> int:
    """
    Write the memory of a tool from a recording of its sensors, and return the number of log samples.

    Parameters
    ----------
    bag : Bag
        Recording of the sensors.
    path : Path
        Folder of the dump.
    channels : dict of str to LogChannel
    clock : DumpClock
    interval_s : int
        Interval of all channels, s.
    recorded : Recorded, optional
        Settings in the recording.

    Raises
    ------
    BagError, ValueError
        See `process.process`.
    FileExistsError
        `path` exists.
    """
    estimator = (recorded.estimator if recorded is not None else None) or EstimatorSettings()
    faster = {name: dataclasses.replace(one, interval_s=interval_s) for name, one in channels.items()}
    thinner, rotation = Thinner(_ROTATION_HZ), list[Samples]()

    def keep(output: Output) -> None:
        rotation.append(output.gravity[thinner(output.attitude["stamp_ns"])])

    samples = computed_samples(bag, estimator, InputSettings(), faster, recorded, keep)
    rows = np.concatenate(rotation) if rotation else wire.GRAVITY.empty(0)
    begin_ns = int(rows["stamp_ns"][0]) if len(rows) else bag.start_ns
    rows["stamp_ns"] = clock.stamps(rows["stamp_ns"], begin_ns)
    with BagWriter(path, custom={"memory": "dump"}) as out:
        speed = out.topic("/" + GRAVITY, wire.GRAVITY.type_name)
        log = out.topic("/log", LogSample.MESSAGE)
        out.write_rows(speed, wire.GRAVITY.encode(rows, wire.SONDE_FRAME), rows["stamp_ns"])
        stamps = clock.stamps(np.array([one.stamp_ns for one in samples], dtype=np.int64), begin_ns)
        for stamp_ns, sample in zip(stamps.tolist(), samples, strict=True):
            moved = dataclasses.replace(sample, stamp_ns=stamp_ns, frame_id=wire.SONDE_FRAME)
            data = out.definitions.typestore.serialize_cdr(moved.to_message(out.definitions.make), LogSample.MESSAGE)
            out.write(log, bytes(data), stamp_ns)
    return len(samples)

# SPDX-License-Identifier: Apache-2.0
"""
Log samples computed from the raw data of a recording by the kernels of the live estimator, and a simulated memory.

The memory of a tool has the log channels at a higher rate, the rotation and the surveys of a simulated run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mwd_estimation.core.input_gate import InputGate
from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.pipeline.output import Output
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry import log_channels, tool_configuration
from mwd_sensors.telemetry.log_channels import LogChannel, LogSample
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.logs.memory_merge import GRAVITY
from mwd_surface.logs.recorded_log import topic_of
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings, find_topics
from mwd_surface.surveys.recorded_settings import Recorded


def channels_of(tool_file: Path | None) -> dict[str, LogChannel]:
    """
    Return the log channels of a tool configuration; without a file, the default channels.

    Raises
    ------
    ValueError, OSError
        The file cannot be used.
    """
    return dict(log_channels.CHANNELS if tool_file is None else tool_configuration.read(tool_file).logged)


def computed_samples(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    channels: dict[str, LogChannel],
    recorded: Recorded | None = None,
    on_survey: Callable[[Survey], None] | None = None,
) -> list[LogSample]:
    """
    Return the log samples of a recording, as the live estimator computes them.

    channels : log channels to compute, by name.
    on_survey : called with each survey of the estimator.

    Raises BagError, ValueError as `process.process` does.
    """
    topics = find_topics(bag, given)
    namespace = topics.imu.removesuffix("imu/data_raw").strip("/")
    sampler, found = LogSampler(channels), list[LogSample]()
    beside = {
        stream: _all(bag, topic_of(bag, name, layout.type_name, namespace), layout)
        for stream, name, layout in (
            ("counts", wire.GAMMA_TOPIC, wire.COUNTS),
            ("status", wire.STATUS_TOPIC, wire.TOOL_STATUS),
        )
    }
    beside["temperature"] = _all(bag, topics.temperature, wire.TEMPERATURE)
    beside["temperature"] = InputGate(derivation.input_ranges(estimator)).temperature(beside["temperature"])

    def take(output: Output) -> None:
        if on_survey is not None:
            for survey in output.surveys:
                on_survey(survey.record(wire.SONDE_FRAME))
        if not len(output.attitude):
            return
        newest = output.attitude["stamp_ns"].max()
        for name, samples in beside.items():
            # Add the samples up to the newest attitude: the sampler needs them before the attitude of their time.
            later = np.flatnonzero(samples["stamp_ns"] > newest)
            cut = int(later[0]) if len(later) else len(samples)
            sampler.push(name, samples[:cut])
            beside[name] = samples[cut:]
        sampler.push("dynamics", output.dynamics)
        found.extend(sampler.advance(output.attitude))
        sampler.running.clear()

    BagEstimate(bag, estimator, given, recorded=recorded).run(take)
    return found + sampler.finish()


def _all(bag: Bag, topic: str | None, layout: wire.Layout) -> Samples:
    if topic is None:
        return layout.empty(0)
    return wire.decode_messages(layout, [data for _, _, _, data in bag.messages([topic])])[0]


_ROTATION_NS = 100_000_000  # averaging interval of the rotary speed, ns


@dataclasses.dataclass(frozen=True)
class DumpClock:
    """Error of a memory's clock relative to the recorded stamps: offset at the start, s, and drift, s/s."""

    offset_s: float = 0.0
    drift: float = 0.0

    def stamps(self, stamp_ns: np.ndarray, begin_ns: int) -> np.ndarray:
        """Return the stamps that the clock of the memory would give, ns."""
        since = (stamp_ns - begin_ns).astype(float)
        return np.asarray(stamp_ns + np.round(self.offset_s * 1e9 + self.drift * since).astype(np.int64))


def dump_memory(
    bag: Bag,
    path: Path,
    channels: dict[str, LogChannel],
    clock: DumpClock,
    *,
    interval_s: int = 2,
    recorded: Recorded | None = None,
) -> tuple[int, int]:
    """
    Simulate a dump of a tool's memory from a recording of the sensors; return the numbers of log samples and surveys.

    Parameters
    ----------
    bag : Bag
        Recording of the sensors.
    path : Path
        Folder of the dump.
    interval_s : int
        Interval of all channels.
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
    surveys: list[Survey] = []
    samples = computed_samples(bag, estimator, InputSettings(), faster, recorded, surveys.append)
    rows = _rotation(bag)
    begin_ns = int(rows["stamp_ns"][0]) if len(rows) else bag.start_ns
    rows["stamp_ns"] = clock.stamps(rows["stamp_ns"], begin_ns)
    with BagWriter(path, custom={"memory": "dump"}) as out:
        speed = out.topic("/" + GRAVITY, wire.GRAVITY.type_name)
        log = out.topic("/log", LogSample.MESSAGE)
        out.write_rows(speed, wire.GRAVITY.encode(rows, wire.SONDE_FRAME), rows["stamp_ns"])
        taken = out.topic("/survey", Survey.MESSAGE)
        kept: tuple[tuple[int, Sequence[LogSample | Survey]], ...] = ((log, samples), (taken, surveys))
        for topic, records in kept:
            stamps = clock.stamps(np.array([one.stamp_ns for one in records], dtype=np.int64), begin_ns)
            for stamp_ns, record in zip(stamps.tolist(), records, strict=True):
                moved = dataclasses.replace(record, stamp_ns=stamp_ns, frame_id=wire.SONDE_FRAME)
                data = out.definitions.typestore.serialize_cdr(moved.to_message(out.definitions.make), moved.MESSAGE)
                out.write(topic, bytes(data), stamp_ns)
    return len(samples), len(surveys)


def _rotation(bag: Bag) -> Samples:
    """
    Return samples of `wire.GRAVITY` with the rotary speed of the tool, rad/s; all other values are NaN.

    The speed is the mean of the gyro's x axis over each 0.1 s. The rotary speed of the estimator is not used, because a
    filter delays this speed by half a second.
    """
    name = find_topics(bag, InputSettings()).imu
    imu, _ = wire.decode_messages(wire.IMU, [data for _, _, _, data in bag.messages([name])])
    if not len(imu):
        return wire.GRAVITY.empty(0)
    cells = imu["stamp_ns"] // _ROTATION_NS
    starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
    counts = np.diff(np.append(starts, len(imu)))
    rows = wire.GRAVITY.empty(len(starts))
    for field in ("gravity", "sigma", "non_gravity"):
        rows[field] = np.nan
    since = imu["stamp_ns"] - imu["stamp_ns"][0]
    rows["stamp_ns"] = imu["stamp_ns"][0] + np.round(np.add.reduceat(since, starts) / counts).astype(np.int64)
    rows["rotary_speed"] = np.add.reduceat(imu["angular_velocity"][:, 0], starts) / counts
    return rows

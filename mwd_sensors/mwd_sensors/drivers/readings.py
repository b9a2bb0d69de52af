# SPDX-License-Identifier: Apache-2.0
"""Samples and answers that a driver receives from a serial line, and their conversion to arrays of messages."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core import burst, input_covariance, wire
from mwd_sensors.core.arrays import Samples

# Bits of `status`: this axis reached the end of its range during the interval of the sample.
CLIPPED_ACCEL, CLIPPED_GYRO, CLIPPED_MAG = (1, 2, 4), (8, 16, 32), (64, 128, 256)
FAULT = 512  # the unit reports that it is faulty
CLIP_WORDS = {
    bit: f"{sensor} {axis}"
    for sensor, bits in (("accelerometer", CLIPPED_ACCEL), ("gyro", CLIPPED_GYRO), ("magnetometer", CLIPPED_MAG))
    for bit, axis in zip(bits, "xyz", strict=True)
}
#: Topics of a probe's samples and their layouts, in the order in which samples of equal stamps are sent. The IMU is
#: last, so that the samples that the estimator combines with it have already arrived.
LAYOUTS = {
    "imu/temperature": wire.TEMPERATURE,
    "gyro/data_raw": wire.IMU,
    "imu/mag": wire.MAG,
    "imu/data_raw": wire.IMU,
}
#: Measured fields of each topic, SI.
FIELDS = {
    "imu/temperature": ("temperature",),
    "gyro/data_raw": ("angular_velocity", "linear_acceleration"),
    "imu/mag": ("magnetic_field",),
    "imu/data_raw": ("angular_velocity", "linear_acceleration"),
}
_CLIP_BITS = {
    "angular_velocity": np.array(CLIPPED_GYRO),
    "linear_acceleration": np.array(CLIPPED_ACCEL),
    "magnetic_field": np.array(CLIPPED_MAG),
}


@dataclasses.dataclass(frozen=True)
class UnitSample:
    """One sample of a sensor unit."""

    topic: str  #: topic, a key of `LAYOUTS`
    stamp_ns: int  #: time by the clock of the unit
    values: tuple[float, ...]  #: values of the fields in `FIELDS`, in order, SI
    status: int = 0  #: bits of `CLIPPED_ACCEL`, `CLIPPED_GYRO`, `CLIPPED_MAG` and `FAULT`


@dataclasses.dataclass(frozen=True)
class UnitAnswer:
    """Answer of a unit to a command."""

    kind: str  #: time or info
    text: str = ""  #: for info: name, serial number and version of the unit
    #: `sent_ns`, `unit_ns`: for time: the host's time in the command, and the unit's time when it read the command, ns.
    sent_ns: int = 0
    unit_ns: int = 0


@dataclasses.dataclass
class FrameCounters:
    """Counts of the frames on a line."""

    #: `frames`, `broken`, `lost`: complete frames, frames with an invalid check or content, and frames missing
    #: according to the counter.
    frames: int = 0
    broken: int = 0
    lost: int = 0


def samples_of(topic: str, readings: list[UnitSample], offset_ns: int = 0) -> Samples:
    """
    Return readings of one topic as samples; offset_ns is added to the unit's time.

    Quantities that a unit does not measure are marked as not provided (REP-145). Axes that the unit reports as clipped
    get the covariance `input_covariance.CLIPPED`; the covariance of all other axes stays zero (unknown).
    """
    out = burst.bare(len(readings)) if LAYOUTS[topic] is wire.IMU else LAYOUTS[topic].empty(len(readings))
    out["stamp_ns"] = np.array([one.stamp_ns for one in readings], dtype=np.int64) + offset_ns
    width = 1 if out[FIELDS[topic][0]].ndim == 1 else 3
    values = np.array([one.values for one in readings], dtype=float).reshape(len(readings), len(FIELDS[topic]), width)
    for k, field in enumerate(FIELDS[topic]):
        out[field] = values[:, k] if width == 3 else values[:, k, 0]
    status = np.array([one.status for one in readings], dtype=int)
    for field in FIELDS[topic]:
        if field in _CLIP_BITS:
            input_covariance.mark_clipped(out, field, status[:, None] & _CLIP_BITS[field] != 0)
    return out


def readings_of(topic: str, samples: Samples) -> list[UnitSample]:
    """Return samples with their clip flags as readings; the inverse of `samples_of`, without the flag `FAULT`."""
    rows = np.column_stack([np.asarray(samples[field], dtype=float) for field in FIELDS[topic]]).tolist()
    status = np.zeros(len(samples), dtype=int)
    for field in FIELDS[topic]:
        if field in _CLIP_BITS:
            status += input_covariance.clipped(samples, field) @ _CLIP_BITS[field]
    parts = zip(samples["stamp_ns"].tolist(), rows, status.tolist(), strict=True)
    return [UnitSample(topic, stamp, tuple(row), bits) for stamp, row, bits in parts]

# SPDX-License-Identifier: Apache-2.0
"""
Bursts: several samples of an inertial unit in one mwd_msgs/ImuBurst, and back, to the bit.

At several kilohertz a message for each sample costs more than its content: a burst of ten costs what one sample does.
An Imu's orientation is not carried, for a raw unit has none; its covariances are those of the whole burst.

Encoding: CDR, little endian, as ROS 2 writes it (see `wire`).
"""

from __future__ import annotations

import itertools

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import WireError

TYPE_NAME = "mwd_msgs/msg/ImuBurst"
MOST = 1000  # samples of one burst, as the message bounds them
# Topics of bursts, and the topics whose samples they carry.
TOPICS = {"imu/burst": "imu/data_raw", "gyro/burst": "gyro/data_raw"}

_HEAD = wire.Layout(
    TYPE_NAME,
    (
        ("angular_velocity_covariance", "float64", 9),
        ("linear_acceleration_covariance", "float64", 9),
        ("count", "uint32", 1),
    ),
)
_SAMPLE = np.dtype(
    [("sec", "<i4"), ("nanosec", "<u4"), ("angular_velocity", "<f8", (3,)), ("linear_acceleration", "<f8", (3,))]
)
_PADDING = bytes(4)
_COVARIANCES = ("angular_velocity_covariance", "linear_acceleration_covariance")


def encode(samples: Samples, frame_id: str) -> bytes:
    """
    One burst of the samples, dtype of `wire.IMU`; their covariances must be equal.

    Raises
    ------
    ValueError
        No samples or more than `MOST`, another dtype, an orientation, or covariances that differ among the samples.
    """
    if samples.dtype != wire.IMU.dtype:
        raise ValueError(f"samples: expected the dtype of {wire.IMU.type_name}, got {samples.dtype}")
    if not 1 <= len(samples) <= MOST:
        raise ValueError(f"samples: a burst has 1 to {MOST}, got {len(samples)}")
    if any((samples[name] != bare()[name]).any() for name in ("orientation", "orientation_covariance")):
        raise ValueError("samples: a burst carries no orientation")
    if any((samples[name] != samples[name][0]).any() for name in _COVARIANCES):
        raise ValueError("samples: the covariances of a burst must be equal")
    head = np.zeros(1, dtype=_HEAD.dtype)
    head["stamp_ns"], head["count"] = samples["stamp_ns"][0], len(samples)
    for name in _COVARIANCES:
        head[name] = samples[name][0]
    start: bytes = _HEAD.encode(head, frame_id)[0].tobytes()
    rows = np.zeros(len(samples), dtype=_SAMPLE)
    rows["sec"], rows["nanosec"] = np.divmod(samples["stamp_ns"], wire.NANOSECONDS)
    rows["angular_velocity"], rows["linear_acceleration"] = samples["angular_velocity"], samples["linear_acceleration"]
    # Behind the count the first stamp is four bytes off what a double needs, and so padded; the others are not.
    packed: bytes = rows.tobytes()
    return start + packed[:8] + _PADDING + packed[8:]


def parts(samples: Samples, size: int) -> list[slice]:
    """Slices for bursts of at most `size`, each of one covariance: a sample flagged as clipped begins another."""
    changes = np.zeros(max(len(samples) - 1, 0), dtype=np.bool_)
    for name in _COVARIANCES:
        changes |= (samples[name][1:] != samples[name][:-1]).any(axis=1)
    starts = sorted({*range(0, len(samples), size), *(np.flatnonzero(changes) + 1).tolist()})
    return [slice(start, stop) for start, stop in itertools.pairwise([*starts, len(samples)])]


def decode(message: bytes) -> Samples:
    """
    Decode a burst: samples, dtype of `wire.IMU`, without orientation (its first covariance element is -1).

    Raises
    ------
    WireError
        Bytes that are not a burst.
    """
    name = wire.frame_id(message)
    size = _HEAD.size(name)
    if len(message) < size:
        raise WireError(f"{TYPE_NAME}: {len(message)} bytes end inside the head")
    head = _HEAD.decode(message[:size])
    count = int(head["count"][0])
    length = size + len(_PADDING) + count * _SAMPLE.itemsize
    # Some writers pad a message to a multiple of four; nothing else may follow.
    if not 1 <= count <= MOST or not 0 <= len(message) - length < 4:
        raise WireError(f"{TYPE_NAME}: {count} samples do not fit into {len(message)} bytes")
    packed = message[size : size + 8] + message[size + 8 + len(_PADDING) : length]
    rows = np.frombuffer(packed, dtype=_SAMPLE)
    samples = bare(count)
    samples["stamp_ns"] = rows["sec"].astype(np.int64) * wire.NANOSECONDS + rows["nanosec"]
    for field in ("angular_velocity", "linear_acceleration"):
        samples[field] = rows[field]
    for field in _COVARIANCES:
        samples[field] = head[field]
    return samples


def bare(count: int = 1) -> Samples:
    """Take the orientation out of samples, as REP-145 defines it: zeros, and -1 as first element of the covariance."""
    samples = wire.IMU.empty(count)
    samples["orientation_covariance"][:, 0] = -1.0
    return samples

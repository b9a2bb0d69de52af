# SPDX-License-Identifier: Apache-2.0
"""
Encode several samples of an inertial unit as one mwd_msgs/ImuBurst and decode them again, bit for bit.

At several kilohertz the overhead of a message is larger than its content: a burst of ten samples costs as much as one
message with one sample. A burst carries no orientation, because a raw unit has none, and one covariance for all its
samples. The encoding is little-endian CDR as ROS 2 writes it (see `wire`).
"""

from __future__ import annotations

import itertools

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import WireError

TYPE_NAME = "mwd_msgs/msg/ImuBurst"
MOST = 1000  # largest number of samples in one burst, the bound in the message definition
# Topic of the bursts -> topic of the single samples that they contain.
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
    Return the bytes of one burst with samples of dtype `wire.IMU`, which must all have the same covariances.

    frame_id is the frame name in the header of the burst.

    Raises
    ------
    ValueError
        There are no samples or more than `MOST`, the dtype differs, a sample has an orientation, or covariances differ.
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
    # The first sample follows the 4-byte count, so four bytes of padding precede its doubles. Later samples need none.
    packed: bytes = rows.tobytes()
    return start + packed[:8] + _PADDING + packed[8:]


def parts(samples: Samples, size: int) -> list[slice]:
    """
    Return the slices, in order, that divide samples into bursts of at most `size` samples with equal covariances.

    The covariance of a clipped sample differs (`mark_clipped`), so clipping starts a new burst.
    """
    changes = np.zeros(max(len(samples) - 1, 0), dtype=np.bool_)
    for name in _COVARIANCES:
        changes |= (samples[name][1:] != samples[name][:-1]).any(axis=1)
    starts = sorted({*range(0, len(samples), size), *(np.flatnonzero(changes) + 1).tolist()})
    return [slice(start, stop) for start, stop in itertools.pairwise([*starts, len(samples)])]


def decode(message: bytes) -> Samples:
    """
    Return the samples of a burst, of dtype `wire.IMU`, without orientation (as `bare`).

    Raises
    ------
    WireError
        The bytes are not a burst.
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
    """Return `count` zero samples without orientation: first element of `orientation_covariance` -1 (REP-145)."""
    samples = wire.IMU.empty(count)
    samples["orientation_covariance"][:, 0] = -1.0
    return samples

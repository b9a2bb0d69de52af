# SPDX-License-Identifier: Apache-2.0
"""
Clip flags that a unit reports: they mark the axes that exceeded their range at some time within a sample.

If a reading is a mean over its interval, the mean may hide a clipped peak; then only the unit can detect the clipping.
Drivers report clipping in the covariance of the sample (`mwd_sensors.core.input_covariance`), so that recordings
contain the flags too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_sensors.core import input_covariance
from mwd_sensors.core.arrays import Array, Samples, Stamps

# Bits for: any accelerometer, the gyro along the axis of the tool, any gyro across it.
ACCEL, AXIAL_GYRO, CROSS_GYRO = 1, 2, 4


class UnitSamples(NamedTuple):
    """
    Samples of one inertial unit.

    stamps, shape (n,), ns; values, shape (n, 6): rates, rad/s, and forces, m/s^2; clipped, shape (n,): clip flags, None
    if the unit does not report clipping.
    """

    stamps: Stamps
    values: Array
    clipped: NDArray[np.uint8] | None = None


def of(samples: Samples) -> NDArray[np.uint8]:
    """Return the clip flags of samples in tool axes (all or some fields of `wire.IMU`), shape (n,)."""
    force = input_covariance.clipped(samples, "linear_acceleration").any(axis=1)
    rate = input_covariance.clipped(samples, "angular_velocity")
    bits = ACCEL * force + AXIAL_GYRO * rate[:, 0] + CROSS_GYRO * rate[:, 1:].any(axis=1)
    return np.asarray(bits, dtype=np.uint8)


def given(clipped: ArrayLike | None, count: int) -> NDArray[np.uint8]:
    """
    Return clip flags in the form that kernels need, shape (count,); all zero if `clipped` is None.

    Raises
    ------
    ValueError
        If there is not exactly one value per sample.
    """
    bits = np.zeros(count, dtype=np.uint8) if clipped is None else np.ascontiguousarray(clipped, dtype=np.uint8)
    if bits.shape != (count,):
        raise ValueError(f"clipped: expected shape ({count},), got {bits.shape}")
    return bits

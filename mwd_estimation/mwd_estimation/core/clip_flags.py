# SPDX-License-Identifier: Apache-2.0
"""
What a unit says of its own clipping: axes that were beyond their range within a sample.

A reading that is a mean over its interval may hide a clipped tip and look small; only the unit knows. A driver tells it
by the covariance of the sample (`mwd_sensors.core.input_covariance`), so that recordings keep it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_sensors.core import input_covariance
from mwd_sensors.core.arrays import Array, Samples, Stamps

# Bits: an accelerometer, the gyro about the axis of the tool, a gyro across it.
ACCEL, AXIAL_GYRO, CROSS_GYRO = 1, 2, 4


class UnitSamples(NamedTuple):
    """Stamps, ns, (n,); rates, rad/s, and forces, m/s^2, (n, 6); clip flags, (n,), or None where nothing was said."""

    stamps: Stamps
    values: Array
    clipped: NDArray[np.uint8] | None = None


def of(samples: Samples) -> NDArray[np.uint8]:
    """Bits of samples in tool axes, dtype of `wire.IMU` or part of it; shape (n,)."""
    force = input_covariance.clipped(samples, "linear_acceleration").any(axis=1)
    rate = input_covariance.clipped(samples, "angular_velocity")
    bits = ACCEL * force + AXIAL_GYRO * rate[:, 0] + CROSS_GYRO * rate[:, 1:].any(axis=1)
    return np.asarray(bits, dtype=np.uint8)


def given(clipped: ArrayLike | None, count: int) -> NDArray[np.uint8]:
    """
    Bits of a block as a kernel takes them; None: nothing was said.

    Raises
    ------
    ValueError
        Not one value for each sample.
    """
    bits = np.zeros(count, dtype=np.uint8) if clipped is None else np.ascontiguousarray(clipped, dtype=np.uint8)
    if bits.shape != (count,):
        raise ValueError(f"clipped: expected shape ({count},), got {bits.shape}")
    return bits

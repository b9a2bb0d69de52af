# SPDX-License-Identifier: Apache-2.0
"""
Information that later measurements of the bounded filter add about earlier errors, without inverses.

The recursion is Bierman's (Fixed interval smoothing with discrete measurements, Int. J. Control 18, 1973). The smoother
uses its result to correct earlier errors, and `jumps` to find when an error has jumped.
"""

from __future__ import annotations

from typing import Any

from mwd_estimation.gravity.bounded.state import (
    ASKEW,
    BIAS,
    DOWN,
    POS,
    SCALE,
    STEADY,
    TILT,
    VEL,
    LaterInformation,
    UpdateSums,
)
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled, specialised
from mwd_sensors.core.constants import STANDARD_GRAVITY


@compiled
def carry_over(update: Any, spread: Array, known: LaterInformation) -> None:
    """
    Transform the information from the time after an update to the time before the interval of this update.

    update: record of `Update`; spread, shape (3,): variances of the three innovations, m^2; known: information of the
    later measurements.
    """
    A, B = known.matrix, known.transposed
    for axis in range(2, -1, -1):
        measured, gain = update.measured[axis], update.gain[axis]
        add_measurement(A, measured, gain, update.innovation[axis], spread[axis], known.row)
    carry_back(update.sums, A)
    for i in range(STEADY):
        for j in range(STEADY):
            B[i, j] = A[j, i]
    carry_back(update.sums, B)
    for i in range(STEADY):
        for j in range(STEADY):
            A[i, j] = B[i, j]


@compiled
def add_measurement(A: Array, h: Array, gain: Array, innovation: float, spread: float, w: Array) -> None:
    """
    Transform information from after to before one scalar measurement, and add the information of the measurement.

    A: information matrix, with the information vector L in the last column; h, gain, shape (STEADY,): row of H and
    Kalman gain of the measurement; innovation, m, and spread, m^2: its innovation and the variance of the innovation;
    w, shape (STEADY + 1,): scratch space. With C = I - gain h, A becomes C^T A C + h h^T / spread, and L becomes
    C^T L + h innovation / spread.
    """
    for j in range(STEADY + 1):
        w[j] = 0.0
    for i in range(STEADY):
        share = gain[i]
        for j in range(STEADY + 1):
            w[j] += share * A[i, j]
    half = 1.0 / spread
    for i in range(STEADY):
        half += w[i] * gain[i]
    half *= 0.5
    for j in range(STEADY):
        w[j] -= half * h[j]
    w[STEADY] -= innovation / spread
    for i in range(STEADY):
        if h[i] != 0.0:
            for j in range(STEADY + 1):
                A[i, j] -= h[i] * w[j]
            for j in range(STEADY):
                A[j, i] -= w[j] * h[i]


@specialised
def carry_back(sums: UpdateSums, A: Array) -> None:
    """Replace A, shape (STEADY, n), by F^T A, with the transition matrix F of `mechanisation.propagate`."""
    T = sums.time
    # Gravity acts through the mean of the tilts before and after the interval.
    pull = -0.5 * STANDARD_GRAVITY * T
    for j in range(A.shape[1]):
        x, y, down = A[VEL, j], A[VEL + 1, j], A[VEL + 2, j]
        # Information about the tilts after the interval, to which the sensor errors contribute.
        tilt_x, tilt_y = A[TILT, j] - pull * y, A[TILT + 1, j] + pull * x
        A[TILT, j] = tilt_x - pull * (y + 0.5 * T * A[POS + 1, j])
        A[TILT + 1, j] = tilt_y + pull * (x + 0.5 * T * A[POS, j])
        for i in range(3):
            A[BIAS + i, j] -= sums.bias[0, i] * tilt_x + sums.bias[1, i] * tilt_y
        A[SCALE, j] -= sums.scale[0] * tilt_x + sums.scale[1] * tilt_y
        for i in range(2):
            A[ASKEW + i, j] -= sums.askew[0, i] * tilt_x + sums.askew[1, i] * tilt_y
        A[DOWN, j] += T * (down + 0.25 * T * A[POS + 2, j])
        for i in range(3):
            A[VEL + i, j] += T * A[POS + i, j]

# SPDX-License-Identifier: Apache-2.0
"""
Check whether the gyros read a rotation while gravity does not rotate. This shows which of two differing gyros is wrong.

If the accelerometers are quiet, the direction of gravity in the tool changes only by w x f. If a gyro reads a rotation
across gravity, but the measured gravity does not rotate, the gyro has drifted beyond its bias. A rotation about gravity
itself, such as about the tool axis in a vertical hole, cannot be checked.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING, observe
from mwd_estimation.health.signal_checks import BIN_NS, FEW
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Number of half seconds that are checked together.
BINS = 8
# Largest rate, rad/s, at which the change of gravity over these half seconds is nearly equal to the rotation (1 rad).
_SLOW = 0.25
# Standard deviation of a value that changes evenly over half a second, as a share of the change; and number of standard
# deviations of the forces above which a rotation would show in them.
_EVEN, _SCATTERS = 1.0 / math.sqrt(12.0), 3.0


@compiled
def judge_rest(most: float, shakes: float, s: Any, checks: Any, channels: Any, began: int) -> None:
    """
    Check the half second that began at `began`, ns; call this after `signal_checks.summarise`.

    most: largest rate across gravity at rest of a healthy gyro, rad/s; shakes: largest standard deviation of a force at
    rest, m/s^2; s: record of `stream_checks.Stream`, whose `rest` and `rested` are updated.
    """
    for c in range(6):
        row = channels[c]
        # An accelerometer that repeats its values does not show gravity.
        if row.n < FEW or (c >= 3 and (row.spread > shakes or row.constant_bins > 0)):
            s.rested = 0
            return
    s.rest[:-1] = s.rest[1:].copy()
    for c in range(6):
        s.rest[BINS - 1, c] = channels[c].mean
    s.rested = min(s.rested + 1, BINS)
    if s.rested < BINS:
        return
    w, f = _lasting(s.rest), _mean(s.rest, 3)
    size = math.sqrt(f[0] ** 2 + f[1] ** 2 + f[2] ** 2)
    total = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    if size == 0.0:
        return
    x, y, z = w[1] * f[2] - w[2] * f[1], w[2] * f[0] - w[0] * f[2], w[0] * f[1] - w[1] * f[0]
    across = math.sqrt(x * x + y * y + z * z) / size
    moved, scatter = 0.0, 0.0
    for c in range(3):
        moved += (s.rest[BINS - 1, 3 + c] - s.rest[0, 3 + c]) ** 2
        scatter += channels[3 + c].spread ** 2
    seconds = 1e-9 * BIN_NS * (BINS - 1)
    seen = AGAINST if across <= most else NOTHING
    if total <= _SLOW and across - math.sqrt(moved) / size / seconds > most:
        seen = FOR
    # A faster rotation would increase the standard deviation of the forces within each half second.
    even = across * size * min(1e-9 * BIN_NS * _EVEN, 0.7 / max(total, _SLOW))
    if total > _SLOW and across > most and even > _SCATTERS * math.sqrt(scatter):
        seen = FOR
    observe(checks[FaultCode.REST_RATE.value, 0], seen, began, across, most)


@compiled
def _lasting(rest: Array) -> tuple[float, float, float]:
    """
    Return the median over the half seconds of each mean rate, rad/s.

    A median is used because a single wrong sample makes the mean of one half second wrong.
    """
    return np.median(rest[:, 0]), np.median(rest[:, 1]), np.median(rest[:, 2])


@compiled
def _mean(rest: Array, first: int) -> tuple[float, float, float]:
    """Return the means over the half seconds of three columns of `rest`, from column `first` on."""
    x, y, z = 0.0, 0.0, 0.0
    for row in range(BINS):
        x, y, z = x + rest[row, first], y + rest[row, first + 1], z + rest[row, first + 2]
    return x / BINS, y / BINS, z / BINS

# SPDX-License-Identifier: Apache-2.0
"""
Detect single wrong samples of a gyro, whose rates are within its range but far from the preceding rates.

From sample to sample a rate may change by a multiple of its usual recent change, or by the largest acceleration that a
string reaches. If a sample differs more from the last accepted one, later samples decide whether it is right: after a
wrong sample the rates are as before it, while a true change stays. Until this is known the sample counts as missing, so
that the sigmas grow as in a data gap. A true change thus costs the samples that confirm it.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# Changes of the rates about the axis and across it (y, z) that are always accepted, rad/s^2. A string that is released
# in stick-slip reaches 30 rad/s^2 (`test_a_stick_slip_release_is_believed`). At 100 Hz a wrong sample below this limit
# rotates the attitude by at most 0.3 and 0.1 deg.
_ACCELERATION = (60.0, 20.0, 20.0)
# A change larger than _UNUSUAL times the usual change (rms over _MEMORY, s) is doubted. It occurs in none of 600 000
# samples of the scenarios, and in less than 1 % of the samples of a phone that vibrates, is tapped and waved about.
_UNUSUAL, _MEMORY = 8.0, 0.5
# Time for which a changed rate must stay before it is accepted, s. About the axis, where torque can change it, one more
# sample is enough; across the axis a tool in its hole cannot be rotated so suddenly.
_GOES_ON = (0.0, 0.05, 0.05)
# Time without samples after which the last rate counts as unknown, s; and number of samples after which the usual
# change counts as known.
_SILENCE, _FIRST = 0.5, 10


class JumpState:
    """State of the detection for one gyro."""

    last_ns: int  #: stamp of the last sample with rates, ns
    count: int  #: number of samples with rates since the start or a gap
    last: Annotated[Array, 3]  #: rates of the last sample with rates, rad/s
    believed: Annotated[Array, 3]  #: rates of the last accepted sample, rad/s
    usual: Annotated[Array, 3]  #: mean square of the change from sample to sample, (rad/s)^2
    away: Annotated[Array, 3]  #: time for which a changed rate has stayed, s; negative: no change


_STATE = dtype_of(JumpState)


class RateJumps:
    """Detector of wrong samples of one gyro; the result does not depend on how the samples are cut into blocks."""

    def __init__(self) -> None:
        self._state = np.zeros(1, dtype=_STATE)

    def without(self, stamps: Stamps, gyro: Array) -> Array:
        """
        Return a copy of the rates with NaN for all axes of each doubted sample, or `gyro` itself if there is none.

        Parameters
        ----------
        stamps : ndarray of int64, shape (n,)
            Stamps, ns.
        gyro : ndarray, shape (n, 3)
            Rates, rad/s, in tool axes.
        """
        doubted = _run(self._state, stamps, gyro)
        if not doubted.any():
            return gyro
        gyro = gyro.copy()
        gyro[doubted] = np.nan
        return gyro


@compiled
def _run(state: Samples, stamps: Stamps, gyro: Array) -> NDArray[np.bool_]:
    """Update the state with samples; return a mask of the doubted samples, shape (n,)."""
    s: JumpState = state[0]
    doubted = np.zeros(len(stamps), dtype=np.bool_)
    for i in range(len(stamps)):
        if not math.isfinite(gyro[i, 0] + gyro[i, 1] + gyro[i, 2]):
            continue
        dt = 1e-9 * (stamps[i] - s.last_ns)
        if s.count > 0 and dt <= 0.0:
            # No stage uses a sample whose stamp does not advance.
            continue
        if s.count == 0 or dt > _SILENCE:
            s.count = 1
            s.usual[:] = 0.0
        else:
            for c in range(3):
                doubted[i] = _goes_astray(s, c, dt, gyro[i, c]) or doubted[i]
            s.count += 1
            doubted[i] = doubted[i] and s.count > _FIRST
        s.last_ns = stamps[i]
        for c in range(3):
            s.last[c] = gyro[i, c]
            if not doubted[i]:
                s.believed[c], s.away[c] = gyro[i, c], -1.0
    return doubted


@compiled
def _goes_astray(s: JumpState, c: int, dt: float, rate: float) -> bool:
    """
    Update the state of axis c; return whether its rate has changed and later samples have not confirmed the change yet.

    dt: time since the last sample, s; rate: rate of this sample, rad/s.
    """
    limit = max(_ACCELERATION[c] * dt, _UNUSUAL * math.sqrt(s.usual[c]))
    step = abs(rate - s.last[c])
    counted = step if s.count < _FIRST else min(step, limit)
    s.usual[c] += max(dt / (_MEMORY + dt), 1.0 / s.count) * (counted * counted - s.usual[c])
    if abs(rate - s.believed[c]) <= limit:
        s.away[c] = -1.0
    elif step > limit:
        s.away[c] = 0.0
    elif s.away[c] >= 0.0:
        s.away[c] += dt
        return bool(s.away[c] < _GOES_ON[c])
    return bool(s.away[c] >= 0.0)

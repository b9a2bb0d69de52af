# SPDX-License-Identifier: Apache-2.0
"""
Single wrong samples of a gyro: within its range, and unlike all that came before them.

A rate changes from sample to sample by as much as it has of late, or by the acceleration that a string reaches. A
sample that is farther from the last one believed is a hypothesis, which the samples behind it decide: a wrong sample is
followed by rates as before it, a true change goes on. Until that is known the sample counts as missing, so that what
stays uncertain is in the sigmas of a data gap. A true change costs the samples that confirm it.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# Changes of the rates about the axis and across it that are always believed, rad/s^2. A string that is released in
# stick-slip reaches 30 rad/s^2 (`test_a_stick_slip_release_is_believed`). At 100 Hz the turn by a wrong sample of less
# is 0.3 and 0.1 deg.
_ACCELERATION = (60.0, 20.0, 20.0)
# Times the usual change, root mean square of half a second, beyond which a change is doubted: none of 600 000 samples
# of the scenarios is, nor one of a hundred of a phone that vibrates, is tapped and waved about.
_UNUSUAL, _MEMORY = 8.0, 0.5
# Time for which a changed rate must go on to be believed, s: about the axis, where torque changes it, one more sample;
# across it a tool in its hole is not turned so suddenly.
_GOES_ON = (0.0, 0.05, 0.05)
# Seconds without a sample after which nothing is known of the last rate, and samples until the usual change is known.
_SILENCE, _FIRST = 0.5, 10


class JumpState:
    """State of one gyro."""

    last_ns: int  #: stamp of the last sample with rates, ns
    count: int  #: number of samples with rates since a start or a silence
    last: Annotated[Array, 3]  #: its rates, rad/s
    believed: Annotated[Array, 3]  #: rates of the last sample that was believed
    usual: Annotated[Array, 3]  #: usual square of the change from sample to sample
    away: Annotated[Array, 3]  #: time for which a changed rate has gone on, s; below 0: it has not changed


_STATE = dtype_of(JumpState)


class RateJumps:
    """Rates of one gyro, sample by sample; any cut of the stream gives the same."""

    def __init__(self) -> None:
        self._state = np.zeros(1, dtype=_STATE)

    def without(self, stamps: Stamps, gyro: Array) -> Array:
        """
        Return the rates with not a number for all axes of each doubted sample.

        Parameters
        ----------
        stamps : ndarray of int64, shape (n,)
            ns.
        gyro : ndarray, shape (n, 3)
            Rates, rad/s, in tool axes.
        """
        doubted = _run(self._state[0], stamps, gyro)
        if not doubted.any():
            return gyro
        gyro = gyro.copy()
        gyro[doubted] = np.nan
        return gyro


@compiled
def _run(s: JumpState, stamps: Stamps, gyro: Array) -> NDArray[np.bool_]:
    """Return which samples are doubted, shape (n,)."""
    doubted = np.zeros(len(stamps), dtype=np.bool_)
    for i in range(len(stamps)):
        if not math.isfinite(gyro[i, 0] + gyro[i, 1] + gyro[i, 2]):
            continue
        dt = 1e-9 * (stamps[i] - s.last_ns)
        if s.count > 0 and dt <= 0.0:
            # Such a sample is used nowhere.
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
    """Whether the rate of axis c, dt seconds after the last, is neither like the believed nor a change that goes on."""
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

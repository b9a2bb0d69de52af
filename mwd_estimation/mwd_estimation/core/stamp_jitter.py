# SPDX-License-Identifier: Apache-2.0
"""
Measure the jitter of the stamps of a stream, which causes an error of the toolface while the tool turns.

A sensor measures at equal intervals. If the stamps are whole periods apart, they come from the sensor's own clock, even
if samples are missing; their error is the difference from whole periods. If the stamps follow no period, they are times
of arrival, and their error is as large as the variation of their steps. A delay that all stamps share cannot be found.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_MEMORY = 200  # samples over which the steps are averaged
_FIRST = 50  # samples until the period is known
_SILENCE = 0.5  # s, a longer step is a gap
# Mean distance of the steps from whole periods, in periods, from which on there is no period: random ones have 0.25;
# and the share of the mean step below which a shortest step is none.
_UNEVEN, _SHORTEST = 0.17, 0.2


class JitterState:
    """State of one stream; the averages are exponential."""

    last_ns: int  #: stamp of the last sample, ns
    count: int  #: number of steps so far
    period: float  #: s
    mean: float  #: mean step, s
    square: float  #: mean square of the steps, s^2
    off: float  #: mean distance from whole periods, in periods
    off_square: float  #: mean square of that, s^2


JITTER_STATE = dtype_of(JitterState)


class StampJitter:
    """Error of the stamps of one stream, sample by sample; any cut of the stream gives the same."""

    def __init__(self) -> None:
        self._state = np.zeros(1, dtype=JITTER_STATE)

    def sigma(self, stamps: Stamps) -> Array:
        """Return the error of each stamp, 1 sigma, s, shape (n,); stamps: ns, shape (n,)."""
        sigma: Array = _run(self._state[0], stamps)
        return sigma


@compiled
def _run(s: JitterState, stamps: Stamps) -> Array:
    """Return the error of each stamp, 1 sigma, s, shape (n,)."""
    sigma = np.zeros(len(stamps))
    for i in range(len(stamps)):
        step = 1e-9 * (stamps[i] - s.last_ns)
        if s.last_ns == 0 or step > _SILENCE:
            s.last_ns = stamps[i]
        elif step > 0.0:
            s.last_ns = stamps[i]
            take_step(s, step)
        if s.count < _FIRST:
            continue
        if follows_no_period(s):
            sigma[i] = math.sqrt(max(s.square - s.mean * s.mean, 0.0))
        else:
            # The step has the errors of two stamps.
            sigma[i] = math.sqrt(0.5 * s.off_square)
    return sigma


@compiled
def follows_no_period(s: JitterState) -> bool:
    """Return whether the intervals between stamps are not multiples of one period."""
    return bool(s.off > _UNEVEN or s.period < _SHORTEST * s.mean)


@compiled
def take_step(s: JitterState, step: float) -> None:
    """Take one step, s."""
    if s.count == 0 or step < 0.6 * s.period:
        # The period assumed so far was two or more steps long, because samples were missing.
        s.count, s.period = 0, step
    s.count += 1
    share = max(1.0 / s.count, 1.0 / _MEMORY)
    if step < 1.5 * s.period:
        s.period += share * (step - s.period)
    s.mean += share * (step - s.mean)
    s.square += share * (step * step - s.square)
    off = step - s.period * round(step / s.period)
    s.off += share * (abs(off) / s.period - s.off)
    s.off_square += share * (off * off - s.off_square)

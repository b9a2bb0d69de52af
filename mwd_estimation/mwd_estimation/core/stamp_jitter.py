# SPDX-License-Identifier: Apache-2.0
"""
Measure the jitter of the stamps of a stream, which causes an error of the toolface while the tool turns.

A sensor measures at equal intervals. If the stamps are whole periods apart (several periods where samples are missing),
they come from the sensor's own clock; their error is the difference of their steps from whole periods. If the stamps
follow no period, they are times of arrival, and their error is as large as the variation of their steps. A delay that
all stamps share cannot be found.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_MEMORY = 200  # number of samples over which the steps are averaged
_FIRST = 50  # number of steps after which the period counts as known
_SILENCE = 0.5  # longest step that is not a gap, s
# The stamps follow no period if the mean distance of the steps from whole periods is above _UNEVEN periods (random
# steps: 0.25), or if the period found is shorter than the share _SHORTEST of the mean step.
_UNEVEN, _SHORTEST = 0.17, 0.2


class JitterState:
    """State of one stream. All means are exponential averages."""

    last_ns: int  #: stamp of the last sample, ns
    count: int  #: number of steps so far
    period: float  #: period of the sensor, s
    mean: float  #: mean step, s
    square: float  #: mean square of the steps, s^2
    off: float  #: mean distance of the steps from whole periods, in periods
    off_square: float  #: mean square distance of the steps from whole periods, s^2


JITTER_STATE = dtype_of(JitterState)


class StampJitter:
    """Estimator of the stamp error of one stream; the result does not depend on how the stream is cut into blocks."""

    def __init__(self) -> None:
        self._state = np.zeros(1, dtype=JITTER_STATE)

    def sigma(self, stamps: Stamps) -> Array:
        """Add stamps, ns, (n,); return 1 sigma of the error of each, s, (n,), which is 0 before 50 steps are known."""
        sigma: Array = _run(self._state, stamps)
        return sigma


@compiled
def _run(state: Samples, stamps: Stamps) -> Array:
    """Update the state with stamps; return 1 sigma of the error of each stamp, s, shape (n,)."""
    s: JitterState = state[0]
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
            # A step is the difference of two stamps, so its variance is twice the variance of a stamp.
            sigma[i] = math.sqrt(0.5 * s.off_square)
    return sigma


@compiled
def follows_no_period(s: JitterState) -> bool:
    """Return whether the intervals between stamps are not multiples of one period."""
    return bool(s.off > _UNEVEN or s.period < _SHORTEST * s.mean)


@compiled
def take_step(s: JitterState, step: float) -> None:
    """Update the period and the means with one step, s; restart them if the step is shorter than 0.6 periods."""
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

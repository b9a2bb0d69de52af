# SPDX-License-Identifier: Apache-2.0
"""
Clock of a stream: the jitter of its stamps, and the times of evenly measured samples from stamps with jitter.

A sensor measures at equal intervals, but a host may stamp the samples late, round the stamps, or read in batches. If
the stamps are whole periods apart (several periods where samples are missing), they come from the sensor's own clock;
their jitter is the difference of their steps from whole periods. If the stamps follow no period, they are times of
arrival, and their jitter is as large as the variation of their steps; it causes an error of the toolface while the tool
turns. A delay that all stamps share cannot be found.

A straight line is fitted to the stamps over the sample number; its slope is the period, and its memory grows to
`_LINE_MEMORY` samples. Stamps far from the line mean that samples are missing or that the clock was set; the line then
continues from these stamps with the same period. If all intervals are multiples of the period, the stamps are returned
unchanged, bit for bit, whether samples are missing or not. Batches of whole periods are also returned unchanged,
because they look like missing samples.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_MEMORY = 200  # number of samples over which the steps are averaged
_FIRST = 50  # number of steps after which the period counts as known and the line is used
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
        sigma: Array = _sigma(self._state, stamps)
        return sigma


@compiled
def _sigma(state: Samples, stamps: Stamps) -> Array:
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


_LINE_MEMORY = 1000  # longest memory of the line, samples: the jitter of a stamp becomes 16 times smaller
_EVEN = 1e-4  # jitter below which stamps stay unchanged, s; 1e-4 s is a toolface error of 0.07 deg at 120 r/min
_FAR = 4.0  # a stamp farther from the line than half a period plus _FAR sigmas is late, or samples are missing
_CONFIRMED = 4  # number of stamps in a row that are far from the line, after which the clock counts as set
_LATE = 10.0  # periods; a stamp that is far from the line and this long after the last stamp follows a data gap


class ClockState:
    """State of the clock of one stream."""

    last_ns: int  #: latest stamp, ns
    time_ns: int  #: latest time that was returned, ns
    line_s: float  #: time of the latest sample on the line, minus its stamp, s
    period: float  #: slope of the line: period of the sensor, s
    count: int  #: number of samples since the line began, at most `_LINE_MEMORY`
    square: float  #: mean squared distance of the stamps from the line, s^2
    far: int  #: number of samples in a row that were far from the line


_STATE = dtype_of(ClockState)


class StreamClock:
    """Times of the samples of one stream, which do not depend on how the stream is cut into blocks."""

    def __init__(self) -> None:
        self._state, self._steps = np.zeros(1, dtype=_STATE), np.zeros(1, dtype=JITTER_STATE)

    def times(self, stamps: Stamps) -> Stamps:
        """
        Return the times at which samples were measured, ns, shape (n,); stamps: ns, shape (n,).

        A sample whose stamp does not advance gets a time that does not advance either.
        """
        times = np.empty_like(stamps)
        _run(self._state, self._steps, stamps, times)
        return times


@compiled
def _run(state: Samples, steps: Samples, stamps: Stamps, times: Stamps) -> None:
    s: ClockState = state[0]
    j: JitterState = steps[0]
    for i in range(len(stamps)):
        stamp = stamps[i]
        if s.last_ns == 0:
            s.last_ns = s.time_ns = stamp
        elif stamp > s.last_ns:
            step = 1e-9 * (stamp - s.last_ns)
            if step < _SILENCE:
                take_step(j, step)
            s.last_ns = stamp
            time = stamp
            if not follows_no_period(j) and 0.5 * j.off_square < _EVEN * _EVEN:
                # The stamps are multiples of one period: use them unchanged, even if samples are missing.
                s.count = 0
            else:
                _follow(s, j, step)
            if s.count >= _FIRST:
                time = stamp + round(1e9 * s.line_s)
            # After a restart the line may give earlier times for some samples; the returned times must still increase.
            s.time_ns = max(time, s.time_ns + 1)
        else:
            times[i] = min(stamp, s.time_ns)
            continue
        times[i] = s.time_ns


@compiled
def _follow(s: ClockState, j: JitterState, step: float) -> None:
    """Continue the line to the next sample; step: time from the last stamp to its stamp, s; j: statistics of steps."""
    if s.count == 0:
        if j.count >= _FIRST:
            s.count, s.period, s.square = _FIRST, j.mean, j.square - j.mean * j.mean
            s.line_s, s.far = 0.0, 0
        return
    # Distance of the stamp from the line.
    off, sigma = step - s.line_s - s.period, math.sqrt(max(s.square, 0.0))
    if abs(off) > 0.5 * s.period + _FAR * sigma or step > _SILENCE:
        s.far += 1
        if s.far < _CONFIRMED and step < _LATE * s.period:
            # A single sample with a late stamp was measured at the time that the line gives.
            s.line_s = -off
            return
        # The clock was set, or there is a data gap; keep the period.
        s.line_s = 0.0
        s.count, s.far = _FIRST, 0
        return
    s.far = 0
    s.count = min(s.count + 1, _LINE_MEMORY)
    n = float(s.count)
    # Gains of a straight line fitted by least squares to n points, at its end.
    s.line_s = -off + 2.0 * (2.0 * n - 1.0) / (n * (n + 1.0)) * off
    s.period += 6.0 / (n * (n + 1.0)) * off
    s.square += max(1.0 / n, 1.0 / 200.0) * (off * off - s.square)

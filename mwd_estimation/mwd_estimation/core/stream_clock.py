# SPDX-License-Identifier: Apache-2.0
"""
Clock of a stream: the jitter of its stamps, and the times of evenly measured samples from stamps with jitter.

A sensor measures at equal intervals, but a host may stamp the samples late, round the stamps, or read in batches. If
the stamps are whole periods apart (several periods where samples are missing), they come from the sensor's own clock;
their jitter is the difference of their steps from whole periods. If the stamps follow no period, they are times of
arrival, and their jitter is as large as the variation of their steps; it causes an error of the toolface while the tool
turns. A delay that all stamps share cannot be found.

A stamp is the time of a reading and does not identify a sample: a coarse clock gives one stamp to several samples. Such
samples share a stamp; their number is counted, and the period is the time between different stamps divided by it. Exact
copies of a message must be removed before (`repeated_samples`).

A straight line is fitted to the stamps over the sample number; its slope is the period, and its memory grows to
`_LINE_MEMORY` stamps. Of samples that share a stamp, the first is fitted, because the clock has just advanced there;
the times are then shifted so that the mean time of the samples is their stamp. Stamps far from the line mean that
samples are missing or that the clock was set; the line then continues from these stamps with the same period. Where
samples share stamps, the first sample of a stamp was measured within a period after the clock advanced; after a missing
sample, the next stamps are farther from the line, and the number of missing samples is known again. If all
intervals are multiples of the period, the stamps are returned unchanged, bit for bit, whether samples are missing or
not. Batches of whole periods with increasing stamps are also returned unchanged, because they look like missing
samples.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_MEMORY = 200  # number of steps over which the steps are averaged
_FIRST = 50  # number of samples after which the period counts as known and the line is used
_FEW = 8  # smallest number of different stamps from which the period of samples that share stamps is known
_SILENCE = 0.5  # longest step that is not a gap, s
# A step after samples that share a stamp may be longer, up to this multiple of the last step.
_LONGER = 3.0
# Largest number of samples with one stamp, before the mean number is known, and as a multiple of this number plus a
# margin. If more samples have the same stamp, the clock has stopped.
_MOST, _TIMES, _MARGIN = 2000, 4.0, 60
# Mean number of samples with one stamp above which the samples share stamps; a single pair in _MEMORY stamps is 1.005.
_SHARED = 1.004
# The stamps follow no period if the mean distance of the steps from whole periods is above _UNEVEN periods (random
# steps: 0.25), or if the period found is shorter than the share _SHORTEST of the mean step.
_UNEVEN, _SHORTEST = 0.22, 0.2


class JitterState:
    """State of one stream. All means are exponential averages over the steps between different stamps."""

    begun: bool  #: whether there was a stamp
    last_ns: int  #: stamp of the last sample, ns
    count: int  #: number of steps so far
    samples: int  #: number of samples in these steps
    period: float  #: shortest usual step between stamps, s
    mean: float  #: mean step, s
    square: float  #: mean square of the steps, s^2
    off: float  #: mean distance of the steps from whole periods, in periods
    off_square: float  #: mean square distance of the steps from whole periods, s^2
    place: int  #: number of samples with the last stamp, minus 1
    step: float  #: last step that was not a data gap, s; the first one may be
    #: `group`, `places`, `places_square`: means, over the stamps, of the number of samples with one stamp, and of the
    #: sum and the sum of squares of their places 0, 1, 2, ...
    group: float
    places: float
    places_square: float


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
        if not s.begun or stamps[i] >= s.last_ns:
            take_stamp(s, stamps[i])
        if not is_known(s):
            continue
        sigma[i] = jitter(s)
        if shares_stamps(s):
            place = s.places / s.group
            spread = max(s.places_square / s.group - place * place, 0.0)
            sigma[i] = math.hypot(sigma[i], sensor_period(s) * math.sqrt(spread))
    return sigma


@compiled
def jitter(s: JitterState) -> float:
    """Return 1 sigma of the error of the first sample of each stamp, s."""
    if follows_no_period(s):
        return math.sqrt(max(s.square - s.mean * s.mean, 0.0))
    # A step is the difference of two stamps, so its variance is twice the variance of a stamp.
    return math.sqrt(0.5 * s.off_square)


@compiled
def is_known(s: JitterState) -> bool:
    """Return whether there were enough stamps to know the period."""
    return bool(s.count >= _FIRST or (shares_stamps(s) and s.count >= _FEW and s.samples >= _FIRST))


@compiled
def follows_no_period(s: JitterState) -> bool:
    """Return whether the intervals between stamps are not multiples of one period."""
    return bool(s.off > _UNEVEN or s.period < _SHORTEST * s.mean)


@compiled
def shares_stamps(s: JitterState) -> bool:
    """Return whether the clock is so coarse that several samples have the same stamp."""
    return bool(s.group > _SHARED)


@compiled
def sensor_period(s: JitterState) -> float:
    """Return the time between samples, s: if the stamps follow a period, also if samples are missing."""
    if shares_stamps(s) or follows_no_period(s):
        return s.mean / max(s.group, 1.0)
    return s.period


@compiled
def stands_still(s: JitterState) -> bool:
    """Return whether the clock has stopped: the latest stamp has repeated for more samples than usual."""
    return bool(s.place >= (_MOST if s.count < _FEW else _TIMES * s.group + _MARGIN))


@compiled
def take_stamp(s: JitterState, stamp: int) -> bool:
    """Update the means with a stamp, ns, not earlier than the last; return whether there is a data gap before it."""
    step = 1e-9 * (stamp - s.last_ns)
    if s.begun and step == 0.0:
        s.place += 1
        return False
    # A coarse clock makes long steps, but each of them follows several samples with one stamp.
    gap = s.begun and step >= _SILENCE and not (s.place > 0 and step < _LONGER * s.step)
    if s.begun and not gap:
        take_step(s, step)
    if s.begun and (not gap or s.count == 0):
        s.step = step
    s.begun, s.last_ns, s.place = True, stamp, 0
    return bool(gap)


@compiled
def take_step(s: JitterState, step: float) -> None:
    """Update the period and the means with one step, s; restart them if the step is shorter than 0.6 periods."""
    if s.count == 0 or step < 0.6 * s.period:
        # The period assumed so far was two or more steps long, because samples were missing.
        s.count, s.period, s.samples = 0, step, 0
    s.count += 1
    share = max(1.0 / s.count, 1.0 / _MEMORY)
    if step < 1.6 * s.period:
        s.period += share * (step - s.period)
    s.mean += share * (step - s.mean)
    s.square += share * (step * step - s.square)
    off = step - s.period * round(step / s.period)
    s.off += share * (abs(off) / s.period - s.off)
    s.off_square += share * (off * off - s.off_square)
    group = s.place + 1
    s.samples += group
    s.group += share * (group - s.group)
    # Sums of the first whole numbers and of their squares.
    s.places += share * (0.5 * s.place * group - s.places)
    s.places_square += share * (s.place * group * (2.0 * s.place + 1.0) / 6.0 - s.places_square)


_LINE_MEMORY = 1000  # longest memory of the line, stamps: the jitter of a stamp becomes 16 times smaller
# The same for samples that share stamps, and the memory with which their line begins and continues after missing
# samples. The period from the count of samples is too long if samples are missing; a short memory corrects it soon.
_SHARED_MEMORY, _SHARED_FIRST = 400, 16
_EVEN = 1e-4  # jitter below which stamps stay unchanged, s; 1e-4 s is a toolface error of 0.07 deg at 120 r/min
# A stamp is far from the line, so that it is late or samples are missing, if its distance is more than half a period
# and more than _FAR sigmas. A stamp that is more than _LATE periods after the line follows missing samples.
_FAR, _LATE = 3.0, 10.0
# The same limit, in periods, of samples that share stamps, and the limit of stamps after the line while samples are
# missing. The first limit is larger, because a coarse clock that drifts along the samples gives now and then a sample
# more or less to a stamp.
_SHARED_FAR, _LOSSY_FAR = 1.25, 0.7
# Some samples are missing if the root mean square distance of the stamps from the line is above this share of a period.
# If no sample is missing, the distances are spread over one period (0.29).
_SPREAD = 0.45
# A second stamp at the same distance from the line, within this share of a period or _FAR sigmas, confirms that samples
# are missing. If they usually are, the first stamp is enough: share of such stamps above which they usually are, and
# weight of the newest one.
_ALIKE, _USUALLY, _LEARNS = 0.125, 0.4, 0.1
# If the stamps are off the line by more than _ASTRAY times their jitter and by more than the share _LOOSE of a period,
# samples were lost and the numbers of the others are not known. The line is then not used for the next _REST stamps.
_ASTRAY, _LOOSE, _REST = 1.5, 0.25, 1000


class ClockState:
    """State of the clock of one stream."""

    time_ns: int  #: latest time that was returned, ns
    line_s: float  #: time of the latest sample on the line, minus its stamp, s
    period: float  #: slope of the line: period of the sensor, s
    count: int  #: number of stamps since the line began, at most `_LINE_MEMORY`; negative: number of stamps without it
    square: float  #: mean squared distance of the stamps from the line, s^2
    missing: float  #: share of the stamps far from the line that followed missing samples, 0 to 1; the others were late
    waiting: float  #: distance of the last stamp from the line, s, if it was far and is not explained yet, otherwise 0
    lossy: bool  #: whether samples were missing in the last stamps, at most `_SHARED_MEMORY`; only if they share stamps
    moved: float  #: time, s, by which the line was moved at the last stamp, because samples seemed to be missing


_STATE = dtype_of(ClockState)


class StreamClock:
    """Times of the samples of one stream, which do not depend on how the stream is cut into blocks."""

    def __init__(self) -> None:
        self._state, self._steps = np.zeros(1, dtype=_STATE), np.zeros(1, dtype=JITTER_STATE)

    def times(self, stamps: Stamps) -> Stamps:
        """
        Return the times at which samples were measured, ns, shape (n,); stamps: ns, shape (n,), without exact copies.

        The times increase, also for samples that share a stamp. A sample whose stamp is earlier than an earlier one, or
        comes from a clock that stands still, gets a time that does not advance either.
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
        if not j.begun:
            take_stamp(j, stamp)
            times[i] = s.time_ns = stamp
            continue
        if stamp < j.last_ns or (stamp == j.last_ns and stands_still(j)):
            times[i] = min(stamp, s.time_ns)
            continue
        step = 1e-9 * (stamp - j.last_ns)
        gap = take_stamp(j, stamp)
        time = stamp
        if not shares_stamps(j) and not follows_no_period(j) and 0.5 * j.off_square < _EVEN * _EVEN:
            # The stamps are multiples of one period: use them unchanged, even if samples are missing.
            s.count = 0
        else:
            _follow(s, j, step, gap)
        if s.count > 0:
            # The line goes through the first sample of each stamp; the mean time of the samples is their stamp.
            time = stamp + round(1e9 * (s.line_s - s.period * j.places / max(j.group, 1.0)))
        # After a restart the line may give earlier times for some samples; the returned times must still increase.
        s.time_ns = max(time, s.time_ns + 1)
        times[i] = s.time_ns


@compiled
def _follow(s: ClockState, j: JitterState, step: float, gap: bool) -> None:
    """
    Continue the line to the next sample.

    step: time from the last stamp to its stamp, s; j: statistics of steps; gap: whether there is a data gap before it.
    """
    if s.count <= 0:
        s.count += int(s.count < 0)
        if s.count == 0 and is_known(j):
            s.count, s.period, s.square, s.lossy = _FIRST, sensor_period(j), jitter(j) ** 2, False
            if shares_stamps(j):
                s.count, s.square = _SHARED_FIRST, s.period * s.period / 12.0
            s.line_s, s.waiting, s.moved = j.place * s.period, 0.0, 0.0
        return
    s.line_s += s.period - step
    if step == 0.0:
        return
    # Distance of the stamp from the line.
    off, spread = -s.line_s, _FAR * math.sqrt(max(s.square, 0.0))
    shared = shares_stamps(j)
    late = early = max(0.5 * s.period, spread)
    if shared:
        late = early = max(_SHARED_FAR * s.period, _FAR * jitter(j))
        if s.lossy:
            late = min(late, _LOSSY_FAR * s.period + _FAR * jitter(j))
    if off > late or off < -early or gap:
        _explain(s, off, max(_ALIKE * s.period, spread), gap, shared)
        return
    if s.waiting != 0.0:
        s.missing -= _LEARNS * s.missing
    if s.moved != 0.0:
        s.missing += _LEARNS * (1.0 - s.missing)
    s.waiting = s.moved = 0.0
    s.count = min(s.count + 1, _SHARED_MEMORY if shared else _LINE_MEMORY)
    n = float(s.count)
    # Gains of a straight line fitted by least squares to n points, at its end; the points are `group` samples apart.
    s.line_s += 2.0 * (2.0 * n - 1.0) / (n * (n + 1.0)) * off
    s.period += 6.0 / (n * (n + 1.0)) * off / max(j.group, 1.0)
    s.square += max(1.0 / n, 1.0 / 200.0) * (off * off - s.square)
    if shared and not s.lossy and s.square > _SPREAD * _SPREAD * s.period * s.period + jitter(j) ** 2:
        s.lossy, s.count = True, _SHARED_FIRST
    elif s.count == _SHARED_MEMORY:
        s.lossy = False
    if s.square > max(_ASTRAY * _expected(j), _LOOSE * s.period) ** 2:
        s.count = -_REST


@compiled
def _expected(j: JitterState) -> float:
    """Return the expected distance, 1 sigma, of the first samples of the stamps from the line, s."""
    # The first sample of a stamp was measured up to a period after the coarse clock advanced.
    return max(jitter(j), 0.5 * sensor_period(j) if shares_stamps(j) else 0.0)


@compiled
def _explain(s: ClockState, off: float, alike: float, gap: bool, shared: bool) -> None:
    """
    Move the line by whole periods if samples are missing or the clock was set, but not if a single stamp is late.

    After missing samples the next stamps are as far from the line, or farther; after a late stamp they are nearer. off:
    distance of a stamp from the line, s; alike: largest difference of equal distances, s; gap: whether there is a data
    gap before the stamp; shared: whether samples share stamps.
    """
    whole = s.period * round(off / s.period)
    # Not nearer than the last stamp, on the same side: more samples may be missing.
    again = (0.0 < s.waiting < off + alike and off > 0.0) or (off - alike < s.waiting < 0.0 and off < 0.0)
    undone = s.moved != 0.0 and abs(off + s.moved) < alike
    if undone or (again and off < 0.0):
        s.missing -= _LEARNS * s.missing
    elif again:
        s.missing += _LEARNS * (1.0 - s.missing)
    first = s.waiting == 0.0 and off > 0.0 and s.missing > _USUALLY
    if not (gap or undone or again or first or off > _LATE * s.period):
        # The sample was measured at the time that the line gives.
        s.waiting, s.moved = off, 0.0
        return
    s.line_s += whole
    s.moved = whole if first and not undone else 0.0
    s.waiting = 0.0
    if shared:
        s.count, s.lossy = min(s.count, _SHARED_FIRST), True
    elif abs(off - whole) > 0.25 * s.period:
        s.count = min(s.count, _FIRST)

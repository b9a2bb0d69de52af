# SPDX-License-Identifier: Apache-2.0
"""
Check the times of the samples: stamps should advance, the rate should be constant, no sample should come twice.

`Stream` is the record of the whole stream; each function here updates a part of it.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.core.time_jumps import BACK_NS
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, OK, observe, weigh
from mwd_estimation.health.motion_window import Samples
from mwd_estimation.health.signal_checks import BIN_NS, FEW, SignalLimits
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# A stamp that does not advance adds 2 to a score, any other stamp subtracts 1. The stamps are a fault if the score
# reaches _STAMP_FAULT; _STAMP_MOST is the upper limit of the score.
_STAMP_FAULT, _STAMP_MOST = 200, 400
# Smallest number of intervals for learning the sample rate; and multiples of the usual interval above which an interval
# is long, and below which it is short.
_LEARN, _LONG, _SHORT = 12, 1.4, 0.7
# A shorter interval, ns, is that of samples with one stamp whose times are not known yet (`core.stream_clock`).
_NO_INTERVAL_NS = 1000
# Number of half seconds at another constant rate after which this rate becomes the usual one; and smallest number of
# samples in such a half second.
_SET_BINS, _FEW_INTERVALS = 60, 4


class Stream:
    """State of the stream of samples: half second, window, rate, and sensors that must not be used."""

    stage: int  #: position at which the kernel stopped, numbered as in `monitor`
    open: int  #: 1 after the first sample
    bin: int  #: index of the open half second: its start divided by its length, ns
    #: `first`, `stop`: indices among the waiting samples of the first one in the open half second, and of the first one
    #: after it.
    first: int
    stop: int
    mag_first: int  #: index among the waiting magnetic samples of the first one that no half second has used
    last_ns: int  #: stamp from which the next interval is counted, ns
    newest_ns: int  #: stamp of the last received sample, ns
    stamp_score: int  #: plus 2 for each stamp that does not advance, minus 1 for each that does
    #: `steps`, `parts`: number of steps and half seconds of the open window (`motion_window`).
    steps: int
    parts: int
    period: float  #: usual interval of the samples, s; 0 before it is known
    mag_came: int  #: 1 once a magnetic sample has arrived
    doubt_left: Annotated[Indices, 3]  #: number of half seconds for which each sensor stays doubtful
    doubtful: int  #: bits of the sensors that were doubtful in the last half second
    window: Annotated[Indices, 3]  #: worst state of each sensor in the window: 0, CLIPPED or BROKEN of `window_checks`
    #: `window_ns`, `judged_ns`: start of the open window, and end of the last full window evaluated; 0 if none.
    window_ns: int
    judged_ns: int
    in_vain: int  #: number of full windows with motion evaluated so far
    broken: int  #: 1 if there is a gap after the last half second
    judge: int  #: 1 if the window must be evaluated now
    end_ns: int  #: end of the last evaluated half second, ns
    #: `unusable`, `suspect`: bits of the sensors that must not be used, and of doubtful ones.
    unusable: int
    suspect: int
    #: `rest`, `rested`: mean rates, rad/s, and forces, m/s^2, of the last quiet half seconds, and number of these half
    #: seconds (`rest_check`).
    rest: Annotated[Array, 8, 6]
    rested: int
    #: `other_period`, `at_other`: another constant interval between samples, s, and number of half seconds for which it
    #: has lasted.
    other_period: float
    at_other: int


STREAM = dtype_of(Stream)


class PaceCounts(NamedTuple):
    """Counts of the intervals between samples, and of the samples, in half a second."""

    steps: int  #: number of intervals
    long: int  #: number of long intervals
    short: int  #: number of short intervals
    imu: int  #: number of IMU samples


@compiled
def judge_stamp(s: Any, checks: Any, stamp: int) -> int:
    """Check whether a stamp, ns, advances when it arrives; return the number of checks that changed."""
    good = stamp > s.newest_ns
    s.newest_ns = stamp
    s.stamp_score = min(max(s.stamp_score + (-1 if good else 2), 0), _STAMP_MOST)
    check = checks[FaultCode.STAMPS.value, 0]
    bad = s.stamp_score >= _STAMP_FAULT and not good and check.state != FAULT
    if not bad and (s.stamp_score > 0 or check.state == OK):
        return 0
    observe(check, FOR if bad else AGAINST, stamp, 1.0 * s.stamp_score, 1.0 * _STAMP_FAULT)
    return int(weigh(checks))


@compiled
def _pace(s: Any, samples: Samples) -> PaceCounts:
    """Return the counts of intervals of the half second; the first half second with enough of them sets the rate."""
    if s.period == 0.0 and s.stop - s.first > _LEARN and not _shares_stamps(s, samples):
        s.period = _usual_interval(s, samples)
    steps, long, short = 0, 0, 0
    for i in range(s.first, s.stop):
        interval = samples.stamps[i] - s.last_ns
        if 0 < interval < BIN_NS:
            steps += 1
            long += int(1e-9 * interval > _LONG * s.period)
            short += int(1e-9 * interval < _SHORT * s.period)
        if interval > 0 or interval < -BACK_NS:
            s.last_ns = samples.stamps[i]
    return PaceCounts(steps, long, short, s.stop - s.first)


@compiled
def _shares_stamps(s: Any, samples: Samples) -> bool:
    """Return whether samples of the half second have one stamp, and no times of their own yet."""
    steps = samples.stamps[s.first + 1 : s.stop] - samples.stamps[s.first : s.stop - 1]
    return bool(((steps > 0) & (steps < _NO_INTERVAL_NS)).any())


@compiled
def _usual_interval(s: Any, samples: Samples) -> float:
    """
    Return the usual interval between samples of the half second, s.

    It is the interval at one third of the sorted intervals: up to about a third of the samples may be lost.
    """
    return float(
        1e-9
        * np.sort(samples.stamps[s.first + 1 : s.stop] - samples.stamps[s.first : s.stop - 1])[(s.stop - s.first) // 3]
    )


@compiled
def _follow_rate(s: Any, checks: Any, samples: Samples) -> None:
    """Accept a new sample rate, as set in the unit, after it has been constant for _SET_BINS half seconds."""
    if checks[FaultCode.RATE.value, 0].state != FAULT or s.stop - s.first <= _FEW_INTERVALS:
        s.at_other = 0
        return
    interval = _usual_interval(s, samples)
    odd = 0
    for i in range(s.first + 1, s.stop):
        step = 1e-9 * (samples.stamps[i] - samples.stamps[i - 1])
        odd += int(not _SHORT * interval <= step <= _LONG * interval)
    even = 10 * odd <= s.stop - s.first
    same = even and _SHORT * s.other_period <= interval <= _LONG * s.other_period
    s.at_other = s.at_other + 1 if same else int(even)
    s.other_period = interval
    if s.at_other >= _SET_BINS:
        s.period, s.at_other = interval, 0


@compiled
def judge_silence(expected: bool, s: Any, checks: Any, channels: Any, began: int) -> None:
    """Check whether magnetic samples arrive; expected: whether the tool has a magnetometer."""
    if channels[6].n + channels[6].not_finite > 0:
        s.mag_came = 1
        observe(checks[FaultCode.NEVER_CAME.value, 6], AGAINST, began, 0.0, 0.0)
        observe(checks[FaultCode.SILENT.value, 6], AGAINST, began, 0.0, 0.0)
    elif expected:
        code = FaultCode.SILENT.value if s.mag_came else FaultCode.NEVER_CAME.value
        observe(checks[code, 6], FOR, began, 0.0, 0.0)


@compiled
def judge_stream(p: SignalLimits, checks: Any, channels: Any, s: Any, samples: Samples, began: int) -> bool:
    """
    Check whether the sample rate is constant and no sample comes twice; call this before `judge_bin`.

    Returns True if rotations are unknown because too many intervals are too long.
    """
    _follow_rate(s, checks, samples)
    pace, period = _pace(s, samples), s.period
    if period > 0.0 and pace.steps >= 2:
        odd = pace.long + pace.short
        seen = FOR if odd > p.off_pace * pace.steps else (AGAINST if odd < p.in_pace * pace.steps else NOTHING)
        observe(checks[FaultCode.RATE.value, 0], seen, began, pace.imu / (1e-9 * BIN_NS), 1.0 / period)
    for s in range(2):
        lively, least, repeats = 0.0, 0.0, pace.imu
        for c in range(3 * s, 3 * s + 3):
            row = channels[c]
            if row.n >= FEW:
                lively = max(lively, row.total2 / row.n - (row.total / row.n) ** 2)
            least = max(least, row.least_step)
            repeats = min(repeats, row.repeats)
        if lively > (p.steps * least) ** 2 and not channels[3 * s].constant_bins:
            share = repeats / max(pace.imu, 1)
            seen = FOR if share > p.repeated else AGAINST
            observe(checks[FaultCode.REPEATED.value, 3 * s], seen, began, share, p.repeated)
    return bool(period > 0.0 and pace.steps >= 2 and pace.long > p.lost * pace.steps)


# Samples that were sent before and come again with new stamps, for example if a link sends its buffer twice. The noise
# of real sensors never repeats: a row of four samples, 24 numbers, occurs only once. A 64-bit hash is kept of every
# eighth row on average. The hash itself selects these rows, so that a repetition is found wherever it begins. If most
# selected rows of a half second were kept before, the data of the half second are old. Hash: Fibonacci hashing, D. E.
# Knuth, *The Art of Computer Programming* 3, 6.4.

# Number of samples in a row; and number of hashes kept, which last eleven hours at 100 Hz.
_ROW, _SLOTS = 4, 1 << 19
_ZERO, _ONE, _FACTOR = np.uint64(0), np.uint64(1), np.uint64(0x9E3779B97F4A7C15)
_SHIFT, _CHOSEN, _MASK = np.uint64(29), np.uint64(7), np.uint64(_SLOTS - 1)
# Smallest number and smallest share of old rows in a half second with replayed samples.
_LEAST, _SHARE = 2, 0.5


def blank_hashes() -> Any:
    """Return an empty table of hashes, shape (slots,), uint64."""
    return np.zeros(_SLOTS, dtype=np.uint64)


@compiled
def _hash(gyro: Any, accel: Any, i: int) -> Any:
    """Return the hash of the bits of a sample; gyro, accel, shape (n, 3), uint64."""
    found = _ONE
    for c in range(3):
        found = (found ^ gyro[i, c]) * _FACTOR
        found ^= found >> _SHIFT
        found = (found ^ accel[i, c]) * _FACTOR
        found ^= found >> _SHIFT
    return found


@compiled
def judge_replay(kept: Any, checks: Any, samples: Samples, first: int, stop: int, began: int) -> None:
    """
    Check the samples of half a second, and keep the hashes of their rows.

    kept: result of `blank`; first, stop: the samples have the indices `first` to `stop` - 1; began: start of the half
    second, ns.
    """
    gyro, accel = samples.gyro.view(np.uint64), samples.accel.view(np.uint64)
    rows, old, length = 0, 0, 0
    h0, h1, h2, h3 = _ZERO, _ZERO, _ZERO, _ZERO
    # Skip a sample that is repeated with its own stamp: no stage uses it.
    newest = began - 1
    for i in range(first, stop):
        if samples.stamps[i] <= newest:
            continue
        newest = samples.stamps[i]
        h0, h1, h2, h3 = h1, h2, h3, _hash(gyro, accel, i)
        # Skip rows of a sensor that repeats one value: another check finds this fault.
        length = 1 if h3 == h2 else length + 1
        row = ((h0 * _FACTOR ^ h1) * _FACTOR ^ h2) * _FACTOR ^ h3
        if length < _ROW or row & _CHOSEN != _ZERO:
            continue
        slot = (row >> _SHIFT) & _MASK
        rows += 1
        old += int(kept[slot] == row)
        kept[slot] = row
    seen = AGAINST if rows > 0 and old == 0 else NOTHING
    if old >= _LEAST and old > _SHARE * rows:
        seen = FOR
    observe(checks[FaultCode.REPLAYED.value, 0], seen, began, old / max(rows, 1), _SHARE)

"""
What half a second of samples shows of a sensor by itself: values that stick, that are at the end of the range, that are
no numbers, that do not come, that come twice or at another pace.

Samples are counted one by one; `close_bin` judges what was counted and notes it for `health_evidence`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.health.fault_debounce import (
    ABSENT,
    AGAINST,
    ALWAYS,
    DEAD,
    FOR,
    GYRO,
    HELD,
    INVALID,
    MAG,
    NOISE,
    NOTHING,
    OFTEN,
    RATE,
    SATURATED,
    STUCK,
    note,
)
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

Whole = NDArray[np.int64]

BIN_NS = 500_000_000
ABSURD = 1e12
BROKEN = 1000  # counts of a spoilt window: from here on values are missing or held, below some were clipped only

_FEW = 10  # samples below which the repeats within a bin say nothing
_SOME = 3.0  # samples below which half a second says nothing: a magnetometer may come at 10 Hz
_TRUSTED = 6.0  # bins at rest in which an axis must have varied before its silence at rest counts

# Per channel: last value, samples, not finite, repeats, first value, sums about it, at the limit, least step, bins that
# were constant up to now, balance of bins at rest in which it varied, bins in a row that were wholly at the limit, sum
# of the squares of its steps.
LAST, _N, _BAD, _SAME, _FIRST, _S1, _S2, _CLIP, _STEP, CONST, _LIVELY, _WHOLE, _D2, _ROW = range(14)
# Counts: steps of time, those long and short, samples of the bin; values held (2); magnetic bins missing and seen; of
# the window: bins spoilt, by sensor (3), those in which a steady force pushed, those with samples missing, and those in
# which the force was noise.
STEPS, LONG, SHORT, IMU, HOLDS, _MAG_SILENT, _MAG_EVER, SPOILT, _PUSHED, _GAPS, _NOISY = (
    0, 1, 2, 3, 4, 6, 7, 8, 11, 12, 13,
)  # fmt: skip
_COUNTS = 14
# m/s^2 along an axis, mean of half a second: more than gravity and than what noise leaves of a mean.
_PUSH = 15.0
# m/s^2 that white noise leaves of such a mean, which no motion in a hole does; and mean square of a step of what is
# white, in variances: 2 but for chance.
_NOISE, _WHITE = 8.0, 1.4
# T; a field that jumps so much from sample to sample is none, and one that is so large is in another unit.
_FIELD_NOISE, _NO_TESLA = 1e-4, 3e-3


def blank() -> tuple[Array, Whole]:
    """Channels (9, ...) of gyro, accelerometer and magnetometer, and counts, before the first sample."""
    channels = np.zeros((9, _ROW))
    channels[:, LAST], channels[:, _STEP] = math.nan, math.inf
    return channels, np.zeros(_COUNTS, dtype=np.int64)


@compiled
def count(channels: Array, c: int, values: Array, k: int, start: int, stop: int, limit: float) -> None:
    """Count column k of the rows from start to stop as values of channel c."""
    # One channel at a time, whole numbers as such and no view of the row: this is most of what the watch costs.
    last, first, fresh = channels[c, LAST], channels[c, _FIRST], channels[c, _N] == 0.0
    s1, s2, least, steps2 = channels[c, _S1], channels[c, _S2], channels[c, _STEP], channels[c, _D2]
    bad, same, clip = 0, 0, 0
    for i in range(start, stop):
        v = values[i, k]
        size = abs(v)
        if not size < ABSURD:
            bad += 1
            continue
        if fresh:
            first, fresh = v, False
        away = abs(v - last)
        same += int(away == 0.0)
        if away > 0.0:
            least = min(least, away)
            steps2 += away * away
        last = v
        away = v - first
        s1 += away
        s2 += away * away
        # Far beyond the range is another unit, not the end of the range.
        if size >= limit:
            clip += int(size <= 1.02 * limit)
    channels[c, LAST], channels[c, _FIRST], channels[c, _STEP] = last, first, least
    channels[c, _S1], channels[c, _S2], channels[c, _D2] = s1, s2, steps2
    channels[c, _N] += stop - start - bad
    channels[c, _BAD] += bad
    channels[c, _SAME] += same
    channels[c, _CLIP] += clip


@compiled
def _spread(row: Array) -> float:
    n = row[_N]
    if n < 2.0:
        return 0.0
    mean = row[_S1] / n
    return math.sqrt(max(row[_S2] / n - mean * mean, 0.0))


@compiled
def _mean(row: Array) -> float:
    return row[_FIRST] + row[_S1] / row[_N] if row[_N] > 0.0 else 0.0


@compiled
def close_bin(
    began: int, channels: Array, counts: Whole, notes: Whole, limits: Array, period: float, expects_mag: bool
) -> int:
    """
    Judge the half second that began at `began`, ns, note what it shows and make room for the next.

    limits, shape (3,): ends of the ranges, in the sensors' units; period: of the IMU's samples, s, 0 while not known.
    Returns the bits of sensors whose values stick, lie at the end of the range, are missing or late, however short.
    """
    doubtful = 0
    now = began + BIN_NS
    spreads = np.zeros(9)
    gyro_moves, shakes, pushed, noisy = False, False, False, False
    field2, size2, worst, noise, jumps, strong = 0.0, 0.0, 0.0, 0.0, False, 0
    for c in range(9):
        row = channels[c]
        if row[_N] >= _SOME:
            row[CONST] = row[CONST] + 1.0 if row[_SAME] >= row[_N] else 0.0
        spreads[c] = _spread(row)
        mean = _mean(row)
        n, variance = row[_N], spreads[c] ** 2
        white = n >= _FEW and row[_D2] > _WHITE * n * variance
        if c >= 6:
            field2 += mean * mean
            size2 += mean * mean + variance
            if spreads[c] > _FIELD_NOISE:
                jumps = jumps or white
                strong |= 1 << (c - 6)
                noise = max(noise, spreads[c])
        elif c >= 3:
            pushed = pushed or abs(mean) > _PUSH
            noisy = noisy or (white and variance > n * _NOISE**2)
        if row[CONST] == 0.0:
            if c < 3:
                gyro_moves = gyro_moves or spreads[c] > 0.02 or abs(mean) > 0.1
            elif c < 6:
                shakes = shakes or spreads[c] > 0.3
            else:
                worst = max(worst, spreads[c])
    if jumps and size2 < _NO_TESLA**2:
        doubtful |= MAG
        note(notes, NOISE, FOR, began, int(1e6 * noise + 0.5), strong, 0)
    elif channels[6, _N] >= _FEW:
        note(notes, NOISE, AGAINST, began, 0, 0, 0)
    counts[_PUSHED] += int(pushed)
    counts[_NOISY] += int(noisy)
    field_turns = worst > 0.01 * math.sqrt(field2)
    any_motion = gyro_moves or shakes or field_turns
    for s in range(3):
        first = 3 * s
        # What the other sensors feel; the magnetometer feels no shaking.
        moving = (gyro_moves and s != 0) or (shakes and s == 0) or (field_turns and s != 2)
        n, bad, axis, constant, zeros = 0.0, 0.0, 0, 0, 0
        step, longest, lively = math.inf, math.inf, math.inf
        for c in range(3):
            row = channels[first + c]
            n += row[_N]
            bad += row[_BAD]
            axis |= int(row[_BAD] > 0.0) << c
            constant += int(row[CONST] > 0.0)
            zeros += int(row[LAST] == 0.0)
            step = min(step, row[_STEP])
            longest = min(longest, row[CONST])
            lively = min(lively, row[_LIVELY])
            counts[SPOILT + s] += int(row[_CLIP] > 0.01 * row[_N])
            counts[SPOILT + s] += BROKEN * int(row[_BAD] > 0.01 * (row[_N] + row[_BAD]) or row[CONST] > 0.0)
        feels = zeros == 3 or moving or lively >= _TRUSTED
        missing = bad > 0.06 * (n + bad)
        doubtful |= int(missing or (constant == 3 and feels)) << s
        if n + bad > 0.0:
            note(notes, INVALID + s, int(missing), began, axis, 0, 0)
        # A whole sensor that gives the same numbers.
        if constant == 3:
            if longest >= 6.0 and feels:
                note(notes, DEAD + s, FOR, now - int(longest) * BIN_NS, int(zeros == 3), 0, 0)
        elif n >= 3.0 * _SOME:
            note(notes, DEAD + s, AGAINST, began, 0, 0, 0)
        for c in range(3):
            row = channels[first + c]
            if row[_N] < _SOME:
                continue
            other = max(spreads[first + (c + 1) % 3], spreads[first + (c + 2) % 3])
            k = first + c
            if row[CONST] == 0.0:
                note(notes, STUCK + k, AGAINST, began, 0, 0, 0)
            elif constant < 3 and abs(row[LAST]) < limits[s]:
                shown = (any_motion and other >= 10.0 * step) or row[_LIVELY] >= _TRUSTED
                doubtful |= int(shown) << s
                if row[CONST] >= 4.0:
                    since = now - int(row[CONST]) * BIN_NS
                    note(notes, STUCK + k, FOR if shown else NOTHING, since, int(row[LAST] == 0.0), 0, 0)
            if limits[s] < math.inf:
                share = row[_CLIP] / row[_N]
                # "Always" takes two seconds of nothing else.
                row[_WHOLE] = row[_WHOLE] + 1.0 if share > 0.9 else 0.0
                # A gyro beyond its range for a while is a string that turns fast.
                doubtful |= int(share > 0.9 and s != 0) << s
                note(notes, SATURATED + k, int(share > 0.2), began, ALWAYS if row[_WHOLE] >= 4.0 else OFTEN, 0, 0)
            # A healthy axis varies at rest, most of the time; one whose steps hide its noise never proves it.
            if not any_motion and row[CONST] == 0.0:
                varies = row[_N] - row[_SAME] >= 0.3 * row[_N]
                row[_LIVELY] = min(row[_LIVELY] + 1.0, 30.0) if varies else max(row[_LIVELY] - 3.0, -30.0)
    if _note_stream(began, channels, counts, notes, period, expects_mag, spreads):
        # What the gyros turned between samples that did not come is not known.
        doubtful |= GYRO
    for c in range(9):
        for k in (_N, _BAD, _SAME, _S1, _S2, _CLIP, _D2):
            channels[c, k] = 0.0
    for k in range(_MAG_SILENT):
        counts[k] = 0
    return doubtful


@compiled
def _note_stream(
    began: int, channels: Array, counts: Whole, notes: Whole, period: float, expects_mag: bool, spreads: Array
) -> bool:
    """Whether samples come, at their pace, and each once; returns whether the IMU's come late."""
    if expects_mag and counts[IMU] > 0:
        if channels[6, _N] + channels[6, _BAD] == 0.0:
            counts[_MAG_SILENT] += 1
            long = counts[_MAG_SILENT] >= (4 if counts[_MAG_EVER] else 10)
            since = began + BIN_NS - counts[_MAG_SILENT] * BIN_NS
            note(notes, ABSENT, FOR if long else NOTHING, since, counts[_MAG_EVER], 0, 0)
        else:
            counts[_MAG_SILENT] = 0
            counts[_MAG_EVER] = 1
            note(notes, ABSENT, AGAINST, began, 0, 0, 0)
    steps, odd = counts[STEPS], counts[LONG] + counts[SHORT]
    if period > 0.0 and steps >= 2:
        seen = FOR if odd > 0.6 * steps else (AGAINST if odd < 0.2 * steps else NOTHING)
        note(notes, RATE, seen, began, int(counts[LONG] > counts[SHORT]), int(1000.0 / period), 0)
    counts[_GAPS] += int(counts[LONG] > 0.02 * steps)
    late = period > 0.0 and steps >= 2 and counts[LONG] > 0.75 * steps
    for s in range(2):
        n, lively, step = channels[3 * s, _N], 0.0, 0.0
        for c in range(3 * s, 3 * s + 3):
            lively, step = max(lively, spreads[c]), max(step, channels[c, _STEP])
        if n >= _FEW and lively > 10.0 * step and channels[3 * s, CONST] == 0.0:
            share = counts[HOLDS + s] / n
            note(notes, HELD + s, int(share > 0.3), began, int(10.0 * share + 0.5) * 10, 0, 0)
    return late

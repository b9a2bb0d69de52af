"""
Health of the sensors from their own samples: what is wrong, with which sensor and axis, since when, and what to do.

Samples are counted half second by half second; every three seconds the motion is asked whether the axes belong
together (`axis_consistency`). Every check is in one of three states: not yet known, ok, fault. What the motion so far
cannot show stays "not yet known"; a fault needs repeated evidence and goes only on repeated evidence of the contrary.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation import axis_consistency as axes
from mwd_sensors.compiled import compiled
from mwd_sensors.settings import setting

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

BIN_NS = 500_000_000
_WINDOW = 6  # bins
_RING = 4096  # samples waiting for the magnetometer's of the same time
_EVENTS = 256

UNKNOWN, OK, FAULT = 0, 1, 2
GYRO, ACCEL, MAG = 1, 2, 4  # bits of what cannot be used
SENSORS = ("gyro", "accelerometer", "magnetometer")

# Checks: first index of each; per axis (9), per sensor (3) or single.
STUCK, SATURATED, INVALID, DEAD, UNIT, AXES, SIGN, FRAME, ABSENT, RATE, STAMPS, HELD, MISMATCH = (
    0, 9, 18, 21, 24, 27, 28, 29, 30, 31, 32, 33, 35,
)  # fmt: skip
CHECKS = 36

_FEW = 10  # samples below which a window, or the sample-by-sample repeats of a bin, say nothing
_SOME = 3.0  # samples below which half a second says nothing: a magnetometer may come at 10 Hz
_TRUSTED = 6.0  # bins at rest in which an axis must have varied before its silence at rest counts
_ABSURD = 1e12
_BROKEN = 1000  # counts of a spoilt window: from here on values are missing or held, below some were clipped only

# Per channel: last value, samples, not finite, repeats, first value, sums about it, at the limit, least step, bins that
# were constant up to now, balance of bins at rest in which it varied.
_LAST, _N, _BAD, _SAME, _FIRST, _S1, _S2, _CLIP, _STEP, _CONST, _LIVELY, _ROW = range(12)
# Integers: ring head and length, magnetic samples used, bin and whether one is open, last stamps taken, carried and
# come, bins of the window, magnetic bins missing and seen, steps of time and those long and short, samples of the bin,
# events, sensors not to be used, score of the stamps, values held, bins spoilt for the window by sensor, place in
# the block of the sample that brings the judgement.
(_HEAD, _LEN, _MHEAD, _BIN, _OPEN, _HAVE, _LAST_NS, _CARRY_NS, _NEWEST, _BINS, _MAG_SILENT, _MAG_EVER, _STEPS, _LONG,
 _SHORT, _IMU, _EVENT_COUNT, _UNUSABLE, _STAMP_SCORE, _HELD_COUNT, _, _SPOILT, _, _, _PLACE,
 _INTS) = range(26)  # fmt: skip
# Reals: reference gravity, total, dip (nan unknown); period, s, and the steps and time it is learned from.
_G, _TOTAL, _DIP, _PERIOD, _LEARNED, _SPAN, _REALS = range(7)
# Of a check: state, evidence for in a row, evidence against in a row, since, three details.
_STATE, _UP, _DOWN, _FROM, _D0, _D1, _D2 = range(7)


_ORDERS = np.array([[*np.argmax(np.abs(m), axis=1), *m.sum(axis=1)] for m in axes.MAPPINGS], dtype=np.int64)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the health checks."""

    watch: bool = setting(True, "Watch the sensors")
    gyro_range_deg_s: float = setting(
        2000.0, "The gyro reads no more than this; 0: not known", unit="deg/s", low=0.0, high=1e5
    )
    accel_range_g: float = setting(
        16.0, "The accelerometer reads no more than this; 0: not known", unit="g", low=0.0, high=1e4
    )
    mag_range_ut: float = setting(
        800.0, "The magnetometer reads no more than this; 0: not known", unit="uT", low=0.0, high=1e5
    )
    rate_hz: float = setting(0.0, "Sample rate of the IMU; 0: learned from its first seconds", unit="Hz", low=0.0)
    mag_lag_s: float = setting(
        0.05, "Samples wait so long for the magnetometer's of their time", unit="s", low=0.0, high=0.4
    )
    mag_expected: bool = setting(True, "A magnetometer belongs to the tool")


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    One fault, or its end, in words a driller understands.

    Attributes
    ----------
    kind : str
        stuck, saturated, invalid, dead, unit, swapped, flipped, frame, absent, rate, stamps, held or mismatch.
    sensor, axis : str
        Which; several possible ones are joined by "/" ("" where no single axis is meant).
    severity : str
        "error": the sensor must not be used; "warning": it may, with care.
    confidence : float
        0 to 1: share of the possible explanations that is named, less where the evidence is indirect.
    message, remedy : str
    since_ns : int
        Stamp from which on the evidence stands.
    cleared_ns : int
        Stamp at which it was gone; 0 while it lasts.
    unusable : int
        Bits GYRO, ACCEL, MAG of what must not be used while it lasts.
    check : int
        Number of the check: the same fault, narrowed down or cleared, has the same.
    """

    kind: str
    sensor: str
    axis: str
    severity: str
    confidence: float
    message: str
    remedy: str
    since_ns: int
    cleared_ns: int = 0
    unusable: int = 0
    check: int = -1


@dataclasses.dataclass
class State:
    """All that changes; `copy` gives an independent one."""

    ring_ns: Whole
    ring: Array
    mag_ns: Whole
    mag: Array
    ints: Whole
    reals: Array
    channels: Array
    sums: Array
    lengths: Array
    checks: Whole
    events: Whole

    def copy(self) -> State:
        """An independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Step:
    """
    What one block gave.

    Attributes
    ----------
    unusable : ndarray of uint8, shape (n,)
        Bits GYRO, ACCEL, MAG as known at each sample of the block.
    changes : list of Finding
        Faults found, narrowed down or cleared, in order.
    places : list of int
        Sample of the block that brought each change.
    """

    unusable: NDArray[np.uint8]
    changes: list[Finding]
    places: list[int]


def initial(
    params: Params, gravity: float | None = None, total: float | None = None, dip: float | None = None
) -> State:
    """State before the first sample; reference gravity, m/s^2, field, T, and dip, rad, where known."""
    del params
    state = State(
        ring_ns=np.zeros(_RING, dtype=np.int64),
        ring=np.zeros((_RING, 6)),
        mag_ns=np.zeros(0, dtype=np.int64),
        mag=np.zeros((0, 3)),
        ints=np.zeros(_INTS, dtype=np.int64),
        reals=np.zeros(_REALS),
        channels=np.zeros((9, _ROW)),
        sums=np.zeros(axes.SIZE),
        lengths=np.zeros((2, 50)),
        checks=np.zeros((CHECKS, 7), dtype=np.int64),
        events=np.zeros((_EVENTS, 8), dtype=np.int64),
    )
    state.channels[:, _LAST] = math.nan
    state.channels[:, _STEP] = math.inf
    axes.begin(state.sums)
    set_reference(state, gravity, total, dip)
    return state


def set_reference(state: State, gravity: float | None, total: float | None, dip: float | None) -> None:
    """Judge totals and dip by this from now on; None where unknown. m/s^2, T, rad."""
    state.reals[_G] = 9.80665 if gravity is None else gravity
    state.reals[_TOTAL] = math.nan if total is None else total
    state.reals[_DIP] = math.nan if dip is None else dip


def push_mag(state: State, stamp_ns: ArrayLike, b_t: ArrayLike) -> None:
    """
    Take magnetic samples, not only the good ones: shapes (n,) and (n, 3), T. To be pushed before the IMU of their time.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    field = np.ascontiguousarray(b_t, dtype=np.float64)
    if field.shape != (*stamps.shape, 3) or stamps.ndim != 1:
        raise ValueError(f"b_t: expected shape ({stamps.size}, 3) beside stamps (n,), got {field.shape}")
    state.mag_ns = np.concatenate([state.mag_ns, stamps])
    state.mag = np.concatenate([state.mag, field])


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Step:
    """
    Take a block of IMU samples of any length; the state changes in place.

    Parameters
    ----------
    params : Params
    state : State
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        rad/s and m/s^2 as they come, not finite ones too.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    gyro, accel = (np.ascontiguousarray(block, dtype=np.float64) for block in (gyro_t, accel_t))
    for name, block in (("gyro_t", gyro), ("accel_t", accel)):
        if block.shape != (*stamps.shape, 3) or stamps.ndim != 1:
            raise ValueError(f"{name}: expected shape ({stamps.size}, 3) beside stamps (n,), got {block.shape}")
    unusable = np.zeros(len(stamps), dtype=np.uint8)
    limits = 0.9995 * np.array(
        [math.radians(params.gyro_range_deg_s), params.accel_range_g * 9.80665, params.mag_range_ut * 1e-6]
    )
    limits[limits == 0.0] = math.inf
    lag = round(params.mag_lag_s * 1e9)
    changes: list[Finding] = []
    places: list[int] = []
    done = 0
    while done < len(stamps) and params.watch:
        state.ints[_EVENT_COUNT] = 0
        done = _run(
            state.ring_ns, state.ring, state.mag_ns, state.mag, state.ints, state.reals, state.channels, state.sums,
            state.lengths, state.checks, state.events, axes.TABLE_WAYS, axes.MISTAKES, axes.WEIGHTS, _ORDERS, limits,
            params.rate_hz, params.mag_expected, lag, stamps, gyro, accel, done, unusable,
        )  # fmt: skip
        for row in state.events[: state.ints[_EVENT_COUNT]]:
            changes.append(_words(row))
            places.append(int(row[7]))
    _forget_used(state)
    return Step(unusable, changes, places)


def _forget_used(state: State) -> None:
    used = int(state.ints[_MHEAD])
    if used:
        state.mag_ns, state.mag = state.mag_ns[used:].copy(), state.mag[used:].copy()
        state.ints[_MHEAD] = 0


@compiled
def _vote(
    checks: Whole, events: Whole, ints: Whole, k: int, seen: int, need: int, clear: int, keep: bool, now: int,
    began: int, d0: int, d1: int, d2: int,
) -> None:  # fmt: skip
    """Weigh one observation of a check: 1 fault, 0 no fault, -1 not to be seen; note a change of its state."""
    row = checks[k]
    changed = False
    if seen == 1:
        if row[_UP] == 0:
            row[_FROM] = began
        row[_UP] += 1
        row[_DOWN] = 0
        if row[_STATE] != FAULT:
            row[_D0], row[_D1], row[_D2] = d0, d1, d2
            changed = row[_UP] >= need
        elif k in (AXES, FRAME) or SATURATED <= k < INVALID:
            changed = d0 != row[_D0] or (k >= INVALID and (d1 != row[_D1] or d2 != row[_D2]))
            row[_D0], row[_D1], row[_D2] = d0, d1, d2
        if row[_UP] >= need:
            row[_STATE] = FAULT
    elif seen == 0:
        row[_DOWN] += 1
        if row[_STATE] == FAULT:
            if row[_DOWN] >= clear:
                row[_STATE] = OK
                row[_UP] = 0
                changed = True
        else:
            if not keep or row[_DOWN] >= clear:
                row[_UP] = 0
            if row[_UP] == 0:
                row[_STATE] = OK
    if changed and ints[_EVENT_COUNT] < len(events):
        event = events[ints[_EVENT_COUNT]]
        event[0], event[1], event[2], event[3] = now, k, row[_STATE], row[_FROM]
        event[4], event[5], event[6], event[7] = row[_D0], row[_D1], row[_D2], ints[_PLACE]
        ints[_EVENT_COUNT] += 1
    if changed:
        ints[_UNUSABLE] = _unusable(checks)


@compiled
def _ones(mask: int) -> int:
    count = 0
    for k in range(48):
        count += mask >> k & 1
    return count


@compiled
def _unusable(checks: Whole) -> int:
    bits = 0
    for k in range(9):
        if checks[STUCK + k, _STATE] == FAULT or (
            checks[SATURATED + k, _STATE] == FAULT and checks[SATURATED + k, _D0] >= 90
        ):
            bits |= 1 << (k // 3)
    for s in range(3):
        for base in (INVALID, DEAD, UNIT):
            if checks[base + s, _STATE] == FAULT:
                bits |= 1 << s
    if checks[AXES, _STATE] == FAULT:
        bits |= (1 if checks[AXES, _D0] else 0) | (2 if checks[AXES, _D1] else 0) | (4 if checks[AXES, _D2] else 0)
    if checks[SIGN, _STATE] == FAULT:
        bits |= checks[SIGN, _D0]
    if checks[FRAME, _STATE] == FAULT:
        named = _ones(checks[FRAME, _D1]) + _ones(checks[FRAME, _D2])
        bits |= MAG | (ACCEL if checks[FRAME, _D1] and named <= 4 else 0)
    if checks[ABSENT, _STATE] == FAULT and checks[ABSENT, _D0] == 1:
        bits |= MAG
    if checks[MISMATCH, _STATE] == FAULT:
        bits |= GYRO
    return bits


@compiled
def _count(channels: Array, c: int, v: float, limit: float) -> None:
    """Count one value of one channel."""
    size = abs(v)
    if not size < _ABSURD:
        channels[c, _BAD] += 1.0
        return
    away = abs(v - channels[c, _LAST])
    if away == 0.0:
        channels[c, _SAME] += 1.0
    elif away < channels[c, _STEP]:
        channels[c, _STEP] = away
    channels[c, _LAST] = v
    if channels[c, _N] == 0.0:
        channels[c, _FIRST] = v
    channels[c, _N] += 1.0
    away = v - channels[c, _FIRST]
    channels[c, _S1] += away
    channels[c, _S2] += away * away
    # Far beyond the range is another unit, not the end of the range.
    if limit <= size <= 1.02 * limit:
        channels[c, _CLIP] += 1.0


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
def _close_bin(
    ints: Whole, reals: Array, channels: Array, checks: Whole, events: Whole, limits: Array, expects_mag: bool
) -> None:  # fmt: skip
    """Judge what half a second shows by itself and make room for the next."""
    began = ints[_BIN] * BIN_NS
    now = began + BIN_NS
    gyro_moves, shakes, field_turns = False, False, False
    field2, worst = 0.0, 0.0
    for c in range(9):
        row = channels[c]
        enough = row[_N] >= _SOME
        constant = enough and row[_SAME] >= row[_N]
        if constant:
            row[_CONST] += 1.0
        elif enough:
            row[_CONST] = 0.0
        if row[_CONST] == 0.0:
            spread, mean = _spread(row), _mean(row)
            if c < 3:
                gyro_moves = gyro_moves or spread > 0.02 or abs(mean) > 0.1
            elif c < 6:
                shakes = shakes or spread > 0.3
            else:
                worst = max(worst, spread)
        if c >= 6:
            field2 += _mean(row) ** 2
    field_turns = worst > 0.01 * math.sqrt(field2)
    for s in range(3):
        first = 3 * s
        if s == 0:
            moving = shakes or field_turns
        elif s == 1:
            moving = gyro_moves or field_turns
        else:
            moving = gyro_moves
        any_motion = gyro_moves or shakes or field_turns
        n = channels[first, _N] + channels[first + 1, _N] + channels[first + 2, _N]
        bad = channels[first, _BAD] + channels[first + 1, _BAD] + channels[first + 2, _BAD]
        axis = 0
        for c in range(3):
            if channels[first + c, _BAD] > 0.0:
                axis |= 1 << c
        if n + bad > 0.0:
            seen = 1 if bad > 0.06 * (n + bad) else 0
            _vote(checks, events, ints, INVALID + s, seen, 2, 4, False, now, began, axis, 0, 0)
        constant = 0
        step = math.inf
        for c in range(3):
            row = channels[first + c]
            if row[_CONST] > 0.0:
                constant += 1
            step = min(step, row[_STEP])
        # A whole sensor that gives the same numbers.
        longest = min(channels[first, _CONST], channels[first + 1, _CONST], channels[first + 2, _CONST])
        lively = min(channels[first, _LIVELY], channels[first + 1, _LIVELY], channels[first + 2, _LIVELY])
        if constant == 3:
            zero = (
                channels[first, _LAST] == 0.0
                and channels[first + 1, _LAST] == 0.0
                and channels[first + 2, _LAST] == 0.0
            )
            sure = zero or moving or lively >= _TRUSTED
            if longest >= 6.0 and sure:
                _vote(checks, events, ints, DEAD + s, 1, 1, 4, False, now, now - int(longest) * BIN_NS, int(zero), 0, 0)
        elif n >= 3.0 * _SOME:
            _vote(checks, events, ints, DEAD + s, 0, 1, 4, False, now, began, 0, 0, 0)
        for c in range(3):
            row = channels[first + c]
            other = max(_spread(channels[first + (c + 1) % 3]), _spread(channels[first + (c + 2) % 3]))
            if row[_N] >= _SOME:
                if row[_CONST] == 0.0:
                    if checks[STUCK + first + c, _STATE] != OK or checks[STUCK + first + c, _UP] > 0:
                        _vote(checks, events, ints, STUCK + first + c, 0, 2, 4, False, now, began, 0, 0, 0)
                elif constant < 3 and row[_CONST] >= 4.0:
                    seen = -1
                    if (any_motion and other >= 10.0 * step) or row[_LIVELY] >= _TRUSTED:
                        seen = 1
                    since = now - int(row[_CONST]) * BIN_NS
                    at_limit = abs(row[_LAST]) >= limits[s]
                    if not at_limit:
                        _vote(checks, events, ints, STUCK + first + c, seen, 2, 4, False, now, since,
                              int(row[_LAST] == 0.0), 0, 0)  # fmt: skip
                if limits[s] < math.inf:
                    share = row[_CLIP] / row[_N]
                    seen = 1 if share > 0.2 else 0
                    # "Always" takes two seconds of nothing else.
                    whole = checks[SATURATED + first + c, _D1] + 1 if share > 0.9 else 0
                    checks[SATURATED + first + c, _D1] = whole
                    if (
                        seen == 1
                        or checks[SATURATED + first + c, _STATE] != OK
                        or checks[SATURATED + first + c, _UP] > 0
                    ):
                        _vote(checks, events, ints, SATURATED + first + c, seen, 4, 12, True, now, began,
                              95 if whole >= 4 else 25, whole, 0)  # fmt: skip
                # A healthy axis varies at rest, most of the time; one whose steps hide its noise never proves it.
                if not any_motion and row[_CONST] == 0.0:
                    lively = row[_N] - row[_SAME] >= 0.3 * row[_N]
                    row[_LIVELY] = min(row[_LIVELY] + 1.0, 30.0) if lively else max(row[_LIVELY] - 3.0, -30.0)
    for s in range(3):
        for c in range(3):
            row = channels[3 * s + c]
            ints[_SPOILT + s] += int(row[_CLIP] > 0.01 * row[_N])
            ints[_SPOILT + s] += _BROKEN * int(row[_BAD] > 0.01 * (row[_N] + row[_BAD]) or row[_CONST] > 0.0)
    # The magnetometer is silent while the IMU speaks.
    count = channels[6, _N] + channels[6, _BAD]
    if expects_mag and ints[_IMU] > 0:
        if count == 0.0:
            ints[_MAG_SILENT] += 1
            need = 4 if ints[_MAG_EVER] else 10
            seen = 1 if ints[_MAG_SILENT] >= need else -1
            _vote(checks, events, ints, ABSENT, seen, 1, 2, False, now, now - ints[_MAG_SILENT] * BIN_NS,
                  ints[_MAG_EVER], 0, 0)  # fmt: skip
        else:
            ints[_MAG_SILENT] = 0
            ints[_MAG_EVER] = 1
            _vote(checks, events, ints, ABSENT, 0, 1, 2, False, now, began, 0, 0, 0)
    # Rate and values sent twice.
    steps = ints[_STEPS]
    if reals[_PERIOD] > 0.0 and steps >= 2:
        seen = (
            1 if ints[_LONG] + ints[_SHORT] > 0.6 * steps else (0 if ints[_LONG] + ints[_SHORT] < 0.2 * steps else -1)
        )
        _vote(checks, events, ints, RATE, seen, 5, 4, False, now, began, int(ints[_LONG] > ints[_SHORT]),
              int(1000.0 / reals[_PERIOD]), 0)  # fmt: skip
    for s in range(2):
        n = channels[3 * s, _N]
        lively = max(_spread(channels[3 * s]), _spread(channels[3 * s + 1]), _spread(channels[3 * s + 2]))
        step = max(channels[3 * s, _STEP], channels[3 * s + 1, _STEP], channels[3 * s + 2, _STEP])
        if n >= _FEW and lively > 10.0 * step and channels[3 * s, _CONST] == 0.0:
            share = ints[_HELD_COUNT + s] / n
            _vote(checks, events, ints, HELD + s, 1 if share > 0.3 else 0, 8, 8, False, now, began,
                  int(10.0 * share + 0.5) * 10, 0, 0)  # fmt: skip
    for c in range(9):
        row = channels[c]
        row[_N] = row[_BAD] = row[_SAME] = row[_S1] = row[_S2] = row[_CLIP] = 0.0
    ints[_LONG] = ints[_SHORT] = ints[_STEPS] = 0
    ints[_HELD_COUNT] = ints[_HELD_COUNT + 1] = 0
    ints[_IMU] = 0


@compiled
def _dip_of(sums: Array, order: Whole, signs: Whole, of_force: bool, scale: float) -> float:
    """Dip, rad, if that sensor's axes were exchanged and reversed so; nan where the products say more than 1."""
    total = 0.0
    for row in range(3):
        if of_force:
            total += signs[row] * axes.product(sums, row, order[row])
        else:
            total += signs[row] * axes.product(sums, order[row], row)
    sine = -total / scale
    return math.asin(min(max(sine, -1.0), 1.0)) if abs(sine) < 1.1 else math.nan


@compiled
def _close_window(
    ints: Whole, reals: Array, sums: Array, lengths: Array, checks: Whole, events: Whole, ways: Whole,
    mistakes: Whole, weights: Whole, orders: Whole, now: int, spoilt: Whole,
) -> None:  # fmt: skip
    """Judge what three seconds of motion show of units, axes and signs."""
    began = now - _WINDOW * BIN_NS
    seconds = 1e-9 * _WINDOW * BIN_NS
    gravity = reals[_G]
    count_f = axes.lengths(ways, sums, False, lengths[0])
    count_b = axes.lengths(ways, sums, True, lengths[1])
    force2, field2 = axes.mean_square(sums, False), axes.mean_square(sums, True)
    path = axes.path(sums)
    # Units.
    accel_unit = -1
    if count_f >= _FEW and spoilt[1] < _BROKEN:
        # Some way to carry it along is nearly right, whatever else is wrong; off the axis the tool's own turning adds.
        rms, still = math.sqrt(force2), math.sqrt(lengths[0, 49]) / gravity
        as_si, as_g, as_mg = False, False, False
        for k in range(50):
            carried = math.sqrt(lengths[0, k]) / gravity
            as_si = as_si or abs(carried - 1.0) < 0.15
            as_g = as_g or abs(9.80665 * carried - 1.0) < 0.15
            as_mg = as_mg or abs(carried / 101.97 - 1.0) < 0.1
        if rms < 0.7 * gravity and as_g:
            accel_unit = 1
        elif rms > 30.0 * gravity and as_mg:
            accel_unit = 2
        elif path < 0.3 and abs(still / 3.2808 - 1.0) < 0.06 and force2 < 1.2 * lengths[0, 49]:
            accel_unit = 3
        elif as_si and rms > 0.8 * gravity:
            accel_unit = 0
        seen = 1 if accel_unit > 0 else accel_unit
        _vote(checks, events, ints, UNIT + 1, seen, 2, 2, False, now, began, max(accel_unit, 0), 0, 0)
    field_unit = -1
    if count_b >= 3 and spoilt[2] < _BROKEN:
        rms = math.sqrt(field2)
        expected = reals[_TOTAL] if math.isfinite(reals[_TOTAL]) else 5e-5
        if 5e-6 < rms < 3e-4:
            field_unit = 0
        elif rms > 3e-4:
            power = math.log10(rms / expected)
            for k in range(5):
                whole = (3.0, 4.0, 6.0, 7.0, 9.0)[k]
                if abs(power - whole) < 0.5 and (field_unit <= 0 or abs(power - whole) < 0.4):
                    field_unit = k + 1
        seen = 1 if field_unit > 0 else field_unit
        _vote(checks, events, ints, UNIT + 2, seen, 2, 2, False, now, began, max(field_unit, 0), 0, 0)
    # Which ways explain gravity and field.
    okay_f, okay_b = np.zeros(48, dtype=np.bool_), np.zeros(48, dtype=np.bool_)
    bad_f, bad_b, tells_f, tells_b = False, False, False, False
    judge_f, judge_b = False, False
    some_f, deg_f, deg_b = False, False, False
    usable_gyro = spoilt[0] == 0 and checks[DEAD, _STATE] != FAULT
    length = gravity
    if accel_unit == 1:
        length = gravity / 9.80665
    elif accel_unit == 2:
        length = gravity * 101.97
    if usable_gyro and spoilt[1] == 0 and count_f >= 4 * _FEW and accel_unit >= 0:
        best = 0.0
        for k in range(48):
            best = max(best, lengths[0, k])
        # White noise at most; vibration that was integrated by the sensor leaves far less.
        sigma = math.sqrt(max(force2 - best, 0.0) / (3.0 * count_f)) / length
        sigma = max(min(sigma, 1.5 * axes.force_noise(ways, sums) / length), 0.004)
        if sigma < 0.08:
            judge_f = True
            all_of, top = True, 0.0
            for k in range(48):
                off = math.sqrt(max(lengths[0, k] / length**2 - 3.0 * sigma**2, 0.0)) - 1.0
                okay_f[k] = abs(off) < 0.06 + 3.0 * sigma
                some_f = some_f or okay_f[k]
                if okay_f[k]:
                    top = max(top, lengths[0, k] / length**2)
                all_of = all_of and abs(off) < 0.1 + 3.0 * sigma
                if k == 0:
                    own = off
            # What is common to two ways, the part along the axis of rotation, cancels between them with its noise.
            margin = 0.05 + 2.2 * sigma
            for k in range(48):
                okay_f[k] = okay_f[k] and lengths[0, k] / length**2 > top - margin
            behind = top - lengths[0, 0] / length**2
            bad_f = abs(own) > 0.12 + 6.0 * sigma or (own < -0.02 - 2.5 * sigma and behind > margin)
            tells_f = not bad_f and abs(own) < 0.1 + 3.0 * sigma and not all_of
            deg_f = abs(math.sqrt(lengths[0, 48]) / length - 1.0) < 0.06 + 3.0 * sigma
    if usable_gyro and spoilt[2] == 0 and count_b >= 10 and field2 > 0.0:
        best, least = 0.0, 2.0
        for k in range(48):
            best = max(best, lengths[1, k] / field2)
            least = min(least, lengths[1, k] / field2)
        fixed = lengths[1, 49] / field2
        judge_b = best > 0.93
        for k in range(48):
            okay_b[k] = lengths[1, k] / field2 > best - 0.04
        own = lengths[1, 0] / field2
        bad_b = judge_b and best - own > 0.1 and fixed < 0.9
        tells_b = judge_b and best - own < 0.04 and least < best - 0.1
        deg_b = lengths[1, 48] / field2 > 0.95
        if own < 0.8 and best < 0.85 and lengths[1, 48] / field2 < 0.9:
            bad_b = True
    # Gyros in deg/s: no string turns that fast, or it turns 57 times less than they say.
    too_fast = path / seconds > 50.0
    if spoilt[0] == 0 or too_fast:
        seen = -1
        explained = (judge_f and some_f) or judge_b
        if (too_fast and path / seconds < 50.0 / axes.DEG) or (path > 1.0 and (deg_f or deg_b) and not explained):
            seen = 1
        elif (tells_f or tells_b) and path > 0.5:
            seen = 0
        _vote(checks, events, ints, UNIT, seen, 2, 2, False, now, began, 1, 0, 0)
        if seen == 1 or checks[UNIT, _STATE] == FAULT:
            return
    rejected_f, rejected_b = judge_f and bad_f, bad_b
    seen = -1
    masks = np.zeros(3, dtype=np.int64)
    if rejected_f or (rejected_b and judge_b):
        known = math.isfinite(reals[_DIP]) and count_b > 0 and abs(math.sqrt(field2) / reals[_TOTAL] - 1.0) < 0.1
        scale = length * math.sqrt(max(field2, 1e-300))
        for use_dip in range(2):
            lightest = 99
            for m in range(len(mistakes)):
                explains = (not judge_f or okay_f[mistakes[m, 2]]) and (not judge_b or okay_b[mistakes[m, 3]])
                if explains and use_dip == 0 and known:
                    k = mistakes[m, 1] if mistakes[m, 0] > 0 else 0
                    dip = _dip_of(sums, orders[k, :3], orders[k, 3:], mistakes[m, 0] == 1, scale)
                    explains = abs(dip - reals[_DIP]) < 0.21
                if not explains or weights[m] > lightest:
                    continue
                if weights[m] < lightest:
                    masks[:] = 0
                    lightest = weights[m]
                masks[mistakes[m, 0]] |= 1 << mistakes[m, 1]
            if lightest < 99:
                seen = 1
                break
    elif tells_f or tells_b:
        seen = 0
    if seen == 1 and checks[AXES, _UP] > 0:
        # What two windows leave possible together.
        both = np.array([masks[k] & checks[AXES, _D0 + k] for k in range(3)])
        if both[0] | both[1] | both[2]:
            masks[:] = both
    _vote(checks, events, ints, AXES, seen, 2, 2, False, now, began, masks[0], masks[1], masks[2])
    # Nothing explains it.
    puzzled = -1
    if seen == 0:
        puzzled = 0
    elif seen == -1 and rejected_f and bad_b and checks[UNIT, _UP] == 0:
        puzzled = 1
    _vote(checks, events, ints, MISMATCH, puzzled, 3, 2, False, now, began, 0, 0, 0)
    # Signs and frames by the dip.
    if (
        seen == 1
        or checks[AXES, _STATE] == FAULT
        or spoilt[0] >= _BROKEN
        or spoilt[1]
        or count_f < 4 * _FEW
        or accel_unit < 0
    ):
        return
    up = axes.mean_force(sums, 0) / length
    inclination = math.acos(min(max(-up, -1.0), 1.0))
    fast = abs(axes.turned(sums, 0)) / seconds > 3.0
    known = math.isfinite(reals[_DIP]) and math.isfinite(reals[_TOTAL]) and spoilt[2] == 0 and count_b >= 3
    known = known and abs(math.sqrt(field2) / reals[_TOTAL] - 1.0) < 0.1 and abs(reals[_DIP]) > 0.35
    if known:
        dip = _dip_of(sums, orders[0, :3], orders[0, 3:], True, length * math.sqrt(field2))
        flipped = abs(dip + reals[_DIP]) < 0.21 and abs(dip - reals[_DIP]) > 0.52
        off = abs(dip - reals[_DIP])
        who = ACCEL if inclination > 1.75 else (MAG if inclination < 1.4 else ACCEL | MAG)
        seen = 1 if flipped else (0 if off < 0.26 else -1)
        _vote(checks, events, ints, SIGN, seen, 2, 2, False, now, began, who, 0, 0)
        close = abs(math.sqrt(field2) / reals[_TOTAL] - 1.0) < 0.05
        seen = 1 if off > 0.26 and not flipped and close else (0 if off < 0.2 else -1)
        masks[:] = 0
        if seen == 1:
            lightest = 99
            for m in range(len(mistakes)):
                # What leaves the hole pointing down and explains motion and dip.
                sensor, k = mistakes[m, 0], mistakes[m, 1]
                if sensor == 0 or weights[m] > 3 or weights[m] > lightest:
                    continue
                rise = up
                if sensor == 1:
                    rise = 0.0
                    for row in range(3):
                        if orders[k, row] == 0:
                            rise = orders[k, 3 + row] * axes.mean_force(sums, row) / length
                explains = (not judge_f or okay_f[mistakes[m, 2]]) and (not judge_b or okay_b[mistakes[m, 3]])
                explains = explains and rise < 0.34
                turned = _dip_of(sums, orders[k, :3], orders[k, 3:], sensor == 1, length * math.sqrt(field2))
                if explains and abs(turned - reals[_DIP]) < 0.1:
                    if weights[m] < lightest:
                        masks[:] = 0
                        lightest = weights[m]
                    masks[sensor] |= 1 << k
            if checks[FRAME, _UP] > 0 and (checks[FRAME, _D1] | checks[FRAME, _D2]) != 0:
                # What several windows leave possible together; where nothing is left, what was possible before.
                both_f, both_b = masks[1] & checks[FRAME, _D1], masks[2] & checks[FRAME, _D2]
                keeps = (both_f | both_b) == 0
                masks[1] = checks[FRAME, _D1] if keeps else both_f
                masks[2] = checks[FRAME, _D2] if keeps else both_b
        _vote(checks, events, ints, FRAME, seen, 2, 2, False, now, began, 0, masks[1], masks[2])
    elif fast and inclination > 2.1:
        _vote(checks, events, ints, SIGN, 1, 2, 2, False, now, began, ACCEL, 1, 0)
    elif fast and inclination < 1.75:
        _vote(checks, events, ints, SIGN, 0, 2, 2, False, now, began, 0, 0, 0)


@compiled
def _run(
    ring_ns: Whole, ring: Array, mag_ns: Whole, mag: Array, ints: Whole, reals: Array, channels: Array, sums: Array,
    lengths: Array, checks: Whole, events: Whole, ways: Whole, mistakes: Whole, weights: Whole, orders: Whole,
    limits: Array, rate_hz: float, expects_mag: bool, lag: int, stamps: Whole, gyro: Array, accel: Array, start: int,
    unusable: NDArray[np.uint8],
) -> int:  # fmt: skip
    head, length, used = ints[_HEAD], ints[_LEN], ints[_MHEAD]
    last_ns, carry_ns, newest = ints[_LAST_NS], ints[_CARRY_NS], ints[_NEWEST]
    steps, late, early, count = ints[_STEPS], ints[_LONG], ints[_SHORT], ints[_IMU]
    held_g, held_a, score = ints[_HELD_COUNT], ints[_HELD_COUNT + 1], ints[_STAMP_SCORE]
    begins, ends = ints[_BIN] * BIN_NS, (ints[_BIN] + 1) * BIN_NS
    full, period = False, reals[_PERIOD]
    if rate_hz > 0.0:
        period = reals[_PERIOD] = 1.0 / rate_hz
    i = start
    while i < len(stamps) and not full:
        stamp = stamps[i]
        ints[_PLACE] = i
        # Stamps are judged as they come: the wait below needs them to advance.
        if ints[_HAVE] == 1:
            good = stamp > newest
            if not good or score > 0 or checks[STAMPS, _STATE] == UNKNOWN:
                score = min(max(score + (-1 if good else 2), 0), 400)
                if score >= 200 and not good:
                    if checks[STAMPS, _STATE] != FAULT:
                        _vote(checks, events, ints, STAMPS, 1, 1, 1, False, stamp, stamp, 0, 0, 0)
                elif score == 0 and checks[STAMPS, _STATE] != OK:
                    _vote(checks, events, ints, STAMPS, 0, 1, 1, False, stamp, stamp, 0, 0, 0)
        newest = stamp
        ints[_HAVE] = 1
        tail = (head + length) & (_RING - 1)
        ring_ns[tail] = stamp
        for k in range(3):
            ring[tail, k] = gyro[i, k]
            ring[tail, 3 + k] = accel[i, k]
        length += 1
        while length > 0:
            at = ring_ns[head]
            if stamp - at < lag and stamp - at > -1_000_000_000 and length < _RING:
                break
            # One IMU sample and the magnetic ones up to its time.
            if ints[_OPEN] == 0:
                ints[_OPEN] = 1
                last_ns = carry_ns = at
                ints[_BIN] = at // BIN_NS
                begins, ends = ints[_BIN] * BIN_NS, (ints[_BIN] + 1) * BIN_NS
            elif at >= ends or at < begins - 2 * BIN_NS:
                ints[_STEPS], ints[_LONG], ints[_SHORT], ints[_IMU] = steps, late, early, count
                ints[_HELD_COUNT], ints[_HELD_COUNT + 1] = held_g, held_a
                steps = late = early = count = held_g = held_a = 0
                _close_bin(ints, reals, channels, checks, events, limits, expects_mag)
                ints[_BINS] += 1
                index = at // BIN_NS
                broken = index != ints[_BIN] + 1
                if ints[_BINS] == _WINDOW // 2:
                    axes.carry(sums)
                    axes.halve(sums)
                if ints[_BINS] == _WINDOW or broken:
                    axes.carry(sums)
                    if not broken:
                        _close_window(ints, reals, sums, lengths, checks, events, ways, mistakes, weights, orders,
                                      ends, ints[_SPOILT:_SPOILT + 3])  # fmt: skip
                    axes.begin(sums)
                    ints[_BINS] = 0
                    for s in range(3):
                        ints[_SPOILT + s] = 0
                ints[_BIN] = index
                begins, ends = index * BIN_NS, (index + 1) * BIN_NS
                full = ints[_EVENT_COUNT] > len(events) // 2
            step = at - last_ns
            dt = 0.0
            if step > 0:
                seconds = 1e-9 * step
                if seconds < 0.5:
                    steps += 1
                    if period > 0.0:
                        late += int(seconds > 1.4 * period)
                        early += int(seconds < 0.7 * period)
                    else:
                        reals[_SPAN] += seconds
                        reals[_LEARNED] += 1.0
                        if reals[_LEARNED] == 64.0:
                            period = reals[_PERIOD] = reals[_SPAN] / 64.0
                if seconds <= 0.25:
                    dt = seconds
                last_ns = at
            elif step < -1_000_000_000:
                last_ns = at
            count += 1
            w_x, w_y, w_z = ring[head, 0], ring[head, 1], ring[head, 2]
            f_x, f_y, f_z = ring[head, 3], ring[head, 4], ring[head, 5]
            held_g += int(w_x == channels[0, _LAST] and w_y == channels[1, _LAST] and w_z == channels[2, _LAST])
            held_a += int(f_x == channels[3, _LAST] and f_y == channels[4, _LAST] and f_z == channels[5, _LAST])
            for c in range(3):
                _count(channels, c, ring[head, c], limits[0])
                _count(channels, 3 + c, ring[head, 3 + c], limits[1])
            turned2 = 0.0
            if abs(w_x) + abs(w_y) + abs(w_z) < _ABSURD:
                turned2 = axes.add_rate(sums, dt, w_x, w_y, w_z)
            if abs(f_x) + abs(f_y) + abs(f_z) < _ABSURD:
                axes.add_force(sums, f_x, f_y, f_z)
            while used < len(mag_ns) and mag_ns[used] <= at:
                for c in range(3):
                    _count(channels, 6 + c, mag[used, c], limits[2])
                size = abs(mag[used, 0]) + abs(mag[used, 1]) + abs(mag[used, 2])
                if at - mag_ns[used] < 250_000_000 and size < _ABSURD:
                    axes.add_field(sums, mag[used, 0], mag[used, 1], mag[used, 2])
                used += 1
            if turned2 > axes.STEP_ANGLE2 or at - carry_ns >= axes.STEP_NS or at < carry_ns:
                axes.carry(sums)
                carry_ns = at
            head = (head + 1) & (_RING - 1)
            length -= 1
        unusable[i] = ints[_UNUSABLE]
        i += 1
    ints[_HEAD], ints[_LEN], ints[_MHEAD] = head, length, used
    ints[_LAST_NS], ints[_CARRY_NS], ints[_NEWEST] = last_ns, carry_ns, newest
    ints[_STEPS], ints[_LONG], ints[_SHORT], ints[_IMU] = steps, late, early, count
    ints[_HELD_COUNT], ints[_HELD_COUNT + 1], ints[_STAMP_SCORE] = held_g, held_a, score
    return i


_UNITS = (
    ("deg/s",),
    ("g", "mg or cm/s^2", "ft/s^2"),
    ("mT", "gauss", "uT", "mG", "nT"),
)
_SI = ("rad/s", "m/s^2", "T")


def findings(state: State) -> list[Finding]:
    """Every fault that stands now."""
    return [
        _words(np.array([0, k, FAULT, *state.checks[k, [_FROM, _D0, _D1, _D2]]]))
        for k in range(CHECKS)
        if state.checks[k, _STATE] == FAULT
    ]


def known(state: State) -> dict[str, str]:
    """What is ok, a fault, or not yet known: units, axes and signs, by the words a panel shows."""
    words = ("not yet known", "ok", "fault")
    names = {
        "gyro unit": UNIT, "accelerometer unit": UNIT + 1, "magnetometer unit": UNIT + 2, "axes": AXES,
        "signs of accelerometer and magnetometer": SIGN,
    }  # fmt: skip
    return {name: words[int(state.checks[k, _STATE])] for name, k in names.items()}


def _words(row: Whole) -> Finding:
    """A row of the events in words."""
    now, k, condition, since = (int(v) for v in row[:4])
    details = [int(v) for v in row[4:7]]
    kind, sensor, axis, severity, confidence, message, remedy, bits = _described(k, details)
    cleared = now if condition != FAULT else 0
    return Finding(
        kind, sensor, axis, severity, confidence, f"{message}: gone" if cleared else message,
        "" if cleared else remedy, since, cleared, bits, k,
    )  # fmt: skip


_Described = tuple[str, str, str, str, float, str, str, int]
_CABLE = "check its plug and cable; if it stays, change the probe"


def _described(k: int, details: list[int]) -> _Described:
    if k < INVALID:
        s, c = divmod(k % 9, 3)
        sensor, axis = SENSORS[s], "xyz"[c]
        if k < SATURATED:
            value = "zero" if details[0] else "one value"
            message = f"{sensor} {axis} axis is stuck at {value} while the tool feels something"
            return "stuck", sensor, axis, "error", 0.99, message, _CABLE, 1 << s
        whole = details[0] >= 90
        message = f"{sensor} {axis} axis is {'always' if whole else 'often'} at the end of its range"
        remedy = (
            "check the sensor's range setting; if it stays at rest, change the probe"
            if whole
            else "more than the sensor can read: reduce rotary speed or shocks, or fit a wider range"
        )
        return "saturated", sensor, axis, "error" if whole else "warning", 0.99, message, remedy, whole << s
    if k < DEAD:
        axis = "/".join(a for n, a in enumerate("xyz") if details[0] >> n & 1)
        sensor = SENSORS[k - INVALID]
        return (
            "invalid", sensor, axis, "error", 1.0, f"{sensor} sends values that are no numbers", _CABLE,
            1 << (k - INVALID),
        )  # fmt: skip
    if k < UNIT:
        s = k - DEAD
        what = "only zeros" if details[0] else "the same values again and again"
        kind = "stuck" if s == 1 else "dead"
        return kind, SENSORS[s], "all", "error", 0.99, f"{SENSORS[s]} is dead: it sends {what}", _CABLE, 1 << s
    if k < AXES:
        s = k - UNIT
        unit = _UNITS[s][max(details[0] - 1, 0)]
        message = f"{SENSORS[s]} looks like {unit}, not {_SI[s]}"
        return "unit", SENSORS[s], "all", "error", 0.97, message, f"convert it to {_SI[s]} in the driver", 1 << s
    if k == AXES:
        return _axes_words(details)
    if k == SIGN:
        bits = details[0]
        sensor = "/".join(SENSORS[s] for s in (1, 2) if bits >> s & 1)
        if details[1]:
            message = "accelerometer reads upside down: the hole would point upwards"
        elif bits == ACCEL:
            message = "accelerometer reads gravity instead of specific force: all its signs are reversed"
        elif bits == MAG:
            message = "all signs of the magnetometer are reversed"
        else:
            message = "all signs of the accelerometer or of the magnetometer are reversed"
        remedy = "reverse its signs in the driver: at rest the accelerometer reads up, the magnetometer along the field"
        return "flipped", sensor, "all", "error", 0.95 if bits != ACCEL | MAG else 0.5, message, remedy, bits
    if k == FRAME:
        return _frame_words(details)
    if k == ABSENT:
        message = "magnetometer has fallen silent" if details[0] else "no magnetometer data arrives"
        lost = details[0] == 1
        return "absent", "magnetometer", "all", "error" if lost else "warning", 1.0, message, _CABLE, MAG if lost else 0
    if k == RATE:
        pace = "slower" if details[0] else "faster"
        message = f"IMU samples come {pace} than the {details[1] / 1000.0:.0f} per second before"
        return (
            "rate",
            "gyro/accelerometer",
            "",
            "warning",
            0.9,
            message,
            "check the rate setting and the link's load",
            0,
        )
    if k == STAMPS:
        message = "IMU stamps repeat or run backwards"
        return "stamps", "gyro/accelerometer", "", "error", 1.0, message, "stamp samples where they are measured", 0
    if k < MISMATCH:
        s = k - HELD
        message = f"{SENSORS[s]} sends values twice: about {details[0]} of 100 repeat the one before"
        return "held", SENSORS[s], "all", "warning", 0.9, message, "set the output rate to the sensor's own", 0
    message = "gyro does not agree with gravity and the magnetic field, whatever its axes"
    return "mismatch", "gyro", "", "error", 0.7, message, "check the gyro's scale and calibration, then the probe", GYRO


def _axes_words(masks: list[int]) -> _Described:
    texts, kinds, named, sensors, bits, count = [], [], [], [], 0, 0
    for s in range(3):
        ways = [_mistake(k) for k in range(48) if masks[s] >> k & 1]
        if not ways:
            continue
        bits |= 1 << s
        sensors.append(SENSORS[s])
        count += len(ways)
        texts.append(f"{SENSORS[s]}: " + " or ".join(text for _, _, text in ways))
        kinds += [kind for kind, _, _ in ways]
        named += [axis for _, axis, _ in ways]
    return (
        "/".join(dict.fromkeys(kinds)), "/".join(sensors), "/".join(dict.fromkeys(named)), "error",
        0.95 / max(count, 1), "the motion shows wrong axes; " + ", or ".join(texts),
        "correct the axes in the driver or the mounting, then rotate the tool again", bits,
    )  # fmt: skip


def _frame_words(masks: list[int]) -> _Described:
    found = [(s, *_mistake(k)) for s in (1, 2) for k in range(48) if masks[s] >> k & 1]
    message = "accelerometer and magnetometer do not belong together: the dip is wrong at the right field strength"
    remedy = "check axes and frame of both, and the reference field; look for steel nearby"
    if not 0 < len(found) <= 4:
        return "frame", "accelerometer/magnetometer", "", "warning", 0.6, message, remedy, MAG
    sensors = dict.fromkeys(SENSORS[s] for s, *_ in found)
    text = ", or ".join(f"{SENSORS[s]}: {words}" for s, _, _, words in found)
    bits = MAG
    for s, *_ in found:
        bits |= 1 << s
    return (
        "/".join(dict.fromkeys(kind for _, kind, _, _ in found)), "/".join(sensors),
        "/".join(dict.fromkeys(axis for _, _, axis, _ in found)), "error", 0.8 / len(found),
        f"{message}; it fits with {text}", remedy, bits,
    )  # fmt: skip


def _mistake(k: int) -> tuple[str, str, str]:
    """Kind, axes and words of a mapping."""
    m = axes.MAPPINGS[k]
    flipped = [a for n, a in enumerate("xyz") if m[n].sum() < 0]
    moved = [a for n, a in enumerate("xyz") if m[n, n] == 0]
    if not moved:
        if len(flipped) == 3:
            return "flipped", "all", "all axes reversed (or the frame left-handed)"
        if len(flipped) == 1:
            return "flipped", flipped[0], f"{flipped[0]} axis reversed"
        still = next(a for a in "xyz" if a not in flipped)
        return "frame", "".join(flipped), f"turned half round about {still}"
    if len(moved) == 2:
        if not flipped:
            return "swapped", "".join(moved), f"{moved[0]} and {moved[1]} exchanged"
        if round(float(np.linalg.det(m))) == 1 and len(flipped) == 1:
            still = next(a for a in "xyz" if a not in moved)
            return "frame", "".join(moved), f"turned a quarter about {still}"
    rows = ", ".join(
        f"{a} is {'-' if m[n].sum() < 0 else ''}{'xyz'[int(np.argmax(np.abs(m[n])))]}" for n, a in enumerate("xyz")
    )
    return "frame", "xyz", f"axes mixed up ({rows})"

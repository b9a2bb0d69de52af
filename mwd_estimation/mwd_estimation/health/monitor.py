"""
Health of the sensors from their own samples: what is wrong, with which sensor and axis, since when, and what to do.

Samples are counted half second by half second (`health_samples`); every three seconds the motion is asked whether the
axes belong together (`health_motion`); what both note is weighed by `health_evidence` and said by `health_words`. What
the motion so far cannot show stays "not yet known".
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import cross_axes, fault_debounce, fault_messages, motion_checks, signal_checks
from mwd_estimation.health.fault_debounce import (
    AGAINST,
    CHECKS,
    D0,
    D2,
    EVENTS,
    FAULT,
    FOR,
    FROM,
    GYRO,
    NOTHING,
    OK,
    PLACE,
    SEEN,
    STAMPS,
    STATE,
    SUSPECT,
    UNKNOWN,
    UNUSABLE,
    doubt,
    note,
    suspected,
    weigh,
)
from mwd_estimation.health.fault_messages import Finding
from mwd_estimation.health.motion_checks import DIP, GRAVITY, TOTAL
from mwd_estimation.health.signal_checks import BIN_NS, HOLDS, IMU, LONG, SHORT, SPOILT, STEPS
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

Whole = NDArray[np.int64]

_WINDOW = axes.PARTS  # bins
_RING = 4096  # samples waiting for the magnetometer's of the same time
_COUNTED = 256  # samples that are counted together

# Integers: ring head and length, magnetic samples used, bin and whether one is open, last stamps taken, carried and
# come, whether one came, bins of the window, score of the stamps.
_HEAD, _LEN, _MHEAD, _BIN, _OPEN, _LAST_NS, _CARRY_NS, _NEWEST, _HAVE, _BINS, _STAMP_SCORE, _INTS = range(12)
# Reals: reference; period, s, how many steps of time it is learned from, and these: the middle one, as some are lost.
_PERIOD, _LEARNED, _FROM_STEPS, _LEARN = 3, 4, 5, 64
_REALS = _FROM_STEPS + _LEARN


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
    counts: Whole
    sums: Array
    cross: Array
    lengths: Array
    checks: Whole
    notes: Whole
    glimpses: Whole
    tally: Whole
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
    suspect : ndarray of uint8, shape (n,)
        Bits of the sensors that something speaks against at that sample, though it is no fault yet.
    changes : list of Finding
        Faults found, narrowed down or cleared, in order.
    places : list of int
        Sample of the block that brought each change.
    """

    unusable: NDArray[np.uint8]
    suspect: NDArray[np.uint8]
    changes: list[Finding]
    places: list[int]


def initial(
    params: Params, gravity: float | None = None, total: float | None = None, dip: float | None = None
) -> State:
    """State before the first sample; reference gravity, m/s^2, field, T, and dip, rad, where known."""
    del params
    channels, counts = signal_checks.blank()
    checks, notes, tally, events = fault_debounce.blank()
    state = State(
        ring_ns=np.zeros(_RING, dtype=np.int64),
        ring=np.zeros((_RING, 6)),
        mag_ns=np.zeros(0, dtype=np.int64),
        mag=np.zeros((0, 3)),
        ints=np.zeros(_INTS, dtype=np.int64),
        reals=np.zeros(_REALS),
        channels=channels,
        counts=counts,
        sums=np.zeros(axes.SIZE),
        cross=np.zeros(cross_axes.SIZE),
        lengths=np.zeros((2, 50)),
        checks=checks,
        notes=notes,
        glimpses=notes.copy(),
        tally=tally,
        events=events,
    )
    axes.begin(state.sums)
    set_reference(state, gravity, total, dip)
    return state


def set_reference(state: State, gravity: float | None, total: float | None, dip: float | None) -> None:
    """Judge totals and dip by this from now on; None where unknown. m/s^2, T, rad."""
    state.reals[GRAVITY] = STANDARD_GRAVITY if gravity is None else gravity
    state.reals[TOTAL] = math.nan if total is None else total
    state.reals[DIP] = math.nan if dip is None else dip


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
    unusable, suspect = np.zeros(len(stamps), dtype=np.uint8), np.zeros(len(stamps), dtype=np.uint8)
    limits = 0.9995 * np.array(
        [math.radians(params.gyro_range_deg_s), params.accel_range_g * STANDARD_GRAVITY, params.mag_range_ut * 1e-6]
    )
    limits[limits == 0.0] = math.inf
    lag = round(params.mag_lag_s * 1e9)
    changes: list[Finding] = []
    places: list[int] = []
    done = 0
    while done < len(stamps) and params.watch:
        state.tally[EVENTS] = 0
        done = _run(
            state.ring_ns, state.ring, state.mag_ns, state.mag, state.ints, state.reals, state.channels, state.counts,
            state.sums, state.cross, state.lengths, state.checks, state.notes, state.glimpses, state.tally,
            state.events, limits, params.rate_hz, params.mag_expected, lag, stamps, gyro, accel, done, unusable,
            suspect,
        )  # fmt: skip
        for row in state.events[: state.tally[EVENTS]]:
            changes.append(fault_messages.finding(row))
            places.append(int(row[7]))
    _forget_used(state)
    return Step(unusable, suspect, changes, places)


def _forget_used(state: State) -> None:
    used = int(state.ints[_MHEAD])
    if used:
        state.mag_ns, state.mag = state.mag_ns[used:].copy(), state.mag[used:].copy()
        state.ints[_MHEAD] = 0


def findings(state: State) -> list[Finding]:
    """Every fault that stands now."""
    return [
        fault_messages.finding([0, k, FAULT, *state.checks[k, [FROM, *range(D0, D2 + 1)]]])
        for k in range(CHECKS)
        if state.checks[k, STATE] == FAULT
    ]


def known(state: State) -> dict[str, str]:
    """What is ok, a fault, or not yet known: units, axes and signs, by the words a panel shows."""
    return fault_messages.known(state.checks)


@compiled
def _judge_stamp(ints: Whole, checks: Whole, notes: Whole, tally: Whole, events: Whole, stamp: int, last: int) -> None:
    """Judge a stamp as it comes: whatever waits for its time needs them to advance."""
    if ints[_HAVE] == 1:
        good = stamp > last
        score = min(max(ints[_STAMP_SCORE] + (-1 if good else 2), 0), 400)
        ints[_STAMP_SCORE] = score
        bad = score >= 200 and not good and checks[STAMPS, STATE] != FAULT
        if bad or (score == 0 and checks[STAMPS, STATE] != OK):
            note(notes, STAMPS, FOR if bad else AGAINST, stamp, 0, 0, 0)
            weigh(checks, notes, tally, events, stamp)
    ints[_HAVE] = 1


@compiled
def _close(
    at: int, step_ns: int, ints: Whole, reals: Array, channels: Array, counts: Whole, sums: Array, cross: Array,
    lengths: Array, checks: Whole, notes: Whole, glimpses: Whole, tally: Whole, events: Whole, limits: Array,
    expects_mag: bool,
) -> None:  # fmt: skip
    """Close the half second before `at`, ns, and with enough of them the window, and open the next."""
    began = ints[_BIN] * BIN_NS
    doubtful = signal_checks.close_bin(began, channels, counts, notes, limits, reals[_PERIOD], expects_mag)
    weigh(checks, notes, tally, events, began + BIN_NS)
    ints[_BINS] += 1
    broken = at // BIN_NS != ints[_BIN] + 1
    full = ints[_BINS] == _WINDOW
    cross_axes.add(cross, sums, 1e-9 * step_ns)
    axes.carry(sums)
    axes.mark(sums)
    if not broken:
        # What a part of the window shows does not count as evidence, but as a reason to doubt.
        glimpses[:, SEEN] = NOTHING
        motion_checks.judge(
            reals, sums, cross, lengths, counts[SPOILT:], checks, glimpses, began + BIN_NS, 1e-9 * ints[_BINS] * BIN_NS
        )
        doubtful |= suspected(checks, glimpses)
        if full:
            weigh(checks, glimpses, tally, events, began + BIN_NS)
    if checks[STAMPS, STATE] == FAULT:
        doubtful |= GYRO
    doubt(checks, tally, doubtful)
    if full or broken:
        axes.begin(sums)
        cross_axes.begin(cross)
        ints[_BINS] = 0
        counts[SPOILT:] = 0
    ints[_BIN] = at // BIN_NS


@compiled
def _count(
    channels: Array, ring: Array, mag: Array, head: int, waiting: int, counted: int, used: int, limits: Array
) -> None:
    """Count the samples that wait for it: of the ring those before its head, and magnetic ones."""
    first = (head - waiting) & (_RING - 1)
    stop = min(first + waiting, _RING)
    for c in range(6):
        signal_checks.count(channels, c, ring, c, first, stop, limits[c // 3])
        signal_checks.count(channels, c, ring, c, 0, first + waiting - stop, limits[c // 3])
    for c in range(3):
        signal_checks.count(channels, 6 + c, mag, c, counted, used, limits[2])


@compiled
def _run(
    ring_ns: Whole, ring: Array, mag_ns: Whole, mag: Array, ints: Whole, reals: Array, channels: Array, counts: Whole,
    sums: Array, cross: Array, lengths: Array, checks: Whole, notes: Whole, glimpses: Whole, tally: Whole,
    events: Whole, limits: Array, rate_hz: float, expects_mag: bool, lag: int, stamps: Whole, gyro: Array, accel: Array,
    start: int, unusable: NDArray[np.uint8], suspect: NDArray[np.uint8],
) -> int:  # fmt: skip
    head, length, used = ints[_HEAD], ints[_LEN], ints[_MHEAD]
    last_ns, carry_ns, newest = ints[_LAST_NS], ints[_CARRY_NS], ints[_NEWEST]
    begins, ends = ints[_BIN] * BIN_NS, (ints[_BIN] + 1) * BIN_NS
    steps, long, short, count = counts[STEPS], counts[LONG], counts[SHORT], counts[IMU]
    held_g, held_a = counts[HOLDS], counts[HOLDS + 1]
    waiting, counted = 0, used
    full = False
    if rate_hz > 0.0:
        reals[_PERIOD] = 1.0 / rate_hz
    period = reals[_PERIOD]
    i = start
    while i < len(stamps) and not full:
        stamp = stamps[i]
        tally[PLACE] = i
        if stamp <= newest or ints[_STAMP_SCORE] > 0 or checks[STAMPS, STATE] == UNKNOWN:
            _judge_stamp(ints, checks, notes, tally, events, stamp, newest)
        newest = stamp
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
                _count(channels, ring, mag, head, waiting, counted, used, limits)
                waiting, counted = 0, used
                counts[STEPS], counts[LONG], counts[SHORT], counts[IMU] = steps, long, short, count
                counts[HOLDS], counts[HOLDS + 1] = held_g, held_a
                steps = long = short = count = held_g = held_a = 0
                _close(at, max(last_ns - carry_ns, 0), ints, reals, channels, counts, sums, cross, lengths, checks,
                       notes, glimpses, tally, events, limits, expects_mag)  # fmt: skip
                carry_ns = last_ns
                begins, ends = ints[_BIN] * BIN_NS, (ints[_BIN] + 1) * BIN_NS
                full = tally[EVENTS] > len(events) // 2
            step = at - last_ns
            dt = 0.0
            if step > 0:
                seconds = 1e-9 * step
                if seconds < 0.5:
                    steps += 1
                    if period > 0.0:
                        long += int(seconds > 1.4 * period)
                        short += int(seconds < 0.7 * period)
                    else:
                        reals[_FROM_STEPS + int(reals[_LEARNED])] = seconds
                        reals[_LEARNED] += 1.0
                        if reals[_LEARNED] == _LEARN:
                            period = reals[_PERIOD] = np.sort(reals[_FROM_STEPS:])[_LEARN // 2]
                if seconds <= 0.25:
                    dt = seconds
                last_ns = at
            elif step < -1_000_000_000:
                last_ns = at
            count += 1
            w_x, w_y, w_z = ring[head, 0], ring[head, 1], ring[head, 2]
            f_x, f_y, f_z = ring[head, 3], ring[head, 4], ring[head, 5]
            before = (head - 1) & (_RING - 1)
            held_g += int(w_x == ring[before, 0] and w_y == ring[before, 1] and w_z == ring[before, 2])
            held_a += int(f_x == ring[before, 3] and f_y == ring[before, 4] and f_z == ring[before, 5])
            waiting += 1
            turned2 = 0.0
            if abs(w_x) + abs(w_y) + abs(w_z) < signal_checks.ABSURD:
                turned2 = axes.add_rate(sums, dt, w_x, w_y, w_z)
            if abs(f_x) + abs(f_y) + abs(f_z) < signal_checks.ABSURD:
                axes.add_force(sums, f_x, f_y, f_z)
            while used < len(mag_ns) and mag_ns[used] <= at:
                size = abs(mag[used, 0]) + abs(mag[used, 1]) + abs(mag[used, 2])
                if at - mag_ns[used] < 250_000_000 and size < signal_checks.ABSURD:
                    axes.add_field(sums, mag[used, 0], mag[used, 1], mag[used, 2])
                used += 1
            if turned2 > axes.STEP_ANGLE2 or at - carry_ns >= axes.STEP_NS or at < carry_ns:
                cross_axes.add(cross, sums, max(1e-9 * (at - carry_ns), 0.0))
                axes.carry(sums)
                carry_ns = at
            head = (head + 1) & (_RING - 1)
            length -= 1
            if waiting == _COUNTED:
                _count(channels, ring, mag, head, waiting, counted, used, limits)
                waiting, counted = 0, used
        unusable[i], suspect[i] = tally[UNUSABLE], tally[SUSPECT]
        i += 1
    _count(channels, ring, mag, head, waiting, counted, used, limits)
    ints[_HEAD], ints[_LEN], ints[_MHEAD] = head, length, used
    ints[_LAST_NS], ints[_CARRY_NS], ints[_NEWEST] = last_ns, carry_ns, newest
    counts[STEPS], counts[LONG], counts[SHORT], counts[IMU] = steps, long, short, count
    counts[HOLDS], counts[HOLDS + 1] = held_g, held_a
    return i

"""
The checks of sensor health: how what is observed, again and again, becomes a fault, and how a fault goes again.

Every check is not yet known, ok or fault. What judges the samples notes what it has seen, for the fault or against it;
`weigh` counts: a fault needs several observations in a row for it, and as a rule more in a row against it to go. What
speaks against a sensor and is no fault yet makes it doubtful meanwhile (`suspected`, `doubt`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.compiled import compiled

Whole = NDArray[np.int64]

UNKNOWN, OK, FAULT = 0, 1, 2
GYRO, ACCEL, MAG = 1, 2, 4  # bits of what cannot be used
SENSORS = ("gyro", "accelerometer", "magnetometer")

# Checks: first index of each; per axis (9), per sensor (3) or single.
STUCK, SATURATED, INVALID, DEAD, UNIT, AXES, SIGN, FRAME, ABSENT, RATE, STAMPS, HELD, MISMATCH, CROSS, LENGTH, NOISE = (
    0, 9, 18, 21, 24, 27, 28, 29, 30, 31, 32, 33, 35, 36, 37, 38,
)  # fmt: skip
CHECKS = 39

# Of a check: state, observations for and against in a row, since, three details.
STATE, UP, DOWN, FROM, D0, D1, D2 = range(7)
# Of a note: what was seen, since when, three details; and what can have been seen.
SEEN, BEGAN = 0, 1
# STRONGLY counts as two observations for it.
NOTHING, AGAINST, FOR, STRONGLY = -1, 0, 1, 2
# Of the tally: events, sensors not to be used, place in the block of the sample that brings the judgement, sensors in
# doubt; half seconds for which each sensor (3) stays so.
EVENTS, UNUSABLE, PLACE, SUSPECT, _DOUBT, _TALLY = 0, 1, 2, 3, 4, 7
_EVENTS = 256
_HOLD = 12

# Of a saturated axis: at the limit often or, with which it cannot be used, always.
OFTEN, ALWAYS = 25, 95


def _by_check(one: int, **others: int) -> Whole:
    """Shape (CHECKS,): the same figure for every check but those named."""
    first = {"saturated": SATURATED, "dead": DEAD, "unit": UNIT, "absent": ABSENT, "rate": RATE, "stamps": STAMPS,
             "held": HELD, "mismatch": MISMATCH, "cross": CROSS, "length": LENGTH, "noise": NOISE}  # fmt: skip
    edges = sorted((*first.values(), STUCK, INVALID, AXES, SIGN, FRAME, CHECKS))
    figures = np.full(CHECKS, one, dtype=np.int64)
    for name, figure in others.items():
        figures[first[name] : edges[edges.index(first[name]) + 1]] = figure
    return figures


# Observations in a row for a fault, and against it for its end.
_NEED = _by_check(2, saturated=4, dead=1, absent=1, rate=5, stamps=1, held=8, mismatch=3, length=4, noise=4)
_CLEAR = np.where(np.arange(CHECKS) < UNIT, 4, 2) + _by_check(0, saturated=8, rate=2, stamps=-1, held=6, noise=2)
# Observations against it wipe those for it only when there are enough of them.
_KEEPS = _by_check(0, saturated=1) == 1
# A fault that stands and is narrowed down is told anew.
_NARROWS = np.isin(np.arange(CHECKS), (AXES, FRAME, CROSS))


def blank() -> tuple[Whole, Whole, Whole, Whole]:
    """Checks (CHECKS, 7), notes (CHECKS, 5), tally and room for the events of a block before the first sample."""
    notes = np.full((CHECKS, 5), NOTHING, dtype=np.int64)
    return (
        np.zeros((CHECKS, 7), dtype=np.int64),
        notes,
        np.zeros(_TALLY, dtype=np.int64),
        np.zeros((_EVENTS, 8), np.int64),
    )


@compiled
def note(notes: Whole, k: int, seen: int, began: int, d0: int, d1: int, d2: int) -> None:
    """Note an observation of a check: FOR a fault since `began`, ns, STRONGLY, AGAINST it, or NOTHING."""
    row = notes[k]
    row[0], row[1], row[2], row[3], row[4] = seen, began, d0, d1, d2


@compiled
def weigh(checks: Whole, notes: Whole, tally: Whole, events: Whole, now: int) -> None:
    """Weigh what was noted of the checks up to `now`, ns, and write down what changed."""
    any_changed = False
    for k in range(CHECKS):
        seen, row, details = notes[k, SEEN], checks[k], notes[k, 2:]
        notes[k, SEEN] = NOTHING
        changed = False
        if seen >= FOR:
            if row[UP] == 0:
                row[FROM] = notes[k, BEGAN]
            row[UP] += seen
            row[DOWN] = 0
            enough = row[UP] >= _NEED[k]
            if row[STATE] != FAULT:
                changed = enough
            elif _NARROWS[k]:
                changed = row[D0] != details[0] or row[D1] != details[1] or row[D2] != details[2]
            elif _KEEPS[k]:
                changed = row[D0] != details[0]
            if row[STATE] != FAULT or _NARROWS[k] or _KEEPS[k]:
                for d in range(3):
                    row[D0 + d] = details[d]
            if enough:
                row[STATE] = FAULT
        elif seen == AGAINST:
            row[DOWN] += 1
            changed = row[STATE] == FAULT and row[DOWN] >= _CLEAR[k]
            if changed or (row[STATE] != FAULT and (not _KEEPS[k] or row[DOWN] >= _CLEAR[k])):
                row[UP] = 0
            if changed or (row[STATE] != FAULT and row[UP] == 0):
                row[STATE] = OK
        any_changed = any_changed or changed
        if changed and tally[EVENTS] < len(events):
            event = events[tally[EVENTS]]
            event[0], event[1], event[2], event[3], event[7] = now, k, row[STATE], row[FROM], tally[PLACE]
            for d in range(3):
                event[4 + d] = row[D0 + d]
            tally[EVENTS] += 1
    if any_changed:
        tally[UNUSABLE] = unusable(checks)
        tally[SUSPECT] &= ~tally[UNUSABLE]


@compiled
def _ones(mask: int) -> int:
    count = 0
    for k in range(48):
        count += mask >> k & 1
    return count


@compiled
def _against(k: int, d0: int, d1: int, d2: int) -> int:
    """Bits of the sensors that a fault of check k with these details speaks against."""
    if k < INVALID:
        return 1 << (k % 9 // 3) if k < SATURATED or d0 == ALWAYS else 0
    if k < AXES:
        return 1 << (k - INVALID) % 3
    if k == AXES:
        return (GYRO if d0 != 0 else 0) | (ACCEL if d1 != 0 else 0) | (MAG if d2 != 0 else 0)
    if k == SIGN:
        return d0
    if k == FRAME:
        return MAG | (ACCEL if d1 != 0 and _ones(d1) + _ones(d2) <= 4 else 0)
    if k == ABSENT:
        return MAG if d0 == 1 else 0
    if k == LENGTH:
        return ACCEL
    if k == NOISE:
        return MAG
    return GYRO if k in (MISMATCH, CROSS) else 0


@compiled
def unusable(checks: Whole) -> int:
    """Bits of the sensors that must not be used."""
    bits = 0
    for k in range(CHECKS):
        if checks[k, STATE] == FAULT:
            bits |= _against(k, checks[k, D0], checks[k, D1], checks[k, D2])
    return bits


@compiled
def suspected(checks: Whole, notes: Whole) -> int:
    """Bits of the sensors that these notes speak against, without those of faults that stand."""
    bits = 0
    for k in range(CHECKS):
        if notes[k, SEEN] >= (STRONGLY if k == LENGTH else FOR) and checks[k, STATE] != FAULT:
            bits |= _against(k, notes[k, 2], notes[k, 3], notes[k, 4])
    return bits


@compiled
def doubt(checks: Whole, tally: Whole, bits: int) -> None:
    """
    Doubt these sensors from now on, and let half a second of the older doubts pass.

    A doubt lasts as long as it takes to name a fault; what is named is a fault and no doubt any more.
    """
    left = 0
    for s in range(3):
        if bits >> s & 1:
            tally[_DOUBT + s] = _HOLD
        elif tally[_DOUBT + s] > 0:
            tally[_DOUBT + s] -= 1
        left |= int(tally[_DOUBT + s] > 0) << s
    tally[SUSPECT] = left & ~unusable(checks)

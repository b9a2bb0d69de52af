"""
The checks of sensor health: how what is observed, again and again, becomes a fault, and how a fault goes again.

Every check is not yet known, ok or fault. What judges the samples notes what it has seen, for the fault or against it;
`weigh` counts: a fault needs several observations in a row for it, and as a rule more in a row against it to go.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.compiled import compiled

Whole = NDArray[np.int64]

UNKNOWN, OK, FAULT = 0, 1, 2
GYRO, ACCEL, MAG = 1, 2, 4  # bits of what cannot be used
SENSORS = ("gyro", "accelerometer", "magnetometer")

# Checks: first index of each; per axis (9), per sensor (3) or single.
STUCK, SATURATED, INVALID, DEAD, UNIT, AXES, SIGN, FRAME, ABSENT, RATE, STAMPS, HELD, MISMATCH = (
    0, 9, 18, 21, 24, 27, 28, 29, 30, 31, 32, 33, 35,
)  # fmt: skip
CHECKS = 36

# Of a check: state, observations for and against in a row, since, three details.
STATE, UP, DOWN, FROM, D0, D1, D2 = range(7)
# Of a note: what was seen, since when, three details; and what can have been seen.
SEEN, BEGAN = 0, 1
NOTHING, AGAINST, FOR = -1, 0, 1
# Of the tally: events, sensors not to be used, place in the block of the sample that brings the judgement.
EVENTS, UNUSABLE, PLACE = range(3)
_EVENTS = 256

# Of a saturated axis: at the limit often or, with which it cannot be used, always.
OFTEN, ALWAYS = 25, 95


def _by_check(one: int, **others: int) -> Whole:
    """Shape (CHECKS,): the same figure for every check but those named."""
    first = {"saturated": SATURATED, "dead": DEAD, "unit": UNIT, "absent": ABSENT, "rate": RATE, "stamps": STAMPS,
             "held": HELD, "mismatch": MISMATCH}  # fmt: skip
    edges = sorted((*first.values(), STUCK, INVALID, AXES, SIGN, FRAME, CHECKS))
    figures = np.full(CHECKS, one, dtype=np.int64)
    for name, figure in others.items():
        figures[first[name] : edges[edges.index(first[name]) + 1]] = figure
    return figures


# Observations in a row for a fault, and against it for its end.
_NEED = _by_check(2, saturated=4, dead=1, absent=1, rate=5, stamps=1, held=8, mismatch=3)
_CLEAR = np.where(np.arange(CHECKS) < UNIT, 4, 2) + _by_check(0, saturated=8, rate=2, stamps=-1, held=6)
# Observations against it wipe those for it only when there are enough of them.
_KEEPS = _by_check(0, saturated=1) == 1
# A fault that stands and is narrowed down is told anew.
_NARROWS = (np.arange(CHECKS) == AXES) | (np.arange(CHECKS) == FRAME)


def blank() -> tuple[Whole, Whole, Whole, Whole]:
    """Checks (CHECKS, 7), notes (CHECKS, 5), tally and room for the events of a block before the first sample."""
    notes = np.full((CHECKS, 5), NOTHING, dtype=np.int64)
    return np.zeros((CHECKS, 7), dtype=np.int64), notes, np.zeros(3, dtype=np.int64), np.zeros((_EVENTS, 8), np.int64)


@compiled
def note(notes: Whole, k: int, seen: int, began: int, d0: int, d1: int, d2: int) -> None:
    """Note an observation of a check: FOR a fault since `began`, ns, AGAINST it, or NOTHING."""
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
        if seen == FOR:
            if row[UP] == 0:
                row[FROM] = notes[k, BEGAN]
            row[UP] += 1
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
        tally[UNUSABLE] = _unusable(checks)


@compiled
def _ones(mask: int) -> int:
    count = 0
    for k in range(48):
        count += mask >> k & 1
    return count


@compiled
def _unusable(checks: Whole) -> int:
    bits = 0
    for k in range(AXES):
        if checks[k, STATE] == FAULT:
            if k < INVALID:
                if k < SATURATED or checks[k, D0] == ALWAYS:
                    bits |= 1 << (k % 9 // 3)
            else:
                bits |= 1 << (k - INVALID) % 3
    if checks[AXES, STATE] == FAULT:
        for s in range(3):
            if checks[AXES, D0 + s] != 0:
                bits |= 1 << s
    if checks[SIGN, STATE] == FAULT:
        bits |= checks[SIGN, D0]
    if checks[FRAME, STATE] == FAULT:
        named = _ones(checks[FRAME, D1]) + _ones(checks[FRAME, D2])
        bits |= MAG | (ACCEL if checks[FRAME, D1] != 0 and named <= 4 else 0)
    if checks[ABSENT, STATE] == FAULT and checks[ABSENT, D0] == 1:
        bits |= MAG
    if checks[MISMATCH, STATE] == FAULT:
        bits |= GYRO
    return bits

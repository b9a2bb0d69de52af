# SPDX-License-Identifier: Apache-2.0
"""
Turn observations into faults: a check is unknown, ok or a fault, and changes after several observations in a row.

Each check records an observation FOR or AGAINST a fault; `weigh` counts the observations. An observation FOR a fault
that is not confirmed yet makes the accused sensor doubtful for some seconds (`doubt`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from mwd_estimation.core.sensor_fault import (
    ACCEL,
    GYRO,
    MAG,
    OF_INSTALLATION,
    PRECISION,
    FaultCode,
    FaultUnit,
    SensorFault,
)
from mwd_sensors.core.arrays import Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

UNKNOWN, OK, FAULT = 0, 1, 2
# Observations of a check; STRONGLY counts as two observations FOR the fault.
NOTHING, AGAINST, FOR, STRONGLY = -1, 0, 1, 2
# Number of half seconds for which a sensor stays doubtful after the last observation: the time to confirm a fault.
DOUBT_BINS = 12

CODES, PLACES = len(FaultCode), 9


class Check:
    """One check: its state, its observations in a row, the fault, and the observation that has not been counted yet."""

    state: int  #: UNKNOWN, OK or FAULT
    #: `votes_for`, `votes_against`: number of observations in a row for and against the fault.
    votes_for: int
    votes_against: int
    #: `since_ns`, `value`, `limit`, `which`: values for `SensorFault`.
    since_ns: int
    value: float
    limit: float
    which: Annotated[Indices, 3]
    #: For AXES and FRAME: mappings of each sensor, as bits, that explain all windows after the first one with the
    #: fault.
    possible: Annotated[Indices, 3]
    changed: int  #: 1 if the check must be reported
    sound: int  #: bits of the sensors that the check has found healthy at least once
    seen: int  #: observation since the last `weigh`: NOTHING, AGAINST, FOR or STRONGLY
    #: `seen_ns`, `seen_value`, `seen_limit`, `seen_which`: values of the fault according to this observation.
    seen_ns: int
    seen_value: float
    seen_limit: float
    seen_which: Annotated[Indices, 3]
    seen_sound: int  #: for AGAINST: bits of the sensors that the observation shows to be healthy


CHECK = dtype_of(Check)


class DebounceRule(NamedTuple):
    """Numbers of observations after which a check becomes a fault and the fault ends, with further properties."""

    #: `need`, `clear`: number of observations in a row for the fault, and against it.
    need: int
    clear: int
    patient: int = 0  #: 1 if a single observation against the fault does not restart the count
    narrows: int = 0  #: 1 if an existing fault is reported again when fewer explanations remain
    #: 1 if a fault of this check excludes sensors from use (`accused` returns these sensors).
    accuses: int = 1


# Rule of each check. One observation covers half a second in checks of samples, three seconds in checks of motion.
RULES = {
    FaultCode.STUCK: DebounceRule(5, 4),
    FaultCode.SATURATED: DebounceRule(4, 4),
    FaultCode.CLIPPED: DebounceRule(4, 8, patient=1, accuses=0),
    FaultCode.INVALID: DebounceRule(2, 4),
    FaultCode.DEAD: DebounceRule(6, 4),
    FaultCode.NOISE: DebounceRule(4, 4),
    FaultCode.NEVER_CAME: DebounceRule(10, 2, accuses=0),
    FaultCode.SILENT: DebounceRule(4, 2),
    FaultCode.REPEATED: DebounceRule(8, 8, accuses=0),
    FaultCode.RATE: DebounceRule(5, 4, accuses=0),
    FaultCode.STAMPS: DebounceRule(1, 1, accuses=0),
    FaultCode.UNIT: DebounceRule(2, 2),
    FaultCode.AXES: DebounceRule(2, 2, narrows=1),
    FaultCode.SIGN: DebounceRule(2, 2),
    FaultCode.POINTS_UP: DebounceRule(2, 2),
    FaultCode.FRAME: DebounceRule(2, 2, narrows=1),
    FaultCode.MISMATCH: DebounceRule(8, 8),
    FaultCode.GRAVITY: DebounceRule(4, 2),
    FaultCode.REST_RATE: DebounceRule(5, 4),
    FaultCode.REPLAYED: DebounceRule(2, 4),
    FaultCode.MOUNT: DebounceRule(4, 2),
    FaultCode.ADRIFT: DebounceRule(2, 2),
}


def _in_order(rules: Mapping[FaultCode, DebounceRule]) -> Indices:
    """Return the rules as an array, one row for each code, in the order of the codes; ValueError if one is missing."""
    without = [code.name for code in FaultCode if code not in rules]
    if without:
        raise ValueError(f"RULES: no row for {', '.join(without)}")
    return np.array([rules[code] for code in FaultCode], dtype=np.int64)


_RULES = _in_order(RULES)
# A FRAME fault also accuses the accelerometer if at most this number of mappings remains.
_FEW_MAPPINGS = 4


def blank() -> Any:
    """Return all checks before the first sample, shape (CODES, PLACES), dtype CHECK."""
    checks = np.zeros((CODES, PLACES), dtype=CHECK)
    checks["seen"] = NOTHING
    return checks


@compiled
def observe(check: Any, seen: int, since_ns: int, value: float, limit: float) -> None:
    """Record an observation: NOTHING, AGAINST, FOR or STRONGLY, since a stamp, ns; value, limit: see `SensorFault`."""
    check.seen, check.seen_ns, check.seen_value, check.seen_limit = seen, since_ns, value, limit
    check.seen_which[0] = check.seen_which[1] = check.seen_which[2] = 0
    check.seen_sound = GYRO | ACCEL | MAG | PRECISION


@compiled
def _count(rule: Indices, check: Any) -> bool:
    """Count the observation of a check; return whether a fault has begun, changed or ended."""
    stood = check.state == FAULT
    if check.seen == AGAINST:
        check.votes_against += 1
        enough = check.votes_against >= rule[1]
        if enough or not (stood or rule[2]):
            check.votes_for = 0
        if check.votes_for == 0:
            check.state = OK
            check.sound |= check.seen_sound
        return bool(stood and enough)
    if check.votes_for == 0:
        check.since_ns = check.seen_ns
    check.votes_for += check.seen
    check.votes_against = 0
    other = False
    if not stood or rule[3]:
        check.value, check.limit = check.seen_value, check.seen_limit
        for s in range(3):
            other = other or check.which[s] != check.seen_which[s]
            check.which[s] = check.seen_which[s]
    if check.votes_for < rule[0]:
        return False
    check.state = FAULT
    return bool(other or not stood)


@compiled
def weigh(checks: Any) -> int:
    """Count the observations since the last call; return the number of checks that changed, and mark them."""
    changes = 0
    for code in range(CODES):
        for place in range(PLACES):
            check = checks[code, place]
            if check.seen != NOTHING and _count(_RULES[code], check):
                check.changed = 1
                changes += 1
            check.seen = NOTHING
    return changes


@compiled
def _ones(mask: int) -> int:
    count = 0
    for k in range(48):
        count += mask >> k & 1
    return count


@compiled
def accused(code: int, place: int, which: Indices) -> int:
    """Return the bits of the sensors that a fault of this check accuses, 0 if none; which: as in `SensorFault`."""
    if not _RULES[code, 4]:
        return 0
    if code == FaultCode.SIGN:
        return int(which[0])
    if code in (FaultCode.REPLAYED, FaultCode.MOUNT):
        return GYRO | ACCEL | MAG
    if code == FaultCode.AXES:
        return (GYRO if which[0] else 0) | (ACCEL if which[1] else 0) | (MAG if which[2] else 0)
    if code == FaultCode.FRAME:
        return MAG | (ACCEL if which[1] != 0 and _ones(which[1]) + _ones(which[2]) <= _FEW_MAPPINGS else 0)
    return int(1 << place // 3)


@compiled
def unusable(checks: Any) -> int:
    """Return the bits of the sensors that must not be used."""
    bits = 0
    for code in range(CODES):
        for place in range(PLACES):
            if checks[code, place].state == FAULT:
                bits |= accused(code, place, checks[code, place].which)
    return bits


@compiled
def suspected(checks: Any) -> int:
    """
    Return the bits of the sensors for which an uncounted observation indicates a fault that is not confirmed yet.

    The observation must be FOR or STRONGLY; for the check GRAVITY, it must be STRONGLY.
    """
    bits = 0
    for code in range(CODES):
        least = STRONGLY if code == FaultCode.GRAVITY else FOR
        for place in range(PLACES):
            check = checks[code, place]
            if check.seen >= least and check.state != FAULT:
                bits |= accused(code, place, check.seen_which)
    return bits


@compiled
def doubt(left: Indices, bits: int) -> int:
    """
    Update the doubt of each sensor after half a second, and return the bits of doubtful sensors.

    left, shape (3,): number of half seconds for which each sensor stays doubtful, changed in place; bits: sensors with
    a new reason for doubt.
    """
    doubtful = 0
    for s in range(3):
        left[s] = DOUBT_BINS if bits >> s & 1 else max(left[s] - 1, 0)
        doubtful |= int(left[s] > 0) << s
    return doubtful


def fault_of(checks: Any, code: int, place: int, now_ns: int, unit: FaultUnit = FaultUnit.CONVENTIONAL) -> SensorFault:
    """Return the fault that a check found; if the check is not in state FAULT, the fault ended at `now_ns`, ns."""
    check = checks[code, place]
    which = tuple(int(v) for v in check.which)
    bits = accused(code, place, check.which)
    if unit != FaultUnit.CONVENTIONAL:
        bits = PRECISION * int(bool(bits) or code == FaultCode.STAMPS)
    from_start = code in OF_INSTALLATION and bits & int(check.sound) == 0
    return SensorFault(
        FaultCode(code),
        unit,
        place,
        float(check.value),
        float(check.limit),
        (which[0], which[1], which[2]),
        bits,
        int(check.since_ns),
        0 if check.state == FAULT else now_ns,
        from_start=from_start,
    )


def take_changes(checks: Any, now_ns: int, unit: FaultUnit = FaultUnit.CONVENTIONAL) -> list[SensorFault]:
    """
    Return the faults that began, changed or ended since the last call, and clear their marks in `checks`.

    now_ns: end of the faults that have ended.
    """
    changed = np.argwhere(checks["changed"] > 0)
    checks["changed"] = 0
    return [fault_of(checks, int(code), int(place), now_ns, unit) for code, place in changed]


def standing(checks: Any, unit: FaultUnit = FaultUnit.CONVENTIONAL) -> list[SensorFault]:
    """Return all existing faults."""
    return [fault_of(checks, int(code), int(place), 0, unit) for code, place in np.argwhere(checks["state"] == FAULT)]

# SPDX-License-Identifier: Apache-2.0
"""
Health of the precision unit: its own samples, and what the conventional unit beside it reads of the same motion.

Two units on one tool read the same vectors. Over a second and a half each axis of the precision unit is compared with
each of the conventional one, at the same times. It should be its own axis, one to one; reversed, another axis or in
another unit are mistakes with a name. Which unit is wrong only a third sensor can show: first either is named, and the
precision unit alone where the tool has moved on for some seconds and nothing has spoken against the conventional one.
What moves too little stays unknown, but for what no gyro at rest can read: much more than the Earth turns.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, FaultCode, SensorFault, Unit
from mwd_estimation.health import fault_debounce, signal_checks
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, observe, weigh
from mwd_estimation.health.signal_checks import ABSURD, BIN_NS, SignalLimits
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import EARTH_RATE, STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

# Half seconds that are compared together; of motion after which the conventional unit would be in doubt if the mistake
# were its own; at rest before a rate is judged, and for which it must stay, within this share of it.
_WINDOW, _MOVED_BINS, _REST_BINS, _STEADY_BINS, _STEADY = 3, 12, 4, 6, 1.0
_FEW = 20
# Root mean square below which an axis shows nothing, rad/s and m/s^2; that of forces beyond which two accelerometers
# need not agree: shocks are not the same to another bandwidth in another place.
_LEAST = (0.005, 0.3)
_SHAKEN = 15.0
# What leaks into an axis of the greatest motion of the unit.
_LEAK = (0.004, 0.02)
# Misfit, from 0 (the same) by 1 (nothing in common) to 2 (reversed), that is still this axis, and that is not.
_SAME, _OTHERWISE = 0.3, 0.6
# Share of the mean in the mean square of what is constant.
_CONSTANT = 0.8
_UNITS = np.array([math.degrees(1.0), 1.0 / STANDARD_GRAVITY])
# A rate at rest is too high beyond so many sigma of the bias, twice the Earth's, and what a string turns that is pulled
# steadily through a bend, which is rest to every other sensor: 10 deg in 30 m at 1 m/s, rad/s.
_BIASES, _PULLED = 40.0, math.radians(10.0 / 30.0)
# Mappings of y and z among themselves.
_ACROSS = sum(1 << k for k, m in enumerate(MAPPINGS) if m[0, 0] == 1)
# What an axis is found to be besides twice the number of an axis, one more reversed, six more in another unit.
SILENT_AXIS, NO_AXIS, UNCLEAR, AT_ONE_END = -1, -2, -3, -4


class Sums:
    """One axis over half a second, and its products with each axis of the conventional unit, in both units."""

    n: float
    at_most: float
    total: float
    square: float
    product: Annotated[Array, 2, 3]
    other: Annotated[Array, 2, 3]
    other2: Annotated[Array, 2, 3]


SUMS = dtype_of(Sums)


@compiled
def compare(values: Array, own: Array, channels: Any, sums: Any) -> None:
    """
    Count the samples of half a second and sum their products with those of the conventional unit at the same times.

    Parameters
    ----------
    values, own : ndarray, shape (n, 6)
        Rates, rad/s, and forces, m/s^2, of the precision unit, and of the conventional one; nan where not known.
    channels, sums : ndarray
        Of `signal_checks`, and of SUMS, shape (6,); added to.
    """
    for row in range(6):
        most, first, one = 0.0, 3 * (row // 3), sums[row]
        for i in range(len(values)):
            if abs(values[i, row]) < ABSURD:
                most = max(most, abs(values[i, row]))
        for i in range(len(values)):
            v, beside = values[i, row], own[i, row]
            at_most = abs(v) >= 0.999 * most
            # A gyro may be at the end of its range while the string turns faster: that is not stuck.
            if not (row < 3 and at_most and abs(beside) > 1.02 * abs(v) > 0.5):
                signal_checks.count(channels[row], values, row, i, i + 1, math.inf)
            if row >= 3 and math.isfinite(beside):
                # The third sensor of the count only shows whether the tool moves.
                signal_checks.count(channels[3 + row], own, row, i, i + 1, math.inf)
            if not math.isfinite(beside) or not abs(v) < ABSURD:
                continue
            one.n += 1.0
            one.at_most += 1.0 if at_most else 0.0
            one.total += v
            one.square += v * v
            for unit in range(2):
                # What lies beyond a gyro axis' own range it cannot have read.
                limit = 1.01 * most / (_UNITS[0] if unit == 1 else 1.0) if row < 3 else math.inf
                for c in range(3):
                    other = min(max(own[i, first + c], -limit), limit)
                    one.product[unit, c] += v * other
                    one.other[unit, c] += other
                    one.other2[unit, c] += other * other


def _beside(stamps: Stamps, beside_ns: Stamps, beside: Array) -> Array:
    """Interpolate the conventional unit, shape (n, 6); nan beyond its samples, in gaps and where not usable."""
    if len(beside_ns) < 2 or not len(stamps):
        return np.full((len(stamps), 6), np.nan)
    at = np.clip(np.searchsorted(beside_ns, stamps, side="left") - 1, 0, len(beside_ns) - 2)
    step = beside_ns[at + 1] - beside_ns[at]
    known = (beside_ns[at] <= stamps) & (stamps <= beside_ns[at + 1]) & (step > 0) & (step < BIN_NS)
    share = ((stamps - beside_ns[at]) / np.maximum(step, 1))[:, None]
    found = (1.0 - share) * beside[at] + share * beside[at + 1]
    known &= (np.abs(found) < ABSURD).all(axis=1)
    return np.ascontiguousarray(np.where(known[:, None], found, np.nan))


@compiled
def _best(one: Any, k: int, centred: bool, least: float, s: int) -> int:
    """Which axis of the conventional unit axis k of sensor s is; without its mean where `centred`."""
    n = max(one.n, 1.0)
    off = one.total / n if centred else 0.0
    own = max(one.square - off * one.total, 0.0)
    itself, smallest, best = 2.0, math.inf, 0
    for unit in range(2):
        scale = _UNITS[s] if unit == 1 else 1.0
        for c in range(3):
            mean = one.other[unit, c] / n if centred else 0.0
            other = scale * scale * max(one.other2[unit, c] - mean * one.other[unit, c], 0.0)
            product = scale * (one.product[unit, c] - off * one.other[unit, c])
            size = math.sqrt(other / n)
            allowed = size >= least
            if unit == 0 and c == k and max(math.sqrt(own / n), size) < least:
                return SILENT_AXIS
            if s == 0 and unit == 1:
                # The other's bias, cut to one value, is as good as what it reads of a slow turn; so is a constant.
                constant = one.other[1, c] ** 2 > _CONSTANT * n * one.other2[1, c]
                allowed = allowed and not constant and one.at_most < 0.5 * n
            for reversed_ in range(2):
                misfit = 2.0
                if allowed:
                    misfit = own + other - 2.0 * product * (1.0 - 2.0 * reversed_)
                    misfit /= max(own + other, 1e-300)
                if unit == 0 and c == k and reversed_ == 0:
                    itself = misfit
                if misfit < smallest:
                    smallest, best = misfit, 6 * unit + 2 * c + reversed_
    if itself < _SAME:
        return 2 * k
    if smallest < _SAME:
        return best
    return NO_AXIS if itself > _OTHERWISE else UNCLEAR


@compiled
def read_axes(sums: Any, s: int) -> tuple[int, int, int, bool]:
    """Find what the axes of sensor s are, and whether one of them is none of the other unit's while all else fits."""
    found, shaken = np.full(3, SILENT_AXIS), 0.0
    # A gyro's cross axes move little beside what leaks of a steady spin into them: the second look is without means.
    for centred in range(2 - s):
        greatest2, own2 = 0.0, 0.0
        for k in range(3):
            one = sums[3 * s + k]
            n = max(one.n, 1.0)
            own2 = max(own2, one.square / n)
            for c in range(3):
                mean = one.other[0, c] / n if centred else 0.0
                greatest2 = max(greatest2, (one.other2[0, c] - mean * one.other[0, c]) / n)
        greatest = math.sqrt(greatest2)
        shaken = max(shaken, greatest, math.sqrt(own2))
        least = max(_LEAST[s], _LEAK[s] * greatest)
        for k in range(3):
            one = sums[3 * s + k]
            if found[k] != SILENT_AXIS or one.n < _FEW:
                continue
            most = max(one.other2[0, 0], one.other2[0, 1], one.other2[0, 2], 0.0)
            full = one.at_most > 0.9 * one.n and one.square > max(4.0 * most, one.n * least**2)
            found[k] = AT_ONE_END if s == 0 and not centred and full else _best(one, k, centred == 1, least, s)
    plain, strange = True, False
    for k in range(3):
        plain = plain and (found[k] == 2 * k or found[k] in (SILENT_AXIS, NO_AXIS, UNCLEAR))
        strange = strange or found[k] == NO_AXIS
    return found[0], found[1], found[2], strange and plain and (s == 0 or shaken < _SHAKEN)


def _mapping(found: Sequence[int]) -> int:
    """Find the mapping of these axes, those that show nothing taken as they should be; 0 where that cannot be."""
    left = {0, 1, 2} - {one % 6 // 2 for one in found if one >= 0}
    matrix = np.zeros((3, 3), dtype=np.int64)
    for k, one in enumerate(found):
        column, sign = (one % 6 // 2, 1 - 2 * (one % 2)) if one >= 0 else (k if k in left else min(left, default=k), 1)
        left.discard(column)
        matrix[k, column] = sign
    return next((k for k, known in enumerate(MAPPINGS) if np.array_equal(known, matrix)), 0)


class PrecisionHealth:
    """Health of one precision unit, half second by half second; bias: of its gyros, 1 sigma, rad/s."""

    def __init__(self, bias: float) -> None:
        self.active = False
        self.suspect = False
        self._most_at_rest = 2.0 * EARTH_RATE + _BIASES * bias + _PULLED
        self._checks = fault_debounce.blank()
        self._channels = signal_checks.blank()
        self._sums: list[Any] = []
        # Samples of the conventional unit, in pieces as they came: most runs have no precision unit that needs them.
        self._beside: list[tuple[Stamps, Array]] = []
        self._still = 0
        self._resting: list[Array] = []
        # Bits of the mappings that the axes of gyro and accelerometer show, 0 where they are right; half seconds moved.
        self._wrong = [0, 0]
        self._differ = 0

    def beside(self, stamps: Stamps, values: Array) -> None:
        """Take samples of the conventional unit, shape (n, 6), rad/s and m/s^2; nan where it cannot be used."""
        self._beside.append((stamps, values))

    def judge(self, end_ns: int, still: bool, samples: tuple[Stamps, Array]) -> list[SensorFault]:
        """
        Take the half second up to `end_ns`, ns; gives what has become known, or has gone.

        still : whether the conventional unit finds the tool at rest; samples : stamps (n,), ns, and values (n, 6).
        """
        stamps, values = samples[0], np.ascontiguousarray(samples[1])
        self.active = self.active or len(stamps) > 0
        if not self.active:
            # The last piece that began before the next half second holds the sample to interpolate from.
            while len(self._beside) > 1 and self._beside[1][0][0] < end_ns:
                del self._beside[0]
            return []
        beside_ns, beside = self._take_beside(end_ns)
        began = end_ns - BIN_NS
        sums = np.zeros(6, dtype=SUMS)
        compare(values, _beside(stamps, beside_ns, beside), self._channels, sums)
        self._still = self._still + 1 if still else 0
        self._resting = self._resting if still else []
        doubtful = self._judge_samples(began, still)
        sound = bool(2 * np.count_nonzero(np.isfinite(beside).all(axis=1)) > len(beside))
        if not sound:
            # The conventional unit cannot be used, and what differed from it is open.
            self._sums, self._wrong = [], [0, 0]
        self._sums = [*self._sums, sums][-_WINDOW:]
        observe(self._checks[FaultCode.SILENT, 6], AGAINST if len(stamps) else FOR, began, 0.0, 0.0)
        back = int(np.count_nonzero(np.diff(stamps) <= 0))
        observe(self._checks[FaultCode.STAMPS, 0], FOR if 3 * back > len(stamps) else AGAINST, began, back, 0.0)
        for s in range(2):
            self._judge_axes(began, s)
        self._judge_wrong(began, still, sound)
        self._judge_rest(began, values)
        unit = [self._checks[code, place].seen for code, place in _OF_THE_UNIT]
        suspected = (fault_debounce.suspected(self._checks) | doubtful) & (GYRO | ACCEL)
        self.suspect = bool(suspected) or FOR in unit
        weigh(self._checks)
        return [self._named(one) for one in fault_debounce.take_changes(self._checks, end_ns, Unit.PRECISION)]

    @property
    def faults(self) -> list[SensorFault]:
        """Faults that stand."""
        return [self._named(one) for one in fault_debounce.standing(self._checks, Unit.PRECISION)]

    @property
    def refusal(self) -> Reason | None:
        """Why its gyros cannot be used now; None where they can."""
        stands = [one for one in self.faults if one.unusable]
        if stands:
            return Reason(ReasonCode.PRECISION_UNIT_FAULT, fault=stands[0])
        return Reason(ReasonCode.PRECISION_UNIT_SUSPECT) if self.suspect else None

    def _take_beside(self, end_ns: int) -> tuple[Stamps, Array]:
        """All samples of the conventional unit; the one before the next half second is kept, and those after it."""
        beside_ns, beside = self._beside[0]
        if len(self._beside) > 1:
            beside_ns = np.concatenate([part[0] for part in self._beside])
            beside = np.concatenate([part[1] for part in self._beside])
        kept = max(int(np.searchsorted(beside_ns, end_ns)) - 1, 0)
        self._beside = [(beside_ns[kept:], beside[kept:])]
        return beside_ns, beside

    def _named(self, fault: SensorFault) -> SensorFault:
        """Name the unit that is meant: mappings that are not proved are of either."""
        if not fault.mappings[2]:
            return fault
        return dataclasses.replace(fault, unit=Unit.EITHER, which=(*fault.mappings[:2], 0))

    def _judge_samples(self, began: int, still: bool) -> int:
        limits = np.full(3, math.inf)
        doubtful: int = signal_checks.judge_bin(SignalLimits(), self._checks, self._channels, limits, began)
        # The third sensor is the conventional accelerometer: what is seen of it belongs to the other monitor.
        self._checks["seen"][:, 6:] = NOTHING
        constant = self._channels["constant_bins"][:3]
        if not still and not constant.all():
            for k in np.flatnonzero(constant > 0):
                # Also where the x gyro is at the end of its range.
                observe(self._checks[FaultCode.STUCK, k], FOR, began, float(self._channels["last"][k]), 0.0)
        return doubtful

    def _judge_axes(self, began: int, s: int) -> None:
        whole = np.zeros(6, dtype=SUMS)
        for name in SUMS.names or ():
            whole[name] = sum(one[name] for one in self._sums)
        *read, strange = read_axes(whole, s)
        *latest, _ = read_axes(self._sums[-1], s)
        # Where the last half second differs from those before, it has just changed.
        found = read if read == latest else [SILENT_AXIS] * 3
        scaled = max(read) >= 6 and max(latest) >= 6
        for k in range(3 if s == 0 else 0):
            at_end = found[k] == AT_ONE_END and not scaled
            observe(self._checks[FaultCode.SATURATED, k], FOR if at_end else AGAINST, began, 1.0, 0.9)
        states = self._checks["state"]
        if states[FaultCode.DEAD, 3 * s] == FAULT or (states[FaultCode.STUCK, 3 * s : 3 * s + 3] == FAULT).any():
            return
        known = [one for one in found if one >= 0]
        if known or scaled:
            check = self._checks[FaultCode.UNIT, 3 * s]
            observe(check, FOR if scaled else AGAINST, began, 0.0, 0.0)
            check.seen_which[0] = 1
        if known and states[FaultCode.UNIT, 3 * s] != FAULT:
            right = all(one < 0 or one == 2 * k for k, one in enumerate(found))
            mapping = 0 if right else _mapping(found)
            strange = strange or not (right or mapping)
            if mapping or len(known) > 1 or not self._wrong[s]:
                self._wrong[s] = 1 << mapping if mapping else 0
        # That the fast axis agrees shows nothing of the two that north is sought with.
        shown = found[1:] if states[FaultCode.MISMATCH, 3 * s] == FAULT else found
        agrees = any(one >= 0 for one in shown)
        seen = FOR if strange else (AGAINST if agrees else NOTHING)
        observe(self._checks[FaultCode.MISMATCH, 3 * s], seen, began, 0.0, 0.0)

    def _judge_wrong(self, began: int, still: bool, sound: bool) -> None:
        check = self._checks[FaultCode.AXES, 0]
        proved = bool(check.state == FAULT and not check.which[2])
        wrong = bool(self._wrong[0] or self._wrong[1])
        across = bool(self._wrong[0] & _ACROSS) and not self._wrong[1]
        self._differ = self._differ + int(not still) if wrong else 0
        proved = proved or (self._differ > _MOVED_BINS and not across)
        observe(check, FOR if wrong else (NOTHING if proved and not sound else AGAINST), began, 0.0, 0.0)
        check.seen_which = (*self._wrong, int(not proved))

    def _judge_rest(self, began: int, values: Array) -> None:
        usable = np.isfinite(values).all(axis=1) if len(values) else np.zeros(0, dtype=np.bool_)
        if self._still <= _REST_BINS or np.count_nonzero(usable) < _FEW // 2:
            return
        # About its own axis a string may creep while it unwinds; across it nothing in a hole turns.
        mean = values[usable, 1:3].mean(axis=0)
        across, limit = float(np.abs(mean).max()), self._most_at_rest
        self._resting = [*self._resting, mean][-_STEADY_BINS:]
        spread = float(np.ptp(self._resting, axis=0).max())
        if across > limit and (len(self._resting) < _STEADY_BINS or spread > _STEADY * across):
            # A tool that comes to rest still turns a little, less and less.
            return
        observe(self._checks[FaultCode.REST_RATE, 0], FOR if across > limit else AGAINST, began, across, limit)


# Checks of the unit as a whole or of what only a second unit shows, which raise a doubt as soon as they are seen.
_OF_THE_UNIT = (
    (FaultCode.STAMPS, 0),
    (FaultCode.MISMATCH, 0),
    (FaultCode.MISMATCH, 3),
    (FaultCode.REST_RATE, 0),
)

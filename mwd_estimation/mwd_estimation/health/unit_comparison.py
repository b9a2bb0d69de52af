"""
Health of the precision unit: its own samples, and what the conventional unit beside it feels of the same motion.

Two units on one tool read the same vectors, so that no motion needs to be followed: over a second and a half each axis
of the precision unit is held against each of the conventional one, sample by sample at the same time. It should be its
own axis, one to one; reversed, another axis or 57 times as much are mistakes with a name. Which of the two is wrong a
third sensor must say: first both are named, and the precision unit alone where the tool has moved on for some seconds
and nothing has spoken against the conventional one; y and z of its gyros seldom show themselves so. What moves too
little to tell (the cross axes of a gyro in a smoothly turning string, all of a gyro at rest) stays unknown, but for
what no gyro at rest can read: much more than the Earth turns. Fault and end of a fault are weighed by
`health_evidence`.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import fault_debounce, fault_messages, signal_checks
from mwd_estimation.health.fault_debounce import (
    ABSENT,
    ACCEL,
    AGAINST,
    ALWAYS,
    AXES,
    D0,
    D2,
    DEAD,
    EVENTS,
    FAULT,
    FOR,
    FROM,
    GYRO,
    HELD,
    INVALID,
    NOISE,
    NOTHING,
    RATE,
    SATURATED,
    SEEN,
    STAMPS,
    STATE,
    STUCK,
    UNIT,
    note,
    weigh,
)
from mwd_estimation.health.fault_messages import CABLE, Finding
from mwd_estimation.health.signal_checks import BIN_NS, CONST, LAST
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import EARTH_RATE, STANDARD_GRAVITY

# Bit of a finding: the precision unit cannot be used.
PRECISION = 8
# Checks of `health_evidence` that mean something else of a second unit: it has fallen silent; its gyros, its
# accelerometers agree with no axis of the first; it reads more at rest than the Earth turns.
SILENT, RATES, FORCES, TOO_MUCH = ABSENT, HELD, HELD + 1, RATE
# Those of a magnetometer, which this unit has not.
_NOT_OURS = [*range(STUCK + 6, STUCK + 9), *range(SATURATED + 6, SATURATED + 9), INVALID + 2, DEAD + 2, NOISE]
# Numbers of these checks among all, behind those of the conventional unit.
FIRST_CHECK = 100

_WINDOW = 3  # bins
# Bins of motion after which the conventional unit would be in doubt if the mistake were its own.
_WITNESS_BINS = 12
# Mappings of y and z among themselves.
_ACROSS = [k for k, m in enumerate(axes.MAPPINGS) if m[0, 0] == 1]
_SILENT_BINS, _HELD_BINS = 4, 4
# Of an axis: samples, those at its greatest value, its sum and square; and with each axis of the conventional unit,
# cut to that greatest value as in SI and as in the other unit: product, that one's sum and square.
_N, _AT_MOST, _SUM, _OWN, _WITH, _OTHER, _OTHER2, _UNIT = 0, 1, 2, 3, 4, 7, 10, 9
_SIZE = _WITH + 2 * _UNIT
_FEW = 20
# Root mean square below which an axis says nothing, rad/s and m/s^2; that of forces beyond which two accelerometers
# need not agree: shocks are not the same to another bandwidth in another place.
_LEAST_RATE, _LEAST_FORCE, _SHAKEN = 0.005, 0.3, 15.0
# Misfit, from 0 (the same) by 1 (nothing in common) to 2 (reversed), that is still this axis, and that is not.
_SAME, _OTHERWISE = 0.3, 0.6
# Share of the mean in the mean square of what is one value all the time.
_ONE_VALUE = 0.8
_UNITS = np.array([math.degrees(1.0), 1.0 / STANDARD_GRAVITY])
# A rate at rest is too much beyond so many sigma of the bias, twice the Earth's, and what a string turns that is pulled
# steadily through a bend, which is rest to every other sensor: 10 deg in 30 m at 1 m/s, rad/s.
_BIASES, _PULLED = 40.0, math.radians(10.0 / 30.0)
_REST_BINS = 4
# And only where it stays for so many bins, within this share of it.
_STEADY_BINS, _STEADY = 6, 1.0


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is known of the unit: 1 sigma of its bias, rad/s."""

    bias: float


@compiled
def compare(
    stamps: Stamps, values: Array, beside_ns: Stamps, beside: Array, units: Array, channels: Array, sums: Array
) -> int:
    """
    Count the samples of half a second and sum their products with those of the conventional unit at the same time.

    Parameters
    ----------
    stamps, values : ndarray, shapes (n,) and (n, 6)
        Of the precision unit, ns; rates, rad/s, and forces, m/s^2.
    beside_ns, beside : ndarray, shapes (m,) and (m, 6)
        Of the conventional unit, over the same time and one sample more.
    units : ndarray, shape (2,)
        What rates and forces in another unit would be multiplied by.
    channels : ndarray
        Of `health_samples`.
    sums : ndarray, shape (6, 22)
        Of each axis; added to.

    Returns
    -------
    int
        Steps of time that did not advance.
    """
    most, one = np.zeros(6), np.zeros((1, 1))
    for i in range(len(stamps)):
        for row in range(6):
            if abs(values[i, row]) < signal_checks.ABSURD:
                most[row] = max(most[row], abs(values[i, row]))
    at, back = 0, 0
    for i in range(len(stamps)):
        back += int(i > 0 and stamps[i] <= stamps[i - 1])
        while at + 1 < len(beside_ns) and beside_ns[at + 1] < stamps[i]:
            at += 1
        known = at + 1 < len(beside_ns) and beside_ns[at] <= stamps[i] and beside_ns[at + 1] - beside_ns[at] < BIN_NS
        for c in range(6 if known else 0):
            known = known and abs(beside[at, c]) + abs(beside[at + 1, c]) < signal_checks.ABSURD
        share = (stamps[i] - beside_ns[at]) / (beside_ns[at + 1] - beside_ns[at]) if known else 0.0
        for row in range(6):
            v, first = values[i, row], 3 * (row // 3)
            at_most = abs(v) >= 0.999 * most[row]
            own = (1.0 - share) * beside[at, row] + share * beside[at + 1, row] if known else 0.0
            # A gyro may be at the end of its range while the string turns faster: that is not stuck.
            if not (row < 3 and at_most and abs(own) > 1.02 * abs(v) > 0.5):
                signal_checks.count(channels, row, values, row, i, i + 1, math.inf)
            if known and row >= 3:
                # The third sensor of the count only says whether the tool moves.
                one[0, 0] = own
                signal_checks.count(channels, 3 + row, one, 0, 0, 1, math.inf)
            if not known or not abs(v) < signal_checks.ABSURD:
                continue
            sums[row, _N] += 1.0
            sums[row, _AT_MOST] += 1.0 if at_most else 0.0
            sums[row, _SUM] += v
            sums[row, _OWN] += v * v
            for unit in range(2):
                # What lies beyond a gyro axis' own range it cannot have read.
                limit = 1.01 * most[row] / (units[0] if unit == 1 else 1.0) if row < 3 else math.inf
                for c in range(3):
                    other = (1.0 - share) * beside[at, first + c] + share * beside[at + 1, first + c]
                    other = min(max(other, -limit), limit)
                    j = unit * _UNIT + c
                    sums[row, _WITH + j] += v * other
                    sums[row, _OTHER + j] += other
                    sums[row, _OTHER2 + j] += other * other
    return back


@compiled
def _best(row: Array, k: int, centred: bool, least: float, factor: float) -> int:
    """
    Which axis of the conventional unit axis k is: twice its number, one more reversed; 6 more in another unit.

    -1: it says nothing; -2: it is none of them; -3: no good match, and not far from being itself.
    """
    n = max(row[_N], 1.0)
    off = row[_SUM] / n if centred else 0.0
    own = max(row[_OWN] - off * row[_SUM], 0.0)
    read = math.sqrt(own / n)
    best, found, itself, itself_size = _SAME, -3, 2.0, 0.0
    for unit in range(2):
        scale = factor if unit == 1 else 1.0
        for c in range(3):
            j = unit * _UNIT + c
            mean = row[_OTHER + j] / n if centred else 0.0
            other = scale * scale * max(row[_OTHER2 + j] - mean * row[_OTHER + j], 0.0)
            product = scale * (row[_WITH + j] - off * row[_OTHER + j])
            size = math.sqrt(other / n)
            if unit == 0 and c == k:
                itself_size = size
            if size < least:
                continue
            # The other's bias, cut to one value, is as good as what is felt of a slow turn.
            if unit == 1 and least < _LEAST_FORCE and row[_OTHER + j] ** 2 > _ONE_VALUE * n * row[_OTHER2 + j]:
                continue
            for way in range(2):
                sign = 1.0 if way == 0 else -1.0
                misfit = (own - 2.0 * sign * product + other) / max(own + other, 1e-300)
                if unit == 0 and c == k and way == 0:
                    itself = misfit
                    if misfit < _SAME:
                        return 2 * k
                # One value all the time is as good as any other cut to it.
                if misfit < best and (unit == 0 or least >= _LEAST_FORCE or row[_AT_MOST] < 0.5 * n):
                    best, found = misfit, 6 * unit + 2 * c + way
    if max(read, itself_size) < least:
        return -1
    return -2 if found == -3 and itself > _OTHERWISE else found


@compiled
def read_axes(sums: Array, s: int, factor: float, found: NDArray[np.int64]) -> int:
    """
    What the axes of sensor s are, into `found`, shape (3,), as `_best` says it, and -4 for always at one end.

    factor : of the other unit. Returns 1 where one of them is none of the conventional unit's, else 0.
    """
    shaken, greatest = 0.0, 0.0
    for k in range(3):
        found[k] = -1
    for centred in range(2 - s):
        # A gyro's cross axes feel little of their own beside what leaks of a steady spin into them.
        greatest = 0.0
        for k in range(3):
            row = sums[3 * s + k]
            n = max(row[_N], 1.0)
            shaken = max(shaken, math.sqrt(row[_OWN] / n))
            for c in range(3):
                mean = row[_OTHER + c] / n if centred == 1 else 0.0
                greatest = max(greatest, (row[_OTHER2 + c] - mean * row[_OTHER + c]) / n)
        greatest = math.sqrt(greatest)
        shaken = max(shaken, greatest)
        least = max(_LEAST_RATE, 0.004 * greatest) if s == 0 else max(_LEAST_FORCE, 0.02 * greatest)
        for k in range(3):
            row = sums[3 * s + k]
            if found[k] != -1 or row[_N] < _FEW:
                continue
            n, most = row[_N], 0.0
            for c in range(3):
                most = max(most, row[_OTHER2 + c])
            if (
                s == 0
                and centred == 0
                and row[_AT_MOST] > 0.9 * n
                and row[_OWN] > 4.0 * most
                and row[_OWN] > n * least**2
            ):
                found[k] = -4
            else:
                found[k] = _best(row, k, centred == 1, least, factor)
    strange, plain = False, True
    for k in range(3):
        strange = strange or found[k] == -2
        plain = plain and (found[k] < 0 or found[k] == 2 * k) and found[k] != -4
    return int(strange and plain and (s == 0 or shaken < _SHAKEN))


def _mapping(found: list[int]) -> int:
    """The mapping these axes are of, with those that do not tell taken as they should be; 0 where that cannot be."""
    left = {0, 1, 2} - {one % 6 // 2 for one in found if one >= 0}
    matrix = np.zeros((3, 3), dtype=np.int64)
    for k, one in enumerate(found):
        column, sign = (one % 6 // 2, 1 - 2 * (one % 2)) if one >= 0 else (k if k in left else min(left, default=k), 1)
        left.discard(column)
        matrix[k, column] = sign
    same = [k for k, known in enumerate(axes.MAPPINGS) if np.array_equal(known, matrix)]
    return same[0] if same else 0


class PrecisionHealth:
    """
    Health of one unit, bin by bin.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.heard = False
        self.suspect = False
        self._checks, self._notes, self._tally, self._events = fault_debounce.blank()
        self._channels, self._counts = signal_checks.blank()
        self._sums: list[Array] = []
        # Samples of the conventional unit, in pieces as they came: most runs have no precision unit that needs them.
        self._beside: list[tuple[Stamps, Array]] = []
        self._silent = self._still = 0
        self._resting: list[Array] = []
        # Mappings that the axes of gyro and accelerometer show, 0 where they are right; and for how many bins.
        self._wrong = [0, 0]
        self._differ = 0

    def beside(self, stamps: Stamps, values: Array) -> None:
        """Samples of the conventional unit, shape (n, 6), rad/s and m/s^2; not a number where it cannot be used."""
        self._beside.append((stamps, values))

    def judge(self, end_ns: int, still: bool, samples: tuple[Stamps, Array]) -> list[Finding]:
        """
        Take the half second up to `end_ns`, ns; gives what has become known, or has gone.

        still : whether the conventional unit finds the tool at rest; samples : stamps (n,), ns, and values (n, 6).
        """
        stamps, values = samples
        self.heard = self.heard or len(stamps) > 0
        if not self.heard:
            # The last piece that began before the next half second holds the sample to interpolate from.
            while len(self._beside) > 1 and self._beside[1][0][0] < end_ns:
                del self._beside[0]
            return []
        beside_ns, beside = self._beside[0]
        if len(self._beside) > 1:
            beside_ns = np.concatenate([part[0] for part in self._beside])
            beside = np.concatenate([part[1] for part in self._beside])
        # Of those beside, one before the next half second is kept.
        kept = max(int(np.searchsorted(beside_ns, end_ns)) - 1, 0)
        self._beside = [(beside_ns[kept:], beside[kept:])]
        began = end_ns - BIN_NS
        sums = np.zeros((6, _SIZE))
        back = compare(
            stamps, np.ascontiguousarray(values), beside_ns, beside, _UNITS,
            self._channels, sums,
        )  # fmt: skip
        self._still = self._still + 1 if still else 0
        self._resting = self._resting if still else []
        limits = np.full(3, math.inf)
        doubtful = signal_checks.close_bin(began, self._channels, self._counts, self._notes, limits, 0.0, False)
        self._notes[_NOT_OURS, SEEN] = NOTHING
        for k in range(3):
            held = int(self._channels[k, CONST])
            if held >= _HELD_BINS and not still and not self._channels[:3, CONST].all():
                # Also where the x gyro is at the end of its range and cannot tell.
                since = end_ns - held * BIN_NS
                note(self._notes, STUCK + k, FOR, since, int(self._channels[k, LAST] == 0.0), 0, 0)
        sound = bool(2 * np.count_nonzero(np.isfinite(beside).all(axis=1)) > len(beside))
        if not sound:
            # The conventional unit cannot be used, and what was held against it is open.
            self._sums, self._wrong = [], [0, 0]
        self._sums = [*self._sums, sums][-_WINDOW:]
        self._whole = self._sums[0] if len(self._sums) == 1 else sum(self._sums[1:], self._sums[0])
        self._note_silence(began, len(stamps))
        note(self._notes, STAMPS, FOR if 3 * back > len(stamps) else AGAINST, began, 0, 0, 0)
        for s in range(2):
            self._note_axes(began, s)
        self._note_wrong(began, still, sound)
        self._note_rest(began, values)
        self.suspect = bool((fault_debounce.suspected(self._checks, self._notes) | doubtful) & (GYRO | ACCEL)) or any(
            self._notes[k, SEEN] == FOR for k in (SILENT, STAMPS, FORCES, RATES, TOO_MUCH)
        )
        self._tally[EVENTS] = 0
        weigh(self._checks, self._notes, self._tally, self._events, end_ns)
        return [_words(row) for row in self._events[: self._tally[EVENTS]]]

    @property
    def findings(self) -> list[Finding]:
        """Faults that stand."""
        return [
            _words(np.array([0, k, FAULT, *self._checks[k, [FROM, *range(D0, D2 + 1)]]]))
            for k in np.flatnonzero(self._checks[:, STATE] == FAULT)
        ]

    @property
    def refusal(self) -> str:
        """Why its gyros cannot be used now, in words; empty where they can."""
        stands = [one for one in self.findings if one.unusable]
        if stands:
            return f"{stands[0].message}: {stands[0].remedy}"
        return "something speaks against the precision unit: not used until it is known what" if self.suspect else ""

    def _note_silence(self, began: int, n: int) -> None:
        self._silent = 0 if n else self._silent + 1
        seen = AGAINST if n else (FOR if self._silent >= _SILENT_BINS else NOTHING)
        note(self._notes, SILENT, seen, began - (self._silent - 1) * BIN_NS, 1, 0, 0)

    def _note_axes(self, began: int, s: int) -> None:
        read = np.zeros((2, 3), dtype=np.int64)
        strange = read_axes(self._whole, s, float(_UNITS[s]), read[0])
        read_axes(self._sums[-1], s, float(_UNITS[s]), read[1])
        # Where the last half second differs from those before, it has just changed.
        found = read[0].tolist() if (read[0] == read[1]).all() else [-1, -1, -1]
        scaled = bool((read.max(axis=1) >= 6).all())
        for k in range(3 if s == 0 else 0):
            note(self._notes, SATURATED + k, int(found[k] == -4 and not scaled), began, ALWAYS, 0, 0)
        first = STUCK + 3 * s
        if self._checks[DEAD + s, STATE] == FAULT or (self._checks[first : first + 3, STATE] == FAULT).any():
            return
        known = [one for one in found if one >= 0]
        if known or scaled:
            note(self._notes, UNIT + s, int(scaled), began, 1, 0, 0)
        if known and self._checks[UNIT + s, STATE] != FAULT:
            right = all(one < 0 or one == 2 * k for k, one in enumerate(found))
            mapping = 0 if right else _mapping(found)
            strange = strange or not (right or mapping)
            if mapping or len(known) > 1 or not self._wrong[s]:
                self._wrong[s] = 1 << mapping if mapping else 0
        disagrees = RATES if s == 0 else FORCES
        # That the fast axis agrees says nothing of the two that north is sought with.
        shown = found[1:] if self._checks[disagrees, STATE] == FAULT else found
        agrees = any(one >= 0 for one in shown)
        note(self._notes, disagrees, FOR if strange else (AGAINST if agrees else NOTHING), began, 0, 0, 0)

    def _note_wrong(self, began: int, still: bool, sound: bool) -> None:
        row = self._checks[AXES]
        proved = bool(row[STATE] == FAULT and not row[D2])
        wrong = bool(self._wrong[0] or self._wrong[1])
        across = any(self._wrong[0] >> k & 1 for k in _ACROSS) and not self._wrong[1]
        self._differ = self._differ + int(not still) if wrong else 0
        proved = proved or (self._differ > _WITNESS_BINS and not across)
        seen = FOR if wrong else (NOTHING if proved and not sound else AGAINST)
        note(self._notes, AXES, seen, began, self._wrong[0], self._wrong[1], int(not proved))

    def _note_rest(self, began: int, values: Array) -> None:
        usable = np.isfinite(values).all(axis=1) if len(values) else np.zeros(0, dtype=np.bool_)
        if self._still <= _REST_BINS or np.count_nonzero(usable) < _FEW // 2:
            return
        # About its own axis a string may creep while it unwinds; across it nothing in a hole turns.
        mean = values[usable, 1:3].mean(axis=0)
        across, limit = float(np.abs(mean).max()), 2.0 * EARTH_RATE + _BIASES * self.settings.bias + _PULLED
        self._resting = [*self._resting, mean][-_STEADY_BINS:]
        spread = float(np.ptp(self._resting, axis=0).max())
        if across > limit and (len(self._resting) < _STEADY_BINS or spread > _STEADY * across):
            # A tool that comes to rest still turns a little, less and less.
            return
        seen = FOR if across > limit else AGAINST
        note(self._notes, TOO_MUCH, seen, began, round(math.degrees(across) * 3600.0), 0, 0)


def _words(row: NDArray[np.int64]) -> Finding:
    """An event in words: those of the conventional unit's checks, or of what only a second unit shows."""
    k, details = int(row[1]), row[4:7]
    own = {
        SILENT: ("absent", "precision unit", "all", "has fallen silent", CABLE),
        STAMPS: ("stamps", "precision unit", "", "sends stamps that do not advance", "stamp samples where measured"),
        FORCES: (
            "mismatch", "precision accelerometer", "all", "agrees with no axis of the first accelerometer",
            "check its scale and mounting against the first one's",
        ),
        RATES: (
            "mismatch", "precision gyro", "all", "agrees with no axis of the first gyro",
            "check its scale, its clock and its mounting against the first one's",
        ),
        TOO_MUCH: (
            "unit", "precision gyro", "y/z", f"reads {details[0]} deg/h at rest, where the Earth turns 15",
            "check its unit (rad/s) and its calibration; tool.precision.gyro.bias_deg_h is the bias that is allowed",
        ),
    }  # fmt: skip
    if k in own:
        kind, sensor, axis, says, remedy = own[k]
        fault = Finding(
            kind, sensor, axis, "error", 0.9, f"{sensor} {says}", remedy, int(row[3]), 0, PRECISION, FIRST_CHECK + k
        )
        return fault if int(row[2]) == FAULT else fault_messages.over(fault, int(row[0]))
    either = k == AXES and details[2] != 0
    plain = fault_messages.finding([int(v) for v in row[:6]] + [0 if k == AXES else int(details[2])])
    if either:
        names = plain.sensor.split("/")
        return dataclasses.replace(
            plain,
            sensor="/".join([*names, *(f"precision {name}" for name in names)]),
            message=f"one of the two units: {plain.message}",
            confidence=0.5 * plain.confidence,
            unusable=PRECISION,
            check=FIRST_CHECK + k,
        )
    return dataclasses.replace(
        plain,
        sensor="/".join(f"precision {name}" for name in plain.sensor.split("/")),
        message=f"precision unit: {plain.message}",
        unusable=PRECISION if plain.unusable else 0,
        check=FIRST_CHECK + k,
    )

# SPDX-License-Identifier: Apache-2.0
"""
Detection of wrong handedness, sign, order or unit, or a dead axis, in the sensor columns of a six-axis table.

A wiring says which column, with which sign, belongs to which axis of a sensor; there are 48, half of them left-handed.
The columns may have a wrong wiring, or be in another unit; all rows of a run have the same fault. Three comparisons
reveal it. Total and dip of the reference reveal a wrong unit, a dead axis, and a wrong wiring of one sensor relative to
the other. The inclination and azimuth given in the table reveal a wrong wiring that both sensors share, above all the
handedness: a mirrored table has the same totals. Without these angles the depths reveal a wrong down-hole axis that
both sensors share: the hole would turn sharply from one row to the next, because a transverse axis turns with the
string.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import inclination, wrap_pi

# Largest number of rows that are examined; in a longer run, rows at equal intervals are examined.
_LOOKED_AT = 60
# Largest relative difference between the total of correct readings and its reference: for gravity, and for the field,
# which interference disturbs.
_GRAVITY_SHARE, _FIELD_SHARE = 0.03, 0.12
# Limits of angle differences, rad. A dip fits the reference below _DIP_FITS. Another wiring is considered if the hole
# direction differs from the table by more than _DIRECTION_OFF, because interference moves an azimuth by several
# degrees. The other wiring must fit within _DIRECTION_FITS, and better by the factor _BETTER.
_DIP_FITS, _DIRECTION_OFF, _DIRECTION_FITS, _BETTER = math.radians(1.5), math.radians(6.0), math.radians(4.0), 3.0
# A wiring is wrong if at most the share _FEW of the dips fits, and another wiring fits at least the share _MOST.
# _LEAST_ROWS is the smallest number of rows for a decision: one row fits one of 48 wirings by chance in a third of the
# cases, three rows in one of 10 000.
_FEW, _MOST, _LEAST_ROWS = 0.2, 0.8, 3
# Inclination above which a hole is taken to go up, rad: a horizontal well that passes the horizontal by a few degrees
# has a smaller one. And inclination that only holes drilled upwards in a mine exceed, rad.
_UPWARDS, _NO_HOLE = math.radians(95.0), math.radians(120.0)
# Largest change of inclination of usual holes, rad/m, and the shortest length over which it counts, m. In the right
# wiring, the share of larger changes is at most _FEW, and the sum of all changes is smaller than in the wiring of the
# table by the factor _BETTER.
_SHARPEST, _SHORTEST = math.radians(30.0) / 30.0, 10.0
# Attitudes that differ by more than this, rad, show the wiring independently.
_ANOTHER_ATTITUDE = math.radians(10.0)
_ACCELERATIONS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "ft/s^2": 0.3048, "Gal": 0.01}
_FIELDS = {"nT": 1e-9, "uT": 1e-6, "mT": 1e-3, "T": 1.0, "gauss": 1e-4, "mgauss": 1e-7}
# Largest number of corrections of a wiring that a message names.
_NAMED = 4
# An axis is dead if its range is less than the share _CONSTANT of the total although the total and the other axes
# require a range above the share _MOVES.
_CONSTANT, _MOVES = 5e-4, 0.1
# A total is wrong if its relative error exceeds _OFF_SHARE times _GRAVITY_SHARE or _FIELD_SHARE.
_OFF_SHARE = 0.3


@dataclass(frozen=True)
class Sensor:
    """Readings of one sensor in a run, with the names and units of its columns."""

    columns: tuple[str, str, str]
    values: Array  #: shape (n, 3); SI, axial and the two transverse axes
    total: float  #: expected length of the vector, SI; nan: unknown
    share: float  #: largest relative error of the total of correct readings
    unit: float  #: unit in which the columns were read, SI
    units: Mapping[str, float]  #: possible units of the columns by name, SI


@dataclass(frozen=True)
class ExpectedRows:
    """Expected values of the rows, shape (n,), rad and m; NaN if unknown."""

    md: Array  #: measured depth, m
    dip: Array
    inclination: Array  #: inclination in the table
    azimuth: Array  #: azimuth in the table, converted to magnetic north


def accelerometers(columns: tuple[str, str, str], f_t: Array, unit: float) -> Sensor:
    """
    Return the accelerometers of a run.

    f_t, shape (n, 3): readings, m/s^2; unit: unit of the columns, m/s^2.
    """
    return Sensor(columns, f_t, STANDARD_GRAVITY, _GRAVITY_SHARE, unit, _ACCELERATIONS)


def magnetometers(columns: tuple[str, str, str], b_t: Array, total: float, unit: float) -> Sensor:
    """
    Return the magnetometers of a run.

    b_t, shape (n, 3): readings, T; total: reference field, T, nan if unknown; unit: unit of the columns, T.
    """
    return Sensor(columns, b_t, total, _FIELD_SHARE, unit, _FIELDS)


def wiring_faults(force: Sensor, field: Sensor, expected: ExpectedRows) -> tuple[Reason, ...]:
    """
    Return the faults of the sensor columns of a run, with the column names of the table; empty if none is found.

    Rows with a reading that is not finite or is zero are not examined. With a dead axis, the wiring is not examined.
    """
    usable = np.isfinite(force.values).all(axis=1) & np.isfinite(field.values).all(axis=1)
    usable &= (np.linalg.norm(force.values, axis=1) > 0.0) & (np.linalg.norm(field.values, axis=1) > 0.0)
    at = np.flatnonzero(usable)
    if not len(at):
        return ()
    found, scaled = list[Reason](), list[Array]()
    for sensor in (force, field):
        values = sensor.values[at]
        unit = _unit_of(sensor, values)
        if unit is not None:
            found.append(Reason(Code.TABLE_UNIT, names=(", ".join(sensor.columns), unit)))
            values = values * sensor.units[unit] / sensor.unit
        dead = _dead(sensor, values)
        if dead is not None:
            found.append(Reason(Code.DEAD_AXIS, names=(sensor.columns[dead],)))
        scaled.append(values)
    if any(reason.code is Code.DEAD_AXIS for reason in found):
        return tuple(found)
    looked = np.unique(np.linspace(0, len(at) - 1, min(len(at), _LOOKED_AT)).round().astype(int))
    f_t, b_t = (values[looked] for values in scaled)
    known = [part[at][looked] for part in (expected.dip, expected.inclination, expected.azimuth)]
    wirings, shown_by = _wirings(f_t, b_t, *known)
    if not wirings and not np.isfinite(known[1]).any():
        wirings, shown_by = _smooth(scaled[0], expected.md[at]), "depths"
    return (*found, _named(force.columns, field.columns, wirings, shown_by)) if wirings else tuple(found)


def _unit_of(sensor: Sensor, values: Array) -> str | None:
    """
    Return the unit with which the total of the readings is as expected.

    None if the unit that was read fits, if no unit fits, or if the expected total is unknown.
    """
    ratio = float(np.median(np.linalg.norm(values, axis=1))) / sensor.total
    # Units differ by more than a factor of two: a smaller ratio has another cause, such as a wrong reference.
    if not math.isfinite(ratio) or 0.5 < ratio < 2.0:
        return None
    return next(
        (name for name, unit in sensor.units.items() if abs(ratio * unit / sensor.unit - 1.0) < sensor.share), None
    )


def _dead(sensor: Sensor, values: Array) -> int | None:
    """
    Return the index of an axis that is constant although total and other axes require a change; None without one.

    The result is also None with fewer than three rows or an unknown total.
    """
    if len(values) < _LEAST_ROWS or not math.isfinite(sensor.total):
        return None
    moved = np.ptp(values, axis=0) / sensor.total
    off = np.abs(np.linalg.norm(values, axis=1) / sensor.total - 1.0)
    # A smaller share of rows with a wrong total may come from stations near steel.
    if np.mean(off > _OFF_SHARE * sensor.share) < _FEW:
        return None
    for axis in range(3):
        others = np.delete(values, axis, axis=1)
        implied = np.sqrt(np.maximum(sensor.total**2 - np.sum(others**2, axis=1), 0.0))
        if moved[axis] < _CONSTANT and np.ptp(implied) > _MOVES * sensor.total:
            return axis
    return None


def _ways() -> tuple[Array, list[int]]:
    """
    Return the 48 wirings of three axes as signed permutation matrices, shape (48, 3, 3), and their mistakes.

    The second result is the number of mistakes in each wiring; the wirings are in the order of this number.
    """
    ways = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            way = np.zeros((3, 3))
            way[range(3), order] = signs
            moved = sum(k != place for k, place in enumerate(order))
            turned = 1 if signs == (-1.0, -1.0, -1.0) else signs.count(-1.0)
            ways.append((max(moved - 1, 0) + turned, way))
    ways.sort(key=lambda pair: pair[0])
    return np.stack([way for _, way in ways]), [cost for cost, _ in ways]


_WAYS, _COSTS = _ways()
_AS_IT_IS = 0
_REVERSED = int(np.argmin(np.abs(_WAYS + np.eye(3)).sum(axis=(1, 2))))


def _cost(pair: tuple[int, int]) -> int:
    """Return the number of mistakes in a wiring of both sensors; the same mistakes in both count once, plus one."""
    p, q = pair
    return _COSTS[p] + (1 if p == q and p != _AS_IT_IS else _COSTS[q])


def _wirings(
    f_t: Array, b_t: Array, dip: Array, printed_inclination: Array, printed: Array
) -> tuple[list[tuple[int, int]], str]:
    """
    Return the simplest wirings of both sensors that explain a run, as indices in `_WAYS`, and their evidence in words.

    The list is empty if the table may have the right wiring. f_t, b_t: shape (n, 3). dip, printed_inclination, printed:
    shape (n,), as in `ExpectedRows`.
    """
    f = np.einsum("pij,nj->pni", _WAYS, f_t / np.linalg.norm(f_t, axis=1, keepdims=True))
    b = np.einsum("qij,nj->qni", _WAYS, b_t / np.linalg.norm(b_t, axis=1, keepdims=True))
    known = np.isfinite(dip)
    dips = -np.arcsin(np.clip(np.einsum("pni,qni->pqn", f[:, known], b[:, known]), -1.0, 1.0))
    fits = (np.abs(dips - dip[known]) < _DIP_FITS).mean(axis=2) if known.any() else np.ones((len(f), len(b)))
    off = _directions_off(f, b, printed_inclination, printed)
    reversed_dips = known.any() and fits[_REVERSED, _AS_IT_IS] >= _MOST and fits[_AS_IT_IS, _AS_IT_IS] <= _FEW
    tilt = inclination(f[_AS_IT_IS])
    if off is None and reversed_dips and ((tilt > _UPWARDS).all() or tilt.max() > _NO_HOLE):
        # The columns contain specific force although they are named as gravity, or the reverse: the hole seems to go up
        # everywhere, or as steeply as no well does. A reference dip of the wrong sign gives the same difference of the
        # dips, but leaves the hole pointing down.
        return [(_REVERSED, _AS_IT_IS)], "dip"
    if off is not None and off[_AS_IT_IS, _AS_IT_IS] > _DIRECTION_OFF:
        # Compare with the angles in the table. Among the wirings that fit these angles, keep those with the best dips.
        fitting = (off < _DIRECTION_FITS) & (_BETTER * off < off[_AS_IT_IS, _AS_IT_IS])
        fitting &= fits >= max(float(fits[_AS_IT_IS, _AS_IT_IS]), 1.0 / len(dip))
    elif _independent(f_t, b_t) and fits[_AS_IT_IS, _AS_IT_IS] <= _FEW:
        # Compare one sensor with the other. Reversing all signs looks like a dip of the wrong sign (`DIP_SIGN`).
        fitting = np.zeros_like(fits, dtype=bool)
        fitting[_AS_IT_IS] = fits[_AS_IT_IS] >= _MOST
        fitting[_AS_IT_IS, _REVERSED] = False
    else:
        return [], ""
    pairs = [(int(p), int(q)) for p, q in np.argwhere(fitting)]
    scores = [(-float(fits[pair]), _cost(pair)) for pair in pairs]
    shown_by = "dip" if off is None else "inclination and azimuth of the table"
    return [pair for pair, score in zip(pairs, scores, strict=True) if score == min(scores)], shown_by


def _smooth(f_t: Array, md: Array) -> list[tuple[int, int]]:
    """
    Return the simplest wirings, right-handed and left-handed, with which the hole is smooth, if the table's is not.

    Both sensors have the same wiring. f_t, md: shapes (n, 3) and (n,), the rows with readings. Rows with a wrong total
    or without depth are left out.
    """
    right = np.abs(np.linalg.norm(f_t, axis=1) / STANDARD_GRAVITY - 1.0) < _GRAVITY_SHARE
    order = np.argsort(np.where(right, md, np.nan), kind="stable")[: int((right & np.isfinite(md)).sum())]
    tilt = inclination(np.einsum("pij,nj->pni", _WAYS, f_t[order]))
    changes = np.abs(np.diff(tilt))
    sharp = changes > _SHARPEST * np.maximum(np.diff(md[order]), _SHORTEST)
    if sharp[_AS_IT_IS].sum() < _LEAST_ROWS or sharp[_AS_IT_IS].mean() <= _FEW:
        return []
    total = changes.sum(axis=1)
    fitting = (sharp.mean(axis=1) <= _FEW) & (_BETTER * total < total[_AS_IT_IS])
    fitting &= np.median(tilt, axis=1) < _UPWARDS
    hands = np.linalg.det(_WAYS)
    ways = (np.flatnonzero(fitting & (hands * hand > 0.0))[:1] for hand in (1.0, -1.0))
    return [(int(p), int(p)) for way in ways for p in way]


def _directions_off(f: Array, b: Array, printed_inclination: Array, printed: Array) -> Array | None:
    """
    Return the median angle between the hole axis of each pair of wirings and the hole axis in the table, rad, (48, 48).

    f, b: unit vectors by wiring, shapes (48, n, 3). None if the table has no usable angles.
    """
    whole = np.isfinite(printed_inclination) & np.isfinite(printed)
    level = np.isfinite(printed_inclination)
    if whole.any():
        tilt = inclination(f[:, whole])[:, None]
        turn = magnetic_geometry.raw_azimuth(f[:, None, whole], b[None, :, whole])
        there = printed_inclination[whole]
        across = np.sqrt(np.abs(np.sin(tilt) * np.sin(there)))
        apart = np.hypot(tilt - there, 2.0 * across * np.abs(np.sin(0.5 * wrap_pi(turn - printed[whole]))))
        # Leave out rows near the vertical, where the direction does not distinguish the wirings.
        telling = np.sin(there) > math.sin(_ANOTHER_ATTITUDE)
        return np.asarray(np.median(apart[..., telling], axis=2)) if telling.any() else None
    if level.any():
        apart = np.abs(inclination(f[:, level]) - printed_inclination[level])
        return np.repeat(np.median(apart, axis=1)[:, None], len(b), axis=1)
    return None


def _independent(f_t: Array, b_t: Array) -> bool:
    """Return whether at least `_LEAST_ROWS` rows differ in attitude by more than `_ANOTHER_ATTITUDE`."""
    chosen: list[tuple[Array, Array]] = []
    for one in zip(f_t, b_t, strict=True):
        if all(max(map(_angle, one, other)) > _ANOTHER_ATTITUDE for other in chosen):
            chosen.append(one)
        if len(chosen) == _LEAST_ROWS:
            return True
    return False


def _angle(a: Array, c: Array) -> float:
    """Return the angle between two vectors, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(a, c))), float(a @ c))


def _named(force: Sequence[str], field: Sequence[str], pairs: Sequence[tuple[int, int]], shown_by: str) -> Reason:
    """Return the reason that names the corrections of the columns, one for each possible wiring, and what shows it."""
    if all(p == _AS_IT_IS for p, _ in pairs):
        # The inverse change of the gravity columns gives the same dips.
        remedies = [_words(names, way) for _, q in pairs for names, way in ((field, _WAYS[q]), (force, _WAYS[q].T))]
    else:
        ways = [((force, _WAYS[p]), (field, _WAYS[q])) for p, q in pairs]
        remedies = [" and ".join(filter(None, (_words(names, way) for names, way in both))) for both in ways]
    mirrored = all(np.linalg.det(_WAYS[p]) < 0.0 and np.linalg.det(_WAYS[q]) < 0.0 for p, q in pairs)
    kind = "the axes are left-handed" if mirrored else "axes or signs are wrong"
    return Reason(Code.WIRING, names=(shown_by, kind, *remedies[:_NAMED]))


def _words(names: Sequence[str], way: Array) -> str:
    """Return the correction of three columns in words; empty if they need none."""
    order, signs = np.argmax(np.abs(way), axis=1), way.sum(axis=1)
    moved = [k for k in range(3) if order[k] != k]
    turned = [names[order[k]] for k in range(3) if signs[k] < 0.0]
    words = []
    if len(moved) == 2:
        words.append(f"exchange {names[moved[0]]} and {names[moved[1]]}")
    elif moved:
        words.append("reorder to " + ", ".join(names[place] for place in order))
    if turned:
        words.append("reverse the sign of " + ", ".join(turned))
    return " and ".join(words)

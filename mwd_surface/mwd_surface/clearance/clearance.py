# SPDX-License-Identifier: Apache-2.0
"""
Clearance between two wells by the separation rule of the ISCWSA.

Separation factor (S. J. Sawaryn and others, "Well-Collision-Avoidance Separation Rule", SPE Drilling & Completion 34,
2019, SPE 187073): the distance between the centres minus both radii and a surface margin, divided by k times the
pedal-curve radius of both wells' covariances, including the uncertainty of the projection ahead. The geometry is
computed by `welleng`, which reproduces the ISCWSA's standard set of well paths. The errors of the two wells are assumed
to be independent.

For points of one well the library finds the nearest point of the other well. Each well is used as the first well in
turn, so that the smallest factor does not depend on which well is called the offset well.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.uncertainty.position_covariance import UncertainWell

# Spacing of the points at which two wells are compared, m; between points the library searches for the smallest factor.
_STEP = 30.0
# Distance of an extra point from each end of a well, m, because the library finds minima only between points.
_AT_END = 0.02
# Shortest length over which a dogleg is checked, m: angles of closer stations differ by noise.
_DOGLEG_LENGTH = 10.0
# Variance added to every position, (10 um)^2 in m^2: the position of a first station may be exact, and rounding could
# make its variance negative.
_ROUNDING = 1e-10
# Change of direction between two points, rad, below which the hole between them is given to the library as straight. On
# such an arc the library computes the nearest point from a radius so large that rounding moves the point by metres.
_STRAIGHT = 1e-6
# Distance at the same measured depth below which two wells count as the same hole, m.
_SAME_HOLE = 0.05


class ClearanceLevel(enum.IntEnum):
    """Level of a separation factor: clear, warning, or stop drilling."""

    CLEAR = 0
    WARNING = 1
    STOP = 2


@dataclasses.dataclass(frozen=True)
class ClearanceRule:
    """Separation rule and its levels; the defaults are those of the paper for collisions that endanger people."""

    k: float = setting(
        3.5, "Factor on the combined 1 sigma of both wells. Raising it keeps wells farther apart.", low=1.0, high=10.0
    )
    surface_margin_m: float = setting(
        0.3,
        "Distance that is kept even if both positions are exact. Raising it keeps wells farther apart.",
        low=0.0,
        high=10.0,
    )
    projection_sigma_m: float = setting(
        0.5,
        "1 sigma of the position of the hole between the last survey and the next one. Raising it keeps wells farther "
        "apart.",
        low=0.0,
        high=10.0,
    )
    warning_factor: float = setting(
        1.25, "Separation factor below which a warning is raised. Raising it warns earlier.", low=1.0, high=20.0
    )
    stop_factor: float = setting(
        1.0, "Separation factor below which drilling must stop. The rule allows no less than 1.", low=1.0, high=20.0
    )
    farthest_km: float = setting(
        10.0,
        "Distance between two wells, or of the first station from its wellhead, above which positions count as "
        "wrong. Raise it to confirm that the wells really are so far apart.",
        low=1.0,
        high=1e5,
    )
    largest_dogleg_deg_30m: float = setting(
        30.0,
        "Dogleg severity above which a list counts as wrong. Raise it to confirm a hole that really turns so sharply.",
        low=5.0,
        high=540.0,
    )

    def level(self, factor: float) -> ClearanceLevel:
        """Return the level of a separation factor; the level of NaN is STOP."""
        if not factor >= self.stop_factor:
            return ClearanceLevel.STOP
        return ClearanceLevel.WARNING if factor < self.warning_factor else ClearanceLevel.CLEAR


@dataclasses.dataclass(frozen=True)
class NotCompared:
    """Part of a well that was not compared with the other well."""

    well: str  #: name of the well
    #: `from_md`, `to_md`: measured depths, m
    from_md: float
    to_md: float
    reason: str  #: why the part was not compared
    #: whether the user stated that both wells are the same hole in this part, so that no comparison is missing
    shared: bool = False

    def remark(self) -> Remark:
        """Return a remark on the part that was not compared and the reason."""
        text = f"{self.well} was not compared from {self.from_md:.0f} to {self.to_md:.0f} m: {self.reason}"
        return Remark(RemarkKind.NOT_COMPARED, text, {"from_md": self.from_md, "to_md": self.to_md})


@dataclasses.dataclass(frozen=True)
class Clearance:
    """Distance and separation factor from one well to another, along the first well."""

    name: str  #: name of the other well
    #: shape (n,); measured depth along the first well, m, in order: its stations, points between them, and the minima
    #: of the factor. A depth may occur twice, with two points of the other well.
    md: Array
    offset_md: Array  #: shape (n,); measured depth of the nearest point of the other well, m
    #: `distance`, `allowed`: shape (n,); distance between the centres, and the distance at which the factor is 1, m
    distance: Array
    allowed: Array
    factor: Array  #: shape (n,); separation factor; negative if the holes overlap
    #: shape (n,); direction to the other well, perpendicular to the first, from the high side of the first well
    #: clockwise looking downhole, rad
    toolface: Array
    #: shape (n,); toolface + azimuth: the same direction measured from north, rad, as used in travelling-cylinder plots
    bearing: Array
    rule: ClearanceRule
    not_compared: tuple[NotCompared, ...] = ()  #: parts of both wells that lie above the compared paths
    other: UncertainWell | None = None  #: the other well, for drawings

    @property
    def least(self) -> int:
        """Index of the smallest separation factor."""
        return int(np.argmin(self.factor))

    @property
    def level(self) -> ClearanceLevel:
        """Level of the smallest separation factor."""
        return self.rule.level(float(self.factor[self.least]))

    def between(self, start: float, end: float) -> Clearance | None:
        """Return the clearance on the part of the first well between two measured depths, m; None without points."""
        part = (self.md >= start) & (self.md <= end)
        if not np.any(part):
            return None
        arrays = {
            f.name: getattr(self, f.name)[part]
            for f in dataclasses.fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return dataclasses.replace(self, **arrays)

    def sentence(self) -> str:
        """Return a sentence that says where the separation factor of the other well is smallest."""
        k = self.least
        limit = {
            ClearanceLevel.STOP: f", below {self.rule.stop_factor:g}",
            ClearanceLevel.WARNING: f", below {self.rule.warning_factor:g}",
        }
        return (
            f"{self.name} is {self.distance[k]:.1f} m away at {self.md[k]:.0f} m: separation factor "
            f"{self.factor[k]:.2f}{limit.get(self.level, '')}; the rule allows no less than {self.allowed[k]:.1f} m"
        )


def clearance(
    reference: UncertainWell, offset: UncertainWell, rule: ClearanceRule, shared_to: float | None = None
) -> Clearance:
    """
    Return the clearance from one well to another by the separation rule.

    Parameters
    ----------
    reference : UncertainWell
        Well being drilled; the result is given along this well.
    offset : UncertainWell
        Other well, in the same axes and from the same origin.
    shared_to : float, optional
        Measured depth down to which both wells are the same hole, m, for a sidetrack and its parent. They are compared
        below this depth, and the position at this depth is assumed to be exact.

    Raises
    ------
    ValueError
        The axes refer to different norths, the wells are the same hole but shared_to is not given, they are farther
        apart than `farthest_km` of the rule, or `check_plausible` or `UncertainWell.covariance` refuses a well.
    """
    if reference.north != offset.north:
        raise ValueError(
            f"{offset.name}: its azimuths are from {offset.north.name.lower()} north, but those of the well from "
            f"{reference.north.name.lower()} north"
        )
    for well in (reference, offset):
        check_plausible(well, rule)
    missing = _above(reference, shared_to) + _above(offset, shared_to)
    other = offset
    if shared_to is None:
        _check_apart(reference, offset)
    else:
        reference, offset = reference.below(shared_to), offset.below(shared_to)
    first, second = _library_survey(reference), _library_survey(offset)
    ahead, back = _compared(first, second, rule), _compared(second, first, rule)
    here, there = _nearest(ahead, back)
    first, second = _library_survey(reference, here), _library_survey(offset, there)
    ahead, back = _compared(first, second, rule), _compared(second, first, rule)
    nearest = float(np.min(ahead.distance_cc))
    if nearest > 1000.0 * rule.farthest_km:
        raise ValueError(
            f"{offset.name} lies {nearest / 1000.0:.0f} km from {reference.name}: the position of its wellhead or the "
            f"coordinates of its list are wrong. Correct them, leave the well out, or confirm it by rule.farthest_km"
        )
    # Add the minima found from the other well: they may lie between the points of the first well.
    kept = sorted({int(np.argmin(back.sf)), int(np.argmin(back.distance_cc)), *_minima(back.sf)})
    rows = [_rows(ahead, ahead.ref, ahead.off), _rows(back, back.off, back.ref)[kept]]
    table = np.concatenate(rows)
    md, offset_md, distance, allowed, factor, toolface, bearing = table[np.argsort(table[:, 0], kind="stable")].T
    return Clearance(offset.name, md, offset_md, distance, allowed, factor, toolface, bearing, rule, missing, other)


def check_plausible(well: UncertainWell, rule: ClearanceRule) -> None:
    """
    Raise ValueError if the list of a well was probably read wrongly.

    This is so if the first station lies farther from the map origin than `farthest_km`, or the well turns more sharply
    above its last survey than `largest_dogleg_deg_30m`; the message says where, and which setting allows the value.
    """
    away = math.hypot(*well.positions[0, :2])
    if away > 1000.0 * rule.farthest_km:
        raise ValueError(
            f"{well.name} starts {away / 1000.0:.0f} km from the wellhead: its coordinates are probably those of a "
            "map. Subtract the wellhead, or confirm the distance by rule.farthest_km"
        )
    angle = mc.dogleg(well.inclination[:-1], well.azimuth[:-1], well.inclination[1:], well.azimuth[1:])
    severity = np.degrees(angle) / np.maximum(np.diff(well.md), _DOGLEG_LENGTH) * 30.0
    # The path from the bit to the plan ahead is not drilled and may have a corner.
    severity = severity[well.md[1:] <= well.surveyed]
    k = int(np.argmax(severity)) if severity.size else 0
    if severity.size and severity[k] > rule.largest_dogleg_deg_30m:
        raise ValueError(
            f"{well.name} turns {math.degrees(angle[k]):.0f} deg between {well.md[k]:.0f} and {well.md[k + 1]:.0f} m "
            f"({severity[k]:.0f} deg/30 m): a station is probably wrong. Correct its list, or confirm the dogleg by "
            "rule.largest_dogleg_deg_30m"
        )


def _above(well: UncertainWell, shared_to: float | None) -> tuple[NotCompared, ...]:
    """Return the part of a well above the compared path as a tuple; empty if there is no such part."""
    if shared_to is not None:
        return (NotCompared(well.name, 0.0, shared_to, "both wells are the same hole in this part", shared=True),)
    first = float(well.md[0])
    return (NotCompared(well.name, 0.0, first, "its list starts below this part"),) if first > 0.0 else ()


def _compared(first: Any, second: Any, rule: ClearanceRule) -> Any:
    from welleng.clearance import IscwsaClearance

    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("ignore")
        return IscwsaClearance(first, second, k=rule.k, sigma_pa=rule.projection_sigma_m, Sm=rule.surface_margin_m)


def _nearest(ahead: Any, back: Any) -> tuple[float, float]:
    """Return the measured depths of the smallest separation factor along the first and the second well, m."""
    k, j = int(np.argmin(ahead.sf)), int(np.argmin(back.sf))
    if ahead.sf[k] <= back.sf[j]:
        return float(ahead.ref.md[k]), float(ahead.off.md[k])
    return float(back.off.md[j]), float(back.ref.md[j])


def _minima(factor: Array) -> list[int]:
    """Return the indices of factors that are smaller than both neighbours."""
    return [int(k) + 1 for k in np.flatnonzero((factor[1:-1] < factor[:-2]) & (factor[1:-1] < factor[2:]))]


def _rows(found: Any, here: Any, there: Any) -> Array:
    """
    Return the columns of `Clearance` from md to bearing, shape (n, 7).

    found: comparison by the library. here, there: points of the first well, and nearest points of the other well.
    """
    inc, azi = np.asarray(here.inc_rad, dtype=float), np.asarray(here.azi_grid_rad, dtype=float)
    to_other = np.column_stack([there.n, there.e, there.tvd]) - np.column_stack([here.n, here.e, here.tvd])
    high = np.column_stack([np.cos(inc) * np.cos(azi), np.cos(inc) * np.sin(azi), -np.sin(inc)])
    right = np.column_stack([-np.sin(azi), np.cos(azi), np.zeros(azi.size)])
    toolface = np.arctan2(np.sum(to_other * right, axis=1), np.sum(to_other * high, axis=1)) % math.tau
    columns = (here.md, there.md, found.distance_cc, found.masd, found.sf, toolface, (toolface + azi) % math.tau)
    return np.column_stack([np.asarray(column, dtype=float) for column in columns])


def nearest_first(found: Sequence[Clearance]) -> list[Clearance]:
    """Return clearances in the order of their smallest separation factors, the smallest first."""
    return sorted(found, key=lambda c: float(c.factor[c.least]))


def _check_apart(reference: UncertainWell, offset: UncertainWell) -> None:
    end = min(reference.md[-1], offset.md[-1])
    depths = np.linspace(max(reference.md[0], offset.md[0]), end, 200)
    if depths[0] >= end:
        return
    places = [mc.interpolate(w.md, w.inclination, w.azimuth, w.positions, depths)[2] for w in (reference, offset)]
    same = np.linalg.norm(places[0] - places[1], axis=1) < _SAME_HOLE
    if same[0]:
        depth = depths[int(np.argmin(same)) - 1] if not np.all(same) else end
        raise ValueError(
            f"{offset.name} lies in the same place as {reference.name} down to {depth:.0f} m: give the place of its "
            "wellhead (north_m, east_m), or shared_to_m where both are the same hole"
        )


def _library_survey(well: UncertainWell, near: float | None = None) -> Any:
    """
    Return the well as a `Survey` of welleng with points at most `_STEP` apart; covariances are interpolated linearly.

    near: measured depth, m, around which the points are ten times as dense, because welleng interpolates between two
    points.
    """
    from welleng.survey import Survey, SurveyHeader

    covariance = well.covariance()
    ends = np.array([well.md[0] + _AT_END, well.md[-1] - _AT_END])
    md = np.concatenate([well.md, np.arange(well.md[0], well.md[-1], _STEP), ends])
    if near is not None:
        dense = near + np.linspace(-_STEP, _STEP, 21)
        md = np.append(md, dense[(dense > well.md[0]) & (dense < well.md[-1])])
    md = np.unique(md)
    # Omit points within a centimetre of a station, because they would only repeat the station.
    md = md[np.concatenate([[True], np.diff(md) > 0.01])]
    inc, azi, positions = mc.interpolate(well.md, well.inclination, well.azimuth, well.positions, md)
    inc, azi = _straightened(inc, azi)
    k = np.clip(np.searchsorted(well.md, md, side="right") - 1, 0, well.md.size - 2)
    part = ((md - well.md[k]) / (well.md[k + 1] - well.md[k]))[:, None, None]
    header = SurveyHeader(
        latitude=0.0,
        longitude=0.0,
        altitude=0.0,
        survey_date="2026-01-01",
        b_total=well.reference.b_total * 1e9,
        dip=math.degrees(well.reference.dip),
        declination=0.0,
        convergence=0.0,
        azi_reference="grid",
    )
    return Survey(
        md=md,
        inc=np.degrees(inc),
        azi=np.degrees(azi),
        n=positions[:, 0],
        e=positions[:, 1],
        tvd=positions[:, 2],
        cov_nev=covariance[k] * (1.0 - part) + covariance[k + 1] * part + _ROUNDING * np.eye(3),
        radius=well.radius,
        header=header,
        start_nev=positions[0],
        start_xyz=positions[0][[1, 0, 2]],
        error_model=None,
        deg=True,
    )


def _straightened(inclination: Array, azimuth: Array) -> tuple[Array, Array]:
    """
    Return directions, rad, shape (n,), without changes of less than `_STRAIGHT` from one point to the next.

    A list in feet has such changes, because its stations are rounded to other depths than the points between them.
    """
    inc, azi = inclination.copy(), azimuth.copy()
    for k in range(1, inc.size):
        if mc.dogleg(inc[k - 1], azi[k - 1], inc[k], azi[k]) < _STRAIGHT:
            inc[k], azi[k] = inc[k - 1], azi[k - 1]
    return inc, azi

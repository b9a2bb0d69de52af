# SPDX-License-Identifier: Apache-2.0
"""
Clearance between two wells by the separation rule of the ISCWSA.

Separation factor (S. J. Sawaryn and others, "Well-Collision-Avoidance Separation Rule", SPE Drilling & Completion 34,
2019, SPE 187073): the distance between the centres less both radii and a surface margin, over k times the
pedal-curve radius of both wells' covariances, with the uncertainty of the projection ahead. The geometry is that of
`welleng`, which reproduces the ISCWSA's standard set of well paths. The errors of two wells count as independent.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import warnings
from collections.abc import Sequence

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_surface.uncertainty.uncertain_well import UncertainWell

# Spacing of the points at which two wells are compared; between them the library looks for the least factor, m.
_STEP = 30.0
# Nearer than this two wells at the same measured depth are one hole, m.
_SAME_HOLE = 0.05


class Level(enum.IntEnum):
    """What a separation factor asks for."""

    CLEAR = 0
    WARNING = 1
    STOP = 2


@dataclasses.dataclass(frozen=True)
class ClearanceRule:
    """The separation rule and its levels; the defaults are the paper's for wells where a collision endangers people."""

    k: float = setting(
        3.5, "Factor on the combined 1 sigma of both wells; a larger one keeps wells further apart", low=1.0, high=10.0
    )
    surface_margin_m: float = setting(
        0.3, "Distance that is kept even where both wells are known exactly", unit="m", low=0.0, high=10.0
    )
    projection_sigma_m: float = setting(
        0.5, "1 sigma of the hole ahead of the last survey until the next one", unit="m", low=0.0, high=10.0
    )
    warning_factor: float = setting(
        1.25, "Separation factor below which a warning is raised; a larger one warns earlier", low=1.0, high=20.0
    )
    stop_factor: float = setting(
        1.0, "Separation factor below which drilling must stop; the rule allows no less than 1", low=1.0, high=20.0
    )

    def level(self, factor: float) -> Level:
        """Level of a separation factor."""
        if factor < self.stop_factor:
            return Level.STOP
        return Level.WARNING if factor < self.warning_factor else Level.CLEAR


@dataclasses.dataclass(frozen=True)
class Clearance:
    """
    Distance from a well to another, along the first.

    Attributes
    ----------
    name : str
        Of the other well.
    md : ndarray, shape (n,)
        Measured depth along the first well, m: its stations, points between, and where the factor is least.
    offset_md : ndarray, shape (n,)
        Of the nearest point of the other well, m.
    distance, allowed : ndarray, shape (n,)
        Between the centres, and the least the rule allows at factor 1, m.
    factor : ndarray, shape (n,)
        Separation factor; negative where the holes overlap.
    toolface : ndarray, shape (n,)
        Direction to the other well, across the first, from its high side clockwise looking down, rad.
    bearing : ndarray, shape (n,)
        The same direction from the north of the wells: toolface + azimuth, rad, as travelling cylinders are drawn.
    rule : ClearanceRule
    """

    name: str
    md: Array
    offset_md: Array
    distance: Array
    allowed: Array
    factor: Array
    toolface: Array
    bearing: Array
    rule: ClearanceRule

    @property
    def least(self) -> int:
        """Index of the smallest separation factor."""
        return int(np.argmin(self.factor))

    @property
    def level(self) -> Level:
        """Level of the smallest separation factor."""
        return self.rule.level(float(self.factor[self.least]))

    def between(self, start: float, end: float) -> Clearance | None:
        """Return the part of the first well between two measured depths, m; None where there is none."""
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
        """Where the other well is nearest by the rule, in a sentence."""
        k = self.least
        limit = {
            Level.STOP: f", below {self.rule.stop_factor:g}",
            Level.WARNING: f", below {self.rule.warning_factor:g}",
        }
        return (
            f"{self.name} is {self.distance[k]:.1f} m away at {self.md[k]:.0f} m: separation factor "
            f"{self.factor[k]:.2f}{limit.get(self.level, '')}; the rule allows no less than {self.allowed[k]:.1f} m"
        )


def clearance(
    reference: UncertainWell, offset: UncertainWell, rule: ClearanceRule, shared_to: float | None = None
) -> Clearance:
    """
    Clearance from one well to another, by the separation rule.

    Parameters
    ----------
    reference : UncertainWell
        The well that is drilled; the result is along it.
    offset : UncertainWell
        The other one, in the same axes and from the same origin.
    rule : ClearanceRule
    shared_to : float, optional
        Measured depth down to which both are the same hole, m: a sidetrack and its parent. Both are then compared
        below, from a point taken as known to both.

    Raises
    ------
    ValueError
        Axes of two norths, wells in the same place without shared_to, or what `UncertainWell.covariance` refuses.
    """
    if reference.north != offset.north:
        raise ValueError(
            f"{offset.name}: azimuths from {offset.north.name.lower()} north, those of the well from "
            f"{reference.north.name.lower()} north"
        )
    if shared_to is None:
        _check_apart(reference, offset)
    else:
        reference, offset = reference.below(shared_to), offset.below(shared_to)
    first, second = _library_survey(reference), _library_survey(offset)
    from welleng.clearance import IscwsaClearance

    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("ignore")
        found = IscwsaClearance(first, second, k=rule.k, sigma_pa=rule.projection_sigma_m, Sm=rule.surface_margin_m)
    toolface = np.asarray(found.toolface_bearing, dtype=float)
    return Clearance(
        offset.name,
        np.asarray(found.ref.md, dtype=float),
        np.asarray(found.off.md, dtype=float),
        np.asarray(found.distance_cc, dtype=float),
        np.asarray(found.masd, dtype=float),
        np.asarray(found.sf, dtype=float),
        toolface,
        (toolface + np.asarray(found.ref.azi_grid_rad, dtype=float)) % math.tau,
        rule,
    )


def nearest_first(found: Sequence[Clearance]) -> list[Clearance]:
    """Return clearances with the smallest separation factor first."""
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


def _library_survey(well: UncertainWell) -> object:
    """Well as the library has it, with points at most `_STEP` apart; covariances between stations are linear."""
    from welleng.survey import Survey, SurveyHeader

    covariance = well.covariance()
    md = np.unique(np.concatenate([well.md, np.arange(well.md[0], well.md[-1], _STEP)]))
    # Points closer than a centimetre to a station would only repeat it.
    md = md[np.concatenate([[True], np.diff(md) > 0.01])]
    inc, azi, positions = mc.interpolate(well.md, well.inclination, well.azimuth, well.positions, md)
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
        cov_nev=covariance[k] * (1.0 - part) + covariance[k + 1] * part,
        radius=well.radius,
        header=header,
        start_nev=positions[0],
        start_xyz=positions[0][[1, 0, 2]],
        error_model=None,
        deg=True,
    )

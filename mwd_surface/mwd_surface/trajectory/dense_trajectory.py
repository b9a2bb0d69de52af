# SPDX-License-Identifier: Apache-2.0
"""
High-density trajectory: the hole between survey stations, from continuous measurements or the slide sheet.

Minimum curvature spreads the dogleg of an interval evenly, but with a motor the hole bends only where it was slid. Over
many stands with the same pattern the computed vertical depth drifts away from the hole (E. Stockhausen, W. Lesso,
"Continuous direction and inclination measurements lead to an improvement in wellbore positioning", SPE/IADC 79917,
2003). Stations are not changed: the trajectory between two stations is anchored at both. Depths are in m along the
hole, angles in rad.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.frames import wrap_pi, wrap_tau
from mwd_surface.trajectory.slide_sheet import SLIDE, DrilledStretch
from mwd_surface.trajectory.well_path import Definitive

STATION, CONTINUOUS, SLIDES, ARC = "station", "continuous", "slide sheet", "arc"
# Longest gap in the continuous data of an interval, m; with a longer gap the data are not used for the interval.
_LONGEST_GAP = 10.0
# Continuous data within this distance from a station are used to anchor the trajectory at the station, m.
_AT_STATION = 3.0
# Length of hole over which samples are replaced by their median, m.
_BIN = 0.5
# Largest difference between continuous inclination and a station, rad; with a larger difference the data are from
# another hole, or have wrong depths.
_MOST_APART = math.radians(1.0)
# The continuous azimuth is used if both stations have at least this inclination, rad.
_LEAST_INCLINATION = math.radians(5.0)
# The slide sheet is used if it covers at least this share of the interval, and if at least this length was slid, m.
_KNOWN_SHARE, _LEAST_SLID = 0.9, 0.5


@dataclasses.dataclass(frozen=True)
class Continuous:
    """Continuous measurements: depth of the sensor, m, inclination and azimuth, rad (NaN if unknown), shape (n,)."""

    md: Array
    inclination: Array
    azimuth: Array


@dataclasses.dataclass(frozen=True)
class DenseTrajectory:
    """Trajectory with points between the stations."""

    #: `md`, `inclination`, `azimuth`: shape (n,); points of the trajectory, m and rad; azimuth from the north of the
    #: definitive path
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array  #: shape (n, 3); north, east, down, m
    differences: Array  #: shape (n, 3); position minus the position by minimum curvature between the stations, m
    source: tuple[str, ...]  #: basis of each point: STATION, or CONTINUOUS, SLIDES or ARC between stations
    remarks: tuple[str, ...] = ()  #: intervals whose continuous data were not used, with the reason

    @property
    def has_detail(self) -> bool:
        """Whether continuous data or slides shape at least one interval; if not, every interval is a circular arc."""
        return CONTINUOUS in self.source or SLIDES in self.source


def dense_trajectory(
    path: Definitive, continuous: Continuous | None = None, stretches: Sequence[DrilledStretch] = (), step: float = 1.0
) -> DenseTrajectory:
    """
    Return the trajectory through the stations of a path, by the best available description of the hole between them.

    Parameters
    ----------
    path : Definitive
        Path; a projection to the bit is ignored.
    continuous : Continuous, optional
        Continuous measurements, preferred to the slide sheet in an interval that they cover. The azimuth may be from
        any north, and the angles may have an error that is constant from one station to the next.
    stretches : sequence of DrilledStretch
        Slide sheet: the dogleg of an interval is placed where the string slid. An interval without slides, or with too
        little information, remains an arc.
    step : float
        Distance between the points, m.

    Raises
    ------
    ValueError
        The step is not above 0.
    """
    if not step > 0.0:
        raise ValueError(f"step: must be above 0 m, got {step:g}")
    stations = [k for k in range(len(path.md)) if path.kind[k] != "projected"]
    md, inclinations, azimuths = path.md[stations], path.inclination[stations], path.azimuth[stations]
    depth, inc, azi = [md[:1]], [inclinations[:1]], [wrap_tau(azimuths[:1])]
    source, remarks = [STATION], []
    for k in range(len(md) - 1):
        piece = _Interval(md[k : k + 2], inclinations[k : k + 2], azimuths[k : k + 2], step)
        try:
            found = piece.by_continuous(continuous) if continuous is not None else None
        except ValueError as error:
            remarks.append(str(error))
            found = None
        kind = CONTINUOUS
        if found is None:
            found, kind = piece.by_slides(stretches), SLIDES
        if found is None:
            found, kind = piece.arc(piece.share(piece.at)), ARC
        depth += [piece.at, md[k + 1 : k + 2]]
        inc += [found[0], inclinations[k + 1 : k + 2]]
        azi += [found[1], wrap_tau(azimuths[k + 1 : k + 2])]
        source += [kind] * len(piece.at) + [STATION]
    whole = np.concatenate(depth), np.concatenate(inc), np.concatenate(azi)
    positions = mc.path(*whole, start=path.positions[0])
    usual = mc.interpolate(md, inclinations, azimuths, path.positions[stations], whole[0])[2]
    return DenseTrajectory(*whole, positions, positions - usual, tuple(source), tuple(remarks))


class _Interval:
    """Interval between two stations, and the points in this interval."""

    def __init__(self, md: Array, inclination: Array, azimuth: Array, step: float) -> None:
        self._inclination, self._azimuth = inclination, azimuth
        self._low, self._high = float(md[0]), float(md[1])
        count = max(math.ceil((self._high - self._low) / step - 1e-9), 1)
        self.at = np.linspace(self._low, self._high, count + 1)[1:-1]

    def share(self, depth: Array) -> Array:
        """Return the share of the interval's length that lies above each depth."""
        return np.asarray((depth - self._low) / (self._high - self._low))

    def arc(self, share: Array) -> tuple[Array, Array]:
        """Return inclination and azimuth after a share of the arc between the stations, rad."""
        ends = np.array([0.0, 1.0])
        inclination, azimuth, _ = mc.interpolate(
            ends, self._inclination, self._azimuth, np.zeros((2, 3)), np.clip(share, 0.0, 1.0)
        )
        return inclination, azimuth

    def by_continuous(self, given: Continuous) -> tuple[Array, Array] | None:
        """
        Return inclination and azimuth at the points from continuous data, rad.

        Return None if the data do not cover the interval. Raise ValueError if they do not fit the stations.
        """
        inside = (given.md >= self._low) & (given.md <= self._high) & np.isfinite(given.inclination)
        md, arc = given.md[inside], self.arc(self.share(given.md[inside]))
        place = np.floor((md - self._low) / _BIN).astype(np.int64)
        centres, tilts = _binned(place, md, given.inclination[inside] - arc[0])
        if not self._covered(centres):
            return None
        ends = _at_ends(centres, tilts, self._low, self._high)
        if np.abs(ends).max() > _MOST_APART:
            raise ValueError(
                f"{self._low:.1f} to {self._high:.1f} m: continuous inclination is "
                f"{math.degrees(max(ends, key=abs)):+.1f} deg off the station: not used, check its depth"
            )
        inclination, azimuth = self.arc(self.share(self.at))
        inclination = inclination + self._anchored(centres, tilts)
        if self._inclination.min() >= _LEAST_INCLINATION:
            known = np.isfinite(given.azimuth[inside])
            turns = wrap_pi(given.azimuth[inside][known] - arc[1][known])
            # Work about the mean direction, so that a difference of half a turn between two norths does not wrap.
            middle = math.atan2(np.sin(turns).sum(), np.cos(turns).sum()) if known.any() else 0.0
            places, turned = _binned(place[known], md[known], wrap_pi(turns - middle))
            if self._covered(places):
                azimuth = wrap_tau(azimuth + self._anchored(places, turned))
        return np.clip(inclination, 0.0, math.pi), azimuth

    def by_slides(self, stretches: Sequence[DrilledStretch]) -> tuple[Array, Array] | None:
        """
        Return inclination and azimuth at the points, rad, with the dogleg where the string slid.

        Return None if the slide sheet covers too little of the interval, or if too little hole was slid. Otherwise the
        ends of the slides are added to the points.
        """
        overlaps = [
            (max(s.from_depth, self._low), min(s.to_depth, self._high), s.mode)
            for s in stretches
            if s.to_depth > self._low and s.from_depth < self._high
        ]
        known = sum(to - begin for begin, to, _ in overlaps)
        slid = [(begin, to) for begin, to, mode in overlaps if mode == SLIDE]
        total = sum(to - begin for begin, to in slid)
        if known < _KNOWN_SHARE * (self._high - self._low) or total < _LEAST_SLID:
            return None
        # Slides begin and end between the points, so add both ends of each slide as points.
        marks = [depth for pair in slid for depth in pair if self._low + 1e-6 < depth < self._high - 1e-6]
        self.at = np.unique(np.round(np.concatenate([self.at, marks]), 6))
        done = sum(np.clip(self.at - begin, 0.0, to - begin) for begin, to in slid)
        return self.arc(np.asarray(done) / total)

    def _covered(self, centres: Array) -> bool:
        """Return whether data at these depths, m, in order of depth, cover the interval and both of its ends."""
        return (
            len(centres) >= 3
            and float(np.diff(centres).max()) <= _LONGEST_GAP
            and max(float(centres[0]) - self._low, self._high - float(centres[-1])) <= _AT_STATION
        )

    def _anchored(self, centres: Array, apart: Array) -> Array:
        """
        Return the differences `apart` from the arc, interpolated to the points, with zero difference at both stations.

        A line between the differences at the two stations is subtracted. centres: depths of the differences, m.
        """
        first, last = _at_ends(centres, apart, self._low, self._high)
        at = np.concatenate([[self._low], centres, [self._high]])
        line = first + (last - first) * self.share(at)
        left = np.concatenate([[first], apart, [last]]) - line
        return np.asarray(np.interp(self.at, at, left))


def _binned(place: Indices, md: Array, values: Array) -> tuple[Array, Array]:
    """Return mean depth and median value of each bin with data, in order of depth."""
    order = np.argsort(place, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(place[order])) + 1) if len(order) else []
    centres = np.array([float(md[group].mean()) for group in groups])
    return centres, np.array([float(np.median(values[group])) for group in groups])


def _at_ends(centres: Array, values: Array, low: float, high: float) -> tuple[float, float]:
    """Return the values at the upper and lower station, extrapolated from the data within `_AT_STATION` of each."""
    return _at_end(centres, values, low), _at_end(centres[::-1], values[::-1], high)


def _at_end(centres: Array, values: Array, end: float) -> float:
    """
    Return the value at a depth `end`, m; centres, values: nearest to this depth first.

    With fewer than three values near this depth, it is their mean, otherwise a line through the values at that depth.
    """
    near = np.abs(centres - end) <= _AT_STATION
    if np.count_nonzero(near) < 3:
        return float(values[near].mean())
    # Extrapolate with a line instead of the mean, because the difference from the arc changes towards the station.
    return float(np.polynomial.Polynomial.fit(centres[near], values[near], 1)(end))

# SPDX-License-Identifier: Apache-2.0
"""
Path of a well by minimum curvature: stations, positions, curvature, vertical section, and projection to the bit.

Units are SI and rad; azimuths and map axes refer to the north that the path names.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.remark import Remark

TIE_ON, ASSUMED, SURVEY, PROJECTED = "tie-on", "assumed", "survey", "projected"  # kinds of stations


@dataclasses.dataclass(frozen=True)
class Definitive:
    """Path of one leg from the wellhead down, by minimum curvature."""

    leg: str
    north: North  #: reference of azimuth and positions
    section_azimuth: float  #: azimuth of the vertical section, rad
    #: `md`, `inclination`, `azimuth`: shape (n,), m and rad
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array  #: shape (n, 3), north, east, down, m
    #: `dogleg_severity`, `build_rate`, `turn_rate`: shape (n,), rad/m, of the interval above each station
    dogleg_severity: Array
    build_rate: Array
    turn_rate: Array
    vertical_section: Array  #: shape (n,), m
    #: `TIE_ON`, `ASSUMED` (assumed tie-on, because none was given; the hole between it and the next station is also
    #: assumed), `SURVEY` or `PROJECTED`
    kind: tuple[str, ...]
    sequence: tuple[int, ...]  #: number of the survey, 0 for other kinds
    #: assumptions, in addition to measurements, on which the coordinates of all stations are based
    assumptions: tuple[Remark, ...] = ()

    @property
    def assumed(self) -> bool:
        """Whether coordinates are based on an assumption, so that depths and positions may have errors of any size."""
        return bool(self.assumptions)

    @property
    def measured_depth(self) -> Array:
        """Measured depth, m, shape (n,); equal to `md`."""
        return self.md

    @property
    def position_north(self) -> Array:
        """Distance north of the wellhead, m, shape (n,)."""
        return self.positions[:, 0]

    @property
    def position_east(self) -> Array:
        """Distance east of the wellhead, m, shape (n,)."""
        return self.positions[:, 1]

    @property
    def vertical_depth(self) -> Array:
        """Vertical depth, m, shape (n,)."""
        return self.positions[:, 2]

    def at(self, md: float) -> tuple[float, float, Array]:
        """
        Return inclination and azimuth, rad, and position, shape (3,), m, at any measured depth of the path.

        Raises
        ------
        ValueError
            The depth is outside the path.
        """
        inc, azi, position = mc.interpolate(self.md, self.inclination, self.azimuth, self.positions, md)
        return float(inc), float(azi), position

    def through(
        self, stations: tuple[Array, Array, Array], positions: Array, kind: tuple[str, ...], sequence: tuple[int, ...]
    ) -> Definitive:
        """Return the path of the same leg through other stations; the arguments are those of `path_of`."""
        path = path_of(self.leg, self.north, self.section_azimuth, stations, positions, kind, sequence)
        return dataclasses.replace(path, assumptions=self.assumptions)


def projected(path: Definitive, bit_depth: float, how: str) -> Definitive:
    """
    Return the path with one more station at the bit, marked "projected".

    Parameters
    ----------
    path : Definitive
        Path with at least the tie-on.
    bit_depth : float
        Measured depth of the bit, m. If it is not below the last station, the path is returned unchanged.
    how : str
        "straight" keeps the last direction, "curve" keeps plane and curvature of the last interval.

    Raises
    ------
    ValueError
        bit_depth is not finite.
    """
    if not math.isfinite(bit_depth):
        raise ValueError(f"bit_depth: must be finite, got {bit_depth}")
    ahead = bit_depth - float(path.md[-1])
    if ahead <= 0.0:
        return path
    # If the last station is vertical, `checked_stations` gives it the azimuth of the hole above.
    inc, azi = (float(row[-1]) for row in mc.checked_stations(path.md, path.inclination, path.azimuth)[1:])
    bend = float(path.dogleg_severity[-1]) * ahead
    # A projected curve of more than a quarter turn would be meaningless: project straight instead.
    if how == "curve" and 1e-9 < bend < math.pi / 2:
        t_1, t_2 = mc.tangent(path.inclination[-2:], path.azimuth[-2:])
        full = float(path.dogleg_severity[-1]) * float(path.md[-1] - path.md[-2])
        # Direction towards which the arc turns at its end, in the plane of the two tangents.
        inward = (math.cos(full) * t_2 - t_1) / math.sin(full)
        t = math.cos(bend) * t_2 + math.sin(bend) * inward
        inc, azi = math.atan2(math.hypot(t[0], t[1]), t[2]), math.atan2(t[1], t[0]) % math.tau
    md, incs, azis = np.append(path.md, bit_depth), np.append(path.inclination, inc), np.append(path.azimuth, azi)
    bit = mc.path(md[-2:], incs[-2:], azis[-2:], path.positions[-1])[-1]
    kind, sequence = (*path.kind, PROJECTED), (*path.sequence, 0)
    return path.through((md, incs, azis), np.vstack([path.positions, bit]), kind, sequence)


def path_of(
    leg: str,
    north: North,
    section_azimuth: float,
    stations: tuple[Array, Array, Array],
    positions: Array,
    kind: tuple[str, ...],
    sequence: tuple[int, ...],
) -> Definitive:
    """
    Return the path through stations with known positions, with all derived values.

    stations: measured depth, m, inclination and azimuth, rad, shape (n,) each. The other arguments are fields of
    `Definitive`.
    """
    md, inclination, azimuth = stations
    return Definitive(
        leg=leg,
        north=north,
        section_azimuth=section_azimuth,
        md=md,
        inclination=inclination,
        azimuth=azimuth,
        positions=positions,
        dogleg_severity=mc.dogleg_severity(*stations, per=1.0),
        build_rate=mc.build_rate(*stations, per=1.0),
        turn_rate=mc.turn_rate(*stations, per=1.0),
        vertical_section=mc.vertical_section(positions, section_azimuth),
        kind=kind,
        sequence=sequence,
    )

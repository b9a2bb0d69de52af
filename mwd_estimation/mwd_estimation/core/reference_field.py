# SPDX-License-Identifier: Apache-2.0
"""
The reference a magnetic survey is judged and corrected by: local field, gravity, and the way to a named north.

It comes from a geomagnetic model (S0 section 4, "by table") or from a measurement made beforehand where nothing
disturbs the field (same section), or from a settings file. Every figure carries its own sigma, because an axial
correction is only as good as the field it uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_tau

NORTHS = ("magnetic", "true", "grid")

# Standard-resolution model, one station, all its parts added in squares: OWSG A001Mc rev 5.1, terms MFI, MDI, DEC, DBH.
SIGMA_TOTAL = 143e-9
SIGMA_DIP = math.radians(0.218)
SIGMA_DECLINATION = math.radians(0.373)
# Declination error of a crust or storm field is that field's east part over the horizontal field, rad T.
SIGMA_DECLINATION_FIELD = math.radians(5831e-9)
# Models know gravity to 3e-4 m/s^2; but what a tool called one g when it was calibrated may have been standard gravity,
# or that of the workshop.
SIGMA_GRAVITY = 6e-3
# External field from which a survey is marked as taken in a magnetic storm, T: a K index of 5 at mid latitudes is 70 to
# 120 nT in three hours (Bartels).
STORM = 1e-7


@dataclass(frozen=True)
class ExternalField:
    """External field contained in a reference: north, east, down (geographic), T."""

    field_n: tuple[float, float, float]

    @property
    def strength(self) -> float:
        """Strength, T."""
        return math.hypot(*self.field_n)

    @property
    def is_storm(self) -> bool:
        """Whether it was measured in a magnetic storm."""
        return self.strength > STORM


@dataclass(frozen=True)
class Slip:
    """Field that was meant where the place or the field was given with a usual slip, such as a wrong sign."""

    words: str  #: what was meant, and what was given
    total: float  #: T
    dip: float  #: rad


@dataclass(frozen=True)
class Reference:
    """Local field, gravity and north; what is not known is None."""

    #: `total`, `dip`: field strength, T, and its angle below the horizontal, rad. Given together or not at all.
    total: float | None = None
    dip: float | None = None
    #: `declination`, `convergence`: true north to magnetic north, rad, east positive; true north to grid north, rad,
    #: east positive (S0 note: true = magnetic + declination; grid = true - convergence).
    declination: float | None = None
    convergence: float | None = None
    gravity: float | None = None  #: local gravity, m/s^2
    source: str = "none"  #: where it comes from, in words
    #: `sigma_total`, `sigma_dip`, `sigma_declination`, `sigma_gravity`: 1 sigma, T, rad, rad, m/s^2.
    #: `sigma_declination` leaves out the part that grows with a weak horizontal field.
    sigma_total: float = SIGMA_TOTAL
    sigma_dip: float = SIGMA_DIP
    sigma_declination: float = SIGMA_DECLINATION
    #: That part, rad T: divided by the horizontal field it adds in squares to `sigma_declination`.
    sigma_declination_field: float = SIGMA_DECLINATION_FIELD
    sigma_gravity: float = SIGMA_GRAVITY
    #: What strength, dip and declination contain of an observatory's disturbance; None where none was added.
    external: ExternalField | None = None
    #: Fields that readings may fit instead where the reference was given with a slip.
    slips: tuple[Slip, ...] = field(default=(), compare=False, repr=False)
    #: IAGA code of the observatory whose record was asked, whether or not it covers the time; empty: none
    observatory: str = ""

    def __post_init__(self) -> None:
        """Refuse figures that no place of the Earth has."""
        for name in ("total", "dip", "declination", "convergence", "gravity"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"reference {name}: must be a finite number, got {value!r}")
        for name in ("sigma_total", "sigma_dip", "sigma_declination", "sigma_declination_field", "sigma_gravity"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"reference {name}: must be zero or more, got {getattr(self, name)!r}")
        if (self.total is None) != (self.dip is None):
            known, missing = ("total", "dip") if self.dip is None else ("dip", "total")
            raise ValueError(f"reference {known} is given without {missing}: a field needs both")
        if self.total is not None and not 5e-6 <= self.total <= 2e-4:
            raise ValueError(
                f"reference total: {self.total:g} T is no Earth field (2e-5 to 7e-5 T){_scaled(self.total)}"
            )
        for name in ("dip", "declination", "convergence"):
            value, bound = getattr(self, name), 0.5 * math.pi if name == "dip" else math.pi
            if value is not None and abs(value) > bound:
                raise ValueError(
                    f"reference {name}: {value:g} rad is beyond {bound:.4g} rad; {value:g} deg would be "
                    f"{math.radians(value):.6g} rad"
                )
        if self.gravity is not None and not 9.7 <= self.gravity <= 9.9:
            raise ValueError(f"reference gravity: {self.gravity:g} m/s^2 is not the Earth's (9.76 to 9.84 m/s^2)")

    @property
    def has_field(self) -> bool:
        """Whether strength and dip are known, without which no correction and no field check is possible."""
        return self.total is not None

    @property
    def horizontal(self) -> float:
        """Horizontal field, T. ValueError where the field is unknown."""
        total, dip = self._field()
        return total * math.cos(dip)

    @property
    def vertical(self) -> float:
        """Downward field, T. ValueError where the field is unknown."""
        total, dip = self._field()
        return total * math.sin(dip)

    @property
    def covariance(self) -> Array:
        """Covariance of (horizontal, vertical), shape (2, 2), T^2, from the sigmas of strength and dip."""
        total, dip = self._field()
        jacobian = np.array([[math.cos(dip), -total * math.sin(dip)], [math.sin(dip), total * math.cos(dip)]])
        return np.asarray(jacobian @ np.diag([self.sigma_total**2, self.sigma_dip**2]) @ jacobian.T)

    def declination_variance(self, horizontal: float) -> float:
        """Variance of the declination, rad^2, where the horizontal field is that many T."""
        return self.sigma_declination**2 + (self.sigma_declination_field / max(horizontal, 1e-9)) ** 2

    def _field(self) -> tuple[float, float]:
        if self.total is None or self.dip is None:
            raise ValueError("the reference has no field: give its strength and dip, or a place and date for a model")
        return self.total, self.dip


def best_north(reference: Reference | None) -> str:
    """Name the most useful north the reference allows: grid where it has a grid, else true, else magnetic."""
    # A convergence of 0 is that of no grid: the two norths are one, and its name is true.
    for north in ("grid", "true") if reference is not None and reference.convergence else ("true",):
        if north_correction(reference, north) is not None:
            return north
    return "magnetic"


def north_correction(reference: Reference | None, north: str) -> float | None:
    """
    Return what refers a magnetic azimuth to the named north when added, rad; None where the reference does not know.

    Raises
    ------
    ValueError
        A north other than magnetic, true, grid.
    """
    if north not in NORTHS:
        raise ValueError(f"north: {north!r} is not one of {', '.join(NORTHS)}")
    if north == "magnetic":
        return 0.0
    if reference is None or reference.declination is None:
        return None
    if north == "true":
        return reference.declination
    if reference.convergence is None:
        return None
    return reference.declination - reference.convergence


def to_north(azimuth_magnetic: float, correction: float) -> float:
    """Azimuth of a named north, rad in [0, 2 pi), from the magnetic one and its correction, rad."""
    return float(wrap_tau(azimuth_magnetic + correction))


def _scaled(total: float) -> str:
    for factor, unit in ((1e-9, "nT"), (1e-6, "uT"), (1e-4, "G")):
        if 2e-5 <= total * factor <= 7e-5:
            return f"; {total:g} {unit} would be {total * factor:g} T"
    return ""

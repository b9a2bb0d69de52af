# SPDX-License-Identifier: Apache-2.0
"""
Reference for checking and correcting a magnetic survey: local field, gravity, declination and convergence.

The reference comes from a geomagnetic model (S0 section 4, "by table"), from an earlier measurement at a place without
disturbances (same section), or from a settings file. Each value has its own sigma, because an axial correction is only
as good as the reference field that it uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_tau

NORTHS = ("magnetic", "true", "grid")

# 1 sigma of a standard-resolution model at one station, T, rad, rad: root sums of squares of the terms MFI, MDI, DEC
# and DBH of OWSG A001Mc rev 5.1.
SIGMA_TOTAL = 143e-9
SIGMA_DIP = math.radians(0.218)
SIGMA_DECLINATION = math.radians(0.373)
# 1 sigma of the part of the declination that is inversely proportional to the horizontal field (DBH), rad T: a crustal
# or storm field rotates magnetic north by its east component divided by the horizontal field.
SIGMA_DECLINATION_FIELD = math.radians(5831e-9)
# 1 sigma of the reference gravity, m/s^2. Models are accurate to 3e-4 m/s^2. The sigma is larger because a calibration
# may have taken either standard gravity or the gravity of the workshop as one g.
SIGMA_GRAVITY = 6e-3
# 1 sigma of the difference between the gravity at the tool and the normal gravity of its place (`earth.gravity`),
# m/s^2: anomalies of 3e-4 (35 mGal rms on land) and a depth of 2.3 km, which adds 8.5e-7 a metre
# (`earth.gravity_gradient`).
LOCAL_GRAVITY = 2e-3
# Strength of the external field above which a survey counts as taken in a magnetic storm, T. A K index of 5 at mid
# latitudes means a range of 70 to 120 nT within three hours (Bartels).
STORM = 1e-7


@dataclass(frozen=True)
class ExternalField:
    """Part of a reference field from sources outside the Earth: components north (true), east and down, T."""

    field_n: tuple[float, float, float]

    @property
    def strength(self) -> float:
        """Strength of the external field, T."""
        return math.hypot(*self.field_n)

    @property
    def is_storm(self) -> bool:
        """Whether the strength is above `STORM`, which a magnetic storm causes."""
        return self.strength > STORM


@dataclass(frozen=True)
class Slip:
    """Field that the user may have meant, if place or field were entered with a mistake such as a wrong sign."""

    words: str  #: description of the mistake: the entry, and the probably intended one
    total: float  #: field strength, T
    dip: float  #: angle of the field below the horizontal, rad


@dataclass(frozen=True)
class Reference:
    """Local field, gravity and directions of north; unknown values are None."""

    #: `total`, `dip`: field strength, T, and its angle below the horizontal, rad; either both are given or neither.
    total: float | None = None
    dip: float | None = None
    #: `declination`, `convergence`: angles from true north to magnetic north and from true north to grid north, rad,
    #: east positive (S0 note: true = magnetic + declination; grid = true - convergence).
    declination: float | None = None
    convergence: float | None = None
    gravity: float | None = None  #: local gravity, m/s^2
    source: str = "none"  #: description of where the values come from
    #: `sigma_total`, `sigma_dip`, `sigma_declination`, `sigma_gravity`: 1 sigma, T, rad, rad, m/s^2.
    #: `sigma_declination` does not contain the part that grows as the horizontal field becomes weak.
    sigma_total: float = SIGMA_TOTAL
    sigma_dip: float = SIGMA_DIP
    sigma_declination: float = SIGMA_DECLINATION
    #: 1 sigma of the declination times the horizontal field, rad T; divided by the horizontal field, it is added in
    #: squares to `sigma_declination`.
    sigma_declination_field: float = SIGMA_DECLINATION_FIELD
    sigma_gravity: float = SIGMA_GRAVITY
    #: External field recorded by an observatory, as contained in strength, dip and declination; None if none was added.
    external: ExternalField | None = None
    #: Other fields that the readings may match, in case the reference was entered with a mistake.
    slips: tuple[Slip, ...] = field(default=(), compare=False, repr=False)
    #: IAGA code of the observatory whose record was consulted, even if it does not cover the time; empty: none.
    observatory: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError for an impossible value, a negative sigma, or if only one of strength and dip is given."""
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
                f"reference total: {self.total:g} T is not a field of the Earth (2e-5 to 7e-5 T){_scaled(self.total)}"
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
        """Whether strength and dip are known; without them no correction and no field check is possible."""
        return self.total is not None

    @property
    def horizontal(self) -> float:
        """Horizontal field, T. Raises ValueError if the field is unknown."""
        total, dip = self._field()
        return total * math.cos(dip)

    @property
    def vertical(self) -> float:
        """Downward field, T. Raises ValueError if the field is unknown."""
        total, dip = self._field()
        return total * math.sin(dip)

    @property
    def covariance(self) -> Array:
        """
        Covariance of (horizontal, vertical), shape (2, 2), T^2, from the sigmas of strength and dip.

        Raises ValueError if the field is unknown.
        """
        total, dip = self._field()
        jacobian = np.array([[math.cos(dip), -total * math.sin(dip)], [math.sin(dip), total * math.cos(dip)]])
        return np.asarray(jacobian @ np.diag([self.sigma_total**2, self.sigma_dip**2]) @ jacobian.T)

    def declination_variance(self, horizontal: float) -> float:
        """Return the variance of the declination, rad^2; horizontal: horizontal field, T."""
        return self.sigma_declination**2 + (self.sigma_declination_field / max(horizontal, 1e-9)) ** 2

    def _field(self) -> tuple[float, float]:
        if self.total is None or self.dip is None:
            raise ValueError("the reference has no field: give its strength and dip, or a place and date for a model")
        return self.total, self.dip


def best_north(reference: Reference | None) -> str:
    """
    Return the most useful north that the reference allows: "grid", "true" or "magnetic", in this order.

    True north needs the declination, grid north also a convergence other than 0.
    """
    # With a convergence of 0, grid north equals true north and is called "true".
    for north in ("grid", "true") if reference is not None and reference.convergence else ("true",):
        if north_correction(reference, north) is not None:
            return north
    return "magnetic"


def north_correction(reference: Reference | None, north: str) -> float | None:
    """
    Return the angle from the named north to magnetic north, rad, to add to a magnetic azimuth; None if unknown.

    Raises
    ------
    ValueError
        If `north` is not magnetic, true or grid.
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
    """Return the azimuth from a named north, rad in [0, 2 pi), given the magnetic azimuth and the correction, rad."""
    return float(wrap_tau(azimuth_magnetic + correction))


def _scaled(total: float) -> str:
    for factor, unit in ((1e-9, "nT"), (1e-6, "uT"), (1e-4, "G")):
        if 2e-5 <= total * factor <= 7e-5:
            return f"; {total:g} {unit} would be {total * factor:g} T"
    return ""

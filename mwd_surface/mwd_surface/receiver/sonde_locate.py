# SPDX-License-Identifier: Apache-2.0
"""
Locate the coil of a sonde from the strength of its field at points on the surface.

The coil is a dipole along the tool axis. Position, direction and moment are fitted to the readings by least squares;
pitch and moment are known from the words of the sonde and from a calibration, each with its sigma. A receiver cannot
measure the sign of an alternating field, only the relative signs of its components. The sign of each reading is free.
Conduction of the ground is neglected: see `docs/methods/coil_link.md` for the distance up to which that holds.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.dipole import dipole_field
from mwd_sensors.core.frames import wrap_pi

_UNKNOWNS = 6  # north, east, down, azimuth, pitch, logarithm of the moment
# Starts of the fit: depths as shares of the extent of the readings, and directions around the compass.
_DEPTHS, _DIRECTIONS = (0.3, 1.0, 3.0), 8
# Largest difference between two solutions that count as the same, m and rad.
_SAME_M, _SAME_RAD = 0.05, 0.02
# Another solution is named if chi-square does not exclude it with a probability of 99 % (one degree of freedom).
_OTHER_CHI2 = float(scipy.stats.chi2.ppf(0.99, 1))
# Readings do not fit one dipole if chance gives a larger chi-square with less than this probability.
_UNLIKELY = 1e-3
# Sigma of the position as a share of the depth, and of the azimuth in rad, above which propagation is not linear.
_LOOSE = 0.3
# A smaller singular value of the fit, relative to the largest, comes from rounding: the readings do not determine this
# combination of the unknowns.
_LEAST_WEIGHT = 1e-6


class SurfaceReadings(NamedTuple):
    """Readings of a receiver on the surface."""

    point: Array  #: shape (n, 3); position of the receiver: north, east, down, m
    #: Shape (n, 3); amplitude of the field in the same axes, T; the sign of a whole row has no meaning. NaN if only the
    #: strength is known.
    field: Array
    strength: Array  #: shape (n,); amplitude of the total field, T


class SondeFacts(NamedTuple):
    """Facts about the sonde, each with 1 sigma."""

    #: `moment`, `moment_share`: moment of the coil, A m^2, and 1 sigma as a share of the moment.
    moment: float
    moment_share: float = 0.02
    #: `pitch`, `pitch_sigma`: angle of the tool axis above the horizontal, rad, as the sonde sends it; NaN if unknown.
    pitch: float = math.nan
    pitch_sigma: float = math.radians(0.3)
    #: `azimuth`, `azimuth_sigma`: direction of the bore as planned or measured, rad; NaN if unknown.
    azimuth: float = math.nan
    azimuth_sigma: float = math.radians(30.0)


class ReadingErrors(NamedTuple):
    """Errors of a reading, 1 sigma of a component: noise, T, and alignment and gain as a share of the strength."""

    noise_t: float = 1e-11
    share: float = 0.02


@dataclasses.dataclass(frozen=True)
class SondeFix:
    """Located sonde."""

    position: Array  #: shape (3,); north, east, down, m
    #: `azimuth`, `pitch`, `moment`: direction of the tool axis, rad, the pitch positive above the horizontal; moment of
    #: the coil, A m^2.
    azimuth: float
    pitch: float
    moment: float
    #: Shape (6, 6); covariance of north, east, down, azimuth, pitch and the logarithm of the moment.
    covariance: Array
    #: `chi2`, `freedom`: sum of the squared errors over their sigmas, and its degrees of freedom.
    chi2: float
    freedom: int
    others: tuple[SondeFix, ...] = ()  #: other solutions that the readings do not exclude, best first

    @property
    def sigma(self) -> Array:
        """1 sigma of north, east, down (m), azimuth, pitch (rad) and the logarithm of the moment, shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to doubt the solution or its sigmas, as sentences; empty without a reason."""
        found = []
        if self.freedom > 0 and scipy.stats.chi2.sf(self.chi2, self.freedom) < _UNLIKELY:
            found.append(
                f"the readings do not fit one dipole (chi-square {self.chi2:.0f} for {self.freedom} degrees of"
                " freedom): steel or another source is near, or a point is wrong; do not trust the sigmas"
            )
        if self.sigma[:3].max() > _LOOSE * self._deepness or self.sigma[3] > _LOOSE:
            found.append("the readings hardly determine the sonde: measure at more points, also beside the bore")
        if self.others:
            found.append(
                f"other solutions fit as well ({len(self.others)}): give the azimuth of the bore, or more points"
            )
        return tuple(found)

    @property
    def _deepness(self) -> float:
        return max(abs(float(self.position[2])), 0.1)


def locate(readings: SurfaceReadings, known: SondeFacts, errors: ReadingErrors = ReadingErrors()) -> SondeFix:  # noqa: B008
    """
    Return the place, direction and moment of a sonde from readings of its field at the surface.

    The sonde is assumed to be below all points of the receiver.

    Raises
    ------
    ValueError
        There are fewer numbers than unknowns, or a number is not usable.
    """
    model = _Model(readings, known, errors)
    fits = [model.fit(start) for start in model.starts()]
    fits.sort(key=lambda fit: fit.chi2)
    best = fits[0]
    apart: list[SondeFix] = [best]
    for fit in fits[1:]:
        if fit.chi2 - best.chi2 < _OTHER_CHI2 and not any(_same(fit, one) for one in apart):
            apart.append(fit)
    return dataclasses.replace(best, others=tuple(apart[1:]))


def locate_points(depth_m: float, pitch: float) -> tuple[float, float]:
    """
    Return the two places on a level surface where the field is vertical, as distances from the point above the sonde.

    Parameters
    ----------
    depth_m : float
        Depth below the surface.
    pitch : float
        Angle of the tool axis above the horizontal, rad, below pi/2.

    Returns
    -------
    (float, float)
        Distances along the tool's azimuth, m: behind the point (negative), and ahead of it.
    """
    c, s = math.cos(pitch), math.sin(pitch)
    root = math.sqrt(9.0 * s * s + 8.0 * c * c)
    return depth_m * (-3.0 * s - root) / (4.0 * c), depth_m * (-3.0 * s + root) / (4.0 * c)


def depth_overhead(strength: float, moment: float, pitch: float) -> float:
    """Return the depth of a sonde, m, from the field strength directly above, T, its moment, A m^2, and pitch, rad."""
    unit = float(np.linalg.norm(dipole_field((0.0, 0.0, 1.0), (math.cos(pitch), 0.0, math.sin(pitch))).real))
    return float((moment * unit / strength) ** (1.0 / 3.0))


def moment_of(strength: float, distance_m: float) -> float:
    """Return the moment of a coil, A m^2, from the field strength, T, at a distance, m, perpendicular to its axis."""
    unit = float(np.linalg.norm(dipole_field((0.0, distance_m, 0.0), (1.0, 0.0, 0.0)).real))
    return strength / unit


class _Model:
    """Readings, prior knowledge and sigmas as residuals of one vector of unknowns."""

    def __init__(self, readings: SurfaceReadings, known: SondeFacts, errors: ReadingErrors) -> None:
        self._point, self._known = readings.point, known
        self._vector = np.isfinite(readings.field).all(axis=1)
        self._field, self._strength = readings.field[self._vector], readings.strength[~self._vector]
        size = np.where(self._vector, np.linalg.norm(readings.field, axis=1), readings.strength)
        if not (np.isfinite(size).all() and np.isfinite(readings.point).all() and (size > 0.0).all()):
            raise ValueError("readings: each point needs a position and a field above 0")
        sigma = np.hypot(errors.noise_t, errors.share * size)
        if not (np.isfinite(sigma).all() and (sigma > 0.0).all() and 0.0 < known.moment < math.inf):
            raise ValueError("errors of the readings and moment of the coil: finite numbers above 0 are needed")
        self._sigma, self._size = sigma, size
        priors = 1 + math.isfinite(known.pitch) + math.isfinite(known.azimuth)
        self.freedom = 3 * len(self._field) + len(self._strength) + priors - _UNKNOWNS
        if self.freedom < 0:
            raise ValueError(
                f"readings: {self.freedom + _UNKNOWNS} numbers do not determine {_UNKNOWNS} unknowns; "
                "measure at more points"
            )

    def starts(self) -> list[Array]:
        """
        Return first guesses of the unknowns, shape (6,) each: below the strongest points, at several depths.

        The guesses have azimuths all around, or near the known azimuth.
        """
        weight = self._size / self._size.sum()
        centre = weight @ self._point[:, :2]
        # At a given distance the strength is largest on the axis and smallest beside the coil; use the mean of both.
        usual = (1.5 * 1e-7 * self._known.moment / self._size.max()) ** (1.0 / 3.0)
        azimuths = math.tau * np.arange(_DIRECTIONS) / _DIRECTIONS
        if math.isfinite(self._known.azimuth):
            azimuths = self._known.azimuth + np.array([0.0, math.pi / 4.0, -math.pi / 4.0])
        pitch = self._known.pitch if math.isfinite(self._known.pitch) else 0.0
        top = float(self._point[:, 2].max())
        return [
            np.array([*centre, top + share * usual, azimuth, pitch, math.log(self._known.moment)])
            for share in _DEPTHS
            for azimuth in azimuths
        ]

    def fit(self, start: Array) -> SondeFix:
        """Return the least-squares solution from a first guess of the unknowns, shape (6,)."""
        low = np.array([-np.inf, -np.inf, self._point[:, 2].max() + 0.01, -np.inf, -np.inf, -np.inf])
        scale = np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.1])
        found = scipy.optimize.least_squares(
            self.residuals, np.maximum(start, low + 0.01), bounds=(low, np.inf), x_scale=scale, max_nfev=200
        )
        # A combination of unknowns that no reading determines gets a very large sigma; a pseudo-inverse would give 0.
        _, weight, directions = np.linalg.svd(found.jac * scale, full_matrices=False)
        spread = scale[:, None] * directions.T / np.maximum(weight, _LEAST_WEIGHT * weight.max())
        x = found.x
        # A tool axis tilted past the vertical points to the opposite azimuth.
        axis = _axis(x)
        return SondeFix(
            position=x[:3],
            azimuth=math.atan2(axis[1], axis[0]) % math.tau,
            pitch=math.asin(float(np.clip(-axis[2], -1.0, 1.0))),
            moment=math.exp(x[5]),
            covariance=np.asarray(spread @ spread.T),
            chi2=2.0 * float(found.cost),
            freedom=self.freedom,
        )

    def residuals(self, x: Array) -> Array:
        """Return the errors of readings and prior knowledge over their sigmas, shape (m,), for unknowns x."""
        field = dipole_field(self._point - x[:3], math.exp(x[5]) * _axis(x)).real
        vectors = field[self._vector]
        sign = np.where(np.sum(vectors * self._field, axis=1) < 0.0, -1.0, 1.0)
        known = self._known
        priors = [(x[5] - math.log(known.moment)) / known.moment_share]
        if math.isfinite(known.pitch):
            priors.append((x[4] - known.pitch) / known.pitch_sigma)
        if math.isfinite(known.azimuth):
            priors.append(float(wrap_pi(x[3] - known.azimuth)) / known.azimuth_sigma)
        return np.concatenate(
            [
                ((vectors * sign[:, None] - self._field) / self._sigma[self._vector, None]).ravel(),
                (np.linalg.norm(field[~self._vector], axis=1) - self._strength) / self._sigma[~self._vector],
                priors,
            ]
        )


def _axis(x: NDArray[np.float64]) -> Array:
    """Return the direction of the tool axis: north, east, down."""
    level = math.cos(x[4])
    return np.array([level * math.cos(x[3]), level * math.sin(x[3]), -math.sin(x[4])])


def _same(one: SondeFix, other: SondeFix) -> bool:
    near = float(np.linalg.norm(one.position - other.position)) < _SAME_M
    turned = max(abs(float(wrap_pi(one.azimuth - other.azimuth))), abs(one.pitch - other.pitch))
    return near and turned < _SAME_RAD

# SPDX-License-Identifier: Apache-2.0
"""
Single-station correction of the magnetic azimuth for axial drill-string interference.

The source is S0, with symbols as in `core.magnetic_geometry`. The field of a station is resolved in three directions
that gravity alone defines: along the *axis*, towards the *high* side, and towards the *right* side (axis x high). With
horizontal field H and vertical field V:

    axis  =  H sin(I) cos(A) + V cos(I) + E      S0 (13), (16)
    high  =  H cos(I) cos(A) - V sin(I)          S0 (19), sign of `high` reversed
    right = -H sin(A)                            S0 (20)

E is the axial interference. The correction estimates azimuth A and E together from the three components by maximum
likelihood. Where S0 divides by sin(theta) = -cos(I), the correction uses a weight that goes to zero, so that sigma
grows and not the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau

_GRID = 360  # number of azimuths of the grid over a full circle
# If 1 sigma of the posterior is larger than this, rad, the posterior is evaluated on the grid; otherwise by the
# curvature at the peak.
_WIDE = np.radians(1.5)
# Prior of the interference: Student's t with seven degrees of freedom, plus a tail with this weight, for strings with
# extreme magnetisation.
_FREEDOM, _TAIL = 7.0, 0.005
# Smallest probability of a second azimuth that is not ignored: _MIRROR, or _MIRROR_LOUD if the first azimuth needs more
# than the plausible interference. If the first azimuth needs more than _BEYOND times the plausible interference, both
# azimuths get the same probability, because the prior does not separate them.
_MIRROR, _MIRROR_LOUD, _BEYOND = 3e-3, 3e-4, 2.0


def hole_components(f_t: ArrayLike, b_t: ArrayLike) -> Array:
    """
    Return the field along the axis, towards the high side and towards the right side, T, shape (..., 3).

    f_t and b_t, shape (..., 3), are in tool axes. The result is NaN in an exactly vertical hole.
    """
    f_t, b_t = np.broadcast_arrays(np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float))
    across = np.hypot(f_t[..., 1], f_t[..., 2])
    across = np.where(across > 0.0, across, np.nan)
    s, c = f_t[..., 1] / across, f_t[..., 2] / across
    return np.stack([b_t[..., 0], b_t[..., 1] * s + b_t[..., 2] * c, b_t[..., 2] * s - b_t[..., 1] * c], axis=-1)


@dataclass(frozen=True)
class AxialCorrection:
    """Azimuth corrected for axial interference, and the interference; arrays have the leading shape of the input."""

    #: `azimuth`, `sigma_azimuth`: magnetic azimuth, rad in [0, 2 pi), and 1 sigma, rad. In singular geometry they are
    #: mean and sigma of the whole posterior, including the second solution, up to pi / sqrt(3) for an unknown angle.
    azimuth: Array
    sigma_azimuth: Array
    #: `interference`, `sigma_interference`: axial field that is not the Earth's, T, positive down-hole, and 1 sigma.
    interference: Array
    sigma_interference: Array
    #: Misfit of the field against the reference, one degree of freedom. A large value means that the disturbance is not
    #: axial or that the reference is not for this place.
    chi_square: Array
    #: bool; whether a second azimuth explains the readings nearly as well (a horizontal hole without the axial
    #: magnetometer).
    mirror: np.ndarray
    both: Array  #: shape (..., 2); most probable and second azimuth, rad; NaN if there is no second azimuth


def axial_correction(
    f_t: ArrayLike,
    b_t: ArrayLike,
    horizontal: ArrayLike,
    vertical: ArrayLike,
    sensor_covariance: ArrayLike,
    reference_covariance: ArrayLike,
    plausible: float = math.inf,
) -> AxialCorrection:
    """
    Estimate azimuth and axial interference by maximum likelihood.

    The equations are S0 (12) to (21), each weighted by its accuracy. The size of the interference is free, so the axial
    magnetometer determines the interference and not the azimuth (short-collar method).

    Parameters
    ----------
    f_t, b_t : array_like, shape (..., 3)
        Specific force, m/s^2, and field, T, in tool axes.
    horizontal, vertical : array_like, shape (...) or ()
        Reference field, horizontal and vertical (down), T.
    sensor_covariance : array_like, shape (..., 6, 6) or (6, 6)
        Covariance of (f_t, b_t), (m/s^2)^2 and T^2: noise of the averages and remaining calibration errors.
    reference_covariance : array_like, shape (..., 2, 2) or (2, 2)
        Covariance of (horizontal, vertical), T^2.
    plausible : float
        Plausible interference, 1 sigma, T; larger interference has a small probability. The value only selects between
        azimuths that fit equally well (two in a horizontal hole, a range of azimuths in a horizontal east-west hole)
        and does not change an azimuth that the readings determine.

    Returns
    -------
    AxialCorrection
        Corrected azimuth and interference; NaN where the hole is exactly vertical.

    Raises
    ------
    ValueError
        If `plausible` is not positive, or the shapes do not match.
    """
    if not plausible > 0.0:
        raise ValueError(f"plausible: must be positive, got {plausible!r} T")
    f_t, b_t = np.broadcast_arrays(np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float))
    lead = f_t.shape[:-1]
    n = math.prod(lead)
    f, b = f_t.reshape(n, 3), b_t.reshape(n, 3)
    h, v = (np.broadcast_to(np.asarray(one, dtype=float), lead).reshape(n) for one in (horizontal, vertical))
    cov_s = np.broadcast_to(np.asarray(sensor_covariance, dtype=float), (*lead, 6, 6)).reshape(n, 6, 6)
    cov_r = np.broadcast_to(np.asarray(reference_covariance, dtype=float), (*lead, 2, 2)).reshape(n, 2, 2)
    # An exactly vertical hole has no azimuth: use a dummy attitude and replace the result by NaN.
    vertical_hole = ~(np.hypot(f[:, 1], f[:, 2]) > 1e-12 * np.linalg.norm(f, axis=1))
    f = np.where(vertical_hole[:, None], np.array([-1.0, 0.0, 1.0]), f)
    stations = _FitStations(f, b, h, v, cov_s, cov_r, plausible)
    return _corrected(stations, vertical_hole, plausible, lead)


def _corrected(
    stations: _FitStations, vertical: np.ndarray, plausible: float, lead: tuple[int, ...]
) -> AxialCorrection:
    """Return the correction of n stations; vertical, (n,): mask of vertical holes; lead: leading shape of results."""
    peaks = _peaks(stations)
    best = _best(stations, peaks)
    fit = stations.fit(best.azimuth)
    share = _mirror_share(stations, peaks, plausible)
    mirror = (share > 0.0) & ~vertical
    sigma = np.where(best.wide, best.spread, fit.variance_azimuth + share * peaks.apart**2)
    sigma = np.minimum(np.sqrt(sigma), np.pi / np.sqrt(3.0))
    # The interference depends on the azimuth through the field along the axis.
    slope = stations.h * stations.sin * np.sin(best.azimuth)
    variance_e = fit.variance_interference + slope**2 * (sigma**2 - fit.variance_azimuth)
    sigma_e = np.sqrt(np.maximum(variance_e, fit.variance_along))

    def shaped(values: Array) -> Array:
        return np.where(vertical, np.nan, values).reshape(lead)

    both = np.where(mirror[:, None], wrap_tau(np.stack([peaks.azimuth, peaks.other], axis=1)), np.nan)
    return AxialCorrection(
        azimuth=shaped(wrap_tau(best.azimuth)),
        sigma_azimuth=shaped(sigma),
        interference=shaped(stations.misfit(best.azimuth[:, None])[2][:, 0]),
        sigma_interference=shaped(sigma_e),
        chi_square=shaped(stations.misfit(peaks.azimuth[:, None])[0][:, 0]),
        mirror=mirror.reshape(lead),
        both=both.reshape(*lead, 2),
    )


@dataclass(frozen=True)
class _Peaks:
    """The two most probable azimuths of n stations; arrays of shape (n,), angles in rad."""

    azimuth: Array  #: most probable azimuth
    other: Array  #: second azimuth
    apart: Array  #: difference between the two azimuths
    #: `cost`, `cost_other`: their values of `_FitStations.cost`; `cost_other` is infinite for a station with only one
    #: azimuth.
    cost: Array
    cost_other: Array
    angles: Array  #: azimuths of a grid over the circle, shape (m,)
    density: Array  #: probabilities of these azimuths, shape (n, m)


def _peaks(stations: _FitStations) -> _Peaks:
    """Return the two deepest minima of the misfit of each station, from a search over the whole circle."""
    angles = np.linspace(0.0, 2.0 * np.pi, _GRID, endpoint=False)
    around = np.broadcast_to(angles, (len(stations.h), _GRID))
    found = stations.misfit(around)
    misfit, cost = found[0], stations.cost(*found)
    # Find minima of the misfit without the prior of the interference, because the prior would shift the minima.
    basin = (misfit <= np.roll(misfit, 1, axis=1)) & (misfit < np.roll(misfit, -1, axis=1))
    ranked = np.argsort(np.where(basin, misfit, np.inf), axis=1)[:, :2]
    two = np.take_along_axis(basin, ranked, axis=1)[:, 1]
    candidates = stations.polish(angles[ranked])
    first, second = candidates[:, 0], candidates[:, 1]
    costs = stations.cost(*stations.misfit(candidates))
    cost_1, cost_2 = costs[:, 0], np.where(two, costs[:, 1], np.inf)
    azimuth, other = np.where(cost_2 < cost_1, (second, first), (first, second))
    with np.errstate(over="ignore"):
        density = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
    density /= density.sum(axis=1, keepdims=True)
    apart = np.abs(wrap_pi(other - azimuth))
    return _Peaks(azimuth, other, apart, np.minimum(cost_1, cost_2), np.maximum(cost_1, cost_2), angles, density)


@dataclass(frozen=True)
class _Best:
    """Azimuth of n stations; arrays of shape (n,)."""

    azimuth: Array  #: azimuth, rad
    wide: np.ndarray  #: whether the azimuth is the mean of a wide posterior instead of its peak
    spread: Array  #: variance of the posterior, rad^2


def _best(stations: _FitStations, peaks: _Peaks) -> _Best:
    """Return the azimuth of each station: the peak of the posterior, or its mean if the posterior is wide (`_WIDE`)."""
    wide = stations.fit(peaks.azimuth).variance_azimuth > _WIDE**2
    away = wrap_pi(peaks.angles - peaks.azimuth[:, None])
    mean = np.sum(peaks.density * away, axis=1)
    spread = np.sum(peaks.density * away**2, axis=1) - mean**2
    return _Best(np.where(wide, peaks.azimuth + mean, peaks.azimuth), wide, spread)


def _mirror_share(stations: _FitStations, peaks: _Peaks, plausible: float) -> Array:
    """
    Return the probability of the second azimuth of each station, from the heights of both peaks, shape (n,).

    It is 0 if the second azimuth is ignored (`_MIRROR`). plausible: plausible interference, 1 sigma, T.
    """
    share = 1.0 / (1.0 + np.exp(np.minimum(0.5 * (peaks.cost_other - peaks.cost), 700.0)))
    loud = np.abs(stations.misfit(peaks.azimuth[:, None])[2][:, 0]) / plausible
    counts = np.isfinite(peaks.cost_other) & (peaks.apart > np.radians(1.0))
    counts &= share > np.where(loud > 1.0, _MIRROR_LOUD, _MIRROR)
    return np.where(counts, np.where(loud > _BEYOND, 0.5, share), 0.0)


@dataclass(frozen=True)
class _AxialFit:
    variance_azimuth: Array  #: variance of the azimuth, rad^2
    variance_interference: Array  #: variance of the interference, T^2
    variance_along: Array  #: variance of the interference if the azimuth were known, T^2


class _FitStations:
    """Readings and references of n stations, with the misfit of any azimuth."""

    def __init__(self, f: Array, b: Array, h: Array, v: Array, cov_s: Array, cov_r: Array, plausible: float) -> None:
        self.h, self.v, self.cov_r, self.information_plausible = h, v, cov_r, 1.0 / plausible**2
        self.seen = hole_components(f, b)
        across, g = np.hypot(f[:, 1], f[:, 2]), np.linalg.norm(f, axis=1)
        self.sin, self.cos = across / g, -f[:, 0] / g
        s, c = f[:, 1] / across, f[:, 2] / across
        n, zero = len(f), np.zeros(len(f))
        # Derivatives of the three components with respect to (f, b); an error of f turns the high side.
        toolface_f = np.stack([zero, c / across, -s / across], axis=1)
        inclination_f = np.stack([across / g**2, -f[:, 0] * s / g**2, -f[:, 0] * c / g**2], axis=1)
        seen_in = np.zeros((n, 3, 6))
        seen_in[:, 0, 3] = 1.0
        seen_in[:, 1, :3], seen_in[:, 2, :3] = -self.seen[:, 2:] * toolface_f, self.seen[:, 1:2] * toolface_f
        seen_in[:, 1, 4], seen_in[:, 1, 5] = s, c
        seen_in[:, 2, 4], seen_in[:, 2, 5] = -c, s
        # Covariance of the three components, their covariance with the inclination, and variance of the inclination.
        self.cov_seen = seen_in @ cov_s @ np.swapaxes(seen_in, 1, 2)
        self.cov_both = np.squeeze(seen_in @ cov_s[:, :, :3] @ inclination_f[:, :, None], 2)
        self.var_inc = np.squeeze(inclination_f[:, None, :] @ cov_s[:, :3, :3] @ inclination_f[:, :, None], (1, 2))

    def _linear(self, azimuth: Array) -> tuple[Array, Array]:
        """
        Return the misfit of azimuths and its covariance.

        azimuth: shape (n, m), rad. The misfit, shape (n, m, 3), T, is the measured minus the expected component along
        the axis, the high side and the right side, without interference; the covariance has shape (n, m, 3, 3), T^2.
        """
        h, v, s, c = (x[:, None] for x in (self.h, self.v, self.sin, self.cos))
        s_a, c_a = np.sin(azimuth), np.cos(azimuth)
        zero = np.zeros_like(s_a)
        high = h * c * c_a - v * s
        axis = h * s * c_a + v * c
        misfit = self.seen[:, None, :] - np.stack([axis, high, -h * s_a], axis=2)
        slope = np.stack([high, -axis, zero], axis=2)
        cross = slope[..., :, None] * self.cov_both[:, None, None, :]
        into = np.stack([s * c_a, c + zero, c * c_a, -s + zero, -s_a, zero], axis=2).reshape(*s_a.shape, 3, 2)
        cov = (
            self.cov_seen[:, None]
            - cross
            - np.swapaxes(cross, 2, 3)
            + slope[..., :, None] * slope[..., None, :] * self.var_inc[:, None, None, None]
            + into @ self.cov_r[:, None] @ np.swapaxes(into, 2, 3)
        )
        return misfit, cov

    def misfit(self, azimuth: Array) -> tuple[Array, Array, Array]:
        """
        Return the chi-square of azimuths, the log determinant of the covariance, and the interference that fits best.

        azimuth, rad, and the three results have shape (n, m). Chi-square (of the components across the axis) plus log
        determinant is minus twice the log likelihood at the best interference, T. For readings without error the
        minimum of chi-square is exactly at the true azimuth.
        """
        misfit, cov = self._linear(azimuth)
        a, b, d = cov[..., 1, 1], cov[..., 1, 2], cov[..., 2, 2]
        det = a * d - b * b
        y, z = misfit[..., 1], misfit[..., 2]
        across = (d * y * y - 2.0 * b * y * z + a * z * z) / det
        # Axial misfit after subtracting the part predicted by the across-axis misfit.
        p, q = cov[..., 0, 1], cov[..., 0, 2]
        k_y, k_z = (d * p - b * q) / det, (a * q - b * p) / det
        return np.asarray(across), np.asarray(np.log(det)), np.asarray(misfit[..., 0] - k_y * y - k_z * z)

    def fit(self, azimuth: Array) -> _AxialFit:
        """Return the variances of azimuth and interference of each station; azimuth, shape (n,): rad."""
        cov = self._linear(azimuth[:, None])[1][:, 0]
        s_a, c_a = np.sin(azimuth), np.cos(azimuth)
        slope = np.stack([-self.h * self.sin * s_a, -self.h * self.cos * s_a, -self.h * c_a], axis=1)
        unit = np.zeros_like(slope)
        unit[:, 0] = 1.0
        # Scale by the field, so that angles and tesla have similar size in the inversion.
        scale = np.stack([np.ones_like(self.h), self.h], axis=1)
        design = np.stack([slope, unit], axis=2) * scale[:, None, :]
        information = np.swapaxes(np.linalg.solve(cov, design), 1, 2) @ design
        # In an exactly horizontal east-west hole the readings have no information on azimuth: keep the inverse finite.
        information[:, 0, 0] += 1e-6
        covariance = np.linalg.inv(information) * scale[:, :, None] * scale[:, None, :]
        return _AxialFit(covariance[:, 0, 0], covariance[:, 1, 1], self.h**2 / information[:, 1, 1])

    def cost(self, misfit: Array, log: Array, interference: Array) -> Array:
        """
        Return minus twice the log probability of azimuths, including the prior of the interference.

        Inputs as from `misfit`; shape (n, m).
        """
        square = interference**2 * self.information_plausible
        density = (1.0 + square / _FREEDOM) ** (-0.5 * (_FREEDOM + 1.0)) + _TAIL / (1.0 + square)
        return np.asarray(misfit + log - 2.0 * np.log(density))

    def polish(self, azimuth: Array) -> Array:
        """Return azimuths, shape (n, m), moved to the minima of their misfit by repeatedly narrowing a window."""
        window = np.linspace(-1.0, 1.0, 17)
        width = 2.0 * np.pi / _GRID
        for _ in range(9):
            tried = azimuth[:, :, None] + width * window
            misfit = self.misfit(tried.reshape(len(tried), -1))[0].reshape(tried.shape)
            azimuth = np.take_along_axis(tried, np.argmin(misfit, axis=2)[:, :, None], axis=2)[:, :, 0]
            width /= 8.0
        return azimuth

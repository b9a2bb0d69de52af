# SPDX-License-Identifier: Apache-2.0
"""
Posterior of the azimuth: a Gaussian of the horizontal Earth rate, restricted to the circle given by the latitude.

The prior of the Earth-rate state is isotropic about zero, so it is constant on the circle |horizontal Earth rate| =
We cos(latitude). Restricting the filter's Gaussian to the circle therefore gives the posterior at any width, with one
mode or two.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi

# The sigma of a mixture follows from the width of its central interval with this probability; _WITHIN_SIGMAS: half of
# the width of this interval for a Gaussian, in sigmas. A mistake with a probability below 1 % does not widen sigma.
_WITHIN = 0.99
_WITHIN_SIGMAS = NormalDist().inv_cdf(0.5 + 0.5 * _WITHIN)
# Least probability of a mode that counts. A less probable mode is within sigma, and does not ask for another reading.
_LEAST_SHARE = 0.005
# Smallest width of a peak that the coarse grid resolves, rad; and largest ratio of the widths of two peaks that use the
# same grid.
_NARROW, _ALIKE = 0.1, 1.4
# Squared distance, above the smallest one, of a point whose weight is below rounding.
_NOTHING = 75.0


class Mixture(NamedTuple):
    """k Gaussians of the horizontal Earth rate, and of an angle that is added to the azimuth found on the circle."""

    log_weight: Array  #: shape (k,); log evidence of each Gaussian relative to the others
    #: `earth`, `S`: shapes (k, 2) and (k, 2, 2); mean and covariance of the horizontal Earth rate, level frame, rad/s.
    earth: Array
    S: Array
    #: `cross`, `own`: shapes (k, 2) and (k,); regression of the added angle on the Earth rate, rad per rad/s, and its
    #: remaining variance, rad^2.
    cross: Array
    own: Array
    shift: Array  #: shape (k,); mean of the angle that is added to the azimuth, rad
    misfit: Array  #: shape (k,); squared distance, in sigmas, of the vertical Earth rate from its value at the latitude


@dataclasses.dataclass(frozen=True)
class OnCircle:
    """Azimuth of the level frame, plus the added angle of `Mixture`, from the posterior on the circle."""

    #: `mean`, `sigma`: mean and 1 sigma, rad.
    mean: float
    sigma: float
    misfit: (
        float  #: squared distance, in sigmas, of the most likely Gaussian's Earth rate from its value at the latitude
    )
    several: tuple[float, ...]  #: angles that fit, each with more than 0.5 %, rad; empty if there is only one
    log_evidence: float  #: log evidence of all Gaussians, up to a constant that all latitudes share


class _Cost:
    """The Gaussians as functions of the angle on the circle: squared distances, in sigmas, and log likelihoods."""

    def __init__(self, parts: Mixture, horizontal: float) -> None:
        self._inverse = np.linalg.inv(parts.S)
        self._offsets = (np.linalg.slogdet(parts.S)[1] - 2.0 * parts.log_weight)[:, None]
        self._north, self._east = parts.earth[:, :1], parts.earth[:, 1:]
        self._nn, self._ne, self._ee = (self._inverse[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
        self._horizontal = horizontal

    def distances(self, angle: Array) -> Array:
        """Return the squared distance, in sigmas, of each Gaussian from the circle at the angles, rad; shape (k, n)."""
        d_n = self._horizontal * np.cos(angle) - self._north
        d_e = -self._horizontal * np.sin(angle) - self._east
        return np.asarray(self._nn * d_n * d_n + 2.0 * self._ne * d_n * d_e + self._ee * d_e * d_e)

    def each(self, angle: Array) -> Array:
        """Return minus twice the log likelihood of each Gaussian, shape (k, n)."""
        return np.asarray(self.distances(angle) + self._offsets)

    def total(self, angle: Array) -> Array:
        """Return minus twice the log likelihood of all Gaussians together, shape (n,)."""
        each = self.each(angle)
        least = each.min(axis=0)
        return np.asarray(least - 2.0 * np.log(np.exp(-0.5 * (each - least)).sum(axis=0)))

    def grid(self, modes: Sequence[float], lone: bool) -> tuple[Array, Array]:
        """
        Return angles that resolve every mode, rad, and the width of the circle that each angle represents, rad.

        Both have the shape (n,). modes: angles of the modes, rad; lone: whether to use only the half circle around the
        single mode, because an expected azimuth excludes the other half.
        """
        # Steps of a degree give mean and sigma of a peak of at least `_NARROW` to a thousandth of sigma.
        spread = [modes[0] + np.linspace(-0.5, 0.5, 181) * math.pi if lone else np.linspace(-1.0, 1.0, 361) * math.pi]
        for mode in modes:
            tangent = self._horizontal * np.array([-math.sin(mode), -math.cos(mode)])
            resolved = 0.0
            for width in np.sort(1.0 / np.sqrt(np.einsum("i,kij,j->k", tangent, self._inverse, tangent))):
                # A narrow peak needs its own grid, unless the last grid was made for a peak that is nearly as narrow.
                if _ALIKE * resolved < width < _NARROW:
                    spread.append(mode + np.linspace(-8.0, 8.0, 81) * width)
                    resolved = width
        angle = np.unique(np.concatenate(spread))
        if lone:
            return angle, np.gradient(angle)
        angle = np.unique(wrap_pi(angle))
        return angle, 0.5 * ((np.roll(angle, -1) - np.roll(angle, 1)) % (2.0 * math.pi))


def along(parts: Mixture, horizontal: float) -> tuple[Array, Array, Array]:
    """
    Evaluate each Gaussian along the circle; horizontal: Earth rate times the cosine of the latitude, rad/s.

    Returns
    -------
    angle : ndarray, shape (n,)
        Angles, rad, that resolve every mode.
    share : ndarray, shape (k, n)
        Probability of each angle within its Gaussian.
    log_weight : ndarray, shape (k,)
        Log evidence of each Gaussian on the circle, up to a constant.
    """
    cost = _Cost(parts, horizontal)
    angle, spacing = cost.grid([mode for mode, _ in _modes(cost.total)], lone=False)
    each = cost.each(angle)
    least = each.min(axis=1, keepdims=True)
    share = np.exp(-0.5 * (each - least)) * spacing
    whole = share.sum(axis=1)
    return angle, share / whole[:, None], np.log(whole) - 0.5 * least[:, 0]


def posterior(parts: Mixture, horizontal: float, expected: float | None = None) -> OnCircle:
    """
    Return mean and sigma of the azimuth, given the length of the horizontal Earth rate.

    Parameters
    ----------
    parts : Mixture
        Estimate from the data, weighted by the evidence.
    horizontal : float
        Earth rate times the cosine of the latitude, rad/s.
    expected : float, optional
        An azimuth, rad, that selects one of several azimuths that fit; this argument does not change the value of the
        selected azimuth.
    """
    cost = _Cost(parts, horizontal)
    modes = _modes(cost.total)
    best = min(modes, key=lambda mode: mode[1])[0]
    likeliest = int(np.argmin(cost.each(np.array([best]))))
    misfit = float(cost.distances(np.array([best]))[likeliest, 0]) + float(parts.misfit[likeliest])
    if len(modes) > 1 and expected is not None:
        modes = [min(modes, key=lambda mode: abs(float(wrap_pi(mode[0] - expected))))]
    angles = [mode for mode, _ in modes]
    angle, spacing = cost.grid(angles, len(angles) == 1 and expected is not None)
    every = cost.each(angle)
    least = float(every.min())
    # The other points have a weight below rounding.
    k, n = np.nonzero(every < least + _NOTHING)
    weight = np.exp(-0.5 * (every[k, n] - least)) * spacing[n]
    whole = float(weight.sum())
    weight /= whole
    d = horizontal * np.stack([np.cos(angle), -np.sin(angle)])
    total = angle + parts.cross @ d + (parts.shift - np.einsum("ki,ki->k", parts.cross, parts.earth))[:, None]
    total = total[k, n]
    mean = math.atan2(float(weight @ np.sin(total)), float(weight @ np.cos(total)))
    variance = float(weight @ (wrap_pi(total - mean) ** 2 + parts.own[k]))
    shares = _shares(angles, angle[n], weight)
    counted = [mode for mode, share in zip(angles, shares, strict=True) if share > _LEAST_SHARE]
    several = tuple(counted) if len(counted) > 1 else ()
    return OnCircle(mean, min(math.sqrt(variance), math.pi), misfit, several, math.log(whole) - 0.5 * least)


def _shares(modes: Sequence[float], angle: Array, weight: Array) -> Array:
    """
    Return the probability of each mode, shape (m,), as the sum over all angles to which this mode is the nearest.

    modes: angles of the modes, rad; angle, weight, shape (n,): angles, rad, and their probabilities.
    """
    nearest = np.argmin(np.abs(wrap_pi(angle - np.array(modes)[:, None])), axis=0)
    return np.asarray(np.bincount(nearest, weight, len(modes)), dtype=float)


def sigma_of_mixture(weight: Array, off: Array, sigmas: Sequence[float]) -> float:
    """
    Return 1 sigma, rad, of the zero-mean Gaussian whose central 99 % interval is as wide as that of a mixture.

    weight, off, sigmas, shape (n,): weights, which have the sum 1, means and 1 sigma of the Gaussians of the mixture,
    rad. The result is at most pi.
    """
    parts = [(w, o, s * math.sqrt(2.0)) for w, o, s in zip(weight, off, sigmas, strict=True)]

    def outside(width: float) -> float:
        return 0.5 * math.fsum(w * (math.erfc((width - o) / s) + math.erfc((width + o) / s)) for w, o, s in parts)

    least, most = 0.0, _WITHIN_SIGMAS * math.pi
    for _ in range(50):
        width = 0.5 * (least + most)
        least, most = (width, most) if outside(width) > 1.0 - _WITHIN else (least, width)
    return most / _WITHIN_SIGMAS


def _modes(cost: Callable[[Array], Array]) -> list[tuple[float, float]]:
    """Return angle, rad, and cost of each local minimum of the cost that is less than 25 above the lowest minimum."""
    grid = np.linspace(-math.pi, math.pi, 180, endpoint=False)
    values = cost(grid)
    low = (values <= np.roll(values, 1)) & (values < np.roll(values, -1))
    found = []
    for angle in grid[low]:
        step = math.radians(2.0)
        for _ in range(5):
            near = angle + np.linspace(-step, step, 41)
            angle = near[np.argmin(cost(near))]
            step /= 12.0
        found.append((float(angle), float(cost(np.array([angle]))[0])))
    best = min(chi2 for _, chi2 in found)
    return [(angle, chi2) for angle, chi2 in found if chi2 < best + 25.0]

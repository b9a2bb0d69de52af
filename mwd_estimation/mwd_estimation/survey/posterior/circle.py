# SPDX-License-Identifier: Apache-2.0
"""Summary of a density on the circle: mean and sigma of its chief mode, and its other modes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.frames import wrap_pi, wrap_tau

# Two peaks are separate modes if the density between them falls below this share of the lower peak.
_VALLEY = 0.5
# Probability of a normal density within `_SIGMAS` sigmas of its mean.
_HELD, _SIGMAS = 0.99, 2.576
# Smallest probability of a mode that is listed as an alternative.
_LEAST = 0.003
# Smallest 1 sigma of an additional error, rad, so that the division by it is defined.
_EXACT = 1e-9
# The circle has 7200 steps of 0.05 deg. The coarse grid uses every 40th step. The fine grid adds, around each peak of
# the coarse grid, all steps within 2.5 deg and every fifth step within 12 deg.
STEPS, _EVERY = 7200, 40
_COARSE = np.arange(0, STEPS, _EVERY)
# Indices of the coarse angles before and after each coarse angle.
_BEFORE, _AFTER = np.roll(np.arange(len(_COARSE)), 1), np.roll(np.arange(len(_COARSE)), -1)
_ABOUT = np.unique(np.concatenate([np.arange(-50, 51), np.arange(-240, 241, 5)]))
# Smallest density of a peak that gets fine steps, relative to the highest peak; and largest number of such peaks.
_WORTH, _MOST = 1e-7, 6
# scipy.special.erfc does the same, but its import would take a fifth of the start time of an estimator.
_ERFC = np.frompyfunc(math.erfc, 1, 1)


@dataclasses.dataclass(frozen=True)
class Circle:
    """Summary of a density of the azimuth."""

    #: `mean`, `sigma`: mean and sigma of the chief mode, rad; sigma is at least that of a normal density with the same
    #: 99 % interval.
    mean: float
    sigma: float
    spread: float  #: the larger of sigma and the standard deviation of the whole chief mode, rad
    share: float  #: probability of the chief mode
    alternatives: tuple[tuple[float, float], ...]  #: mean, rad, and probability of the other modes, most probable first


def beyond(angles: Array, density: Array, centre: float, width: float, smear: float = 0.0) -> float:
    """
    Return the probability of an angle farther than `width` from `centre`, rad; angles and density as in `read`.

    smear: 1 sigma of an independent normal error that is not in the density, rad.
    """
    mass, off = density * widths(angles), wrap_pi(angles - centre)
    inside = np.array([width - off, width + off]) / (math.sqrt(2.0) * max(smear, _EXACT))
    return float(0.5 * mass @ np.asarray(_ERFC(inside), dtype=float).sum(axis=0) / mass.sum())


def coarse() -> Array:
    """Return the angles of the coarse grid, rad, which are 2 deg apart."""
    return np.asarray(_COARSE * (math.tau / STEPS))


def refined(log_density: Array, *centres: float) -> Array:
    """
    Return the angles, rad, in order, at which a density is computed: a coarse grid, and fine steps where it is large.

    The fine steps lie about every peak of the coarse density and about every further centre.

    log_density: at each coarse angle, the log density, or the highest log density about this angle (`highest`), shape
    (180,). centres: further centres, rad; NaN: no centre.
    """
    peaks = np.flatnonzero((log_density >= log_density[_BEFORE]) & (log_density > log_density[_AFTER]))
    peaks = peaks[log_density[peaks] > log_density.max() + math.log(_WORTH)]
    peaks = peaks[np.argsort(log_density[peaks])[::-1]][:_MOST]
    about = [*_COARSE[peaks], *(round(one / math.tau * STEPS) for one in centres if math.isfinite(one))]
    chosen = np.zeros(STEPS, dtype=bool)
    chosen[_COARSE] = True
    for place in about:
        chosen[(place + _ABOUT) % STEPS] = True
    return np.asarray(np.flatnonzero(chosen) * (math.tau / STEPS))


def highest(density: Array) -> Array:
    """Return the highest density about each coarse angle, shape (180,); density: at every step, shape (7200,)."""
    return np.asarray(np.roll(density, _EVERY // 2).reshape(-1, _EVERY).max(axis=1))


def is_coarse(angles: Array) -> np.ndarray:
    """Return which of the angles from `refined` belong to the coarse grid, bool."""
    return np.asarray(places(angles) % _EVERY == 0)


def places(angles: Array) -> Indices:
    """Return the index, 0 to `STEPS`, of the step of the circle at which each angle from `coarse` or `refined` lies."""
    return np.rint(angles * (STEPS / math.tau)).astype(np.intp)


def widths(angles: Array) -> Array:
    """Return the width of the interval around each of the ordered angles, rad."""
    found = np.empty(len(angles))
    found[1:-1] = angles[2:] - angles[:-2]
    found[[0, -1]] = (angles[[1, 0]] - angles[[-1, -2]]) % math.tau
    return 0.5 * found


def read(angles: Array, density: Array) -> Circle:
    """
    Return the summary of a density.

    angles: in order, rad, shape (n,); density: per rad, shape (n,); it need not be normalised.
    """
    mass = density * widths(angles)
    mass = mass / mass.sum()
    found = (_moments(angles[at], mass[at], angles[at][int(np.argmax(density[at]))]) for at in _regions(density))
    modes = sorted(found, reverse=True)
    share, mean, sigma, spread = modes[0]
    others = tuple((other[1], other[0]) for other in modes[1:] if other[0] >= _LEAST)
    return Circle(mean, min(sigma, math.pi), min(spread, math.pi), share, others)


def _regions(density: Array) -> list[Indices]:
    """Return the indices of the angles of each mode; the circle is cut at the valleys of `density`, shape (n,)."""
    n, start = len(density), int(np.argmin(density))
    order = (start + np.arange(n)) % n
    cuts, peak, valley, at = [0], -1.0, density[order[0]], 0
    for k, value in enumerate(density[order].tolist()):
        if value < valley or peak < 0.0:
            valley, at = min(value, valley), k
        if peak > 0.0 and value > valley / _VALLEY and valley < _VALLEY * peak:
            cuts.append(at)
            peak, valley = value, value
        elif value > peak:
            peak, valley = value, value
    return [order[a:b] for a, b in zip(cuts, [*cuts[1:], n], strict=True)]


def _moments(angles: Array, mass: Array, peak: float) -> tuple[float, float, float, float]:
    """
    Return the probability of one mode, its mean, its sigma, and its spread (rms distance from mean, at least sigma).

    Angles in rad; mass, shape (n,): probability of each angle; peak: angle of the highest density. If the probability
    is 0, the mean is the peak, and sigma and spread are pi.
    """
    share = float(mass.sum())
    if not share > 0.0:
        return 0.0, float(peak), math.pi, math.pi
    away = wrap_pi(angles - peak)
    mean = float(mass @ away) / share
    off = np.abs(away - mean)
    order = np.argsort(off)
    # The probability of a grid angle is that of the interval around it. Half of it lies farther from the mean than the
    # grid angle does, so only the other half is counted up to this angle.
    reached = np.cumsum(mass[order]) - 0.5 * mass[order]
    limit = float(np.interp(_HELD * share, reached, off[order]))
    held = off <= limit
    within = math.sqrt(float(mass[held] @ off[held] ** 2) / float(mass[held].sum()))
    sigma = max(within, limit / _SIGMAS)
    return share, float(wrap_tau(peak + mean)), sigma, max(sigma, math.sqrt(float(mass @ off**2) / share))

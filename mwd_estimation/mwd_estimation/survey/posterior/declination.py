# SPDX-License-Identifier: Apache-2.0
"""
Density of the azimuth of the hole, from the density of the angle that the field shows and the error of the declination.

The field depends on the magnetic azimuth only, so `evidence` evaluates angles for the declination of the reference. The
azimuth is this angle plus the error of the declination, and a gyro measures the azimuth. At every point of `evidence`
(angle, filter, external field, state of the gyro) the error is normal; readings of a gyro, at this station or before,
give its mean and variance (Kalman update). In the density of the azimuth, each point is moved by the mean and smeared
by the variance.

The error of the declination is not one of the errors by which the predicted field changes (`field_model`). There, a
change is a slope, so it would move the field along a straight line. A large error of the declination moves the field
along a circle, and the readings would seem to exclude it.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.survey.posterior import circle
from mwd_estimation.survey.posterior.evidence import OUT, highest_share, inverse, packed_products, spread_at
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled

# Smallest probability of a point that is used.
_LEAST = 1e-10
# Largest covariance of independent errors by rounding, rad uT or rad^2.
_INDEPENDENT = 1e-12
# Densities are convolved with normal errors whose variances form a geometric series: its first variance, rad^2, and the
# ratio of two successive ones. For a variance between two of them, their results are averaged with weights.
_EXACT, _RATIO = 1e-8, 1.25
# Means and sigmas of errors that differ by less than this are the same, rad.
_SAME = 1e-9
# A density below this share of the highest is rounding error of the Fourier transform.
_ROUNDED = 1e-13


class Declination(NamedTuple):
    """
    Error of the declination in each of m filters before a station.

    Its covariance with the residual of the station is given too.
    """

    mean: Array  #: shape (m,); rad
    variance: Array  #: shape (m,); rad^2
    slope: Array  #: shape (m, 3, 4); covariance with the residual, as factors of `field_model.basis`


def azimuth_density(
    angles: Array,
    share: Array,
    adrift: NDArray[np.bool_],
    circle_of: tuple[Array, Array],
    terms: tuple[Array, Array],
    extra: Array,
    error: Declination,
) -> Array:
    """
    Return the density of the azimuth at every step of the circle, per step, shape (`circle.STEPS`, 3).

    Last axis: the gyro is right; its bias stepped or drifts; it is wrong, or there is none.

    angles (n,): as from `circle.refined`, rad; share (n, m, h, j): as in `CircleEvidence.share`; adrift (m,), bool:
    whether the gyro of the filter drifts; circle_of: basis (n, 3) and residual (n,) of the gyro at each angle, 0
    without a gyro; terms: r (m, 3, 4) and S (m, 3, 3, 4, 4); extra (h + 1,): all as in `evidence.gains`.
    """
    width = circle.widths(angles)
    if share.shape[3] == 1 and not (np.abs(error.slope) > _INDEPENDENT).any() and np.abs(error.mean).max() < _SAME:
        # Without a gyro so far, the error is independent of the readings and the same in many filters.
        by_filter = np.where(share > _LEAST, share, 0.0)[..., 0] @ np.ones(share.shape[2]) / width[:, None]
        _, first, group = np.unique(np.rint(np.sqrt(error.variance) / _SAME), return_index=True, return_inverse=True)
        density = (by_filter @ (group[:, None] == np.arange(len(first)))).T
        return _without_gyro(circle.places(angles), density, error.variance[first])
    mass, turn, smear = errors = np.zeros((3, *share.shape[:2], 3))
    _fill_errors(share, adrift, circle_of, terms, extra, error, errors)
    used = smear[mass > 0.0]
    low = int(used.min())
    parts = np.zeros((3, int(used.max()) - low + 2, circle.STEPS))
    filled = np.zeros(parts.shape[:2], dtype=bool)
    _add_points(circle.places(angles), mass / width[:, None, None], turn, smear - low, parts, filled)
    found = np.zeros((circle.STEPS, 3))
    for state in np.flatnonzero(filled.any(axis=1)):
        whole = sum(np.fft.rfft(parts[state, k]) * _kept(low + k) for k in np.flatnonzero(filled[state]))
        found[:, state] = np.fft.irfft(whole, circle.STEPS)
    return np.where(found > _ROUNDED * found.max(), found, 0.0)


def _without_gyro(places: Indices, density: Array, variance: Array) -> Array:
    """
    Return the result of `azimuth_density` for g errors with mean 0 that are independent of the readings.

    places (n,): steps of the circle at the angles; density (g, n): of the angle, per rad; variance (g,): rad^2.
    """
    times = np.maximum(variance / _EXACT, 1.0)
    powers = np.floor(np.log(times) / math.log(_RATIO)).astype(int)
    wider = (times / _RATIO**powers - 1.0) / (_RATIO - 1.0)
    whole, steps = np.zeros(circle.STEPS // 2 + 1, dtype=complex), np.arange(circle.STEPS)
    # The first angle is 0; the argument `period` of `np.interp` would take three times as long.
    ends = np.append(places, circle.STEPS)
    for part, power, wide in zip(density, powers.tolist(), wider.tolist(), strict=True):
        smeared = (1.0 - wide) * _kept(power) + wide * _kept(power + 1)
        whole += np.fft.rfft(np.interp(steps, ends, np.append(part, part[0]))) * smeared
    found = np.zeros((circle.STEPS, 3))
    found[:, 2] = np.fft.irfft(whole, circle.STEPS) * (math.tau / circle.STEPS)
    return np.where(found > _ROUNDED * found.max(), found, 0.0)


@functools.lru_cache(maxsize=128)
def _kept(smear: int) -> Array:
    """
    Return the factors of the Fourier coefficients of a density when a normal error is added (convolution).

    smear: the error has the variance `_EXACT` times `_RATIO` to this power. (Mardia and Jupp, Directional Statistics,
    section 3.5.7.)
    """
    return np.asarray(np.exp(-0.5 * _EXACT * _RATIO**smear * np.arange(circle.STEPS // 2 + 1) ** 2))


@compiled
def _fill_errors(
    share: Array,
    adrift: NDArray[np.bool_],
    circle_of: tuple[Array, Array],
    terms: tuple[Array, Array],
    extra: Array,
    error: tuple[Array, Array, Array],
    errors: Array,
) -> None:
    """
    Fill the error of the declination at every probable angle by filter and state of the gyro, shape (3, n, m, 3).

    errors: probability, mean of the error, rad, and its variance as the power p of `_RATIO` (see `_kept`). A p of 3.2
    means that 0.8 of the probability is smeared by power 3, and 0.2 by power 4. The errors under all external fields
    are merged. errors must be zero before the call; the inputs are those of `azimuth_density`.
    """
    phi, gyro = circle_of
    r, S = terms
    before, spread, slope = error
    last = share.shape[3] - 1
    packed, s, i, e, c = np.zeros((4, 4, 6)), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    for k in range(share.shape[1]):
        # Until a gyro is used, the readings tell nothing of the declination error, except by rounding.
        known = np.abs(slope[k]).max() > _INDEPENDENT
        packed_products(S[k], packed)
        for n in range(share.shape[0]):
            if not highest_share(share, n, k) > _LEAST:
                continue
            if known:
                spread_at(phi, n, packed, 4, s)
                for a in range(4):
                    e[a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
                    c[a] = phi[n, 0] * slope[k, 0, a] + phi[n, 1] * slope[k, 1, a] + phi[n, 2] * slope[k, 2, a]
                e[3] += gyro[n]
            for j in range(last + 1):
                whole, first, second = 0.0, 0.0, 0.0
                for h in range(share.shape[2]):
                    one = share[n, k, h, j]
                    if not one > _LEAST:
                        continue
                    mean, variance = before[k], spread[k]
                    if known:
                        # A wrong gyro, or none, does not measure the error: such a measurement has infinite variance.
                        inverse(s, extra[h], OUT if j == last else j * extra[-1], i)
                        for a in range(4):
                            gain = i[a, 0] * c[0] + i[a, 1] * c[1] + i[a, 2] * c[2] + i[a, 3] * c[3]
                            mean += gain * e[a]
                            variance -= gain * c[a]
                    whole, first, second = whole + one, first + one * mean, second + one * (variance + mean * mean)
                if whole > 0.0:
                    state = 1 if adrift[k] and j < last else 2 - last + j
                    mean = first / whole
                    times = max((second / whole - mean * mean) / _EXACT, 1.0)
                    power = math.floor(math.log(times) / math.log(_RATIO))
                    errors[0, n, k, state] = whole
                    errors[1, n, k, state] = mean
                    errors[2, n, k, state] = power + (times / _RATIO**power - 1.0) / (_RATIO - 1.0)


@compiled
def _add_points(
    places: Indices, density: Array, turn: Array, smear: Array, parts: Array, filled: NDArray[np.bool_]
) -> None:
    """
    Add all points to the densities of the azimuth before the convolution; between two angles they are interpolated.

    places (n,): steps of the circle at the angles; density (n, m, 3): of the angle; turn (n, m, 3): mean of the error,
    rad, from `_fill_errors`; smear (n, m, 3): its power, from `_fill_errors`, minus the power of the first of the g
    convolutions; parts (3, g, `circle.STEPS`): probability of each azimuth, by state of the gyro and convolution;
    filled (3, g): set to True where a probability was added.
    """
    steps, count = parts.shape[2], len(places)
    a_step = 6.283185307179586 / steps
    for k in range(density.shape[1]):
        for state in range(3):
            for n in range(count):
                m = n + 1 if n + 1 < count else 0
                one, two = density[n, k, state], density[m, k, state]
                if not one + two > 0.0:
                    continue
                apart = (places[m] - places[n]) % steps
                for t in range(apart):
                    p, q = one * (1.0 - t / apart), two * (t / apart)
                    whole = p + q
                    if not whole > 0.0:
                        continue
                    level = (p * smear[n, k, state] + q * smear[m, k, state]) / whole
                    at = places[n] + t + (p * turn[n, k, state] + q * turn[m, k, state]) / whole / a_step
                    g, place = int(level), math.floor(at)
                    wider, beyond = level - g, at - place
                    place %= steps
                    after = place + 1 if place + 1 < steps else 0
                    wide, narrow = whole * a_step * wider, whole * a_step * (1.0 - wider)
                    filled[state, g] = filled[state, g + 1] = True
                    parts[state, g, place] += narrow * (1.0 - beyond)
                    parts[state, g, after] += narrow * beyond
                    parts[state, g + 1, place] += wide * (1.0 - beyond)
                    parts[state, g + 1, after] += wide * beyond

# SPDX-License-Identifier: Apache-2.0
"""
Density of the azimuth of the hole, from the density of the angle that the field shows and the error of the declination.

The field depends on the magnetic azimuth only, so `evidence` evaluates angles for the declination of the reference. The
azimuth is this angle plus the error of the declination, and a gyro measures the azimuth. At every point of `evidence`
(angle, filter, external field, state of the gyro) the error is normal; readings of a gyro, at this station or before,
give its mean and variance (Kalman update). In the density of the azimuth, each point is moved by the mean and smeared
by the variance.

If the error of the declination changed the predicted field, it would move the field along a straight line. A large
error moves the field along a circle, so the readings would seem to exclude such an error.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.survey.posterior import circle
from mwd_estimation.survey.posterior.evidence import OUT, highest_share, inverse, packed_products, spread_at
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled

# Smallest probability of a point that is used.
_LEAST = 1e-12
# Largest covariance of independent errors by rounding, rad uT or rad^2.
_INDEPENDENT = 1e-12
# Smallest variance of the error, rad^2, and ratio of the variances for which the convolution is computed. Between two
# of them, a part of the probability is smeared by each.
_EXACT, _RATIO = 1e-8, 1.25
# A density below this share of the highest is rounding error of the Fourier transform.
_ROUNDED = 1e-13


class Declination(NamedTuple):
    """Error of the declination in m filters before a station, and its covariance with the residual at the station."""

    mean: Array  #: shape (m,); rad
    variance: Array  #: shape (m,); rad^2
    slope: Array  #: shape (m, 3, 4); covariance with the residual, as factors of `field_model.basis`


def azimuth_density(
    angles: Array,
    share: Array,
    adrift: Array,
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
    turn, variance = np.zeros_like(share), np.zeros_like(share)
    _fill_errors(share, circle_of, terms, extra, error, turn, variance)
    known = variance[share > _LEAST]
    low, high = (int(math.log(max(at, _EXACT) / _EXACT) / math.log(_RATIO)) for at in (known.min(), known.max()))
    smears = _EXACT * _RATIO ** np.arange(low, high + 2)
    parts = np.zeros((3, len(smears), circle.STEPS))
    width = circle.widths(angles)
    _add_points(circle.places(angles), share / width[:, None, None, None], adrift, turn, variance, smears, parts)
    found = np.zeros((circle.STEPS, 3))
    for state in np.flatnonzero(parts.any(axis=(1, 2))):
        whole = sum(np.fft.rfft(parts[state, k]) * _kept(low + k) for k in np.flatnonzero(parts[state].any(axis=1)))
        found[:, state] = np.fft.irfft(whole, circle.STEPS)
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
    circle_of: tuple[Array, Array],
    terms: tuple[Array, Array],
    extra: Array,
    error: tuple[Array, Array, Array],
    mean: Array,
    variance: Array,
) -> None:
    """Fill mean, rad, and variance, rad^2, of the error of the declination at every probable point, shape of share."""
    phi, gyro = circle_of
    r, S = terms
    before, spread, slope = error
    last = share.shape[3] - 1
    packed, s, i, e, c = np.zeros((4, 4, 6)), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    for k in range(share.shape[1]):
        # Without a gyro so far, the error is independent of the readings, up to rounding.
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
            for h in range(share.shape[2]):
                for j in range(last + 1):
                    if share[n, k, h, j] > _LEAST:
                        mean[n, k, h, j], variance[n, k, h, j] = before[k], spread[k]
                        if known:
                            # A wrong gyro, or none, does not measure the error: its variance has no limit.
                            inverse(s, extra[h], OUT if j == last else j * extra[-1], i)
                            for a in range(4):
                                gain = i[a, 0] * c[0] + i[a, 1] * c[1] + i[a, 2] * c[2] + i[a, 3] * c[3]
                                mean[n, k, h, j] += gain * e[a]
                                variance[n, k, h, j] -= gain * c[a]


@compiled
def _add_points(
    places: Indices,
    density: Array,
    adrift: Array,
    turn: Array,
    variance: Array,
    smears: Array,
    parts: Array,
) -> None:
    """
    Add all points to the densities of the azimuth before the convolution; between two angles they are interpolated.

    places (n,): steps of the circle at the angles; density, turn and variance (n, m, h, j): density of the angle, mean,
    rad, and variance, rad^2, of the error at each point; smears (g,): variances of the convolutions, rad^2; parts
    (3, g, `circle.STEPS`): probability of each azimuth, by state of the gyro and convolution.
    """
    steps, count, first = parts.shape[2], density.shape[0], 3 - density.shape[3]
    a_step = 6.283185307179586 / steps
    for k in range(density.shape[1]):
        for h in range(density.shape[2]):
            for j in range(density.shape[3]):
                state = 1 if adrift[k] and first + j == 0 else first + j
                for n in range(count):
                    m = n + 1 if n + 1 < count else 0
                    one, two = density[n, k, h, j], density[m, k, h, j]
                    if not one + two > 0.0:
                        continue
                    apart = (places[m] - places[n]) % steps
                    for t in range(apart):
                        p, q = one * (1.0 - t / apart), two * (t / apart)
                        whole = p + q
                        if not whole > 0.0:
                            continue
                        moved = (p * turn[n, k, h, j] + q * turn[m, k, h, j]) / whole
                        smear = (p * variance[n, k, h, j] + q * variance[m, k, h, j]) / whole
                        g = int(math.log(max(smear, smears[0]) / smears[0]) / math.log(_RATIO))
                        g = min(g, len(smears) - 2)
                        wider = min(max((smear - smears[g]) / (smears[g + 1] - smears[g]), 0.0), 1.0)
                        at = (places[n] + t + moved / a_step) % steps
                        place = int(at)
                        beyond = at - place
                        place %= steps
                        after = place + 1 if place + 1 < steps else 0
                        parts[state, g, place] += whole * a_step * (1.0 - wider) * (1.0 - beyond)
                        parts[state, g, after] += whole * a_step * (1.0 - wider) * beyond
                        parts[state, g + 1, place] += whole * a_step * wider * (1.0 - beyond)
                        parts[state, g + 1, after] += whole * a_step * wider * beyond

# SPDX-License-Identifier: Apache-2.0
"""
Whitening of noise: an autoregressive model of the pressure that pulses do not explain, and its prediction error filter.

The model describes the first difference, which removes standpipe pressure and its drift. Sources: S. M. Kay, Modern
Spectral Estimation, 1988, section 7.3 (autocorrelation method, Levinson); H. Akaike, A new look at the statistical
model identification, IEEE Trans. Autom. Control 19 (1974) 716 (order: each coefficient costs one nat).
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Highest order of the noise model, in a decoding (with the prior) and before a sync (without the prior); and white
# noise added to the model, as a share of its variance. With the prior, the word errors of the orders 40 and 60 differ
# by less than their scatter.
ORDER, SEARCH_ORDER, FLOOR = 60, 24, 1e-6
_LOCAL = 12  # samples on either side over which the noise power is averaged
_ROUNDS = 3  # number of iterations over noise model and weights
# Number of disturbance states, largest variance, and square root of the ratio of neighbouring variances. Each variance
# is 8 times the next smaller one, up to the variance of starting pumps.
_STATES, _LARGEST, _SQRT_8 = 6, 8.0**5, math.sqrt(8.0)
# Probability that a disturbance begins at a sample, one every five minutes with pulses of 0.5 s; and mean length of a
# disturbance, samples. In whitened pressure a disturbance lasts as long as its flanks, a second or less.
_BEGINS, _LASTS = 1.0 / 5000.0, 8.0


@compiled
def prediction_error_filter(
    noise: Array,
    weight: Array,
    order: int,
    floor: float,
    unsure: Array | None = None,
    prior: bool = False,
) -> tuple[Array, float]:
    """
    Return the filter that turns noise into white noise of unit variance, and the size of the noise.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses, Pa.
    weight : ndarray, shape (n,)
        0 where a sample is unknown or disturbed, 1 elsewhere.
    order : int
        Highest order of the autoregressive model of the difference.
    floor : float
        White noise added to the model, as a share of its variance, so that empty bands are not amplified.
    unsure : ndarray, shape (order + 2,), optional
        Autocorrelation, Pa^2 summed over the samples, of the error of the pulses that were subtracted; it is added to
        the autocorrelation of the noise.
    prior : bool
        Whether the partial correlations have a prior, which becomes narrower with their lag.

    Returns
    -------
    ndarray, shape (order + 2,)
        Coefficients of the filter; the first belongs to the newest sample.
    float
        Standard deviation of the innovation, Pa; 0 if the noise is constant or has too few samples for `order`.
    """
    n = len(noise)
    lags = np.zeros(order + 1)
    step = np.zeros(n)
    count = 0.0
    for i in range(n):
        count += weight[i] * weight[i]
        if i > 0:
            step[i] = (noise[i] - noise[i - 1]) * weight[i]
    for i in range(1, n):
        later = step[i : i + order + 1]
        for k in range(len(later)):
            lags[k] += step[i] * later[k]
    if unsure is not None:
        for k in range(order + 1):
            lags[k] += 2.0 * unsure[k] - unsure[abs(k - 1)] - unsure[k + 1]
    out = np.zeros(order + 2)
    if count < 2.0 * order or lags[0] <= 0.0:
        return out, 0.0
    lags /= count
    lags[0] *= 1.0 + floor
    best = np.zeros(order + 1)
    sigma = float(np.sqrt(_predicted(lags, count, prior, best)))
    for i in range(order + 1):
        out[i] += best[i] / sigma
        out[i + 1] -= best[i] / sigma
    return out, sigma


@compiled
def _predicted(lags: Array, count: float, prior: bool, best: Array) -> float:
    """
    Fill `best` with the filter of the order that Akaike's criterion selects; return its innovation variance.

    The prior of the partial correlation of lag m is normal with mean 0 and sigma 1 / (m + 1); the partial correlations
    of the first difference of white noise have this size. In Akaike's criterion a coefficient counts with the share to
    which the samples, and not the prior, determine it.
    """
    n, fitted = len(lags), 0.0
    # Filter of m coefficients, and correlation of its error with the samples 0 to m steps back.
    a, apart = np.zeros(n), np.zeros(n)
    a[0] = best[0] = 1.0
    apart[0] = error = least = lags[0]
    lowest = count * np.log(error)
    for m in range(1, n):
        # Correlation of the errors of forward and backward prediction, which the filter leaves.
        total = error = 0.0
        for i in range(m):
            apart[m] += a[i] * lags[m - i]
        for i in range(m):
            total += a[i] * apart[m - i]
            error += a[i] * apart[i]
        k = -total / error
        share = 1.0 / (1.0 + (m + 1) ** 2 * (1.0 - k * k) / count) if prior else 1.0
        k *= share
        fitted += share
        _add_reversed(a[: m + 1], k)
        _add_reversed(apart[: m + 1], k)
        error += 2.0 * k * total + k * k * error
        if count * np.log(error) + 2.0 * fitted < lowest:
            # Each coefficient fits its share of the noise, so correct the variance.
            lowest, least = count * np.log(error) + 2.0 * fitted, error * count / (count - fitted)
            best[:] = a
    return float(least)


@compiled
def _add_reversed(x: Array, k: float) -> None:
    """Add k times the reversed values to the values x, shape (n,), in place."""
    n = len(x)
    for i in range((n + 1) // 2):
        first, last = x[i], x[n - 1 - i]
        x[i] = first + k * last
        x[n - 1 - i] = last + k * first


@compiled
def correlated(x: Array, taps: Array, count: int) -> Array:
    """
    Return the sums of the products of taps, shape (k,), with the values of x from each of `count` places on.

    x, shape (n,): n is at least `count` + k - 1.
    """
    out, whole = np.zeros(count), len(taps) - len(taps) % 4
    # Some taps for all places, then the next taps: the compiler works on several places at once.
    for k in range(0, whole, 4):
        a, b, c, d = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        x_a, x_b, x_c, x_d = x[k:], x[k + 1 :], x[k + 2 :], x[k + 3 :]
        for i in range(count):
            out[i] += (a * x_a[i] + b * x_b[i]) + (c * x_c[i] + d * x_d[i])
    for k in range(whole, len(taps)):
        tap, late = taps[k], x[k:]
        for i in range(count):
            out[i] += tap * late[i]
    return out


@compiled
def filtered(x: Array, taps: Array) -> Array:
    """Return x, shape (n,), after a causal filter. Before its first sample x counts as constant."""
    return correlated(np.concatenate((np.full(len(taps) - 1, x[0]), x)), taps[::-1].copy(), len(x))


@compiled
def steadiness(noise: Array, known: Array) -> Array:
    """
    Return the weight of each sample: small where the noise is large, 0 where the sample is unknown.

    Besides steady noise, pressure has stalls, spikes and starting pumps. Pulses still in the pressure change these
    weights little, whereas `precision` would take the pulses for disturbances.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Whitened noise.
    known : ndarray, shape (n,)
        1 where a sample is known.
    """
    local, usual = _sizes(noise, known)
    # The mean of 25 squares exceeds twice its expectation by chance once in thousands.
    return known * np.minimum(1.0, 2.0 * usual / np.maximum(local, 1e-12))


@compiled
def precision(noise: Array, known: Array) -> Array:
    """
    Return the posterior mean of 1 / variance of each sample; 1 in steady noise, 0 where the sample is unknown.

    The noise is Gaussian. Its variance is the steady one or, in a disturbance, one of five larger ones, and changes
    between them as a Markov chain (L. R. Rabiner, Proc. IEEE 77 (1989) 257, section III).

    Parameters
    ----------
    noise, known
        As in `steadiness`; the noise must be without pulses.
    """
    out = np.empty(len(noise))
    _mean_precision(noise**2 / _sizes(noise, known)[1], known, out)
    return out


@compiled
def median(values: Array) -> float:
    """Return the median of values, shape (n,); for short arrays numpy's own function takes ten times as long."""
    return float(np.median(values))


@compiled
def _sizes(noise: Array, known: Array) -> tuple[Array, float]:
    """Return the mean square of the noise around each sample, and the median of the mean squares."""
    beyond, width = np.zeros(_LOCAL), 2 * _LOCAL + 1
    local = correlated(np.concatenate((beyond, noise**2, beyond)), np.full(width, 1.0 / width), len(noise))
    seen = local[known > 0.0]
    usual = float(np.median(seen)) if len(seen) else 0.0
    return local, max(usual, 1e-6 * local.mean(), 1e-12)


@compiled
def _mean_precision(square: Array, known: Array, out: Array) -> None:
    """
    Fill `out` with the mean of 1 / variance by the forward-backward algorithm.

    square, shape (n,): squared noise over the mean square of the steady noise; known, shape (n,): as in `steadiness`.
    """
    n = len(square)
    likelihood, chance = np.ones((n, _STATES)), np.empty((n, _STATES))
    begun, ended, other = _BEGINS / (_STATES - 1), 0.5 / _LASTS, 0.5 / _LASTS / (_STATES - 1)
    stays, steady = 1.0 - 1.0 / _LASTS, 1.0 - _BEGINS
    now = np.full(_STATES, begun * _LASTS)
    now[0] = 1.0
    for i in range(n):
        if known[i] > 0.0:
            # Each variance is 8 times the next smaller one: square the likelihood three times.
            x, size = math.exp(-0.5 * min(square[i] / _LARGEST, 100.0)), 1.0
            for k in range(_STATES - 1, -1, -1):
                likelihood[i, k] = x * size
                x, size = x * x, size * _SQRT_8
                x *= x
                x *= x
        total = 0.0
        for k in range(_STATES):
            total += now[k]
        mixed = other * (total - now[0]) + begun * now[0]
        quiet, scale = steady * now[0] + ended * (total - now[0]), 1.0 / total
        for k in range(_STATES):
            p = quiet if k == 0 else stays * now[k] + mixed
            now[k] = max(p * scale * likelihood[i, k], 1e-100)
            chance[i, k] = now[k]
    after = np.ones(_STATES)
    for i in range(n - 1, -1, -1):
        total = mean = whole = 0.0
        inverse = 1.0
        for k in range(_STATES):
            p = chance[i, k] * after[k]
            total += p
            mean += p * inverse
            inverse *= 0.125
            after[k] *= likelihood[i, k]
            whole += after[k]
        out[i] = known[i] * mean / total
        first, rest = after[0], whole - after[0]
        mixed, scale = ended * first + other * rest, 1.0 / whole
        for k in range(_STATES):
            p = steady * first + begun * rest if k == 0 else stays * after[k] + mixed
            after[k] = max(p * scale, 1e-100)


def steady_filter(pressure: Array, known: Array, order: int, floor: float) -> Array | None:
    """
    Return the prediction error filter that turns the steady noise into unit variance.

    Returns
    -------
    ndarray, shape (order + 2,), or None
        None if the pressure is constant or mostly unknown.
    """
    # A starting pump outweighs all steady noise; without this weighting the first model would describe the pump.
    weight = steadiness(np.diff(pressure, prepend=pressure[:1]), known)
    for _ in range(_ROUNDS):
        taps, size = prediction_error_filter(pressure, weight, order, floor)
        if size <= 0.0:
            return None
        whitened = filtered(pressure, taps)
        weight = steadiness(whitened, known)
    return np.asarray(taps / np.sqrt(np.sum(weight * whitened**2) / np.sum(weight)))

# SPDX-License-Identifier: Apache-2.0
"""
Noise made white: an autoregressive model of what pulses do not explain, and its prediction error filter.

The model is of the first difference, so that standpipe pressure and its drift drop out, or of the pressure less most of
the value before, which does not lose the low frequencies of a steady pressure. Sources: S. M. Kay, Modern Spectral
Estimation, 1988, section 7.3 (autocorrelation method, Levinson); H. Akaike, A new look at the statistical model
identification, IEEE Trans. Autom. Control 19 (1974) 716 (order: each coefficient costs one nat).
"""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

_LOCAL = 12  # samples to either side over which the size of the noise is judged
_ROUNDS = 3


@compiled
def prediction_error_filter(
    noise: Array, weight: Array, order: int, floor: float, out: Array, kept: float = 1.0
) -> float:
    """
    Filter that turns noise into white noise of unit variance.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses, Pa.
    weight : ndarray, shape (n,)
        0 where a sample is unknown or disturbed, 1 elsewhere.
    order : int
        Highest of the autoregressive model of the difference.
    floor : float
        White noise added to the model, share of its variance: keeps empty bands from being raised.
    out : ndarray, shape (order + 2,)
        Coefficients of the filter, first the newest sample's.
    kept : float
        Share of the sample before in the difference. Below 1 the noise must have no mean.

    Returns
    -------
    float
        Standard deviation of the innovation, Pa; 0 where the noise is a constant.
    """
    n = len(noise)
    lags = np.zeros(order + 1)
    step = np.zeros(n)
    count = 0.0
    for i in range(n):
        count += weight[i] * weight[i]
        if i > 0:
            step[i] = (noise[i] - kept * noise[i - 1]) * weight[i]
    for k in range(order + 1):
        for i in range(1, n - k):
            lags[k] += step[i] * step[i + k]
    out[:] = 0.0
    if count < 2.0 * order or lags[0] <= 0.0:
        return 0.0
    lags /= count
    lags[0] *= 1.0 + floor
    best = np.zeros(order + 1)
    sigma = float(np.sqrt(_predicted(lags, count, best)))
    for i in range(order + 1):
        out[i] += best[i] / sigma
        out[i + 1] -= kept * best[i] / sigma
    return sigma


@compiled
def _predicted(lags: Array, count: float, best: Array) -> float:
    """Innovation variance of the model whose order Akaike's criterion chooses; best: its filter, is filled."""
    a = np.zeros(len(lags))
    work = np.zeros(len(lags))
    a[0] = best[0] = 1.0
    error = least = lags[0]
    lowest = count * np.log(error)
    for m in range(1, len(lags)):
        total = lags[m]
        for i in range(1, m):
            total += a[i] * lags[m - i]
        k = -total / error
        for i in range(1, m):
            work[i] = a[i] + k * a[m - i]
        for i in range(1, m):
            a[i] = work[i]
        a[m] = k
        error *= 1.0 - k * k
        if count * np.log(error) + 2.0 * m < lowest:
            # Each coefficient fits its share of the noise.
            lowest, least = count * np.log(error) + 2.0 * m, error * count / (count - m)
            best[:] = a
    return float(least)


@compiled
def filtered(x: Array, taps: Array, out: Array) -> None:
    """Causal filter; out, shape (n,). Before its first sample x is constant."""
    for i in range(len(x)):
        total = 0.0
        for k in range(len(taps)):
            total += taps[k] * x[max(i - k, 0)]
        out[i] = total


def steadiness(noise: Array, known: Array) -> Array:
    """
    Weight of each sample: less where the noise is larger than elsewhere, 0 where the sample is unknown.

    Pressure has stalls, spikes and pumps that start beside its steady noise; a weight of 1 / variance is right for all.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Whitened, without pulses.
    known : ndarray, shape (n,)
        1 where a sample is known.
    """
    square = noise**2
    local = np.convolve(square, np.ones(2 * _LOCAL + 1) / (2 * _LOCAL + 1), mode="same")
    usual = max(float(np.median(local[known > 0.0])) if np.any(known > 0.0) else 0.0, 1e-6 * float(local.mean()), 1e-12)
    # The mean of 25 squares exceeds twice its mean by chance once in thousands.
    return np.asarray(known * np.minimum(1.0, 2.0 * usual / np.maximum(local, 1e-12)))


def steady_filter(pressure: Array, known: Array, order: int, floor: float) -> Array | None:
    """
    Prediction error filter of the steady noise, for unit variance.

    Returns
    -------
    ndarray, shape (order + 2,), or None
        None where the pressure is a constant or mostly unknown.
    """
    taps, whitened = np.empty(order + 2), np.empty(len(pressure))
    # A pump that starts outweighs all steady noise: a first model that knows it would keep it.
    weight = steadiness(np.diff(pressure, prepend=pressure[:1]), known)
    for _ in range(_ROUNDS):
        if prediction_error_filter(pressure, weight, order, floor, taps) <= 0.0:
            return None
        filtered(pressure, taps, whitened)
        weight = steadiness(whitened, known)
    return np.asarray(taps / np.sqrt(np.sum(weight * whitened**2) / np.sum(weight)))

# SPDX-License-Identifier: Apache-2.0
"""
Response of the channel to one pulse, estimated from pulses with known or believed places.

The valve makes a rectangle of 2 TU. The impulse response of line and gauge is modelled as a Gaussian process: rough at
the arrival of the impulse, smoother later, and decaying. The pulse response is then a Gaussian process too, with the
corners of the rectangle in it. Only its largest components are estimated, so a few pulses suffice; the estimate is the
posterior mean (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, section 2.1).
"""

from __future__ import annotations

import functools
import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.pulse import trellis
from mwd_surface.receiver.whitening import correlated

SAMPLES_PER_TU = 4
BEFORE = 12  # samples of the response before the nominal edge, for a slow rise and a timing error of the sync
# Length of the response: echoes of the string arrive within 2 depth / speed, and the line relaxes over seconds.
_RESPONSE_S = 15.0
_LEAST_TU, _MOST_TU = 24, 120
_PULSE = 2 * SAMPLES_PER_TU  # length of a pulse, samples
# Spread of the arrival before the nominal time, 1 sigma: timing error of a sync, samples, and travel through km of mud,
# s.
_EARLY_SAMPLES, _EARLY_S = 1.5, 0.2
# Decay after the arrival: time constant of the fast decay (friction and echoes near the gauge), s; share and time
# constant, s, of the slow decay (relaxation of the line).
_NEAR_S, _SLOW, _SLOW_S = 0.3, 0.1, 8.0
# Correlation length at the arrival, samples; after _SMOOTHER times this length the correlation length has doubled,
# because friction damps high frequencies first.
_ROUGH, _SMOOTHER = 1.5, 3.0
_FEW = 1e-3  # expected number of pulses below which a term is skipped
LAGS = 20  # largest distance between two possible places of one pulse, TU
_LEAST = 3e-4  # share of the largest variance below which components are dropped


def response_length(tu_s: float) -> int:
    """Return the length of the response, samples, for a time unit in s."""
    return SAMPLES_PER_TU * min(max(round(_RESPONSE_S / tu_s), _LEAST_TU), _MOST_TU)


@functools.cache
def basis(length: int, tu_s: float) -> Array:
    """
    Return the components of the response.

    Parameters
    ----------
    length : int
        Number of samples of the response.
    tu_s : float
        Time unit of the tool.

    Returns
    -------
    ndarray, shape (components, length)
        Components, each scaled by its standard deviation so that all coefficients have equal variance.
    """
    at = np.arange(length, dtype=float) - BEFORE
    step_s = tu_s / SAMPLES_PER_TU
    early, late = np.minimum(at, 0.0), np.maximum(at, 0.0)
    near = np.exp(-0.5 * early**2 / (_EARLY_SAMPLES**2 + (_EARLY_S / step_s) ** 2) - late * step_s / _NEAR_S)
    size = (1.0 - _SLOW) * near + np.where(at < 0.0, near, np.exp(-late * step_s / _SLOW_S)) * _SLOW
    size *= np.minimum((at + BEFORE + 1.0) / 4.0, 1.0) * np.minimum((length - BEFORE - at) / 12.0, 1.0)
    lag = early + _SMOOTHER * np.log1p(late / _SMOOTHER)
    impulse = size[:, None] * size * np.exp(-0.5 * ((lag[:, None] - lag) / _ROUGH) ** 2)
    # Integrate over the time that the valve is closed (trapezoidal rule).
    since = at[:, None] - at
    pulse = np.where((since >= 0.0) & (since <= _PULSE), 1.0, 0.0) - 0.5 * ((since == 0.0) | (since == _PULSE))
    covariance = pulse @ impulse @ pulse.T
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST * values[-1]
    # The sign of an eigenvector is arbitrary; fix it, so that results do not depend on the linear algebra library.
    vectors = vectors[:, kept][:, ::-1]
    vectors = vectors * np.sign(vectors[np.argmax(np.abs(vectors), axis=0), np.arange(vectors.shape[1])])
    return np.ascontiguousarray((vectors * np.sqrt(values[kept][::-1])).T)


@compiled
def whitened_responses(responses: Array, whitener: Array, count: int) -> Array:
    """
    Return the first samples of responses, shape (c, m), after a prediction error filter; shape (c, count).

    whitener, shape (k,): coefficients; the first belongs to the newest sample. `count` is at most m + k - 1.
    """
    beyond, turned, out = np.zeros(len(whitener) - 1), whitener[::-1].copy(), np.empty((len(responses), count))
    for a in range(len(responses)):
        out[a] = correlated(np.concatenate((beyond, responses[a], beyond)), turned, count)
    return out


@compiled
def pulse_columns(train: Array, shapes: Array) -> Array:
    """
    Return the whitened pressure of a train of pulses for each component of the response.

    Parameters
    ----------
    train : ndarray, shape (n,)
        Expected number of edges at each sample.
    shapes : ndarray, shape (c, m)
        Whitened components, which begin `BEFORE` samples before the edge.

    Returns
    -------
    ndarray, shape (n, c)
    """
    n, (c, m) = len(train), shapes.shape
    turned, columns = np.ascontiguousarray(shapes.T).ravel(), np.zeros(n * c)
    for i in range(n):
        if abs(train[i]) > 1e-4:
            # One loop over all components of all samples, because the compiler then computes several values at once.
            first, end = max(i - BEFORE, 0), min(i - BEFORE + m, n)
            size, out, pulse = train[i], columns[c * first : c * end], turned[c * (first - i + BEFORE) :]
            for k in range(len(out)):
                out[k] += size * pulse[k]
    return columns.reshape(n, c)


@compiled
def normal_equations(columns: Array, whitened: Array, weight: Array) -> tuple[Array, Array]:
    """
    Return the normal equations of the coefficients.

    Parameters
    ----------
    columns : ndarray, shape (n, c)
        Pressure for each component, from `pulse_columns`.
    whitened : ndarray, shape (n,)
        Whitened pressure.
    weight : ndarray, shape (n,)
        Weight of each sample.

    Returns
    -------
    ndarray, shape (c, c)
        Matrix.
    ndarray, shape (c,)
        Right side.
    """
    n, c = columns.shape
    matrix, right = np.zeros((c, c)), np.zeros(c)
    for j in range(n):
        w = weight[j]
        if w > 0.0:
            for a in range(c):
                x = w * columns[j, a]
                right[a] += x * whitened[j]
                for b in range(a + 1):
                    matrix[a, b] += x * columns[j, b]
    for a in range(c):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, right


@compiled
def coefficients(matrix: Array, right: Array, scale: float) -> tuple[Array, float, Array]:
    """
    Return the posterior of the coefficients and their re-estimated scale.

    Parameters
    ----------
    matrix, right : ndarray, shapes (c, c), (c,)
        Normal equations of whitened data.
    scale : float
        Prior standard deviation of the coefficients, Pa.

    Returns
    -------
    ndarray, shape (c,)
        Coefficients, Pa.
    float
        Standard deviation of the coefficients, re-estimated by expectation-maximisation.
    ndarray, shape (c, c)
        Posterior covariance of the coefficients, Pa^2.
    """
    count = len(right)
    inverse = matrix.copy()
    for a in range(count):
        inverse[a, a] += 1.0 / scale**2
    # Gauss-Jordan elimination in place; a positive definite matrix needs no other order of the pivots.
    for k in range(count):
        pivot = 1.0 / inverse[k, k]
        inverse[k, k] = 1.0
        for b in range(count):
            inverse[k, b] *= pivot
        for a in range(count):
            if a != k:
                share = inverse[a, k]
                inverse[a, k] = 0.0
                for b in range(count):
                    inverse[a, b] -= share * inverse[k, b]
    u, size = np.zeros(count), 0.0
    for a in range(count):
        for b in range(count):
            u[a] += inverse[a, b] * right[b]
        size += u[a] * u[a] + inverse[a, a]
    return u, math.sqrt(size / count), inverse


@compiled
def pulse_places(packets: Indices, chance: Array, start: int, least: float) -> Array:
    """
    Return the possible places of the pulses of packets, and their probabilities; shape (j, 3), as in `place_pairs`.

    packets, shape (k, 5): as in `trellis.forward_backward`, from the sample `start` on; chance, shape (k, values):
    probability of each value. Values with a probability of at most `least` are left out.
    """
    rows, found = np.empty((chance.size, 3)), 0
    for k in range(len(packets)):
        window = start + SAMPLES_PER_TU * packets[k, trellis.START]
        for value in range(packets[k, trellis.COUNT]):
            if chance[k, value] > least:
                rows[found, 0] = start + SAMPLES_PER_TU * trellis.place(packets, k, value)
                rows[found, 1], rows[found, 2] = chance[k, value], window
                found += 1
    return rows[:found].copy()


@compiled
def place_pairs(pulses: Array, weight: Array) -> Array:
    """
    Return the sums of the products of the probabilities of two places of one pulse, by the distance of the places.

    Parameters
    ----------
    pulses : ndarray, shape (j, 3)
        Place, samples; its probability; first sample of the window, which is the same for all places of one pulse. The
        places of a pulse follow each other.
    weight : ndarray, shape (n,)
        Weight of each sample.

    Returns
    -------
    ndarray, shape (LAGS,)
        Sums by distance, TU, weighted by the samples of each pulse.
    """
    out = np.zeros(LAGS)
    for a in range(len(pulses)):
        first = round(pulses[a, 0])
        known = weight[first : first + _PULSE].sum() / _PULSE if first >= 0 else 0.0
        b = a - 1
        while b >= 0 and pulses[b, 2] == pulses[a, 2]:
            gap = round(abs(pulses[a, 0] - pulses[b, 0]) / SAMPLES_PER_TU)
            if gap < len(out):
                out[gap] += known * pulses[a, 1] * pulses[b, 1]
            b -= 1
    return out


def spread(pairs: Array, shapes: Array) -> Array:
    """
    Return the covariance that uncertain pulse places add to the normal equations of expected pulses.

    Without it, a response estimated from places chosen in noise grows with that noise (A. P. Dempster et al., J. R.
    Stat. Soc. B 39 (1977) 1).

    Parameters
    ----------
    pairs : ndarray, shape (..., k)
        Sums from `place_pairs`.
    shapes : ndarray, shape (c, m)
        Whitened components.

    Returns
    -------
    ndarray, shape (..., c, c)
    """
    out = np.zeros((*pairs.shape[:-1], len(shapes), len(shapes)))
    gram = shapes @ shapes.T
    # A gap of 0 adds nothing: both pulses are at one place.
    for gap in 1 + np.flatnonzero(np.atleast_2d(pairs)[:, 1:].max(axis=0) > _FEW):
        k = SAMPLES_PER_TU * int(gap)
        common = shapes[:, k:] @ shapes[:, :-k].T
        out += pairs[..., gap, None, None] * (2.0 * gram - common - common.T)
    return out


@compiled
def reconstruct(train: Array, response: Array) -> Array:
    """
    Return the pressure of a train of pulses, shape (n,).

    train, shape (n,): expected number of edges at each sample; response, shape (m,): begins `BEFORE` samples before the
    edge.
    """
    return pulse_columns(train, response.reshape(1, -1)).ravel()


@compiled
def matched(whitened: Array, weight: Array, response: Array, start: int, count: int) -> tuple[Array, Array]:
    """
    Return the output of the matched filter at each TU.

    Parameters
    ----------
    whitened, weight : ndarray, shape (n,)
        Whitened pressure and the weight of each sample.
    response : ndarray, shape (m,)
        Whitened response, which begins `BEFORE` samples before the edge.
    start : int
        Sample of the first place.
    count : int
        Number of places.

    Returns
    -------
    ndarray, shape (count,)
        Correlation at each place.
    ndarray, shape (count,)
        Energy of the response under the weights at that place.
    """
    begin, end = start - BEFORE, start - BEFORE + SAMPLES_PER_TU * (count - 1) + len(response)
    before, after = np.zeros(max(-begin, 0)), np.zeros(max(end - len(weight), 0))
    here = slice(max(begin, 0), max(end, 0))
    near = np.concatenate((before, weight[here], after))
    folded = np.concatenate((before, weight[here] * whitened[here], after))
    places = SAMPLES_PER_TU * (count - 1) + 1
    out, energy = correlated(folded, response, places), correlated(near, response**2, places)
    return out[::SAMPLES_PER_TU].copy(), energy[::SAMPLES_PER_TU].copy()


@compiled
def common_energy(response: Array, places: int) -> Array:
    """
    Return the common energy of two pulses at each distance 0, 1, 2 ... TU, shape (places,).

    response, shape (m,): whitened response to a pulse.
    """
    count = SAMPLES_PER_TU * places
    return correlated(np.concatenate((response, np.zeros(count))), response, count)[::SAMPLES_PER_TU].copy()

# SPDX-License-Identifier: Apache-2.0
"""
Removal of pump noise: narrow spectral lines, at harmonics of counted strokes or found without a counter.

Strokes make lines at their multiples, strongest at 3, 6 and 9 times the rate of a triplex pump. A line is demodulated,
averaged over some pulse widths and subtracted. Variations faster than the average are left to the noise model.
Source: B. Widrow et al., Adaptive noise cancelling, Proc. IEEE 63 (1975) 1692 (a notch that follows its line).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.whitening import median, prediction_error_filter

# Power over the spectral floor above which a line is subtracted. Weaker lines are left to the noise model, which
# handles them better: with pulses of 0.3 s the lines lie within the spectrum of the pulses, and a lower limit lost
# words with healthy pumps.
_STANDS_OUT = 200.0
_MOST_LINES = 16  # largest number of lines
# Lowest power of a line relative to the power of the noise in the average of the line. Subtracting a weaker line adds
# more noise than it removes.
_COHERENT = 4.0
# Harmonics of counted strokes: their number, their upper limit as a share of the highest frequency, and the factor of
# the averaging time relative to uncounted lines. The time is longer, because the counter follows the rate of the pump;
# with a factor of 3, a quarter more words with pulses of 0.3 s are lost.
_MOST_HARMONICS, _HIGHEST, _STROKES_HOLD = 12, 0.9, 1.5
# Order and floor of the noise model by which the lines with and without strokes are compared.
_ORDER, _FLOOR = 24, 1e-6
_NEIGHBOURHOOD = 32  # bins over which the floor of the spectrum is estimated
_BLOCK = 16  # samples that are averaged before smoothing
# 1 sigma of the Gaussian average: 24 TU while pulses are still in the pressure, and 10 s, over which pumps hold their
# rate, once the pulses are known and cannot be taken for a line.
SEARCH_SAMPLES = 96.0
STEADY_S = 10.0


@functools.lru_cache(maxsize=64)
def _window(length: int) -> Array:
    return np.asarray(np.hanning(length))


def line_frequencies(
    noise: Array, stands_out: float = _STANDS_OUT, band: tuple[float, float] = (0.0, math.pi)
) -> Array:
    """
    Return the frequencies of the spectral lines in the noise, strongest first.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Samples without the signal of the tool.
    stands_out : float
        Least ratio of the power of a line to the spectral floor.
    band : (float, float)
        Lowest and highest frequency, rad per sample.

    Returns
    -------
    ndarray, shape (k,)
        Frequencies, rad per sample, at most `_MOST_LINES`; none if the samples are too few to find the floor.
    """
    # The first difference removes the slope of 1/f noise, so that the noise floor is flat.
    step = np.diff(noise)
    whole = scipy.fft.next_fast_len(max(len(step), 1), real=True)
    count = (whole // 2 + 1) // _NEIGHBOURHOOD
    if count < 3:
        return np.zeros(0)
    power = np.abs(np.fft.rfft((step - step.mean()) * _window(len(step)), whole)) ** 2
    floors = np.array([median(one) for one in power[: count * _NEIGHBOURHOOD].reshape(count, _NEIGHBOURHOOD)])
    at = (np.arange(count) + 0.5) * _NEIGHBOURHOOD
    floor = np.interp(np.arange(len(power)), at, floors)
    inner = power[2:-2]
    peak = (inner >= power[1:-3]) & (inner >= power[3:-1]) & (inner > power[:-4]) & (inner > power[4:])
    found = 2 + np.flatnonzero(peak & (inner > stands_out * floor[2:-2]))
    low, high = np.array(band) * whole / (2.0 * math.pi)
    found = found[(found >= low) & (found <= high)]
    found = found[np.argsort(-power[found] / np.maximum(floor[found], 1e-300), kind="stable")][:_MOST_LINES]
    # Interpolate the frequency of a Hann-windowed line from the amplitudes next to its largest one.
    left, middle, right = (np.sqrt(power[found + k]) for k in (-1, 0, 1))
    share = (right - left) / (2.0 * middle - left - right + 1e-300)
    return np.asarray(2.0 * math.pi * (found + 0.5 * np.clip(share, -1.0, 1.0)) / whole)


@compiled
def turning(omega: float, cosine: Array, sine: Array) -> None:
    """Fill cosine and sine, shape (n,), of an angle that advances by omega rad per sample."""
    turn_c, turn_s = math.cos(omega), math.sin(omega)
    c, s = 1.0, 0.0
    for i in range(len(cosine)):
        # Advance by rotation within a block: accurate enough, and much faster than calling cos and sin.
        if i % _BLOCK == 0:
            c, s = math.cos(omega * i), math.sin(omega * i)
        cosine[i], sine[i] = c, s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


@compiled
def subtract_line(noise: Array, known: Array, cosine: Array, sine: Array, memory: float, out: Array) -> None:
    """
    Subtract one spectral line, if the line is stronger than the noise around it.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses and its mean, Pa; the line is subtracted from it in place.
    known : ndarray, shape (n,)
        Weight of each sample.
    cosine, sine : ndarray, shape (n,)
        Cosine and sine of the phase angle of the line.
    memory : float
        1 sigma of the Gaussian window of the average, samples.
    out : ndarray, shape (n,)
        The subtracted line is added to it.
    """
    n = len(noise)
    count = n // _BLOCK
    if count < 2:
        return
    in_phase, across, weight = np.zeros(count), np.zeros(count), np.zeros(count)
    for b in range(count):
        c = s = w = 0.0
        for i in range(b * _BLOCK, (b + 1) * _BLOCK):
            x = 2.0 * known[i] * noise[i]
            c += x * cosine[i]
            s += x * sine[i]
            w += known[i]
        in_phase[b], across[b], weight[b] = c, s, w
    sigma = memory / _BLOCK
    reach = int(3.0 * sigma)
    falls = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    smooth_c, smooth_s, total = np.zeros(count), np.zeros(count), np.zeros(count)
    for j in range(count):
        # Views that start at 0 let the compiler work on several blocks at once.
        near = slice(max(j - reach, 0), min(j + reach + 1, count))
        near_c, near_s, near_total, g = smooth_c[near], smooth_s[near], total[near], falls[reach + near.start - j :]
        for b in range(len(near_c)):
            near_c[b] += g[b] * in_phase[j]
            near_s[b] += g[b] * across[j]
            near_total[b] += g[b] * weight[j]
    line = raw = 0.0
    for b in range(count):
        if total[b] > 0.0:
            smooth_c[b] /= total[b]
            smooth_s[b] /= total[b]
        line += weight[b] * (smooth_c[b] ** 2 + smooth_s[b] ** 2)
        raw += (in_phase[b] ** 2 + across[b] ** 2) / max(weight[b], 1.0)
    # The average of noise alone has a share of 1 / (2 sqrt(pi) sigma) of the power of the noise.
    if line * 2.0 * math.sqrt(math.pi) * sigma < _COHERENT * max(raw - line, 0.0):
        return
    # Between the middles of two blocks the line changes evenly; before the first and after the last it is constant.
    for b in range(count + 1):
        left, right, middle = max(b - 1, 0), min(b, count - 1), _BLOCK * b - _BLOCK // 2
        for i in range(max(middle, 0), middle + _BLOCK if b < count else n):
            share = (i - middle + 0.5) / _BLOCK
            one = (smooth_c[left] * (1.0 - share) + smooth_c[right] * share) * cosine[i]
            one += (smooth_s[left] * (1.0 - share) + smooth_s[right] * share) * sine[i]
            noise[i] -= one
            out[i] += one


class Crank(NamedTuple):
    """Rotation of a pump, from its counted strokes."""

    #: `cosine`, `sine`: shape (n,); cosine and sine of the crank angle; both are 0 where the angle is unknown.
    cosine: Array
    sine: Array
    harmonics: int  #: number of harmonics below a share of the highest frequency in the samples


def crank(angle: Array) -> Crank:
    """Return the rotation of a pump from its crank angle, rad, shape (n,); NaN where the angle is unknown."""
    steps = np.diff(angle)
    steps = steps[np.isfinite(steps)]
    highest = int(_HIGHEST * math.pi / max(median(steps), 1e-9)) if len(steps) else 0
    return Crank(*_cosines(angle), min(highest, _MOST_HARMONICS))


@compiled
def _cosines(angle: Array) -> tuple[Array, Array]:
    """Return cosine and sine of an angle; both are 0 where the angle is not finite."""
    cosine, sine = np.zeros(len(angle)), np.zeros(len(angle))
    for i in range(len(angle)):
        if math.isfinite(angle[i]):
            cosine[i], sine[i] = math.cos(angle[i]), math.sin(angle[i])
    return cosine, sine


def pump_noise(
    noise: Array, known: Array, memory: float = SEARCH_SAMPLES, angles: Array | None = None
) -> tuple[Array, list[Crank]]:
    """
    Return the sum of all pump lines, and the pumps whose counted strokes were used.

    The strokes are used if the lines are better with them than without.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses, Pa.
    known : ndarray, shape (n,)
        Weight of each sample, 0 to 1.
    memory : float
        1 sigma of the Gaussian window of the average, as in `subtract_line`.
    angles : ndarray, shape (pumps, n), optional
        Crank angles from counted strokes, rad; NaN where a pump's angle is unknown.

    Returns
    -------
    ndarray, shape (n,)
        Pressure caused by the pumps, Pa.
    list of Crank
        The pumps with strokes; empty if the strokes were not used.
    """
    plain = lines(noise, known, memory)
    if angles is None or not len(angles):
        return plain, []
    # If the counter has jitter, or two pumps have nearly the same rate, subtraction with the strokes can be worse than
    # without them.
    cranks = [crank(angle) for angle in angles]
    counted = lines(noise, known, memory, cranks)
    root = np.sqrt(known)
    unexplained = [prediction_error_filter(noise - one, root, _ORDER, _FLOOR)[1] for one in (plain, counted)]
    # The fitted harmonics also follow noise; estimate the share of its variance that their coefficients explain.
    fitted = 2.0 * _MOST_HARMONICS * len(angles) * len(noise) / (2.0 * math.sqrt(math.pi) * _STROKES_HOLD * memory)
    share = 1.0 - min(fitted / max(float(known.sum()), 1.0), 0.5)
    return (counted, cranks) if unexplained[1] ** 2 < share * unexplained[0] ** 2 else (plain, [])


def lines(noise: Array, known: Array, memory: float, cranks: Sequence[Crank] = ()) -> Array:
    """
    Return the sum, Pa, of the harmonics of counted strokes and of the lines found in the remaining noise, shape (n,).

    Arguments as in `pump_noise`.
    """
    out = np.zeros(len(noise))
    rest = noise - np.mean(noise)
    for one in cranks:
        _subtract_harmonics(rest, known, *one, _STROKES_HOLD * memory, out)
    cosine, sine = np.empty(len(noise)), np.empty(len(noise))
    for omega in line_frequencies(rest):
        turning(float(omega), cosine, sine)
        subtract_line(rest, known, cosine, sine, memory, out)
    return out


@compiled
def _subtract_harmonics(
    rest: Array, known: Array, turn_c: Array, turn_s: Array, harmonics: int, memory: float, out: Array
) -> None:
    """
    Subtract the first harmonics of a crank from `rest` and add them to `out`, both shape (n,), in place.

    turn_c, turn_s: cosine and sine, as in `Crank`; other arguments as in `subtract_line`.
    """
    runs = np.where((turn_c == 0.0) & (turn_s == 0.0), 0.0, known)
    cosine, sine = turn_c.copy(), turn_s.copy()
    for _ in range(harmonics):
        subtract_line(rest, runs, cosine, sine, memory, out)
        for i in range(len(rest)):
            c = cosine[i]
            cosine[i], sine[i] = c * turn_c[i] - sine[i] * turn_s[i], c * turn_s[i] + sine[i] * turn_c[i]

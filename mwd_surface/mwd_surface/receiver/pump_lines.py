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
from mwd_surface.receiver.whitening import FLOOR, ORDER, correlated, prediction_error_filter

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
    if (whole // 2 + 1) // _NEIGHBOURHOOD < 3:
        return np.zeros(0)
    power = np.abs(np.fft.rfft((step - step.mean()) * _window(len(step)), whole)) ** 2
    low, high = (edge * whole / (2.0 * math.pi) for edge in band)
    return np.asarray(2.0 * math.pi / whole * _peaks(power, stands_out, low, high, _MOST_LINES))


@compiled
def _peaks(power: Array, stands_out: float, low: float, high: float, most: int) -> Array:
    """
    Return the places, bins, of at most `most` lines between two places, strongest first.

    power, shape (n,): spectrum of the noise with a Hann window; stands_out: as in `line_frequencies`.
    """
    count = len(power) // _NEIGHBOURHOOD
    floors = np.array([np.median(power[k * _NEIGHBOURHOOD : (k + 1) * _NEIGHBOURHOOD]) for k in range(count)])
    places, ratios, found = np.zeros(most + 1), np.zeros(most + 1), 0
    for k in range(max(math.ceil(low), 2), min(math.floor(high), len(power) - 3) + 1):
        if power[k] < max(power[k - 1], power[k + 1]) or power[k] <= max(power[k - 2], power[k + 2]):
            continue
        # The floor changes evenly between the middles of two neighbourhoods.
        middle = min(max(k / _NEIGHBOURHOOD - 0.5, 0.0), count - 1.0)
        below = min(int(middle), count - 2)
        floor = floors[below] + (middle - below) * (floors[below + 1] - floors[below])
        if power[k] <= stands_out * floor:
            continue
        # Interpolate the place of a Hann-windowed line from the amplitudes next to its largest one.
        left, largest, right = math.sqrt(power[k - 1]), math.sqrt(power[k]), math.sqrt(power[k + 1])
        share = (right - left) / (2.0 * largest - left - right + 1e-300)
        place, ratio, at = k + 0.5 * min(max(share, -1.0), 1.0), power[k] / max(floor, 1e-300), found
        while at > 0 and ratios[at - 1] < ratio:
            places[at], ratios[at] = places[at - 1], ratios[at - 1]
            at -= 1
        places[at], ratios[at] = place, ratio
        found = min(found + 1, most)
    return places[:found].copy()


@compiled
def _turning(omega: float, cosine: Array, sine: Array) -> None:
    """Fill cosine and sine, shape (n,), of an angle that advances by omega rad per sample."""
    turn_c, turn_s = math.cos(omega), math.sin(omega)
    c, s = 1.0, 0.0
    for i in range(len(cosine)):
        # Advance by rotation within a block: accurate enough, and much faster than calling cos and sin.
        if i % _BLOCK == 0:
            c, s = math.cos(omega * i), math.sin(omega * i)
        cosine[i], sine[i] = c, s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


class LineAverage(NamedTuple):
    """Gaussian average of a line over blocks of samples."""

    falls: Array  #: shape (2 reach + 1,); weight of a block by its distance
    #: `weight`, `total`: shape (blocks,); sum of the weights of the samples of each block, and its Gaussian average.
    weight: Array
    total: Array
    sigma: float  #: 1 sigma of the average, blocks


@compiled
def _average(known: Array, memory: float) -> LineAverage:
    """Return the average over samples with the weights `known`, shape (n,); memory: 1 sigma, samples."""
    sigma, count = memory / _BLOCK, len(known) // _BLOCK
    reach = int(3.0 * sigma)
    falls = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weight = np.zeros(count)
    for b in range(count):
        for i in range(b * _BLOCK, (b + 1) * _BLOCK):
            weight[b] += known[i]
    return LineAverage(falls, weight, _smooth(weight, falls), sigma)


@compiled
def _smooth(blocks: Array, falls: Array) -> Array:
    """Return the sums of the blocks around each block, weighted by `falls`."""
    beyond = np.zeros(len(falls) // 2)
    return correlated(np.concatenate((beyond, blocks, beyond)), falls, len(blocks))


@compiled
def _subtract_line(noise: Array, known: Array, cosine: Array, sine: Array, average: LineAverage, out: Array) -> bool:
    """
    Subtract one spectral line, if the line is stronger than the noise around it; return whether it was subtracted.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses and its mean, Pa; the line is subtracted from it in place.
    known : ndarray, shape (n,)
        Weight of each sample.
    cosine, sine : ndarray, shape (n,)
        Cosine and sine of the phase angle of the line.
    average : LineAverage
        Average for these weights.
    out : ndarray, shape (n,)
        The subtracted line is added to it.
    """
    weight, total = average.weight, average.total
    n, count = len(noise), len(weight)
    if count < 2:
        return False
    in_phase, across = np.zeros(count), np.zeros(count)
    for b in range(count):
        c = s = 0.0
        for i in range(b * _BLOCK, (b + 1) * _BLOCK):
            x = 2.0 * known[i] * noise[i]
            c += x * cosine[i]
            s += x * sine[i]
        in_phase[b], across[b] = c, s
    smooth_c, smooth_s = _smooth(in_phase, average.falls), _smooth(across, average.falls)
    line = raw = 0.0
    for b in range(count):
        if total[b] > 0.0:
            smooth_c[b] /= total[b]
            smooth_s[b] /= total[b]
        line += weight[b] * (smooth_c[b] ** 2 + smooth_s[b] ** 2)
        raw += (in_phase[b] ** 2 + across[b] ** 2) / max(weight[b], 1.0)
    # The average of noise alone has a share of 1 / (2 sqrt(pi) sigma) of the power of the noise.
    if line * 2.0 * math.sqrt(math.pi) * average.sigma < _COHERENT * max(raw - line, 0.0):
        return False
    # Between the middles of two blocks the line changes evenly; before the first and after the last it is constant.
    size_c, size_s = np.empty(n), np.empty(n)
    for b in range(count + 1):
        left, right, middle = max(b - 1, 0), min(b, count - 1), _BLOCK * b - _BLOCK // 2
        begin, end = max(middle, 0), middle + _BLOCK if b < count else n
        near_c, near_s = size_c[begin:end], size_s[begin:end]
        for i in range(end - begin):
            share = (i + begin - middle + 0.5) / _BLOCK
            near_c[i] = smooth_c[left] * (1.0 - share) + smooth_c[right] * share
            near_s[i] = smooth_s[left] * (1.0 - share) + smooth_s[right] * share
    for i in range(n):
        one = size_c[i] * cosine[i] + size_s[i] * sine[i]
        noise[i] -= one
        out[i] += one
    return True


class Crank(NamedTuple):
    """Rotation of a pump, from its counted strokes."""

    #: `cosine`, `sine`: shape (n,); cosine and sine of the crank angle; both are 0 where the angle is unknown.
    cosine: Array
    sine: Array
    harmonics: int  #: number of harmonics below a share of the highest frequency in the samples
    turn: float  #: median advance of the crank angle, rad per sample


@compiled
def crank(angle: Array) -> Crank:
    """Return the rotation of a pump from its crank angle, rad, shape (n,); NaN where the angle is unknown."""
    cosine, sine, harmonics, turn = np.zeros(len(angle)), np.zeros(len(angle)), 0, 0.0
    for i in range(len(angle)):
        if math.isfinite(angle[i]):
            cosine[i], sine[i] = math.cos(angle[i]), math.sin(angle[i])
    steps = angle[1:] - angle[:-1]
    steps = steps[np.isfinite(steps)]
    if len(steps):
        turn = max(np.median(steps), 1e-9)
        harmonics = min(int(_HIGHEST * math.pi / turn), _MOST_HARMONICS)
    return Crank(cosine, sine, harmonics, turn)


class PumpNoise(NamedTuple):
    """Pressure of the pumps, and the lines it consists of."""

    pressure: Array  #: shape (n,); Pa
    #: Shape (k, 2); frequency of each line, rad per sample, and weight with which a sample enters the size of the line
    #: at the same sample.
    lines: Array


def pump_noise(
    noise: Array, known: Array, memory: float = SEARCH_SAMPLES, angles: Array | None = None
) -> tuple[PumpNoise, list[Crank]]:
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
        1 sigma of the Gaussian window of the average, as in `LineAverage`.
    angles : ndarray, shape (pumps, n), optional
        Crank angles from counted strokes, rad; NaN where a pump's angle is unknown.

    Returns
    -------
    PumpNoise
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
    unexplained = [
        prediction_error_filter(noise - one.pressure, root, ORDER, FLOOR, None, True)[1] for one in (plain, counted)
    ]
    # The fitted harmonics also follow noise; estimate the share of its variance that their coefficients explain.
    fitted = 2.0 * _MOST_HARMONICS * len(angles) * len(noise) / (2.0 * math.sqrt(math.pi) * _STROKES_HOLD * memory)
    share = 1.0 - min(fitted / max(float(known.sum()), 1.0), 0.5)
    return (counted, cranks) if unexplained[1] ** 2 < share * unexplained[0] ** 2 else (plain, [])


def lines(noise: Array, known: Array, memory: float, cranks: Sequence[Crank] = ()) -> PumpNoise:
    """
    Return the sum of the harmonics of counted strokes and of the lines found in the remaining noise.

    Arguments as in `pump_noise`.
    """
    out = np.zeros(len(noise))
    rest = noise - noise.mean()
    used = []
    for one in cranks:
        found = _subtract_harmonics(rest, known, one, _STROKES_HOLD * memory, out)
        used.append((found, np.full(len(found), _own_weight(_STROKES_HOLD * memory))))
    found = _subtract_lines(rest, known, line_frequencies(rest), memory, out)
    used.append((found, np.full(len(found), _own_weight(memory))))
    return PumpNoise(out, np.concatenate([np.column_stack(one) for one in used]))


def _own_weight(memory: float) -> float:
    """Return the weight of a sample in the average of a line at this sample; memory: as in `pump_noise`."""
    return 2.0 / (math.sqrt(2.0 * math.pi) * memory)


@compiled
def _subtract_lines(rest: Array, known: Array, omegas: Array, memory: float, out: Array) -> Array:
    """
    Subtract lines of given frequencies, rad per sample, from `rest` and add them to `out`, both shape (n,), in place.

    Other arguments as in `pump_noise`. Return the frequencies of the lines that were subtracted.
    """
    average, cosine, sine = _average(known, memory), np.empty(len(rest)), np.empty(len(rest))
    used = np.zeros(len(omegas), dtype=np.bool_)
    for k in range(len(omegas)):
        _turning(omegas[k], cosine, sine)
        used[k] = _subtract_line(rest, known, cosine, sine, average, out)
    return omegas[used]


@compiled
def _subtract_harmonics(rest: Array, known: Array, pump: Crank, memory: float, out: Array) -> Array:
    """
    Subtract the first harmonics of a crank from `rest` and add them to `out`, both shape (n,), in place.

    Other arguments as in `pump_noise`. Return the frequencies of the harmonics that were subtracted, rad per sample.
    """
    turn_c, turn_s = pump.cosine, pump.sine
    runs = np.where((turn_c == 0.0) & (turn_s == 0.0), 0.0, known)
    average, cosine, sine = _average(runs, memory), turn_c.copy(), turn_s.copy()
    used = np.zeros(pump.harmonics, dtype=np.bool_)
    for k in range(pump.harmonics):
        used[k] = _subtract_line(rest, runs, cosine, sine, average, out)
        for i in range(len(rest)):
            c = cosine[i]
            cosine[i], sine[i] = c * turn_c[i] - sine[i] * turn_s[i], c * turn_s[i] + sine[i] * turn_c[i]
    return pump.turn * (1.0 + np.flatnonzero(used).astype(np.float64))

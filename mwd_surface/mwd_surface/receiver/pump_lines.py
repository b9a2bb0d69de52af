"""
Pump noise taken out: narrow lines of the spectrum, found without a stroke counter and followed in amplitude and phase.

Strokes make lines at their multiples, strongest at 3, 6, 9 x of a triplex. A line is demodulated, averaged over some
pulse widths and subtracted; what hunts faster than the average stays for the noise model.
Source: B. Widrow et al., Adaptive noise cancelling, Proc. IEEE 63 (1975) 1692 (a notch that follows its line).
"""

from __future__ import annotations

import functools
import math

import numpy as np
from scipy.fft import next_fast_len

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Lines weaker than this multiple of the floor are left to the noise model, which then does better: with pulses of
# 0.3 s lines lie among the pulses' own spectrum, and a lower bound lost words of healthy pumps.
_STANDS_OUT = 200.0
_MOST_LINES = 16
_NEIGHBOURHOOD = 32  # bins over which the floor of the spectrum is judged
_BLOCK = 16  # samples averaged first
# 1 sigma of the Gaussian average: over 24 TU where pulses are still in the pressure; 10 s, for which pumps hold their
# strokes, where they are known and cannot be taken for a line.
SEARCH_SAMPLES = 96.0
STEADY_S = 10.0


@functools.lru_cache(maxsize=64)
def _window(length: int) -> Array:
    return np.asarray(np.hanning(length))


def line_frequencies(noise: Array) -> Array:
    """
    Frequencies of the lines, strongest first.

    noise, shape (n,): pressure without its pulses, Pa. Returns shape (k,), radians a sample.
    """
    # The first difference takes the slope of 1/f noise out, so that the floor is even.
    step = np.diff(noise)
    whole = next_fast_len(len(step), real=True)
    power = np.abs(np.fft.rfft((step - step.mean()) * _window(len(step)), whole)) ** 2
    count = len(power) // _NEIGHBOURHOOD
    if count < 3:
        return np.zeros(0)
    floors = np.median(power[: count * _NEIGHBOURHOOD].reshape(count, _NEIGHBOURHOOD), axis=1)
    at = (np.arange(count) + 0.5) * _NEIGHBOURHOOD
    floor = np.interp(np.arange(len(power)), at, floors)
    inner = power[2:-2]
    peak = (inner >= power[1:-3]) & (inner >= power[3:-1]) & (inner > power[:-4]) & (inner > power[4:])
    found = 2 + np.flatnonzero(peak & (inner > _STANDS_OUT * floor[2:-2]))
    found = found[np.argsort(-power[found] / np.maximum(floor[found], 1e-300), kind="stable")][:_MOST_LINES]
    # Middle of a Hann-windowed line from the amplitudes beside its largest one.
    left, middle, right = (np.sqrt(power[found + k]) for k in (-1, 0, 1))
    share = (right - left) / (2.0 * middle - left - right + 1e-300)
    return np.asarray(2.0 * math.pi * (found + 0.5 * np.clip(share, -1.0, 1.0)) / whole)


@compiled
def subtract_line(noise: Array, known: Array, omega: float, memory: float, out: Array) -> None:
    """
    Take one line out.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses and without its mean, Pa; the line is taken out of it.
    known : ndarray, shape (n,)
        Weight of each sample.
    omega : float
        Radians a sample.
    memory : float
        1 sigma of the average, samples.
    out : ndarray, shape (n,)
        What was subtracted is added to it.
    """
    n = len(noise)
    count = n // _BLOCK
    if count < 2:
        return
    cosine, sine, weight = np.zeros(count), np.zeros(count), np.zeros(count)
    turn_c, turn_s = math.cos(omega), math.sin(omega)
    for b in range(count):
        # Cosine and sine turn on from sample to sample: exact enough over a block, and much faster.
        c, s = math.cos(omega * b * _BLOCK), math.sin(omega * b * _BLOCK)
        for i in range(b * _BLOCK, (b + 1) * _BLOCK):
            cosine[b] += 2.0 * known[i] * noise[i] * c
            sine[b] += 2.0 * known[i] * noise[i] * s
            weight[b] += known[i]
            c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    sigma = memory / _BLOCK
    reach = int(3.0 * sigma)
    smooth_c, smooth_s = np.zeros(count), np.zeros(count)
    for b in range(count):
        total = 0.0
        for j in range(max(b - reach, 0), min(b + reach + 1, count)):
            g = math.exp(-0.5 * ((j - b) / sigma) ** 2)
            smooth_c[b] += g * cosine[j]
            smooth_s[b] += g * sine[j]
            total += g * weight[j]
        if total > 0.0:
            smooth_c[b] /= total
            smooth_s[b] /= total
    c, s = 1.0, 0.0
    for i in range(n):
        if i % _BLOCK == 0:
            c, s = math.cos(omega * i), math.sin(omega * i)
        at = min(max((i + 0.5) / _BLOCK - 0.5, 0.0), count - 1.0)
        b = min(int(at), count - 2)
        share = at - b
        line = (smooth_c[b] * (1.0 - share) + smooth_c[b + 1] * share) * c
        line += (smooth_s[b] * (1.0 - share) + smooth_s[b + 1] * share) * s
        noise[i] -= line
        out[i] += line
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


def pump_noise(noise: Array, known: Array, memory: float = SEARCH_SAMPLES) -> Array:
    """
    Sum of all lines.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses, Pa.
    known : ndarray, shape (n,)
        Weight of each sample, 0 to 1.
    memory : float
        As `subtract_line`.

    Returns
    -------
    ndarray, shape (n,)
        Pressure of the pumps, Pa.
    """
    out = np.zeros(len(noise))
    rest = noise - np.mean(noise)
    for omega in line_frequencies(noise):
        subtract_line(rest, known, float(omega), memory, out)
    return out

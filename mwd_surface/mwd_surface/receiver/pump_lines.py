"""
Pump noise taken out: narrow lines of the spectrum, found without a stroke counter and followed in amplitude and phase.

Strokes make lines at their multiples, strongest at 3, 6, 9 x of a triplex. A line is demodulated, averaged over some
pulse widths and subtracted; what hunts faster than the average stays for the noise model.
Source: B. Widrow et al., Adaptive noise cancelling, Proc. IEEE 63 (1975) 1692 (a notch that follows its line).
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Lines weaker than this multiple of the floor are left to the noise model, which then does better: with pulses of
# 0.3 s lines lie among the pulses' own spectrum, and a lower bound lost words of healthy pumps.
_STANDS_OUT = 200.0
_MOST_LINES = 16
_NEIGHBOURHOOD = 32  # bins over which the floor of the spectrum is judged
_BLOCK = 16  # samples averaged first
_SMOOTH = 6.0  # 1 sigma of the Gaussian average, blocks: 24 TU


def line_frequencies(noise: Array) -> Array:
    """
    Frequencies of the lines, strongest first.

    noise, shape (n,): pressure without its pulses, Pa. Returns shape (k,), radians a sample.
    """
    # The first difference takes the slope of 1/f noise out, so that the floor is even.
    step = np.diff(noise)
    power = np.abs(np.fft.rfft((step - step.mean()) * np.hanning(len(step)))) ** 2
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
    return np.asarray(2.0 * math.pi * (found + 0.5 * np.clip(share, -1.0, 1.0)) / len(step))


@compiled
def subtract_line(noise: Array, known: Array, omega: float, out: Array) -> None:
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
    out : ndarray, shape (n,)
        What was subtracted is added to it.
    """
    n = len(noise)
    count = n // _BLOCK
    if count < 2:
        return
    cosine, sine, weight = np.zeros(count), np.zeros(count), np.zeros(count)
    for b in range(count):
        for i in range(b * _BLOCK, (b + 1) * _BLOCK):
            cosine[b] += 2.0 * known[i] * noise[i] * math.cos(omega * i)
            sine[b] += 2.0 * known[i] * noise[i] * math.sin(omega * i)
            weight[b] += known[i]
    reach = int(3.0 * _SMOOTH)
    smooth_c, smooth_s = np.zeros(count), np.zeros(count)
    for b in range(count):
        total = 0.0
        for j in range(max(b - reach, 0), min(b + reach + 1, count)):
            g = math.exp(-0.5 * ((j - b) / _SMOOTH) ** 2)
            smooth_c[b] += g * cosine[j]
            smooth_s[b] += g * sine[j]
            total += g * weight[j]
        if total > 0.0:
            smooth_c[b] /= total
            smooth_s[b] /= total
    for i in range(n):
        at = min(max((i + 0.5) / _BLOCK - 0.5, 0.0), count - 1.0)
        b = min(int(at), count - 2)
        share = at - b
        c = smooth_c[b] * (1.0 - share) + smooth_c[b + 1] * share
        s = smooth_s[b] * (1.0 - share) + smooth_s[b + 1] * share
        line = c * math.cos(omega * i) + s * math.sin(omega * i)
        noise[i] -= line
        out[i] += line


def pump_noise(noise: Array, known: Array) -> Array:
    """
    Sum of all lines.

    Parameters
    ----------
    noise : ndarray, shape (n,)
        Pressure without its pulses, Pa.
    known : ndarray, shape (n,)
        Weight of each sample, 0 to 1.

    Returns
    -------
    ndarray, shape (n,)
        Pressure of the pumps, Pa.
    """
    out = np.zeros(len(noise))
    rest = noise - np.mean(noise)
    for omega in line_frequencies(noise):
        subtract_line(rest, known, float(omega), out)
    return out

# SPDX-License-Identifier: Apache-2.0
"""
Instruments: convert the true rate, force or field at a point of the tool to the reading of a sensor with its errors.

The chain of one axis is: bandwidth (a symmetric low-pass whose delay is compensated, as in strapdown sensors);
analogue-to-digital converter with scale, misalignment, bias (turn-on, walk, instability, temperature), sensitivity to
acceleration and vibration, noise, clipping and steps; then strapdown integration or plain sampling at the output rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.simulator.instrument_grade import AccelerometerGrade, GyroGrade, MagnetometerGrade


class Triad(NamedTuple):
    """Errors of one sensor triad of one tool, drawn at random, SI."""

    matrix: Array  #: shape (3, 3); scale and misalignment: output = matrix @ input + ...
    #: `bias`, `bias_per_c`, `scale_per_c`: shape (3,); bias at the calibration temperature; slopes of bias and scale
    #: per degC.
    bias: Array
    bias_per_c: Array
    scale_per_c: Array
    g_matrix: Array  #: shape (3, 3); sensitivity to specific force, per m/s^2
    #: Shape (3,); sensitivity to the square of the specific force along the axis, without gravity's part, per
    #: (m/s^2)^2.
    g2: Array
    noise: float  #: white noise, per sqrt(Hz)
    instability: float  #: steady 1 sigma of the first-order Markov bias
    instability_s: float  #: correlation time of the Markov bias
    walk: float  #: growth of the random walk per sqrt(s)
    limit: Array  #: shape (3,); largest reading; larger values are clipped
    step: float  #: quantisation step; 0 for none


# Peak of the Allan deviation of a first-order Markov process (at 1.89 correlation times) divided by its steady sigma
# (IEEE Std 952, C.1.6). Data sheets quote this peak as the bias instability.
_MARKOV_PEAK = 0.6174


def gyro_triad(g: GyroGrade, rng: np.random.Generator) -> Triad:
    """Return a gyro triad of a grade with random errors; the unit of the readings is rad/s."""
    deg_h = math.radians(1.0) / 3600.0
    return Triad(
        matrix=_matrix(g.scale_ppm, g.misalignment_mrad, rng),
        bias=g.bias_deg_h * deg_h * rng.standard_normal(3),
        bias_per_c=g.bias_deg_h_per_c * deg_h * rng.standard_normal(3),
        scale_per_c=g.scale_ppm_per_c * 1e-6 * rng.standard_normal(3),
        g_matrix=g.g_deg_h_g * deg_h / STANDARD_GRAVITY * rng.standard_normal((3, 3)),
        g2=g.g2_deg_h_g2 * deg_h / STANDARD_GRAVITY**2 * rng.standard_normal(3),
        noise=math.radians(g.noise_deg_sqrt_h) / 60.0,
        instability=g.instability_deg_h * deg_h / _MARKOV_PEAK,
        instability_s=g.instability_s,
        walk=g.walk_deg_h_sqrt_h * deg_h / 60.0,
        limit=np.radians(g.range_deg_s),
        step=math.radians(g.step_deg_s),
    )


def accelerometer_triad(a: AccelerometerGrade, rng: np.random.Generator) -> Triad:
    """Return an accelerometer triad of a grade with random errors; the unit of the readings is m/s^2."""
    ug = STANDARD_GRAVITY * 1e-6
    return Triad(
        matrix=_matrix(a.scale_ppm, a.misalignment_mrad, rng),
        bias=a.bias_ug * ug * rng.standard_normal(3),
        bias_per_c=a.bias_ug_per_c * ug * rng.standard_normal(3),
        scale_per_c=a.scale_ppm_per_c * 1e-6 * rng.standard_normal(3),
        g_matrix=np.zeros((3, 3)),
        g2=a.g2_ug_g2 * ug / STANDARD_GRAVITY**2 * rng.standard_normal(3),
        noise=a.noise_ug_sqrt_hz * ug,
        instability=a.instability_ug * ug / _MARKOV_PEAK,
        instability_s=a.instability_s,
        walk=a.walk_ug_sqrt_h * ug / 60.0,
        limit=np.array(a.range_g) * STANDARD_GRAVITY,
        step=a.step_ug * ug,
    )


def magnetometer_triad(m: MagnetometerGrade, rng: np.random.Generator) -> Triad:
    """Return a magnetometer triad of a grade with random errors, T; `noise` is 1 sigma of one sample, T."""
    return Triad(
        matrix=_matrix(m.scale_ppm, m.misalignment_mrad, rng),
        bias=m.bias_nt * 1e-9 * rng.standard_normal(3),
        bias_per_c=m.bias_nt_per_c * 1e-9 * rng.standard_normal(3),
        scale_per_c=np.zeros(3),
        g_matrix=np.zeros((3, 3)),
        g2=np.zeros(3),
        noise=m.noise_nt * 1e-9,
        instability=0.0,
        instability_s=1.0,
        walk=0.0,
        limit=np.full(3, m.range_ut * 1e-6),
        step=m.step_nt * 1e-9,
    )


def _matrix(scale_ppm: float, misalignment_mrad: float, rng: np.random.Generator) -> Array:
    draw = rng.standard_normal((3, 3))
    matrix = misalignment_mrad * 1e-3 * draw
    np.fill_diagonal(matrix, 1.0 + scale_ppm * 1e-6 * np.diag(draw))
    return matrix


def low_pass(bandwidth_hz: float, delay: float, rate: float) -> Array:
    """
    Return the weights of a Gaussian low-pass: an odd number of weights with sum 1.

    bandwidth_hz is the -3 dB point, Hz (0: no low-pass). delay, s, shifts the weights into the past. rate is the rate
    of the input samples, Hz. The middle weight belongs to the input sample at the instant of the output.
    """
    sigma = math.sqrt(math.log(2.0)) / (2.0 * math.pi * bandwidth_hz) * rate if bandwidth_hz else 0.0
    shift = delay * rate
    half = max(math.ceil(4.0 * sigma + abs(shift)), 1 if shift else 0)
    k = np.arange(-half, half + 1)
    # Without a bandwidth the weights interpolate linearly, which is exact for delays of whole steps.
    bell = np.exp(-0.5 * ((k + shift) / max(sigma, 0.2)) ** 2)
    weights = bell if sigma >= 0.2 else np.maximum(0.0, 1.0 - np.abs(k + shift))
    return np.asarray(weights / weights.sum())


def noise_band(bandwidth_hz: float, rate: float) -> float:
    """
    Return the two-sided noise bandwidth, Hz, of `low_pass` at a sampling rate, Hz: variance = density^2 * bandwidth.

    The bandwidth of a Gaussian with the -3 dB point b is b sqrt(pi / ln 2); the result is at most the rate.
    """
    return min(rate, bandwidth_hz * math.sqrt(math.pi / math.log(2.0))) if bandwidth_hz else rate


@compiled
def filtered(x: Array, weights: Array, first: int, stride: int, out: Array) -> None:
    """
    Write the low-passed x, shape (n, 3), at the indices first + k stride, into out, shape (m, 3).

    weights has shape (2 h + 1,); h samples must exist before and after each index.
    """
    half = len(weights) // 2
    for k in range(len(out)):
        centre = first + k * stride
        for axis in range(3):
            total = 0.0
            for j in range(-half, half + 1):
                total += weights[j + half] * x[centre + j, axis]
            out[k, axis] = total


class TriadState(NamedTuple):
    """Slowly changing biases of a triad: Markov bias and random walk, SI, shape (3,) each."""

    markov: Array
    walk: Array


def initial(triad: Triad, rng: np.random.Generator) -> TriadState:
    """Return the state at switch-on: a Markov bias drawn from its steady distribution, and a random walk of zero."""
    return TriadState(triad.instability * rng.standard_normal(3), np.zeros(3))


@compiled
def advance(triad: Triad, state: TriadState, seconds: float, warm: Array, draws: Array, out: Array) -> None:
    """
    Advance the slow biases by s steps; fills out, shape (s, 3), with the bias after each step, SI.

    seconds is the length of a step, s. warm, shape (s,), is the temperature minus the calibration temperature, degC.
    draws, shape (s, 2, 3), are standard normal random numbers.
    """
    keep = math.exp(-seconds / triad.instability_s)
    drawn, walked = triad.instability * math.sqrt(1.0 - keep * keep), triad.walk * math.sqrt(seconds)
    for k in range(len(out)):
        for i in range(3):
            state.markov[i] = keep * state.markov[i] + drawn * draws[k, 0, i]
            state.walk[i] += walked * draws[k, 1, i]
            out[k, i] = triad.bias[i] + triad.bias_per_c[i] * warm[k] + (state.markov[i] + state.walk[i])


@compiled
def convert(
    triad: Triad, bias: Array, warm: Array, x: Array, f: Array, gravity: Array, noise: Array, out: Array
) -> None:
    """
    Convert true vectors to readings in s steps of equal length; fills out, shape (m, 3).

    bias, shape (s, 3), is the slow bias, SI; warm, shape (s,), the temperature minus the calibration temperature, degC;
    gravity, shape (s,), is in m/s^2. x and f, shape (m, 3), are input and specific force, SI; noise, shape (m, 3), is
    added to each sample, SI. The rectification term is f^2 - gravity^2 / 3, so that a tool at rest reads its bias.
    """
    matrix, g_matrix, g2, limit, step = triad.matrix.copy(), triad.g_matrix, triad.g2, triad.limit, triad.step
    for k in range(len(x)):
        at = k * len(warm) // len(x)
        for i in range(3):
            matrix[i, i] = triad.matrix[i, i] + triad.scale_per_c[i] * warm[at]
            y = matrix[i, 0] * x[k, 0] + matrix[i, 1] * x[k, 1] + matrix[i, 2] * x[k, 2]
            y += g_matrix[i, 0] * f[k, 0] + g_matrix[i, 1] * f[k, 1] + g_matrix[i, 2] * f[k, 2]
            y += g2[i] * (f[k, i] * f[k, i] - gravity[at] * gravity[at] / 3.0) + bias[at, i] + noise[k, i]
            y = min(max(y, -limit[i]), limit[i])
            if step > 0.0:
                y = math.floor(y / step + 0.5) * step
                # The quantisation step next to the limit may lie beyond the limit.
                y = min(max(y, -limit[i]), limit[i])
            out[k, i] = y


@compiled
def strapdown(rate: Array, f: Array, ratio: int, dt: float, rate_out: Array, f_out: Array) -> None:
    """
    Integrate converter samples to the output rate (strapdown).

    Parameters
    ----------
    rate, f : ndarray, shape (m * ratio, 3)
        Rates, rad/s, and forces, m/s^2, in the middle of the converter's intervals.
    ratio : int
        Number of converter samples in one output.
    dt : float
        Converter interval, s.
    rate_out, f_out : ndarray, shape (m, 3)
        Output. rate_out is the rotation vector over the interval divided by its length, which includes coning. f_out is
        the mean specific force with each sample turned into the axes at the end of the interval, which includes
        sculling. Those axes are fixed in inertial space, so the force turns relative to them with the Earth, by 0.36
        urad in half of 10 ms.
    """
    whole = ratio * dt
    for k in range(len(rate_out)):
        # q: rotation from the axes at the end of the interval to those at the present sample, going backwards; scalar
        # last.
        x, y, z, w = 0.0, 0.0, 0.0, 1.0
        s0, s1, s2 = 0.0, 0.0, 0.0
        for j in range(ratio - 1, -1, -1):
            i = k * ratio + j
            # First half of the sample's rotation, then the force in the middle, then the second half.
            h0, h1, h2 = 0.25 * dt * rate[i, 0], 0.25 * dt * rate[i, 1], 0.25 * dt * rate[i, 2]
            angle = math.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
            scale = math.sin(angle) / angle if angle > 1e-12 else 1.0
            a, b, c, d = scale * h0, scale * h1, scale * h2, math.cos(angle)
            for part in range(2):
                if part == 1:
                    # Turn the specific force into the axes at the end of the interval.
                    f0, f1, f2 = f[i, 0], f[i, 1], f[i, 2]
                    t0 = 2.0 * (z * f1 - y * f2)
                    t1 = 2.0 * (x * f2 - z * f0)
                    t2 = 2.0 * (y * f0 - x * f1)
                    s0 += f0 + w * t0 + (z * t1 - y * t2)
                    s1 += f1 + w * t1 + (x * t2 - z * t0)
                    s2 += f2 + w * t2 + (y * t0 - x * t1)
                # q <- half rotation * q: earlier rotations are on the left.
                x, y, z, w = (
                    d * x + a * w + b * z - c * y,
                    d * y + b * w + c * x - a * z,
                    d * z + c * w + a * y - b * x,
                    d * w - a * x - b * y - c * z,
                )
        if w < 0.0:
            x, y, z, w = -x, -y, -z, -w
        sine = math.sqrt(x * x + y * y + z * z)
        factor = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
        rate_out[k, 0], rate_out[k, 1], rate_out[k, 2] = factor * x / whole, factor * y / whole, factor * z / whole
        f_out[k, 0], f_out[k, 1], f_out[k, 2] = s0 / ratio, s1 / ratio, s2 / ratio

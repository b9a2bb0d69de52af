# SPDX-License-Identifier: Apache-2.0
"""
Instruments: from the true rate, force or field at a point of the tool to the reading of a sensor, error by error.

The chain of one axis: bandwidth (a symmetric low-pass whose delay is compensated, as strapdown sensors do) -> analogue
to digital converter with scale, misalignment, bias (turn-on, walk, instability, temperature), sensitivity to
acceleration and vibration, noise, clipping, steps -> strapdown integration or plain sampling at the output rate.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.simulator.instrument_grade import AccelerometerGrade, GyroGrade, MagnetometerGrade


class Converter(NamedTuple):
    """
    What turns a true vector into a reading.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        Scale and misalignment.
    bias : ndarray, shape (3,)
        SI.
    g_matrix : ndarray, shape (3, 3)
        Reading per specific force, SI per m/s^2.
    g2 : ndarray, shape (3,)
        Reading per squared specific force, SI per (m/s^2)^2.
    limit : ndarray, shape (3,)
        Largest reading, SI.
    step : float
        Quantisation, SI; 0: none.
    """

    matrix: Array
    bias: Array
    g_matrix: Array
    g2: Array
    limit: Array
    step: float


@dataclasses.dataclass(frozen=True)
class Triad:
    """
    One triad of one tool, errors drawn, SI.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        Output = matrix @ input + ..., scale and misalignment.
    bias, bias_per_c, scale_per_c : ndarray, shape (3,)
        At the calibration temperature; per degC.
    g_matrix : ndarray, shape (3, 3)
        Response to specific force, per m/s^2.
    g2 : ndarray, shape (3,)
        Response to the square of the specific force along the axis, gravity's part left out, per (m/s^2)^2.
    noise : float
        White, per sqrt(Hz).
    instability, walk : float
        Steady 1 sigma of a first-order Markov bias; growth of the walk per sqrt(s).
    instability_s : float
        Correlation time, s.
    limit : ndarray, shape (3,)
        Clips beyond.
    step : float
        Quantisation, 0 for none.
    """

    matrix: Array
    bias: Array
    bias_per_c: Array
    scale_per_c: Array
    g_matrix: Array
    g2: Array
    noise: float
    instability: float
    instability_s: float
    walk: float
    limit: Array
    step: float

    def converter(self, bias: Array, warm: float) -> Converter:
        """
        Errors of the converter at one temperature.

        bias, shape (3,): slow bias at that time, SI. warm: temperature above that of calibration, degC.
        """
        matrix = self.matrix.copy()
        for axis in range(3):
            matrix[axis, axis] += self.scale_per_c[axis] * warm
        return Converter(matrix, bias, self.g_matrix, self.g2, self.limit, self.step)


# Peak of the Allan deviation of a first-order Markov process, at 1.89 correlation times, over its steady sigma (IEEE
# Std 952, C.1.6): the bias instability that a data sheet reads off the floor of its curve.
_MARKOV_PEAK = 0.6174


def gyro_triad(g: GyroGrade, rng: np.random.Generator) -> Triad:
    """Draw a gyro triad, rad/s."""
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
    """Draw an accelerometer triad, m/s^2."""
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
    """Draw a magnetometer triad, T; its noise is that of one sample."""
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
    Weights of a Gaussian low-pass at the kinematic rate, odd in number, sum 1.

    bandwidth_hz is the -3 dB point (0: none); delay, s, moves the weights into the past; the middle weight belongs
    to the instant itself.
    """
    sigma = math.sqrt(math.log(2.0)) / (2.0 * math.pi * bandwidth_hz) * rate if bandwidth_hz else 0.0
    shift = delay * rate
    half = max(math.ceil(4.0 * sigma + abs(shift)), 1 if shift else 0)
    k = np.arange(-half, half + 1)
    # Without a bandwidth: linear interpolation, exact for whole steps.
    bell = np.exp(-0.5 * ((k + shift) / max(sigma, 0.2)) ** 2)
    weights = bell if sigma >= 0.2 else np.maximum(0.0, 1.0 - np.abs(k + shift))
    return np.asarray(weights / weights.sum())


def noise_band(bandwidth_hz: float, rate: float) -> float:
    """
    Two-sided noise bandwidth, Hz, of `low_pass` at a sampling rate, Hz: density squared times it is the variance.

    For a bell with its -3 dB point at b it is b sqrt(pi / ln 2); never more than the rate.
    """
    return min(rate, bandwidth_hz * math.sqrt(math.pi / math.log(2.0))) if bandwidth_hz else rate


@compiled
def filtered(x: Array, weights: Array, first: int, stride: int, out: Array) -> None:
    """
    Low-passed x, shape (n, 3), at the indices first + k stride, into out, shape (m, 3).

    weights, shape (2 h + 1,): h samples before and after each index must exist.
    """
    half = len(weights) // 2
    for k in range(len(out)):
        centre = first + k * stride
        for axis in range(3):
            total = 0.0
            for j in range(-half, half + 1):
                total += weights[j + half] * x[centre + j, axis]
            out[k, axis] = total


@dataclasses.dataclass
class TriadState:
    """What a triad carries on: its Markov bias and its walk, SI, shape (3,) each."""

    markov: Array
    walk: Array

    @property
    def bias(self) -> Array:
        """Their sum, shape (3,)."""
        return self.markov + self.walk


def initial(triad: Triad, rng: np.random.Generator) -> TriadState:
    """State at switch-on: the Markov bias in its steady spread, no walk yet."""
    return TriadState(triad.instability * rng.standard_normal(3), np.zeros(3))


def advance(triad: Triad, state: TriadState, seconds: float, rng: np.random.Generator) -> None:
    """Move the slow biases on by a time, s."""
    keep = math.exp(-seconds / triad.instability_s)
    draw = rng.standard_normal((2, 3))
    state.markov = keep * state.markov + triad.instability * math.sqrt(1.0 - keep * keep) * draw[0]
    state.walk = state.walk + triad.walk * math.sqrt(seconds) * draw[1]


def slow_bias(triad: Triad, state: TriadState, warm: float) -> Array:
    """Bias now, SI, shape (3,); warm: temperature above that of calibration, degC."""
    return triad.bias + triad.bias_per_c * warm + state.bias


@compiled
def convert(errors: Converter, x: Array, f: Array, gravity: float, noise: Array, out: Array) -> None:
    """
    Analogue to digital: fills out, shape (m, 3).

    x, f, shape (m, 3): input and specific force, SI; gravity, m/s^2; noise, shape (m, 3): of each sample, SI.
    The rectified square leaves out gravity's own, so that a tool at rest reads its bias: (f^2 - gravity^2 / 3).
    """
    matrix, bias, g_matrix, g2 = errors.matrix, errors.bias, errors.g_matrix, errors.g2
    limit, step = errors.limit, errors.step
    for k in range(len(x)):
        for i in range(3):
            y = matrix[i, 0] * x[k, 0] + matrix[i, 1] * x[k, 1] + matrix[i, 2] * x[k, 2]
            y += g_matrix[i, 0] * f[k, 0] + g_matrix[i, 1] * f[k, 1] + g_matrix[i, 2] * f[k, 2]
            y += g2[i] * (f[k, i] * f[k, i] - gravity * gravity / 3.0) + bias[i] + noise[k, i]
            y = min(max(y, -limit[i]), limit[i])
            if step > 0.0:
                y = math.floor(y / step + 0.5) * step
                # The step next to the limit may lie beyond it.
                y = min(max(y, -limit[i]), limit[i])
            out[k, i] = y


@compiled
def strapdown(rate: Array, f: Array, ratio: int, dt: float, rate_out: Array, f_out: Array) -> None:
    """
    Strapdown integration of converter samples to the output rate.

    Parameters
    ----------
    rate, f : ndarray, shape (m * ratio, 3)
        rad/s and m/s^2 at the middles of the converter's intervals.
    ratio : int
        Converter samples in one output.
    dt : float
        Converter interval, s.
    rate_out, f_out : ndarray, shape (m, 3)
        Filled: the rotation vector over the interval divided by its length (coning is in it), and the mean specific
        force, each sample first turned into the axes at the end of the interval (sculling is in it). Those axes
        stand still in inertial space: the Earth turns by 0.36 urad in half of 10 ms, and the force with it.
    """
    whole = ratio * dt
    for k in range(len(rate_out)):
        # q: from the axes at the end of the interval to those at the time reached, going backwards. Scalar last.
        x, y, z, w = 0.0, 0.0, 0.0, 1.0
        s0, s1, s2 = 0.0, 0.0, 0.0
        for j in range(ratio - 1, -1, -1):
            i = k * ratio + j
            # Half of the sample's own rotation, the force in the middle, the other half.
            h0, h1, h2 = 0.25 * dt * rate[i, 0], 0.25 * dt * rate[i, 1], 0.25 * dt * rate[i, 2]
            angle = math.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
            scale = math.sin(angle) / angle if angle > 1e-12 else 1.0
            a, b, c, d = scale * h0, scale * h1, scale * h2, math.cos(angle)
            for part in range(2):
                if part == 1:
                    # Specific force into the end axes by the inverse of q (q: later axes -> these axes' vectors).
                    f0, f1, f2 = f[i, 0], f[i, 1], f[i, 2]
                    t0 = 2.0 * (z * f1 - y * f2)
                    t1 = 2.0 * (x * f2 - z * f0)
                    t2 = 2.0 * (y * f0 - x * f1)
                    s0 += f0 + w * t0 + (z * t1 - y * t2)
                    s1 += f1 + w * t1 + (x * t2 - z * t0)
                    s2 += f2 + w * t2 + (y * t0 - x * t1)
                # q <- half rotation * q: earlier rotations stand on the left.
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

# SPDX-License-Identifier: Apache-2.0
"""
Fit a calibration to a tumble and temperature run.

The known inputs are the strengths of gravity and of the magnetic field, the dip of the field, and the rotations between
intervals at rest. These inputs determine the triads except for one common rotation. Every parameter comes with its 1
sigma, from the scatter of the residuals.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from mwd_sensors.calibration.triad_calibration import Calibration, TriadCalibration
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.frames import mat_from_quat, quat_from_rotvec, quat_multiply


def fit_strength(reading: ArrayLike, strength: float, celsius: ArrayLike) -> TriadCalibration:
    """
    Return a triad's calibration from the strength of a field alone (gravity), with unknown attitudes.

    reading, shape (m, 3), and strength, SI; celsius, shape (m,): temperature, degC. The matrix is symmetric, because
    the strength does not determine a rotation.

    Raises
    ------
    ValueError
        The attitudes do not determine the parameters.
    """
    y, heat = np.asarray(reading, dtype=float) / strength, RunTemperature.of(np.asarray(celsius, dtype=float))

    def residual(p: Array) -> Array:
        return np.asarray(np.linalg.norm(heat.corrected(y, p[6:]) @ _symmetric(p[:6]), axis=1) - 1.0)

    start = np.concatenate([[1.0, 1.0, 1.0], np.zeros(3 + heat.count)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    check_determined(found.jac)
    sigma = fit_sigmas(found.jac, found.fun)
    return TriadCalibration(
        matrix=_symmetric(found.x[:6]),
        sigma_matrix=_symmetric(sigma[:6]),
        **heat.figures_of(found.x[6:], sigma[6:], strength, rms(found.fun)),
        before=rms(np.linalg.norm(y, axis=1) - 1.0) * strength,
        after=rms(found.fun) * strength,
        poses=len(y),
    )


def fit_magnetometer(
    reading: ArrayLike, f_t: ArrayLike, strength: float, dip: float, celsius: ArrayLike
) -> TriadCalibration:
    """
    Return a magnetometer's calibration from the field's strength and its dip relative to calibrated accelerometers.

    Parameters
    ----------
    reading, f_t : array_like, shape (m, 3)
        Readings, T, and corrected specific force, m/s^2. The dip relates the magnetic axes to those of the
        accelerometers.
    strength, dip : float
        Strength, T, and dip, rad, of the field at the place of the run.
    celsius : array_like, shape (m,)
        Temperature, degC.

    Raises
    ------
    ValueError
        The attitudes do not determine the parameters.
    """
    y, f = np.asarray(reading, dtype=float) / strength, np.asarray(f_t, dtype=float)
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    heat = RunTemperature.of(np.asarray(celsius, dtype=float))

    def residual(p: Array) -> Array:
        b = heat.corrected(y, p[9:]) @ p[:9].reshape(3, 3).T
        return np.concatenate([np.linalg.norm(b, axis=1) - 1.0, np.sum(b * down, axis=1) - np.sin(dip)])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(heat.count)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    check_determined(found.jac)
    sigma = fit_sigmas(found.jac, found.fun, 2)
    return TriadCalibration(
        matrix=found.x[:9].reshape(3, 3),
        sigma_matrix=sigma[:9].reshape(3, 3),
        **heat.figures_of(found.x[9:], sigma[9:], strength, rms(found.fun)),
        before=rms(residual(start)) * strength,
        after=rms(found.fun) * strength,
        poses=len(y),
    )


def fit_gyro(gyro: ArrayLike, at_rest: TumbleRests, accelerometer: TriadCalibration, rate: float) -> TriadCalibration:
    """
    Return the calibration of gyros.

    Bias and its temperature slope come from intervals at rest, scale and misalignment from rotations.

    Parameters
    ----------
    gyro : array_like, shape (n, 3)
        Readings of the whole run, rad/s.
    at_rest : TumbleRests
        Intervals at rest of the same run.
    accelerometer : TriadCalibration
        Calibration that gives the direction of gravity in each interval at rest; the rotation between two intervals
        must turn the direction in the first to the direction in the second.
    rate : float
        Sample rate, Hz.

    Raises
    ------
    ValueError
        The rotations do not determine the parameters (rotations about all axes are needed).
    """
    w, t = np.asarray(gyro, dtype=float), at_rest.celsius
    heat = RunTemperature.of(t)
    design = np.column_stack([np.ones(len(t)), heat.warm]) if heat.varied else np.ones((len(t), 1))
    solution = np.linalg.lstsq(design, at_rest.gyro, rcond=None)[0]
    left = design @ solution - at_rest.gyro
    scatter = np.array([fit_sigmas(design, column) for column in left.T])
    per_span = scatter[:, 1] / heat.span if heat.varied else np.zeros(3)
    sigma_bias, sigma_per_c = allow_for_drift(scatter[:, 0], per_span, np.sqrt(np.mean(left**2, axis=0)), heat.span)
    bias, per_c = solution[0], solution[1] / heat.span if heat.varied else np.zeros(3)
    f = accelerometer(at_rest.accel, t)
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    between = 0.5 * (t[:-1] + t[1:]) - heat.reference_c
    steps = _turns(w, at_rest, bias, per_c * between[:, None], rate)

    def residual(p: Array) -> Array:
        gain = 1.0 + p[9:] * (between / heat.span)[:, None] if heat.varied else 1.0
        return np.asarray((_carried(steps / gain @ p[:9].reshape(3, 3).T, down[:-1]) - down[1:]).ravel())

    start = np.concatenate([np.eye(3).ravel(), np.zeros(3 if heat.varied else 0)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    check_determined(found.jac)
    sigma = fit_sigmas(found.jac, found.fun, 3, interleaved=True)
    return TriadCalibration(
        matrix=found.x[:9].reshape(3, 3),
        bias=bias,
        bias_per_c=per_c,
        scale_per_c=found.x[9:] / heat.span if heat.varied else np.zeros(3),
        sigma_matrix=sigma[:9].reshape(3, 3),
        sigma_bias=sigma_bias,
        sigma_bias_per_c=sigma_per_c if heat.varied else np.zeros(3),
        sigma_scale_per_c=sigma[9:] / heat.span if heat.varied else np.zeros(3),
        reference_c=heat.reference_c,
        before=float(np.sqrt(np.mean(residual(start) ** 2) * 3.0)),
        after=float(np.sqrt(np.mean(found.fun**2) * 3.0)),
        poses=steps.shape[1],
    )


def calibrate(
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | None,
    celsius: ArrayLike,
    rate: float,
    gravity: float,
    field: tuple[float, float] | None,
) -> Calibration:
    """
    Return the calibration of a unit from one tumble run, without a stand.

    Parameters
    ----------
    gyro, accel, mag : array_like, shape (n, 3)
        Readings, rad/s, m/s^2, T (or None).
    celsius : array_like, shape (n,)
        Temperature at each sample, degC.
    rate : float
        Sample rate, Hz.
    gravity : float
        Strength of gravity, m/s^2.
    field : (float, float) or None
        Strength, T, and dip, rad, of the magnetic field at the place of the run; needed to calibrate magnetometers.

    Raises
    ------
    ValueError
        There are too few intervals at rest, or the attitudes do not determine the parameters.
    """
    found = rests(gyro, accel, mag, celsius, rate)
    accelerometer = fit_strength(found.accel, gravity, found.celsius)
    magnetometer = None
    if mag is not None and field is not None:
        f_t = accelerometer(found.accel, found.celsius)
        magnetometer = fit_magnetometer(found.mag, f_t, field[0], field[1], found.celsius)
    return Calibration(fit_gyro(gyro, found, accelerometer, rate), accelerometer, magnetometer)


def _turns(w: Array, at_rest: TumbleRests, bias: Array, drift: Array, rate: float) -> Array:
    """
    Return the rotation vectors of the samples between intervals at rest, rad, shape (n, k, 3).

    k is the number of rotations, in order of time, and n the number of samples of the longest; shorter rotations are
    padded with zeros. w, shape (samples, 3), are the rates of the whole tumble; bias, shape (3,), is the gyro bias and
    drift, shape (k, 3), its change in each rotation. All in rad/s.
    """
    turns = []
    for k in range(len(drift)):
        a, z = int(at_rest.last[k]) - round(0.5 * rate), int(at_rest.first[k + 1]) + round(0.5 * rate)
        turns.append((w[a:z] - bias - drift[k]) / rate)
    # All rotations are computed in parallel; short ones are padded with zeros, which stand for no rotation.
    steps = np.zeros((max(len(turn) for turn in turns), len(turns), 3))
    for k, turn in enumerate(turns):
        steps[: len(turn), k] = turn
    return steps


def _carried(steps: Array, down: Array) -> Array:
    """
    Return the directions of gravity in tool axes after k rotations, unit vectors, shape (k, 3).

    steps, shape (n, k, 3): rotation vectors of the n samples of each rotation, rad. down, shape (k, 3): directions of
    gravity before the rotations.
    """
    # Rotations are multiplied in pairs, as a tree, so that a long rotation takes few array operations.
    q = quat_from_rotvec(steps)
    while len(q) > 1:
        odd = q[-1:] if len(q) % 2 else q[:0]
        q = np.concatenate([quat_multiply(q[0 : len(q) - len(odd) : 2], q[1 : len(q) : 2]), odd])
    # q is the tool-to-level rotation relative to the start, so the direction turns by its inverse.
    return np.asarray(np.einsum("kji,kj->ki", mat_from_quat(q[0]), down))


def _symmetric(p: Array) -> Array:
    return np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])


# Find the intervals at rest in a tumble run and average the readings in them.


MIN_POSES = 12  # smallest number of intervals at rest for a calibration
# Shortest interval at rest, s; largest range of an axis in a window at rest, rad/s and m/s^2.
_SHORTEST_S, _QUIET_RATE, _QUIET_FORCE = 2.0, 0.02, 0.15


@dataclasses.dataclass(frozen=True)
class TumbleRests:
    """Mean readings over intervals at rest."""

    #: `first`, `last`: shape (m,); index of the first sample of each interval, and index after its last sample.
    first: Indices
    last: Indices
    #: `gyro`, `accel`, `mag`: shape (m, 3); mean readings, rad/s, m/s^2, T; mag is NaN without a magnetometer.
    gyro: Array
    accel: Array
    mag: Array
    celsius: Array  #: shape (m,); mean temperature, degC


def rests(gyro: ArrayLike, accel: ArrayLike, mag: ArrayLike | None, celsius: ArrayLike, rate: float) -> TumbleRests:
    """
    Return the intervals at rest in a tumble run.

    A window of half a second is at rest if the range of each axis is below `_QUIET_RATE` and `_QUIET_FORCE`, and its
    mean specific force differs from both neighbouring windows by less than half of `_QUIET_FORCE`.

    Parameters
    ----------
    gyro, accel, mag : array_like, shape (n, 3)
        Readings in rad/s, m/s^2, T (or None), all at the same rate.
    celsius : array_like, shape (n,)
        Temperature, degC.
    rate : float
        Sample rate, Hz.

    Raises
    ------
    ValueError
        There are fewer than `MIN_POSES` intervals at rest, too few for a calibration.
    """
    w, f = np.asarray(gyro, dtype=float), np.asarray(accel, dtype=float)
    t = np.asarray(celsius, dtype=float)
    b = np.full_like(f, np.nan) if mag is None else np.asarray(mag, dtype=float)
    window = max(2, round(0.5 * rate))
    count = len(f) // window
    shape = (count, window, 3)
    spans = [np.ptp(x[: count * window].reshape(shape), axis=1).max(axis=1) for x in (w, f)]
    # Readings in a steady rotation are quiet too; at rest the specific force of neighbouring windows must also agree.
    mean_f = f[: count * window].reshape(shape).mean(axis=1)
    drift = np.linalg.norm(np.diff(mean_f, axis=0, prepend=mean_f[:1]), axis=1)
    drift = np.maximum(drift, np.append(drift[1:], 0.0))
    quiet = (spans[0] < _QUIET_RATE) & (spans[1] < _QUIET_FORCE) & (drift < 0.5 * _QUIET_FORCE)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    pairs = [(a * window, z * window) for a, z in edges.reshape(-1, 2) if (z - a) * window >= _SHORTEST_S * rate]
    if len(pairs) < MIN_POSES:
        raise ValueError(
            f"only {len(pairs)} rests of {_SHORTEST_S:g} s were found; a tumble needs at least {MIN_POSES} attitudes"
        )
    means = [np.array([x[a:z].mean(axis=0) for a, z in pairs]) for x in (w, f, b, t)]
    first, last = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True))
    return TumbleRests(first, last, means[0], means[1], means[2], means[3])


# Statistics of least-squares calibrations: effect of temperature, sigmas from residuals, check of the attitudes.


UNDETERMINED = "these attitudes do not determine scale, misalignment and bias; turn the probe further"


@dataclasses.dataclass(frozen=True)
class RunTemperature:
    """Temperature during a calibration run."""

    #: `reference_c`, `span`: mean and range, degC; the range is 1 if it is too small (`varied`).
    reference_c: float
    span: float
    #: Shape (m,); temperature above the reference divided by the range, so that all parameters of a fit have similar
    #: size.
    warm: Array
    varied: bool  #: whether the range is large enough to fit the effect of temperature

    @classmethod
    def of(cls, celsius: Array) -> RunTemperature:
        """Return reference and range of temperatures, shape (m,), degC; `varied` is True above a range of 1 degC."""
        reference, varied = float(celsius.mean()), bool(np.ptp(celsius) > 1.0)
        span = float(np.ptp(celsius)) if varied else 1.0
        return cls(reference, span, (celsius - reference) / span, varied)

    @property
    def count(self) -> int:
        """Number of parameters in addition to the matrix: bias and, if temperature varied, slopes of bias and scale."""
        return 9 if self.varied else 3

    def corrected(self, y: Array, p: Array) -> Array:
        """Correct readings, shape (m, 3), by p: bias and, if temperature varied, slopes of bias and scale."""
        if not self.varied:
            return np.asarray(y - p[:3])
        warm = self.warm[:, None]
        return np.asarray((y - p[:3] - warm * p[3:6]) / (1.0 + warm * p[6:9]))

    def figures_of(self, p: Array, sigma: Array, strength: float, scatter: float) -> dict[str, Any]:
        """
        Return parameters p and their sigmas as named results in SI.

        scatter is the rms of the residuals divided by the strength of the field.
        """
        none = np.zeros(3)
        per_c, gain = strength / self.span, 1.0 / self.span
        bias, bias_per_c = allow_for_drift(sigma[:3], sigma[3:6] if self.varied else none, scatter, 1.0)
        return {
            "reference_c": self.reference_c,
            "bias": p[:3] * strength,
            "sigma_bias": bias * strength,
            "bias_per_c": p[3:6] * per_c if self.varied else none,
            "sigma_bias_per_c": bias_per_c * per_c if self.varied else none,
            "scale_per_c": p[6:9] * gain if self.varied else none,
            "sigma_scale_per_c": sigma[6:9] * gain if self.varied else none,
        }


def fit_sigmas(jacobian: Array, residual: Array, parts: int = 1, interleaved: bool = False) -> Array:
    """
    Return 1 sigma of the p parameters of a least-squares fit, shape (p,), from the scatter of its residuals.

    jacobian, shape (n, p), and residual, shape (n,), belong to the solution. Each interval at rest has `parts`
    residuals, stored next to each other (interleaved) or in `parts` blocks with one residual of each interval. A slow
    drift of the sensor makes neighbouring residuals similar, so that fewer of them are independent. The result is
    therefore the larger of the ordinary sigma and the sigma by Newey and West (Econometrica 55, 1987), with lags up to
    a fifth of the intervals.
    """
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.inv(scaled.T @ scaled)
    rows, figures = scaled.shape
    spare = max(rows - figures, 1)
    ordinary = inverse.diagonal() * float(residual @ residual) / spare
    scores = scaled * residual[:, None]
    count = rows // parts
    scores = (
        scores.reshape(count, parts, -1).sum(axis=1) if interleaved else scores.reshape(parts, count, -1).sum(axis=0)
    )
    reach = count // 5
    spread = scores.T @ scores
    for lag in range(1, reach + 1):
        product = scores[lag:].T @ scores[:-lag]
        spread = spread + (1.0 - lag / (reach + 1.0)) * (product + product.T)
    robust = (inverse @ spread @ inverse).diagonal() * rows / spare
    return np.asarray(np.sqrt(np.maximum(ordinary, robust)) / size)


def allow_for_drift(
    sigma_bias: Array, sigma_bias_per_c: Array, scatter: Array | float, span: float
) -> tuple[Array, Array]:
    """
    Return the sigmas of bias and of its slope with temperature, both increased for drift.

    Half the residual scatter is added in quadrature to the sigma of the bias, and twice the scatter divided by `span`,
    the range of temperature, to that of the slope. A sensor that drifts while the temperature happens to rise looks
    like a sensor that depends on temperature.
    """
    return np.hypot(sigma_bias, 0.5 * scatter), np.hypot(sigma_bias_per_c, 2.0 * scatter / span)


def check_determined(jacobian: Array) -> None:
    """
    Raise ValueError if the attitudes do not determine the parameters of a fit.

    This is so if the condition number of the scaled Jacobian is above 1e5.
    """
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    if np.linalg.cond(scaled) > 1e5:
        raise ValueError(UNDETERMINED)


def rms(x: Array) -> float:
    """Return the root mean square of the lengths of vectors, shape (m, 3), or of numbers, shape (m,)."""
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(x.T).T ** 2, axis=-1))))

# SPDX-License-Identifier: Apache-2.0
"""
Multi-station analysis: errors of the sensors and drill-string interference from many stations of one run.

Gravity and the Earth's field are the same at every station: total gravity, horizontal and downward field. Errors of the
tool, which stay with its axes, change the measured values from station to station as the tool rotates and the hole
bends: bias and scale of each magnetometer (axial interference is a bias of the axial one) and of each accelerometer.
These errors are estimated together with the errors of the reference by nonlinear least squares; each error has a prior,
from the tool code or from the sigmas of the reference:

    b = B-true + bias + scale b,   f = F-true + bias + scale f
    residual = (|f|, H, V)(f - ..., b - ...) - reference - error of the reference

An error that cannot be observed at the attitudes of the run keeps its prior sigma. The result marks such errors, and
the azimuth's sigma includes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.chi_square import exceeded
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic import interference_filter
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import GRAVITY_SPREAD, STANDARD_GRAVITY
from mwd_sensors.core.frames import inclination

# Least-squares problem: residuals of the stations of a run, and their derivatives.

SENSORS = 12  #: number of sensor errors; the errors of the reference follow them


# 1 sigma of the prior of the axial interference, as a multiple of `SensorErrors.axial_interference_nt`. The filter of
# the magnetic samples has the same prior (`InterferenceParams`).
_AXIAL = interference_filter.InterferenceParams().axial / (SensorErrors.axial_interference_nt * 1e-9)
# Cross-axial bias from a hot spot in the collar, in addition to the sensors' own bias, 1 sigma, nT.
_CROSS_AXIAL = 150.0
# Noise of a station's mean field, T, and mean specific force, m/s^2, per axis, 1 sigma.
_FIELD_NOISE = 20e-9
_FORCE_NOISE = 0.002
# Random variation of the Earth's field between stations, 1 sigma (MFIR, MDIR): strength, T, and dip, rad.
_FIELD_VARIATION = 60e-9
_DIP_VARIATION = math.radians(0.08)
# The search for the most probable errors ends at a step below this size, prior sigmas, or after this number of steps.
_CONVERGED, _MOST_STEPS = 1e-7, 50


class StationsProblem:
    """
    Whitened residuals of the stations against one reference, together with the priors.

    f, b: mean specific force, m/s^2, and field, T, of each station in tool axes, shape (n, 3). In the methods, x holds
    the errors in prior sigmas, shape (15,), and used marks the stations in use, shape (n,).
    """

    def __init__(self, f: Array, b: Array, reference: Reference, errors: SensorErrors) -> None:
        self.f, self.b = f, b
        gravity = STANDARD_GRAVITY if reference.gravity is None else reference.gravity
        self.reference = np.array([gravity, reference.horizontal, reference.vertical])
        bias = errors.magnetometer_bias_nt
        magnetometer = [
            math.hypot(bias, _AXIAL * errors.axial_interference_nt) * 1e-9,
            math.hypot(bias, _CROSS_AXIAL) * 1e-9,
            math.hypot(bias, _CROSS_AXIAL) * 1e-9,
            *([max(errors.magnetometer_scale, 1e-7)] * 3),
        ]
        accelerometer = [max(errors.accelerometer_bias_mps2, 1e-7)] * 3 + [max(errors.accelerometer_scale, 1e-8)] * 3
        # Errors = scale @ x, where x has a unit prior.
        self.scale = np.zeros((15, 15))
        self.scale[range(SENSORS), range(SENSORS)] = magnetometer + accelerometer
        self.scale[12:14, 12:14] = np.linalg.cholesky(reference.covariance + np.eye(2) * 1e-22)
        self.scale[14, 14] = GRAVITY_SPREAD if reference.gravity is None else max(reference.sigma_gravity, 1e-7)
        self.noise = np.diag([_FORCE_NOISE**2] * 3 + [_FIELD_NOISE**2] * 3)
        total, dip = float(np.hypot(*self.reference[1:])), math.atan2(self.reference[2], self.reference[1])
        turn = np.array([[math.cos(dip), -total * math.sin(dip)], [math.sin(dip), total * math.cos(dip)]])
        varying = np.diag([_FIELD_VARIATION, _DIP_VARIATION]) ** 2
        self.varying = turn @ varying @ turn.T
        self._weigh()

    def _weigh(self) -> None:
        # Compute the weights from the uncorrected readings, because the noise hardly depends on the small errors.
        _, inputs = self._values(np.zeros(15))
        covariance = inputs @ self.noise @ np.swapaxes(inputs, 1, 2)
        covariance[:, 1:, 1:] += self.varying
        self.white = np.linalg.inv(np.linalg.cholesky(covariance))

    def quieten(self, x: Array, used: np.ndarray) -> None:
        """
        Scale the noise down to the scatter of the residuals of the used stations, separately for gravity and field.

        Less scatter than expected means that the sensors are better than specified. For the field, the variation of the
        Earth's field is reduced before the noise of the magnetometers. The noise is never scaled up: more scatter is a
        reason to refuse the analysis.
        """
        slope = self._whitened_slope(x)[used]
        residual = self._whitened(x)[used]
        every = slope.reshape(-1, 15)
        covariance = np.linalg.inv(every.T @ every + np.eye(15))
        leverage = np.einsum("nki,ij,nkj->nk", slope, covariance, slope)

        def share(columns: slice) -> float:
            freedom = max(float(np.sum(1.0 - leverage[:, columns])), 1.0)
            return min(max(float(np.sum(residual[:, columns] ** 2)) / freedom, 1e-4), 1.0)

        gravity, field = share(slice(0, 1)), share(slice(1, 3))
        # The residuals cannot separate magnetometer noise from variation of the field. The noise, which affects the
        # azimuth, keeps its setting as far as the residuals allow, and the variation is reduced first.
        _, inputs = self._values(np.zeros(15))
        by_noise = float(np.mean(np.einsum("nki,ij,nkj->nk", inputs[:, 1:], self.noise, inputs[:, 1:])))
        by_variation = 0.5 * float(np.trace(self.varying))
        seen = field * (by_noise + by_variation)
        self.noise = self.noise * np.repeat([gravity, min(seen / by_noise, 1.0)], 3)[:, None]
        self.varying = self.varying * max((seen - by_noise) / max(by_variation, 1e-30), 0.0)
        self._weigh()

    def _values(self, errors: Array) -> tuple[Array, Array]:
        """
        Return total gravity, horizontal and vertical field, (n, 3), of the corrected readings, and their Jacobian.

        errors: in SI units, shape (15,). The Jacobian is with respect to (f, b) and has shape (n, 3, 6).
        """
        f, b = corrected(self.f, self.b, errors)
        g = np.linalg.norm(f, axis=1, keepdims=True)
        down = -f / g
        vertical = np.sum(b * down, axis=1, keepdims=True)
        level = b - vertical * down
        horizontal = np.linalg.norm(level, axis=1, keepdims=True)
        north = level / horizontal
        slope = np.zeros((len(f), 3, 6))
        slope[:, 0, :3] = -down
        slope[:, 1, :3], slope[:, 1, 3:] = vertical * north / g, north
        slope[:, 2, :3], slope[:, 2, 3:] = -horizontal * north / g, down
        return np.concatenate([g, horizontal, vertical], axis=1), slope

    def _by_errors(self) -> Array:
        """Return the derivatives of the corrected (f, b) with respect to the sensor errors, shape (n, 6, 12)."""
        slope = np.zeros((len(self.f), 6, SENSORS))
        for axis in range(3):
            slope[:, 3 + axis, axis] = -1.0
            slope[:, 3 + axis, 3 + axis] = -self.b[:, axis]
            slope[:, axis, 6 + axis] = -1.0
            slope[:, axis, 9 + axis] = -self.f[:, axis]
        return slope

    def solve(self, used: np.ndarray) -> Array:
        """
        Return the most probable errors (in prior sigmas) from the used stations and the priors, shape (15,).

        Gauss-Newton steps from zero; each is halved until it lowers the sum of squares (Nocedal and Wright, Numerical
        Optimization, section 10.3).
        """
        x, residual = np.zeros(15), self.residual(np.zeros(15), used)
        for _ in range(_MOST_STEPS):
            step = np.linalg.lstsq(self.slope(x, used), -residual)[0]
            while np.abs(step).max() > _CONVERGED:
                tried = self.residual(x + step, used)
                if tried @ tried < residual @ residual:
                    break
                step *= 0.5
            else:
                break
            x, residual = x + step, tried
        return x

    def residual(self, x: Array, used: np.ndarray) -> Array:
        """Return the whitened residuals of the n stations in use and of the priors, shape (3 n + 15,)."""
        return np.concatenate([self._whitened(x)[used].ravel(), x])

    def slope(self, x: Array, used: np.ndarray) -> Array:
        """Return the derivative of `residual` with respect to x, shape (3 n + 15, 15)."""
        return np.concatenate([self._whitened_slope(x)[used].reshape(-1, 15), np.eye(15)])

    def misfit(self, x: Array) -> Array:
        """Return the length of each station's whitened residual, shape (n,); one in a thousand exceeds 4 by chance."""
        return np.asarray(np.linalg.norm(self._whitened(x), axis=1))

    def _whitened(self, x: Array) -> Array:
        errors = self.scale @ x
        values, _ = self._values(errors)
        off = values - self.reference - np.array([errors[14], errors[12], errors[13]])
        return np.asarray(np.squeeze(self.white @ off[:, :, None], 2))

    def _whitened_slope(self, x: Array) -> Array:
        _, inputs = self._values(self.scale @ x)
        slope = np.zeros((len(self.f), 3, 15))
        slope[:, :, :SENSORS] = inputs @ self._by_errors()
        slope[:, 0, 14], slope[:, 1, 12], slope[:, 2, 13] = -1.0, -1.0, -1.0
        return np.asarray(self.white @ slope @ self.scale)

    def reading_covariance(self, x: Array, covariance: Array, used: np.ndarray) -> Array:
        """
        Return the covariance of the corrected (f, b) of each station, shape (n, 6, 6), from noise and remaining errors.

        covariance: of the 15 errors in SI units, shape (15, 15). The noise of a station in use has influenced the
        estimated errors, so the cross-covariance of noise and errors is included.
        """
        by_errors = self._by_errors()
        left = covariance[:SENSORS, :SENSORS]
        out = self.noise + by_errors @ left @ np.swapaxes(by_errors, 1, 2)
        _, inputs = self._values(self.scale @ x)
        slope = self._whitened_slope(x) @ np.linalg.inv(self.scale)
        gain = covariance[None, :SENSORS] @ np.swapaxes(slope, 1, 2) @ self.white
        both = -by_errors @ gain @ inputs @ self.noise * used[:, None, None]
        return np.asarray(out + both + np.swapaxes(both, 1, 2))


def corrected(f: Array, b: Array, errors: Array) -> tuple[Array, Array]:
    """
    Return force, m/s^2, and field, T, without the sensor errors, each of shape (..., 3).

    errors: in the order of `Multistation.estimate`; only the first 12, the sensor errors, are used.
    """
    return f - errors[6:9] - errors[9:12] * f, b - errors[0:3] - errors[3:6] * b


# Analysis of a run: outliers, result, and reasons to refuse the result.


# Smallest number of stations for estimating the noise.
_MANY = 8
# Misfit, in sigma, above which a station is left out, and largest share of stations that may be left out. The analysis
# is refused if there are more outliers.
_OUTLIER_SIGMA = 4.5
_MAX_OUTLIERS = 0.25
# Ratio of an error's sigma to its prior sigma above which the error counts as not observable.
_OBSERVABLE = 0.7
# Limits: the analysis is refused below this probability of a larger chi-square, and above this median sigma of the
# azimuth, deg.
_MIN_PROBABILITY = 0.001
_MAX_SIGMA_DEG = 1.5


@dataclass(frozen=True)
class Multistation:
    """Result of the multi-station analysis of a run."""

    #: `estimate`, `sigma`, `prior`: shape (15,); errors, their 1 sigma after the analysis, and before it. For x, y, z
    #: each: bias, T (for x with axial interference), and scale of the magnetometers; bias, m/s^2, and scale of the
    #: accelerometers; then the errors of the reference: horizontal and downward field, T, and gravity, m/s^2.
    estimate: Array
    sigma: Array
    prior: Array
    #: `azimuth`, `sigma_azimuth`, `inclination`, `sigma_inclination`: shape (n,); corrected, magnetic, rad. The sigmas
    #: include noise and remaining errors, but not the errors of declination and alignment.
    azimuth: Array
    sigma_azimuth: Array
    inclination: Array
    sigma_inclination: Array
    azimuth_raw: Array  #: shape (n,); uncorrected magnetic azimuth, rad
    used: np.ndarray  #: bool, shape (n,); false for outliers, which do not contribute but are corrected too
    #: `chi_square`, `degrees`, `probability`: chi-square of the residuals of the used stations and of the priors, its
    #: degrees of freedom, and the probability of a larger value by chance.
    chi_square: float
    degrees: int
    probability: float
    observable: np.ndarray  #: bool, shape (15,); whether the error can be observed at the attitudes of the run
    refused: Reason | None  #: why the corrected azimuths must not be used; None if they may be used


def analyse(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference,
    errors: SensorErrors | None = None,
) -> Multistation:
    """
    Estimate the errors common to the stations of one run, and the azimuths corrected for them.

    Parameters
    ----------
    f_t, b_t : array_like, shape (n, 3)
        Mean specific force, m/s^2, and field, T, in tool axes, for n >= 2 stations with the same tool and assembly.
    reference : Reference
        Reference with a field; its sigmas are the prior of the reference's error, which is common to all stations.
    errors : SensorErrors, optional
        Priors of bias, scale and axial interference, for example `tool_code.sensor_errors(code)`.

    Raises
    ------
    ValueError
        The shapes are wrong, there are fewer than two stations, a reading is not finite, or the reference has no field.
    """
    errors = SensorErrors() if errors is None else errors
    f, b = _readings(f_t, b_t)
    if not reference.has_field:
        raise ValueError("reference: a multi-station analysis needs the strength and dip of the field")
    problem = StationsProblem(f, b, reference, errors)
    return _result(problem, _fitted(problem))


def _readings(f_t: ArrayLike, b_t: ArrayLike) -> tuple[Array, Array]:
    f, b = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
    if f.ndim != 2 or f.shape[1] != 3 or f.shape != b.shape:
        raise ValueError(f"f_t and b_t: expected the same shape (n, 3), got {f.shape} and {b.shape}")
    if len(f) < 2:
        raise ValueError(f"f_t: a multi-station analysis needs two stations or more, got {len(f)}")
    if not (np.isfinite(f).all() and np.isfinite(b).all()):
        raise ValueError("f_t and b_t: every reading must be finite; leave incomplete stations out")
    return f, b


@dataclass(frozen=True)
class _ErrorFit:
    """Most probable errors (in prior sigmas), the stations used, and the quality of the fit as in `Multistation`."""

    solution: Array
    used: np.ndarray
    misfit: Array
    chi_square: float
    degrees: int
    probability: float


def _fitted(problem: StationsProblem) -> _ErrorFit:
    """
    Return the fit of the errors to the stations that are not outliers.

    While the largest misfit exceeds `_OUTLIER_SIGMA`, its station is dropped, as long as more than three stations and
    more than three quarters of all stations are in use. With at least `_MANY` stations in use, the noise is then scaled
    to the residuals and the fit repeated.
    """
    n = len(problem.f)
    used = np.ones(n, dtype=bool)
    while True:
        solution = problem.solve(used)
        misfit = problem.misfit(solution)
        worst = int(np.argmax(np.where(used, misfit, 0.0)))
        if misfit[worst] <= _OUTLIER_SIGMA or used.sum() <= max(3, (1.0 - _MAX_OUTLIERS) * n):
            break
        used[worst] = False
    degrees = int(3 * used.sum())
    chi_square = float(np.sum(problem.residual(solution, used) ** 2))
    # A few stations are not enough to estimate the noise.
    if used.sum() >= _MANY:
        for _ in range(2):
            problem.quieten(solution, used)
            solution = problem.solve(used)
    return _ErrorFit(solution, used, misfit, chi_square, degrees, exceeded(chi_square, degrees))


def _result(problem: StationsProblem, fit: _ErrorFit) -> Multistation:
    f, b, solution, used = problem.f, problem.b, fit.solution, fit.used
    slope = problem.slope(solution, used)
    covariance_x = np.asarray(np.linalg.inv(slope.T @ slope), dtype=float)
    estimate = problem.scale @ solution
    covariance = problem.scale @ covariance_x @ problem.scale.T
    prior = np.sqrt(np.diagonal(problem.scale @ problem.scale.T))
    sigma = np.sqrt(np.diagonal(covariance))
    f_c, b_c = corrected(f, b, estimate)
    jacobian = magnetic_geometry.angle_jacobian(f_c, b_c)
    spread = problem.reading_covariance(solution, covariance, used)
    angles = jacobian @ spread @ np.swapaxes(jacobian, 1, 2)
    before = problem.reading_covariance(np.zeros(15), problem.scale @ problem.scale.T, np.zeros(len(f), dtype=bool))
    jacobian_raw = magnetic_geometry.angle_jacobian(f, b)
    raw = jacobian_raw @ before @ np.swapaxes(jacobian_raw, 1, 2)
    sigma_azimuth = np.minimum(np.sqrt(angles[:, 1, 1]), np.pi)
    sigma_raw = np.minimum(np.sqrt(raw[:, 1, 1]), np.pi)
    return Multistation(
        estimate=estimate,
        sigma=sigma,
        prior=prior,
        azimuth=magnetic_geometry.raw_azimuth(f_c, b_c),
        sigma_azimuth=sigma_azimuth,
        inclination=inclination(f_c),
        sigma_inclination=np.sqrt(angles[:, 0, 0]),
        azimuth_raw=magnetic_geometry.raw_azimuth(f, b),
        used=used,
        chi_square=fit.chi_square,
        degrees=fit.degrees,
        probability=fit.probability,
        observable=sigma / prior < _OBSERVABLE,
        refused=_refusal(fit, sigma_azimuth, sigma_raw),
    )


def _refusal(fit: _ErrorFit, sigma: Array, sigma_raw: Array) -> Reason | None:
    """
    Return why the corrected azimuths must not be used; None if they may be used.

    sigma, sigma_raw: 1 sigma of the corrected and of the uncorrected azimuths, rad.
    """
    used, n = fit.used, float(len(fit.used))
    share = float(np.mean(~used))
    if share > _MAX_OUTLIERS or (np.where(used, fit.misfit, 0.0).max() > _OUTLIER_SIGMA):
        return Reason(Code.STATIONS_DO_NOT_FIT, float((~used).sum()), _MAX_OUTLIERS * n, (n,))
    if fit.probability < _MIN_PROBABILITY:
        numbers = (fit.chi_square, float(fit.degrees))
        return Reason(Code.STATIONS_IMPROBABLE, fit.probability, _MIN_PROBABILITY, numbers)
    typical, before = float(np.degrees(np.median(sigma))), float(np.degrees(np.median(sigma_raw)))
    if typical > _MAX_SIGMA_DEG:
        most = math.radians(_MAX_SIGMA_DEG)
        return Reason(Code.MULTI_STATION_UNCERTAIN, math.radians(typical), most)
    if typical > before:
        return Reason(Code.MULTI_STATION_NO_BETTER, math.radians(typical), math.radians(before))
    return None

# SPDX-License-Identifier: Apache-2.0
"""
Least-squares problem of the multi-station analysis: residuals of the stations of a run, and their derivatives.

See `multi_station_analysis` for the model and its source.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic import interference_filter
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import GRAVITY_SPREAD, STANDARD_GRAVITY

SENSORS = 12
"""Number of sensor errors; the errors of the reference follow them."""


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

# SPDX-License-Identifier: Apache-2.0
"""Statistics of least-squares calibrations: effect of temperature, sigmas from residuals, check of the attitudes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array

UNDETERMINED = "these attitudes do not determine scale, misalignment and bias; turn the probe further"


@dataclasses.dataclass(frozen=True)
class RunTemperature:
    """
    Temperature during a calibration run.

    Attributes
    ----------
    reference_c, span : float
        Mean and range, degC.
    warm : ndarray, shape (m,)
        Temperature above the reference divided by the range, so that all parameters of a fit have similar size.
    varied : bool
        Whether the range is large enough to fit the effect of temperature.
    """

    reference_c: float
    span: float
    warm: Array
    varied: bool

    @classmethod
    def of(cls, celsius: Array) -> RunTemperature:
        """Compute reference and range from temperatures, shape (m,), degC."""
        reference, varied = float(celsius.mean()), bool(np.ptp(celsius) > 1.0)
        span = float(np.ptp(celsius)) if varied else 1.0
        return cls(reference, span, (celsius - reference) / span, varied)

    @property
    def count(self) -> int:
        """Number of parameters besides the matrix: bias and, if temperature varied, slopes of bias and scale."""
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
    Return 1 sigma of the parameters of a least-squares fit, from the scatter of its residuals.

    Each rest has `parts` residuals, stored one after the other (interleaved) or all firsts before all seconds. A slow
    drift of the sensor makes neighbouring residuals similar, so that fewer of them are independent. The result is
    therefore the larger of the ordinary sigma and the one by Newey and West (Econometrica 55, 1987), with a lag of a
    fifth of the rests.
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
    Increase sigmas for drift: add half the residual scatter to the bias, and twice the scatter per range to its slope.

    A sensor that drifts while the temperature happens to rise looks like a sensor that depends on temperature.
    """
    return np.hypot(sigma_bias, 0.5 * scatter), np.hypot(sigma_bias_per_c, 2.0 * scatter / span)


def check_determined(jacobian: Array) -> None:
    """
    Raise ValueError if the attitudes do not determine the parameters of a fit.

    Raises
    ------
    ValueError
        The condition number of the scaled Jacobian is above 1e5.
    """
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    if np.linalg.cond(scaled) > 1e5:
        raise ValueError(UNDETERMINED)


def rms(x: Array) -> float:
    """Return the root mean square of vectors, shape (m, 3), or numbers, shape (m,)."""
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(x.T).T ** 2, axis=-1))))

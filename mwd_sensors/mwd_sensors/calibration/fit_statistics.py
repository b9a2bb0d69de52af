# SPDX-License-Identifier: Apache-2.0
"""Statistics of least-squares calibrations: influence of temperature, sigmas from residuals, what is not determined."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array

UNDETERMINED = "these attitudes do not determine scale, misalignment and bias; turn the probe further"


@dataclasses.dataclass(frozen=True)
class RunTemperature:
    """
    Temperature of a run.

    Attributes
    ----------
    reference_c, span : float
        Mean and range, degC.
    warm : ndarray, shape (m,)
        Temperature above the reference over the range, so that all figures of a fit are of one size.
    varied : bool
        Whether the range is large enough to fit the influence of temperature.
    """

    reference_c: float
    span: float
    warm: Array
    varied: bool

    @classmethod
    def of(cls, celsius: Array) -> RunTemperature:
        """Take reference and range from temperatures, shape (m,), degC."""
        reference, varied = float(celsius.mean()), bool(np.ptp(celsius) > 1.0)
        span = float(np.ptp(celsius)) if varied else 1.0
        return cls(reference, span, (celsius - reference) / span, varied)

    @property
    def count(self) -> int:
        """Number of figures beside the matrix: bias, and where temperature varied its influence on bias and scale."""
        return 9 if self.varied else 3

    def corrected(self, y: Array, p: Array) -> Array:
        """Correct readings, shape (m, 3), by the figures p: bias, and over the range of temperature bias and scale."""
        if not self.varied:
            return np.asarray(y - p[:3])
        warm = self.warm[:, None]
        return np.asarray((y - p[:3] - warm * p[3:6]) / (1.0 + warm * p[6:9]))

    def figures_of(self, p: Array, sigma: Array, strength: float, scatter: float) -> dict[str, Any]:
        """Name the figures p and their sigmas, SI; scatter: rms of the residuals over the strength."""
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
    1 sigma of the figures of a least-squares fit, from the scatter of its residuals.

    parts residuals belong to each rest: one after the other (interleaved), or all firsts before all seconds. A slow
    drift of the sensor leaves residuals that resemble their neighbours, and fewer of them count: the larger of the
    ordinary sigma and of that by Newey and West (Econometrica 55, 1987) with a fifth of the rests as its reach.
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
    Widen sigmas for drift: half the scatter of the residuals in the bias, twice the scatter over the range.

    A sensor that drifts while the temperature happens to rise looks like one that depends on the temperature.
    """
    return np.hypot(sigma_bias, 0.5 * scatter), np.hypot(sigma_bias_per_c, 2.0 * scatter / span)


def check_determined(jacobian: Array) -> None:
    """
    Refuse a fit that the attitudes do not determine.

    Raises
    ------
    ValueError
        The condition number of the scaled Jacobian is above 1e5.
    """
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    if np.linalg.cond(scaled) > 1e5:
        raise ValueError(UNDETERMINED)


def rms(x: Array) -> float:
    """Root mean square of vectors, shape (m, 3), or numbers, shape (m,)."""
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(x.T).T ** 2, axis=-1))))

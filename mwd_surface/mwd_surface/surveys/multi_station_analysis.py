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
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import inclination
from mwd_surface.surveys.multi_station_problem import StationsProblem
from mwd_surface.surveys.multi_station_problem import corrected as corrected_readings

__all__ = ["Multistation", "analyse"]

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
    f_c, b_c = corrected_readings(f, b, estimate)
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

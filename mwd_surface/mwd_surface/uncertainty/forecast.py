# SPDX-License-Identifier: Apache-2.0
"""
Forecast of surveys along a plan: their sigmas, the limits of quality control, and the share that will be accepted.

Sigmas come from the tool code at each attitude. The sigmas after the single-station correction of axial interference
come from the code with the same field model and with this correction (+AX), here called sibling. The corrected
azimuth has no accuracy where the hole is nearly horizontal east-west, because the field across the tool then hardly
depends on the azimuth. Limits come from the tool code. For the share of accepted surveys, single stations are drawn
from the errors of a healthy tool and judged by the rules of the estimator.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.stats import norm, qmc

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.verdicts import ACCEPT
from mwd_estimation.survey import tool_code, totals
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.station import station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.totals import Deviations, deviation_covariance
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import mat_nt, wrap_tau
from mwd_surface.trajectory.plan import Plan, interpolated
from mwd_surface.uncertainty.error_terms import ErrorReference, ErrorTool, Mask, angle_covariance, tool_codes

# Toolfaces over which the limits of quality control are averaged; the limits hardly depend on the toolface.
_TOOLFACES = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
# Number of stations that are drawn at each attitude, as a power of 2: 2^5, in a Sobol sequence of toolfaces and errors.
# The share of accepted stations then has a sigma of 0.09 (as with independent draws) or less. The same draws are used
# along the whole plan, so that the share changes only with the attitude.
_LOG2_DRAWS = 5
# Smallest angle between the directions of the hole at which the share is computed, rad; between them it is
# interpolated.
_APART = math.radians(5.0)
_VERTICAL = math.radians(1.0)  # inclination below which the azimuth has no sigma, rad
_STEP = 30.0  # distance between surveys, m
# Largest ratio of the azimuth's sigmas with and without correction for which the correction is useful.
_MUCH = 1.5


@dataclasses.dataclass(frozen=True)
class Forecast:
    """Expected quality of surveys along a plan."""

    #: `md`, `inclination`, `azimuth`: shape (n,); stations every 30 m, m and rad; azimuth from the north of the plan
    md: Array
    inclination: Array
    azimuth: Array
    true_azimuth: Array  #: shape (n,); azimuth from true north, rad
    #: `sigma_inclination`, `sigma_azimuth`: shape (n,); 1 sigma of inclination and azimuth by the tool code, rad; for
    #: the azimuth NaN within 1 deg of the vertical
    sigma_inclination: Array
    sigma_azimuth: Array
    #: shape (n,); 1 sigma of the azimuth after single-station correction, rad; NaN if `corrected_sibling` finds no code
    sigma_corrected: Array
    #: shape (n, 3); limits on the deviations of total gravity, total field and dip: m/s^2, T, rad; NaN for codes
    #: without these sensors
    limits: Array
    #: shape (n,); share of stations of a healthy tool that the estimator's verdict accepts, 0 to 1, from 32 random
    #: stations; NaN for codes without these sensors
    accepted: Array
    #: shape (n,); whether the sigma of the corrected azimuth exceeds `most`, and 1.5 times the sigma without correction
    no_go: Mask
    most: float  #: largest useful sigma of a corrected azimuth, rad
    axial: float  #: axial interference of the drill string assumed for `accepted`, T


def forecast(
    plan: Plan, north: str, code: str, reference: Reference, latitude: float, axial: float, most: float
) -> Forecast:
    """
    Return the forecast of surveys along a plan.

    Parameters
    ----------
    north : str
        North of the plan's azimuths: "true", "grid" or "magnetic".
    code : str
        Tool code.
    reference : Reference
        Reference with field and declination, and with convergence for a plan from grid north.
    latitude : float
        Latitude, rad; NaN if unknown.
    axial : float
        Expected axial interference of the drill string, T.
    most : float
        Largest useful sigma of a corrected azimuth, rad.

    Raises
    ------
    ValueError
        The reference lacks a value that is needed for the north of the plan, or `error_terms.angle_covariance` refuses
        the input.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    dense = interpolated(plan, _STEP)
    # Plan stations may be closer together than surveys: keep one station every 30 m, and the last.
    keep = np.unique(np.searchsorted(dense.md, np.append(np.arange(dense.md[0], dense.md[-1], _STEP), dense.md[-1])))
    md, inc, azi = dense.md[keep], dense.inclination[keep], dense.azimuth[keep]
    true = wrap_tau(azi + _to_true(north, reference))
    field = error_reference(reference, latitude)
    sigmas = _sigmas(code, (md, inc, true), field)
    sibling = corrected_sibling(code)
    corrected = _sigmas(sibling, (md, inc, true), field)[:, 1] if sibling else np.full(md.size, math.nan)
    limits, accepted = _quality(code, inc, true, reference, axial)
    # In a steep hole the azimuth is uncertain even without correction, so compare the two sigmas.
    no_go = np.nan_to_num(corrected) > np.maximum(most, _MUCH * np.nan_to_num(sigmas[:, 1], nan=math.inf))
    return Forecast(md, inc, azi, true, sigmas[:, 0], sigmas[:, 1], corrected, limits, accepted, no_go, most, axial)


def correction_map(
    code: str, reference: Reference, latitude: float, points: tuple[int, int] = (72, 30)
) -> tuple[Array, Array, Array]:
    """
    Return directions of the hole, and the sigma of the corrected azimuth in each direction, for a chart.

    points: number of azimuth steps, and number of inclinations. The results are true azimuths, shape (m,),
    inclinations, shape (k,), and sigmas, shape (k, m), rad. Other arguments and exceptions are those of `forecast`;
    also raises ValueError if `corrected_sibling` finds no code.
    """
    sibling = corrected_sibling(code)
    if not sibling:
        raise ValueError(f"code: {code} has no variant with a correction of axial interference (+AX)")
    azimuths = np.linspace(0.0, math.tau, points[0] + 1)
    inclinations = np.radians(np.linspace(2.0, 90.0, points[1]))
    field = error_reference(reference, latitude)
    # The angle errors of magnetic tools do not depend on the path above a station, so depths are arbitrary.
    md: Array = _STEP * np.arange(azimuths.size, dtype=float)
    rows = [_sigmas(sibling, (md, np.full(azimuths.size, inc), azimuths), field)[:, 1] for inc in inclinations]
    return azimuths, inclinations, np.array(rows)


def corrected_sibling(code: str) -> str:
    """Return the code with the same field model and with axial correction; empty if there is no such code."""
    kind = "EMS" if code.startswith("EMS") else "MWD"
    model = next((word for word in ("IFR2", "IFR1", "HRGM", "LRGM", "SRGM") if word in code), "")
    floating = "_Fl" if code.endswith("_Fl") else ""
    if not model or not code.startswith(("MWD", "EMS")):
        return ""
    known = tool_codes()
    wanted = ("+AX+SAG", "+AX") if "SAG" in code else ("+AX", "+AX+SAG")
    return next((name for end in wanted if (name := f"{kind}+{model}{end}{floating}") in known), "")


def error_reference(reference: Reference, latitude: float) -> ErrorReference:
    """
    Return the local field and gravity for the error models, from a reference and a latitude, rad.

    Unknown angles are 0, an unknown gravity is standard gravity. Raises ValueError if the reference has no field.
    """
    if reference.total is None or reference.dip is None:
        raise ValueError("reference: a forecast needs the field; give --lat, --lon and --date, or --field")
    gravity = STANDARD_GRAVITY if reference.gravity is None else reference.gravity
    return ErrorReference(
        latitude, reference.total, reference.dip, reference.declination or 0.0, reference.convergence or 0.0, gravity
    )


def _to_true(north: str, reference: Reference) -> float:
    turn = {"true": 0.0, "magnetic": reference.declination, "grid": reference.convergence}[north]
    if turn is None:
        needed = {"magnetic": "declination", "grid": "convergence"}[north]
        raise ValueError(f"azimuths from {north} north need the {needed}: give the {needed} (option --{needed})")
    return turn


def _sigmas(code: str, stations: tuple[Array, Array, Array], field: ErrorReference) -> Array:
    """Return the sigmas of inclination and azimuth from the error model of a tool code, shape (n, 2), rad."""
    inc = stations[1]
    covariance = angle_covariance(stations, ErrorTool(code), field)
    sigmas = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    near = np.sin(inc) < math.sin(_VERTICAL)
    return np.column_stack([sigmas[:, 0], np.where(near, math.nan, sigmas[:, 1])])


def _quality(code: str, inc: Array, true: Array, reference: Reference, axial: float) -> tuple[Array, Array]:
    """
    Return the limits of quality control, shape (n, 3), and the share of stations that are accepted, shape (n,).

    Both are as in `Forecast`; they are NaN for a code without magnetic sensors.
    """
    # OWSG set B differs from set A in the field model, not in the sensors.
    sensors = code.replace("HRGM", "SRGM").replace("LRGM", "SRGM")
    limits = np.full((inc.size, 3), math.nan)
    try:
        errors, coded = tool_code.sensor_errors(sensors), tool_code.reference_for(sensors, reference)
    except ValueError:
        # The code is of a gyro or an inclination-only tool.
        return limits, np.full(inc.size, math.nan)
    for k in range(inc.size):
        attitudes = [mat_nt(float(inc[k]), float(true[k]), toolface) for toolface in _TOOLFACES]
        limits[k] = np.mean([_limits(mat, errors, coded) for mat in attitudes], axis=0)
    at = _apart(inc, true)
    shares = [_accepted(float(inc[k]), float(true[k]), errors, coded, axial) for k in at]
    return limits, np.interp(np.arange(inc.size), at, shares)


def _apart(inc: Array, true: Array) -> list[int]:
    """
    Return the indices of stations whose directions are far enough apart to compute the share.

    They are the first and the last station, and each station whose direction differs by more than `_APART` from the
    direction of the previously chosen station.
    """
    axes = np.column_stack([np.sin(inc) * np.cos(true), np.sin(inc) * np.sin(true), np.cos(inc)])
    chosen = [0]
    for k in range(1, inc.size):
        if k == inc.size - 1 or axes[k] @ axes[chosen[-1]] < math.cos(_APART):
            chosen.append(k)
    return chosen


def _limits(mat: Array, errors: SensorErrors, reference: Reference) -> Array:
    """
    Return the limits of quality control of a tool at an attitude, shape (3,): m/s^2, T, rad.

    mat: rotation matrix from tool axes to north, east, down.
    """
    f_t, b_t = mat.T @ np.array([0.0, 0.0, -_gravity(reference)]), mat.T @ _field_n(reference)
    own = errors.covariance(f_t, b_t)
    expected = deviation_covariance(f_t, b_t, reference, own, errors.axial_interference_nt * 1e-9)
    return totals.bounds(Deviations(0.0, 0.0, 0.0, expected), QualitySettings())


def _accepted(inclination: float, true: float, errors: SensorErrors, reference: Reference, axial: float) -> float:
    """Return the share, 0 to 1, of random stations of a healthy tool that the verdict accepts; axial: field, T."""
    settings, accepted = StationSettings(errors=errors), 0
    draws = qmc.Sobol(d=10, seed=1).random_base2(_LOG2_DRAWS)
    # A Sobol sequence can contain 0, whose normal quantile is infinite.
    normal = norm.ppf(np.clip(draws[:, 1:], 1e-6, 1.0 - 1e-6))
    for toolface, of_field, of_tool in zip(math.tau * draws[:, 0], normal[:, :3], normal[:, 3:], strict=True):
        mat = mat_nt(inclination, true, float(toolface))
        here = dataclasses.replace(
            reference,
            total=(reference.total or 0.0) + reference.sigma_total * of_field[0],
            dip=(reference.dip or 0.0) + reference.sigma_dip * of_field[1],
            gravity=_gravity(reference) + reference.sigma_gravity * of_field[2],
        )
        f_t, b_t = mat.T @ np.array([0.0, 0.0, -_gravity(here)]), mat.T @ _field_n(here)
        drawn = of_tool * np.sqrt(np.diagonal(errors.covariance(f_t, b_t)))
        found = station(f_t + drawn[:3], b_t + drawn[3:] + [axial, 0.0, 0.0], reference, settings)
        accepted += found.verdict == ACCEPT
    return accepted / len(draws)


def _gravity(reference: Reference) -> float:
    return STANDARD_GRAVITY if reference.gravity is None else reference.gravity


def _field_n(reference: Reference) -> Array:
    """Return the field in true north, east, down, shape (3,), T."""
    declination = reference.declination or 0.0
    level = np.array([math.cos(declination), math.sin(declination)]) * reference.horizontal
    return np.append(level, reference.vertical)

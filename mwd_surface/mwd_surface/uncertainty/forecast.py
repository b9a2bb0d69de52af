# SPDX-License-Identifier: Apache-2.0
"""
Forecast along a plan: how well inclination and azimuth will be known, what quality control allows, how much will pass.

Sigmas are those of the tool code at each attitude. The single-station correction of axial interference is judged by the
code's sibling with that correction (+AX): its azimuth is lost where the hole is near horizontal east-west, for there
the field along the tool says the same as the field across it (S0). Limits are those of the verdict by tool code.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey import tool_code, totals
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.totals import Deviations, deviation_covariance
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import mat_nt, wrap_tau
from mwd_surface.trajectory.plan import Plan, interpolated
from mwd_surface.uncertainty.error_terms import ErrorReference, Mask, Tool, angle_covariance, tool_codes

# Toolfaces over which quality control is averaged: its limits hardly depend on it.
_TOOLFACES = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
_VERTICAL = math.radians(1.0)
_STEP = 30.0
# A correction that makes the azimuth's sigma so many times larger is of no use.
_MUCH = 1.5


@dataclasses.dataclass(frozen=True)
class Forecast:
    """
    What to expect of surveys along a plan.

    Attributes
    ----------
    md, inclination, azimuth : ndarray, shape (n,)
        Stations every 30 m, m and rad, from the north of the plan.
    true_azimuth : ndarray, shape (n,)
        From true north, rad.
    sigma_inclination, sigma_azimuth : ndarray, shape (n,)
        1 sigma by the tool code, rad; the azimuth's is nan nearer than 1 deg to vertical.
    sigma_corrected : ndarray, shape (n,)
        Of the azimuth after a single-station correction of axial interference, rad; nan where the code has no sibling.
    limits : ndarray, shape (n, 3)
        On the deviations of total gravity, total field and dip: m/s^2, T, rad; nan of codes without these sensors.
    pass_rate : ndarray, shape (n,)
        Probability that a sound tool keeps all three limits, without a correction; nan as the limits.
    no_go : ndarray of bool, shape (n,)
        The corrected azimuth's sigma is over `most`, and much over that without correction.
    most : float
        Largest sigma of a corrected azimuth that is of use, rad.
    axial : float
        Axial interference taken for pass_rate, T.
    """

    md: Array
    inclination: Array
    azimuth: Array
    true_azimuth: Array
    sigma_inclination: Array
    sigma_azimuth: Array
    sigma_corrected: Array
    limits: Array
    pass_rate: Array
    no_go: Mask
    most: float
    axial: float


def forecast(
    plan: Plan, north: str, code: str, reference: Reference, latitude: float, axial: float, most: float
) -> Forecast:
    """
    Forecast surveys along a plan.

    Parameters
    ----------
    plan : Plan
    north : str
        Of its azimuths: "true", "grid" or "magnetic".
    code : str
        Tool code.
    reference : Reference
        With field, declination, and convergence for a plan from grid north.
    latitude : float
        rad; nan where not known.
    axial : float
        Axial interference of the drill string to expect, T.
    most : float
        Largest sigma of a corrected azimuth that is of use, rad.

    Raises
    ------
    ValueError
        A reference without what the plan's north needs, or what `error_terms.angle_covariance` refuses.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    dense = interpolated(plan, _STEP)
    # The stations of a plan itself stand closer than surveys do; every 30 m is what will be surveyed.
    keep = np.unique(np.searchsorted(dense.md, np.append(np.arange(dense.md[0], dense.md[-1], _STEP), dense.md[-1])))
    md, inc, azi = dense.md[keep], dense.inclination[keep], dense.azimuth[keep]
    true = wrap_tau(azi + _to_true(north, reference))
    field = error_reference(reference, latitude)
    sigmas = _sigmas(code, (md, inc, true), field)
    sibling = corrected_sibling(code)
    corrected = _sigmas(sibling, (md, inc, true), field)[:, 1] if sibling else np.full(md.size, math.nan)
    limits, passes = _quality(code, inc, true, reference, axial)
    # Where the hole is steep every azimuth is weak; that is not the fault of the correction.
    no_go = np.nan_to_num(corrected) > np.maximum(most, _MUCH * np.nan_to_num(sigmas[:, 1], nan=math.inf))
    return Forecast(md, inc, azi, true, sigmas[:, 0], sigmas[:, 1], corrected, limits, passes, no_go, most, axial)


def correction_map(
    code: str, reference: Reference, latitude: float, points: tuple[int, int] = (72, 30)
) -> tuple[Array, Array, Array]:
    """
    Sigma of the corrected azimuth over all directions, for a chart.

    points: of azimuth and inclination. Returns true azimuths, shape (m,), inclinations, shape (k,), and sigmas, shape
    (k, m), rad. Arguments and errors otherwise as `forecast`; ValueError too for a code without a corrected sibling.
    """
    sibling = corrected_sibling(code)
    if not sibling:
        raise ValueError(f"code: {code} has no sibling with a correction of axial interference (+AX)")
    azimuths = np.linspace(0.0, math.tau, points[0] + 1)
    inclinations = np.radians(np.linspace(2.0, 90.0, points[1]))
    field = error_reference(reference, latitude)
    # The errors of magnetic tools do not depend on the way to a station; the depths are any.
    md: Array = _STEP * np.arange(azimuths.size, dtype=float)
    rows = [_sigmas(sibling, (md, np.full(azimuths.size, inc), azimuths), field)[:, 1] for inc in inclinations]
    return azimuths, inclinations, np.array(rows)


def corrected_sibling(code: str) -> str:
    """Tool code with the same field model and the axial correction; empty for gyros and others without."""
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
    Return the local field as the error models want it.

    Raises ValueError where the reference has no field.
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
        raise ValueError(f"reference: azimuths from {north} north need the {needed}")
    return turn


def _sigmas(code: str, stations: tuple[Array, Array, Array], field: ErrorReference) -> Array:
    """Sigma of inclination and azimuth by a code, shape (n, 2), rad."""
    inc = stations[1]
    covariance = angle_covariance(stations, Tool(code), field)
    sigmas = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    near = np.sin(inc) < math.sin(_VERTICAL)
    return np.column_stack([sigmas[:, 0], np.where(near, math.nan, sigmas[:, 1])])


def _quality(code: str, inc: Array, true: Array, reference: Reference, axial: float) -> tuple[Array, Array]:
    """Limits of quality control, shape (n, 3), and the probability to keep them, shape (n,)."""
    # Set B differs from set A in the model of the field, not in the sensors.
    sensors = code.replace("HRGM", "SRGM").replace("LRGM", "SRGM")
    limits, passes = np.full((inc.size, 3), math.nan), np.full(inc.size, math.nan)
    try:
        errors, coded = tool_code.sensor_errors(sensors), tool_code.reference_for(sensors, reference)
    except ValueError:
        # A gyro, or an inclination-only tool.
        return limits, passes
    gravity = STANDARD_GRAVITY if reference.gravity is None else reference.gravity
    field = error_reference(reference, math.nan)
    b_n = _field_n(field)
    for k in range(inc.size):
        found = []
        for toolface in _TOOLFACES:
            mat = mat_nt(float(inc[k]), float(true[k]), toolface)
            f_t, b_t = mat.T @ np.array([0.0, 0.0, -gravity]), mat.T @ b_n
            own = errors.covariance(f_t, b_t)
            expected = deviation_covariance(f_t, b_t, coded, own, errors.axial_interference_nt * 1e-9)
            limit = totals.bounds(Deviations(0.0, 0.0, 0.0, expected), QualitySettings())
            sound = deviation_covariance(f_t, b_t, coded, own, 0.0)
            found.append((limit, _kept(limit, sound, _shift(f_t, b_t, axial))))
        limits[k] = np.mean([limit for limit, _ in found], axis=0)
        passes[k] = np.mean([kept for _, kept in found])
    return limits, passes


def _field_n(field: ErrorReference) -> Array:
    """Field in true north, east, down, shape (3,), T."""
    horizontal = field.b_total * math.cos(field.dip)
    return np.array(
        [
            horizontal * math.cos(field.declination),
            horizontal * math.sin(field.declination),
            field.b_total * math.sin(field.dip),
        ]
    )


def _shift(f_t: Array, b_t: Array, axial: float) -> Array:
    """Change of total gravity, total field and dip by axial interference, shape (3,): m/s^2, T, rad."""
    disturbed = b_t + np.array([axial, 0.0, 0.0])
    total, before = float(np.linalg.norm(disturbed)), float(np.linalg.norm(b_t))
    return np.array([0.0, total - before, magnetic_geometry.dip(f_t, disturbed) - magnetic_geometry.dip(f_t, b_t)])


def _kept(limit: Array, covariance: Array, shift: Array) -> float:
    """Probability that deviations with a mean and a covariance stay within limits, shape (3,)."""
    from scipy.stats import multivariate_normal

    scale = np.sqrt(np.diagonal(covariance))
    mean, bound = shift / scale, limit / scale
    # A fixed seed: the integration draws points.
    normal = multivariate_normal(mean, covariance / np.outer(scale, scale), seed=1)
    return float(normal.cdf(bound, lower_limit=-bound))

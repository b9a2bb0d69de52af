"""One survey station: six averaged axes to angles, totals, azimuth by each method with its sigma, and a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference, best_north, north_correction, to_north
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.survey import acceptance, azimuth_selection
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, REJECT, Deviations
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.station_checks import (
    Correction,
    Findings,
    check_field,
    check_hidden,
    check_interference,
)
from mwd_estimation.survey.station_deviations import deviations, gross_faults
from mwd_estimation.survey.station_record import MethodAzimuth, Station, blind
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import (
    gravity_toolface,
    inclination,
    magnetic_toolface,
    mat_from_quat,
    mat_nt,
    quat_from_rotvec,
    wrap_tau,
)

__all__ = ["MethodAzimuth", "Station", "StationSettings", "station"]

# 1 sigma of an azimuth of which nothing is known.
_UNKNOWN_SIGMA = math.pi
# With a smaller share of the field horizontal there is no azimuth at all.
_LEVEL = 1e-6
# A smaller correction of sag is not worth a word, rad.
_LEAST_SAG = math.radians(0.005)
# Less is no reading, T, m/s^2.
_NO_FIELD = 1e-12
_NO_GRAVITY = 1e-3
# Where there is no horizontal field any field serves for the slopes of inclination and toolface, T.
_ANY_FIELD = (1e-5, 2e-5, 3e-5)
_NO_CORRECTION = Correction()


@dataclass(frozen=True)
class _Readings:
    """Readings in tool axes (f_t, b_t) and hole axes (f_h, b_h), their covariance (6, 6), and what follows directly."""

    f_t: Array
    b_t: Array
    f_h: Array
    b_h: Array
    covariance: Array
    jacobian: Array
    has_field: bool
    b_total: float
    inclination: float
    toolface: float
    dip: float


@dataclass(frozen=True)
class _North:
    """Name of the north, what to add to a magnetic azimuth, rad, and the variance that this adds, rad^2."""

    name: str
    turn: float
    variance: float = 0.0


@dataclass(frozen=True)
class _Azimuths:
    """The magnetic azimuths of the reading, the one chosen, and the single-station correction behind them."""

    methods: tuple[azimuth_selection.Method, ...] = ()
    chosen: azimuth_selection.Method | None = None
    correction: Correction = _NO_CORRECTION


def station(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference | None = None,
    settings: StationSettings | None = None,
    *,
    covariance_f: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
    faults: tuple[Reason, ...] = (),
) -> Station:
    """
    Compute one station from its six averaged axes.

    Parameters
    ----------
    f_t, b_t : array_like, shape (3,)
        Mean specific force, m/s^2 (up at rest), and mean field, T, in tool axes. A nan marks a missing sensor.
    reference : Reference, optional
        Without one the azimuth is magnetic and uncorrected, and the station doubtful.
    settings : StationSettings, optional
    covariance_f, covariance_b : array_like, shape (3, 3), optional
        Noise of the two means, (m/s^2)^2 and T^2; what the sensors get wrong alike comes from the settings.
    faults : tuple of Reason
        What is known to be wrong with the readings: each rejects the station.

    Returns
    -------
    Station

    Raises
    ------
    ValueError
        Shapes other than (3,) and (3, 3).
    """
    settings = StationSettings() if settings is None else settings
    f_raw, b_raw = _vector("f_t", f_t), _vector("b_t", b_t)
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = _matrix("covariance_f", covariance_f), _matrix("covariance_b", covariance_b)
    if not (np.isfinite(f_raw).all() and float(np.linalg.norm(f_raw)) > _NO_GRAVITY):
        return blind(f_raw, b_raw, reference, (Reason(Code.NO_ACCELEROMETER), *faults))
    readings = _readings(f_raw, b_raw, noise, settings)
    findings = Findings()
    north = _north(reference, settings.north, findings, readings.has_field)
    if readings.has_field and reference is not None and north.name != "magnetic":
        variance = reference.declination_variance(_horizontal(readings, reference))
        north = _North(north.name, north.turn, variance)
    azimuths = _azimuths(readings, reference, settings)
    return _finished(readings, reference, settings, north, azimuths, findings, faults)


def _finished(
    readings: _Readings,
    reference: Reference | None,
    settings: StationSettings,
    north: _North,
    azimuths: _Azimuths,
    findings: Findings,
    faults: tuple[Reason, ...],
) -> Station:
    """The station, checked and with its verdict."""
    apart, doubted = _checked(readings, reference, settings, findings, north.name, azimuths.correction)
    findings.add(REJECT, *faults)
    within = acceptance.within(apart, settings.quality.limits) if findings.verdict == ACCEPT else ()
    g_limit, b_limit, dip_limit = acceptance.bounds(apart, settings.quality.limits).tolist()
    inc, toolface, correction = readings.inclination, readings.toolface, azimuths.correction
    azimuth = toolface_north = math.nan
    if azimuths.chosen is not None:
        azimuth = to_north(azimuths.chosen.azimuth, north.turn)
        toolface_north = float(magnetic_toolface(mat_nt(inc, azimuth, toolface)))
    alignment = settings.errors.alignment(inc)
    covariance = _covariance(readings, azimuths, north, alignment)
    interference, sigma_interference = correction.interference
    offset = math.radians(settings.toolface_offset_deg)
    sag = settings.sag.at(inc)
    if abs(sag) >= _LEAST_SAG:
        findings.remark(Reason(Code.SAG_CORRECTED, sag))
    return Station(
        inclination=min(max(inc + sag, 0.0), math.pi),
        sigma_inclination=math.sqrt(covariance[0, 0]),
        gravity_toolface=float(wrap_tau(toolface + offset)),
        magnetic_toolface=float(wrap_tau(toolface_north + offset)),
        sigma_toolface=math.sqrt(covariance[2, 2]),
        g_total=float(np.linalg.norm(readings.f_t)),
        b_total=readings.b_total,
        dip=readings.dip,
        azimuth=azimuth,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        north=north.name,
        method=AzimuthMethod.NONE if azimuths.chosen is None else azimuths.chosen.name,
        corrected=correction.chosen,
        azimuths=tuple(_method_azimuth(method, north, correction.refused) for method in azimuths.methods),
        interference=interference,
        sigma_interference=sigma_interference,
        interference_chi_square=math.nan if correction.estimate is None else float(correction.estimate.chi_square),
        covariance=covariance,
        alignment=alignment,
        deviations=apart,
        verdict=findings.verdict,
        reasons=(*findings.reasons, *within, *findings.remarks),
        reference=reference,
        north_correction=north.turn,
        f_t=readings.f_t,
        b_t=readings.b_t,
        azimuth_doubts=doubted,
        limits=(g_limit, b_limit, dip_limit),
    )


def _readings(f_t: Array, b_t: Array, noise: Array, settings: StationSettings) -> _Readings:
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = _to_hole(settings)
    b_total = float(np.linalg.norm(b_t))
    has_field = bool(np.isfinite(b_t).all()) and b_total > _NO_FIELD
    has_field = has_field and math.cos(float(magnetic_geometry.dip(f_t, b_t))) > _LEVEL
    f_h, b_h = turn[:3, :3] @ f_t, turn[:3, :3] @ (b_t if has_field else np.array(_ANY_FIELD))
    return _Readings(
        f_t=f_t,
        b_t=b_t,
        f_h=f_h,
        b_h=b_h,
        covariance=turn @ noise @ turn.T + settings.errors.covariance(f_h, b_h),
        jacobian=magnetic_geometry.angle_jacobian(f_h, b_h),
        has_field=has_field,
        b_total=b_total if has_field else math.nan,
        inclination=float(inclination(f_h)),
        toolface=float(gravity_toolface(f_h)),
        dip=float(magnetic_geometry.dip(f_h, b_h)) if has_field else math.nan,
    )


def _horizontal(readings: _Readings, reference: Reference | None) -> float:
    """Horizontal field, T: the reference's, else as measured."""
    if reference is not None and reference.has_field:
        return reference.horizontal
    return readings.b_total * math.cos(readings.dip)


def _north(reference: Reference | None, wanted: str, findings: Findings, has_field: bool) -> _North:
    """The north asked for; magnetic, with a reason, where what leads to it is not known."""
    north = best_north(reference) if wanted == "best" else wanted
    turn = north_correction(reference, north)
    if turn is not None:
        return _North(north, turn)
    if north == "true" and not has_field:
        # A gyro finds it without a declination, and there is nothing else to refer to it.
        return _North(north, 0.0)
    missing = "declination and convergence" if north == "grid" else "declination"
    findings.add(DOUBTFUL, Reason(Code.NORTH_UNKNOWN, names=(north, missing)))
    return _North("magnetic", 0.0)


def _azimuths(readings: _Readings, reference: Reference | None, settings: StationSettings) -> _Azimuths:
    if not readings.has_field:
        return _Azimuths()
    f_h, b_h, jacobian, covariance_s = readings.f_h, readings.b_h, readings.jacobian, readings.covariance
    expected, plausible = settings.errors.axial_interference_nt * 1e-9, settings.plausible_interference_nt * 1e-9
    estimate, refused, hidden = None, None, False
    if reference is not None and reference.has_field:
        estimate = axial_correction.axial_correction(
            f_h,
            b_h,
            reference.horizontal,
            reference.vertical,
            covariance_s,
            reference.covariance,
            plausible=plausible,
        )
        refused = acceptance.correction_refusal(estimate, readings.inclination, settings.quality)
        hidden = azimuth_selection.hidden(estimate, jacobian, covariance_s, expected, plausible)
    methods = [azimuth_selection.raw(f_h, b_h, jacobian, covariance_s, expected, plausible, estimate)]
    if estimate is not None and math.isfinite(float(estimate.azimuth)):
        methods.append(azimuth_selection.corrected(estimate, jacobian, covariance_s))
    chosen = azimuth_selection.choose(settings.azimuth_method, methods, estimate, refused, expected, plausible)
    is_corrected = chosen.name == AzimuthMethod.SINGLE_STATION
    return _Azimuths(tuple(methods), chosen, Correction(estimate, refused, is_corrected, hidden))


def _checked(
    readings: _Readings,
    reference: Reference | None,
    settings: StationSettings,
    findings: Findings,
    north: str,
    correction: Correction,
) -> tuple[Deviations, tuple[Reason, ...]]:
    """Check the readings; returns the deviations from the reference and what doubts only the magnetic azimuth."""
    f_h, b_h, has_field = readings.f_h, readings.b_h, readings.has_field
    taken_off = correction.interference[0] if correction.chosen else 0.0
    apart = deviations(f_h, b_h, reference, readings.covariance, settings.errors, taken_off, has_field)
    judgement = acceptance.judge(apart, settings.quality.limits)
    findings.add(judgement.verdict, *judgement.reasons)
    b_earth = b_h - np.array([taken_off, 0.0, 0.0])
    earth = (math.nan, math.nan)
    if has_field:
        earth = float(np.linalg.norm(b_earth)), float(magnetic_geometry.dip(f_h, b_earth))
    findings.add(REJECT, *gross_faults(float(np.linalg.norm(readings.f_t)), *earth, reference))
    if not has_field:
        what = Code.NO_HORIZONTAL_FIELD if np.isfinite(readings.b_t).all() else Code.NO_MAGNETOMETER
        missing = Reason(Code.INCLINATION_ONLY, causes=(Reason(what),))
        findings.add(REJECT, missing)
        return apart, (missing,)
    check_field(findings, settings, reference, north, _horizontal(readings, reference))
    doubted = check_interference(findings, settings, correction)
    doubted += check_hidden(findings, float(readings.jacobian[1, 3]), correction.hidden)
    if math.sin(readings.inclination) < math.sin(math.radians(settings.quality.min_azimuth_inclination_deg)):
        findings.remark(Reason(Code.NEAR_VERTICAL))
    return apart, doubted


def _covariance(readings: _Readings, azimuths: _Azimuths, north: _North, alignment: Array) -> Array:
    """Covariance (3, 3) of inclination, azimuth and toolface, all errors included."""
    if azimuths.chosen is not None:
        covariance = azimuths.chosen.covariance + alignment
        covariance[1, 1] += north.variance
    else:
        covariance = readings.jacobian @ readings.covariance @ readings.jacobian.T + alignment
        covariance[1, :], covariance[:, 1] = 0.0, 0.0
        covariance[1, 1] = _UNKNOWN_SIGMA**2
    return _capped(covariance)


def _method_azimuth(method: azimuth_selection.Method, north: _North, refused: Reason | None) -> MethodAzimuth:
    return MethodAzimuth(
        method.name,
        to_north(method.azimuth, north.turn),
        min(math.sqrt(method.covariance[1, 1] + north.variance), _UNKNOWN_SIGMA),
        refused if method.name == AzimuthMethod.SINGLE_STATION else None,
    )


def _to_hole(settings: StationSettings) -> Array:
    """Rotation (3, 3) from tool axes to hole axes by the known misalignment."""
    angles = np.array([0.0, math.radians(settings.misalignment_y_deg), math.radians(settings.misalignment_z_deg)])
    return np.asarray(mat_from_quat(quat_from_rotvec(-angles)))


def _capped(covariance: Array) -> Array:
    """Covariance with no angle less certain than the full circle; correlations kept."""
    sigma = np.sqrt(np.diagonal(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(sigma > _UNKNOWN_SIGMA, _UNKNOWN_SIGMA / sigma, 1.0)
    return np.asarray(covariance * scale[:, None] * scale[None, :])


def _vector(name: str, value: ArrayLike) -> Array:
    vector = np.array(value, dtype=float)
    if vector.shape != (3,):
        raise ValueError(f"{name}: expected three axes, shape (3,), got {vector.shape}")
    return vector


def _matrix(name: str, value: ArrayLike | None) -> Array:
    matrix = np.zeros((3, 3)) if value is None else np.array(value, dtype=float)
    if matrix.shape != (3, 3):
        raise ValueError(f"{name}: expected shape (3, 3), got {matrix.shape}")
    return matrix

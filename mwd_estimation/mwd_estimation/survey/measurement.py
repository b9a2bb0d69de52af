# SPDX-License-Identifier: Apache-2.0
"""Quantities of one station from the means of its six axes: angles, totals, and azimuths of single methods."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import chi_square, magnetic_geometry
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference, best_north, north_correction, to_north
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.posterior.field_model import Row, geometry
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.totals import deviations
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

# 1 sigma of an unknown azimuth, rad.
_UNKNOWN_SIGMA = math.pi
# The azimuth is unknown if the ratio of horizontal to total field is not larger than this.
_LEVEL = 1e-6
# Smallest field, T, and specific force, m/s^2, that count as a reading.
_NO_FIELD = 1e-12
_NO_GRAVITY = 1e-3
# Field for the derivatives of inclination and toolface if there is no horizontal field, T; its value does not matter.
_ANY_FIELD = (1e-5, 2e-5, 3e-5)
# Axial interference that the single-station correction assumes, 1 sigma, T.
_PLAUSIBLE = 3e-6
# Largest number of stations that are corrected in one call; more would need more memory and take as long.
_BLOCK = 50
# Limits for a corrected azimuth: largest 1 sigma, rad; smallest inclination, rad; and largest chi-square of the
# cross-axial field (one degree of freedom, exceeded by chance once in 1000).
_LEAST_CERTAIN = math.radians(3.0)
NEAR_VERTICAL = math.radians(1.0)
_MISFIT = chi_square.limit(0.001, 1)


@dataclass(frozen=True)
class StationReadings:
    """Readings in tool axes (f_t, b_t) and hole axes (f_h, b_h), and quantities computed from them; m/s^2, T, rad."""

    f_t: Array
    b_t: Array
    f_h: Array
    b_h: Array
    noise: Array  #: shape (6, 6); covariance of the means (f_h, b_h) by noise
    covariance: Array  #: shape (6, 6); `noise` plus the errors that remain after calibration
    jacobian: Array  #: shape (3, 6); derivative of (inclination, azimuth, toolface) with respect to (f_h, b_h)
    has_field: bool
    b_total: float
    inclination: float
    toolface: float
    dip: float


@dataclass(frozen=True)
class NorthTurn:
    """Name of a north, angle to add to a magnetic azimuth, rad, and variance of this angle, rad^2."""

    name: str
    turn: float
    variance: float = 0.0


@dataclass(frozen=True)
class Measured:
    """A station before its azimuth is found."""

    #: Station with the azimuths of single methods, the uncorrected azimuth and no verdict.
    station: Station
    readings: StationReadings | None  #: readings; None without a usable accelerometer
    reasons: tuple[Reason, ...] = ()  #: reason if the reference does not allow the wanted north

    @property
    def declination(self) -> float:
        """Angle from the north of the azimuths in `row` to magnetic north, rad; 0 if that is magnetic north."""
        reference = self.station.reference
        if self.station.north == "magnetic" or reference is None or reference.declination is None:
            return 0.0
        return reference.declination

    @functools.cached_property
    def row(self) -> Row | None:
        """Record of the station for the posterior, without a gyro; None without a usable accelerometer."""
        readings = self.readings
        if readings is None:
            return None
        b_h = readings.b_h if readings.has_field else np.full(3, math.nan)
        return geometry(readings.f_h, b_h, readings.noise, self.station.reference, self.declination)[0]


def measured(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference | None = None,
    settings: StationSettings | None = None,
    *,
    covariance_f: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
) -> Measured:
    """
    Compute angles, totals and azimuths of single methods of a station.

    For the arguments and the errors raised see `station.station`.
    """
    settings = StationSettings() if settings is None else settings
    f_raw, b_raw = _vector("f_t", f_t), _vector("b_t", b_t)
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = _matrix("covariance_f", covariance_f), _matrix("covariance_b", covariance_b)
    readings = _readings(f_raw, b_raw, noise, settings)
    (estimate,) = _axial_corrections([readings], [reference])
    return _measured(f_raw, b_raw, readings, reference, settings, estimate)


def measured_rows(
    f_t: Array, b_t: Array, references: Sequence[Reference | None], settings: StationSettings
) -> list[Measured]:
    """
    Compute n stations without noise of the means, as `measured`; much faster than one by one.

    f_t, b_t: shape (n, 3), as in `measured`; references: of each station.
    """
    noise = np.zeros((6, 6))
    readings = [_readings(f_raw, b_raw, noise, settings) for f_raw, b_raw in zip(f_t, b_t, strict=True)]
    estimates = _axial_corrections(readings, references)
    return [
        _measured(f_raw, b_raw, one, reference, settings, estimate)
        for f_raw, b_raw, one, reference, estimate in zip(f_t, b_t, readings, references, estimates, strict=True)
    ]


def _measured(
    f_t: Array,
    b_t: Array,
    readings: StationReadings | None,
    reference: Reference | None,
    settings: StationSettings,
    estimate: AxialCorrection | None,
) -> Measured:
    """Return a station from its readings and its single-station correction."""
    if readings is None:
        b_total = float(np.linalg.norm(b_t))
        return Measured(Station(f_t, b_t, reference, b_total=b_total, reasons=(Reason(Code.NO_ACCELEROMETER),)), None)
    north, missing = _north(reference, settings.north, readings.has_field)
    if readings.has_field and reference is not None and north.name != "magnetic":
        north = NorthTurn(north.name, north.turn, reference.declination_variance(_horizontal(readings, reference)))
    return Measured(_unjudged(readings, reference, settings, north, estimate), readings, missing)


def _unjudged(
    readings: StationReadings,
    reference: Reference | None,
    settings: StationSettings,
    north: NorthTurn,
    estimate: AxialCorrection | None,
) -> Station:
    """Return the station with its angles, totals and uncorrected azimuth, without a verdict."""
    inc, toolface = readings.inclination, readings.toolface
    alignment = settings.errors.alignment(inc)
    covariance = readings.jacobian @ readings.covariance @ readings.jacobian.T + alignment
    azimuth = toolface_north = math.nan
    methods: tuple[MethodAzimuth, ...] = ()
    if readings.has_field:
        across = settings.errors.cross_interference_nt * 1e-9
        string = readings.jacobian[:, 3:] * np.square([settings.axial_sigma(reference), across, across])
        covariance[1] += string @ readings.jacobian[1, 3:]
        covariance[:, 1] = covariance[1]
        covariance[1, 1] += north.variance
        azimuth = to_north(float(magnetic_geometry.raw_azimuth(readings.f_h, readings.b_h)), north.turn)
        toolface_north = float(magnetic_toolface(mat_nt(inc, azimuth, toolface)))
        own = min(math.sqrt(covariance[1, 1] - alignment[1, 1]), _UNKNOWN_SIGMA)
        methods = (
            MethodAzimuth(AzimuthMethod.RAW, azimuth, own),
            *_corrected(readings, estimate, north),
        )
    else:
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[1, 1] = _UNKNOWN_SIGMA**2
    covariance = capped(covariance)
    offset, sag = math.radians(settings.toolface_offset_deg), settings.sag.at(inc)
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
        method=AzimuthMethod.RAW if readings.has_field else AzimuthMethod.NONE,
        azimuths=methods,
        covariance=covariance,
        alignment=alignment,
        deviations=deviations(
            readings.f_h, readings.b_h, reference, readings.covariance, settings.errors, 0.0, readings.has_field
        ),
        reference=reference,
        north_correction=north.turn,
        f_t=readings.f_t,
        b_t=readings.b_t,
    )


def _axial_corrections(
    readings: Sequence[StationReadings | None], references: Sequence[Reference | None]
) -> list[AxialCorrection | None]:
    """Return the single-station correction of each station; None without a field or a reference field."""
    found: list[AxialCorrection | None] = [None] * len(readings)
    usable = [
        (k, one, reference)
        for k, (one, reference) in enumerate(zip(readings, references, strict=True))
        if one is not None and one.has_field and reference is not None and reference.has_field
    ]
    for begin in range(0, len(usable), _BLOCK):
        places, ones, fields = zip(*usable[begin : begin + _BLOCK], strict=True)
        estimate = axial_correction.axial_correction(
            [one.f_h for one in ones],
            [one.b_h for one in ones],
            [reference.horizontal for reference in fields],
            [reference.vertical for reference in fields],
            [one.covariance for one in ones],
            [reference.covariance for reference in fields],
            plausible=_PLAUSIBLE,
        )
        for k, *values in zip(places, *vars(estimate).values(), strict=True):
            found[k] = AxialCorrection(*values)
    return found


def _corrected(
    readings: StationReadings, estimate: AxialCorrection | None, north: NorthTurn
) -> tuple[MethodAzimuth, ...]:
    """
    Return the azimuth of the single-station correction, with a reason if refused.

    The result is empty without a reference field, or in an exactly vertical hole.
    """
    if estimate is None or not math.isfinite(float(estimate.azimuth)):
        return ()
    refused = correction_refusal(estimate, readings.inclination)
    azimuth = to_north(float(estimate.azimuth), north.turn)
    sigma = min(math.hypot(float(estimate.sigma_azimuth), math.sqrt(north.variance)), _UNKNOWN_SIGMA)
    return (MethodAzimuth(AzimuthMethod.SINGLE_STATION, azimuth, sigma, refused),)


def correction_refusal(correction: AxialCorrection, inclination: float) -> Reason | None:
    """
    Return the reason why an axial correction of one station must not be used; None if it may.

    correction: correction of one station (arrays of shape ()); inclination: rad.
    """
    from_vertical = min(inclination, math.pi - inclination)
    if not from_vertical >= NEAR_VERTICAL:
        return Reason(Code.CORRECTION_NEAR_VERTICAL, from_vertical, NEAR_VERTICAL)
    if correction.chi_square > _MISFIT:
        return Reason(Code.CROSS_AXIAL_MISFIT, float(correction.chi_square), _MISFIT)
    if correction.mirror:
        first, second = (float(angle) for angle in correction.both)
        return Reason(Code.TWO_AZIMUTHS_FIT_FIELD, values=(first, second))
    sigma = float(correction.sigma_azimuth)
    if not sigma <= _LEAST_CERTAIN:
        from_horizontal = abs(0.5 * math.pi - inclination)
        from_east_west = abs(math.asin(min(1.0, abs(math.cos(float(correction.azimuth))))))
        return Reason(Code.CORRECTION_UNCERTAIN, sigma, _LEAST_CERTAIN, (from_horizontal, from_east_west))
    return None


def _readings(f_t: Array, b_t: Array, noise: Array, settings: StationSettings) -> StationReadings | None:
    """Return the readings of a station; None without a usable accelerometer."""
    if not (np.isfinite(f_t).all() and float(np.linalg.norm(f_t)) > _NO_GRAVITY):
        return None
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = _to_hole(settings)
    b_total = float(np.linalg.norm(b_t))
    has_field = bool(np.isfinite(b_t).all()) and b_total > _NO_FIELD
    has_field = has_field and math.cos(float(magnetic_geometry.dip(f_t, b_t))) > _LEVEL
    f_h, b_h = turn[:3, :3] @ f_t, turn[:3, :3] @ (b_t if has_field else np.array(_ANY_FIELD))
    return StationReadings(
        f_t=f_t,
        b_t=b_t,
        f_h=f_h,
        b_h=b_h,
        noise=turn @ noise @ turn.T,
        covariance=turn @ noise @ turn.T + settings.errors.covariance(f_h, b_h),
        jacobian=magnetic_geometry.angle_jacobian(f_h, b_h),
        has_field=has_field,
        b_total=b_total if has_field else math.nan,
        inclination=float(inclination(f_h)),
        toolface=float(gravity_toolface(f_h)),
        dip=float(magnetic_geometry.dip(f_h, b_h)) if has_field else math.nan,
    )


def _horizontal(readings: StationReadings, reference: Reference | None) -> float:
    """Return the horizontal field of the reference, T; without a reference, the measured one."""
    if reference is not None and reference.has_field:
        return reference.horizontal
    return readings.b_total * math.cos(readings.dip)


def _north(reference: Reference | None, wanted: str, has_field: bool) -> tuple[NorthTurn, tuple[Reason, ...]]:
    """
    Return the wanted north; or magnetic north and a reason, if the declination or convergence is not known.

    Without a field (`has_field`), true north needs no declination.
    """
    north = best_north(reference) if wanted == "best" else wanted
    turn = north_correction(reference, north)
    if turn is not None:
        return NorthTurn(north, turn), ()
    if north == "true" and not has_field:
        # A gyro finds true north without a declination, and without a field no magnetic azimuth has to be converted.
        return NorthTurn(north, 0.0), ()
    missing = "declination and convergence" if north == "grid" else "declination"
    return NorthTurn("magnetic", 0.0), (Reason(Code.NORTH_UNKNOWN, names=(north, missing)),)


def _to_hole(settings: StationSettings) -> Array:
    """Return the rotation, shape (3, 3), from tool axes to hole axes by the known misalignment."""
    angles = np.array([0.0, *map(math.radians, settings.hole_axis_deg)])
    return np.asarray(mat_from_quat(quat_from_rotvec(-angles)))


def capped(covariance: Array) -> Array:
    """Return a covariance of angles, rad^2, with sigmas of at most pi and unchanged correlations."""
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

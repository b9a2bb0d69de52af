"""A survey: one station with when, how and from what it was measured."""

from __future__ import annotations

import dataclasses
import math
import uuid
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import fusion
from mwd_estimation.north_seek import Solution
from mwd_estimation.quality import ACCEPT, DOUBTFUL
from mwd_estimation.reference import Reference
from mwd_estimation.station import CORRECTED, MethodAzimuth, Station, StationSettings, station
from mwd_estimation.still_survey import StillAverage
from mwd_sensors.frames import wrap_pi, wrap_tau

Array = NDArray[np.float64]

GYRO = "gyro"

# Names a survey by its time and readings, so that a replay names it alike whatever its number (RFC 4122, version 5).
_SURVEYS = uuid.UUID("6b0d4f5e-6f0e-5c1b-9a55-3a5d2c1b7e10")


@dataclasses.dataclass(frozen=True)
class Survey:
    """
    One survey as the estimator hands it over.

    Attributes
    ----------
    stamp_ns : int
        Middle of the averaging interval.
    sequence : int
        From 1.
    uuid : str
    requested : bool
        Asked for, not taken by itself.
    duration : float
        s.
    samples : int
        IMU samples averaged.
    station : Station
        Angles, totals, verdict; its azimuth is the fused one.
    weights : mapping of str to float
        Share of each of the station's methods in its azimuth.
    azimuth_reasons : mapping of str to str
        Why a method has no weight; empty where there is nothing to say.
    covariance_f, covariance_b : ndarray, shape (3, 3)
        Of the averaged specific force, (m/s^2)^2, and field, T^2: the noise alone.
    rate_t : ndarray, shape (3,)
        Mean angular rate of the precision unit, else of the AHRS, rad/s.
    temperature : float or None
        degC.
    """

    stamp_ns: int
    sequence: int
    uuid: str
    requested: bool
    duration: float
    samples: int
    station: Station
    covariance_f: Array
    covariance_b: Array
    rate_t: Array
    temperature: float | None
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    azimuth_reasons: Mapping[str, str] = dataclasses.field(default_factory=dict)


def from_average(
    still: StillAverage,
    sequence: int,
    reference: Reference | None,
    settings: StationSettings,
    gyro: Solution | str | None = None,
    fusing: fusion.Settings | None = None,
) -> Survey:
    """
    Work out the survey of a still interval.

    gyro: north found with the precision unit, or in words why there is none; None without such a unit.
    """
    b_t = still.mag.mean if still.mag is not None else np.full(3, np.nan)
    covariance_b = still.mag.covariance if still.mag is not None else np.zeros((3, 3))
    covariance_f = still.imu.covariance[3:, 3:]
    rates = still.precision if still.precision is not None else still.imu
    stamp_ns = (still.start_ns + still.end_ns) // 2
    magnetic = station(
        still.imu.mean[3:], b_t, reference, settings, covariance_f=covariance_f, covariance_b=covariance_b
    )
    whole, weights, reasons = fused(magnetic, gyro, fusing)
    return Survey(
        stamp_ns=stamp_ns,
        sequence=sequence,
        uuid=str(uuid.uuid5(_SURVEYS, f"{stamp_ns} {[float(v) for v in still.imu.mean]}")),
        requested=still.requested,
        duration=(still.end_ns - still.start_ns) * 1e-9,
        samples=still.imu.count,
        station=whole,
        covariance_f=covariance_f,
        covariance_b=covariance_b,
        rate_t=rates.mean[:3],
        temperature=still.temperature,
        weights=weights,
        azimuth_reasons=reasons,
    )


def fused(
    magnetic: Station, gyro: Solution | str | None, settings: fusion.Settings | None = None
) -> tuple[Station, dict[str, float], dict[str, str]]:
    """
    The station with the gyro's azimuth weighed in, the weight of each method, and why a method has none.

    Of the magnetic azimuths the one that the station's own rule chose is weighed, for they are one reading. A station
    whose field failed its check is compared with the gyro, not averaged; a disagreement makes it doubtful at least.
    """
    weights = {one.method: float(one.method == magnetic.method) for one in magnetic.azimuths}
    reasons = {one.method: _not_chosen(one, magnetic) for one in magnetic.azimuths}
    if gyro is None:
        return magnetic, weights, reasons
    found, shared = _gyro_azimuth(gyro, magnetic)
    azimuths = (*magnetic.azimuths, found)
    if found.refused:
        listed = dataclasses.replace(magnetic, azimuths=azimuths)
        return listed, {**weights, GYRO: 0.0}, {**reasons, GYRO: found.refused}
    doubt = "" if magnetic.verdict == ACCEPT else "; ".join(magnetic.reasons)
    reference = magnetic.reference
    declination = 0.0
    if reference is not None and magnetic.north != "magnetic":
        declination = math.sqrt(reference.declination_variance(_horizontal(reference)))
    candidates = [
        fusion.Candidate(
            "axial" if one.method == CORRECTED else one.method,
            one.azimuth,
            one.sigma,
            shared={"declination": min(declination, one.sigma)},
            doubt=doubt,
            refused=reasons[one.method],
        )
        for one in magnetic.azimuths
    ]
    candidates.append(fusion.Candidate(GYRO, found.azimuth, found.sigma, family=fusion.GYRO, shared=shared))
    result = fusion.fuse(candidates, settings)
    names = [one.method for one in azimuths]
    weights = dict(zip(names, result.weights, strict=True))
    reasons = dict(zip(names, result.reasons, strict=True))
    if not math.isfinite(result.azimuth):
        return dataclasses.replace(magnetic, azimuths=azimuths), weights, reasons
    carrying = [name for name in names if weights[name] > 0.0]
    covariance = magnetic.covariance.copy()
    # What ties the magnetic azimuth to inclination and toolface is kept by its share.
    share = sum(weights[name] for name in names if name != GYRO)
    covariance[1, :] *= share
    covariance[:, 1] *= share
    covariance[1, 1] = min(result.sigma**2 + magnetic.alignment[1, 1], math.pi**2)
    before = magnetic.azimuth if math.isfinite(magnetic.azimuth) else result.azimuth
    turned = float(wrap_pi(result.azimuth - before))
    station_ = dataclasses.replace(
        magnetic,
        azimuth=result.azimuth,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        magnetic_toolface=float(wrap_tau(magnetic.magnetic_toolface + turned)),
        method=carrying[0] if len(carrying) == 1 else "fused",
        azimuths=azimuths,
        covariance=covariance,
        verdict=DOUBTFUL if result.alarm and magnetic.verdict == ACCEPT else magnetic.verdict,
        reasons=(result.alarm, *magnetic.reasons) if result.alarm else magnetic.reasons,
    )
    return station_, weights, reasons


def _not_chosen(one: MethodAzimuth, magnetic: Station) -> str:
    if one.method == magnetic.method:
        return ""
    return one.refused or f"the {magnetic.method} azimuth of the same reading is used"


def _horizontal(reference: Reference) -> float:
    return reference.horizontal if reference.has_field else 1e-5


def _gyro_azimuth(gyro: Solution | str, magnetic: Station) -> tuple[MethodAzimuth, dict[str, float]]:
    """The gyro's azimuth from the station's north, and the terms it shares with the magnetic ones."""
    if isinstance(gyro, str):
        return MethodAzimuth(GYRO, math.nan, math.nan, gyro), {}
    if not math.isfinite(gyro.azimuth):
        return MethodAzimuth(GYRO, math.nan, math.nan, gyro.reason), {}
    reference, variance = magnetic.reference, 0.0
    turn: float | None = 0.0
    if magnetic.north == "grid":
        turn = reference.convergence if reference is not None else None
    elif magnetic.north == "magnetic":
        turn = reference.declination if reference is not None else None
        if turn is not None and reference is not None:
            variance = reference.declination_variance(_horizontal(reference))
    if turn is None:
        why = f"the gyro finds true north and what {magnetic.north} north is from there is not known"
        return MethodAzimuth(GYRO, math.nan, math.nan, why), {}
    sigma = min(math.hypot(gyro.sigma, math.sqrt(variance)), math.pi)
    shared = {"declination": -min(math.sqrt(variance), sigma)} if variance else {}
    return MethodAzimuth(GYRO, float(wrap_tau(gyro.azimuth - turn)), sigma, gyro.reason), shared

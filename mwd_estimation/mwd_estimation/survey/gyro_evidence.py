"""
The azimuth of the gyrocompass at a station: what it is from the station's north, and what it leaves open.

External interference that turns the field and leaves its total and dip in order shows in nothing but a gyro. So a
magnetic azimuth that the gyro has not confirmed is a matter of the verdict, by the rules of `unconfirmed`.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import azimuth_fusion
from mwd_estimation.survey.acceptance import DOUBTFUL
from mwd_estimation.survey.azimuth_fusion import Candidate, Fused, Settings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_sensors.core.frames import wrap_pi, wrap_tau

# A gyro's choice between azimuths is left to the magnetometer where one lies within the first of its azimuth and all
# others beyond the second: no interference that leaves total and dip in order turns a field so far.
_NEAR, _FAR = math.radians(60.0), math.radians(90.0)
# Refusals that a second position of the tool, or more time there, lifts.
_SECOND_POSITION = frozenset({Code.GYRO_BIAS_UNKNOWN, Code.GYRO_BIAS_UNKNOWN_STATIC, Code.TWO_AZIMUTHS_FIT_GYRO})


def chosen_by_field(gyro: Solution | None, alone: Station) -> Solution | None:
    """The gyro's answer; of azimuths that fit it equally, the one nearest to the magnetic azimuth of the station."""
    if gyro is None or not gyro.choices or not math.isfinite(alone.azimuth):
        return gyro
    turn = _from_true(alone)
    if turn is None:
        return gyro
    ranked = sorted(gyro.choices, key=lambda one: abs(float(wrap_pi(one[0] - turn - alone.azimuth))))
    away = [abs(float(wrap_pi(azimuth - turn - alone.azimuth))) for azimuth, _ in ranked]
    if away[0] > _NEAR or min(away[1:]) < _FAR:
        return gyro
    return dataclasses.replace(gyro, reason=None, azimuth=ranked[0][0], sigma=ranked[0][1], choices=())


def gyro_azimuth(gyro: Solution, station: Station) -> tuple[MethodAzimuth, dict[str, float]]:
    """The gyro's azimuth from the station's north, and the error terms it shares with the magnetic ones, rad."""
    if not math.isfinite(gyro.azimuth):
        return MethodAzimuth(AzimuthMethod.GYRO, math.nan, math.nan, gyro.reason), {}
    reference, variance, turn = station.reference, 0.0, _from_true(station)
    if station.north == "magnetic" and turn is not None and reference is not None:
        variance = reference.declination_variance(_horizontal(reference))
    if turn is None:
        unknown = Reason(Code.GYRO_NORTH_UNKNOWN, names=(station.north,))
        return MethodAzimuth(AzimuthMethod.GYRO, math.nan, math.nan, unknown), {}
    sigma = min(math.hypot(gyro.sigma, math.sqrt(variance)), math.pi)
    shared = {"declination": -min(math.sqrt(variance), sigma)} if variance else {}
    return MethodAzimuth(AzimuthMethod.GYRO, float(wrap_tau(gyro.azimuth - turn)), sigma, gyro.reason), shared


def gyro_for_run(station: Station, gyro: Solution) -> tuple[float, float, float]:
    """
    A gyro's azimuth as `StationRun.add_gyro` takes it.

    White noise errs at each station anew. All else (bias, sensitivity to gravity, scale) is taken to err alike at all,
    and so is the declination that leads from true to magnetic north.
    """
    reference = station.reference
    if reference is None or reference.declination is None:
        return math.nan, math.nan, 0.0
    declination = math.sqrt(reference.declination_variance(_horizontal(reference)))
    noise = min(gyro.limit, gyro.sigma)
    lasting = math.hypot(math.sqrt(gyro.sigma**2 - noise**2), declination)
    return float(wrap_tau(gyro.azimuth - reference.declination)), noise, lasting


def declination_sigma(station: Station) -> float:
    """1 sigma of the declination in azimuths from the station's north, rad."""
    reference = station.reference
    if reference is None or station.north == "magnetic":
        return 0.0
    return math.sqrt(reference.declination_variance(_horizontal(reference)))


def left_open(magnetic: Candidate, gyro: Candidate, result: Fused, settings: Settings) -> Reason | None:
    """
    What a gyro that is not certain enough leaves open of a station; None where nothing.

    It is no alarm: one sound station in eight is 1.5 sigma away. But external interference that turns the field by tens
    of degrees and keeps its total and dip shows in nothing else.
    """
    if result.alarm or not math.isfinite(gyro.azimuth) or gyro.refused is not None:
        return None
    if not math.isfinite(magnetic.azimuth):
        most = math.radians(settings.alone_deg)
        return None if gyro.sigma <= most else Reason(Code.GYRO_ONLY_UNCERTAIN, gyro.sigma, most)
    apart = float(wrap_pi(gyro.azimuth - magnetic.azimuth))
    ratio = abs(apart) / math.hypot(gyro.sigma, magnetic.sigma)
    if ratio <= settings.open_sigmas or abs(apart) <= math.radians(settings.open_deg):
        return None
    names = (gyro.method, magnetic.method)
    return Reason(Code.GYRO_UNDECIDED, apart, math.radians(settings.open_deg), (ratio,), names)


def unconfirmed(
    missing: Reason | None, last_alarm: tuple[Reason, ...], could: bool = False
) -> tuple[Reason | None, Reason | None]:
    """
    What a station is worth whose magnetic azimuth the gyro has not confirmed: a doubt and a remark, each may be None.

    Where the gyro has shown external interference at the last station, an azimuth that it has not compared is
    doubtful; where it has shown none yet, or agreed, the station stands on its own checks, with a remark that
    it was not compared. Where half a turn is all that the gyro lacks, that is a doubt too: it costs
    minutes, and nothing else on board knows.

    Parameters
    ----------
    missing : Reason or None
        Why there is no gyro azimuth here; None where there is one, or no gyro in the tool.
    last_alarm : tuple of Reason
        `Fused.alarm` of the last station at which both were compared; empty where they agreed or none was compared.
    could : bool
        Whether a second position would make the gyro certain enough.
    """
    if missing is None:
        return None, None
    if last_alarm:
        return Reason(Code.NOT_CONFIRMED_BY_GYRO, causes=(missing, *last_alarm)), None
    remark = Reason(Code.NOT_COMPARED_WITH_GYRO, causes=(missing,))
    return (remark, None) if could else (None, remark)


def could_confirm(gyro: Solution, settings: Settings) -> bool:
    """Whether a second position, or time, is all the gyro lacks to judge the azimuth, and the settings ask for it."""
    return (
        settings.unconfirmed == DOUBTFUL
        and gyro.reason is not None
        and gyro.reason.code in _SECOND_POSITION
        and gyro.limit <= math.radians(settings.alone_deg)
    )


def lasting_sigma(gyro: Solution) -> float:
    """1 sigma of what the gyro gets wrong alike at all stations, rad."""
    return math.sqrt(gyro.sigma**2 - min(gyro.limit, gyro.sigma) ** 2)


def candidate(found: MethodAzimuth, shared: dict[str, float]) -> Candidate:
    """The gyro's azimuth for the fusion."""
    return Candidate(AzimuthMethod.GYRO, found.azimuth, found.sigma, azimuth_fusion.GYRO, shared)


def _horizontal(reference: Reference) -> float:
    return reference.horizontal if reference.has_field else 1e-5


def _from_true(station: Station) -> float | None:
    """What to take off an azimuth from true north for one from the station's, rad; None where that is not known."""
    reference = station.reference
    if station.north == "grid":
        return reference.convergence if reference is not None else None
    if station.north == "magnetic":
        return reference.declination if reference is not None else None
    return 0.0

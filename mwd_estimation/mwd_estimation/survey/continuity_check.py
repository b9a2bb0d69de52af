"""
Continuity of a survey with what came before it: the gyro-propagated azimuth and the azimuth of the samples.

The gyro-propagated azimuth is that of the last accepted station, turned on by the gyros alone. It owes nothing to the
magnetic field between the two stations nor at the second, and so shows external interference that keeps total field and
dip in order where no gyro sought north. But it *is* the last station's azimuth: an error both stations share
(declination, drill-string interference) is in both. So it is never averaged into an azimuth that passes its checks: it
agrees and changes nothing, or it disagrees, and that is an alarm. Only where the station has no azimuth of its own that
holds does it stand in.

The azimuth of the samples reads the same magnetometer, but knows of it what turning the tool has shown: biases and
scales across the axis, which one station does not show. Why it is so: ``docs/methods/azimuth_fusion.md``.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.attitude.block import StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_state import PropagatedAzimuth
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, REJECT, worse
from mwd_estimation.survey.azimuth_fusion import Settings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.gyro_evidence import declination_sigma
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.survey import STATIC, Survey
from mwd_sensors.core.frames import wrap_pi, wrap_tau

GYRO, GYRO_PROPAGATED = AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED
# A smaller difference, rad, is not worth another survey, however many sigma it is: the multi-station analysis
# changes its azimuths by as much while it learns.
_LEAST = math.radians(1.0)


def accepted_azimuth(survey: Survey) -> StationAzimuth:
    """
    What the gyros propagate from a survey; nan where it was not accepted.

    Sigma is the tool axis' own, without how the tool lies in the hole: that is what the gyros propagate.
    """
    station = survey.station
    if survey.kind != STATIC or station.verdict != ACCEPT or not math.isfinite(station.azimuth):
        return StationAzimuth()
    return StationAzimuth(station.azimuth, _own_sigma(station), _lasting(survey), _by_gyro(survey))


def checked(survey: Survey, propagated: PropagatedAzimuth, settings: Settings) -> Survey:
    """
    The survey, checked for continuity.

    Parameters
    ----------
    survey : Survey
    propagated : PropagatedAzimuth
        From the station's north.
    settings : azimuth_fusion.Settings
        When azimuths disagree, and which are too uncertain to compare.

    Returns
    -------
    Survey
        With the method GYRO_PROPAGATED. Where the azimuths disagree: with the alarm, and unless a gyro found north
        here, doubtful and its sigma widened by the difference. Where the station has no azimuth, or one that its own
        check doubts: with the gyro-propagated one, doubtful still. Doubtful and widened as well where it is far from
        that of the samples.
    """
    if survey.kind != STATIC:
        return survey
    return _against_samples(_against_propagated(survey, propagated, settings), propagated, settings)


def _against_propagated(survey: Survey, propagated: PropagatedAzimuth, settings: Settings) -> Survey:
    azimuth, sigma, lasting, _, _ = propagated
    station = survey.station
    if not (math.isfinite(azimuth) and sigma > 0.0):
        return survey
    listed = dataclasses.replace(station, azimuths=(*station.azimuths, MethodAzimuth(GYRO_PROPAGATED, azimuth, sigma)))
    widest = math.radians(settings.widest_deg)
    if sigma > widest:
        return _with(survey, listed, Reason(Code.AZIMUTH_UNCERTAIN, sigma, widest))
    known = math.isfinite(station.azimuth)
    apart = float(wrap_pi(station.azimuth - azimuth)) if known else 0.0
    own = _own_sigma(station) if known else 0.0
    variance = max(sigma**2 + own**2 - 2.0 * lasting * _lasting(survey), 1e-4 * sigma**2)
    ratio = abs(apart) / math.sqrt(variance)
    gyro = _by_gyro(survey)
    alarm: tuple[Reason, ...] = ()
    if ratio > settings.disagreement_sigmas and abs(apart) > _LEAST:
        limit, names = settings.disagreement_sigmas, (station.method,)
        alarm = (Reason(Code.PROPAGATED_DISAGREES, apart, limit, (ratio,), names),)
    doubted = bool(station.azimuth_doubts) and station.verdict != ACCEPT and not gyro
    if station.verdict != REJECT and (doubted or not known):
        listed = _stands_in(listed, azimuth, sigma, apart)
        weights = {**dict.fromkeys(survey.weights, 0.0), GYRO_PROPAGATED: 1.0}
        return dataclasses.replace(_with(survey, listed, None, alarm), weights=weights)
    if not alarm:
        return _with(survey, listed, Reason(Code.PROPAGATED_AGREES))
    if gyro:
        # The gyro found north here: it is the station before, or the way from it, that was wrong.
        listed = dataclasses.replace(listed, reasons=(*station.reasons, *alarm))
        return _with(survey, listed, alarm[0], alarm)
    unresolved = dataclasses.replace(alarm[0], code=Code.PROPAGATED_DISAGREES_UNRESOLVED)
    return _with(survey, _widened(listed, apart, unresolved), alarm[0], alarm)


def _stands_in(station: Station, azimuth: float, sigma: float, apart: float) -> Station:
    """The station with the gyro-propagated azimuth, rad, 1 sigma; apart: how far its own is from that, rad."""
    why = station.azimuth_doubts[0] if station.azimuth_doubts else Reason(Code.NO_OTHER_AZIMUTH)
    covariance = station.covariance.copy()
    covariance[1, :] = covariance[:, 1] = 0.0
    covariance[1, 1] = min(sigma**2 + station.alignment[1, 1], math.pi**2)
    turned = apart if math.isfinite(station.magnetic_toolface) else 0.0
    return dataclasses.replace(
        station,
        azimuth=azimuth,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        magnetic_toolface=float(wrap_tau(station.magnetic_toolface - turned)),
        covariance=covariance,
        method=GYRO_PROPAGATED,
        verdict=worse(station.verdict, DOUBTFUL),
        reasons=(*station.reasons, Reason(Code.PROPAGATED_USED, causes=(why,))),
    )


def _against_samples(survey: Survey, propagated: PropagatedAzimuth, settings: Settings) -> Survey:
    """A magnetic station against the azimuth of the samples up to it: which errs less, nothing here shows."""
    station, azimuth, sigma = survey.station, propagated.azimuth, propagated.sigma
    known = math.isfinite(azimuth + station.azimuth) and 0.0 < sigma <= math.radians(settings.widest_deg)
    decided = survey.alarm or survey.left_open or station.method == GYRO_PROPAGATED or station.verdict == REJECT
    if not known or decided or _by_gyro(survey):
        return survey
    apart = float(wrap_pi(station.azimuth - azimuth))
    # The declination is in both.
    shared = min(declination_sigma(station), sigma) * _lasting(survey)
    ratio = abs(apart) / math.sqrt(max(sigma**2 + _own_sigma(station) ** 2 - 2.0 * shared, 1e-4 * sigma**2))
    if ratio <= settings.disagreement_sigmas or abs(apart) <= _LEAST:
        return survey
    limit, names = settings.disagreement_sigmas, (station.method,)
    reason = Reason(Code.SAMPLES_DISAGREE, apart, limit, (ratio,), names)
    return dataclasses.replace(survey, station=_widened(station, apart, reason))


def _widened(station: Station, apart: float, reason: Reason) -> Station:
    """The station, doubtful for a reason, with a difference in its sigma."""
    covariance = station.covariance.copy()
    covariance[1, 1] = min(covariance[1, 1] + apart**2, math.pi**2)
    return dataclasses.replace(
        station,
        covariance=covariance,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        verdict=worse(station.verdict, DOUBTFUL),
        reasons=(reason, *station.reasons),
    )


def _by_gyro(survey: Survey) -> bool:
    """Whether the gyro makes most of the azimuth: one that hardly weighs does not."""
    return survey.weights.get(GYRO, 0.0) > 0.5


def _with(survey: Survey, station: Station, reason: Reason | None, alarm: tuple[Reason, ...] = ()) -> Survey:
    """The survey with a station, why the gyro-propagated azimuth has no weight, and an alarm beside its own."""
    alarms = (*(survey.alarm or ()), *alarm)
    return dataclasses.replace(
        survey,
        station=station,
        weights={**survey.weights, GYRO_PROPAGATED: 0.0},
        azimuth_reasons={**survey.azimuth_reasons, GYRO_PROPAGATED: reason},
        alarm=alarms or survey.alarm,
    )


def _own_sigma(station: Station) -> float:
    return math.sqrt(max(float(station.covariance[1, 1] - station.alignment[1, 1]), 1e-12))


def _lasting(survey: Survey) -> float:
    """1 sigma of the declination in the survey's azimuth, rad: what its magnetic part shares with every other."""
    magnetic = sum(weight for name, weight in survey.weights.items() if name not in (GYRO, GYRO_PROPAGATED))
    return min(magnetic * declination_sigma(survey.station), _own_sigma(survey.station))

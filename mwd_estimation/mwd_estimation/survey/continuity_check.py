"""
The azimuths that were carried to a station, as witnesses there: that of the last accepted station, by the gyros alone,
and that of the samples up to here.

The first owes nothing to the magnetic field between the two stations nor at the second, and so shows steel that keeps
total field and dip in order where no gyro sought north. But it *is* the last station's azimuth: an error both stations
share (declination, the tool's own field) is in both. So it is never averaged into an azimuth that passes its checks: it
agrees and changes nothing, or it disagrees, and that is an alarm. Only where the station has no azimuth of its own that
holds does it stand in.

The second reads the same magnetometer, but knows of it what turning the tool has shown: biases and scales across the
axis, which one station does not show. The rule and its reasons: ``docs/fusion.md``.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, REJECT, worse
from mwd_estimation.survey.azimuth_fusion import Settings
from mwd_estimation.survey.station import MethodAzimuth, Station
from mwd_estimation.survey.survey import GYRO, STATIC, Survey, declination_sigma
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau

CARRIED = "carried"
# A smaller difference, rad, is not worth another survey, however many sigma it is: the analysis of many stations
# changes its mind by as much while it learns.
_LEAST = math.radians(1.0)


def handed_on(taken: Survey) -> tuple[float, float, float, float]:
    """
    What a survey gives the gyros to carry on, as `continuous_azimuth.Steps.station`; nan where it was not accepted.

    Sigma is the tool axis' own, without how the tool lies in the hole: that is what the gyros carry.
    """
    station = taken.station
    if taken.kind != STATIC or station.verdict != ACCEPT or not math.isfinite(station.azimuth):
        return (math.nan,) * 4
    return station.azimuth, _own_sigma(station), _lasting(taken), float(_by_gyro(taken))


def held_against(taken: Survey, anchor: Array, settings: Settings) -> Survey:
    """
    A survey held against the azimuths carried on to it.

    Parameters
    ----------
    taken : Survey
    anchor : ndarray, shape (5,)
        As `continuous_azimuth.Rows.anchor`, from the station's north.
    settings : fusion.Settings
        When azimuths disagree, and which are too uncertain to compare.

    Returns
    -------
    Survey
        With the method "carried". Where the azimuths disagree: with the alarm, and unless a gyro found north here,
        doubtful and its sigma widened by the difference. Where the station has no azimuth, or one that its own check
        doubts: with the carried one, doubtful still. Doubtful and widened as well where it is far from that of the
        samples.
    """
    if taken.kind != STATIC:
        return taken
    return _held_against_samples(_held_against_station(taken, anchor, settings), anchor, settings)


def _held_against_station(taken: Survey, anchor: Array, settings: Settings) -> Survey:
    azimuth, sigma, lasting = (float(value) for value in anchor[:3])
    station = taken.station
    if not (math.isfinite(azimuth) and sigma > 0.0):
        return taken
    listed = dataclasses.replace(station, azimuths=(*station.azimuths, MethodAzimuth(CARRIED, azimuth, sigma, "")))
    if sigma > math.radians(settings.widest_deg):
        return _with(taken, listed, f"not certain enough: {math.degrees(sigma):.0f} deg")
    known = math.isfinite(station.azimuth)
    apart = float(wrap_pi(station.azimuth - azimuth)) if known else 0.0
    own = _own_sigma(station) if known else 0.0
    variance = max(sigma**2 + own**2 - 2.0 * lasting * _lasting(taken), 1e-4 * sigma**2)
    ratio = abs(apart) / math.sqrt(variance)
    gyro = _by_gyro(taken)
    text = ""
    if ratio > settings.disagreement_sigmas and abs(apart) > _LEAST:
        text = (
            f"{station.method} azimuth is {math.degrees(apart):+.1f} deg ({ratio:.1f} sigma) from the one that the "
            "gyros carried on from the last accepted station"
        )
    doubted = bool(station.azimuth_doubts) and station.verdict != ACCEPT and not gyro
    if station.verdict != REJECT and (doubted or not known):
        why = station.azimuth_doubts[0] if station.azimuth_doubts else "there is no other"
        reason = f"azimuth carried by the gyros from the last accepted station, for: {why}"
        covariance = listed.covariance.copy()
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[1, 1] = min(sigma**2 + station.alignment[1, 1], math.pi**2)
        turned = apart if math.isfinite(station.magnetic_toolface) else 0.0
        listed = dataclasses.replace(
            listed,
            azimuth=azimuth,
            sigma_azimuth=math.sqrt(covariance[1, 1]),
            magnetic_toolface=float(wrap_tau(station.magnetic_toolface - turned)),
            covariance=covariance,
            method=CARRIED,
            verdict=worse(station.verdict, DOUBTFUL),
            reasons=(*station.reasons, reason),
        )
        weights = {**dict.fromkeys(taken.weights, 0.0), CARRIED: 1.0}
        return dataclasses.replace(_with(taken, listed, "", text), weights=weights)
    if not text:
        return _with(taken, listed, "agrees; it comes from the stations before and adds nothing of its own")
    if gyro:
        # The gyro found north here: it is the station before, or the way from it, that was wrong.
        listed = dataclasses.replace(listed, reasons=(*station.reasons, text))
        return _with(taken, listed, text, text)
    listed = _widened(listed, apart, text + "; let the tool rest for the gyro, or survey again")
    return _with(taken, listed, text, text)


def _held_against_samples(taken: Survey, anchor: Array, settings: Settings) -> Survey:
    """A magnetic station held against the azimuth of the samples up to it: which errs less, nothing here says."""
    station, azimuth, sigma = taken.station, float(anchor[3]), float(anchor[4])
    known = math.isfinite(azimuth + station.azimuth) and 0.0 < sigma <= math.radians(settings.widest_deg)
    said = taken.alarm or taken.left_open or station.method == CARRIED or station.verdict == REJECT
    if not known or said or _by_gyro(taken):
        return taken
    apart = float(wrap_pi(station.azimuth - azimuth))
    # The declination is in both.
    shared = min(declination_sigma(station), sigma) * _lasting(taken)
    ratio = abs(apart) / math.sqrt(max(sigma**2 + _own_sigma(station) ** 2 - 2.0 * shared, 1e-4 * sigma**2))
    if ratio <= settings.disagreement_sigmas or abs(apart) <= _LEAST:
        return taken
    reason = (
        f"{station.method} azimuth is {math.degrees(apart):+.1f} deg ({ratio:.1f} sigma) from that of the samples up "
        "to here, which know the magnetometer by the tool's turning: calibrate it, or survey again at another toolface"
    )
    return dataclasses.replace(taken, station=_widened(station, apart, reason))


def _widened(station: Station, apart: float, reason: str) -> Station:
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


def _by_gyro(taken: Survey) -> bool:
    """Whether it is the gyro that vouches for the azimuth: one that hardly weighs does not."""
    return taken.weights.get(GYRO, 0.0) > 0.5


def _with(taken: Survey, station: Station, reason: str, alarm: str = "") -> Survey:
    """The survey with a station, why the carried azimuth has no weight, and an alarm beside its own."""
    alarms = "; ".join(one for one in (taken.alarm, alarm) if one)
    return dataclasses.replace(
        taken,
        station=station,
        weights={**taken.weights, CARRIED: 0.0},
        azimuth_reasons={**taken.azimuth_reasons, CARRIED: reason},
        alarm=alarms or taken.alarm,
    )


def _own_sigma(station: Station) -> float:
    return math.sqrt(max(float(station.covariance[1, 1] - station.alignment[1, 1]), 1e-12))


def _lasting(taken: Survey) -> float:
    """1 sigma of the declination in the survey's azimuth, rad: what its magnetic part shares with every other."""
    magnetic = sum(weight for name, weight in taken.weights.items() if name not in (GYRO, CARRIED))
    return min(magnetic * declination_sigma(taken.station), _own_sigma(taken.station))

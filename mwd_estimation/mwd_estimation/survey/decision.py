# SPDX-License-Identifier: Apache-2.0
"""
Decision of a survey: measurement, posterior of the run, sensor faults and continuity, in this order.

The decision begins in the half-second bin that ends the averaging of the survey, because the measured field changes the
field model of the samples after the survey. The decision is completed when the attitude up to the survey is known,
which the check of continuity needs. Only a completed survey is published.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mwd_estimation.attitude.block import StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_filter import PropagatedAzimuth
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.core.verdicts import ACCEPT
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.fault_history import Accusation, FaultHistory, withdrawn
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import Measured, measured
from mwd_estimation.survey.revision import findings, is_revised, with_last_readings
from mwd_estimation.survey.run_model import RunModel, Taken, declination_sigma, gyro_azimuth
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.survey import ROTARY, STATIC
from mwd_estimation.survey.turning_string import Turning
from mwd_estimation.survey.verdict import judged, without_toolface
from mwd_sensors.core.arrays import Array

_NS_PER_HOUR = 3.6e12
# Smallest share of the gyro in a station's azimuth at which the gyro azimuth corrects the azimuth of the samples.
_COUNTS = 0.01
# Number of stations that a run may still revise; a recording has fewer. If a tool stays in the hole for months, the
# oldest stations are dropped.
_REVISABLE = 1000


class _Published(NamedTuple):
    """Published survey, and the azimuth propagated to it from the station above."""

    survey: DecidedSurvey
    #: Arguments of `Finding.continued`: azimuth and 1 sigma, rad, and variance in common, rad^2; None if the propagated
    #: azimuth did not change the survey.
    known: tuple[float, float, float] | None = None
    above: int = 0  #: number of the survey from which the azimuth was propagated; 0: none


@dataclasses.dataclass(frozen=True)
class Provisional:
    """A survey before its continuity is checked, and its results for the continuous estimate."""

    survey: DecidedSurvey
    measured: Measured
    finding: Finding | None = None  #: finding of the run about its azimuth; None if there is no finding
    #: Mean, shape (23,), and covariance, shape (23, 23), of the errors that the stations of the run share (see
    #: `RunModel.shared`); None if unknown.
    shared: tuple[Array, Array] | None = None
    #: Evidence against the sensors of the survey at the end of its averaging. Later samples are not used, because the
    #: number of later samples that are already known depends on how the samples are cut into blocks.
    against: Accusation | None = None

    @property
    def sound(self) -> bool:
        """Whether no sensor was faulty during the survey; only then its results are used in the estimate."""
        return self.against is None

    @property
    def gyro(self) -> tuple[float, float]:
        """
        Gyro azimuth of this station and 1 sigma, rad.

        NaN if a sensor was faulty, or if the weight of the gyro in the azimuth is at most 1 %.
        """
        found = self.survey.station.by_method(AzimuthMethod.GYRO)
        if not self.sound or found is None or not self.survey.weights.get(AzimuthMethod.GYRO, 0.0) > _COUNTS:
            return math.nan, math.nan
        return found.azimuth, found.sigma

    @property
    def accepted_azimuth(self) -> StationAzimuth:
        """
        Azimuth from which the gyros propagate; NaN if it was not accepted, a sensor was faulty, or the string turned.

        The sigma is for the tool axis, without the misalignment of the tool in the hole, because the gyros
        propagate the tool axis.
        """
        station, survey = self.survey.station, self.survey
        if not self.sound or survey.kind != STATIC or station.verdicts.azimuth != ACCEPT:
            return StationAzimuth()
        # If gyro and magnetometer have agreed in the run, the propagated azimuth may contradict the gyro too.
        found = survey.weights.get(AzimuthMethod.GYRO, 0.0) > 0.5
        found = found and not (self.finding is not None and self.finding.gyro_agreed)
        return StationAzimuth(station.azimuth, _own_sigma(station), self.lasting, found)

    @property
    def lasting(self) -> float:
        """1 sigma of the declination error in the azimuth, rad, which all magnetic azimuths have in common."""
        share = self.survey.weights.get(AzimuthMethod.GYRO, 0.0)
        return min((1.0 - share) * declination_sigma(self.survey.station), _own_sigma(self.survey.station))


class SurveyDecision:
    """
    Decision on the surveys of one run.

    Parameters
    ----------
    faults : FaultHistory
        Faults of the sensors; the caller updates it.
    """

    def __init__(self, settings: StationSettings, faults: FaultHistory) -> None:
        self._settings, self._faults = settings, faults
        self._run = RunModel(settings)
        # By survey number: stations of the run, in order, with their findings; and the published surveys.
        self._taken: dict[int, tuple[Taken, Finding | None]] = {}
        self._published: dict[int, _Published] = {}
        # Number of the survey whose azimuth the gyros propagate; 0 before the first.
        self._above = 0

    def begin(
        self,
        average: StillAverage,
        sequence: int,
        reference: Reference | None,
        gyro: Solution | None,
        turning: Turning | None = None,
        *,
        usable: bool = True,
    ) -> Provisional:
        """
        Return the decision on the survey of a still interval, except for its continuity.

        Parameters
        ----------
        sequence : int
            The survey's number.
        gyro : Solution or None
            Azimuth from the north seek of the precision unit, or the reason why the seek gave no azimuth; None for a
            tool without a precision unit.
        turning : Turning or None
            Estimates from the rotations of the string so far.
        usable : bool
            Whether all sensors are usable; if not, the station does not become part of the run.
        """
        average = self._faults.readable(average)
        one = _measured(average, reference, self._settings)
        taken = Taken(one, average.end_ns / _NS_PER_HOUR, gyro, turning)
        finding = self._run.take(taken, learn=usable)
        survey = DecidedSurvey(average, sequence, self._decided(one, finding, gyro), _weights(finding, gyro))
        against = self._faults.against(survey)
        if usable and against is None:
            self._taken[sequence] = taken, finding
            while len(self._taken) > _REVISABLE:
                del self._taken[next(iter(self._taken))]
        judged_by_faults = survey if against is None else against.judge(survey)
        return Provisional(judged_by_faults, one, finding, self._run.shared(), against)

    def complete(self, provisional: Provisional, propagated: PropagatedAzimuth) -> DecidedSurvey:
        """
        Return the survey, completed with the azimuth that the gyros propagated from the station above to it.

        The survey is kept as published, for revisions.
        """
        known, finding = _known_of(provisional, propagated), provisional.finding
        survey, changes = provisional.survey, False
        if known is not None and finding is not None:
            continued = finding.continued(*known)
            changes = continued is not finding
            decided = judged(provisional.measured, continued, self._settings)
            station = dataclasses.replace(decided, azimuths=survey.station.azimuths)
            survey = dataclasses.replace(survey, station=station)
            survey = survey if provisional.against is None else provisional.against.judge(survey)
        if known is not None:
            row = MethodAzimuth(AzimuthMethod.GYRO_PROPAGATED, propagated.station_azimuth, propagated.station_sigma)
            listed = dataclasses.replace(survey.station, azimuths=(*survey.station.azimuths, row))
            survey = dataclasses.replace(survey, station=listed, weights={**survey.weights, row.method: 0.0})
        self._keep(_Published(survey, known if changes else None, self._above))
        if math.isfinite(provisional.accepted_azimuth.azimuth):
            self._above = survey.sequence
        return survey

    def revisions(self) -> dict[int, DecidedSurvey]:
        """
        Return the surveys whose result has changed since they were published.

        A result has changed if the verdict differs, or the azimuth differs by more than its sigma. A survey is rejected
        and withdrawn if a sensor fault that still lasts began before the survey.

        Returns
        -------
        dict of int to DecidedSurvey
            Revisions by survey number. The published survey stays valid, and a revision is a proposal, unless it is
            withdrawn.
        """
        now = self.judging_again(len(self._taken))()
        return {number: survey for number, survey in now.items() if survey is not self._published[number].survey}

    def judging_again(self, newest: int) -> Callable[[], dict[int, DecidedSurvey]]:
        """
        Return a function that decides the newest stations again with the present run.

        newest: number of stations. The function may be called in another thread. It returns these surveys by number, as
        published or revised, and older surveys that are withdrawn because of a sensor fault.
        """
        taken, published = tuple(self._taken.items()), dict(self._published)
        return functools.partial(_judged_again, taken, published, self._settings, newest, self._faults.standing)

    def rotary(
        self, average: StillAverage, sequence: int, reference: Reference | None, rotary_speed: float
    ) -> DecidedSurvey:
        """
        Return a rotary survey with its verdict.

        average: averaged in axes that do not turn with the string (`rotary_survey`); rotary_speed: rad/s.
        """
        one = _measured(average, reference, self._settings)
        # Use a run of one station: in axes that do not turn with the string, the cross-axis errors differ from those of
        # the other stations.
        finding = RunModel(self._settings).take(Taken(one))
        station = without_toolface(self._decided(one, finding, None), rotary_speed)
        survey = self._faults.judge(DecidedSurvey(average, sequence, station, _weights(finding, None), ROTARY))
        self._keep(_Published(survey))
        return survey

    def _keep(self, published: _Published) -> None:
        """Store the published survey; drop the oldest ones if there are more than can be revised (`_REVISABLE`)."""
        self._published[published.survey.sequence] = published
        while len(self._published) > _REVISABLE:
            del self._published[next(iter(self._published))]

    def _decided(self, one: Measured, finding: Finding | None, gyro: Solution | None) -> Station:
        station = judged(one, finding, self._settings)
        if gyro is None:
            return station
        return dataclasses.replace(station, azimuths=(*station.azimuths, gyro_azimuth(gyro, station)))


def _judged_again(
    taken: Sequence[tuple[int, tuple[Taken, Finding | None]]],
    published: Mapping[int, _Published],
    settings: StationSettings,
    newest: int,
    faults: Sequence[SensorFault],
) -> dict[int, DecidedSurvey]:
    """
    Return the newest surveys by number, as published or as revised by the run, and all withdrawn surveys.

    taken: stations of the run, in order, by survey number, with their findings; published: by survey number; newest:
    number of stations; faults: present faults.
    """
    judged_now = _by_the_run(taken, published, settings, newest)
    every = {number: judged_now.get(number, first.survey) for number, first in published.items()}
    now = {number: withdrawn(survey, faults) for number, survey in every.items()}
    return {number: survey for number, survey in now.items() if survey.withdrawn or number in judged_now}


def _by_the_run(
    taken: Sequence[tuple[int, tuple[Taken, Finding | None]]],
    published: Mapping[int, _Published],
    settings: StationSettings,
    newest: int,
) -> dict[int, DecidedSurvey]:
    """Return the newest surveys by number: as published, or as revised with all other stations of the run."""
    stations, before = with_last_readings([one for _, (one, _) in taken]), [found for _, (_, found) in taken]
    _, found = findings(stations, settings, before, newest)
    again = zip((number for number, _ in taken), stations, found, strict=True)
    now, revised = dict[int, DecidedSurvey](), set[int]()
    for number, one, finding in list(again)[-newest:]:
        if number not in published:
            continue
        first, known, above = published[number]
        now[number] = first
        if finding is not None and finding.repeats is not None:
            continue
        # An azimuth propagated from a station that is itself revised is not valid any more.
        if finding is not None and known is not None and above not in revised:
            finding = finding.continued(*known)
        station = judged(one.measured, finding, settings)
        if is_revised(first.station, station, first.station.sigma_azimuth):
            station = dataclasses.replace(station, azimuths=_by_gyro(one.gyro, station, first.station.azimuths))
            unweighed = dict.fromkeys(first.weights, 0.0)
            now[number] = dataclasses.replace(
                first, station=station, weights={**unweighed, **_weights(finding, one.gyro)}
            )
            revised.add(number)
    return now


def _by_gyro(gyro: Solution | None, station: Station, azimuths: tuple[MethodAzimuth, ...]) -> tuple[MethodAzimuth, ...]:
    """Return the azimuths of all methods, with the gyro azimuth replaced by its present value."""
    if gyro is None:
        return azimuths
    return tuple(gyro_azimuth(gyro, station) if row.method == AzimuthMethod.GYRO else row for row in azimuths)


def _known_of(provisional: Provisional, propagated: PropagatedAzimuth) -> tuple[float, float, float] | None:
    """
    Return azimuth, sigma and common variance as `Finding.continued` needs them, from the station above.

    Return None if no azimuth with a sigma was propagated, or the survey was not taken at rest.
    """
    azimuth, sigma = propagated.station_azimuth, propagated.station_sigma
    if not (math.isfinite(azimuth) and sigma > 0.0) or provisional.survey.kind != STATIC:
        return None
    shared = propagated.station_constant_sigma * provisional.lasting
    return azimuth, sigma, shared if math.isfinite(shared) else 0.0


def _own_sigma(station: Station) -> float:
    """Return 1 sigma of the azimuth of the tool axis, without the misalignment of the tool in the hole, rad."""
    return math.sqrt(max(float(station.covariance[1, 1] - station.alignment[1, 1]), 1e-12))


def _measured(average: StillAverage, reference: Reference | None, settings: StationSettings) -> Measured:
    hot_f, hot_b = settings.calibrated.variances(average.temperature)
    return measured(
        average.imu.mean[3:],
        average.mag.mean if average.mag is not None else np.full(3, np.nan),
        reference,
        settings,
        covariance_f=average.imu.covariance[3:, 3:] + hot_f * np.eye(3),
        covariance_b=average.mag.covariance + hot_b * np.eye(3) if average.mag is not None else None,
    )


def _weights(finding: Finding | None, gyro: Solution | None) -> dict[str, float]:
    """Return the shares of gyro and magnetometer in the azimuth, 0 to 1, by the name of the method."""
    share = 0.0 if finding is None else finding.by_gyro
    weights: dict[str, float] = {} if gyro is None else {AzimuthMethod.GYRO: share}
    if finding is not None and share < 1.0:
        weights[AzimuthMethod.FUSED] = 1.0 - share
    return weights

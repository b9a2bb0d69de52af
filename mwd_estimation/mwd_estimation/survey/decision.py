"""
The one place that decides a survey: correction, fusion, faults and continuity, in this order.

A survey is begun in the half-second bin that ends its averaging, because what it shows of the magnetic field changes
how the samples after it are read. It is completed when the attitude up to it is known, which the continuity check
needs. Only a completed survey leaves the estimator.
"""

from __future__ import annotations

import dataclasses
import math
import uuid

import numpy as np

from mwd_estimation.attitude.block import StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_state import PropagatedAzimuth
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import continuity_check, gyro_evidence, run_history
from mwd_estimation.survey.azimuth_fusion import Settings as FusionSettings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.multi_station_analysis import Multistation
from mwd_estimation.survey.run_history import StationRun
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import station
from mwd_estimation.survey.station_azimuth import WeighedStation, weigh
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.survey import ROTARY, Survey

# Names a survey by its time and readings, so that a replay names it alike whatever its number (RFC 4122, version 5).
_SURVEYS = uuid.UUID("6b0d4f5e-6f0e-5c1b-9a55-3a5d2c1b7e10")


@dataclasses.dataclass(frozen=True)
class Provisional:
    """
    A survey before its continuity check, and what the estimate learns from it.

    Attributes
    ----------
    survey : Survey
    analysis : Multistation or None
        Of the run with it, where one holds.
    sound : bool
        Whether no sensor was at fault while it was taken: only then anything is learnt from it.
    """

    survey: Survey
    analysis: Multistation | None = None
    sound: bool = True

    @property
    def gyro(self) -> tuple[float, float]:
        """Azimuth and 1 sigma of the gyro here, rad; nan where it has no weight."""
        found = self.survey.station.by_method(AzimuthMethod.GYRO)
        if not self.sound or found is None or not self.survey.weights.get(AzimuthMethod.GYRO, 0.0) > 0.0:
            return math.nan, math.nan
        return found.azimuth, found.sigma

    @property
    def accepted_azimuth(self) -> StationAzimuth:
        """What the gyros propagate from here, as `continuity_check.accepted_azimuth`; nan where nothing is."""
        return continuity_check.accepted_azimuth(self.survey) if self.sound else StationAzimuth()


class SurveyDecision:
    """
    Decides the surveys of one run.

    Parameters
    ----------
    settings : StationSettings
    fusing : azimuth_fusion.Settings
    multistation : run_history.Params
    faults : FaultHistory
        Of the sensors; kept by the caller.
    """

    def __init__(
        self,
        settings: StationSettings,
        fusing: FusionSettings,
        multistation: run_history.Params,
        faults: FaultHistory,
    ) -> None:
        self._settings, self._fusing, self._faults = settings, fusing, faults
        self._run = StationRun(multistation)
        # How gyro and magnetic azimuth disagreed at the last station at which they were compared.
        self._last_alarm: tuple[Reason, ...] = ()

    def begin(
        self,
        average: StillAverage,
        sequence: int,
        reference: Reference | None,
        gyro: Solution | None,
        *,
        usable: bool = True,
    ) -> Provisional:
        """
        Decide the survey of a still interval, but for its continuity.

        Parameters
        ----------
        average : StillAverage
        sequence : int
            The survey's number.
        reference : Reference or None
        gyro : Solution or None
            North found with the precision unit, or why there is none; None without such a unit.
        usable : bool
            Whether all sensors are in order: else the station is not counted among those of the run.
        """
        average = self._faults.readable(average)
        run = self._run if usable else None
        taken, analysis = decided(
            average, sequence, reference, self._settings, gyro, self._fusing, run=run, last_alarm=self._last_alarm
        )
        if taken.alarm is not None:
            self._last_alarm = taken.alarm
        judged = self._faults.judge(taken)
        return Provisional(judged, analysis, judged is taken)

    def complete(self, provisional: Provisional, propagated: PropagatedAzimuth) -> Survey:
        """The survey, checked for continuity with the azimuths propagated to it."""
        return continuity_check.checked(provisional.survey, propagated, self._fusing)

    def rotary(self, average: StillAverage, sequence: int, reference: Reference | None, rotary_speed: float) -> Survey:
        """Decide a survey averaged in axes that do not turn (`rotary_survey`); rotary_speed, rad/s, for the record."""
        return self._faults.judge(decided_rotary(average, sequence, reference, self._settings, rotary_speed))


def decided(
    average: StillAverage,
    sequence: int,
    reference: Reference | None,
    settings: StationSettings,
    gyro: Solution | None = None,
    fusing: FusionSettings | None = None,
    *,
    run: StationRun | None = None,
    last_alarm: tuple[Reason, ...] = (),
) -> tuple[Survey, Multistation | None]:
    """
    Correct and fuse one survey, with no regard to faults and continuity.

    Parameters
    ----------
    average, sequence, reference, gyro
        As `SurveyDecision.begin`.
    settings : StationSettings
    fusing : azimuth_fusion.Settings, optional
    run : StationRun, optional
        The stations before it, into which it is taken.
    last_alarm : tuple of Reason
        How gyro and magnetic azimuth disagreed at the last station at which they were compared.

    Returns
    -------
    survey : Survey
    analysis : Multistation or None
        Of the run with it, where one holds.
    """
    alone = station(
        average.imu.mean[3:],
        average.mag.mean if average.mag is not None else np.full(3, np.nan),
        reference,
        settings,
        covariance_f=average.imu.covariance[3:, 3:],
        covariance_b=average.mag.covariance if average.mag is not None else None,
    )
    gyro = gyro_evidence.chosen_by_field(gyro, alone)
    together, analysis = (alone, None) if run is None else run.take(alone, settings)
    aided = 0.0 if analysis is None else float(analysis.by_gyro[-1])
    result = weigh(alone, together, gyro, fusing, last_alarm=last_alarm, aided=aided)
    if together is not alone and run is not None and result.alarm == () and gyro is not None and gyro.success:
        run.add_gyro(*gyro_evidence.gyro_for_run(result.station, gyro))
    return _survey(average, sequence, result), analysis


def decided_rotary(
    average: StillAverage, sequence: int, reference: Reference | None, settings: StationSettings, rotary_speed: float
) -> Survey:
    """The survey of an average in axes that do not turn: it has no toolface; as `SurveyDecision.rotary`."""
    taken, _ = decided(average, sequence, reference, settings)
    return dataclasses.replace(taken, station=_without_toolface(taken.station, rotary_speed), kind=ROTARY)


def _without_toolface(one: Station, rotary_speed: float) -> Station:
    covariance = one.covariance.copy()
    covariance[2, :] = covariance[:, 2] = 0.0
    covariance[2, 2] = math.pi**2
    return dataclasses.replace(
        one,
        gravity_toolface=0.0,
        magnetic_toolface=0.0,
        sigma_toolface=math.pi,
        covariance=covariance,
        reasons=(*one.reasons, Reason(Code.STRING_ROTATED, abs(rotary_speed))),
    )


def _survey(average: StillAverage, sequence: int, result: WeighedStation) -> Survey:
    """The survey of an average with its station."""
    rates = average.precision if average.precision is not None else average.imu
    stamp_ns = (average.start_ns + average.end_ns) // 2
    return Survey(
        stamp_ns=stamp_ns,
        sequence=sequence,
        uuid=str(uuid.uuid5(_SURVEYS, f"{stamp_ns} {[float(v) for v in average.imu.mean]}")),
        requested=average.requested,
        duration=(average.end_ns - average.start_ns) * 1e-9,
        samples=average.imu.count,
        station=result.station,
        covariance_f=average.imu.covariance[3:, 3:],
        covariance_b=average.mag.covariance if average.mag is not None else np.zeros((3, 3)),
        rate_t=rates.mean[:3],
        temperature=average.temperature,
        weights=result.weights,
        azimuth_reasons=result.reasons,
        alarm=result.alarm,
        left_open=result.left_open,
    )

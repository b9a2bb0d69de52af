# SPDX-License-Identifier: Apache-2.0
"""
Comparison of two tools in one probe: the conventional unit against the precision gyro, station by station.

The conventional tool gives the inclination from its accelerometers, and the azimuth from its magnetometer as measured,
corrected for declination only. The gyro tool gives the inclination from the accelerometers of the precision unit, from
the same samples as the survey, and the azimuth from north seeking. Azimuths are from true north. A survey is requested
at the end of each interval at rest; the last survey of a station is used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.survey import STATIC, Survey
from mwd_sensors.core.angle_convention import AngleConvention
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.frames import inclination, wrap_pi
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import Scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.runs.launch_plan import estimator_parameters
from mwd_surface.signals.cells import fixed

_SAME = 0.3  # distance below which two surveys belong to one station, m
_LAST_S = 12.0  # time from the request of a survey to the end of the interval at rest, s
_ASKED_S = 8.0  # length of a requested survey, s
_SHORTEST = 20.0  # shortest interval at rest in which a survey is requested in addition to the automatic one, s

#: Columns of the table of the comparison: scenario, vertical angle, and `comparison_cells`.
COMPARISON_COLUMNS = (
    "scenario",
    "angle",
    "md_m",
    "angle_conventional_deg",
    "angle_gyro_deg",
    "angle_true_deg",
    "azimuth_conventional_deg",
    "azimuth_gyro_deg",
    "azimuth_true_deg",
    "error_azimuth_conventional_deg",
    "error_azimuth_gyro_deg",
)


@dataclasses.dataclass(frozen=True)
class ToolDirection:
    """Inclination and azimuth from true north of one tool, rad."""

    inclination: float
    azimuth: float
    sigma_azimuth: float = math.nan  #: 1 sigma of the azimuth, rad; NaN if unknown


@dataclasses.dataclass(frozen=True)
class ToolStation:
    """Survey with both tools: measured depth, m, the readings of both tools, and the truth of the simulation."""

    measured_depth: float
    conventional: ToolDirection
    gyro: ToolDirection
    truth: ToolDirection
    automatic: bool  #: whether the survey was taken without a request
    accepted: bool  #: whether the azimuth of the survey was accepted


def compared(story: Scenario) -> list[ToolStation]:
    """
    Return the last survey of each station of a scenario, with the readings of both tools.

    Raises
    ------
    ValueError
        The scenario has no precision gyro, or no survey is taken in it.
    """
    return last_of_each_station(surveyed(story))


def surveyed(story: Scenario) -> list[ToolStation]:
    """
    Return every survey at rest in a scenario, requested or automatic, in the order of depth and time.

    Raises
    ------
    ValueError
        The scenario has no precision gyro, or no survey is taken in it.
    """
    if story.precision is None:
        raise ValueError(f"{story.name}: its probe has no precision gyro to compare with")
    sonde = Sonde(story)
    pipeline = Pipeline(changed(EstimatorSettings(), estimator_parameters(story)))
    asked = _requests(story)
    found: list[DecidedSurvey] = []
    truth, precision = [], []
    rest = 0
    for block in sonde.blocks(1.0):
        true = block["truth"]
        moves = max(np.abs(true["angular_velocity"]).max(), np.abs(true["velocity"]).max()) > 1e-3
        rest = 0 if moves else rest + 1
        if rest == 1:
            wanted = next(asked, math.inf)
        if rest and rest == wanted:
            pipeline.request_survey(_ASKED_S)
        truth.append(true)
        precision.append(block["gyro/data_raw"])
        pipeline.push_mag(block["imu/mag"])
        pipeline.push_precision(block["gyro/data_raw"])
        found += pipeline.push_imu(block["imu/data_raw"]).surveys
    found += pipeline.finish().surveys
    rows, samples = np.concatenate(truth), np.concatenate(precision)
    stations = [_station(one, rows, samples) for one in found if one.kind == STATIC]
    if not stations:
        raise ValueError(f"{story.name}: no survey is taken in it")
    return sorted(stations, key=lambda one: one.measured_depth)


def last_of_each_station(surveys: list[ToolStation]) -> list[ToolStation]:
    """Return the last survey of each station; surveys: in the order of depth and time."""
    last: list[ToolStation] = []
    for station in surveys:
        if last and station.measured_depth - last[-1].measured_depth < _SAME:
            last[-1] = station
        else:
            last.append(station)
    return last


def _requests(story: Scenario) -> Iterator[float]:
    """Yield, for each still phase of the schedule, the time from its start to the request, s; inf: no request."""
    for phase in story.schedule * story.cycles:
        if phase.kind == "still":
            yield round(phase.seconds - _LAST_S) if phase.seconds >= _SHORTEST else math.inf


def _station(one: DecidedSurvey, truth: Samples, precision: Samples) -> ToolStation:
    survey = one.record()
    at = truth[min(int(np.searchsorted(truth["stamp_ns"], survey.stamp_ns)), len(truth) - 1)]
    start, end = np.searchsorted(precision["stamp_ns"], [one.average.start_ns, one.average.end_ns])
    mean = precision["linear_acceleration"][start:end].mean(axis=0) if end > start else np.full(3, math.nan)
    return ToolStation(
        float(at["measured_depth"]),
        ToolDirection(survey.inclination, *_azimuth(survey, AzimuthMethod.RAW)),
        ToolDirection(float(inclination(mean)), *_azimuth(survey, AzimuthMethod.GYRO)),
        ToolDirection(float(at["inclination"]), float(at["azimuth"])),
        automatic=not survey.requested,
        accepted=one.station.verdicts.azimuth == "accept",
    )


def _azimuth(survey: Survey, method: AzimuthMethod) -> tuple[float, float]:
    """Return azimuth from true north and its sigma by one method, rad; NaN if the survey has no such azimuth."""
    estimate = next((each for each in survey.azimuths if each.method == method), None)
    if estimate is None:
        return math.nan, math.nan
    turned = survey.turned(estimate.azimuth, North(estimate.north), North.TRUE)
    return (math.nan if turned is None else turned), estimate.sigma


def azimuth_error(reading: ToolDirection, truth: ToolDirection) -> float:
    """Return measured minus true azimuth, rad, from -pi to pi."""
    return float(wrap_pi(reading.azimuth - truth.azimuth))


def comparison_cells(station: ToolStation, convention: AngleConvention) -> tuple[str, ...]:
    """Return the numbers of a station as text, in degrees, for the columns after scenario and angle."""
    tools = (station.conventional, station.gyro)
    readings = (*tools, station.truth)
    return (
        fixed(station.measured_depth, 1),
        *(fixed(math.degrees(convention.shown(one.inclination)), 2) for one in readings),
        *(fixed(math.degrees(one.azimuth), 2, 360.0) for one in readings),
        *(fixed(math.degrees(azimuth_error(one, station.truth)), 2) for one in tools),
    )

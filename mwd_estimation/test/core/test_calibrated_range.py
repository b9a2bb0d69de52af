# SPDX-License-Identifier: Apache-2.0
"""Beyond the temperatures of its calibration a tool is warned of, and its surveys have the sigma that it then has."""

import dataclasses
import math

import numpy as np
import pytest
from bench_errors import BENCH

from consistency import assert_consistent
from mwd_estimation.core.calibrated_range import CalibratedRange, TemperatureWatch
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Average
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decision import SurveyDecision
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt

SLOPES = CalibratedRange(20.0, 150.0, accelerometer_mps2_per_c=1e-3, magnetometer_t_per_c=5e-9)
IDEAL = dataclasses.replace(BENCH, accelerometer_bias_mps2=1e-5, accelerometer_scale=0.0, magnetometer_bias_nt=0.1,
                            magnetometer_scale=0.0, axial_interference_nt=0.0)  # fmt: skip
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.0, convergence=0.0, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1), 0.0, math.sin(1.1)])


def station(celsius, rng=None):
    """A station of an ideal tool at a temperature; rng draws the slopes of its biases."""
    mat, beyond = mat_nt(0.9, 1.3, 0.4), max(celsius - 150.0, 20.0 - celsius, 0.0)
    force, field = mat.T @ [0.0, 0.0, -9.81], mat.T @ FIELD_N
    if rng is not None:
        force = force + 1e-3 * beyond * rng.standard_normal(3)
        field = field + 5e-9 * beyond * rng.standard_normal(3)
    imu = Average(np.concatenate([np.zeros(3), force]), 1e-12 * np.eye(6), 800)
    mag = Average(field, 1e-20 * np.eye(3), 800)
    still = StillAverage(10**11, 11 * 10**10, imu, mag, None, celsius, requested=False)
    settings = StationSettings(errors=IDEAL, calibrated=SLOPES)
    return SurveyDecision(settings, FaultHistory()).begin(still, 1, REFERENCE, None).survey.station


@pytest.mark.slow
@pytest.mark.fault_case(23)
@pytest.mark.parametrize("celsius", [190.0, -10.0])
def test_errors_beyond_the_calibration_are_as_large_as_the_sigmas_say(celsius):
    rng = np.random.default_rng(23)
    found = [station(celsius, rng) for _ in range(60)]
    sigmas = [math.sqrt(one.covariance[0, 0]) for one in found]
    assert_consistent([one.inclination - 0.9 for one in found], sigmas, name="inclination")


@pytest.mark.fault_case(23)
def test_the_sigma_grows_with_the_distance_to_the_range_and_not_inside_of_it():
    covariances = [station(celsius).covariance for celsius in (85.0, 150.0, 160.0, 190.0)]
    for angle in range(3):
        sigmas = [math.sqrt(covariance[angle, angle]) for covariance in covariances]
        assert sigmas[0] == sigmas[1] < sigmas[2] < sigmas[3]
    assert station(math.nan).covariance.tolist() == covariances[0].tolist()


@pytest.mark.fault_case(23)
def test_temperatures_beyond_the_calibration_are_noted_until_the_tool_has_cooled():
    watch = TemperatureWatch(SLOPES)
    watch.take(np.array([20.0, 150.0, np.nan]))
    assert (watch.outside, watch.outside_now) == (None, False)
    watch.take(np.array([170.0, 190.0, np.nan]))
    assert (watch.outside, watch.outside_now) == ((170.0, 190.0), True)
    watch.take(np.array([5.0, 60.0]))
    assert (watch.outside, watch.outside_now) == ((5.0, 190.0), False)


@pytest.mark.fault_case(23)
def test_the_settings_of_the_tool_are_those_of_the_range_and_the_pipeline_watches_it():
    tool = dataclasses.replace(EstimatorSettings().tool, calibrated_c=(10.0, 90.0))
    settings = EstimatorSettings(tool=tool)
    found = derivation.station_params(settings).calibrated
    assert (found.low_c, found.high_c, found.magnetometer_t_per_c) == (10.0, 90.0, pytest.approx(1e-9))
    assert found.accelerometer_mps2_per_c == pytest.approx(9.80665e-5)
    pipeline, heat = Pipeline(settings, REFERENCE), wire.TEMPERATURE.empty(2)
    heat["temperature"] = (60.0, 120.0)
    pipeline.push_temperature(heat)
    assert pipeline.temperature.outside == (120.0, 120.0)
    with pytest.raises(ValueError, match="exchange the two"):
        Pipeline(EstimatorSettings(tool=dataclasses.replace(tool, calibrated_c=(91.0, 90.0))))

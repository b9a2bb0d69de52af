# SPDX-License-Identifier: Apache-2.0
"""Surveys as the estimator itself decides and sends them."""

import math

import numpy as np

from mwd_estimation.attitude.gyro_azimuth_filter import PropagatedAzimuth
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Average
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.decision import SurveyDecision
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core.frames import mat_nt

REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1) * math.cos(0.05), math.cos(1.1) * math.sin(0.05), math.sin(1.1)])
NOT_PROPAGATED = PropagatedAzimuth(*[math.nan] * 5)


def decided(*, magnetometer=True, gyro_sigma=None, reference=REFERENCE, inclination=0.9, azimuth=1.3):
    """The first survey of a run; gyro_sigma: of a north seek, rad, None without a precision unit."""
    mat = mat_nt(inclination, azimuth, 0.7)
    imu = Average(np.concatenate([np.zeros(3), mat.T @ [0.0, 0.0, -9.81]]), 4e-6 * np.eye(6), 800)
    field = Average(mat.T @ FIELD_N, 9e-16 * np.eye(3), 800) if magnetometer else None
    still = StillAverage(10**18, 10**18 + 10**10, imu, field, None, None, requested=False)
    gyro = None if gyro_sigma is None else Solution(None, "still", azimuth, gyro_sigma, inclination, 0.0, 60.0, 0.1)
    run = SurveyDecision(StationSettings(), FaultHistory())
    survey = run.complete(run.begin(still, 1, reference, gyro), NOT_PROPAGATED)
    return survey.record()

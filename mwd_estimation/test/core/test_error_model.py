# SPDX-License-Identifier: Apache-2.0
"""Sensor and alignment errors: covariance by axis, growth towards the vertical."""

import math

import numpy as np
import pytest
from bench_errors import BENCH

from mwd_estimation.core.error_model import SensorErrors


def test_covariance_holds_bias_and_scale_of_each_axis():
    cov = SensorErrors().covariance(np.array([-9.0, 0.0, 4.0]), np.array([0.0, 5e-5, 1e-5]))
    sigma = np.sqrt(np.diagonal(cov))
    assert sigma[:3] == pytest.approx([math.hypot(0.004, 0.0045), 0.004, math.hypot(0.004, 0.002)])
    assert sigma[3:] == pytest.approx([70e-9, math.hypot(70e-9, 80e-9), math.hypot(70e-9, 16e-9)])
    assert np.count_nonzero(cov - np.diag(np.diagonal(cov))) == 0


def test_covariance_takes_stacks_of_stations():
    assert SensorErrors().covariance(np.ones((5, 2, 3)), np.ones((5, 2, 3))).shape == (5, 2, 6, 6)


def test_alignment_grows_for_azimuth_towards_the_vertical_and_is_nothing_on_the_bench():
    errors = SensorErrors()
    at = [errors.alignment(math.radians(inc)) for inc in (5.0, 30.0, 90.0)]
    assert at[0][1, 1] > at[1][1, 1] > at[2][1, 1]
    assert math.degrees(math.sqrt(at[2][1, 1])) == pytest.approx(0.1)
    # Well 1's terms at 30 deg: misalignment .05, course .26, sag .17 deg.
    assert math.degrees(math.sqrt(at[1][0, 0])) == pytest.approx(math.sqrt(0.05**2 + 0.2598**2 + 0.1682**2), rel=1e-3)
    assert not BENCH.alignment(0.5).any()

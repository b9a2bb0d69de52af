# SPDX-License-Identifier: Apache-2.0
"""The raw accelerometer: exact at rest, and its sigma grows with what disturbs it."""

import numpy as np
import pytest
from gravity_runs import inclination_error, toolface_error

from consistency import assert_consistent
from mwd_estimation.core.status import Status
from mwd_estimation.gravity import accelerometer_only as raw
from mwd_sensors.core.constants import STANDARD_GRAVITY

DOWN = np.array([0.6, 0.0, 0.8])
STAMPS = np.arange(1000, dtype=np.int64) * 10_000_000


def test_at_rest_it_is_exact():
    p = raw.AccelerometerParams()
    got = raw.run(p, raw.initial(p), STAMPS, np.zeros((1000, 3)), np.tile(-STANDARD_GRAVITY * DOWN, (1000, 1)))
    assert got.g_t == pytest.approx(np.tile(DOWN, (1000, 1)), abs=1e-15)
    assert (got.status & int(Status.STILL) != 0).all()
    assert got.sigma_inclination[-1] == pytest.approx(p.sigma_floor, rel=1e-3)


def test_sigma_grows_with_the_disturbance():
    rng = np.random.default_rng(1)
    p = raw.AccelerometerParams()
    accel = -STANDARD_GRAVITY * DOWN + rng.standard_normal((1000, 3))
    got = raw.run(p, raw.initial(p), STAMPS, np.zeros((1000, 3)), accel)
    assert_consistent(inclination_error(got, DOWN[None])[300:], got.sigma_inclination[300:])


@pytest.mark.fault_case(21, 22)
@pytest.mark.parametrize("inclination_deg", [8.0, 45.0, 90.0])
@pytest.mark.parametrize(
    ("axial", "turning", "circle"),
    [(3.0, 0.0, 0.0), (4.0, 0.0, 35.6), (1.0, 12.7, 35.6), (2.0, 39.5, 62.8), (12.5, 0.0, 62.8)],
)
def test_sigma_covers_a_disturbance_whatever_its_direction(inclination_deg, axial, turning, circle):
    # Vibration along the hole, and the centripetal force, m/s^2, of a sensor that turns at `circle`, rad/s.
    rng = np.random.default_rng(3)
    time = np.arange(3000) * 0.01
    roll = circle * time + 1.0
    inclination = np.radians(inclination_deg)
    across = np.sin(inclination)
    down = np.stack([np.full(3000, np.cos(inclination)), -across * np.sin(roll), -across * np.cos(roll)], axis=-1)
    accel = -STANDARD_GRAVITY * down + [0.0, -0.8 * turning, 0.6 * turning]
    accel[:, 0] += axial * np.sin(71.3 * time + 0.3) + 0.1 * axial * rng.standard_normal(3000)
    p = raw.AccelerometerParams()
    stamps = np.arange(3000, dtype=np.int64) * 10_000_000
    got = raw.run(p, raw.initial(p), stamps, np.zeros((3000, 3)), accel)
    late = slice(500, None)
    tilt, turned = inclination_error(got, down), toolface_error(got, down)
    for error, sigma in ((tilt, got.sigma_inclination), (turned, got.sigma_toolface)):
        assert np.mean(np.abs(error[late]) > 3.0 * sigma[late]) < 0.003
        assert np.mean(np.square(error[late] / sigma[late])) < 1.5

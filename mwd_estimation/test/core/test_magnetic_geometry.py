# SPDX-License-Identifier: Apache-2.0
"""Magnetic azimuth, dip and total field of a pair of readings, and their slopes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import floats

from mwd_estimation.core import magnetic_geometry
from mwd_sensors.core.frames import gravity_toolface, inclination, mat_nt, wrap_pi

TOTAL, DIP = 50e-6, math.radians(72.0)
HORIZONTAL, VERTICAL = TOTAL * math.cos(DIP), TOTAL * math.sin(DIP)
ANY_INC = floats(0.05, math.pi - 0.05)
ANY_ANGLE = floats(0.0, 2.0 * math.pi)


def readings(inc, azi, toolface, horizontal=HORIZONTAL, vertical=VERTICAL):
    mat_tn = np.swapaxes(mat_nt(inc, azi, toolface), -1, -2)
    return mat_tn @ np.array([0.0, 0.0, -9.81]), mat_tn @ np.array([horizontal, 0.0, vertical])


@given(inc=ANY_INC, azi=ANY_ANGLE, toolface=ANY_ANGLE, dip=floats(-1.3, 1.3))
def test_raw_azimuth_undoes_the_attitude_in_every_quadrant(inc, azi, toolface, dip):
    f_t, b_t = readings(inc, azi, toolface, TOTAL * math.cos(dip), TOTAL * math.sin(dip))
    assert wrap_pi(magnetic_geometry.raw_azimuth(f_t, b_t) - azi) == pytest.approx(0.0, abs=1e-9)
    assert wrap_pi(magnetic_geometry.raw_azimuth_sample(*f_t, *b_t) - azi) == pytest.approx(0.0, abs=1e-9)
    assert magnetic_geometry.dip(f_t, b_t) == pytest.approx(dip, abs=1e-9)


def test_slopes_of_the_angles_agree_with_finite_differences():
    rng = np.random.default_rng(3)
    f_t, b_t = readings(rng.uniform(0.1, 3.0, 20), rng.uniform(0, 6.28, 20), rng.uniform(0, 6.28, 20))
    x = np.concatenate([f_t, b_t + rng.normal(0, 1e-6, (20, 3))], axis=1)

    def angles(x):
        f, b = x[:, :3], x[:, 3:]
        return np.stack([inclination(f), magnetic_geometry.raw_azimuth(f, b), gravity_toolface(f)], axis=1)

    jac = magnetic_geometry.angle_jacobian(x[:, :3], x[:, 3:])
    for k, step in enumerate([1e-5] * 3 + [1e-11] * 3):
        change = np.zeros(6)
        change[k] = step
        slope = wrap_pi(angles(x + change) - angles(x - change)) / (2.0 * step)
        assert jac[:, :, k] * step == pytest.approx(slope * step, rel=1e-5, abs=1e-11)

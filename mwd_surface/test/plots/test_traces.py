# SPDX-License-Identifier: Apache-2.0
"""The table of what is drawn: a label and unit for every series, what is not available missing, norths named."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mwd_sensors.core import wire
from mwd_surface.plots import traces
from mwd_surface.plots.traces import north_of, traces_of

LAYOUTS = sorted(wire.LAYOUTS)


def trace(layout, title):
    return next(item for item in traces_of(layout.type_name) if title in item.title)


@pytest.mark.parametrize("type_name", LAYOUTS)
def test_every_fixed_message_is_drawn_with_a_label_for_each_column(type_name):
    samples = wire.LAYOUTS[type_name].empty(5)
    assert traces_of(type_name)
    for item in traces_of(type_name):
        assert item.what in traces.WHAT
        assert item.unit
        assert item.values(samples).shape == (5, len(item.labels))


def test_other_types_are_not_drawn_over_time():
    assert traces_of("std_msgs/msg/String") == ()


def test_numbers_are_drawn_in_the_units_people_use():
    imu, mag, rig = wire.IMU.empty(1), wire.MAG.empty(1), wire.RIG_STATE.empty(1)
    imu["angular_velocity"], mag["magnetic_field"] = [np.pi, 0.0, -np.pi], [3e-5, 0.0, 4e-5]
    rig["rotary_speed"], rig["pressure"], rig["valid"] = 4.0 * np.pi, 2.5e7, 2047
    assert_allclose(trace(wire.IMU, "angular rate").values(imu), [[180.0, 0.0, -180.0]])
    assert_allclose(trace(wire.MAG, "magnetic field").values(mag), [[30.0, 0.0, 40.0, 50.0]])
    assert_allclose(trace(wire.RIG_STATE, "rotary speed").values(rig), [[120.0]])
    assert_allclose(trace(wire.RIG_STATE, "pressure").values(rig), [[250.0]])


def test_what_is_not_available_is_missing():
    imu, rig, attitude = wire.IMU.empty(2), wire.RIG_STATE.empty(2), wire.ATTITUDE.empty(2)
    imu["linear_acceleration_covariance"][1, 0] = -1.0
    rig["valid"] = [1, 2]
    attitude["sigma_azimuth"], attitude["azimuth"] = [0.1, np.nan], [1.0, np.nan]
    assert_array_equal(np.isnan(trace(wire.IMU, "specific force").values(imu))[:, 0], [False, True])
    assert_array_equal(np.isnan(trace(wire.RIG_STATE, "depth").values(rig)), [[False, True], [True, False]])
    assert_array_equal(np.isnan(trace(wire.ATTITUDE, "azimuth").values(attitude))[:, 0], [False, True])


@pytest.mark.parametrize(
    ("title", "field", "bit"),
    [("pressure", "pressure", 256), ("rotary", "rotary_speed", 64), ("hook load", "hookload", 8)],
)
def test_a_gauge_counts_only_while_its_bit_is_set(title, field, bit):
    rig = wire.RIG_STATE.empty(2)
    rig[field], rig["valid"] = 1.0, [bit, 2047 - bit]
    assert_array_equal(np.isnan(trace(wire.RIG_STATE, title).values(rig))[:, 0], [False, True])


def test_toolface_runs_from_left_to_right_of_high_side():
    attitude = wire.ATTITUDE.empty(2)
    attitude["gravity_toolface"] = np.radians([350.0, 10.0])
    assert_allclose(trace(wire.ATTITUDE, "gravity toolface").values(attitude)[:, 0], [-10.0, 10.0])


def test_the_north_is_that_of_the_azimuths_that_are_there():
    attitude = wire.ATTITUDE.empty(3)
    assert north_of(attitude) == 0
    attitude["north"], attitude["azimuth"] = [1, 3, 3], [np.nan, 0.1, 0.1]
    assert north_of(attitude) == 3
    assert traces.NORTHS[3] == "grid"

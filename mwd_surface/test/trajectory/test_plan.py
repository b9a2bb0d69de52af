# SPDX-License-Identifier: Apache-2.0
"""Where the well is from its plan and how to steer back: closed forms, brute force, arcs that end where they aim."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.trajectory import plan as planning
from mwd_surface.trajectory.plan import read_plan

J_CURVE = planning.plan_of([0.0, 500.0, 1100.0, 2000.0], [0.0, 0.0, math.pi / 3, math.pi / 3], [0.0, 0.7, 0.7, 0.7])
coordinates = st.tuples(st.floats(-800, 1500), st.floats(-800, 1500), st.floats(-100, 2500))
inclinations, angles = st.floats(0.0, math.pi), st.floats(0.0, math.tau)


def test_a_point_on_the_plan_is_at_no_distance():
    inc, azi, at = mc.interpolate(J_CURVE.md, J_CURVE.inclination, J_CURVE.azimuth, J_CURVE.positions, 777.0)
    got = planning.offset_from(J_CURVE, at, float(inc), float(azi))
    assert got.distance == pytest.approx(0.0, abs=1e-9)
    assert got.plan_md == pytest.approx(777.0, abs=1e-6)


def test_up_and_right_are_seen_looking_down_hole():
    """On the tangent of 60 deg inclination, heading 0.7 rad: 3 m above the plan and 4 m to its right."""
    inc, azi, at = math.pi / 3, 0.7, J_CURVE.positions[2] + 300 * mc.tangent(math.pi / 3, 0.7)
    high = np.array([math.cos(inc) * math.cos(azi), math.cos(inc) * math.sin(azi), -math.sin(inc)])
    right = np.array([-math.sin(azi), math.cos(azi), 0.0])
    got = planning.offset_from(J_CURVE, at + 3 * high + 4 * right, inc, azi)
    assert (got.up, got.right, got.distance, got.plan_md) == pytest.approx((3.0, 4.0, 5.0, 1400.0))
    assert got.vertical == pytest.approx(-3 * math.sin(inc))
    # Back to the plan is down and left.
    assert math.degrees(got.toolface) == pytest.approx(180 + math.degrees(math.atan2(4, 3)))


@given(coordinates)
def test_no_station_of_a_dense_plan_is_nearer(point):
    dense = planning.interpolated(J_CURVE, 1.0)
    brute = float(np.min(np.linalg.norm(dense.positions - np.array(point), axis=1)))
    got = planning.offset_from(J_CURVE, point, 0.5, 0.5)
    assert got.distance <= brute + 1e-9
    assert got.distance >= math.sqrt(max(0.0, brute**2 - 0.5**2)) - 0.51
    assert math.hypot(got.up, got.right) <= got.distance + 1e-6


@given(inclination=inclinations, azimuth=angles, target=coordinates)
def test_the_arc_to_a_target_ends_in_the_target(inclination, azimuth, target):
    assume(np.linalg.norm(target) > 1.0)
    direction = np.array(target) / np.linalg.norm(target)
    assume(direction @ mc.tangent(inclination, azimuth) > 0.05)
    got = planning.steering_to((0.0, 0.0, 0.0), inclination, azimuth, target)
    path = mc.path([0.0, got.length], [inclination, got.inclination], [azimuth, got.azimuth])
    np.testing.assert_allclose(path[-1], target, atol=1e-6)


@given(inclination=st.floats(0.02, 3.1), azimuth=angles, end=st.tuples(st.floats(0.02, 3.1), angles))
def test_a_minimum_curvature_interval_is_found_again(inclination, azimuth, end):
    bend = float(mc.dogleg(inclination, azimuth, *end))
    assume(0.01 < bend < 1.5)
    there = mc.path([0.0, 50.0], [inclination, end[0]], [azimuth, end[1]], (1.0, 2.0, 3.0))[-1]
    got = planning.steering_to((1.0, 2.0, 3.0), inclination, azimuth, there)
    assert (got.length, got.dogleg_severity) == pytest.approx((50.0, bend / 50.0), rel=1e-6)
    np.testing.assert_allclose(mc.tangent(got.inclination, got.azimuth), mc.tangent(*end), atol=1e-6)


@pytest.mark.parametrize(
    ("end", "toolface_deg"),
    [((math.pi / 2 + 0.03, 1.0), 0.0), ((math.pi / 2, 1.03), 90.0), ((math.pi / 2 - 0.03, 1.0), 180.0)],
)
def test_high_side_builds_and_right_turns_right(end, toolface_deg):
    there = mc.path([0.0, 30.0], [math.pi / 2, end[0]], [1.0, end[1]])[-1]
    got = planning.steering_to((0, 0, 0), math.pi / 2, 1.0, there)
    assert math.cos(got.toolface - math.radians(toolface_deg)) == pytest.approx(1.0)


def test_from_the_vertical_the_toolface_counts_from_north():
    got = planning.steering_to((0, 0, 0), 0.0, 2.5, (0.0, 100.0, 1000.0))
    assert math.degrees(got.toolface) == pytest.approx(90.0)
    assert got.azimuth == pytest.approx(math.pi / 2)


def test_a_target_behind_or_at_the_bit_is_refused():
    with pytest.raises(ValueError, match="behind the bit"):
        planning.steering_to((0, 0, 0), 0.0, 0.0, (0.0, 0.0, -10.0))
    with pytest.raises(ValueError, match="apart from the position"):
        planning.steering_to((0, 0, 0), 0.0, 0.0, (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="at least two stations"):
        planning.plan_of([0.0], [0.0], [0.0])
    with pytest.raises(ValueError, match="step: must be positive"):
        planning.interpolated(J_CURVE, 0.0)


def test_the_section_azimuth_runs_from_the_start_to_the_target():
    assert J_CURVE.section_azimuth == pytest.approx(0.7)
    np.testing.assert_array_equal(J_CURVE.target, J_CURVE.positions[-1])


@pytest.mark.fault_case(40)
def test_a_plan_file_that_never_ends_is_refused_at_once(tmp_path):
    pipe = tmp_path / "plan.csv"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        with pytest.raises(ListFileError, match="not a regular file"):
            read_plan(path)

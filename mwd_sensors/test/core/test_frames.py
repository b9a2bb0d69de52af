# SPDX-License-Identifier: Apache-2.0
"""Frames: angles against hand-worked attitudes, the source's matrices, and their own inverses."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mwd_sensors.core.frames import (
    MAT_EN,
    TAU,
    gravity_toolface,
    hole_angles,
    inclination,
    magnetic_toolface,
    mat_from_quat,
    mat_nt,
    orientation_et,
    quat_from_mat,
    quat_from_rotvec,
    quat_multiply,
    wrap_pi,
    wrap_tau,
)

UP_N = np.array([0.0, 0.0, -9.8])
angles = st.floats(0.0, TAU)
inclinations = st.floats(1e-3, np.pi - 1e-3)


def _source_matrix(theta, phi, psi):
    """S0 eqs (1) and (2), written out: NED to tool."""
    yaw = np.array([[np.cos(psi), np.sin(psi), 0], [-np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
    pitch = np.array([[np.cos(theta), 0, -np.sin(theta)], [0, 1, 0], [np.sin(theta), 0, np.cos(theta)]])
    roll = np.array([[1, 0, 0], [0, np.cos(phi), np.sin(phi)], [0, -np.sin(phi), np.cos(phi)]])
    return roll @ pitch @ yaw


@given(inc=inclinations, azi=angles, toolface=angles)
def test_rotation_is_the_source_s_with_our_angles(inc, azi, toolface):
    source = _source_matrix(inc - np.pi / 2, toolface - np.pi, azi)
    np.testing.assert_allclose(mat_nt(inc, azi, toolface), source.T, atol=1e-12)


@given(inc=inclinations, azi=angles, toolface=angles)
def test_inclination_and_toolface_do_not_see_the_azimuth(inc, azi, toolface):
    f_t = mat_nt(inc, azi, toolface).T @ UP_N
    assert inclination(f_t) == pytest.approx(inc, abs=1e-9)
    assert wrap_pi(gravity_toolface(f_t) - toolface) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.fault_case(29)
@given(inc=inclinations, azi=angles, toolface=angles)
def test_hole_angles_invert_the_rotation(inc, azi, toolface):
    found = hole_angles(mat_nt(inc, azi, toolface))
    for value, wanted in zip(found, (inc, azi, toolface), strict=True):
        assert wrap_pi(value - wanted) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.fault_case(28)
@pytest.mark.parametrize("inc", [0.0, np.pi])
def test_an_exactly_vertical_hole_keeps_its_rotation(inc):
    mat = mat_nt(inc, 0.7, 1.1)
    found = hole_angles(mat)
    assert found[1] == 0.0
    np.testing.assert_allclose(mat_nt(*found), mat, atol=1e-12)


def test_hand_worked_attitudes():
    # Horizontal hole to the east, scribe line up: x east, z up, y = z x x = north.
    np.testing.assert_allclose(mat_nt(np.pi / 2, np.pi / 2, 0.0).T, [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-15)
    # Clockwise looking down-hole (east): a quarter turn from up is to the right, that is south.
    np.testing.assert_allclose(mat_nt(np.pi / 2, np.pi / 2, np.pi / 2)[:, 2], [-1, 0, 0], atol=1e-15)
    # Vertical hole, scribe line east: magnetic toolface 90 deg.
    assert magnetic_toolface(mat_nt(0.0, 0.0, np.pi / 2)) == pytest.approx(np.pi / 2)


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), z=st.floats(-3, 3))
def test_quaternions_and_matrices_agree(x, y, z):
    q = quat_from_rotvec([x, y, z])
    mat = mat_from_quat(q)
    np.testing.assert_allclose(mat @ mat.T, np.eye(3), atol=1e-12)
    back = quat_from_mat(mat)
    assert abs(back @ q) == pytest.approx(1.0)
    assert back[3] >= 0.0
    np.testing.assert_allclose(mat_from_quat(quat_multiply(q, back)), mat @ mat, atol=1e-9)


def test_quaternion_survives_half_turns():
    for axis in np.eye(3):
        mat = mat_from_quat(quat_from_rotvec(np.pi * axis))
        np.testing.assert_allclose(mat_from_quat(quat_from_mat(mat)), mat, atol=1e-12)


def test_ros_orientation_turns_tool_to_east_north_up():
    mat = mat_nt(1.0, 2.0, 3.0)
    np.testing.assert_allclose(mat_from_quat(orientation_et(mat)), MAT_EN @ mat, atol=1e-12)
    np.testing.assert_allclose(MAT_EN @ MAT_EN, np.eye(3))


@given(a=st.floats(-1e3, 1e3))
@example(a=-1e-20)
def test_wrapping_stays_in_range_and_keeps_the_angle(a):
    assert 0.0 <= wrap_tau(a) < TAU
    assert -np.pi <= wrap_pi(a) < np.pi
    assert np.cos(wrap_tau(a)) == pytest.approx(np.cos(a), abs=1e-9)
    assert np.sin(wrap_pi(a)) == pytest.approx(np.sin(a), abs=1e-9)

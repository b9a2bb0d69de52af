# SPDX-License-Identifier: Apache-2.0
"""The shared Kalman steps against plain numpy and scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from mwd_sensors.core import kalman
from mwd_sensors.core.frames import wrap_pi


def covariance(n: int, seed: int = 3) -> np.ndarray:
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T


@pytest.mark.parametrize("moving", [4, 7])
def test_covariance_is_propagated_as_by_the_whole_transition(moving: int) -> None:
    rng = np.random.default_rng(3)
    phi = rng.standard_normal((moving, 7)) * (rng.random((moving, 7)) < 0.5)
    whole = np.eye(7)
    whole[:moving] = phi
    P = covariance(7)
    expected = whole @ P @ whole.T
    kalman.propagate_covariance(P, phi, np.empty((moving, 7)))
    assert_allclose(P, expected, atol=1e-12)
    assert_array_equal(P, P.T)


def test_a_scalar_update_is_the_kalman_update_of_the_textbook() -> None:
    rng = np.random.default_rng(5)
    P, x, h, noise, measured = covariance(6), rng.standard_normal(6), rng.standard_normal(6), 0.3, 1.7
    h[2] = 0.0
    variance = h @ P @ h + noise
    gain = P @ h / variance
    expected_x, expected_P = x + gain * (measured - h @ x), (np.eye(6) - np.outer(gain, h)) @ P
    ph = np.full(6, np.nan)
    assert kalman.project_covariance(P, h, ph) == pytest.approx(variance - noise)
    assert_allclose(ph, P @ h)
    kalman.scalar_update(P, x, ph, variance, measured - h @ x)
    assert_allclose(x, expected_x)
    assert_allclose(P, expected_P, atol=1e-12)
    assert_array_equal(P, P.T)


def test_a_reset_state_is_independent_of_the_others() -> None:
    P = covariance(4)
    before = P.copy()
    kalman.reset_state(P, 1, 0.5)
    assert_array_equal(P[1], [0.0, 0.5, 0.0, 0.0])
    assert_array_equal(P[:, 1], P[1])
    rest = np.ix_([0, 2, 3], [0, 2, 3])
    assert_array_equal(P[rest], before[rest])


@pytest.mark.parametrize("angle", [-9.0, -math.pi, 0.0, 3.0, math.pi, 20.0])
def test_an_angle_is_wrapped_as_in_frames(angle: float) -> None:
    assert kalman.wrap_angle(angle) == wrap_pi(angle)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.01e-4, 0.3, 3.1])
def test_a_matrix_is_rotated_from_the_left_and_from_the_right(angle: float) -> None:
    mat = Rotation.from_euler("zyx", [1.0, 0.4, -2.0]).as_matrix()
    v = angle * np.array([0.36, -0.48, 0.8])
    turn = Rotation.from_rotvec(v).as_matrix()
    left, right = mat.copy(), mat.copy()
    kalman.rotate_left(left, *v)
    kalman.rotate_right(right, *v)
    assert_allclose(left, turn @ mat, atol=1e-15)
    assert_allclose(right, mat @ turn, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0121, 0.0999, 0.1001, 1.0, 3.0])
def test_a_vector_in_turned_axes_is_the_rotated_one_at_every_angle(angle: float) -> None:
    axis, vector = np.array([0.6, -0.48, 0.64]), np.array([0.2, 0.9, -0.4])
    turned = kalman.in_turned_axes(*vector, *(angle * axis))
    assert_allclose(turned, Rotation.from_rotvec(-angle * axis).apply(vector), rtol=0.0, atol=4e-16)


def test_coning_adds_a_twelfth_of_the_cross_product_of_neighbouring_angles() -> None:
    a, b = np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.01, -0.01])
    assert_allclose(kalman.coning_rotation(*a, *b, 0.5), b + 0.5 / 12.0 * np.cross(a, b))


def test_the_level_frame_lies_along_down_and_the_horizontal_part_of_forward() -> None:
    mat = np.empty((3, 3))
    down, forward = np.array([0.2, -3.0, 1.0]), np.array([1.0, 0.5, 0.0])
    kalman.level_matrix(down, forward, 1e-12, mat)
    assert_allclose(mat @ mat.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(mat) == pytest.approx(1.0)
    assert_allclose(mat @ down, [0.0, 0.0, np.linalg.norm(down)], atol=1e-14)
    level = mat @ forward
    assert level[0] > 0.0
    assert level[1] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("down", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
def test_without_a_horizontal_part_any_level_frame_will_do(down: list[float]) -> None:
    mat = np.empty((3, 3))
    kalman.level_matrix(np.array(down), 2.0 * np.array(down), 1e-12, mat)
    assert_allclose(mat @ mat.T, np.eye(3), atol=1e-15)
    assert_allclose(mat[2], down)

# SPDX-License-Identifier: Apache-2.0
"""The field of a small coil: its fall with distance, its shape, and the loss in conducting ground."""

import math

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.dipole import dipole_field, wave_number

NUMBER = st.floats(-50.0, 50.0)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(VECTOR, VECTOR, st.floats(0.1, 10.0))
def test_the_field_falls_with_the_third_power_of_the_distance_and_is_the_same_on_the_other_side(offset, moment, far):
    field = dipole_field(offset, moment)
    assert dipole_field(far * offset, moment) == pytest.approx(field / far**3, rel=1e-9)
    assert dipole_field(-offset, moment) == pytest.approx(field, rel=1e-12)


@given(VECTOR, VECTOR, st.integers(0, 2**31))
def test_the_field_turns_with_the_axes(offset, moment, seed):
    turn = scipy.spatial.transform.Rotation.random(random_state=seed).as_matrix()
    field = dipole_field(offset, moment)
    assert dipole_field(turn @ offset, turn @ moment) == pytest.approx(turn @ field, rel=1e-9, abs=1e-22)


def test_the_field_is_that_of_a_ring_of_current():
    """Biot-Savart around a ring of 1 cm at 2 m, on the axis and beside it."""
    radius, current = 0.01, 100.0
    angle = np.linspace(0.0, math.tau, 2001)[:-1]
    ring = radius * np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], axis=-1)
    along = radius * (math.tau / 2000) * np.stack([0.0 * angle, -np.sin(angle), np.cos(angle)], axis=-1)
    for point in ([2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.2, -0.9, 1.1]):
        away = np.array(point) - ring
        each = np.cross(along, away) / np.linalg.norm(away, axis=1)[:, None] ** 3
        expected = scipy.constants.mu_0 * current / (4.0 * math.pi) * each.sum(axis=0)
        found = dipole_field(point, [current * math.pi * radius**2, 0.0, 0.0]).real
        assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())


@given(VECTOR, VECTOR)
def test_ground_without_conductivity_changes_nothing_and_one_skin_depth_weakens_the_field(offset, moment):
    air = dipole_field(offset, moment)
    assert dipole_field(offset, moment, wave_number(8000.0, math.inf)) == pytest.approx(air, rel=1e-12)
    skin = 1.0 / wave_number(8000.0, 50.0).real
    assert skin == pytest.approx(math.sqrt(50.0 / (math.pi * 8000.0 * scipy.constants.mu_0)), rel=1e-9)
    near, far = ((scale / np.linalg.norm(offset)) * offset for scale in (0.01 * skin, 10.0 * skin))
    still = dipole_field(near, moment)
    change = dipole_field(near, moment, 1.0 / skin + 1j / skin) - still
    assert np.linalg.norm(change) < 1e-2 * np.linalg.norm(still)
    lossy = np.linalg.norm(dipole_field(far, moment, 1.0 / skin + 1j / skin))
    assert lossy < 0.05 * np.linalg.norm(dipole_field(far, moment))

# SPDX-License-Identifier: Apache-2.0
"""Inclination and dip: the conversion and its inverse, and the rows of a scenario."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.angle_convention import CONVENTIONS, AngleConvention
from mwd_sensors.simulator.scenario import parse

ANGLES = st.floats(0.0, math.pi)


@given(ANGLES, st.sampled_from(AngleConvention))
def test_the_angle_that_people_read_converts_back_to_the_same_inclination(inclination, convention):
    assert convention.inclination(convention.shown(inclination)) == pytest.approx(inclination, abs=1e-15)


@given(ANGLES)
def test_an_inclination_is_shown_to_the_last_bit_and_the_two_dips_are_opposite(inclination):
    assert AngleConvention.INCLINATION.shown(inclination) == inclination
    assert AngleConvention.DIP_UP.shown(inclination) == -AngleConvention.DIP_DOWN.shown(inclination)


def test_a_rising_hole_has_a_positive_dip_up():
    assert math.degrees(AngleConvention.DIP_UP.shown(math.radians(95.0))) == pytest.approx(5.0)
    assert math.isnan(AngleConvention.DIP_UP.shown(math.nan))


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_scenario_in_dips_has_the_same_hole_as_in_inclinations(convention):
    inclinations = np.array([[0.0, 92.0, 10.0], [40.0, 95.5, 11.0], [90.0, 88.25, 12.0]])
    rows = inclinations.copy()
    rows[:, 1] = np.degrees(AngleConvention(convention).shown(np.radians(inclinations[:, 1])))
    told = parse(f"well: {{convention: {convention}, stations: {rows.tolist()}}}").well
    usual = parse(f"well: {{stations: {inclinations.tolist()}}}").well
    np.testing.assert_allclose(told.hole, usual.hole, atol=1e-12)

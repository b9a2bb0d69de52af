# SPDX-License-Identifier: Apache-2.0
"""Readings that are not in SI are recognised by their size; those that are, never doubted."""

import numpy as np
import pytest

from mwd_sensors.core import units

EARTH = {"acceleration": 9.81, "rate": 16.2, "field": 4.9e-5}


def readings(quantity, factor=1.0):
    direction = np.random.default_rng(1).normal(size=(200, 3))
    return direction / np.linalg.norm(direction, axis=1)[:, None] * EARTH[quantity] / factor


@pytest.mark.fault_case(12)
@pytest.mark.parametrize(
    ("quantity", "unit"),
    [(q, u) for q, table in units.FACTORS.items() for u in table if (q, u) != ("field", "mT")],
)
def test_each_unit_is_named_by_the_size_of_the_readings(quantity, unit):
    found = units.doubt(quantity, readings(quantity, units.factor(quantity, unit)))
    if units.factor(quantity, unit) == 1.0:
        assert found is None
    else:
        assert found is not None
        assert found[1] == unit
        assert f"looks like {unit}" in found[0]


@pytest.mark.parametrize("force", [9.0, 30.0, 120.0])
def test_vibration_is_not_taken_for_another_unit(force):
    rng = np.random.default_rng(2)
    shaken = rng.normal(scale=force / 2.0, size=(5000, 3))
    shaken[:, 2] += 9.8
    assert units.doubt("acceleration", shaken) is None


def test_a_still_gyro_is_plausible():
    assert units.doubt("rate", np.zeros((10, 3))) is None


def test_a_dead_sensor_is_no_unit():
    sentence, unit = units.doubt("field", np.zeros((10, 3)))
    assert unit == ""
    assert "not plausible in any unit" in sentence


def test_nothing_finite_says_nothing():
    assert units.doubt("field", np.full((5, 3), np.nan)) is None
    assert units.doubt("field", np.zeros((0, 3))) is None


def test_an_unknown_unit_lists_those_that_are_known():
    with pytest.raises(ValueError, match="'oersted' is not one of T, mT, uT"):
        units.factor("field", "oersted")
    with pytest.raises(ValueError, match="'mass' is not one of"):
        units.factor("mass", "kg")

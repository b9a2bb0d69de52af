# SPDX-License-Identifier: Apache-2.0
"""The transmission line against an independent model of 3 km of mud."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator import mud_channel
from mwd_sensors.simulator.mud_channel import WellGeometry, responses, wave_speed

FREQUENCY = np.array([1.0, 4.0, 12.0, 24.0])


def loss_db(friction):
    """Loss of 3 km of drill pipe."""
    well = WellGeometry()
    line = mud_channel._line(well, 2.0 * np.pi * FREQUENCY, 0.5 * well.bore_m, 0.25 * np.pi * well.bore_m**2, friction)
    return 3000.0 * line[0].real * 20.0 / np.log(10.0)


def test_loss_is_that_of_the_independent_model():
    """20 mPa s, 2.1 GPa, bore 108.6 mm: boundary layer alone, then with 1.6 kPa/m of turbulent friction."""
    # The independent model took another density, to which the boundary layer is sensitive.
    assert loss_db(0.0) == pytest.approx([2.6, 5.3, 9.1, 12.9], rel=0.15)
    assert loss_db(1600.0) == pytest.approx([10.0, 13.0, 17.0, 21.0], abs=0.7)


def test_waves_run_at_korteweg_s_speed():
    assert wave_speed(WellGeometry()) == pytest.approx(1250.0, abs=15.0)
    assert wave_speed(WellGeometry(bulk_modulus=1.0e8)) < 300.0


def test_a_dampener_makes_a_null_between_two_and_two_and_a_half_hertz():
    frequency = np.array([1.0, 2.25, 6.0])
    charged = np.abs(responses(WellGeometry(), frequency)[0])
    assert charged[1] < 0.2 * charged[0]
    assert charged[1] < 0.4 * charged[2]
    flat = np.abs(responses(WellGeometry(precharge=0.0), frequency)[0])
    assert flat[1] > 0.7 * flat[0]


def test_depth_costs_some_decibels_a_kilometre_at_a_few_hertz():
    frequency = np.linspace(3.0, 6.0, 31)
    power = [np.mean(np.abs(responses(WellGeometry(depth_m=depth), frequency)[0]) ** 2) for depth in (3000.0, 5000.0)]
    assert 10.0 * np.log10(power[0] / power[1]) / 2.0 == pytest.approx(4.5, abs=0.6)


def test_pumps_are_quieter_behind_a_charged_dampener():
    frequency = np.array([4.35, 8.7])
    charged, flat = (
        np.abs(responses(dataclasses.replace(WellGeometry(), precharge=p), frequency)[1]) for p in (0.35, 0.0)
    )
    assert np.all(charged < 0.3 * flat)

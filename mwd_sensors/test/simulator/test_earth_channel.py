# SPDX-License-Identifier: Apache-2.0
"""The EM channel: loss against the table of the literature's model, layers, blocks."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator.carrier_tool import transmit
from mwd_sensors.simulator.earth_channel import (
    EarthChannel,
    EarthNoise,
    EarthVoltage,
    Ground,
    earth_run,
    propagation,
    response,
)
from mwd_sensors.telemetry.tool_configuration import from_mapping

# dB/km at 2, 5, 10 Hz by resistivity, ohm m: an independent computation of the leaky line.
TABLE = {1: (58, 69, 87), 3: (33, 39, 49), 10: (17, 21, 26), 30: (10, 12, 15), 100: (5, 6, 8)}
FREQUENCY = np.array([2.0, 5.0, 10.0])
TOOL = from_mapping({"code": "psk", "carrier": {"medium": "earth", "frequency_hz": 6.0}, "transmit_delay_s": 1.0})
SENT = transmit(TOOL, ((0.0, 100.0),), 1)
DB_PER_NEPER = 20.0 / np.log(10.0)


def loss_db_per_km(resistivity):
    constant, _, _ = propagation(Ground(), resistivity, FREQUENCY)
    return 1000.0 * DB_PER_NEPER * constant.real


@pytest.mark.parametrize("resistivity", TABLE)
def test_the_loss_is_that_of_the_table(resistivity):
    assert loss_db_per_km(resistivity) == pytest.approx(np.array(TABLE[resistivity]), abs=2.0)


def test_another_kilometre_costs_what_the_line_loses():
    ground = Ground(bottom_m=(12000.0,), resistivity=(10.0,))
    far, near = (np.abs(response(dataclasses.replace(ground, depth_m=m), FREQUENCY)) for m in (3000.0, 2000.0))
    assert DB_PER_NEPER * np.log(near / far) == pytest.approx(loss_db_per_km(10.0), abs=0.5)


def test_two_layers_of_the_same_ground_are_one():
    one = Ground(bottom_m=(12000.0,), resistivity=(10.0,), depth_m=2500.0)
    two = dataclasses.replace(one, bottom_m=(800.0, 12000.0), resistivity=(10.0, 10.0))
    assert response(two, FREQUENCY) == pytest.approx(response(one, FREQUENCY), rel=1e-9)


def test_the_mode_satisfies_its_equation_without_steel_loss_in_the_limit():
    """A string without resistance guides a wave of the ground itself: the skin depth decides."""
    constant, _, _ = propagation(dataclasses.replace(Ground(), wall_m=0.05, radius_m=0.3), 0.1, np.array([100.0]))
    ground = np.sqrt(1j * 2.0 * np.pi * 100.0 * 4e-7 * np.pi / 0.1)
    assert constant[0] == pytest.approx(ground, rel=0.2)


def test_voltage_is_the_same_however_it_is_asked_for_and_by_seed():
    _, whole = earth_run(EarthChannel(), SENT, 60.0, 3)
    stream = EarthVoltage(EarthChannel(), SENT.drive, 3)
    assert np.array_equal(np.concatenate([stream.block() for _ in range(6)]), whole)
    assert not np.array_equal(earth_run(EarthChannel(), SENT, 60.0, 4)[1], whole)


def test_the_signal_has_the_size_of_the_response():
    quiet = EarthNoise(0.0, 0.0, 0.0, 50.0, 0.0, 1.45, 0.0, 0.0)
    ground = Ground(bottom_m=(12000.0,), resistivity=(30.0,), depth_m=2000.0)
    _, voltage = earth_run(EarthChannel(ground, quiet), SENT, 60.0, 3)
    size = float(np.abs(response(ground, np.array([6.0])))[0])
    assert np.sqrt(2.0) * np.std(voltage[2500:]) == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"bottom_m": (1000.0,)}, "as many"),
        ({"bottom_m": (5000.0, 1000.0)}, "go down"),
        ({"bottom_m": (500.0, 1500.0)}, "above the bit"),
    ],
)
def test_ground_that_cannot_be_is_refused(change, complaint):
    with pytest.raises(ValueError, match=complaint):
        dataclasses.replace(Ground(), **change)

# SPDX-License-Identifier: Apache-2.0
"""The receiver of a sonde's field: strength by distance and direction, mains lines, blocks, and a link that is late."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_sensors.simulator.carrier_tool import transmit
from mwd_sensors.simulator.coil_channel import RATE_HZ, CoilChannel, CoilVoltage, coil_run
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.telemetry_link import CoilLink, OnAir
from mwd_sensors.telemetry.carrier import Coil
from mwd_sensors.telemetry.tool_configuration import from_mapping

AHEAD = np.array([1.0, 0.0, 0.0])
QUIET = CoilChannel(position_m=(10.0, 0.0, 0.0), resistivity=1e6, noise_t=0.0, mains_t=0.0)


def still(_at_s):
    """A level sonde at the wellhead that points north."""
    return np.zeros(3), AHEAD


def voltage(channel, drive=np.zeros_like, place=still, seed=1, blocks=4):
    """So many seconds of voltage."""
    stream = CoilVoltage(channel, Coil(), place, drive, seed)
    return np.concatenate([stream.block() for _ in range(blocks)])


def test_the_voltage_is_the_strength_of_the_dipole_and_its_change_the_carrier():
    # On the axis at 10 m: mu0 m / (2 pi r^3) = 2e-7 x 5 / 1000 T.
    assert voltage(QUIET) == pytest.approx(1.0, rel=1e-3)
    time = np.arange(1000) / RATE_HZ
    sent = voltage(QUIET, lambda t: np.cos(2.0 * math.pi * 12.0 * t))
    assert sent == pytest.approx(voltage(QUIET) * (1.0 + 0.5 * np.cos(2.0 * math.pi * 12.0 * time)), rel=1e-9)
    far = dataclasses.replace(QUIET, position_m=(20.0, 0.0, 0.0))
    assert voltage(far) == pytest.approx(voltage(QUIET) / 8.0, rel=1e-2)


def test_a_coil_across_the_field_receives_nothing_and_one_beside_the_sonde_half():
    assert voltage(dataclasses.replace(QUIET, axis=(0.0, 1.0, 0.0))) == pytest.approx(0.0, abs=1e-9)
    beside = dataclasses.replace(QUIET, position_m=(0.0, 10.0, 0.0))
    assert voltage(beside) == pytest.approx(0.5 * voltage(QUIET), rel=1e-2)


def test_the_strength_follows_a_sonde_that_moves():
    def place(at_s):
        return np.array([at_s, 0.0, 0.0]), AHEAD

    moving = voltage(QUIET, place=place)
    assert moving[0] == pytest.approx(1.0, rel=1e-3)
    assert moving[-1] == pytest.approx(1000.0 / 6.0**3, rel=0.02)
    assert (np.diff(moving) > 0.0).all()


def test_mains_harmonics_appear_at_their_distance_from_the_frequency_of_the_sonde():
    hum = voltage(dataclasses.replace(QUIET, mains_t=1e-11), blocks=8)
    power = np.abs(np.fft.rfft((hum - hum.mean()) * np.hanning(len(hum)))) ** 2
    hertz = np.fft.rfftfreq(len(hum), 1.0 / RATE_HZ)
    # 8025 Hz: the harmonics 160 and 161 are 25 Hz away, the next two 75 Hz.
    assert min(abs(hertz[np.argmax(power)] - line) for line in (25.0, 75.0)) < 5.0
    near = [np.abs(hertz - line) < 12.0 for line in (25.0, 75.0)]
    assert sum(power[one].sum() for one in near) > 0.8 * power.sum()


def test_white_noise_has_its_density_in_the_band():
    noisy = voltage(dataclasses.replace(QUIET, noise_t=1e-12), blocks=40)
    # A strong steady field turns one of the two components into a change of the amplitude.
    assert noisy.std() * 1e-9 == pytest.approx(1e-12 * math.sqrt(RATE_HZ), rel=0.05)


def test_a_voltage_does_not_depend_on_how_far_it_is_asked_for_and_late_phases_are_counted():
    def heard(steps):
        link = CoilLink(CoilChannel(), Coil(), lambda _at: (np.array([5.0, 0.0, 3.0]), AHEAD), 3)
        assert link.send(OnAir("coil", 2.0, phases=(0.0, 1.0, 2.0), width_s=0.5, frequency_hz=12.0)) == 0
        values = np.concatenate([one.values for step in steps for one in link.advance(step)])
        return values, link.send(OnAir("coil", 4.0, phases=(0.0,), width_s=0.5, frequency_hz=12.0))

    (one, late), (other, _) = heard([30.0]), heard([1.0, 7.5, 30.0])
    assert np.array_equal(one, other)
    assert late == 1


def test_the_run_of_a_tool_is_the_same_by_seed():
    tool = from_mapping({"code": "psk", "carrier": {"medium": "coil"}, "transmit_delay_s": 1.0})
    sent = transmit(tool, ((0.0, 60.0),), 1)
    (_, one), (_, same), (_, other) = (coil_run(CoilChannel(), tool.coil, sent, 20.0, seed) for seed in (3, 3, 4))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_the_sonde_of_a_scenario_is_where_its_hole_is():
    story = parse(
        "name: bore\nwell: {stations: [[0.0, 75.0, 42.0]], bit_m: 21.0, sensor_to_bit_m: 1.0}\n"
        "schedule: [{kind: still, seconds: 5.0}]\nprecision: null\n"
        "telemetry: {tool: {code: psk, carrier: {medium: coil}}}\n"
    )
    position, axis = Sonde(story).motion.place(2.0)
    inclination, azimuth = math.radians(75.0), math.radians(42.0)
    level = math.sin(inclination)
    expected = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.cos(inclination)])
    assert axis == pytest.approx(expected, abs=1e-6)
    assert position == pytest.approx(20.0 * expected, abs=1e-3)


def test_a_receiver_without_a_direction_is_refused():
    with pytest.raises(ValueError, match="direction"):
        CoilChannel(axis=(0.0, 0.0, 0.0))

# SPDX-License-Identifier: Apache-2.0
"""Channels of a run's links: what is put on air while it runs is what is heard, and what comes too late is counted."""

import math

import numpy as np
import pytest

from mwd_sensors.simulator.carrier_tool import CarrierSent, CarrierSpan, CarrierStream
from mwd_sensors.simulator.earth_channel import EarthChannel, EarthNoise
from mwd_sensors.simulator.serial_channel import SerialChannel, SerialStream
from mwd_sensors.simulator.telemetry_link import EarthLink, OnAir, WireLink

QUIET = EarthChannel(noise=EarthNoise(0.0, 0.0, 0.0, 50.0, 0.0, switching_per_hour=0.0))
SYMBOLS = np.exp(0.5j * math.pi * np.arange(40))


def test_blocks_that_follow_each_other_are_one_carrier():
    time = np.arange(0.005, 40.0, 0.01)
    stream = CarrierStream("mud")
    for k in range(4):
        stream.add(5.0 + 5.0 * k + 1e-9, SYMBOLS[10 * k : 10 * k + 10], 0.5, 12.0)
    whole = CarrierSent((), (CarrierSpan(5.0, SYMBOLS),), 12.0, 0.5, 0.1)
    assert stream.drive(time) == pytest.approx(whole.drive(time), abs=1e-5)


def test_a_carrier_that_begins_anew_ends_what_is_on_air():
    stream = CarrierStream("earth")
    stream.add(0.0, SYMBOLS, 1.0, 5.0)
    stream.add(10.25, SYMBOLS[:5], 1.0, 5.0)
    time = np.arange(0.0, 40.0, 0.01)
    found = stream.drive(time)
    assert np.abs(found).max() <= 1.0
    assert not found[(time > 10.01) & (time < 10.24)].any()
    assert not found[time > 15.26].any()


def test_a_voltage_does_not_depend_on_how_far_it_is_asked_for():
    def heard(steps):
        link = EarthLink(EarthChannel(), 3)
        link.send(OnAir("em", 2.0, phases=tuple(np.angle(SYMBOLS).tolist()), width_s=0.5, frequency_hz=6.0))
        return np.concatenate([one.values for step in steps for one in link.advance(step)])

    assert np.array_equal(heard([30.0]), heard([1.0, 7.5, 30.0]))


def test_phases_that_come_too_late_are_left_out_and_counted():
    link = EarthLink(QUIET, 1)
    link.advance(5.0)
    assert link.send(OnAir("em", 4.0, phases=(0.0, 0.0), width_s=0.5, frequency_hz=6.0)) == 1
    assert not np.concatenate([one.values for one in link.advance(10.0)]).any()


def test_a_frame_arrives_once_all_of_it_has_and_a_break_loses_what_falls_into_it():
    link = WireLink(SerialChannel(), 9600, 1)
    assert link.send(OnAir("serial", 1.0, octets=b"abcd")) == 0
    assert link.advance(1.003) == []
    (heard,) = link.advance(1.01)
    assert heard.values.tobytes() == b"abcd"
    assert heard.start_s == pytest.approx(1.0 + 10.0 / 9600.0)
    assert link.send(OnAir("serial", 1.0, octets=b"abcd")) == 1
    line = SerialStream(SerialChannel(breaks_per_hour=360.0, break_s=5.0), 9600, 2)
    got = sum(len(line.carry(float(k), b"x" * 100)) for k in range(3600))
    # A break begins a tenth as often as it lasts half of it: a third of the time is lost.
    assert got / 360_000 == pytest.approx(1.0 / 1.5, abs=0.06)

# SPDX-License-Identifier: Apache-2.0
"""A surface unit of another maker polls the surface: a Modbus master, a frame of its own, and what goes wrong."""

import contextlib
import math
import os
import select
import time

import pytest
from example_rig import extended, pseudo_terminal, started, values
from pymodbus.client import ModbusSerialClient
from waiting import eventually

from mwd_sensors.drivers import polled_line
from mwd_sensors.drivers.polled_line import Master
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.rig.polled.unit import QUANTITIES, PolledSettings, PolledUnit, host_frame
from mwd_surface.rig.values import silenced

OWN_FRAME = """
start: eb90
address: 7
counted: false
check_order: high_first
polls:
  - {command: 1, items: [
      {quantity: survey_inclination, form: int16, step: -0.01, offset: 90.0, unit: deg},
      {quantity: survey_azimuth, form: uint16, step: 0.01, unit: deg}]}
  - {command: 2, items: [{quantity: gravity_toolface, form: uint16, step: 0.1, unit: deg}]}
"""


@contextlib.contextmanager
def on_a_line(**settings):
    """The unit with its first values, and a descriptor of the line's other end."""
    with pseudo_terminal() as (theirs, device), started(PolledUnit(PolledSettings(device=device, **settings))) as unit:
        unit.publish(values())
        yield unit, theirs


def polled(line, frame, rounds=1, within=10.0):
    """Poll the unit for a number of rounds, as a host does; return the values and the host."""
    host, got, end = Master(frame), {}, time.monotonic() + within
    while host.counters.frames < rounds * len(frame.polls) and time.monotonic() < end:
        if asked := host.due(time.monotonic()):
            os.write(line, asked)
        if select.select([line], [], [], 0.01)[0]:
            for one in host.feed(os.read(line, 4096), time.monotonic()):
                got |= one.values
    return got, host


def test_an_emulated_host_reads_inclination_azimuth_and_toolface():
    with on_a_line() as (unit, line):
        got, host = polled(line, host_frame())
        expected = values().values
        assert set(got) == {"inclination", "azimuth", "gravity_toolface"}
        for name, value in got.items():
            assert value == pytest.approx(expected[name].value, abs=math.radians(0.006))
        assert host.trouble == {}
        assert unit.status().sent == 1
        unit.publish(silenced(values(), 10.0, "for the test"))
        assert all(math.isnan(value) for value in polled(line, host_frame())[0].values())


def test_a_frame_of_another_maker_is_served_from_its_file_with_a_dip(tmp_path):
    (tmp_path / "host.yaml").write_text(OWN_FRAME)
    frame = polled_line.read(tmp_path / "host.yaml", QUANTITIES)
    with on_a_line(frame_file=str(tmp_path / "host.yaml")) as (_, line):
        got, host = polled(line, frame, rounds=3)
        expected = values().values
        for name, value in got.items():
            assert value == pytest.approx(expected[name].value, abs=math.radians(0.06))
        assert host.trouble == {}
        os.write(line, polled_line.request(frame, frame.polls[0]))
        answer = b""
        while len(answer) < 10:
            assert select.select([line], [], [], 5.0)[0]
            answer += os.read(line, 100)
    dip = int.from_bytes(answer[4:6], "big", signed=True)
    assert dip == round(9000.0 - 100.0 * math.degrees(expected["survey_inclination"].value))


def test_a_modbus_master_of_others_making_reads_the_usual_registers():
    with on_a_line() as (_, line), extended(line) as device:
        client = ModbusSerialClient(device, baudrate=9600, timeout=5)
        with contextlib.closing(client):
            assert client.connect()
            answer = client.read_input_registers(0, count=3, device_id=1)
            refused = client.read_input_registers(10, count=3, device_id=1)
    expected = values().values
    names = ("inclination", "azimuth", "gravity_toolface")
    assert answer.registers == [round(100.0 * math.degrees(expected[name].value)) for name in names]
    assert refused.isError()


def test_noise_and_damaged_requests_are_not_answered_and_are_said():
    with on_a_line() as (unit, line):
        whole = polled_line.request(host_frame(), host_frame().polls[0])
        os.write(line, b"\x00\xff\x55" + whole[:-1] + bytes([whole[-1] ^ 1]))
        eventually(lambda: "wrong check" in unit.status().reason)
        assert not select.select([line], [], [], 0.1)[0]
        assert len(polled(line, host_frame())[0]) == 3


def test_a_frame_file_with_an_unknown_quantity_or_a_device_that_is_missing_is_refused(tmp_path):
    (tmp_path / "host.yaml").write_text("polls: [{items: [{quantity: inclinaton}]}]")
    with pytest.raises(InterfaceError, match="inclination"):
        PolledUnit(PolledSettings(device="/dev/null", frame_file=str(tmp_path / "host.yaml"))).start()
    with pytest.raises(InterfaceError, match="No such file"):
        PolledUnit(PolledSettings(device=str(tmp_path / "none"))).start()

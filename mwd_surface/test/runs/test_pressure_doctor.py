# SPDX-License-Identifier: Apache-2.0
"""A file of pressure before it is decoded: what hides pulses is named with its remedy."""

import dataclasses

import numpy as np

from mwd_sensors.telemetry.carrier import Carrier
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pressure_files import PressureFile
from mwd_surface.runs.doctor import CheckLevel
from mwd_surface.runs.pressure_doctor import examine_pressure

TIME = np.arange(0.0, 300.0, 0.02)
FLOW = 1.0 - np.exp(-np.maximum(TIME - 60.0, 0.0) / 2.0)
PRESSURE = 2.0e5 + 2.0e7 * FLOW + np.random.default_rng(1).normal(size=len(TIME)) * 1e4
GOOD = PressureFile(TIME, PRESSURE, "time_s of the file", ())


def levels(read, tool=None):
    return {result.name: result.level for result in examine_pressure(read, tool)}


def test_a_good_file_has_nothing_to_mend():
    assert set(levels(GOOD, ToolConfiguration()).values()) == {CheckLevel.OK}
    flow = next(result for result in examine_pressure(GOOD, ToolConfiguration()) if result.name == "flow")
    assert "start at 6" in flow.state


def test_too_few_samples_for_the_pulses_are_missing():
    slow = dataclasses.replace(GOOD, time_s=TIME[::20], pressure_pa=PRESSURE[::20])
    assert levels(slow, ToolConfiguration(pulse_width_s=0.5))["sample rate"] == CheckLevel.MISSING
    assert levels(slow)["sample rate"] == CheckLevel.OK


def test_a_coarse_converter_and_a_column_without_its_unit_are_named():
    coarse = dataclasses.replace(GOOD, pressure_pa=np.round(PRESSURE / 1e5) * 1e5)
    assert levels(coarse)["resolution"] == CheckLevel.NOTE
    assert levels(dataclasses.replace(GOOD, pressure_pa=PRESSURE / 1e5))["size"] == CheckLevel.NOTE
    assert levels(dataclasses.replace(GOOD, pressure_pa=np.full(len(TIME), 2e7)))["resolution"] == CheckLevel.MISSING


def test_a_file_in_which_no_pump_starts_and_notes_of_the_data_are_named():
    steady = dataclasses.replace(GOOD, pressure_pa=PRESSURE[10000:], time_s=TIME[10000:], notes=("2 gaps",))
    found = levels(steady)
    assert found["flow"] == CheckLevel.NOTE
    assert found["data"] == CheckLevel.NOTE


def test_the_samples_of_a_carrier_are_judged_by_its_frequency():
    siren = ToolConfiguration(code="psk", carrier=Carrier(frequency_hz=12.0, symbol_rate_hz=2.5))
    assert levels(GOOD, siren)["sample rate"] == CheckLevel.OK
    slow = dataclasses.replace(GOOD, time_s=TIME[::5], pressure_pa=PRESSURE[::5])
    assert levels(slow, siren)["sample rate"] == CheckLevel.MISSING


def test_the_voltage_of_a_tool_in_the_earth_is_not_judged_as_a_standpipe_pressure():
    tool = ToolConfiguration(code="psk", carrier=Carrier(medium="earth", frequency_hz=6.0))
    voltage = 1e-4 * np.random.default_rng(2).normal(size=len(TIME))
    results = examine_pressure(dataclasses.replace(GOOD, pressure_pa=voltage), tool)
    assert {result.level for result in results} == {CheckLevel.OK}
    assert not any("bar" in result.state.split() for result in results)

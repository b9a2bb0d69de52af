# SPDX-License-Identifier: Apache-2.0
"""The register map: every address as tabulated, held or NaN where not to be used, words in either order."""

import dataclasses
import math
import struct

import pytest
from example_rig import attitude, values
from example_surveys import START, S, survey, surveys
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.status import Status
from mwd_surface.rig.modbus.map import (
    COUNT,
    FLOATS,
    NEVER,
    VERSION,
    ControlBit,
    ModbusForm,
    StatusBit,
    float_of,
    long_of,
    registers,
    status_bits,
)
from mwd_surface.rig.values import Condition, RigValue, nothing_yet
from mwd_surface.surveys.survey_list import SurveyList

ABCD, CDAB = ModbusForm(), ModbusForm(word_order="CDAB")


def at(block, address, form=ABCD):
    return float_of(block[address : address + 2], form)


def test_every_register_holds_what_the_table_says():
    table = values()
    s = table.survey
    block = registers(table, ABCD)
    assert len(block) == COUNT
    assert block[:2] == (VERSION, 5000)
    assert block[3] == 12
    expected = {
        4: 123.456,
        6: 201.5,
        8: 0.1,
        10: math.degrees(s.value("inclination")),
        12: math.degrees(s.value("azimuth")),
        14: s.value("measured_depth"),
        16: s.value("g_total") / 9.80665,
        18: s.value("b_total") * 1e9,
        20: math.degrees(s.value("dip")),
        22: 0.05,
        24: 0.4,
        26: 40.12,
        28: 850.0,
        30: 60.0 / math.pi,
        32: 71.25,
        46: 1.9 * 30.0 / math.pi,
        48: 5000.0,
        50: 1800.0,
        52: 19.0,
        54: math.nan,
        56: 1800.0,
        58: 120.0,
        60: 4000.0,
        62: math.degrees(1.0),
        64: 650.25,
        66: 660.0,
        68: 678.25,
        70: 1.0,
        72: 1.75,
        74: 0.25,
        76: -1.5,
    }
    for address, value in expected.items():
        assert at(block, address) == pytest.approx(value, rel=1e-6, nan_ok=True), address
    assert struct.unpack(">Q", struct.pack(">4H", *block[34:38]))[0] == s.result.stamp_ns // 1_000_000
    assert set(FLOATS) | {8} == set(expected)
    # Depth of a ROS publisher; clock of the rig, clock of the tool.
    assert block[78:80] == (2, 0x0201)


def test_who_has_control_and_what_was_taken_is_beside_it():
    block = registers(values(), ABCD)
    enabled, mwd, slide = (1 << bit for bit in (ControlBit.ENABLED, ControlBit.MWD_ALIVE, ControlBit.ADVISED_SLIDE))
    assert block[38:46] == (2, enabled | mwd | slide, 1, 70_000 - 65_536, 5, 2, 2, 1)
    swapped = registers(values(), CDAB)
    assert long_of(block[40:42], ABCD) == long_of(swapped[40:42], CDAB) == 70_000


def test_big_endian_words_are_those_of_ieee_754():
    table = dataclasses.replace(values())
    block = registers(table, ABCD)
    assert struct.pack(">2H", *block[4:6]) == struct.pack(">f", 123.456)
    swapped = registers(table, CDAB)
    assert swapped[4:6] == block[5:3:-1]
    assert swapped[34:38] == block[37:33:-1]
    assert at(swapped, 4, CDAB) == at(block, 4)


@pytest.mark.parametrize(
    ("bit", "table"),
    [
        (StatusBit.ACTIVE, values()),
        (StatusBit.SONDE_LINK, values()),
        (StatusBit.TOOLFACE_FRESH, values()),
        (StatusBit.SURVEY_ACCEPTED, values()),
        (StatusBit.INTERFERENCE_CORRECTED, values()),
        (StatusBit.RECORDING, values()),
        (StatusBit.GRAVITY_MODE, values()),
        (StatusBit.MAGNETIC_MODE, values(sample=attitude(Status.NEAR_VERTICAL, inclination=0.01))),
        (StatusBit.ROTATING, values(sample=attitude(Status.ROTATING))),
        (StatusBit.SIMULATED, values(simulated=True)),
    ],
)
def test_a_status_bit_is_set_when_it_is_so_and_not_before_anything_is_known(bit, table):
    assert status_bits(table) >> bit & 1
    assert bit == StatusBit.GRAVITY_MODE or not status_bits(nothing_yet()) >> bit & 1


@pytest.mark.parametrize(("verdict", "bit"), [(1, StatusBit.QUALITY_DOUBTFUL), (2, StatusBit.QUALITY_BAD)])
def test_the_quality_of_the_survey_is_in_its_bits(verdict, bit):
    whole = SurveyList().add(survey(1, 30.0, 75.0, verdict=verdict, north=2), 300.0, 0.0).accept(1, "Bo", "", START + S)
    assert status_bits(values(whole)) >> bit & 1
    assert not status_bits(values()) >> bit & 1


def test_a_toolface_is_not_fresh_while_the_string_turns_or_when_it_is_old():
    fresh = 1 << StatusBit.TOOLFACE_FRESH
    assert not status_bits(values(sample=attitude(Status.ROTATING))) & fresh
    assert not status_bits(values(later=5.0)) & fresh


def test_what_is_not_to_be_used_is_held_or_a_quiet_nan_if_asked_for():
    old = values(later=100.0)
    held, nan = registers(old, ABCD), registers(old, ModbusForm(nan_invalid=True))
    assert at(held, 4) == pytest.approx(123.456)
    assert at(held, 8) == pytest.approx(100.1)
    assert nan[4:6] == (0x7FC0, 0)
    assert math.isnan(at(nan, 26))
    assert at(nan, 10) == at(held, 10)


def test_before_anything_came_no_number_is_given_and_the_age_says_never():
    block = registers(nothing_yet(), ABCD)
    assert at(block, 8) == NEVER
    assert block[0] == VERSION
    assert all(math.isnan(at(block, a)) for a in FLOATS)


@pytest.mark.parametrize("name", [name for name, _, _ in FLOATS.values()])
def test_a_number_that_is_not_known_is_a_nan_beside_numbers_that_are(name):
    """An unknown sigma of the azimuth was 0 deg, and an unknown age of the depth 0 s."""
    table = values()
    unknown = dataclasses.replace(table, values={**table.values, name: RigValue(reason="not known for this survey")})
    block = registers(unknown, ABCD)
    missing = {n for a, (n, _, _) in FLOATS.items() if math.isnan(at(block, a))}
    # The driller's turn is not set in the example either.
    assert missing == {name, "set_turn"}


def test_an_angle_just_below_a_turn_is_zero_not_360():
    table = values()
    almost = RigValue(math.nextafter(math.tau, 0.0), Condition.GOOD)
    table = dataclasses.replace(table, values={**table.values, "survey_azimuth": almost})
    assert at(registers(table, ABCD), 12) == 0.0


@given(value=st.floats(allow_nan=False, allow_infinity=False), heartbeat=st.integers(0, 2**40))
def test_any_finite_value_fits_the_registers(value, heartbeat):
    table = nothing_yet()
    odd = {name: RigValue(value, Condition.GOOD) for name in table.values}
    block = registers(dataclasses.replace(table, values=odd, heartbeat=heartbeat), ABCD)
    assert all(0 <= word <= 0xFFFF for word in block)
    assert block[1] == heartbeat % 65536


def test_a_survey_number_beyond_16_bits_wraps():
    whole = SurveyList().add(survey(70_000, 30.0, 75.0, north=2), 300.0, 0.0)
    assert registers(values(whole), ABCD)[3] == 70_000 - 65_536
    assert registers(values(surveys()), ABCD)[3] == 12

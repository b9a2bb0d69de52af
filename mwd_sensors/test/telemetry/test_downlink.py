# SPDX-License-Identifier: Apache-2.0
"""Commands to the tool: codes that come back, a check that finds errors, and what each command changes."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.telemetry import downlink, tool_commands
from mwd_sensors.telemetry.downlink import COMMANDS, HEAD, Downlink, DownlinkFrame, decode, frame_of, levels, programme
from mwd_sensors.telemetry.tool_commands import ToolSettings, applied, command
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, from_mapping, text

FRAMES = st.builds(DownlinkFrame, st.integers(1, 7), st.integers(0, len(COMMANDS) - 1), st.integers(0, 15))
TOOL = ToolConfiguration(
    pulse_width_s=0.8,
    downlink=Downlink(pulse_widths_s=(0.3, 0.5, 0.8)),
    survey_sequences=("Inc:12:P Azm:12:P DLnk:10:P", "Inc:12:P DLnk:10:P"),
    toolface_sequences=("aTFA:6:P Gama:8:P", "Gama:8:P"),
)


@given(FRAMES)
def test_a_command_comes_back_from_its_levels_and_its_echo(frame):
    given_levels = levels(frame, TOOL.downlink)
    assert given_levels[:2] == HEAD[1:]
    assert given_levels[-1] == HEAD[0]
    assert decode(given_levels[2:-1], TOOL.downlink) == frame
    assert frame_of(frame.echo) == frame


@given(FRAMES)
def test_one_or_two_wrong_symbols_next_to_the_right_ones_are_found(frame):
    data = levels(frame, TOOL.downlink)[2:-1]
    for places in [*itertools.combinations(range(9), 1), *itertools.combinations(range(9), 2)]:
        wrong = list(data)
        for place in places:
            wrong[place] += 1 if wrong[place] < 3 else -1
        assert decode(tuple(wrong), TOOL.downlink) is None


def test_a_command_for_another_table_is_no_command():
    other = Downlink(pulse_widths_s=(0.5, 0.3, 0.8))
    data = levels(DownlinkFrame(1, 1, 0), TOOL.downlink)[2:-1]
    assert decode(data, other) is None


def test_echo_zero_and_numbers_without_a_command_are_none():
    assert frame_of(0) is None
    assert frame_of(DownlinkFrame(1, 0, 0).echo | 7 << 4) is None
    assert [downlink.next_counter(k) for k in (0, 1, 6, 7)] == [1, 2, 7, 1]


@given(FRAMES)
def test_the_programme_ramps_from_level_to_level_and_ends_where_it_began(frame):
    given_programme = programme(frame, TOOL.downlink)
    assert given_programme.at(-1.0) == given_programme.at(given_programme.duration_s + 1.0) == 1.0
    start = 0.0
    before = 1.0
    for number, symbol in enumerate(given_programme.symbols, 1):
        assert given_programme.at(start + 0.5 * symbol.ramp_s) == pytest.approx(0.5 * (before + symbol.amplitude))
        assert given_programme.at(start + symbol.ramp_s + 0.5 * symbol.hold_s) == pytest.approx(symbol.amplitude)
        assert given_programme.number_at(start + 0.5) == number
        start, before = start + symbol.ramp_s + symbol.hold_s, symbol.amplitude
    assert given_programme.lowest == pytest.approx(1.0 - TOOL.downlink.depth)


def test_eighteen_bits_take_less_than_three_minutes():
    data_s = 9 * Downlink().symbol_s
    assert data_s < 180.0


def test_commands_change_the_configuration_as_people_name_it():
    settings = ToolSettings()
    for name, value in (("pulse_width", 0.3), ("toolface_rate", 3), ("sequence", 1)):
        settings = settings.after(DownlinkFrame(1, *command(TOOL, name, value)))
    changed = applied(TOOL, settings)
    assert changed.pulse_width_s == 0.3
    assert [item.name for item in changed.surveys[0]] == ["Inc", "DLnk"]
    assert [item.name for item in applied(TOOL, settings._replace(sequence=0)).toolfaces[0]] == ["aTFA"] * 3 + ["Gama"]
    assert settings.after(DownlinkFrame(1, *command(TOOL, "mute", 0))).mute
    assert not settings._replace(mute=True).after(DownlinkFrame(1, *command(TOOL, "survey_now", 0))).mute


def test_a_tool_that_names_its_sequences_keeps_their_order():
    named = from_mapping({"header_bits": 2, "downlink": {}, "survey_sequences": ["Inc:12:P", "Azm:12:P"]})
    assert applied(named, ToolSettings(sequence=1)).surveys == named.surveys


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("pulse_width", 0.4, "can be 0.3, 0.5, 0.8 s"),
        ("sequence", 2, "numbers 0 to 1"),
        ("sequence", 0.5, "whole number"),
        ("toolface_rate", 0, "1 to 15"),
        ("carrier", 12.0, "no carrier"),
        ("restart", 0, "is unknown; choose one of"),
    ],
)
def test_a_command_the_tool_cannot_obey_is_refused_with_what_it_can(name, value, words):
    with pytest.raises(ValueError, match=words):
        command(TOOL, name, value)


def test_a_tool_without_a_downlink_takes_no_commands_and_its_file_says_so():
    with pytest.raises(ValueError, match="accepts no commands"):
        command(ToolConfiguration(), "survey_now", 0)
    assert "downlink: null" in text(ToolConfiguration())
    assert applied(TOOL, ToolSettings()).tu_s == TOOL.tu_s
    assert tool_commands.about(TOOL, DownlinkFrame(1, 1, 0)) == "pulse width 0.3 s"

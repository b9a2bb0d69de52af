# SPDX-License-Identifier: Apache-2.0
"""Another pulse width in the tool: found by words that are believed with it, and by nothing else."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.mud_line import Well
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.other_width import OtherWidth, other_widths, sent_width

pytestmark = pytest.mark.slow

HERE = ToolConfiguration(
    pulse_width_s=0.5,
    transmit_delay_s=20.0,
    survey_sequences=("Inc:12:P Azm:12:P",),
    toolface_sequences=("aTFA:6:P",),
)
FLOW_ON = 20.0


def pressure(width_s, seconds=200.0, seed=5):
    """Times and pressure of a tool with pulses of a width in a well of 2 km."""
    tool = dataclasses.replace(HERE, pulse_width_s=width_s)
    channel = MudChannel(well=Well(depth_m=2000.0), flow_off_s=((-100.0, FLOW_ON),))
    run = link_run(channel, transmit(tool, ((FLOW_ON, seconds),), seed), seconds, seed)
    return run.time_s, run.pressure_pa


def test_the_nearest_widths_are_tried_first_and_its_own_is_not():
    assert other_widths(HERE)[:2] == [0.6, 0.4]
    assert HERE.pulse_width_s not in other_widths(HERE)


@pytest.mark.parametrize("width", [0.25, 0.8, 1.2])
def test_the_width_that_the_tool_sends_is_found(width):
    assert sent_width(HERE, *pressure(width)) == width


def test_no_width_is_found_in_pumps_alone():
    run = link_run(MudChannel(well=Well(depth_m=2000.0)), transmit(HERE, (), 1), 200.0, 6)
    assert sent_width(HERE, run.time_s, run.pressure_pa) is None


def test_a_search_waits_for_its_time_and_tries_one_width_a_block():
    time_s, value = pressure(0.8)
    search, found = OtherWidth(HERE), []
    after = time_s >= FLOW_ON
    for block in np.array_split(np.flatnonzero(after), 180):
        search.push(time_s[block], value[block], FLOW_ON, 120.0)
        found.append((time_s[block[-1]], search.found_s))
    first = next(at for at, width in found if width is not None)
    assert first == pytest.approx(FLOW_ON + 120.0 + other_widths(HERE).index(0.8), abs=2.0)
    assert found[-1][1] == 0.8


def test_nothing_is_searched_where_the_flow_on_is_not_known():
    time_s, value = pressure(0.8)
    search = OtherWidth(HERE)
    search.push(time_s, value, -np.inf, 10.0)
    assert search.found_s is None

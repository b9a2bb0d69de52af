# SPDX-License-Identifier: Apache-2.0
"""A link that follows the tool to another pulse width once the tool says that it has obeyed."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator.mud_channel import MudChannel, WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link import Link
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_feed import FollowingLink

pytestmark = pytest.mark.slow

START_NS = 1_772_345_000_000_000_000
BEFORE = ToolConfiguration(
    pulse_width_s=0.8,
    transmit_delay_s=5.0,
    survey_sequences=("DLnk:10:P Inc:12:P Azm:12:P",),
    toolface_sequences=("aTFA:6:P",),
)
AFTER = dataclasses.replace(BEFORE, pulse_width_s=0.5)
TOLD_S = 160.0


@pytest.fixture(scope="module")
def heard():
    """Pressure of a tool that sends with 0.8 s up to some time, and with 0.5 s from then on."""
    first, second = transmit(BEFORE, ((20.0, TOLD_S),), 3), transmit(AFTER, ((TOLD_S, 330.0),), 4)
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0),))
    both = dataclasses.replace(first, pulses=np.concatenate([first.pulses, second.pulses]))
    return link_run(channel, both, 340.0, 3), first, second


def played(heard, expected, echo, told_s=TOLD_S - 40.0):
    run, _, _ = heard
    link = FollowingLink(Link(BEFORE, "mud_pulse", AgeRules(), lambda at: START_NS + round(at * 1e9)))
    words, surveys = [], []
    for begin in range(0, len(run.time_s), 100):
        if begin == round(told_s * 100.0):
            link.expect(expected, echo)
        part = slice(begin, begin + 100)
        out = link.push(run.time_s[part], run.pressure_pa[part])
        words += [word for word in out.words if word.revision]
        surveys += out.surveys
    return link, words, surveys


def test_the_answer_lets_it_read_on_by_the_new_configuration_with_nothing_lost(heard):
    _, first, second = heard
    link, words, surveys = played(heard, AFTER, second.words[0].raw)
    assert link.link.tool == AFTER
    assert link.expects is None
    sent = [(word.name, word.raw) for word in (*first.words[:3], *second.words[:3])]
    believed = [(word.name, word.raw) for word in words if word.kind == "survey"]
    assert believed == sent
    assert len(surveys) == 2


def test_without_the_answer_it_reads_on_as_before(heard):
    _, _, second = heard
    link, words, _ = played(heard, AFTER, second.words[0].raw ^ 1)
    assert link.link.tool == BEFORE
    assert link.expects is not None
    assert {word.frame for word in words if word.start_s < TOLD_S}
    link.go_on_as(AFTER)
    assert link.link.tool == AFTER
    assert link.expects is None

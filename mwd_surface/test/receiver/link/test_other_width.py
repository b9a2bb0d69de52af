# SPDX-License-Identifier: Apache-2.0
"""Another pulse width in the tool: found by words that are believed with it, and by nothing else."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from mwd_sensors.simulator.mud_channel import MudChannel, WellGeometry
from mwd_sensors.simulator.pulse_tool import SentTransmission, link_run, transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link import other_width
from mwd_surface.receiver.link.other_width import OtherWidth, other_widths, sent_tool, sent_width
from mwd_surface.receiver.pulse import sync_search
from mwd_surface.receiver.pulse.sync_search import USUAL_SYNCS
from mwd_surface.receiver.words import BELIEVED, ERASED

pytestmark = pytest.mark.slow(4)

HERE = ToolConfiguration(
    pulse_width_s=0.5,
    transmit_delay_s=20.0,
    survey_sequences=("Inc:12:P Azm:12:P",),
    toolface_sequences=("aTFA:6:P",),
)
FLOW_ON = 20.0
# The survey of a tool with pulses of 0.65 s ends at 75 s. A search of all widths takes a tenth of a second for each
# second of pressure.
SHORT_S = 90.0


def pressure(width_s, seconds=200.0, seed=5, on_s=FLOW_ON, before=(), depth_m=2000.0):
    """Times and pressure of a tool with pulses of a width; before: spans without flow, s."""
    tool = dataclasses.replace(HERE, pulse_width_s=width_s)
    channel = MudChannel(well=WellGeometry(depth_m=depth_m), flow_off_s=before or ((-100.0, on_s),))
    run = link_run(channel, transmit(tool, ((on_s, seconds),), seed), seconds, seed)
    return run.time_s, run.pressure_pa


def test_the_nearest_widths_are_tried_first_and_its_own_is_not():
    assert other_widths(HERE)[:2] == [0.6, 0.4]
    assert HERE.pulse_width_s not in other_widths(HERE)


@pytest.mark.nightly
@pytest.mark.parametrize("width", [0.25, 0.8])
def test_the_width_that_the_tool_sends_is_found(width):
    assert sent_width(HERE, *pressure(width), {}) == pytest.approx(width, rel=2e-3)


@pytest.mark.parametrize("syncs", [2, pytest.param(len(USUAL_SYNCS), marks=pytest.mark.nightly)])
def test_width_sync_and_parity_are_found_blindly(syncs):
    sent = dataclasses.replace(HERE, pulse_width_s=0.65, sync=USUAL_SYNCS[1], parity="odd")
    channel = MudChannel(well=WellGeometry(depth_m=2000.0), flow_off_s=((-100.0, FLOW_ON),))
    run = link_run(channel, transmit(sent, ((FLOW_ON, SHORT_S),), 5), SHORT_S, 5)
    found = sent_tool(HERE, run.time_s, run.pressure_pa, {}, USUAL_SYNCS[:syncs], ("even", "odd"))
    assert found.pulse_width_s == pytest.approx(0.65, rel=2e-3)
    assert (found.sync, found.parity) == (sent.sync, "odd")


def test_the_configuration_with_most_believed_words_is_found_not_the_first_one_with_any(monkeypatch):
    """A wrong parity and a width that is slightly wrong may have a few believed words, before the right ones."""
    time_s, value = np.arange(100.0), np.zeros(100)
    rough = dataclasses.replace(HERE, pulse_width_s=0.362)
    rows = [sync_search.Guess(rough, 50.0, 30.0), sync_search.Guess(HERE, 40.0, 30.0)]
    monkeypatch.setattr(sync_search, "guesses", lambda *_: rows)

    def received(tool, *_):
        counts = {("even", 0.36): 5, ("odd", 0.36): 90, ("odd", 0.362): 6}
        believed = counts.get((tool.parity, round(tool.pulse_width_s, 3)), 0)
        statuses = [BELIEVED] * believed + [ERASED] * (100 - believed)
        words = [SimpleNamespace(status=status) for status in statuses]
        return SimpleNamespace(words=words, frames=[SimpleNamespace(clock_error=0.0)])

    monkeypatch.setattr(other_width, "received_with", received)
    found = sent_tool(HERE, time_s, value, {}, USUAL_SYNCS[:1], ("even", "odd"))
    assert (found.parity, round(found.pulse_width_s, 3)) == ("odd", 0.36)


def test_a_flow_without_words_is_found_in_which_the_tool_has_another_width():
    """As after a change of the width by downlink: the words of the first flow are believed, none of the second."""
    spans = ((-100.0, 20.0), (100.0, 120.0))
    first, second = (dataclasses.replace(HERE, pulse_width_s=width) for width in (0.5, 0.8))
    sent = transmit(first, ((20.0, 100.0),), 5), transmit(second, ((120.0, 230.0),), 6)
    both = SentTransmission(sent[0].words + sent[1].words, np.concatenate([one.pulses for one in sent]))
    channel = MudChannel(well=WellGeometry(depth_m=2000.0), flow_off_s=spans)
    run = link_run(channel, both, 230.0, 5)
    got = other_width.received_with(HERE, run.time_s, run.pressure_pa, {})
    begin, end = other_width.unread_flow(HERE, run.time_s, run.pressure_pa, got.words)
    assert (begin, end) == (pytest.approx(120.0, abs=5.0), pytest.approx(230.0, abs=5.0))
    inside = other_width.during((begin, end), run.time_s)
    assert sent_width(HERE, run.time_s[inside], run.pressure_pa[inside], {}) == pytest.approx(0.8, rel=2e-3)
    early = run.time_s < 110.0
    assert other_width.unread_flow(HERE, run.time_s[early], run.pressure_pa[early], got.words) is None


def test_a_search_tells_its_progress_and_ends_without_a_sync():
    """The pressure has a sync with the noise of the whole recording, and none with the noise around this sync."""
    shares = []
    time_s = np.arange(0.0, 60.0, 0.05)
    value = 1.0e7 + 1e3 * np.random.default_rng(1).normal(size=len(time_s))
    assert sent_tool(HERE, time_s, value, {}, USUAL_SYNCS[:2], (), shares.append) is None
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_recording_is_tried_from_the_flow_on_of_its_longest_flow():
    """The width is none of the usual ones."""
    spans = ((-100.0, 20.0), (40.0, 80.0), (160.0, 200.0))
    assert sent_width(HERE, *pressure(0.547, 170.0, on_s=80.0, before=spans), {}) == pytest.approx(0.547, rel=2e-3)


def test_no_width_is_found_in_pumps_alone():
    run = link_run(MudChannel(well=WellGeometry(depth_m=2000.0)), transmit(HERE, (), 6), SHORT_S, 6)
    assert sent_width(HERE, run.time_s, run.pressure_pa, {}) is None


def test_no_width_is_found_where_the_signal_of_its_own_is_weak():
    assert sent_width(HERE, *pressure(0.5, SHORT_S, depth_m=6000.0), {}) is None


def searched(search, since_s, first_s, parts=1):
    """Widths found by the end of each second of a tool with pulses of 0.8 s: a list of (time, width)."""
    time_s, value = pressure(0.8)
    found = []
    for second in np.split(np.arange(len(time_s)), np.flatnonzero(np.diff(np.floor(time_s))) + 1):
        if time_s[second[0]] < FLOW_ON:
            continue
        for part in np.array_split(second, parts):
            search.push(time_s[part], value[part], since_s, first_s)
        found.append((time_s[second[-1]], search.found_s))
    return found


@pytest.mark.parametrize("parts", [1, 4])
def test_a_search_waits_for_its_time_and_tries_one_width_a_second(parts):
    found = searched(OtherWidth(HERE), FLOW_ON, 120.0, parts)
    first = next(at for at, width in found if width is not None)
    assert first == pytest.approx(FLOW_ON + 120.0 + other_widths(HERE).index(0.8), abs=2.0)
    assert found[-1][1] == 0.8


def test_what_was_found_is_dropped_when_the_flow_comes_on_anew():
    search = OtherWidth(HERE)
    assert searched(search, FLOW_ON, 120.0)[-1][1] == 0.8
    time_s = 300.0 + 0.01 * np.arange(100)
    search.push(time_s, np.full(100, 2.0e7), 299.0, 120.0)
    assert search.found_s is None


def test_nothing_is_searched_where_the_flow_on_is_not_known():
    """Words of 0.8 s are in the first samples; then there are seconds enough for all widths."""
    time_s, value = pressure(0.8)
    search, found = OtherWidth(HERE), []
    for samples in np.split(np.arange(len(time_s)), 100 * np.arange(180, 200)):
        search.push(time_s[samples], value[samples], -np.inf, 10.0)
        found.append(search.found_s)
    assert len(found) > len(other_widths(HERE))
    assert set(found) == {None}

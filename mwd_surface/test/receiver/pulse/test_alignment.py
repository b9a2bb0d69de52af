# SPDX-License-Identifier: Apache-2.0
"""Words behind a sync that noise has widened."""

import dataclasses
import itertools

import numpy as np
import pytest
from link_runs import TOOLS, white

from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.pulse_tool import Transmission, link_run, transmit
from mwd_surface.receiver.pulse import segment, transmission, trellis
from mwd_surface.receiver.pulse.alignment import Aligned, align, moved
from mwd_surface.receiver.pulse.passes import rows_from_sync
from mwd_surface.receiver.pulse.pulse_receiver import decode
from mwd_surface.receiver.pulse.tool_clock import ToolClock
from mwd_surface.receiver.words import packet_rows

TOOL = TOOLS["0.5"]


@pytest.mark.slow
def test_noise_in_the_sync_does_not_move_all_words_by_one_place():
    """A run whose sync teaches a response 1 TU wider than it is; words and clock learnt from it agree with it."""
    tool = dataclasses.replace(TOOL, pulse_width_s=0.3)
    channel = MudChannel(flow_off_s=((-100.0, 20.0),))
    run = link_run(channel, transmit(tool, ((20.0, 170.0),), 11, 5e-4), 170.0, 1011)
    survey = [word.raw for word in decode(tool, run.time_s, run.pressure_pa).words if word.kind == "survey"]
    assert survey == [word.raw for word in run.sent.words[: len(survey)]]
    assert len(survey) == len(tool.surveys[0])


def test_pulses_moved_by_one_place_and_back_are_where_they_were():
    rows, _ = rows_from_sync(TOOL, TOOL.surveys[0])
    first = len(rows) - sum(len(packet_rows((item,))[0]) for item in TOOL.surveys[0])
    one = np.zeros((len(rows), 8))
    one[:first, 0], one[first:, 2] = 1.0, 1.0
    later = moved(rows, one, 1)
    assert np.all(later[first:, 1] == 1.0)
    assert np.all(moved(rows, later, -1) == one)
    # What leaves its window may be anywhere in it.
    assert moved(rows, moved(rows, later, 1), 1) == pytest.approx(trellis.uniform(rows))


@pytest.mark.parametrize(
    ("evidence", "decoded"),
    [
        (itertools.repeat(np.nan), 3),
        (itertools.repeat(np.inf), 3),
        (itertools.chain([1.0] * 2, itertools.repeat(np.nan)), 3),
        (itertools.chain([1.0] * 2, itertools.repeat(np.inf)), 3),
        (itertools.count(0.0, 100.0), 1 + 2 * 8),
    ],
    ids=["nan", "inf", "from a number to nan", "from a number to inf", "ever better"],
)
def test_words_move_by_their_window_at_most_whatever_the_evidence(evidence, decoded):
    """8 values a packet: 8 moves, each of which weighs two places, decoded twice each."""
    rows, _ = rows_from_sync(TOOL, TOOL.surveys[0])
    given, calls = trellis.uniform(rows), 0
    channel = segment.Channel(np.ones(8), 1.0, np.ones(1), np.ones(1), np.ones((1, 8)), 1.0)

    def decoder(clock, probability, found):
        nonlocal calls
        calls += 1
        assert calls <= 2 * decoded, "words move without end"
        unused = np.zeros(0)
        timing = (0.0, 1.0, 0.0)
        return segment.Decision(unused, unused, unused, probability, found, 0.0, timing, next(evidence), 0.0, 0.0)

    start = Aligned(ToolClock(0.0), channel, given)
    found = align(decoder, rows, start)
    assert calls == 2 * decoded
    assert np.isfinite(found.evidence)


@pytest.mark.slow
def test_words_without_pulses_are_not_aligned(monkeypatch):
    """A tool that is silent for three words of its survey: each packet of the joint decision had a pulse."""
    given = []

    def aligned(decoder, rows, start):
        given.append(rows)
        return align(decoder, rows, start)

    monkeypatch.setattr(transmission, "align", aligned)
    sent = transmit(TOOL, ((0.0, 420.0),), 0)
    begin, end = sent.words[2].start_s, sent.words[5].start_s
    pulses = sent.pulses[(sent.pulses[:, 0] < begin) | (sent.pulses[:, 0] >= end)]
    decode(TOOL, *white(TOOL, Transmission((), pulses), 14.0))
    assert len(given) == 1
    at = np.rint((pulses[:, 0] - pulses[0, 0]) / TOOL.tu_s)
    first, count = given[0][:, trellis.START], given[0][:, trellis.COUNT]
    assert np.all([np.any((at >= a) & (at < a + n)) for a, n in zip(first, count, strict=True)])

# SPDX-License-Identifier: Apache-2.0
"""Words behind a sync that noise has widened."""

import dataclasses

import numpy as np
import pytest
from link_runs import TOOLS

from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_surface.receiver.pulse import trellis
from mwd_surface.receiver.pulse.alignment import moved
from mwd_surface.receiver.pulse.passes import rows_from_sync
from mwd_surface.receiver.pulse.pulse_receiver import decode
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

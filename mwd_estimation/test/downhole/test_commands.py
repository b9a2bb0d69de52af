# SPDX-License-Identifier: Apache-2.0
"""A command by rotation changes what the tool sends from the next sync on, and the tool says so."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.status import Status
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import PartKind, Transmitter, TransmitterState
from mwd_sensors.core import wire
from mwd_sensors.telemetry.downlink import Downlink, DownlinkFrame, programme
from mwd_sensors.telemetry.tool_commands import command
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

START = 1_700_000_000_000_000_000
TOOL = ToolConfiguration(
    pulse_width_s=0.8,
    transmit_delay_s=10.0,
    downlink=Downlink(ramp_s=2.0, hold_s=4.0),
    survey_sequences=("RINC:11:P DLnk:10:P", "DLnk:10:P"),
    toolface_sequences=("aTFA:6:P RAZM:11:P", "aTFA:6:P"),
)
BASE = 11.0
RATE = 20.0


def played(frames, tool=TOOL, block=37, off=None, every=150.0):
    """What a tool sends that is told commands, one after the other; off: a span without flow, s."""
    seconds = 60.0 + every * len(frames)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    stamps = START + np.round(time * 1e9).astype(np.int64)
    imu, rows, flow = (layout.empty(len(time)) for layout in (wire.IMU, wire.ATTITUDE, wire.TOOL_FLOW))
    imu["stamp_ns"] = rows["stamp_ns"] = flow["stamp_ns"] = stamps
    share = np.ones(len(time))
    for k, frame in enumerate(frames):
        ordered = programme(frame, tool.downlink)
        inside = time >= 60.0 + every * k
        share[inside] = [ordered.at(at - 60.0 - every * k) for at in time[inside]]
    imu["angular_velocity"][:, 0] = BASE * share * (1.0 + 0.9 * np.sin(math.tau * time / 2.0))
    flow["flow"] = 0.033
    if off is not None:
        flow["flow"][(time >= off[0]) & (time < off[1])] = 0.0
    for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
        rows[name], rows["sigma_" + name] = 0.7, 0.01
    rows["north"], rows["status"] = 1, int(Status.ROTATING)
    transmitter, sent = Transmitter(tool, Transmit()), []
    for begin in range(0, len(time), block):
        part = slice(begin, begin + block)
        transmitter.take_flow(flow[part])
        transmitter.take_rotation(imu[part])
        sent += transmitter.advance(rows[part], None)
    return transmitter, sent


def told(name, value=0.0, counter=1, tool=TOOL):
    return DownlinkFrame(counter, *command(tool, name, value))


def test_a_new_pulse_width_begins_with_a_sync_and_the_echo():
    frame = told("pulse_width", 0.5)
    transmitter, sent = played([frame])
    syncs = [k for k, one in enumerate(sent) if one.kind == PartKind.SYNC]
    assert len(syncs) == 2
    assert {one.tool.pulse_width_s for one in sent[: syncs[1]]} == {0.8}
    assert {one.tool.pulse_width_s for one in sent[syncs[1] :]} == {0.5}
    echoes = [one.raw for one in sent if one.name == "DLnk"]
    assert echoes == [0, frame.echo]
    before = sent[syncs[1] - 1]
    assert sent[syncs[1]].start_ns == before.start_ns + round(before.duration_s * 1e9)
    assert transmitter.state == TransmitterState.SENDING


@pytest.mark.slow
def test_what_is_sent_does_not_depend_on_the_blocks():
    frames = [told("toolface_rate", 3), told("survey_now", counter=2)]
    one, other = played(frames, block=1)[1], played(frames, block=501)[1]
    assert one == other
    syncs = [k for k, part in enumerate(one) if part.kind == PartKind.SYNC]
    assert len(syncs) == 3
    names = [part.name for part in one[syncs[1] :]]
    assert names[:7] == ["", "RINC", "DLnk", "aTFA", "aTFA", "aTFA", "RAZM"]


def test_a_sequence_is_chosen_by_its_number():
    names = [one.name for one in played([told("sequence", 1)], every=200.0)[1]]
    last = len(names) - names[::-1].index("")
    assert names[last : last + 3] == ["DLnk", "aTFA", "aTFA"]
    assert "RAZM" not in names[last:]


def test_a_mute_tool_answers_and_speaks_again_at_the_next_flow_on():
    frame = told("mute")
    transmitter, sent = played([frame])
    assert transmitter.state == TransmitterState.MUTED
    assert (sent[-1].name, sent[-1].raw) == ("DLnk", frame.echo)
    again, more = played([frame], off=(170.0, 180.0))
    assert again.state == TransmitterState.SENDING
    assert len(more) > len(sent)


def test_a_command_the_tool_cannot_obey_changes_nothing_and_is_not_answered():
    transmitter, sent = played([DownlinkFrame(1, 1, 14)])
    assert sum(one.kind == PartKind.SYNC for one in sent) == 1
    assert transmitter.tool.pulse_width_s == 0.8


@pytest.mark.parametrize("medium", ["flow"])
def test_a_tool_listens_to_one_medium_only(medium):
    other = dataclasses.replace(TOOL, downlink=dataclasses.replace(TOOL.downlink, medium=medium, least=0.01))
    _, sent = played([told("pulse_width", 0.5)], tool=other)
    assert {one.tool.pulse_width_s for one in sent} == {0.8}

# SPDX-License-Identifier: Apache-2.0
"""A scenario with telemetry: the tool's words become pressure, the same whatever the blocks, and are decoded again."""

import dataclasses

import numpy as np
import pytest

from mwd_estimation.downhole.transmitter import PartKind
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.receiver import pressure_files
from mwd_surface.receiver.link import receivers
from mwd_surface.runs import simulate
from mwd_surface.runs.simulate import SimulatedTool

pytestmark = pytest.mark.slow(2)

SCENARIO = """
name: short_link
seed: 3
date: 2026-03-01T06:00:00
well: {stations: [[0.0, 30.0, 40.0], [1300.0, 36.0, 47.0]], bit_m: 1200.0, sensor_to_bit_m: 15.0}
rig: {flow_lpm: 2000.0, pressure_bar: 150.0}
schedule:
  - {kind: still, seconds: 15.0, pumps: false}
  - {kind: still, seconds: 130.0}
precision: null
telemetry:
  tool:
    pulse_width_s: 0.5
    transmit_delay_s: 30.0
    survey_sequences: ["Inc:12:P Azm:12:P DipA:12:P Grav:12:P MagF:12:P"]
    toolface_sequences: ["aTFA:6:P"]
"""


def played(story, block_s):
    sonde, heard, done = Sonde(story), [], 0.0
    tool = SimulatedTool(sonde)
    for block in sonde.blocks(block_s):
        done = min(done + block_s, sonde.duration)
        heard += tool.take(block, done)[1]
    return tool, heard + tool.finish()


def test_pressure_and_words_do_not_depend_on_the_blocks():
    story = parse(SCENARIO.replace("130.0", "85.0"))
    (one, first), (two, second) = (played(story, block_s) for block_s in (1.0, 0.7))
    assert one.sent == two.sent
    assert np.array_equal(
        np.concatenate([heard.values for heard in first]), np.concatenate([heard.values for heard in second])
    )
    assert one.link.late == 0
    assert [sent.kind for sent in one.sent[:4]] == [PartKind.SYNC, PartKind.SURVEY, PartKind.SURVEY, PartKind.SURVEY]


EM = """
telemetry:
  tool:
    code: psk
    transmit_delay_s: 30.0
    carrier: {medium: earth, frequency_hz: 6.0, symbol_rate_hz: 4.0, block_bits: 40}
    survey_sequences: ["Inc:12 Azm:12 DipA:12 Grav:12 MagF:12"]
    toolface_sequences: ["aTFA:6"]
  earth: {ground: {bottom_m: [12000.0], resistivity: [20.0]}}
"""
SIREN = """
telemetry:
  tool:
    code: psk
    transmit_delay_s: 30.0
    carrier: {medium: mud, frequency_hz: 12.0, symbol_rate_hz: 5.0, block_bits: 40}
    survey_sequences: ["Inc:12 Azm:12 DipA:12 Grav:12 MagF:12"]
    toolface_sequences: ["aTFA:6"]
  mud: {valve_pa: 200000.0, rise_s: 0.005}
"""
SERIAL = """
telemetry:
  tool:
    code: serial
    survey_sequences: ["Inc:12 Azm:12 DipA:12 Grav:12 MagF:12"]
    toolface_sequences: ["aTFA:6"]
  serial: {bit_errors: 1.0e-4}
"""


COIL = """
telemetry:
  tool:
    code: psk
    transmit_delay_s: 30.0
    carrier: {medium: coil, frequency_hz: 12.0, symbol_rate_hz: 5.0, block_bits: 40}
    survey_sequences: ["Inc:12 Azm:12 DipA:12 Grav:12 MagF:12"]
    toolface_sequences: ["aTFA:6"]
  coil: {position_m: [473.0, 448.0, 1013.0], axis: [0.4, 0.4, 0.8]}
"""


@pytest.mark.parametrize("telemetry", ["", EM, SIREN, COIL, SERIAL], ids=["pulses", "em", "siren", "coil", "serial"])
def test_a_recording_of_it_decodes_to_what_was_sent(telemetry, tmp_path, monkeypatch):
    tools = []

    def kept(sonde):
        tools.append(SimulatedTool(sonde))
        return tools[0]

    # The tool of the recording knows what it sent: it need not be played again.
    monkeypatch.setattr(simulate, "SimulatedTool", kept)
    story = parse((SCENARIO.partition("telemetry:")[0] + telemetry) if telemetry else SCENARIO)
    simulate.record(story, tmp_path / "bag", "w1")
    link = story.telemetry.tool
    if link.link == "serial":
        read = pressure_files.read_bytes(tmp_path / "bag", link.serial.baud)
    else:
        read = pressure_files.read(tmp_path / "bag", link=link.link)
    receiver = receivers.receiver_of(link)
    counted = [pump for pump, times in read.strokes.items() if len(times) > 100]
    assert counted == ([1, 2] if link.medium == "mud" else [])
    if not telemetry:
        for pump, times in read.strokes.items():
            receiver.strokes(pump, times)
    words = receiver.push(read.time_s, read.pressure_pa).words + receiver.finish().words
    (tool,) = tools
    assert tool.link.late == 0
    sent = {sent.name: sent.raw for sent in tool.sent if sent.kind == PartKind.SURVEY}
    received = {word.name: word.raw for word in words if word.kind == "survey" and word.status == "believed"}
    assert received == sent
    assert len(received) == 5
    assert sum(word.name == "aTFA" for word in words) >= 2


def test_a_scenario_without_telemetry_has_no_tool():
    with pytest.raises(ValueError, match="telemetry"):
        SimulatedTool(Sonde(dataclasses.replace(parse(SCENARIO), telemetry=None)))

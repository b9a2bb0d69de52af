# SPDX-License-Identifier: Apache-2.0
"""What the tool sends, and when: by flow and rotation, the same however its samples are cut."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_estimation.core.time_bins import Average
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import PartKind, Transmitter, TransmitterState
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import station
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.telemetry import pulse_position
from mwd_sensors.telemetry.carrier import BlockName, Carrier, block_bits, symbols
from mwd_sensors.telemetry.serial_frames import SerialLine
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
REFERENCE = Reference(50e-6, math.radians(72.0), math.radians(3.0), math.radians(1.0), 9.81, "test")
TOOL = ToolConfiguration(
    pulse_width_s=0.5,
    transmit_delay_s=10.0,
    survey_sequences=("Inc:12:P Azm:12:P Grav:12:P",),
    toolface_sequences=("aTFA:6:P RINC:11:P",),
)
FULL, USUAL = 0.033, Transmit()


def attitude(seconds, rotating=False, rate=20.0):
    time = np.arange(0.0, seconds, 1.0 / rate)
    rows = wire.ATTITUDE.empty(len(time))
    rows["stamp_ns"] = START + np.round(time * SECOND).astype(np.int64)
    rows["inclination"], rows["azimuth"] = math.radians(40.0), math.radians(120.0)
    rows["gravity_toolface"] = np.radians(time % 360.0)
    rows["magnetic_toolface"] = np.radians(200.0)
    for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
        rows["sigma_" + name] = 0.01
    rows["north"] = 3
    rows["status"] = int(Status.ROTATING if rotating else Status.SLIDING)
    return rows


def flow(seconds, spans, rate=5.0):
    time = np.arange(0.0, seconds, 1.0 / rate)
    rows = wire.TOOL_FLOW.empty(len(time))
    rows["stamp_ns"] = START + np.round(time * SECOND).astype(np.int64)
    rows["flow"] = FULL * np.any([(time >= begin) & (time < end) for begin, end in spans], axis=0)
    return rows


def survey(azimuth=120.0):
    mat_tn = mat_nt(math.radians(35.0), math.radians(azimuth), 0.7).T
    field = REFERENCE.total * np.array([math.cos(REFERENCE.dip), 0.0, math.sin(REFERENCE.dip)])
    found = station(mat_tn @ np.array([0.0, 0.0, -9.81]), mat_tn @ field, REFERENCE)
    half, mean = 4 * SECOND, Average(np.zeros(6), np.zeros((6, 6)), 800)
    still = StillAverage(START - half, START + half, mean, None, None, 60.0, requested=False)
    return DecidedSurvey(still, 1, found)


def run(tool=TOOL, settings=USUAL, *, seconds=60.0, rows=None, on=((5.0, 1e9),), flows=None, surveys=(), block=200):
    """The transmitter after these seconds of samples, and what it sent; on: spans with flow, s."""
    rows = attitude(seconds) if rows is None else rows
    flows = flow(1.0 + len(rows) / 20.0, on) if flows is None else flows
    transmitter, sent = Transmitter(tool, settings), []
    for one in surveys:
        transmitter.take_survey(one)
    for first in range(0, len(rows), block):
        part = rows[first : first + block]
        before = flows[flows["stamp_ns"] <= part["stamp_ns"][-1]]
        flows = flows[len(before) :]
        transmitter.take_flow(before)
        sent += transmitter.advance(part, REFERENCE)
    return transmitter, sent


def turning_from(seconds, total, begins_rotating=False):
    """Attitude of a tool that begins or ends to rotate at a time, s."""
    rows = np.concatenate([attitude(seconds, begins_rotating), attitude(total - seconds, not begins_rotating)])
    rows["stamp_ns"] = START + np.arange(len(rows)) * (SECOND // 20)
    return rows


def seconds(one):
    return (one.start_ns - START) / SECOND


@pytest.mark.parametrize("flows", [flow(60.0, []), flow(0.0, [])], ids=["no flow", "unknown flow"])
def test_without_flow_the_tool_is_silent(flows):
    transmitter, sent = run(flows=flows)
    assert sent == []
    assert transmitter.state == TransmitterState.SILENT


def test_sync_comes_a_delay_after_flow_on_then_the_survey_once_then_toolfaces():
    _, sent = run(seconds=120.0, on=[(20.0, 120.0)], surveys=[survey()])
    assert seconds(sent[0]) == pytest.approx(30.0, abs=0.11)
    assert [one.kind for one in sent[:4]] == [PartKind.SYNC, *3 * [PartKind.SURVEY]]
    assert {one.kind for one in sent[4:]} == {PartKind.TOOLFACE}
    for one, following in itertools.pairwise(sent):
        assert following.start_ns - one.start_ns == pytest.approx(one.duration_s * SECOND, abs=2)


def test_words_have_the_survey_and_its_time():
    _, sent = run(surveys=[survey()])
    by_name = {one.name: one for one in sent}
    inc, azm, grav = (by_name[name] for name in ("Inc", "Azm", "Grav"))
    assert TOOL.table["Inc"].value(inc.raw, 12) == pytest.approx(35.0, abs=0.03)
    # From magnetic north, whatever north the estimator has in force.
    assert TOOL.table["Azm"].value(azm.raw, 12) == pytest.approx(120.0, abs=0.1)
    assert TOOL.table["Grav"].value(grav.raw, 12) == pytest.approx(9.81 / 9.80665, abs=3e-4)
    assert inc.reading.stamp_ns == START
    assert inc.reading.sigma > 0.0


def test_a_toolface_is_measured_when_it_goes_on_air():
    _, sent = run(seconds=120.0)
    toolfaces = [one for one in sent if one.name == "aTFA"]
    assert toolfaces
    for one in toolfaces:
        assert (one.reading.stamp_ns - one.start_ns) / SECOND == pytest.approx(0.0, abs=0.11)
        assert TOOL.table["aTFA"].value(one.raw, 6) == pytest.approx(seconds(one) % 360.0, abs=3.0)


def test_near_vertical_the_automatic_toolface_is_the_magnetic_one():
    rows = attitude(100.0)
    rows["status"] |= int(Status.NEAR_VERTICAL)
    _, sent = run(rows=rows)
    first = next(one for one in sent if one.name == "aTFA")
    # From magnetic north: convergence and declination are taken off the grid's.
    assert math.degrees(first.reading.value) == pytest.approx(200.0 + 1.0 - 3.0)


def test_flow_off_ends_the_transmission_and_flow_on_begins_another():
    _, sent = run(seconds=200.0, on=[(5.0, 60.0), (100.0, 200.0)], surveys=[survey()])
    syncs = [seconds(one) for one in sent if one.kind == PartKind.SYNC]
    assert syncs == pytest.approx([15.0, 110.0], abs=0.11)
    assert not [one for one in sent if 63.0 < seconds(one) < 109.0]


def test_a_short_dip_of_the_flow_does_not_interrupt():
    _, sent = run(TOOL, Transmit(flow_hold_s=2.0), seconds=100.0, on=[(5.0, 40.0), (41.0, 200.0)])
    assert sum(one.kind == PartKind.SYNC for one in sent) == 1


def test_what_is_sent_does_not_depend_on_how_the_samples_are_cut():
    whole, *cut = (run(seconds=90.0, surveys=[survey()], block=block)[1] for block in (1800, 1, 7, 333))
    assert all(one == whole for one in cut)


def test_rotation_switches_the_sequence_with_a_new_sync():
    tool = dataclasses.replace(TOOL, header_bits=2, toolface_sequences=("aTFA:6:P", "LRMS:11:P RINC:11:P"))
    settings = Transmit(rotation_switching_s=2.0)
    _, sent = run(tool, settings, rows=turning_from(60.0, 180.0), on=[(1.0, 180.0)], surveys=[survey()])
    headers = [one.raw for one in sent if one.kind == PartKind.HEADER]
    assert headers == [0, 1]
    after = [one for one in sent if seconds(one) > 63.0]
    kinds = [one.kind for one in after[after.index(next(o for o in after if o.kind == PartKind.HEADER)) + 1 :]]
    assert kinds[:3] == [PartKind.SURVEY] * 3
    assert {one.name for one in after if one.kind == PartKind.TOOLFACE} <= {"aTFA", "LRMS", "RINC"}


def test_without_a_survey_at_rest_the_least_noisy_continuous_one_is_sent():
    rows = attitude(200.0)
    moving = (rows["stamp_ns"] - START) / SECOND
    rows["inclination"] = math.radians(40.0) + np.where(moving < 30.0, 0.02 * np.sin(moving * 9.0), 0.0)
    _, sent = run(rows=rows, on=[(90.0, 200.0)])
    inc = next(one for one in sent if one.name == "Inc")
    assert math.degrees(inc.reading.value) == pytest.approx(40.0, abs=0.01)
    assert inc.reading.stamp_ns > START + 30 * SECOND


def test_attitude_without_flow_waits_a_minute_at_most():
    transmitter = Transmitter(TOOL, Transmit())
    rows = attitude(600.0)
    for first in range(0, len(rows), 200):
        assert not transmitter.advance(rows[first : first + 200], REFERENCE)
    assert 59.0 < transmitter.waits_s <= 60.0
    transmitter.take_flow(flow(600.0, [(0.0, 600.0)]))
    transmitter.advance(rows[:0], REFERENCE)
    assert transmitter.waits_s < 1.0


PSK = ToolConfiguration(
    code="psk",
    carrier=Carrier(medium="earth", frequency_hz=6.0, symbol_rate_hz=6.0),
    transmit_delay_s=10.0,
    survey_sequences=("Inc:12 Azm:12 Grav:12",),
    toolface_sequences=("aTFA:6 RINC:11",),
)


def test_on_a_carrier_blocks_of_the_survey_and_of_toolfaces_follow_each_other():
    _, sent = run(PSK, seconds=90.0, surveys=[survey()])
    blocks = [one for one in sent if one.phases]
    assert [one.name for one in sent[:3]] == ["Inc", "Azm", "Grav"]
    assert len({one.start_ns for one in sent[:3]}) == 1
    assert {one.kind for one in blocks[1:]} == {PartKind.TOOLFACE}
    for one, following in itertools.pairwise(blocks):
        assert following.start_ns - one.start_ns == pytest.approx(PSK.carrier.block_s * SECOND, abs=2)
    for one in blocks:
        words = [word for word in sent if word.start_ns == one.start_ns]
        items = (PSK.surveys if one.kind == PartKind.SURVEY else PSK.toolfaces)[0]
        name = BlockName(one.kind.name.lower(), 0, 0)
        lengths = [item.length for item in items]
        bits = block_bits(PSK.carrier, name, [word.raw for word in words], lengths, PSK.table_check)
        assert np.exp(1j * np.array(one.phases)) == pytest.approx(symbols(PSK.carrier, bits), abs=1e-12)


@pytest.mark.parametrize("form", ["binary", "ascii"])
def test_a_tool_on_a_wire_sends_without_flow_and_each_survey_once(form):
    tool = dataclasses.replace(
        PSK, code="serial", serial=SerialLine(format=form, period_s=2.0), toolface_sequences=("aTFA:6", "RINC:11")
    )
    _, sent = run(tool, flows=flow(0.0, []), surveys=[survey()])
    frames = [one for one in sent if one.octets]
    assert len(frames) == 30
    assert [one.kind for one in frames[:3]] == [PartKind.SURVEY, PartKind.TOOLFACE, PartKind.TOOLFACE]
    assert sum(one.kind == PartKind.SURVEY for one in frames) == 1
    toolface = frames[5]
    assert tool.table["aTFA"].value(toolface.raw, 6) == pytest.approx(seconds(toolface), abs=3.0)
    assert all(one.octets.endswith(b"\n" if form == "ascii" else b"\0") for one in frames)


def test_rotation_switches_the_sequence_of_a_carrier_without_a_header():
    tool = dataclasses.replace(PSK, toolface_sequences=("aTFA:6", "LRMS:11"))
    settings = Transmit(rotation_switching_s=2.0)
    _, sent = run(tool, settings, rows=turning_from(60.0, 120.0), on=[(1.0, 120.0)], surveys=[survey()])
    late = [one for one in sent if one.kind == PartKind.TOOLFACE and seconds(one) > 90.0]
    assert {(one.name, one.sequence) for one in late} == {("LRMS", 1)}


def test_what_the_tool_has_not_measured_has_the_reserved_code_where_there_is_one():
    for tool in (TOOL, dataclasses.replace(TOOL, missing_code=True)):
        _, sent = run(tool)
        grav = next(one for one in sent if one.name == "Grav")
        assert grav.reading is None
        edges = tuple(round(edge / tool.tu_s) for edge in grav.edges_s)
        expected = 0b1111_1111_1111_0 if tool.missing_code else 0
        assert edges == pulse_position.encode(expected, 13).edges


def test_a_switching_shorter_than_half_a_second_is_refused():
    with pytest.raises(ValueError, match="rotation_switching_s"):
        Transmit(rotation_switching_s=0.2)
    assert Transmit(rotation_switching_s=0.5).rotation_switching_s == 0.5


def test_a_tool_of_surveys_only_sends_one_after_each_flow_on_and_is_silent_between():
    tool = dataclasses.replace(TOOL, toolface_sequences=())
    _, sent = run(tool, seconds=200.0, on=[(20.0, 90.0), (110.0, 190.0)], surveys=[survey()], block=40)
    assert [one.kind for one in sent] == 2 * [PartKind.SYNC, *3 * [PartKind.SURVEY]]
    transmitter, _ = run(tool, seconds=80.0, on=[(20.0, 90.0)], surveys=[survey()])
    assert transmitter.state == TransmitterState.DONE


@pytest.mark.parametrize("begins_rotating", [False, True])
@pytest.mark.parametrize("turn_s", [33.0, 36.0, 40.0])
def test_a_change_of_rotation_during_the_survey_of_a_tool_of_surveys_only_does_not_lose_it(begins_rotating, turn_s):
    tool = dataclasses.replace(TOOL, header_bits=2, toolface_sequences=())
    rows, settings = turning_from(turn_s, 200.0, begins_rotating), Transmit(rotation_switching_s=2.0)
    transmitter, sent = run(tool, settings, rows=rows, on=[(20.0, 200.0)], surveys=[survey()])
    last = max(k for k, one in enumerate(sent) if one.kind == PartKind.SYNC)
    assert [one.kind for one in sent[last:]] == [PartKind.SYNC, PartKind.HEADER, *3 * [PartKind.SURVEY]]
    assert seconds(sent[last]) > turn_s
    assert transmitter.state == TransmitterState.DONE


def test_a_tool_of_surveys_only_on_a_wire_sends_each_survey_once():
    tool = dataclasses.replace(TOOL, code="serial", survey_sequences=("Inc:12 Azm:12",), toolface_sequences=())
    transmitter = Transmitter(tool, Transmit())
    rows = attitude(60.0)
    sent = transmitter.advance(rows[:400], REFERENCE)
    transmitter.take_survey(survey())
    sent += transmitter.advance(rows[400:800], REFERENCE)
    transmitter.take_survey(survey(121.0))
    sent += transmitter.advance(rows[800:], REFERENCE)
    assert [one.name for one in sent if one.octets] == ["Inc", "Inc"]

# SPDX-License-Identifier: Apache-2.0
"""The receiver end to end: simulated wells, white noise at the limit, any cut, and what must not be believed."""

import dataclasses
import re

import numpy as np
import pytest
from link_runs import TOOLS, pairs, reception, simulated, white
from scipy import stats

import telemetry_limits as limits
from mwd_sensors.simulator.mud_channel import MudChannel, PressureNoise, WellGeometry
from mwd_sensors.simulator.pulse_tool import SentTransmission, link_run, transmit
from mwd_sensors.telemetry.tool_configuration import Sync, encode
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver, decode
from mwd_surface.receiver.words import BELIEVED, pulse_edges

TOOL, FAST = TOOLS["0.8"], TOOLS["0.5"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "depth", "clock"), [("0.8", 3000.0, 0.0), ("0.8", 5000.0, 1e-3), ("0.5", 3000.0, -1e-3)]
)
def test_a_well_is_read_without_error(width, depth, clock):
    run, got, tool = simulated(width, depth, clock=clock), reception(width, depth, clock=clock), TOOLS[width]
    both = pairs(run, got.words, tool, depth)
    assert len(both) == len(run.sent.words)
    assert all(sent.raw == word.raw for sent, word in both if word.status == BELIEVED)
    assert np.mean([word.status == BELIEVED for _, word in both]) > 0.9
    assert got.frames[-1].clock_error == pytest.approx(clock, abs=3e-4)
    assert got.frames[0].kind == "survey"


@pytest.mark.slow
def test_any_cut_gives_the_same_words():
    run, whole = simulated("0.5", seconds=200.0), reception("0.5", seconds=200.0)
    receiver = PulseReceiver(FAST)
    words = []
    random = np.random.default_rng(4)
    cuts = np.sort(random.integers(0, len(run.time_s), 60))
    for time, pressure in zip(np.split(run.time_s, cuts), np.split(run.pressure_pa, cuts), strict=True):
        words += receiver.push(time, pressure).words
    words += receiver.finish().words
    assert words == whole.words


@pytest.mark.slow
def test_any_cut_gives_the_same_words_with_strokes():
    run = simulated("0.5", seconds=200.0)
    strokes = dict(enumerate(run.strokes_s, 1))
    whole = decode(FAST, run.time_s, run.pressure_pa, strokes)
    receiver = PulseReceiver(FAST)
    got = []
    for time, pressure in zip(np.array_split(run.time_s, 37), np.array_split(run.pressure_pa, 37), strict=True):
        for pump, times in strokes.items():
            receiver.strokes(pump, times[(times >= time[0]) & (times <= time[-1])])
        got += receiver.push(time, pressure).words
    assert got + receiver.finish().words == whole.words
    assert whole.words != reception("0.5", seconds=200.0).words


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "clock"), [(208, -5e-4), (9, 5e-4)])
def test_a_sync_behind_what_looked_like_one_is_found(seed, clock):
    """
    Three of the five pulses of a sync lie 15 TU apart: it looks like an earlier one of which two are weak.

    It is found with the noise learnt anew, or with that of the transmission which began with the earlier one.
    """
    channel = MudChannel(noise=PressureNoise(stalls_per_hour=60.0), flow_off_s=((-100.0, 20.0),))
    run = link_run(channel, transmit(FAST, ((20.0, 180.0),), seed, clock), 180.0, 1000 + seed)
    survey = [word.raw for word in decode(FAST, run.time_s, run.pressure_pa).words if word.kind == "survey"]
    assert survey == [word.raw for word in run.sent.words[: len(FAST.surveys[0])]]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [30012, 31053])
def test_of_two_places_for_a_sync_the_words_choose(seed):
    """6 dB: with a pulse of the first word, a sync is like itself 15 TU later in four pulses of five."""
    alike = dataclasses.replace(FAST, sync=Sync((0, 5, 15, 20, 30), 40))
    sent = transmit(alike, ((0.0, 140.0),), seed)
    words = decode(alike, *white(alike, sent, 6.0, seed=seed)).words
    assert words[0].start_s == pytest.approx(sent.words[0].start_s, abs=alike.tu_s)


@pytest.mark.slow
def test_a_sync_soon_after_the_pressure_begins_is_found():
    """6 dB: of 30 TU of pressure or less, the pulses of the sync are a large part, which is not noise."""
    found = 0
    for seed in range(10):
        sent = transmit(FAST, ((0.0, 140.0),), seed)
        time, pressure = white(FAST, sent, 6.0, seed=seed)
        late = time > sent.words[0].start_s - FAST.head_s - (3.0 + 3.0 * seed) * FAST.tu_s
        found += len(decode(FAST, time[late], pressure[late]).words) > 0
    assert found >= 9


def test_each_word_is_provisional_before_it_is_final():
    got = reception("0.5")
    provisional = {(word.frame, word.index): word for word in got.provisional}
    assert {(word.frame, word.index) for word in got.words} == set(provisional)
    assert all(word.revision == 1 and provisional[word.frame, word.index].revision == 0 for word in got.words)


def test_the_pulses_chosen_are_those_that_were_sent():
    tool, run, words = TOOLS["0.8"], simulated("0.8"), reception("0.8").words
    late = words[0].start_s - run.sent.words[0].start_s
    believed = [word for word in words if word.status == BELIEVED]
    chosen = np.concatenate([word.start_s - late + np.array(pulse_edges(word, tool)) for word in believed])
    off = np.abs(chosen[:, None] - run.sent.pulses[:, 0]).min(axis=1)
    assert len(chosen) > 30
    assert np.max(off) < 0.5 * tool.tu_s


@pytest.mark.slow
def test_word_errors_in_white_noise_are_near_the_limit():
    """7 dB: hard decisions err in 6 % of 13-bit words, parity used softly in 2 %."""
    errors = []
    for seed in range(12):
        sent = transmit(FAST, ((0.0, 260.0),), seed)
        got = decode(FAST, *white(FAST, sent, 7.0, seed=seed))
        run = dataclasses.replace(simulated("0.5"), sent=sent)
        both = [(s, w) for s, w in pairs(run, got.words, FAST, -250.0) if s.bits == 12]
        assert both
        errors += [s.raw != w.raw for s, w in both]
    expected = limits.soft_word_error(7.0 - 0.5, 13)
    assert np.mean(errors) < expected + 3.0 * np.sqrt(expected / len(errors))


@pytest.mark.slow
@pytest.mark.parametrize(("parity", "ebn0_db"), [("", 8.0), (":P", 7.0)])
def test_words_in_white_noise_err_as_the_closed_form_says(parity, ebn0_db):
    """
    Binomial bands: no better than the limit, and no worse than it is 1.5 dB below.

    Without parity each packet is decided by itself, which has a closed form; response and noise are estimated.
    """
    word = f"Inc:12{parity}"
    tool = dataclasses.replace(FAST, survey_sequences=(word,), toolface_sequences=(f"8{{{word}}}",))
    limit = limits.soft_word_error if parity else limits.word_error
    bits = 12 + len(parity) // 2
    wrong = sent_words = 0
    for seed in range(4):
        sent = transmit(tool, ((0.0, 500.0),), seed)
        words = decode(tool, *white(tool, sent, ebn0_db, seed=seed)).words
        for one in sent.words:
            near = [w.raw for w in words if abs(w.start_s - one.start_s) < 6.0 * tool.tu_s]
            sent_words += 1
            wrong += near != [one.raw]
    low, high = (stats.binom(sent_words, limit(ebn0_db - worse, bits)) for worse in (0.0, 1.5))
    assert low.ppf(0.001) <= wrong <= high.ppf(0.999)


def test_what_the_tool_has_not_measured_is_erased_and_nothing_else():
    """Each third word of the survey has no measurement; strong pulses, so that all others are believed."""
    tool = dataclasses.replace(FAST, missing_code=True, transmit_delay_s=30.0)
    codes = tuple(None if k % 3 == 1 else 40 + k for k in range(len(tool.surveys[0])))
    first = encode(tool, tool.surveys[0], codes, 0)
    after = encode(tool, tool.toolfaces[0], tuple(range(len(tool.toolfaces[0]))))
    edges = np.array([*first.edges, *(first.length + edge for edge in after.edges)])
    begin = 40.0 + edges * tool.tu_s
    sent = SentTransmission((), np.column_stack([begin, begin + tool.pulse_width_s]))
    words = [one for one in decode(tool, *white(tool, sent, 14.0)).words if one.kind == "survey"]
    assert [one.status == BELIEVED for one in words] == [code is not None for code in codes]
    assert [one.raw for one in words if one.status == BELIEVED] == [code for code in codes if code is not None]
    assert all(np.isnan(one.value) for one in words if one.status != BELIEVED)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, 2.0, 3.0])
def test_a_surge_of_pressure_costs_only_the_words_during_it(seconds):
    """A motor that stalls raises the pressure by much more than a pulse does."""
    sent = transmit(FAST, ((0.0, 500.0),), 5)
    time, pressure = white(FAST, sent, 14.0)
    during = (time > 300.0) & (time < 300.0 + seconds)
    pressure = pressure.copy()
    pressure[during] += 8.0 * np.ptp(pressure) * np.sin(np.pi * (time[during] - 300.0) / seconds)
    right = {(word.name, word.raw) for word in decode(FAST, time, pressure).words if word.status == BELIEVED}
    after = [word for word in sent.words if word.start_s > 303.0 + seconds]
    assert len(after) > 10
    assert [word for word in after if (word.name, word.raw) not in right] == []


@pytest.mark.parametrize("pulse", range(len(FAST.sync.edges_tu)))
def test_a_missing_pulse_of_the_sync_costs_no_word(pulse):
    """A valve that sticks at its first pulse after a rest must not cost all words until the next flow-on."""
    sent = transmit(FAST, ((0.0, 220.0),), 5)
    lacking = SentTransmission(sent.words, np.delete(sent.pulses, pulse, axis=0))
    words = decode(FAST, *white(FAST, lacking, 12.0)).words
    assert [word.raw for word in words if word.status == BELIEVED] == [word.raw for word in sent.words]


@pytest.mark.slow(4)
@pytest.mark.parametrize("hours", [1, pytest.param(10, marks=pytest.mark.nightly)])
def test_nothing_is_believed_in_hours_of_noise(hours):
    """Drilling with two pumps, connections, and no tool; a tool that begins with one word leaves most to chance."""
    tool = dataclasses.replace(FAST, survey_sequences=("Inc:12:P",), toolface_sequences=("aTFA:6:P",))
    silent = transmit(tool, ((0.0, 1.0),), 1)
    for hour in range(hours):
        channel = MudChannel(flow_off_s=((-100.0, 20.0), (1800.0, 2000.0)))
        run = link_run(channel, silent, 3600.0, seed=7 + hour)
        assert not [w for w in decode(tool, run.time_s, run.pressure_pa).words if w.status == BELIEVED]


@pytest.mark.parametrize(
    "wrong",
    [
        dataclasses.replace(
            TOOL, survey_sequences=("Temp:8:P Inc:11:P Azm:10:P DipA:12:P",), toolface_sequences=("Inc:9",)
        ),
        dataclasses.replace(TOOL, pulse_width_s=0.6),
        dataclasses.replace(TOOL, parity="odd"),
    ],
    ids=["table", "pulse width", "parity"],
)
def test_words_of_a_wrong_configuration_are_not_believed(wrong):
    run = simulated("0.8")
    words = decode(wrong, run.time_s, run.pressure_pa).words
    assert sum(word.status == BELIEVED for word in words) <= 0.02 * len(words)


@pytest.mark.parametrize("more", [2, -2])
def test_a_word_of_another_length_in_the_table_makes_no_word_after_it_believed(more):
    names = ["Inc:12:P", "Azm:12:P", "DipA:12:P", "Grav:12:P", "BatV:8:P", "Temp:8:P", "MagF:12:P", "Gama:8:P"]
    tool = dataclasses.replace(FAST, survey_sequences=(" ".join(names),), toolface_sequences=())
    names[3] = f"Grav:{12 + more}:P"
    table = dataclasses.replace(tool, survey_sequences=(" ".join(names),))
    for seed in range(3):
        sent = transmit(tool, ((0.0, 200.0),), seed)
        codes = [word.raw for word in sent.words]
        for word in decode(table, *white(tool, sent, 10.0, seed=seed)).words:
            assert word.status != BELIEVED or (word.index < 3 and word.raw == codes[word.index])


@pytest.mark.slow
def test_a_new_flow_on_is_a_new_survey():
    channel = MudChannel(well=WellGeometry(depth_m=3000.0), flow_off_s=((-100.0, 20.0), (250.0, 300.0)))
    sent = transmit(FAST, ((20.0, 250.0), (300.0, 520.0)), 3)
    run = link_run(channel, sent, 520.0, 3)
    got = decode(FAST, run.time_s, run.pressure_pa)
    both = pairs(run, got.words, FAST, 3000.0)
    assert [frame.kind for frame in got.frames].count("survey") == 2
    surveys = [(s, w) for s, w in both if w.kind == "survey"]
    assert len(surveys) == 14
    assert np.mean([s.raw == w.raw and w.status == BELIEVED for s, w in surveys]) > 0.9


@pytest.mark.slow
def test_syncs_between_sequences_and_headers_are_followed():
    tool = dataclasses.replace(FAST, header_bits=2, toolface_sequences=("4{aTFA:6:P Gama:8:P}",))
    sent = transmit(tool, ((20.0, 400.0),), 3, resync=True)
    run = link_run(MudChannel(flow_off_s=((-100.0, 20.0),)), sent, 400.0, 3)
    got = decode(tool, run.time_s, run.pressure_pa)
    both = pairs(run, got.words, tool, 3000.0)
    assert len(both) == len(sent.words)
    assert np.mean([s.raw == w.raw and w.status == BELIEVED for s, w in both]) > 0.9


@pytest.mark.slow
def test_a_stall_that_looks_like_a_sync_at_the_end_of_a_pass_is_none():
    tool = dataclasses.replace(FAST, toolface_sequences=("3{2{aTFA:6:P} Gama:8:P} Inc:12:P Azm:12:P",))
    channel = MudChannel(noise=PressureNoise(stalls_per_hour=60.0), flow_off_s=((-100.0, 20.0),))
    sent = transmit(tool, ((20.0, 470.0),), 14, -5e-4)
    run = link_run(channel, sent, 470.0, 1014)
    got = decode(tool, run.time_s, run.pressure_pa)
    both = pairs(run, got.words, tool, 3000.0)
    assert len(both) == len(sent.words)
    assert np.mean([s.raw == w.raw and w.status == BELIEVED for s, w in both]) > 0.9


def test_samples_too_far_apart_are_refused():
    time = np.arange(0.0, 300.0, 0.5)
    with pytest.raises(ValueError, match=r"2 samples a second; pulses of 0\.8 s need 6\.25"):
        decode(TOOL, time, np.sin(time))


def test_a_code_without_pulses_is_refused():
    with pytest.raises(ValueError, match="not psk"):
        PulseReceiver(dataclasses.replace(TOOL, code="psk"))


def test_no_word_has_a_reason():
    receiver = PulseReceiver(TOOL)
    time = np.arange(0.0, 200.0, 0.01)
    receiver.push(time, 2e7 + np.random.default_rng(1).normal(size=len(time)))
    receiver.finish()
    assert "no sync" in receiver.why_nothing()


def reason(tool, time, pressure):
    receiver = PulseReceiver(tool)
    receiver.push(time, pressure)
    receiver.finish()
    return receiver.why_nothing()


@pytest.mark.parametrize("seed", range(4))
def test_a_weak_signal_and_noise_are_not_blamed_on_the_configuration(seed):
    tool = dataclasses.replace(FAST, survey_sequences=("Inc:12:P Azm:12:P",), transmit_delay_s=20.0)
    sent = transmit(tool, ((0.0, 120.0),), seed)
    for ebn0_db in (3.0, 0.0, -20.0):
        said = reason(tool, *white(tool, sent, ebn0_db, seed=seed))
        assert "too weak" in said or "the pulses have ended" in said
        assert "sequences" not in said


@pytest.mark.parametrize("seed", range(3))
def test_a_recording_that_begins_during_a_transmission_is_not_blamed_on_the_signal_alone(seed):
    """The words are strong, but their sync was sent before the recording begins."""
    tool = dataclasses.replace(FAST, survey_sequences=("Inc:12:P Azm:12:P",), transmit_delay_s=20.0)
    time, pressure = white(tool, transmit(tool, ((0.0, 200.0),), seed), 14.0, seed=seed)
    late = time > 20.0 + tool.head_s
    assert "contains no start of the pumps" in reason(tool, time[late], pressure[late])


@pytest.mark.parametrize(
    "wrong", [{"parity": "odd"}, {"survey_sequences": ("Inc:10:P Azm:14:P Grav:10:P",)}, {"header_bits": 3}]
)
def test_a_wrong_table_in_a_strong_signal_is_not_blamed_on_the_signal(wrong):
    tool = dataclasses.replace(FAST, survey_sequences=("Inc:12:P Azm:12:P Grav:12:P",), transmit_delay_s=20.0)
    sent = transmit(tool, ((0.0, 200.0),), 1)
    said = reason(dataclasses.replace(tool, **wrong), *white(tool, sent, 14.0))
    assert "sequence" in said
    assert "too weak" not in said


SHORT_SURVEY = dataclasses.replace(FAST, survey_sequences=("Inc:12:P Azm:12:P Grav:12:P",), transmit_delay_s=20.0)


def two_tools(seed, late_tu, seconds=200.0, silent_s=np.inf):
    """First transmission, time and pressure of two tools; the second is `late_tu` later and silent from a time on."""
    tool = SHORT_SURVEY
    first, second = (transmit(tool, ((0.0, seconds),), number) for number in (2 * seed + 1, 2 * seed + 2))
    second = dataclasses.replace(second, pulses=second.pulses[second.pulses[:, 0] < silent_s])
    (time, both), (_, other) = (white(tool, one, 14.0, seed=k) for k, one in enumerate((first, second)))
    late = round(late_tu * tool.tu_s / (time[1] - time[0]))
    late_end = min(len(both), late + len(other))
    both[late:late_end] += (other - other.mean())[: late_end - late]
    return first, time, both


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("late_tu", [0, 17])
def test_two_tools_that_send_at_once_are_named_and_no_word_is_believed(late_tu, seed):
    _, time, pressure = two_tools(seed, late_tu)
    done = decode(SHORT_SURVEY, time, pressure)
    assert any("two tools" in one.reason for one in done.frames)
    assert all(word.status != BELIEVED for word in [*done.words, *done.provisional])


@pytest.mark.parametrize("seed", range(3))
def test_a_single_tool_is_believed_and_no_second_one_is_named(seed):
    sent = transmit(SHORT_SURVEY, ((0.0, 200.0),), 2 * seed + 1)
    done = decode(SHORT_SURVEY, *white(SHORT_SURVEY, sent, 14.0, seed=0))
    assert all("two tools" not in one.reason for one in done.frames)
    believed = {(word.name, word.raw) for word in done.words if word.status == BELIEVED}
    assert believed
    assert believed <= {(word.name, word.raw) for word in sent.words}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_tool_is_believed_again_when_a_second_one_falls_silent(seed):
    sent, time, pressure = two_tools(seed, 0, 640.0, silent_s=200.0)
    done = decode(SHORT_SURVEY, time, pressure)
    for words in (done.words, done.provisional):
        believed = [word for word in words if word.status == BELIEVED]
        right = {one for one in sent.words for word in believed if abs(word.start_s - one.start_s) < 2.0}
        late = [one for one in sent.words if one.start_s > 350.0]
        assert sum(one in right for one in late) >= 0.9 * len(late)
        assert all(
            word.raw == one.raw for word in believed for one in sent.words if abs(word.start_s - one.start_s) < 2.0
        )


def test_a_flow_too_short_for_the_sync_is_named():
    time = np.arange(0.0, 100.0, 0.02)
    flow = (time > 20.0) & (time < 40.0)
    said = reason(FAST, time, 2e7 * flow + 1e5 * np.random.default_rng(1).normal(size=len(time)))
    assert "the flow was on for" in said


@pytest.mark.parametrize(("off_s", "end_s"), [(20.0, 60.0), (20.0, 78.0), (1000.0, 100.0)])
def test_a_recording_shorter_than_delay_and_sync_says_that_the_flow_was_on_too_short(off_s, end_s):
    # The sync of this tool ends 61 s after flow-on.
    time = np.arange(0.0, end_s, 0.02)
    said = reason(TOOL, time, 2e7 * (time > off_s) + 1e4 * np.random.default_rng(1).normal(size=len(time)))
    seconds = float(re.search(r"the flow was on for (\S+) s", said)[1])
    assert 0.0 <= seconds <= end_s


def test_a_gauge_that_stands_is_named():
    receiver = PulseReceiver(TOOL)
    receiver.push(np.arange(0.0, 200.0, 0.01), np.full(20000, 2.0e7))
    receiver.finish()
    assert "the gauge is stuck at 200 bar" in receiver.why_nothing()


def test_another_parity_than_the_tool_has_is_named():
    run = simulated("0.8")
    receiver = PulseReceiver(dataclasses.replace(TOOL, parity="odd"))
    words = receiver.push(run.time_s, run.pressure_pa).words + receiver.finish().words
    assert not [word for word in words if word.status == BELIEVED]
    assert "parity" in receiver.why_nothing()


@pytest.mark.slow
def test_words_are_shown_soon_after_their_end():
    """Within ten seconds at a pulse width of 0.5 s: the response behind a word, and a short one waits for the next."""
    run = simulated("0.5")
    receiver = PulseReceiver(FAST)
    late = []
    for second in range(int(run.time_s[-1])):
        some = slice(*np.searchsorted(run.time_s, [second, second + 1]))
        got = receiver.push(run.time_s[some], run.pressure_pa[some])
        late += [second + 1 - word.end_s for word in got.provisional]
    assert len(late) > 20
    assert np.median(late) < 10.0


@pytest.mark.parametrize("clock", [1e-3, -1e-3, 3e-3, -3e-3, 5e-3, -5e-3])
def test_the_clock_of_the_tool_is_followed(clock):
    """A tool in order is within 0.1 %; a warm one without compensation may be far outside."""
    sent = transmit(FAST, ((0.0, 260.0),), 7, clock)
    got = decode(FAST, *white(FAST, sent, 12.0, seed=3))
    assert [(w.raw, w.status) for w in got.words] == [(w.raw, BELIEVED) for w in sent.words]
    assert got.frames[-1].clock_error == pytest.approx(clock, abs=6e-4)


@pytest.mark.slow
@pytest.mark.parametrize("clock", [1e-2, -1e-2])
def test_a_clock_too_far_off_to_be_followed_gives_no_wrong_word(clock):
    for seed in range(3):
        sent = transmit(FAST, ((0.0, 260.0),), seed, clock)
        words = decode(FAST, *white(FAST, sent, 12.0, seed=seed)).words
        right = {(word.name, word.raw) for word in sent.words}
        assert not [word for word in words if word.status == BELIEVED and (word.name, word.raw) not in right]


@pytest.mark.slow
def test_a_receiver_that_starts_amid_a_transmission_reads_from_the_next_sync():
    channel = MudChannel(well=WellGeometry(depth_m=3000.0), flow_off_s=((-100.0, 20.0), (250.0, 300.0)))
    sent = transmit(FAST, ((20.0, 250.0), (300.0, 520.0)), 3)
    run = link_run(channel, sent, 520.0, 3)
    for start in (90.0, 131.7, 200.0):
        amid = run.time_s >= start
        words = decode(FAST, run.time_s[amid], run.pressure_pa[amid]).words
        second = tuple(word for word in sent.words if word.start_s > 300.0)
        both = pairs(dataclasses.replace(run, sent=dataclasses.replace(sent, words=second)), words, FAST, 3000.0)
        assert len(both) == len(second)
        assert all(s.raw == w.raw and w.status == BELIEVED for s, w in both)
        assert not [w for w in words if w.status == BELIEVED and w.start_s < 300.0]


def test_short_pulses_soon_after_flow_on_are_found():
    """Seven seconds of pumps behind their start teach too little of the noise: the pulses must not hide in it."""
    tool = dataclasses.replace(TOOL, pulse_width_s=0.3, transmit_delay_s=10.0)
    sent = transmit(tool, ((20.0, 130.0),), 3)
    run = link_run(MudChannel(well=WellGeometry(depth_m=2000.0), flow_off_s=((-100.0, 20.0),)), sent, 135.0, 3)
    both = pairs(run, decode(tool, run.time_s, run.pressure_pa).words, tool, 2000.0)
    assert len(both) == len(sent.words)
    assert all(s.raw == w.raw for s, w in both if w.status == BELIEVED)
    assert np.mean([w.status == BELIEVED for _, w in both]) > 0.5


@pytest.mark.slow
def test_electrical_spikes_cost_no_word():
    run = simulated("0.5")
    random = np.random.default_rng(5)
    spiked = run.pressure_pa.copy()
    spiked[random.choice(len(spiked), len(spiked) // 300, replace=False)] += 2e6
    words = decode(FAST, run.time_s, spiked).words
    assert [(w.raw, w.status) for w in words] == [(w.raw, w.status) for w in reception("0.5").words]


@pytest.mark.parametrize("header", [0, 2])
def test_a_tool_of_surveys_only_is_read_at_each_flow_on_and_nothing_between(header):
    tool = dataclasses.replace(FAST, toolface_sequences=(), transmit_delay_s=10.0, header_bits=header)
    sent = transmit(tool, ((0.0, 130.0), (140.0, 270.0)), 1)
    got = decode(tool, *white(tool, sent, 12.0))
    assert [frame.kind for frame in got.frames] == ["survey", "survey"]
    assert [frame.reason for frame in got.frames] == ["", ""]
    assert [word.raw for word in got.words if word.status == BELIEVED] == [word.raw for word in sent.words]

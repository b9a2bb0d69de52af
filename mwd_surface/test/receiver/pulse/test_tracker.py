# SPDX-License-Identifier: Apache-2.0
"""Hypotheses are followed until another one is better: interruptions, missing pulses, wrong tables, two places."""

import dataclasses

import numpy as np
import pytest
from link_runs import TOOLS, white

from mwd_sensors.simulator.pulse_tool import transmit
from mwd_sensors.telemetry.tool_configuration import Sync
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver, decode
from mwd_surface.receiver.words import BELIEVED

FAST = TOOLS["0.5"]
# A copy of this sync 15 TU later shares three of its five pulses.
ALIKE = dataclasses.replace(FAST, sync=Sync((0, 5, 15, 20, 30), 40))
FROM_S = 200.0


def sent_and_heard(tool=FAST, seed=3, seconds=640.0, ebn0_db=12.0, silent=lambda begin: begin < 0.0):
    """Transmission, time and pressure in white noise; pulses that begin where `silent` are missing."""
    sent = transmit(tool, ((0.0, seconds),), seed)
    there = ~silent(sent.pulses[:, 0])
    return (sent, *white(tool, dataclasses.replace(sent, pulses=sent.pulses[there]), ebn0_db, seed=seed))


def outcome(sent, words, tool, after_s=0.0):
    """Return numbers: words sent after a time; those believed and right; believed words that are wrong."""
    found = {
        one: [w for w in words if w.name == one.name and abs(w.start_s - one.start_s) < 4.0 * tool.tu_s]
        for one in sent.words
    }
    right = {id(w) for one, near in found.items() for w in near if w.raw == one.raw}
    late = [near for one, near in found.items() if one.start_s > after_s]
    believed = sum(any(w.status == BELIEVED and id(w) in right for w in near) for near in late)
    return len(late), believed, sum(w.status == BELIEVED and id(w) not in right for w in words)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [30.0, pytest.param(120.0, marks=pytest.mark.nightly), 300.0])
@pytest.mark.parametrize("kind", ["quiet", "cut out", "frozen"])
def test_an_interruption_is_bridged(kind, seconds):
    end = FROM_S + seconds
    away = (lambda at: (at > FROM_S) & (at < end)) if kind == "quiet" else (lambda at: at < 0.0)
    sent, time, pressure = sent_and_heard(seconds=end + 400.0, silent=away)
    inside = (time > FROM_S) & (time < end)
    if kind == "cut out":
        time, pressure = time[~inside], pressure[~inside]
    elif kind == "frozen":
        pressure = np.where(inside, pressure[np.argmax(inside)], pressure)
    words, believed, wrong = outcome(sent, decode(FAST, time, pressure).words, FAST, end + 5.0)
    assert words > 10
    assert believed >= 0.9 * words
    assert wrong == 0


@pytest.mark.slow
def test_any_cut_gives_the_same_words_over_an_interruption():
    sent, time, pressure = sent_and_heard(ALIKE, seconds=400.0, silent=lambda at: (at > FROM_S) & (at < FROM_S + 60.0))
    whole = decode(ALIKE, time, pressure).words
    assert len(whole) > 0.8 * len(sent.words)
    random = np.random.default_rng(2)
    for cuts in (np.arange(1, len(time), 977), np.sort(random.integers(0, len(time), 25))):
        receiver = PulseReceiver(ALIKE)
        words = []
        for some in zip(np.split(time, cuts), np.split(pressure, cuts), strict=True):
            words += receiver.push(*some).words
        assert words + receiver.finish().words == whole


@pytest.mark.slow
@pytest.mark.parametrize("share", [pytest.param(0.02, marks=pytest.mark.nightly), 0.05])
def test_missing_pulses_make_words_unsure_and_not_wrong(share):
    believed = wrong = total = 0
    for seed in range(4):
        random = np.random.default_rng(seed)
        sent, time, pressure = sent_and_heard(
            seed=seed,
            seconds=400.0,
            ebn0_db=11.0,
            silent=lambda at, r=random: (r.uniform(size=len(at)) < share) & (at > 20.0),
        )
        words, good, bad = outcome(sent, decode(FAST, time, pressure).words, FAST)
        total, believed, wrong = total + words, believed + good, wrong + bad
    assert believed > 0.5 * total
    assert wrong <= 0.01 * believed


def test_a_pulser_that_dies_in_a_word_leaves_no_wrong_word():
    sent, *_ = sent_and_heard(seconds=300.0)
    for word in sent.words[3:7]:
        dead = word.end_s - 9.0 * FAST.tu_s
        _, time, pressure = sent_and_heard(seconds=300.0, silent=lambda at, d=dead: (at > d) & (at < 290.0))
        assert outcome(sent, decode(FAST, time, pressure).words, FAST)[2] == 0


def without_parity(texts):
    return tuple(text.replace(":P", "") for text in texts)


@pytest.mark.slow
@pytest.mark.parametrize(
    "table",
    [
        dataclasses.replace(
            FAST,
            survey_sequences=without_parity(FAST.survey_sequences),
            toolface_sequences=without_parity(FAST.toolface_sequences),
        ),
        dataclasses.replace(FAST, survey_sequences=(FAST.survey_sequences[0].replace("Azm:12", "Azm:14"),)),
    ],
    ids=["no parity", "two bits too long"],
)
def test_words_of_a_table_that_the_pulses_do_not_fit_are_not_believed(table):
    wrong = words = 0
    for seed in range(3):
        sent, time, pressure = sent_and_heard(seed=seed, seconds=400.0, ebn0_db=11.0)
        got = decode(table, time, pressure).words
        wrong, words = wrong + outcome(sent, got, FAST)[2], words + len(got)
    assert wrong <= 0.01 * words


@pytest.mark.parametrize("seed", range(3))
def test_of_a_sync_and_its_copy_the_words_choose(seed):
    sent, time, pressure = sent_and_heard(ALIKE, seed, 200.0, 8.0)
    got = decode(ALIKE, time, pressure).words
    assert got[0].start_s == pytest.approx(sent.words[0].start_s, abs=FAST.tu_s)

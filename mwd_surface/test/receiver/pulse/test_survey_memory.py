# SPDX-License-Identifier: Apache-2.0
"""Surveys sent again are combined, new ones are not; erased words are chosen by the surveys before, and marked."""

import dataclasses

import numpy as np
import pytest
from example_words import received
from link_runs import TOOLS, pairs, white

from mwd_sensors.core.constants import STANDARD_GRAVITY as G
from mwd_sensors.simulator.pulse_tool import SentTransmission, transmit
from mwd_surface.receiver.pulse.pulse_receiver import decode
from mwd_surface.receiver.pulse.survey_memory import SurveyMemory
from mwd_surface.receiver.words import BELIEVED, BY_CONSISTENCY, ERASED

TOOL = TOOLS["0.5"]
ITEMS = TOOL.surveys[0]


def at_once(_from_s, _until_s):
    """No rest for another survey."""
    return False


CODES = (1000, 2000, 3500, 120, 2047, 2010, 77)


def survey(codes=CODES, confidence=0.999, wrong=(), frame=0):
    """Words of a survey; of those in `wrong` the code next to it is taken for the right one."""
    words = []
    for k, (item, code) in enumerate(zip(ITEMS, codes, strict=True)):
        raw, other = (code ^ 1, code) if k in wrong else (code, code ^ 1)
        sure = 0.6 if k in wrong else confidence
        doubt = {"status": BELIEVED if sure >= 0.99 else ERASED, "alternatives": ((other, 0.99 * (1.0 - sure)),)}
        place = {"start_s": float(k), "end_s": k + 1.0, "frame": frame, "index": k}
        words.append(received(item.name, raw=raw, table=TOOL.table, bits=item.bits, confidence=sure, **doubt, **place))
    return words


def test_a_survey_sent_again_has_the_posterior_of_both():
    memory = SurveyMemory(TOOL, at_once)
    memory.settle(survey(confidence=0.9))
    second = memory.settle(survey(confidence=0.9, wrong=(1,), frame=1))
    assert [word.raw for word in second] == list(CODES)
    odds = 0.9 / (0.99 * 0.1)
    assert second[0].confidence / second[0].alternatives[0][1] == pytest.approx(odds**2, rel=0.01)
    assert second[0].confidence < 0.99
    assert memory.settle(survey(confidence=0.9, frame=2))[0].status == BELIEVED


@pytest.mark.parametrize("alternatives", [(), ((CODES[2] + 700, 0.05),)])
def test_a_word_that_was_not_heard_or_wrong_hides_no_repeat(alternatives):
    memory = SurveyMemory(TOOL, at_once)
    words = survey(confidence=0.9)
    sure = 0.94 if alternatives else 1.0 / 4096
    words[2] = dataclasses.replace(words[2], raw=3, confidence=sure, status=ERASED, alternatives=alternatives)
    memory.settle(words)
    second = memory.settle(survey(confidence=0.95, frame=1))
    assert [word.raw for word in second] == list(CODES)
    assert second[1].status == BELIEVED


@pytest.mark.parametrize(("rested", "taken"), [(False, CODES[1]), (True, CODES[1] ^ 1)])
def test_behind_a_rest_a_survey_that_differs_by_one_word_is_another_one(rested, taken):
    """In a straight hole: the azimuth, heard well enough, is not that of the survey before."""
    memory = SurveyMemory(TOOL, lambda _, until_s: rested and until_s > 0.0)
    memory.settle(survey())
    words = [dataclasses.replace(word, start_s=word.start_s + 600.0) for word in survey(frame=1)]
    near = {"raw": words[1].raw ^ 1, "confidence": 0.9, "status": ERASED, "alternatives": ((words[1].raw, 0.09),)}
    words[1] = dataclasses.replace(words[1], **near)
    assert memory.settle(words)[1].raw == taken


@pytest.mark.parametrize(("places", "repeated"), [((0, 1), True), ((3, 6), False)])
def test_two_equal_long_words_show_a_repeat_and_two_short_ones_do_not(places, repeated):
    """Temperature and battery often keep their codes from survey to survey; inclination and azimuth do not."""
    texts = " ".join(f"{ITEMS[k].name}:{ITEMS[k].bits}:P" for k in places)
    memory = SurveyMemory(dataclasses.replace(TOOL, survey_sequences=(texts,)), at_once)
    words = [dataclasses.replace(survey(confidence=0.98)[k], index=index) for index, k in enumerate(places)]
    memory.settle(words)
    assert all((word.confidence > 0.99) == repeated for word in memory.settle(words))


def test_another_survey_is_not_taken_for_the_same():
    memory = SurveyMemory(TOOL, at_once)
    memory.settle(survey())
    codes = tuple(code + 3 for code in CODES)
    words = survey(codes, 0.9, frame=1)
    again = memory.settle(words)
    assert [word.confidence for word in again if word.status == ERASED] == [
        word.confidence for word, one in zip(words, again, strict=True) if one.status == ERASED
    ]
    assert [word.raw for word in again] == list(codes)


def test_a_word_sent_twice_in_a_survey_is_combined():
    tool = dataclasses.replace(TOOL, survey_sequences=("Inc:12:P Azm:12:P Inc:12:P Azm:12:P",))
    words = survey(confidence=0.95)[:2]
    both = [dataclasses.replace(word, index=k) for k, word in enumerate(words + words)]
    settled = SurveyMemory(tool, at_once).settle(both)
    assert {word.name: word.raw for word in settled} == {"Inc": 1000, "Azm": 2000}
    assert all(word.confidence > 0.995 and word.status == BELIEVED for word in settled)


def test_an_erased_word_is_chosen_by_the_surveys_before_and_marked():
    """Inclination 45 deg off is far from the station before; one step off is not, and stays erased."""
    memory = SurveyMemory(TOOL, at_once)
    memory.settle(survey())
    words = survey(tuple(code + 7 for code in CODES), 0.999, frame=1)
    far = CODES[0] + 1024
    words[0] = dataclasses.replace(
        words[0], raw=far, confidence=0.6, status=ERASED, alternatives=((CODES[0] + 7, 0.398),)
    )
    words[1] = dataclasses.replace(words[1], confidence=0.6, status=ERASED, alternatives=((words[1].raw + 1, 0.398),))
    inclination, azimuth = memory.settle(words)[:2]
    assert (inclination.raw, inclination.status) == (CODES[0] + 7, BY_CONSISTENCY)
    assert inclination.value == pytest.approx(TOOL.table["Inc"].value(CODES[0] + 7, 12))
    assert azimuth.status == ERASED


@pytest.mark.parametrize(("heard", "status"), [(0.79, BY_CONSISTENCY), (0.85, ERASED)])
def test_one_word_in_twenty_may_be_unrelated_to_the_survey_before(heard, status):
    """An inclination 45 deg off is overruled if it is four times as probable as the expected one, but not six times."""
    memory = SurveyMemory(TOOL, at_once)
    memory.settle(survey())
    words = survey(tuple(code + 7 for code in CODES), 0.999, frame=1)
    near = ((CODES[0] + 7, 0.9999 - heard),)
    words[0] = dataclasses.replace(words[0], raw=CODES[0] + 1024, confidence=heard, status=ERASED, alternatives=near)
    assert memory.settle(words)[0].status == status


def test_gravity_is_known_before_any_survey():
    words = survey()
    right = TOOL.table["Grav"].code(0.9995, 12)
    words[4] = dataclasses.replace(words[4], raw=1023, confidence=0.7, status=ERASED, alternatives=((right, 0.29),))
    gravity = SurveyMemory(TOOL, at_once).settle(words)[4]
    assert (gravity.raw, gravity.status) == (right, BY_CONSISTENCY)


@pytest.mark.parametrize(("name", "unit", "factor"), [("MagF", "nT", 1e3), ("MagF", "T", 1e-6), ("Grav", "m/s^2", G)])
def test_the_unit_of_a_word_changes_no_choice(name, unit, factor):
    table = TOOL.table[name]
    other = dataclasses.replace(table, low=table.low * factor, high=table.high * factor, unit=unit)
    tool = dataclasses.replace(TOOL, words={name: other})
    k = [item.name for item in ITEMS].index(name)
    chosen = []
    for one in (TOOL, tool):
        memory = SurveyMemory(one, at_once)
        for frame, confidence in enumerate((0.999, 0.9)):
            words = survey(frame=frame)
            row = one.table[name]
            doubt = (BELIEVED, ()) if confidence > 0.99 else (ERASED, ((CODES[k] + 1000, 0.09),))
            value = {"unit": row.unit, "value": row.value(CODES[k], ITEMS[k].bits), "confidence": confidence}
            words[k] = dataclasses.replace(words[k], **value, status=doubt[0], alternatives=doubt[1])
            words[0] = dataclasses.replace(words[0], raw=CODES[0] + 5 * frame)
            words[1] = dataclasses.replace(words[1], raw=CODES[1] + 5 * frame)
            found = memory.settle(words)[k]
        chosen.append((found.raw, found.status, found.confidence))
    assert chosen[0][:2] == (CODES[k], BY_CONSISTENCY)
    assert chosen[1][:2] == chosen[0][:2]
    assert chosen[1][2] == pytest.approx(chosen[0][2], rel=1e-9)


def test_toolface_words_are_left_alone():
    words = [dataclasses.replace(word, kind="toolface") for word in survey(confidence=0.5)]
    assert SurveyMemory(TOOL, at_once).settle(words) == words


@pytest.mark.slow
def test_a_repeat_brings_the_survey_at_7_db():
    """White noise, 7 dB a bit: inclination and azimuth are believed far more often when a survey is sent again."""
    once, twice, wrong = [], [], 0
    for seed in range(16):
        # Long enough for the survey alone.
        first = transmit(TOOL, ((0.0, 145.0),), seed)
        again = tuple(w._replace(start_s=w.start_s + 145.0, end_s=w.end_s + 145.0, frame=1) for w in first.words)
        sent = SentTransmission(first.words + again, np.concatenate([first.pulses, first.pulses + 145.0]))
        words = decode(TOOL, *white(TOOL, sent, 7.0, seed=seed)).words
        for late, found in ((0.0, once), (145.0, twice)):
            these = [w for w in words if abs(w.start_s - first.words[0].start_s - late) < 30.0 and w.index < 2]
            found.append(len(these) == 2 and all(w.status == BELIEVED for w in these))
        run = dataclasses.make_dataclass("Run", ["sent"])(sent)
        wrong += sum(s.raw != w.raw for s, w in pairs(run, words, TOOL, -250.0) if w.status == BELIEVED)
    # A receiver that knows channel, noise and temperature believes 68 % once: a survey alone teaches them less well.
    assert np.mean(twice) >= 0.65
    assert np.mean(twice) > np.mean(once) + 0.3
    assert wrong <= 1

# SPDX-License-Identifier: Apache-2.0
"""One list of surveys from several links: none twice, the better word of each quantity, the source named."""

import dataclasses
import math

import pytest

from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.link.link_survey import HeardSurvey, LinkSurveys, SurveyTime
from mwd_surface.receiver.words import LinkValue

SECOND = 10**9
START = 1_772_345_000 * SECOND
WORDS = "Inc:12:P Azm:12:P DipA:12:P Grav:12:P MagF:12:P"
MUD = ToolConfiguration(transmit_delay_s=30.0, survey_sequences=(WORDS,))
EM = dataclasses.replace(starting("psk"), carrier=dataclasses.replace(starting("psk").carrier, medium="earth"))
TRUE = {
    meanings.INCLINATION: math.radians(40.0),
    meanings.AZIMUTH: math.radians(359.99),
    meanings.G_TOTAL: 9.81,
    meanings.B_TOTAL: 5.0e-5,
    meanings.DIP: math.radians(70.0),
}


NO_AZIMUTH = {"without": (meanings.AZIMUTH,)}


def heard(link, at_s, half_s=20.0, without=(), bits=12, confidence=0.999, **changed):
    """Words of the true values plus what is changed, with the resolution of the words' bits (a turn, 2 g, 100 uT)."""
    ranges = {meanings.G_TOTAL: 20.0, meanings.B_TOTAL: 1e-4}
    values = {}
    for name, value in TRUE.items():
        if name not in without:
            step = ranges.get(name, math.tau) / 2**bits
            rounded = round((value + changed.get(name, 0.0)) / step) * step
            values[name] = LinkValue(rounded, step / math.sqrt(12.0), round(rounded / step), 0.0, 1.0, confidence)
    return HeardSurvey(link, SurveyTime(START + round(at_s * SECOND), half_s), values)


def surveys_of(*passes, tools=(MUD, EM)):
    """Surveys given at each pass (seconds, words)."""
    one_list = LinkSurveys(tools, lambda _: None)
    return [one_list.take(words, START + round(at * SECOND)) for at, words in passes], one_list


def test_a_survey_over_two_links_is_one_and_the_first_is_not_waited_for():
    (first, second, third), _ = surveys_of(
        (100.0, heard("em", 50.0)), (180.0, heard("mud_pulse", 56.0)), (400.0, heard("em", 350.0, inclination=0.05))
    )
    assert [len(first), len(second), len(third)] == [1, 0, 1]
    assert first[0].reasons[-1] == "received over em"
    assert [first[0].sequence, third[0].sequence] == [1, 2]


def test_a_word_that_one_link_lost_is_taken_from_the_other_and_both_are_named():
    (first, second), _ = surveys_of(
        (100.0, heard("em", 50.0, **NO_AZIMUTH)), (180.0, heard("mud_pulse", 56.0, bits=10))
    )
    assert first == []
    (survey,) = second
    assert math.cos(survey.azimuth - TRUE[meanings.AZIMUTH]) == pytest.approx(1.0, abs=1e-4)
    # The finer word of the other quantities.
    assert survey.inclination == pytest.approx(TRUE[meanings.INCLINATION], abs=math.tau / 2**13 * 1.01)
    assert survey.reasons[-1] == "received over em and mud pulse"


def test_a_survey_that_lacks_a_word_is_given_once_the_other_link_had_its_time():
    (first,), one_list = surveys_of((100.0, heard("em", 50.0, **NO_AZIMUTH)))
    assert first == []
    assert one_list.advance(START + 120 * SECOND) == []
    (survey,) = one_list.advance(START + 600 * SECOND)
    assert "the azimuth was not received" in survey.reasons[0]
    (completed,) = one_list.take(heard("mud_pulse", 56.0), START + 700 * SECOND)
    assert completed.azimuth_method == "link"


def test_of_two_words_that_differ_the_surer_one_counts():
    (_, second), _ = surveys_of(
        (100.0, heard("em", 50.0, without=(meanings.DIP,), azimuth=0.0, inclination=0.2, confidence=0.99)),
        (180.0, heard("mud_pulse", 56.0, confidence=0.9999)),
    )
    assert second[0].inclination == pytest.approx(TRUE[meanings.INCLINATION], abs=1e-3)


FIRST = (100.0, heard("mud_pulse", 50.0), 1)
# A receiver that was started while the tool sent its survey does not know the rest before it.
LATE = (100.0, heard("mud_pulse", 70.0, half_s=math.inf), 1)
# Tools; for each pass when it was heard, its words, and how many surveys it adds to the list.
STORIES = {
    "one link repeats a survey": [
        (MUD,),
        (100.0, heard("mud_pulse", 50.0, **NO_AZIMUTH), 1),
        (400.0, heard("mud_pulse", 50.0, **NO_AZIMUTH), 0),
        (700.0, heard("mud_pulse", 50.0), 1),
        (1000.0, heard("mud_pulse", 950.0, inclination=0.02), 1),
    ],
    # In a straight hole.
    "next rest, same codes": [(MUD,), FIRST, (400.0, heard("mud_pulse", 350.0), 1)],
    "next rest, same codes over another link": [(MUD, EM), FIRST, (400.0, heard("em", 350.0), 1)],
    "next rest, one code differs": [(MUD,), FIRST, (400.0, heard("mud_pulse", 350.0, inclination=math.tau / 2**12), 1)],
    "rests too short for a survey": [
        (MUD,),
        FIRST,
        (400.0, heard("mud_pulse", 350.0, half_s=2.0), 0),
        (700.0, heard("mud_pulse", 650.0, half_s=2.0, inclination=0.02), 1),
    ],
    "a rest after one that was not seen": [(MUD,), LATE, (400.0, heard("mud_pulse", 350.0), 1)],
    "a rest that was not seen is known over another link": [(MUD, EM), LATE, (400.0, heard("em", 60.0), 0)],
    "a long connection is not the rest before it": [
        (MUD, EM),
        (100.0, heard("em", 50.0), 1),
        (2600.0, heard("mud_pulse", 350.0, half_s=900.0, inclination=0.02), 1),
    ],
    "rests not seen: values that agree are one survey": [
        (MUD, EM),
        (100.0, heard("em", 90.0, half_s=math.inf), 1),
        (180.0, heard("mud_pulse", 50.0, half_s=math.inf, bits=11), 0),
        (300.0, heard("em", 290.0, half_s=math.inf, magnetic_azimuth=0.01), 1),
    ],
}


@pytest.mark.parametrize("story", STORIES)
def test_each_survey_is_listed_once_by_its_rest_and_its_codes(story):
    tools, *passes = STORIES[story]
    given, _ = surveys_of(*((at, words) for at, words, _ in passes), tools=tools)
    assert [len(surveys) for surveys in given] == [count for *_, count in passes]


def test_the_azimuth_of_the_next_rest_does_not_complete_a_survey():
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, **NO_AZIMUTH)), (400.0, heard("mud_pulse", 350.0)), tools=(MUD,)
    )
    assert [first[0].azimuth_method, second[0].azimuth_method] == ["", "link"]
    assert [first[0].sequence, second[0].sequence] == [1, 2]


def test_what_a_repeat_after_a_short_rest_completes_keeps_its_time():
    (first, completed), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, **NO_AZIMUTH)),
        (400.0, heard("mud_pulse", 350.0, half_s=2.0)),
        tools=(MUD,),
    )
    assert [first[0].azimuth_method, completed[0].azimuth_method] == ["", "link"]
    assert completed[0].stamp_ns == first[0].stamp_ns


def test_totals_alone_do_not_give_a_survey_the_azimuth_of_the_next_station():
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, **NO_AZIMUTH)),
        (400.0, heard("mud_pulse", 350.0, without=(meanings.INCLINATION,), magnetic_azimuth=0.1)),
        tools=(MUD,),
    )
    assert [len(first), len(second)] == [1, 0]
    assert first[0].azimuth_method == ""

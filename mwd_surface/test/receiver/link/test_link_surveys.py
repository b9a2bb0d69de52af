# SPDX-License-Identifier: Apache-2.0
"""One list of surveys from several links: none twice, the better word of each quantity, the source named."""

import dataclasses
import math

import pytest

from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.link.link_survey import HeardSurvey, SurveyTime
from mwd_surface.receiver.link.link_surveys import LinkSurveys
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
        (100.0, heard("em", 50.0, without=(meanings.AZIMUTH,))), (180.0, heard("mud_pulse", 56.0, bits=10))
    )
    assert first == []
    (survey,) = second
    assert math.cos(survey.azimuth - TRUE[meanings.AZIMUTH]) == pytest.approx(1.0, abs=1e-4)
    # The finer word of the other quantities.
    assert survey.inclination == pytest.approx(TRUE[meanings.INCLINATION], abs=math.tau / 2**13 * 1.01)
    assert survey.reasons[-1] == "received over em and mud pulse"


def test_a_survey_that_lacks_a_word_is_given_once_the_other_link_had_its_time():
    (first,), one_list = surveys_of((100.0, heard("em", 50.0, without=(meanings.AZIMUTH,))))
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


def test_one_link_gives_each_survey_at_once_and_a_repeated_one_once():
    (first, again, complete, other), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, without=(meanings.AZIMUTH,))),
        (400.0, heard("mud_pulse", 50.0, without=(meanings.AZIMUTH,))),
        (700.0, heard("mud_pulse", 50.0)),
        (1000.0, heard("mud_pulse", 950.0, inclination=0.02)),
        tools=(MUD,),
    )
    assert [len(one) for one in (first, again, complete, other)] == [1, 0, 1, 1]


@pytest.mark.parametrize("link", ["mud_pulse", "em"])
def test_a_survey_of_the_next_rest_with_the_same_codes_is_another_one(link):
    """In a straight hole; over another link too, where that of one was lost."""
    tools = (MUD,) if link == "mud_pulse" else (MUD, EM)
    (first, second), _ = surveys_of((100.0, heard("mud_pulse", 50.0)), (400.0, heard(link, 350.0)), tools=tools)
    assert [len(first), len(second)] == [1, 1]


def test_the_azimuth_of_the_next_rest_does_not_complete_a_survey():
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, without=(meanings.AZIMUTH,))), (400.0, heard("mud_pulse", 350.0)), tools=(MUD,)
    )
    assert [first[0].azimuth_method, second[0].azimuth_method] == ["", "link"]
    assert [first[0].sequence, second[0].sequence] == [1, 2]


def test_a_rest_too_short_for_a_survey_makes_the_same_codes_a_repeat_and_others_a_survey():
    (first, again, other), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0)),
        (400.0, heard("mud_pulse", 350.0, half_s=2.0)),
        (700.0, heard("mud_pulse", 650.0, half_s=2.0, inclination=0.02)),
        tools=(MUD,),
    )
    assert [len(one) for one in (first, again, other)] == [1, 0, 1]


def test_what_a_repeat_after_a_short_rest_completes_keeps_its_time():
    (first, completed), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, without=(meanings.AZIMUTH,))),
        (400.0, heard("mud_pulse", 350.0, half_s=2.0)),
        tools=(MUD,),
    )
    assert [first[0].azimuth_method, completed[0].azimuth_method] == ["", "link"]
    assert completed[0].stamp_ns == first[0].stamp_ns


@pytest.mark.parametrize(("at_s", "listed"), [(60.0, 0), (350.0, 1)])
def test_a_rest_after_a_survey_whose_rest_was_not_seen_is_another_one(at_s, listed):
    """A receiver that was started while the tool sent its survey: over a second link the rest before it is known."""
    tools = (MUD, EM) if not listed else (MUD,)
    link = "em" if not listed else "mud_pulse"
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 70.0, half_s=math.inf)), (400.0, heard(link, at_s)), tools=tools
    )
    assert [len(first), len(second)] == [1, listed]


def test_a_long_connection_is_not_the_rest_before_it():
    (first, second), _ = surveys_of(
        (100.0, heard("em", 50.0)), (2600.0, heard("mud_pulse", 350.0, half_s=900.0, inclination=0.02))
    )
    assert [len(first), len(second)] == [1, 1]


def test_a_survey_of_the_next_rest_that_differs_by_one_code_is_another_one():
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0)),
        (400.0, heard("mud_pulse", 350.0, inclination=math.tau / 2**12)),
        tools=(MUD,),
    )
    assert [len(first), len(second)] == [1, 1]


def test_totals_alone_do_not_give_a_survey_the_azimuth_of_the_next_station():
    (first, second), _ = surveys_of(
        (100.0, heard("mud_pulse", 50.0, without=(meanings.AZIMUTH,))),
        (400.0, heard("mud_pulse", 350.0, without=(meanings.INCLINATION,), magnetic_azimuth=0.1)),
        tools=(MUD,),
    )
    assert [len(first), len(second)] == [1, 0]
    assert first[0].azimuth_method == ""


def test_surveys_whose_time_is_not_known_are_one_where_their_values_agree():
    (first, second, third), _ = surveys_of(
        (100.0, heard("em", 90.0, half_s=math.inf)),
        (180.0, heard("mud_pulse", 50.0, half_s=math.inf, bits=11)),
        (300.0, heard("em", 290.0, half_s=math.inf, magnetic_azimuth=0.01)),
    )
    assert [len(one) for one in (first, second, third)] == [1, 0, 1]

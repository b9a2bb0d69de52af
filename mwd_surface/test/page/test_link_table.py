# SPDX-License-Identifier: Apache-2.0
"""The link as the page's JSON: state and reason in words, words of the last survey, what is unknown as None."""

import dataclasses
import json
import math

from mwd_surface.live.link_state import (
    LOCKED,
    NO_FLOW,
    SURVEY,
    TOOLFACE,
    LinkCollector,
    LinkFrameState,
    LinkStatus,
    LinkWordState,
    WordStatus,
)
from mwd_surface.live.live_state import LiveState
from mwd_surface.page.state_feed import dumps
from mwd_surface.page.state_json import StateJson, plain

QUALITY = LinkStatus(
    *("mud_pulse", LOCKED, "", 9.5, 3.5, 1e-4, 0.01, 0.4, "survey", 2, 7, 12.0, math.nan, 40.0, 50.0),
    stamp_ns=1_700_000_000_000_000_000,
    at=5.0,
)


def word(place, frame=0, kind=SURVEY, status=0, revision=0, raw_confidence=0.99):
    return LinkWordState(
        *(f"W{place}", 1.0, 0.01, "rad", raw_confidence, WordStatus(status), kind, frame, place, revision),
        start_ns=10,
        stamp_ns=20,
        pulses=(0.5, 1.0),
    )


def test_without_a_link_there_is_none_to_show():
    assert StateJson().snapshot(LiveState().at(1.0))["sections"]["link"] is None


def test_a_survey_fills_word_by_word_and_a_final_word_replaces_the_provisional_one():
    collector = LinkCollector()
    for place in (0, 1):
        collector.on_word(word(place))
    collector.on_word(word(0, status=1, revision=1))
    table = plain(collector.status(QUALITY))
    assert [(one["name"], one["status"], one["final"]) for one in table["survey"]] == [
        ("W0", "erased", True),
        ("W1", "believed", False),
    ]
    collector.on_word(word(0, frame=4))
    assert [one["name"] for one in plain(collector.status(QUALITY))["survey"]] == ["W0"]


def test_toolface_words_do_not_end_the_survey_shown():
    collector = LinkCollector()
    collector.on_word(word(0))
    collector.on_word(word(0, frame=1, kind=TOOLFACE))
    status = collector.status(QUALITY)
    assert len(status.survey) == 1
    assert len(status.words) == 2


def test_what_is_unknown_is_none_and_the_state_is_said_in_words():
    unknown = dict.fromkeys(("ebn0_db", "margin_db", "clock_error", "goodput"), math.nan)
    quiet = dataclasses.replace(QUALITY, state=NO_FLOW, reason="the pumps are off", **unknown)
    table = plain(quiet)
    assert (table["state"], table["reason"]) == ("no flow", "the pumps are off")
    assert table["margin_db"] is None
    assert table["goodput"] is None
    assert table["survey_age"] is None
    assert table["toolface_age"] == 12.0


def test_each_link_in_use_is_named_with_its_own_words():
    collector = LinkCollector()
    collector.on_word(word(0))
    second = dataclasses.replace(collector.status(QUALITY), link="em", state=NO_FLOW)
    table = plain(dataclasses.replace(QUALITY, others=(second,)))
    assert (table["name"], table["words"]) == ("mud pulse", [])
    assert [(one["name"], one["state"], len(one["words"])) for one in table["others"]] == [("em", "no flow", 1)]


def test_the_page_gets_it_as_json():
    live = LiveState()
    collector = LinkCollector()
    collector.on_word(word(0))
    collector.on_frame(LinkFrameState(SURVEY, 0, 7, 6, 9.5, 10, 20, ""))
    live.on_link(collector.status(QUALITY), 5.0)
    section = StateJson().snapshot(live.at(6.0))["sections"]["link"]
    assert json.loads(dumps(section))["frames"][0]["believed"] == 6
    assert section["since"] == 5.0

# SPDX-License-Identifier: Apache-2.0
"""Surveys that a link did not bring: each time with flow after which none is in the list, with its reason."""

import dataclasses

import numpy as np
from test_score import START, survey
from test_score import message as survey_message
from test_score import recording as direct

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import installed
from mwd_surface.surveys.score import unlisted

START_S = START // 10**9
NO_INPUT, NO_FLOW, SEARCHING, LOCKED = range(4)
WAITING = "waiting for the sync"
PLAIN = {"int": 0, "float": 0.0, "str": "", "bool": False}


def empty(store, kind):
    """A message whose fields are all empty, without middleware."""

    def blank(name):
        if "ndarray" in name:
            return np.zeros(0)
        return PLAIN[name] if name in PLAIN else [] if "[" in name else empty(store, name.replace("__", "/"))

    names = ((field.name, str(field.type)) for field in dataclasses.fields(store.types[kind]))
    return store.types[kind](**{name: blank(text) for name, text in names})


def message(kind, second, values):
    types = installed()
    types.load(kind)
    one = empty(types.typestore, kind)
    one.header.stamp.sec = START_S + second
    if kind.endswith("LinkWord"):
        one.start.sec = START_S + second
    return bytes(types.typestore.serialize_cdr(dataclasses.replace(one, **values), kind))


def recording(path, *, surveys, words):
    """Pumps off for a minute, on for five, three times; surveys: times at rest; words: time, status, confidence."""
    rows = []
    for second in range(0, 1080, 10):
        at = second % 360
        state = NO_FLOW if at < 60 else (SEARCHING if at < 120 else LOCKED)
        state = NO_INPUT if at == 200 else state
        reason = {SEARCHING: WAITING, NO_INPUT: "no pressure"}.get(state, "")
        rows.append(
            ("quality", "mwd_msgs/msg/LinkQuality", second, {"link": "mud_pulse", "state": state, "reason": reason})
        )
    for second, status, confidence in words:
        word = {"kind": 2, "name": "Inc", "status": status, "revision": 1, "confidence": confidence}
        rows.append(("word", "mwd_msgs/msg/LinkWord", second, {"link": "mud_pulse", **word}))
    with BagWriter(path) as bag:
        channels = {"survey": bag.topic("/w/link/survey", "mwd_msgs/msg/Survey")}
        for number, second in enumerate(surveys):
            bag.write(channels["survey"], survey_message(survey(number, second, 1.0)), START + (second + 90) * 10**9)
        for topic, kind, second, values in rows:
            if topic not in channels:
                channels[topic] = bag.topic(f"/w/link/{topic}", kind)
            bag.write(channels[topic], message(kind, second, values), (START_S + second) * 10**9)
    return path


def found(path):
    with Bag(path) as bag:
        return [(one.start_ns // 10**9 - START_S, one.reason) for one in unlisted(bag)]


def test_a_survey_whose_inclination_was_erased_is_named_with_its_confidence(tmp_path):
    path = recording(tmp_path / "bag", surveys=(30, 750), words=((150, 0, 0.999), (510, 1, 0.93), (870, 0, 0.999)))
    assert found(path) == [(420, "the inclination was not received clearly, confidence 0.93")]


def test_a_survey_of_which_nothing_was_heard_has_the_last_reason_of_the_link(tmp_path):
    path = recording(tmp_path / "bag", surveys=(30, 390), words=((150, 0, 0.999), (510, 0, 0.999)))
    assert found(path) == [(780, WAITING)]


def test_nothing_is_said_where_all_surveys_are_listed_or_no_link_was_recorded(tmp_path):
    path = recording(tmp_path / "bag", surveys=(30, 390, 750), words=((150, 0, 0.999),))
    assert found(path) == []
    assert found(direct(tmp_path / "direct", [survey(1, 30.0, 1.0)])) == []

# SPDX-License-Identifier: Apache-2.0
"""Surveys that are in no list because a link did not receive them completely: their time and the reason."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.telemetry import meanings
from mwd_surface.bags.bag_reader import Bag

_WORD, _QUALITY, _SURVEY = "mwd_msgs/msg/LinkWord", "mwd_msgs/msg/LinkQuality", "mwd_msgs/msg/Survey"
# Constants of LinkWord (kind, status, revision) and of LinkQuality (state).
_OF_SURVEY, _ERASED, _FINAL = 2, 1, 1
_NO_INPUT, _NO_FLOW = 0, 1


class Unlisted(NamedTuple):
    """
    Interval with flow whose survey was not received completely: begin and end, ns, and the reason.

    A tool sends a survey at the beginning of each interval with flow.
    """

    start_ns: int
    end_ns: int
    reason: str


@dataclasses.dataclass
class _Flow:
    """Interval with flow at one link: end of the previous flow, begin, end, ns; the link's reasons for missing data."""

    before_ns: int
    start_ns: int
    end_ns: int
    reasons: list[str]


def unlisted(bag: Bag, namespace: str = "") -> list[Unlisted]:
    """
    Return the intervals with flow for which a link received no complete survey, each with a reason.

    Intervals for which the link gave no reason are left out. A wired tool also sends without flow, so its lost surveys
    cannot be found.
    """
    prefix = namespace.strip("/")
    if not all(any(topic.type_name == kind for topic in bag.topics.values()) for kind in (_WORD, _QUALITY)):
        return []
    listed = []
    if any(topic.type_name == _SURVEY for topic in bag.topics.values()):
        surveys = bag.find_topic(_SURVEY, f"{prefix}/link/survey")
        listed = [stamp_of(bag.decode(name, data).header.stamp) for _, name, _, data in bag.messages([surveys])]
    erased = _erased(bag, bag.find_topic(_WORD, f"{prefix}/link/word"))
    found: dict[int, Unlisted] = {}
    for flow in _flows(bag, bag.find_topic(_QUALITY, f"{prefix}/link/quality")):
        if any(flow.before_ns <= stamp <= flow.end_ns for stamp in listed):
            continue
        reason = next((text for at, text in erased if flow.start_ns <= at <= flow.end_ns), "")
        reason = reason or next(iter(flow.reasons[-1:]), "")
        if reason:
            found.setdefault(flow.start_ns, Unlisted(flow.start_ns, flow.end_ns, reason))
    return list(found.values())


def _erased(bag: Bag, topic: str) -> list[tuple[int, str]]:
    """Return the times, ns, of survey inclinations that were dropped as too uncertain, each with a sentence."""
    out = []
    for _, name, _, data in bag.messages([topic]):
        word = bag.decode(name, data)
        if (word.kind, word.status, word.revision) != (_OF_SURVEY, _ERASED, _FINAL):
            continue
        if meanings.meaning_of(word.name) == meanings.INCLINATION:
            out.append(
                (stamp_of(word.start), f"the inclination was not received clearly, confidence {word.confidence:.2f}")
            )
    return out


def _flows(bag: Bag, topic: str) -> list[_Flow]:
    """Return the intervals with flow of all links; flow before the first report without flow of a link is left out."""
    flows: list[_Flow] = []
    now: dict[str, _Flow | None] = {}
    stopped: dict[str, int] = {}
    for _, name, _, data in bag.messages([topic]):
        quality = bag.decode(name, data)
        stamp, link = stamp_of(quality.header.stamp), quality.link
        if quality.state == _NO_INPUT:
            continue
        if quality.state == _NO_FLOW:
            if now.get(link) is not None or link not in stopped:
                stopped[link] = stamp
            now[link] = None
        elif link in stopped:
            flow = now.get(link)
            if flow is None:
                flow = _Flow(stopped[link], stamp, stamp, [])
                now[link] = flow
                flows.append(flow)
            flow.end_ns = stamp
            flow.reasons += [quality.reason] if quality.reason else []
    return flows

# SPDX-License-Identifier: Apache-2.0
"""Conversion of the output of a telemetry link to ROS messages."""

from __future__ import annotations

import math
from collections.abc import Callable

from mwd_msgs import msg

from mwd_sensors.ros.time_stamps import stamp
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link import Quality
from mwd_surface.receiver.words import BELIEVED, FrameReport, ReceivedWord, item_of, pulse_edges

StampOf = Callable[[float], int]
_KINDS = {"survey": msg.LinkWord.SURVEY, "toolface": msg.LinkWord.TOOLFACE}
_STATUS = {BELIEVED: msg.LinkWord.BELIEVED, "by_consistency": msg.LinkWord.BY_CONSISTENCY}


def word_message(word: ReceivedWord, tool: ToolConfiguration, link: str, stamp_of: StampOf) -> msg.LinkWord:
    """Return a word as mwd_msgs/LinkWord; stamp_of: function from the time of the signal, s, to a stamp, ns."""
    factor = meanings.factor(word.unit)
    item = item_of(word, tool)
    message = msg.LinkWord(
        link=link,
        kind=_KINDS[word.kind],
        frame=word.frame,
        place=word.index,
        revision=word.revision,
        name=word.name,
        bits=item.bits,
        raw=word.raw,
        # A word without a value has the status erased; send 0, so that no consumer needs to handle NaN.
        value=0.0 if math.isnan(word.value) else word.value * factor,
        unit=meanings.si_unit(word.unit),
        confidence=min(max(word.confidence, 0.0), 1.0),
        sigma=word.sigma * factor,
        status=_STATUS.get(word.status, msg.LinkWord.ERASED),
        alternatives=[raw for raw, _ in word.alternatives],
        alternative_odds=[odds for _, odds in word.alternatives],
        pulses=pulse_edges(word, tool),
    )
    message.header.stamp = stamp(stamp_of(word.end_s))
    message.start = stamp(stamp_of(word.start_s))
    if word.kind == "toolface":
        message.measured = message.start
    return message


def frame_message(frame: FrameReport, words: list[ReceivedWord], link: str, stamp_of: StampOf) -> msg.LinkFrame:
    """Return a received frame (one pass of a sequence of words) as mwd_msgs/LinkFrame; words: words of the frame."""
    message = msg.LinkFrame(
        link=link,
        kind=_KINDS[frame.kind],
        frame=frame.frame,
        words=len(words),
        believed=sum(word.status == BELIEVED for word in words),
        complete=not frame.reason,
        ebn0_db=frame.ebn0_db,
        clock_error=frame.clock_error,
        reason=frame.reason,
    )
    message.header.stamp = stamp(stamp_of(frame.end_s))
    message.start = stamp(stamp_of(frame.start_s))
    return message


def quality_message(quality: Quality, link: str, stamp_ns: int) -> msg.LinkQuality:
    """Return the state of a link as mwd_msgs/LinkQuality."""
    fields = {name: value for name, value in vars(quality).items() if name != "needed_db"}
    message = msg.LinkQuality(link=link, margin_db=quality.ebn0_db - quality.needed_db, latency=math.nan, **fields)
    message.header.stamp = stamp(stamp_ns)
    return message

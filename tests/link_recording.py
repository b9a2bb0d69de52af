# SPDX-License-Identifier: Apache-2.0
"""A recording of what a rig's gauge heard, with what a receiver makes of it: as the receiver node, without a graph."""

import numpy as np
from rclpy.serialization import serialize_message

from mwd_estimation.settings.place import reference_of
from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.ros.messages import make
from mwd_surface.receiver.link import link_attitude
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_feed import LinkFeed
from mwd_surface.receiver.link.link_survey import LinkSurveys
from mwd_surface.ros import link_messages

_ATTITUDE_NS = 500_000_000


def receiver_messages(bag, namespace, tools, place):
    """
    Return (time, topic, type, bytes) of all that a receiver says of a recording, in order of time.

    tools: configurations of the tool, one a link. place: settings of the reference.
    """
    reference = reference_of(place, bag.start_ns)
    feeds = {namespace + gauge_burst.TOPICS[tool.link][0]: LinkFeed(tool, AgeRules(), str) for tool in tools}
    kinds = {namespace + gauge_burst.TOPICS[tool.link][0]: gauge_burst.TOPICS[tool.link][1] for tool in tools}
    surveys = LinkSurveys(tools, lambda _stamp: reference, None)
    said, attitude_at = [], 0

    def say(at, topic, message):
        kind = f"mwd_msgs/msg/{type(message).__name__}"
        said.append((at, namespace + topic, kind, bytes(serialize_message(message))))

    for at, topic, _, data in bag.messages([*feeds, namespace + "rig/state"]):
        if topic not in feeds:
            rig = wire.RIG_STATE.decode(np.frombuffer(data, dtype=np.uint8)[None])[0]
            for feed in feeds.values():
                feed.link.attitude.rotating = abs(float(rig["rotary_speed"])) > 0.5
                feed.link.attitude.speed = abs(float(rig["rate_of_penetration"]))
            continue
        feed = feeds[topic]
        out = feed.push(*gauge_burst.decode(data, kinds[topic]))
        name, now_ns = feed.link.name, feed.stamp_of(feed.link.now_s)
        for word in out.words:
            say(at, "link/word", link_messages.word_message(word, feed.link.tool, name, feed.stamp_of))
        for frame in out.frames:
            words = [word for word in out.words if word.frame == frame.frame and word.revision]
            say(at, "link/frame", link_messages.frame_message(frame, words, name, feed.stamp_of))
        for when, quality in out.states:
            say(at, "link/quality", link_messages.quality_message(quality, name, feed.stamp_of(when)))
        for heard in out.surveys:
            for survey in surveys.take(heard, now_ns):
                say(at, "link/survey", survey.to_message(make))
        if at - attitude_at >= _ATTITUDE_NS:
            attitude_at = at
            rows = [
                one.link.attitude.sample(one.seconds(now_ns) or 0.0, now_ns, reference)
                for one in feeds.values()
                if one.heard
            ]
            row = wire.ATTITUDE.encode(link_attitude.best(rows), wire.SONDE_FRAME)[0].tobytes()
            said.append((at, namespace + "link/attitude", wire.ATTITUDE.type_name, row))
    return said

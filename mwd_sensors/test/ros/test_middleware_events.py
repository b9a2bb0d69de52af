# SPDX-License-Identifier: Apache-2.0
"""Two processes with one node name are told from one that was started again."""

from types import SimpleNamespace

import pytest

from mwd_sensors.ros.middleware_events import MiddlewareEvents
from mwd_sensors.ros.qos import STREAM


class Node:
    """A node that sees these publishers."""

    def __init__(self, names):
        self.names = names

    def resolve_topic_name(self, topic):
        return f"/w1/{topic}"

    def get_publishers_info_by_topic(self, _topic):
        return [SimpleNamespace(node_namespace="/w1", node_name=name) for name in self.names]


def watching(names):
    now = [100.0]
    node = Node(names)
    events = MiddlewareEvents(node, lambda: now[0])
    matched = events.of_subscription("imu/data_raw", STREAM).matched
    matched(SimpleNamespace(current_count=len(names)))
    return node, events, matched, now


@pytest.mark.fault_case(56)
def test_two_nodes_of_one_name_are_named_once_a_killed_one_would_have_left_the_graph():
    _, events, _, now = watching(["sonde", "sonde"])
    now[0] += 20.0
    assert events.diagnostics() == []
    now[0] += 10.0
    (found,) = events.diagnostics()
    assert found.message == "imu/data_raw has 2 publishers: /w1/sonde, /w1/sonde"
    assert "stop all but one" in found.remedy


def test_a_node_that_was_killed_and_started_again_is_no_alarm():
    node, events, matched, now = watching(["sonde", "sonde"])
    now[0] += 20.0
    node.names = ["sonde"]
    matched(SimpleNamespace(current_count=1))
    now[0] += 20.0
    assert events.diagnostics() == []


def test_two_nodes_of_different_names_are_named_within_seconds():
    _, events, _, now = watching(["sonde", "sonde_2"])
    now[0] += 4.0
    (found,) = events.diagnostics()
    assert "/w1/sonde, /w1/sonde_2" in found.message

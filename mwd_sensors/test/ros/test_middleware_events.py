# SPDX-License-Identifier: Apache-2.0
"""Two processes with one node name are told from one that was started again."""

from types import SimpleNamespace

import pytest
from rclpy.duration import Duration, Infinite
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from mwd_sensors.ros.middleware_events import MiddlewareEvents
from mwd_sensors.ros.qos import LATCHED, STREAM


class Node:
    """A node that sees these publishers, and these subscriptions of its topic."""

    def __init__(self, names=(), **profiles):
        self.names, self.profiles = names, profiles

    def resolve_topic_name(self, topic):
        return f"/w1/{topic}"

    def get_publishers_info_by_topic(self, _topic):
        return [SimpleNamespace(node_namespace="/w1", node_name=name) for name in self.names]

    def get_subscriptions_info_by_topic(self, _topic):
        return [
            SimpleNamespace(node_namespace="/w1", node_name=name, qos_profile=qos)
            for name, qos in self.profiles.items()
        ]

    def get_name(self):
        return "estimator"

    def get_namespace(self):
        return "/w1"

    def get_node_names_and_namespaces(self):
        return [("estimator", "/w1"), ("estimator", "/w2"), *((name, "/w1") for name in self.names)]


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
    assert "2 publishers: /w1/sonde, /w1/sonde" in found.message
    assert found.remedy


@pytest.mark.fault_case(56)
def test_a_second_node_of_ones_own_name_is_named_and_forgotten_when_it_has_gone():
    node, events, _, now = watching(["estimator"])
    assert events.diagnostics() == []
    now[0] += 30.0
    (found,) = events.diagnostics()
    assert "2 nodes have the name /w1/estimator" in found.message
    node.names = []
    assert events.diagnostics() == []
    node.names = ["estimator"]
    assert events.diagnostics() == []


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


def as_the_graph_gives_it(qos, **limits):
    """Return a profile whose unlimited durations are infinite, as the middleware's graph says them."""
    durations = {"deadline": Infinite, "lifespan": Infinite, "liveliness_lease_duration": Infinite, **limits}
    return QoSProfile(depth=1, reliability=qos.reliability, durability=qos.durability, **durations)


@pytest.mark.fault_case(52)
@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        (as_the_graph_gives_it(LATCHED, deadline=Duration(seconds=0.5)), "deadline 0.5 s"),
        (as_the_graph_gives_it(LATCHED, liveliness_lease_duration=Duration(seconds=2)), "lease duration 2 s"),
        (as_the_graph_gives_it(STREAM), None),
    ],
)
@pytest.mark.parametrize("ours", [LATCHED, STREAM])
def test_only_the_unfit_subscription_is_named_and_only_while_it_is_there(wrong, word, ours):
    """A healthy listener was named beside it, and kept the error for ever after the unfit one had left."""
    healthy = as_the_graph_gives_it(ours)
    node = Node(estimator=healthy, rogue=wrong)
    events = MiddlewareEvents(node)
    events.of_publisher("surveys", ours).incompatible_qos(None)
    found = events.diagnostics()
    if word is not None:
        (one,) = found
        assert "/w1/rogue" in one.message
        assert word in one.message
    assert all("/w1/estimator" not in one.message for one in found)
    node.profiles.pop("rogue")
    assert events.diagnostics() == []


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
@pytest.mark.parametrize("durability", [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL])
def test_a_partner_with_the_same_profile_always_fits(reliability, durability):
    ours = QoSProfile(depth=3, reliability=reliability, durability=durability)
    events = MiddlewareEvents(Node(other=as_the_graph_gives_it(ours)))
    events.of_publisher("surveys", ours).incompatible_qos(None)
    assert events.diagnostics() == []

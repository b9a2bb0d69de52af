# SPDX-License-Identifier: Apache-2.0
"""What others may send the receiver node: depths and angles that no rig has."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

import rclpy
from mwd_msgs.msg import RigState
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState

from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.nodes.receiver import ReceiverNode
from mwd_surface.receiver.link.link import NO_FLOW, SEARCHING
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_feed import LinkFeed


@pytest.fixture
def node():
    """What the callbacks of the node use of it: one link that has heard a second of pressure."""
    feed = LinkFeed(ToolConfiguration(), AgeRules(), [].append)
    feed.push(0, 0.01, np.full(100, 2.0e7))
    return SimpleNamespace(_inputs=[SimpleNamespace(feed=feed)])


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("depth", [math.nan, math.inf, -math.inf, 1e300, -9999.0])
def test_a_depth_that_no_hole_has_changes_no_age_of_a_word(node, depth):
    attitude = node._inputs[0].feed.link.attitude
    ReceiverNode._on_rig_state(node, RigState(bit_depth=2500.0, valid=RigState.BIT_DEPTH))
    assert attitude.travel_s == 2.0
    ReceiverNode._on_rig_state(node, RigState(bit_depth=depth, valid=RigState.BIT_DEPTH))
    assert attitude.travel_s == 2.0


@pytest.mark.fault_case(3)
def test_an_angle_of_the_top_drive_that_is_not_finite_is_left_out(node, monkeypatch):
    taken = []
    attitude = node._inputs[0].feed.link.attitude
    monkeypatch.setattr(attitude, "take_quill", lambda _at, angle: taken.append(angle))
    for angle in (math.nan, math.inf, 0.5):
        ReceiverNode._on_quill(node, JointState(position=[angle]))
    assert taken == [0.5]


def test_a_flow_whose_bit_goes_keeps_no_tool_silent(node):
    link = node._inputs[0].feed.link
    low = 0.5 * ToolConfiguration().flow_threshold
    ReceiverNode._on_rig_state(node, RigState(flow_rate=low, valid=RigState.FLOW_RATE))
    assert link.quality().state == NO_FLOW
    ReceiverNode._on_rig_state(node, RigState(flow_rate=low))
    assert link.quality().state == SEARCHING


def test_a_receiver_without_a_tool_file_shuts_down_and_ends_its_process():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = ReceiverNode(context=context)
    try:
        assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
        assert node.trigger_shutdown() == TransitionCallbackReturn.SUCCESS
        assert node.stop_requested.done()
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)

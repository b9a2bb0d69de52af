# SPDX-License-Identifier: Apache-2.0
"""What others may send the receiver node: depths, angles and times that no rig has."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_msgs.msg import RigState
from sensor_msgs.msg import JointState

from mwd_surface.nodes.receiver import ReceiverNode

START = 1_772_344_800_000_000_000


def receiver():
    """What the callbacks of the node use of it; `pushed` and `begun` tell what they did."""
    told = SimpleNamespace(pushed=[], begun=[], quill=[])
    link = SimpleNamespace(
        attitude=SimpleNamespace(
            travel_s=1.2, rotating=False, take_quill=lambda at, angle: told.quill.append((at, angle))
        ),
        now_s=100.0,
        push=lambda seconds, _pressure: told.pushed.append(float(seconds[0])),
    )
    node = SimpleNamespace(
        _link=link,
        _following=link,
        _origin_ns=START,
        _tool=SimpleNamespace(medium="mud"),
        _publish=lambda _out: None,
        get_logger=lambda: SimpleNamespace(warning=told.begun.append),
    )

    def new_link():
        node._origin_ns, link.now_s = None, -np.inf

    node._new_link = new_link
    node._take = lambda *burst: ReceiverNode._take(node, *burst)
    return node, told


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("depth", [math.nan, math.inf, -math.inf, 1e300, -9999.0])
def test_a_depth_that_no_hole_has_changes_no_age_of_a_word(depth):
    node, _ = receiver()
    ReceiverNode._on_rig_state(node, RigState(bit_depth=depth, valid=RigState.BIT_DEPTH))
    assert node._link.attitude.travel_s == 1.2
    ReceiverNode._on_rig_state(node, RigState(bit_depth=2500.0, valid=RigState.BIT_DEPTH))
    assert node._link.attitude.travel_s == 2.0


@pytest.mark.fault_case(3)
def test_an_angle_of_the_top_drive_that_is_not_finite_is_left_out():
    node, told = receiver()
    for angle in (math.nan, math.inf, 0.5):
        ReceiverNode._on_quill(node, JointState(position=[angle]))
    assert [angle for _, angle in told.quill] == [0.5]


@pytest.mark.fault_case(43)
def test_a_gap_of_hours_begins_anew_instead_of_being_filled():
    node, told = receiver()
    node._take(START + 160 * 10**9, 0.01, np.zeros(10))
    assert told.begun == []
    node._take(START + 20 * 3600 * 10**9, 0.01, np.zeros(10))
    assert told.begun == ["the pressure's time went on by more than an hour: the receiver begins anew"]
    assert told.pushed == [160.0, 0.0]

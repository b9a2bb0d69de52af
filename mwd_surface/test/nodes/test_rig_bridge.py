# SPDX-License-Identifier: Apache-2.0
"""What the surface node does with data of the rig."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_sensors.core import wire
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.settings import ControlSettings
from mwd_surface.nodes import rig_bridge
from mwd_surface.rig.port import RigSettings


@pytest.mark.fault_case(86)
def test_rig_data_that_come_while_the_node_is_inactive_are_dropped(tmp_path, monkeypatch):
    given, published = {}, []
    port = SimpleNamespace(start=dict, enabled=False, status=tuple)
    monkeypatch.setattr(rig_bridge, "RigPort", lambda *_, **more: given.update(more) or port)
    publisher = SimpleNamespace(publish=published.append)
    node = SimpleNamespace(active=False, frame=lambda name: name, add_publisher=lambda *_: publisher)
    context = SimpleNamespace(
        node=node,
        alarm_log=None,
        now_ns=lambda: 7,
        requests=SimpleNamespace(call=None),
        folder=tmp_path,
    )
    bridge = rig_bridge.RigBridge(context, RigSettings(), "w", ControlAuthority(ControlSettings()), lambda: False)
    bridge._publisher = publisher
    given["on_rig_state"]("rig_wits", wire.RIG_STATE.empty(1))
    node.active = True
    bridge.update(1.0)
    assert published == []
    given["on_rig_state"]("rig_wits", wire.RIG_STATE.empty(1))
    bridge.update(2.0)
    (message,) = published
    assert wire.frame_id(message) == "rig_wits"

# SPDX-License-Identifier: Apache-2.0
"""Servers of the surface whose file cannot be understood: refused is what needs it, with the file and the remedy."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_msgs import srv

from mwd_sensors.ros.diagnostics import WARN
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.downlink import Downlink
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import ControlRequest, Permission, Sender
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.nodes.control_server import ControlServer
from mwd_surface.nodes.downlink_server import DownlinkServer

pytestmark = pytest.mark.fault_case(69)


@pytest.fixture
def context(tmp_path):
    def nothing(*_):
        """Not looked at here."""

    services = []
    return SimpleNamespace(
        node=SimpleNamespace(add_service=lambda _kind, name, _answer: services.append(name)),
        services=services,
        live=None,
        now_ns=lambda: 7,
        folder=tmp_path,
        alarm_log=SimpleNamespace(raise_alarm=nothing),
    )


def test_control_is_refused_with_the_damaged_file_and_not_with_a_setting(context):
    (context.folder / "control.json").write_text("[")
    server = ControlServer(context, ControlSettings(enabled=True))
    decision = server.authority.request(ControlRequest(Sender("test", "autodriller"), "autodriller"), 0.0)
    assert decision.permission == Permission.DENIED
    (diagnostic,) = server.diagnostics()
    assert diagnostic.level == WARN
    for words in (decision.message, diagnostic.message, server.authority.status(0.0).reason):
        assert "control.json" in words
        assert "delete it" in words
    assert "control.enabled" not in decision.message


def test_a_downlink_is_refused_with_the_damaged_file_and_not_with_a_setting(context):
    tool = context.folder / "tool.yaml"
    tool.write_text(tool_configuration.text(ToolConfiguration(downlink=Downlink())))
    (context.folder / "downlink.json").write_text("[")
    server = DownlinkServer(context, DownlinkSettings(tool_file=str(tool)), ControlAuthority(ControlSettings()))
    server.open()
    assert context.services == ["draft_downlink", "decide_downlink"]
    answer = server.draft(srv.DraftDownlink.Request(), srv.DraftDownlink.Response())
    (diagnostic,) = server.diagnostics()
    assert not answer.success
    assert diagnostic.level == WARN
    for words in (answer.message, diagnostic.message):
        assert "downlink.json" in words
        assert "delete it" in words
    assert "downlink.tool_file" not in answer.message

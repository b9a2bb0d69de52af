# SPDX-License-Identifier: Apache-2.0
"""A surface node that cannot be configured completely."""

import socket

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from mwd_surface.nodes.surface import SurfaceNode


def _is_free(port):
    with socket.socket() as found:
        try:
            found.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


@pytest.mark.slow(3)
@pytest.mark.fault_case(94)
@pytest.mark.parametrize("refused", ["acknowledge_alarm", "export"])
def test_a_node_that_is_refused_one_service_keeps_no_page_and_no_folder_and_may_be_configured_again(
    tmp_path, monkeypatch, refused
):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    given = {"folder": str(tmp_path), "page.port": port}
    node = SurfaceNode(context=context, parameter_overrides=[Parameter(name, value=v) for name, v in given.items()])
    try:
        add_service = node.add_service

        def refuse(srv_type, name, callback):
            if name == refused:
                raise RuntimeError(f"this node may not reply {name}")
            add_service(srv_type, name, callback)

        with monkeypatch.context() as refusing:
            refusing.setattr(node, "add_service", refuse)
            assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
        assert _is_free(port)
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert not _is_free(port)
        assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
        assert _is_free(port)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)

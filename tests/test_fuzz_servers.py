# SPDX-License-Identifier: Apache-2.0
"""Servers: whatever a peer sends, the next one is served."""

import base64
import contextlib
import gc
import http.client
import socket
import struct
from urllib.parse import urlsplit

import pytest
from hypothesis import given, settings

from attacks import attacks
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings
from mwd_surface.rig.modbus.server import ModbusServer, ModbusSettings
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.server import OpcuaServer
from mwd_surface.rig.wits.connections import Wits0Server, Wits0ServerSettings

pytestmark = [pytest.mark.fuzz, pytest.mark.slow]

# Each example is a connection: fewer than of files, ten times as many in `make fuzz`.
BOUNDED = settings(max_examples=max(settings().max_examples // 4, 25))


def send(port, data, first=b""):
    """Send bytes to a server and read what it says, if anything."""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 5.0) as peer:
        peer.settimeout(0.05)
        peer.sendall(first)
        if first:
            peer.recv(4096)
        peer.sendall(data)
        peer.shutdown(socket.SHUT_WR)
        peer.recv(4096)


@pytest.fixture(scope="module")
def page():
    token = "a-secret-of-tests"  # noqa: S105
    made = PageServer(PageSettings(port=0, request_timeout=0.5), lambda _name, _arguments: (True, ""), token=token)
    made.start()
    made.push({"now": 0.0, "sections": {"a": {"b": 1}}, "revisions": {"a": 1}})
    yield urlsplit(made.address).port
    made.stop()


def page_serves(port):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    try:
        connection.request("GET", "/state.json")
        assert connection.getresponse().status == 200
    finally:
        connection.close()


COMMAND = (
    b"POST /command/set_depth HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer a-secret-of-tests\r\n"
    b'Content-Type: application/json\r\nContent-Length: 41\r\n\r\n{"bit_depth": 1.0, "operator_name": "Ann"}'
)
UPGRADE = (
    b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + base64.b64encode(b"0123456789abcdef") + b"\r\n\r\n"
)
FRAMES = (b"\x81\x85\x00\x00\x00\x00hello", b"\x89\x80\x00\x00\x00\x00", b"\x82\xff" + b"\xff" * 8 + b"\x00" * 4)


@pytest.mark.fault_case(79)
def test_http(page):
    @BOUNDED
    @given(data=attacks(b"GET /state.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", COMMAND))
    def attack(data):
        send(page, data)

    attack()
    page_serves(page)


def test_websocket(page):
    @BOUNDED
    @given(data=attacks(*FRAMES))
    def attack(data):
        send(page, data, UPGRADE)

    attack()
    page_serves(page)


@pytest.mark.fault_case(89)
def test_modbus():
    server = ModbusServer(ModbusSettings(port=0), None)
    server.start()
    try:

        @BOUNDED
        @given(data=attacks(*(struct.pack(">HHHBBHH", 7, 0, 6, 1, function, 0, 10) for function in (3, 4, 6, 16))))
        def attack(data):
            send(server.port, data)

        attack()
        with socket.create_connection(("127.0.0.1", server.port), 5.0) as peer:
            peer.sendall(struct.pack(">HHHBBHH", 7, 0, 6, 1, 4, 0, 1))
            assert peer.recv(64)[7:9] == b"\x04\x02"
    finally:
        server.stop()


@pytest.mark.fault_case(72)
def test_wits():
    server = Wits0Server(Wits0ServerSettings(port=0))
    server.start()
    try:

        @BOUNDED
        @given(data=attacks(b"&&\r\n0108123.4\r\n01101234.5\r\n!!\r\n"))
        def attack(data):
            send(server.port, data)

        attack()
        with socket.create_connection(("127.0.0.1", server.port), 5.0):
            assert server.running
    finally:
        server.stop()


@pytest.mark.fault_case(90)
# asyncua drops the transport of a connection that it refuses without closing it.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_opcua():
    server = OpcuaServer(OpcuaSettings(port=0), "Well 1")
    server.start()
    hello = b"HELF" + struct.pack("<IIIIIII", 32, 0, 65536, 65536, 0, 0, 0)
    opened = b"OPNF" + struct.pack("<II", 132, 0) + b"\x2f\x00\x00\x00http://opcfoundation.org/UA/SecurityPolicy#None"
    try:

        @BOUNDED
        @given(data=attacks(hello, hello + opened))
        def attack(data):
            send(server.port, data)

        attack()
        with socket.create_connection(("127.0.0.1", server.port), 5.0) as peer:
            peer.settimeout(5.0)
            peer.sendall(hello)
            assert peer.recv(8)[:4] == b"ACKF"
    finally:
        server.stop()
        # Here, so that no later test is blamed.
        gc.collect()


def test_foxglove():
    from mwd_surface.page.foxglove_server import FoxgloveServer, FoxgloveSettings

    server = FoxgloveServer(FoxgloveSettings(enabled=True, port=0), "/w1")
    server.start()
    port = urlsplit(server.address).port
    upgrade = UPGRADE.replace(b"/live", b"/").replace(
        b"\r\n\r\n", b"\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    )
    try:

        @BOUNDED
        @given(data=attacks(*FRAMES, b'\x81\xa9\x00\x00\x00\x00{"op":"subscribe","subscriptions":[{"id":1}]}'))
        def attack(data):
            send(port, data, upgrade)

        attack()
        with socket.create_connection(("127.0.0.1", port), 5.0) as peer:
            peer.settimeout(5.0)
            peer.sendall(upgrade)
            assert peer.recv(16).startswith(b"HTTP/1.1 101")
    finally:
        server.stop()

# SPDX-License-Identifier: Apache-2.0
"""The live Foxglove server, asked by a websocket client that speaks its protocol: schemas, bytes, late joiners."""

import asyncio
import contextlib
import json
import socket
import struct
import time

import aiohttp
import pytest

from mwd_surface.bags.definitions import installed
from mwd_surface.page.foxglove_server import FoxgloveError, FoxgloveServer, FoxgloveSettings

TEMPERATURE, LIST = "sensor_msgs/msg/Temperature", "mwd_msgs/msg/SurveyList"
MESSAGE, TIME, TEXT, BINARY = 1, 2, aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY


@pytest.fixture
def server():
    made = FoxgloveServer(FoxgloveSettings(enabled=True, port=0), "/w1")
    made.start()
    yield made
    made.stop()


class Client:
    """Just enough of the Foxglove websocket protocol, version 1, as a viewer speaks it."""

    def __init__(self, talk):
        self.talk, self.info, self.channels, self.messages = talk, {}, {}, []
        self.times = []

    async def until(self, true):
        async with asyncio.timeout(5.0):
            while not true(self):
                reported = await self.talk.receive()
                if reported.type == TEXT:
                    table = json.loads(reported.data)
                    if table["op"] == "serverInfo":
                        self.info = table
                    elif table["op"] == "advertise":
                        self.channels |= {c["topic"]: c for c in table["channels"]}
                elif reported.type == BINARY and reported.data[0] == TIME:
                    self.times += struct.unpack_from("<Q", reported.data, 1)
                elif reported.type == BINARY and reported.data[0] == MESSAGE:
                    subscription, stamp = struct.unpack_from("<IQ", reported.data, 1)
                    self.messages.append((subscription, stamp, reported.data[13:]))
                elif reported.type in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSE):
                    raise ConnectionError("the server closed")

    async def subscribe(self, subscription, topic):
        one = {"id": subscription, "channelId": self.channels[topic]["id"]}
        await self.talk.send_json({"op": "subscribe", "subscriptions": [one]})


def watched(server, script):
    """Run `script(client)` against the server."""

    async def run():
        address = server.address.replace("ws:", "http:")
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as talk,
        ):
            client = Client(talk)
            await client.until(lambda c: c.info)
            await script(client)
            return client

    return asyncio.run(run())


def test_a_client_gets_the_bytes_the_stamp_and_the_schema_of_a_recording(server):
    data = bytes(range(48))
    server.put("/w1/imu/temperature", TEMPERATURE, data, 5)

    async def script(client):
        await client.until(lambda c: c.channels)
        await client.subscribe(7, "/w1/imu/temperature")
        async with asyncio.timeout(5.0):
            # A subscription takes a moment to be in force; the topic goes on meanwhile, as topics do.
            while not client.messages:
                server.put("/w1/imu/temperature", TEMPERATURE, data, 1_795_000_000_123_456_789)
                try:
                    async with asyncio.timeout(0.05):
                        await client.until(lambda c: c.messages)
                except TimeoutError:
                    continue

    client = watched(server, script)
    assert client.info["name"] == "/w1"
    # The time of the wall is not told.
    assert "time" not in client.info["capabilities"]
    channel = client.channels["/w1/imu/temperature"]
    assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == ("cdr", TEMPERATURE, "ros2msg")
    assert channel["schema"] == installed().definition(TEMPERATURE).text
    assert client.messages[0] == (7, 1_795_000_000_123_456_789, data)


@pytest.mark.parametrize("offered", [[], ["chat.v1"]])
def test_a_client_of_another_protocol_is_refused(server, offered):
    async def knock():
        address = server.address.replace("ws:", "http:")
        async with aiohttp.ClientSession() as session, session.ws_connect(address, protocols=offered):
            pass

    with pytest.raises(aiohttp.WSServerHandshakeError, match="400"):
        asyncio.run(knock())


def test_one_that_says_nothing_of_a_handshake_does_not_keep_others_out(server):
    host, _, port = server.address.removeprefix("ws://").partition(":")
    with socket.create_connection((host, int(port))) as dumb:
        dumb.sendall(b"\0" * 100_000)

        async def script(client):
            assert client.info["name"] == "/w1"

        watched(server, script)


def test_clients_are_told_a_time_that_is_not_the_wall_s():
    simulated = FoxgloveServer(FoxgloveSettings(enabled=True, port=0), "/w1", simulated_clock=True)
    simulated.start()

    async def script(client):
        assert "time" in client.info["capabilities"]
        while not client.times:
            simulated.set_time(5_000_000_000)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(0.05):
                    await client.until(lambda c: c.times)

    assert set(watched(simulated, script).times) == {5_000_000_000}
    simulated.stop()


def test_one_who_comes_late_gets_the_last_of_a_latched_topic(server):
    server.put("/w1/surveys", LIST, b"first", 1, latched=True)
    server.put("/w1/surveys", LIST, b"the table", 2, latched=True)

    async def script(client):
        await client.until(lambda c: c.channels)
        await client.subscribe(1, "/w1/surveys")
        await client.until(lambda c: c.messages)

    client = watched(server, script)
    assert client.messages[0] == (1, 2, b"the table")


def test_a_topic_is_shown_before_its_first_message_and_after_a_restart(server):
    server.advertise("/w1/survey", "mwd_msgs/msg/Survey")

    async def script(client):
        await client.until(lambda c: "/w1/survey" in c.channels)

    watched(server, script)
    server.stop()
    server.start()
    watched(server, script)


def test_a_type_nobody_defines_is_left_out_and_named(server):
    server.put("/odd", "no_such_pkg/msg/Odd", b"\0", 1)
    assert server.unknown == {"no_such_pkg/msg/Odd"}


def test_a_taken_port_is_named_and_a_stopped_server_gives_it_free(server):
    port = int(server.address.rsplit(":", 1)[1])
    again = FoxgloveServer(FoxgloveSettings(port=port), "b")
    with pytest.raises(FoxgloveError, match=str(port)):
        again.start()
    server.stop()
    # The library closes its socket in a thread of its own, a moment after it has reported that it stopped.
    end = time.monotonic() + 10.0
    while not again.address and time.monotonic() < end:
        with contextlib.suppress(FoxgloveError):
            again.start()
    assert again.address.endswith(f":{port}")
    again.stop()
    again.put("/x", TEMPERATURE, b"", 1)


def test_an_address_that_others_can_reach_must_be_meant():
    with pytest.raises(FoxgloveError, match="allow_network"):
        FoxgloveServer(FoxgloveSettings(host="0.0.0.0"), "a")  # noqa: S104  (refused is what is tested)


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    with pytest.raises(FoxgloveError, match="pip install foxglove-sdk"):
        FoxgloveServer(FoxgloveSettings(), "a").start()

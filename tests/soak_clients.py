# SPDX-License-Identifier: Apache-2.0
"""Clients of a running well for the soak test: page, WITS, Modbus, OPC UA and a node that hears every survey."""

from __future__ import annotations

import asyncio
import json
import os
import struct
import threading
import time
import urllib.request
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any

import aiohttp
import asyncua
import rclpy
from mwd_msgs.msg import Survey
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from mwd_surface.rig.modbus.map import COUNT
from mwd_surface.rig.wits.format import Decoder

SILENT_S = 120.0
_WAIT_S = 30.0  # for one answer of a connection
_AGAIN_S = 1.0

Answers = Callable[[], AsyncIterator[None]]


def state_of(page: int) -> Mapping[str, Any]:
    """Tables of the page now; empty where it does not answer."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{page}/state.json", timeout=5) as answer:
            sections: Mapping[str, Any] = json.load(answer)["sections"]
            return sections
    except (OSError, ValueError, KeyError):
        return {}


class Client:
    """A client that connects again whenever its connection ends; counts its answers and its longest silence, s."""

    def __init__(self, name: str, answers: Answers) -> None:
        self.name = name
        self.answers, self.connections = 0, 0
        self.longest = 0.0
        self._ask, self._last = answers, time.monotonic()

    async def run(self) -> None:
        """Ask until cancelled."""
        while True:
            try:
                async for _ in self._ask():
                    now = time.monotonic()
                    self.longest, self._last = max(self.longest, now - self._last), now
                    self.answers += 1
            except (OSError, EOFError, TimeoutError, aiohttp.ClientError, asyncua.ua.UaError, ValueError):
                # The surface was killed; what does not come back is seen by the silence.
                self.connections += 1
            await asyncio.sleep(_AGAIN_S)

    def fault(self) -> str:
        """What is wrong with the connection; "" for nothing."""
        silent = max(self.longest, time.monotonic() - self._last)
        return f"{self.name} was without an answer for {silent:.0f} s" if silent > SILENT_S else ""


class Clients:
    """All clients of a surface, in a thread with a loop of its own."""

    def __init__(self, page: int, wits: int, modbus: int, opcua: int) -> None:
        self.clients = [
            Client("page", lambda: _page(page)),
            Client("WITS", lambda: _wits(wits)),
            Client("Modbus", lambda: _modbus(modbus)),
            Client("OPC UA", lambda: _opcua(opcua)),
        ]
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="clients", daemon=True)
        self._thread.start()

    def stop(self) -> list[str]:
        """End them; returns what was wrong."""
        faults = [fault for client in self.clients if (fault := client.fault())]
        for client in self.clients:
            seen = f"{client.answers} answers, {client.connections} times connected again"
            print(f"{client.name}: {seen}, longest silence {client.longest:.1f} s")
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(10.0)
        return faults

    def _run(self) -> None:
        async def together() -> None:
            self._task = asyncio.current_task()
            # Unlike gather, it waits until each of them has closed its connection.
            async with asyncio.TaskGroup() as group:
                for client in self.clients:
                    group.create_task(client.run())

        try:
            self._loop.run_until_complete(together())
        except asyncio.CancelledError:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())


async def _page(port: int) -> AsyncIterator[None]:
    address = f"http://127.0.0.1:{port}/live"
    async with aiohttp.ClientSession() as session, session.ws_connect(address, autoping=True) as talk:
        while True:
            message = await talk.receive(_WAIT_S)
            if message.type not in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                return
            yield


async def _wits(port: int) -> AsyncIterator[None]:
    decoder = Decoder()
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        while data := await asyncio.wait_for(reader.read(4096), _WAIT_S):
            for _ in decoder.feed(data):
                yield
    finally:
        writer.close()


async def _modbus(port: int) -> AsyncIterator[None]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        while True:
            writer.write(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, COUNT))
            answer = await asyncio.wait_for(reader.readexactly(9 + 2 * COUNT), _WAIT_S)
            if answer[7] != 4:
                raise ValueError(f"exception {answer[8]}")
            yield
            await asyncio.sleep(0.5)
    finally:
        writer.close()


async def _opcua(port: int) -> AsyncIterator[None]:
    async with asyncua.Client(f"opc.tcp://127.0.0.1:{port}/", timeout=10) as client:
        found = await client.nodes.objects.get_children()
        names = [(await node.read_browse_name()).NamespaceIndex for node in found]
        well = found[names.index(max(names))]
        variables = await well.get_variables()
        while True:
            await asyncio.wait_for(client.read_attributes(variables, asyncua.ua.AttributeIds.Value), _WAIT_S)
            yield
            await asyncio.sleep(1.0)


class SurveyListener:
    """A node that hears every survey of the estimator; it is in the same network as the well."""

    def __init__(self, environment: Mapping[str, str], well: str) -> None:
        os.environ.update({k: v for k, v in environment.items() if k.startswith(("ROS_", "AMENT", "FAST"))})
        self.heard: set[str] = set()
        # An interrupt is the soak test's own.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("listener")
        qos = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_subscription(Survey, f"/{well}/survey", lambda got: self.heard.add(got.uuid), qos)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="listener", daemon=True)
        self._thread.start()

    def stop(self) -> set[str]:
        """End the node; returns the surveys it heard."""
        self._executor.shutdown()
        self._thread.join(10.0)
        self._node.destroy_node()
        rclpy.shutdown()
        return self.heard

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

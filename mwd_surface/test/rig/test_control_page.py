# SPDX-License-Identifier: Apache-2.0
"""The controllers of docs/rig/control.md, as they stand there, take and give back control by OPC UA and by Modbus."""

import asyncio
import contextlib
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from example_rig import certified, started, values

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import Achieved, ControlJudgement, ControlRequest, ControlState, Sender
from mwd_surface.rig.modbus.server import ModbusServer, ModbusSettings
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.address_space import NAMESPACE
from mwd_surface.rig.opcua.server import OpcuaServer

PAGE = Path(__file__).resolve().parents[3] / "docs" / "rig" / "control.md"
SETTINGS = ControlSettings(enabled=True, grant="automatic", heartbeat_s=20.0)


def example(title):
    """The program under a heading of the page."""
    section = PAGE.read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL).group(1)


def play(path, title, *arguments):
    """Run the program as somebody who copied it would; what it said."""
    script = path / "controller.py"
    script.write_text(example(title))
    words = [sys.executable, str(script), *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    return done.stdout if done.returncode == 0 else done.stderr


def trusted(folder, name):
    """Certificate and key of a client that the server trusts."""
    certificate, key = asyncio.run(certified(folder, name))
    (folder / "trusted").mkdir(exist_ok=True)
    shutil.copy(certificate, folder / "trusted")
    return certificate, key


@contextlib.contextmanager
def rig(interface, authority):
    """The interface with a rig that obeys, and a node that passes the state on."""
    sent, over = [], threading.Event()

    def work():
        while not over.wait(0.02):
            now = time.monotonic()
            for point in authority.update(now):
                sent.append(point)
                authority.on_acknowledge(point.lease, point.sequence, True, "")
            authority.on_rig(Achieved(speed=0.0), now)
            table = values()
            interface.publish(type(table)(**{**vars(table), "control": authority.status(now)}))

    with started(interface):
        thread = threading.Thread(target=work)
        thread.start()
        try:
            yield sent
        finally:
            over.set()
            thread.join()


@pytest.mark.slow
def test_the_modbus_controller_of_the_page_rotates_and_gives_back(tmp_path):
    authority = ControlAuthority(SETTINGS, first=70_000)
    server = ModbusServer(ModbusSettings(port=0, allow_control=True), authority=authority)
    with rig(server, authority) as sent:
        assert play(tmp_path, "Modbus", "127.0.0.1", server.port, 7) == "done\n"
        assert authority.status(time.monotonic()).state == ControlState.IDLE
        rotates = [point for point in sent if point.mode == Mode.ROTATE]
        assert rotates[0].lease == 70_000
        log = " | ".join(authority.drain_events())
        assert "modbus 7 has control" in log
        assert "modbus 7 gave control back" in log
        authority.request(ControlRequest(Sender("test", "another"), "another", priority=5), time.monotonic())
        assert play(tmp_path, "Modbus", "127.0.0.1", server.port, 7) == "no control: permission 0\n"
        assert authority.status(time.monotonic()).owner == "another"


def test_without_leave_no_register_of_control_is_there():
    from pymodbus.client import ModbusTcpClient

    authority = ControlAuthority(SETTINGS)
    with started(ModbusServer(ModbusSettings(port=0), authority=authority)) as server:
        client = ModbusTcpClient("127.0.0.1", port=server.port)
        client.connect()
        assert client.write_registers(110, [1, 7, 5, 0]).isError()
        client.close()
    assert authority.drain_events() == []


@pytest.mark.slow
def test_the_opcua_controller_of_the_page_rotates_and_gives_back(tmp_path):
    certificate, key = trusted(tmp_path, "controller")
    authority = ControlAuthority(SETTINGS, first=70_000)
    server = OpcuaServer(OpcuaSettings(port=0, allow_control=True), "Well 1", None, tmp_path, authority)
    with rig(server, authority) as sent:
        ends = (server.address, "Well 1", certificate, key, tmp_path / "own.der", "urn:test:controller")
        assert "[True, 'the driller controls top drive and pumps']" in play(tmp_path, "OPC UA", *ends)
        assert next(point.mode for point in sent if point.mode != Mode.RELEASE) == Mode.ROTATE
        assert "my_opcua_controller gave control back: done" in " | ".join(authority.drain_events())
        authority.request(ControlRequest(Sender("test", "another"), "another", priority=5), time.monotonic())
        assert "another has control" in play(tmp_path, "OPC UA", *ends)
        authority.judge(ControlJudgement.ABORT, "driller", time.monotonic())


@pytest.mark.slow
def test_an_opcua_lease_is_of_its_session_and_its_certificate(tmp_path):
    from asyncua import Client, ua
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

    pairs = {name: trusted(tmp_path, name) for name in ("controller", "other")}
    authority = ControlAuthority(SETTINGS)
    server = OpcuaServer(OpcuaSettings(port=0, allow_control=True), "Well 1", None, tmp_path, authority)
    kinds = ua.VariantType

    @contextlib.asynccontextmanager
    async def session(name):
        client = Client(server.address)
        client.application_uri = f"urn:test:{name}"
        own = tmp_path / "own.der"
        await client.set_security(SecurityPolicyBasic256Sha256, *pairs[name], server_certificate=own)
        async with client:
            index = await client.get_namespace_index(NAMESPACE)
            well = await client.nodes.objects.get_child([f"{index}:Well 1"])

            async def call(method, *arguments):
                return await well.call_method(f"{index}:{method}", *arguments)

            yield call

    async def ask(call, name, priority=5):
        wish = ua.Variant(priority, kinds.Byte), ua.Variant(False, kinds.Boolean), ua.Variant(0.0, kinds.Double)
        return await call("request_control", name, "", *wish)

    async def point(call, lease, sequence):
        numbers = ((lease, kinds.UInt32), (sequence, kinds.UInt32), (1, kinds.Byte))
        values = [ua.Variant(value, kinds.Double) for value in (1.0, 0.0, 0.0, 2.0)]
        return await call("set_point", *(ua.Variant(v, k) for v, k in numbers), *values)

    async def play():
        async with session("controller") as owner, session("controller") as again, session("other") as other:
            _, permission, lease = await ask(owner, "autodriller")
            assert permission == 2
            assert (await point(owner, lease, 1))[0]
            for thief in (again, other):
                assert (await ask(thief, "autodriller", 255))[1] == 0
                for sequence in (0, 2):
                    done, why = await point(thief, lease, sequence)
                    assert not done
                    assert f"lease {lease} belongs to autodriller" in why
                assert not (await thief("release_control", ua.Variant(lease, kinds.UInt32), ""))[0]
            assert not (await point(owner, lease, 1))[0]
            assert (await point(owner, lease, 2))[0]

    with started(server):
        asyncio.run(play())

# SPDX-License-Identifier: Apache-2.0
"""The part that all rig interfaces share: a thread that starts or says why not, is woken, and ends."""

import asyncio
import errno
import os
import pty
import re
import socket
import sys
import threading

import pytest
from example_rig import started, values
from waiting import eventually

from mwd_surface.rig.interface import (
    InterfaceError,
    InterfaceStatus,
    RigInterface,
    checked_host,
    optional,
    port_error,
    probe_port,
)
from mwd_surface.rig.modbus.server import ModbusSerial, ModbusSerialSettings, ModbusServer, ModbusSettings
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.server import OpcuaServer
from mwd_surface.rig.polled.unit import PolledSettings, PolledUnit
from mwd_surface.rig.wits.connections import Wits0Serial, Wits0SerialSettings, Wits0Server, Wits0ServerSettings


class Echo(RigInterface):
    """Counts how often it is woken with values."""

    def __init__(self, failure=None):
        super().__init__("echo")
        self.seen = []
        self.on_start = failure
        self.later = None

    async def serve(self, ready, stop):
        if self.on_start is not None:
            raise self.on_start
        ready("here:1")
        while not stop.is_set():
            await self.wake.wait()
            self.wake.clear()
            if self.later is not None:
                raise self.later
            if self.values is not None:
                self.seen.append(self.values.heartbeat)

    def status(self):
        return InterfaceStatus(self.name, "listening" if self.running else "stopped", self.address, self.failure)


def test_it_runs_in_its_own_thread_and_is_woken_by_values():
    echo = Echo()
    echo.publish(values())
    with started(echo):
        assert echo.address == "here:1"
        assert any(t.name == "rig-echo" for t in threading.enumerate())
        echo.publish(values())
        eventually(lambda: echo.seen)
        with pytest.raises(InterfaceError, match="running already"):
            echo.start()
    assert not any(t.name == "rig-echo" for t in threading.enumerate())
    assert not echo.running
    echo.publish(values())
    echo.stop()


@pytest.mark.parametrize("failure", [InterfaceError("no"), OSError(5, "no"), ValueError("no")])
def test_a_failure_at_the_start_is_raised_where_it_was_started(failure):
    echo = Echo(failure)
    with pytest.raises(InterfaceError, match="no"):
        echo.start()
    assert not echo.running
    echo.on_start = None
    with started(echo):
        assert echo.running


def test_a_start_that_takes_too_long_is_given_up():
    class Slow(Echo):
        start_timeout = 0.05

        async def serve(self, _ready, stop):
            await stop.wait()

    slow = Slow()
    with pytest.raises(InterfaceError, match="did not start"):
        slow.start()
    assert not slow.running


@pytest.mark.parametrize("failure", [OSError(5, "the line is cut"), KeyError("the line is cut")])
def test_a_failure_later_is_kept_as_the_reason(failure):
    echo = Echo()
    with started(echo):
        echo.later = failure
        echo.publish(values())
        eventually(lambda: not echo.running)
        assert "the line is cut" in echo.status().reason


def test_an_interface_that_does_not_run_has_nothing_to_wake():
    with pytest.raises(RuntimeError, match="not running"):
        asyncio.run(Echo().wake.wait())


@pytest.mark.fault_case(88)
@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EADDRINUSE, "in use"),
        (errno.EACCES, "1024 or more"),
        (errno.EADDRNOTAVAIL, "not an address of this machine"),
        (errno.ENETDOWN, "Network is down"),
        (errno.EAFNOSUPPORT, "not an address of this machine"),
        (socket.EAI_NONAME, "finds no address for the name"),
    ],
)
def test_what_hinders_a_port_is_reported_in_words(number, words):
    text = str(port_error(OSError(number, "Network is down"), "10.0.0.5", 502))
    assert words in text
    assert "10.0.0.5 port 502" in text


@pytest.mark.fault_case(88)
@pytest.mark.parametrize(
    ("host", "words"),
    [
        ("no-such-host.invalid", "the name 'no-such-host.invalid' may lead to an address that other machines reach"),
        ("rig.example.com", "may lead to an address"),
        ("127.1", "may lead to an address"),
        ("0.0.0.0", "0.0.0.0 can be reached from other machines"),  # noqa: S104
        ("::", ":: can be reached from other machines"),
        ("fe80::1%eth0", "can be reached from other machines"),
        ("192.168.1.7", "can be reached from other machines"),
        ("", "is not an address"),
        (" 127.0.0.1", "is not an address"),
        ("127.0.0.1:8080", "the port in its own setting"),
        ("[::1]", "is not an address"),
        ("http://localhost", "is not an address"),
        ("a..b", "is not an address"),
        ("x" * 64, "is not an address"),
    ],
)
def test_a_host_that_is_not_allowed_is_named_for_what_it_is(host, words):
    with pytest.raises(InterfaceError, match=re.escape(words)):
        checked_host(host, allow_network=False)


@pytest.mark.fault_case(88)
@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "localhost", "LOCALHOST"])
def test_a_host_of_this_machine_alone_is_allowed_and_any_other_where_the_network_is(host):
    assert checked_host(host, allow_network=False) == host
    for reached in (host, "::", "10.0.0.5", "rig.example"):
        assert checked_host(reached, allow_network=True) == reached


def test_a_free_port_is_probed_without_being_kept():
    with socket.create_server(("127.0.0.1", 0)) as holder:
        number = holder.getsockname()[1]
        with pytest.raises(InterfaceError, match="in use"):
            probe_port("127.0.0.1", number)
    probe_port("127.0.0.1", number)
    with pytest.raises(InterfaceError, match="finds no address for the name"):
        probe_port("no-such-host.invalid", 1)


def test_a_missing_package_is_named_with_the_command_that_installs_it():
    assert optional("json", "json", "This").loads("1") == 1
    with pytest.raises(InterfaceError, match=r"This needs the package nowhere, .*pip install nowhere"):
        optional("no_such_module", "nowhere", "This")


SERVERS = {
    "modbus": lambda **given: ModbusServer(ModbusSettings(**given)),
    "opcua": lambda **given: OpcuaServer(OpcuaSettings(**given)),
    "wits": lambda **given: Wits0Server(Wits0ServerSettings(**given)),
}


@pytest.mark.parametrize("name", SERVERS)
def test_every_server_names_a_port_that_is_taken_and_an_address_that_is_not_allowed_or_not_here(name):
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        with pytest.raises(InterfaceError, match=f"port {port} is in use"):
            SERVERS[name](port=port).start()
    # OPC UA asks for its certificates before it listens to a network.
    absent = "certificates" if name == "opcua" else "not an address of this machine"
    for network, words in ((False, "allow_network"), (True, absent)):
        with pytest.raises(InterfaceError, match=words):
            SERVERS[name](port=0, host="192.0.2.1", allow_network=network).start()


@pytest.mark.parametrize(
    ("module", "package", "made"),
    [
        ("pymodbus.server", "pymodbus", SERVERS["modbus"]),
        ("asyncua", "asyncua", SERVERS["opcua"]),
        ("serial", "pyserial", lambda **_: Wits0Serial(Wits0SerialSettings())),
    ],
)
def test_an_interface_without_its_package_says_how_to_install_it(monkeypatch, module, package, made):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InterfaceError, match=f"pip install {package}"):
        made(port=0).start()


@pytest.mark.parametrize(
    "made",
    [
        lambda device: ModbusSerial(ModbusSerialSettings(device=device), ModbusSettings()),
        lambda device: PolledUnit(PolledSettings(device=device)),
    ],
    ids=["modbus", "polled"],
)
def test_a_line_that_goes_away_is_reported_so_that_it_is_opened_anew(made):
    theirs, ours = pty.openpty()
    with started(made(os.ttyname(ours))) as interface:
        eventually(lambda: getattr(interface, "_seen", True))
        os.close(ours)
        os.close(theirs)
        eventually(lambda: interface.status().state == "stopped")
        assert "is gone" in interface.status().reason

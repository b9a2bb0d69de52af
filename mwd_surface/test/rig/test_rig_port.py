# SPDX-License-Identifier: Apache-2.0
"""All rig interfaces: each fails alone and restarts by itself, and missing values are reported."""

import contextlib
import dataclasses
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from example_rig import values
from waiting import eventually

from mwd_sensors.core import settings
from mwd_surface.rig.input import RigInputSettings
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.rig.modbus.map import StatusBit
from mwd_surface.rig.modbus.server import ModbusSettings
from mwd_surface.rig.port import RigPort, RigSettings
from mwd_surface.rig.wits.connections import Wits0ServerSettings
from mwd_surface.rig.wits.format import Decoder
from mwd_surface.rig.wits.link import Wits0Settings


def rig_settings(**changes):
    base = RigSettings(
        wits0_server=Wits0ServerSettings(enabled=True, port=0),
        modbus=ModbusSettings(enabled=True, port=0),
        retry_period=0.05,
        silent_after=0.3,
    )
    return dataclasses.replace(base, **changes)


@contextlib.contextmanager
def running(config, **arguments):
    port = RigPort(config, **arguments)
    port.start()
    try:
        yield port
    finally:
        port.stop()


def state_of(port, name):
    return next(s for s in port.status() if s.name == name)


def test_everything_is_off_until_switched_on():
    port = RigPort(RigSettings())
    assert not port.enabled
    assert port.start() == {}
    assert port.status() == ()
    port.publish(values())
    port.stop()
    every = {name: value for name, (value, _) in settings.flat(RigSettings()).items() if name.endswith("enabled")}
    assert len(every) == 9
    assert not any(every.values())


def test_settings_tell_whether_rig_data_can_come_in():
    assert not rig_settings().takes_data
    assert rig_settings(wits0=Wits0Settings(rig=RigInputSettings(accept=True))).takes_data
    assert rig_settings(modbus=ModbusSettings(enabled=True, allow_writes=True)).takes_data
    assert not RigSettings(modbus=ModbusSettings(allow_writes=True)).takes_data


def test_values_reach_every_interface():
    with running(rig_settings()) as port:
        assert {s.state for s in port.status()} == {"listening"}
        port.publish(values())
        where = state_of(port, "wits0_server").address.split(":")
        with socket.create_connection((where[0], int(where[1])), 5.0) as connection:
            decoder, frames = Decoder(), []
            while not frames:
                frames += decoder.feed(connection.recv(4096))
            assert frames[0].number(713) == 40.0
        eventually(lambda: ("survey", "12") in state_of(port, "modbus").last)


@pytest.mark.fault_case(87)
def test_an_interface_whose_port_is_taken_is_down_while_the_rest_runs_and_comes_up_by_itself():
    holder = socket.create_server(("127.0.0.1", 0))
    number = holder.getsockname()[1]
    config = rig_settings(modbus=ModbusSettings(enabled=True, port=number))
    with running(config) as port:
        down = state_of(port, "modbus")
        assert down.state == "down"
        assert f"port {number} is in use" in down.reason
        assert state_of(port, "wits0_server").state == "listening"
        port.publish(values())
        holder.close()
        eventually(lambda: state_of(port, "modbus").state == "listening")
        eventually(lambda: ("survey", "12") in state_of(port, "modbus").last)


@pytest.mark.fault_case(87)
def test_strict_means_all_or_nothing():
    with socket.create_server(("127.0.0.1", 0)) as holder:
        config = rig_settings(strict=True, modbus=ModbusSettings(enabled=True, port=holder.getsockname()[1]))
        port = RigPort(config)
        with pytest.raises(InterfaceError, match=r"modbus: .*is in use"):
            port.start()
        assert state_of(port, "wits0_server").state == "stopped"


@pytest.mark.fault_case(98)
def test_a_missing_package_is_reported_with_the_way_to_install_it_and_the_rest_runs(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymodbus.server", None)
    with running(rig_settings()) as port:
        assert "pip install pymodbus" in state_of(port, "modbus").reason
        assert state_of(port, "wits0_server").state == "listening"


@pytest.mark.fault_case(98)
@pytest.mark.slow(2)
def test_the_surface_node_loads_without_the_packages_of_its_interfaces():
    hidden = ("asyncua", "pymodbus", "serial")
    code = f"import sys; sys.modules.update(dict.fromkeys({hidden})); import mwd_surface.nodes.surface"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_when_nobody_publishes_every_interface_tells_it():
    with running(rig_settings()) as port:
        port.publish(values())

        def bits():
            return int(dict(state_of(port, "modbus").last)["status"], 2)

        eventually(lambda: bits() >> StatusBit.SONDE_LINK & 1)
        eventually(lambda: not bits() >> StatusBit.SONDE_LINK & 1)
        assert not bits() >> StatusBit.TOOLFACE_FRESH & 1
        assert not bits() >> StatusBit.ACTIVE & 1
        port.publish(values())
        eventually(lambda: bits() >> StatusBit.SONDE_LINK & 1)


def test_every_parameter_that_the_pages_name_exists():
    known = settings.flat(RigSettings())
    folder = Path(__file__).parents[3] / "docs" / "rig"
    pages = [folder / f"{name}.md" for name in ("port", "wits", "opcua", "modbus", "witsml", "ros")]
    named = {name for page in pages for name in re.findall(r"\brig\.([a-z0-9_]+(?:\.[a-z0-9_]+)*)", page.read_text())}
    assert len(named) > 20
    assert {n for n in named if n not in known and not any(k.startswith(n + ".") for k in known)} == set()

# SPDX-License-Identifier: Apache-2.0
"""Two sources of rig data at one surface node: the better one is used, and that they differ is an alarm."""

import socket
import struct
import time

import pytest
from mcap.reader import make_reader
from mwd_msgs.msg import AlarmList, InputList, InputState, RigState
from rclpy.serialization import deserialize_message

import running_graph
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(5)]
KINDS = {"inputs": InputList, "alarms": AlarmList, "rig/state": RigState}


def messages(file):
    """Messages of the recording by topic."""
    found = {name: [] for name in KINDS}
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages([f"/w1/{name}" for name in KINDS]):
            name = channel.topic.removeprefix("/w1/")
            found[name].append(deserialize_message(message.data, KINDS[name]))
    return found


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorder says 1000 m by WITS, a rig system 1012 m by Modbus, until the alarm is there."""
    from pymodbus.client import ModbusTcpClient

    folder = tmp_path_factory.mktemp("inputs")
    settings = {
        "serve_page": False,
        "record__name": "run",
        "rig__wits0_server__enabled": True,
        "rig__wits0_server__port": 0,
        "rig__wits0__rig__accept": True,
        "rig__modbus__enabled": True,
        "rig__modbus__port": 0,
        "rig__modbus__allow_writes": True,
        "rig_sources__settle": 1.0,
    }
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", folder=folder / "data", **settings)
        until(lambda: ": active" in graph.log(surface), 90, "the surface is active")
        status = folder / "data" / "w1" / "rig_status.json"
        table = {row["name"]: row["address"] for row in until(lambda: read(status), 20, "the status file")}
        wits, modbus = (int(table[name].rpartition(":")[2]) for name in ("wits0_server", "modbus"))
        with (
            socket.create_connection(("127.0.0.1", wits)) as recorder,
            ModbusTcpClient("127.0.0.1", port=modbus) as rig,
        ):

            def speak():
                assert not rig.write_registers(100, struct.unpack(">2H", struct.pack(">f", 1012.0))).isError()
                recorder.sendall(b"&&\r\n01081000.0\r\n01101000.0\r\n!!\r\n")
                time.sleep(0.5)
                registers = rig.read_input_registers(70, count=10).registers
                apart = struct.unpack(">f", struct.pack(">2H", *registers[2:4]))[0]
                said.append(apart == pytest.approx(12.0))
                # The alarm comes when they have differed for ten seconds.
                return registers if sum(said) > 25 else None

            said = []
            registers = until(speak, 90, "the alarm")
        assert graph.end(surface)[0] == 0
        (file,) = (folder / "data" / "w1" / "bags" / "run").glob("*.mcap")
        yield messages(file), registers


def read(path):
    """The rows of the status file with a port; nothing before it is there."""
    import json

    if not path.exists():
        return []
    rows = json.loads(path.read_text())["interfaces"]
    return rows if all(row["address"] for row in rows) else []


def test_the_source_of_the_higher_priority_is_in_force_and_both_are_recorded(run):
    found, _ = run
    rows = {row.name: row for row in found["inputs"][-1].inputs}
    assert {message.header.frame_id for message in found["rig/state"]} == {"w1/rig_wits", "w1/rig_modbus"}
    assert found["inputs"][-1].depth_source == "rig_wits"
    assert found["inputs"][-1].depth_difference == pytest.approx(12.0)
    assert (rows["rig_wits"].role, rows["rig_modbus"].role) == (InputState.IN_FORCE, InputState.STANDBY)
    assert {row.clock for name, row in rows.items() if name.startswith("rig_")} == {InputState.HOST}
    assert all(0.0 <= row.data_age < 5.0 for name, row in rows.items() if name.startswith("rig_"))


def test_that_the_sources_differ_is_an_alarm_and_stands_in_the_registers(run):
    found, registers = run
    assert any(alarm.id == "depth.sources" for message in found["alarms"] for alarm in message.alarms)
    assert struct.unpack(">f", struct.pack(">2H", *registers[2:4]))[0] == pytest.approx(12.0)
    # Depth by WITS, its data stamped by the surface; nothing of a sonde.
    assert registers[8:] == [4, 0x00FF]

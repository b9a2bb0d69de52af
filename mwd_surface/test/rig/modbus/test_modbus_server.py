# SPDX-License-Identifier: Apache-2.0
"""Modbus TCP: what others' clients read, what is refused and how, and that no block is ever torn."""

import contextlib
import dataclasses
import importlib.metadata
import math
import os
import select
import shutil
import socket
import struct
import subprocess
import threading
from pathlib import Path

import pytest
from example_rig import extended, pseudo_terminal, started, values
from hypothesis import given, settings
from hypothesis import strategies as st
from waiting import eventually

from mwd_surface.rig.interface import InterfaceError
from mwd_surface.rig.modbus.map import COUNT, VERSION, ModbusForm, float_of
from mwd_surface.rig.modbus.server import ModbusSerial, ModbusSerialSettings, ModbusServer, ModbusSettings

PEERS = Path(__file__).parents[2] / "peers"


def server(on_rig_state=None, **changes):
    return ModbusServer(ModbusSettings(port=0, **changes), on_rig_state)


@contextlib.contextmanager
def serving(on_rig_state=None, **changes):
    """A server that has its first values."""
    with started(server(on_rig_state, **changes)) as s:
        s.publish(values())
        eventually(lambda: ask(s.port, 4, 3, 1)[2:] == b"\x00\x0c")
        yield s


@pytest.fixture(scope="module")
def served():
    """One server for the tests that only ask."""
    with serving() as s:
        yield s


def request(connection, function, address, count, unit=1, body=b""):
    """One exchange of bytes by the book (Modbus application protocol 1.1b3); the answer from its function code on."""
    pdu = struct.pack(">BHH", function, address, count) + body
    connection.sendall(struct.pack(">HHHB", 7, 0, len(pdu) + 1, unit) + pdu)
    head = b""
    while len(head) < 7:
        piece = connection.recv(7 - len(head))
        assert piece, "the server ended the connection"
        head += piece
    (length,) = struct.unpack(">H", head[4:6])
    answer = b""
    while len(answer) < length - 1:
        answer += connection.recv(length - 1 - len(answer))
    return answer


def ask(port, function, address, count, unit=1, body=b""):
    with socket.create_connection(("127.0.0.1", port), 5.0) as connection:
        return request(connection, function, address, count, unit, body)


def test_the_whole_map_is_read_at_once(served):
    block = struct.unpack(f">{COUNT}H", ask(served.port, 4, 0, COUNT)[2:])
    assert block[0] == VERSION
    assert float_of(block[10:12], ModbusForm()) == pytest.approx(40.0)


@pytest.mark.fault_case(89)
@pytest.mark.parametrize(
    ("function", "address", "count", "unit", "code"),
    [
        (4, COUNT, 1, 1, 2),
        (4, COUNT - 8, 9, 1, 2),
        (4, 60000, 10, 1, 2),
        (4, 0, 126, 1, 3),
        (4, 0, 65535, 1, 3),
        (4, 0, 0, 1, 3),
        (4, 0, 2, 9, 2),
        (3, 0, 2, 1, 1),
        (1, 0, 2, 1, 1),
        (3, 100, 2, 1, 2),
        (6, 4, 99, 1, 1),
        (6, 100, 99, 1, 2),
    ],
)
def test_what_is_not_on_the_map_is_refused_with_the_exception_for_it(served, function, address, count, unit, code):
    before = ask(served.port, 4, 2, 36)
    assert ask(served.port, function, address, count, unit) == bytes([function | 0x80, code])
    assert ask(served.port, 4, 2, 36) == before


@pytest.mark.fault_case(89)
@given(function=st.integers(0, 127).filter(lambda f: f not in (1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43)), body=st.binary())
@settings(max_examples=60, deadline=None)
def test_a_function_that_is_not_served_gets_exception_1_of_that_function(served, function, body):
    """Function 24 was answered with four example values, and unknown functions with exception 1 of function 0."""
    pdu = bytes([function]) + body[:200]
    with socket.create_connection(("127.0.0.1", served.port), 5.0) as connection:
        connection.sendall(struct.pack(">HHHB", 9, 0, len(pdu) + 1, 1) + pdu)
        assert connection.recv(300) == struct.pack(">HHHBBB", 9, 0, 3, 1, function | 0x80, 1)


@pytest.mark.fault_case(89)
def test_an_unserved_function_is_not_answered_with_values_when_requests_come_in_one_piece(served):
    read, queue = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, 1), struct.pack(">HHHBBH", 2, 0, 4, 1, 24, 0)
    with socket.create_connection(("127.0.0.1", served.port), 5.0) as connection:
        connection.sendall(queue + read)
        assert received(connection, 9 + 11)[:9] == struct.pack(">HHHBBB", 2, 0, 3, 1, 24 | 0x80, 1)


def received(connection, length):
    """The next bytes of a connection, this many."""
    got = b""
    while len(got) < length:
        piece = connection.recv(length - len(got))
        assert piece, "the server ended the connection"
        got += piece
    return got


@given(cuts=st.lists(st.integers(0, 12 * 8), max_size=5).map(sorted))
@settings(max_examples=20, deadline=None)
def test_requests_are_all_answered_in_order_however_the_stream_is_cut(served, cuts):
    """Requests that came with another one were lost; after a part of a request the connection gave no answers."""
    stream = b"".join(struct.pack(">HHHBBHH", number, 0, 6, 1, 4, 3, 1) for number in range(8))
    with socket.create_connection(("127.0.0.1", served.port), 5.0) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
            connection.sendall(stream[begin:end])
        answers = received(connection, 11 * 8)
        assert [struct.unpack_from(">H", answers, 11 * k)[0] for k in range(8)] == list(range(8))
        assert request(connection, 4, 3, 1)[2:] == b"\x00\x0c"


def test_a_client_that_asks_and_never_reads_is_cut_off(served):
    ask_all = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, COUNT)
    with socket.create_connection(("127.0.0.1", served.port), 5.0) as connection, pytest.raises(OSError):  # noqa: PT012
        for _ in range(100_000):
            connection.sendall(ask_all)
    eventually(lambda: not served.status().peers)


@pytest.mark.fault_case(89)
def test_a_write_of_many_registers_changes_nothing():
    with serving() as s:
        body = b"\x04" + struct.pack(">f", 1.0)
        assert ask(s.port, 16, 4, 2, body=body)[0] == 0x90
        assert ask(s.port, 16, 100, 2, body=body)[0] == 0x90
        assert s.status().state == "listening"
        assert dict(s.status().counts)["denied"] >= 1


def test_a_bit_depth_is_taken_where_writing_is_allowed_and_only_a_whole_plausible_one():
    taken = []
    with serving(taken.append, allow_writes=True) as s:

        def write(value):
            return ask(s.port, 16, 100, 2, body=b"\x04" + struct.pack(">f", value))

        assert write(1234.5)[0] == 16
        eventually(lambda: taken)
        assert (float(taken[0]["bit_depth"][0]), int(taken[0]["valid"][0])) == (1234.5, 1)
        assert ask(s.port, 3, 100, 2)[2:] == struct.pack(">f", 1234.5)
        for bad in (math.nan, math.inf, -5.0, 1e9):
            assert write(bad) == b"\x90\x03"
        assert ask(s.port, 6, 100, 7) == b"\x86\x03"
        assert ask(s.port, 16, 100, 1, body=b"\x02\x00\x00") == b"\x90\x03"
        assert ask(s.port, 4, 100, 2) == b"\x84\x02"
        assert len(taken) == 1


@pytest.mark.slow
def test_no_reader_ever_sees_half_of_a_change():
    with serving() as s:
        one, two = values(), values(later=0.5)
        two = dataclasses.replace(two, surveys=two.surveys[:-1], heartbeat=7)
        ended = threading.Event()

        def change():
            while not ended.is_set():
                s.publish(one)
                s.publish(two)

        writer = threading.Thread(target=change)
        writer.start()
        try:
            with socket.create_connection(("127.0.0.1", s.port), 5.0) as connection:
                seen = {request(connection, 4, 0, COUNT) for _ in range(400)}
        finally:
            ended.set()
            writer.join()
        numbers = {struct.unpack(f">{COUNT}H", a[2:])[3] for a in seen}
        assert len(seen) <= 2
        assert numbers <= {11, 12}


def test_too_many_connections_are_turned_away_and_idle_ones_closed():
    with serving(max_clients=3, idle_timeout=1.0) as s, contextlib.ExitStack() as stack:
        eventually(lambda: not s.status().peers)
        held = [stack.enter_context(socket.create_connection(("127.0.0.1", s.port), 5.0)) for _ in range(3)]
        eventually(lambda: len(s.status().peers) == 3)
        for _ in range(100):
            with socket.create_connection(("127.0.0.1", s.port), 5.0) as extra:
                assert extra.recv(10) == b""
        assert s.refused == 100
        for connection in held:
            assert connection.recv(10) == b""
        eventually(lambda: not s.status().peers)
        assert ask(s.port, 4, 0, 1)[0] == 4


def test_junk_on_a_connection_leaves_the_others_alone(served):
    with socket.create_connection(("127.0.0.1", served.port), 5.0) as good:
        with socket.create_connection(("127.0.0.1", served.port), 5.0) as bad:
            bad.sendall(b"\xff" * 5000)
            bad.sendall(b"GET / HTTP/1.1\r\n\r\n")
        assert request(good, 4, 0, 1)[0] == 4


def test_an_older_pymodbus_is_named_with_the_version_that_serves(monkeypatch):
    monkeypatch.setattr(importlib.metadata, "version", lambda _package: "3.11.3")
    with pytest.raises(InterfaceError, match=r"pymodbus 3\.13 or later, and 3\.11\.3 is installed"):
        server().start()


def test_it_starts_again_after_a_stop():
    s = server()
    for _ in range(2):
        with started(s):
            s.publish(values())
            eventually(lambda: ask(s.port, 4, 3, 1)[2:] == b"\x00\x0c")


def test_pymodbustcp_reads_the_same(served):
    import pyModbusTCP.client as theirs

    client = theirs.ModbusClient(host="127.0.0.1", port=served.port, unit_id=1, auto_close=True)
    block = client.read_input_registers(0, COUNT)
    assert float_of(block[14:16], ModbusForm()) == pytest.approx(630.0)
    assert client.read_input_registers(COUNT, 1) is None
    assert client.last_except == 2
    client.close()


def said(*words):
    """What a program of others says."""
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def mbpoll(*words):
    """The two floats from register 11 on, read by mbpoll: it counts from 1, and -B are big-endian words."""
    program = shutil.which("mbpoll")
    if program is None:
        pytest.skip("mbpoll is not installed: apt install mbpoll")
    lines = said(program, *words[:-1], "-a", "1", "-t", "3:float", "-B", "-r", "11", "-c", "2", "-1", words[-1])
    return [float(line.split()[1]) for line in lines.splitlines() if line.startswith("[")]


def test_mbpoll_reads_the_same(served):
    assert mbpoll("-m", "tcp", "-p", served.port, "127.0.0.1") == pytest.approx([40.0, 79.8])


def test_modbus_serial_of_node_reads_the_same(served):
    node = shutil.which("node")
    if node is None or not (PEERS / "node_modules" / "modbus-serial").exists():
        pytest.skip("node or modbus-serial is not there: npm install --prefix mwd_surface/test/peers")
    version, *numbers, refused = said(node, PEERS / "modbus_read.js", served.port, COUNT).split()
    assert (int(version), int(refused)) == (VERSION, 2)
    assert [float(number) for number in numbers] == pytest.approx([40.0, 79.8, 630.0])


@contextlib.contextmanager
def on_a_line(on_rig_state=None, **changes):
    """The serial server with its first values, and a descriptor of the line's other end."""
    with pseudo_terminal() as (theirs, device):
        serial = ModbusSerial(ModbusSerialSettings(device=device), ModbusSettings(**changes), on_rig_state)
        with started(serial) as s:
            s.publish(values())
            eventually(lambda: rtu(theirs, 4, 3, 1)[2:] == b"\x00\x0c")
            yield s, theirs


def crc(frame):
    """Check of an RTU frame (Modbus over serial line 1.02, section 6.2.2), lowest byte first."""
    check = 0xFFFF
    for byte in frame:
        check ^= byte
        for _ in range(8):
            check = (check >> 1) ^ (0xA001 if check & 1 else 0)
    return struct.pack("<H", check)


def rtu(line, function, address, count, unit=1, body=b"", within=5.0):
    """One exchange over the line; the answer from its function code on, empty where none comes in time."""
    frame = struct.pack(">BBHH", unit, function, address, count) + body
    os.write(line, frame + crc(frame))
    answer = b""
    while select.select([line], [], [], within)[0]:
        answer += os.read(line, 4096)
        if len(answer) > 4 and crc(answer[:-2]) == answer[-2:]:
            assert answer[0] == unit
            return answer[1:-2]
    assert answer == b""
    return b""


def test_over_a_serial_line_the_same_map_is_read_and_refused():
    with on_a_line() as (s, line):
        answer = rtu(line, 4, 0, COUNT)
        assert answer[:2] == bytes((4, 2 * COUNT))
        assert struct.unpack(f">{COUNT}H", answer[2:]) == s._block
        assert rtu(line, 4, COUNT, 1) == b"\x84\x02"
        assert rtu(line, 3, 0, 1) == b"\x83\x01"
        assert s.status().peers[0].address == s.line.device


def test_on_a_shared_line_requests_to_other_units_are_left_to_them():
    with on_a_line() as (_, line):
        assert rtu(line, 4, 0, 4, unit=2, within=0.3) == b""
        assert rtu(line, 4, 3, 1)[2:] == b"\x00\x0c"


def test_a_bit_depth_is_taken_over_the_line_where_writing_is_allowed():
    taken = []
    with on_a_line(taken.append, allow_writes=True) as (_, line):
        assert rtu(line, 16, 100, 2, body=b"\x04" + struct.pack(">f", 1234.5))[0] == 16
        eventually(lambda: taken)
        assert float(taken[0]["bit_depth"][0]) == 1234.5


def test_a_line_that_is_not_there_is_named():
    with pytest.raises(InterfaceError, match="no-such-line"):
        ModbusSerial(ModbusSerialSettings(device="/dev/no-such-line"), ModbusSettings()).start()


def test_mbpoll_reads_the_same_over_a_line():
    with on_a_line() as (_, line), extended(line) as device:
        assert mbpoll("-m", "rtu", "-b", "19200", "-P", "none", device) == pytest.approx([40.0, 79.8])

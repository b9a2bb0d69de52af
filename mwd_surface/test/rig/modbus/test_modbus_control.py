# SPDX-License-Identifier: Apache-2.0
"""Control over Modbus under attack: whatever masters write, only a whole block of the owner moves the rig."""

import contextlib
import gc
import socket
import struct
import threading
import time

import pytest
from example_rig import started, values
from hypothesis import given, settings
from hypothesis import strategies as st
from waiting import eventually

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import Permission
from mwd_surface.rig.modbus.server import COMMAND, COMMAND_COUNT, REQUEST, REQUEST_COUNT, ModbusServer, ModbusSettings

pytestmark = pytest.mark.fault_case(89)
BLOCKS = {REQUEST: REQUEST_COUNT, COMMAND: COMMAND_COUNT}
WRITE = 16
BOUNDED = settings(max_examples=max(settings().max_examples // 2, 25))


@contextlib.contextmanager
def serving():
    authority = ControlAuthority(ControlSettings(enabled=True, grant="automatic", heartbeat_s=60.0))
    server = ModbusServer(ModbusSettings(port=0, allow_control=True, allow_writes=True), None, authority)
    with started(server) as s:
        s.publish(values())
        yield s, authority


class Master:
    """A master with a connection that is made anew whenever the server ends it."""

    def __init__(self, port):
        self.port, self.talk = port, None

    def send(self, pdu, wait=5.0):
        """Answer to a PDU from its function code on; empty where the server gives none."""
        if self.talk is None:
            self.talk = socket.create_connection(("127.0.0.1", self.port), 5.0)
        self.talk.settimeout(wait)
        try:
            self.talk.sendall(struct.pack(">HHHB", 7, 0, len(pdu) + 1, 1) + pdu)
            return self.talk.recv(300)[7:]
        except OSError:
            self.close()
            return b""

    def write(self, address, *words):
        return self.send(struct.pack(f">BHHB{len(words)}H", WRITE, address, len(words), 2 * len(words), *words))

    def ask_for_control(self, number, priority=50):
        """The lease granted, as two words; None where the answer is no."""
        self.write(REQUEST, 1, number, priority, 0)
        answered, permission, *lease = self.answer()
        assert answered == number
        return lease if permission == Permission.GRANTED else None

    def answer(self):
        """Number answered, permission and lease as two words."""
        return struct.unpack(">4H", self.send(struct.pack(">BHH", 3, REQUEST + 4, 4))[2:])

    def rotate(self, lease, sequence, rpm=60.0):
        speed, valid_for = (struct.unpack(">2H", struct.pack(">f", number)) for number in (rpm, 30.0))
        return self.write(COMMAND, *lease, sequence, Mode.ROTATE, *speed, 0, 0, 0, 0, *valid_for)

    def close(self):
        if self.talk is not None:
            self.talk.close()
        self.talk = None


def commanded(authority):
    """Who has control, and what was commanded last."""
    now = authority.status(time.monotonic())
    return now.lease, now.owner, now.sequence, now.mode


def addressed(function):
    """Requests of a function to registers in and around the map, with as many bytes as they say, or not."""
    near = st.one_of(st.integers(95, 140), st.integers(0, 0xFFFF))
    body = st.one_of(st.binary(max_size=40), st.integers(0, 14).map(lambda n: bytes([2 * n]) + b"\x00\x01" * n))
    return st.builds(lambda at, n, more: struct.pack(">BHH", function, at, n) + more, near, st.integers(0, 130), body)


ATTACKS = st.one_of(
    *(addressed(function) for function in (1, 2, 3, 4, 5, 6, 15, WRITE, 22, 23)),
    st.binary(min_size=1, max_size=60),
)


def is_whole_block(pdu):
    """Whether it writes a block of control from its first register to its last."""
    if len(pdu) < 6 or pdu[0] != WRITE:
        return False
    address, count = struct.unpack(">HH", pdu[1:5])
    return BLOCKS.get(address) == count and pdu[5] == 2 * count


@pytest.mark.fuzz
def test_no_request_but_a_whole_block_changes_who_has_control_or_what_is_commanded():
    with serving() as (s, authority):
        owner, attacker = Master(s.port), Master(s.port)
        lease = owner.ask_for_control(1)
        assert owner.rotate(lease, 1)[0] == WRITE
        before = commanded(authority)

        @BOUNDED
        @given(pdu=ATTACKS)
        def attack(pdu):
            attacker.send(pdu, wait=0.2)
            attacker.close()
            if is_whole_block(pdu):
                return
            assert commanded(authority) == before

        attack()
        assert owner.rotate(lease, 2)[0] == WRITE
        owner.close()


def test_each_connection_reads_the_answer_to_its_own_request_and_a_new_one_the_last():
    with serving() as (s, _):
        masters = {number: Master(s.port) for number in (1, 2, 3)}
        for number in (1, 2):
            masters[number].write(REQUEST, 1, number, 50, 0)
        read = {number: master.answer()[:2] for number, master in masters.items()}
        assert read == {1: (1, Permission.GRANTED), 2: (2, Permission.DENIED), 3: (2, Permission.DENIED)}
        for master in masters.values():
            master.close()


@pytest.mark.slow
def test_the_answer_to_a_master_that_hung_up_at_once_is_not_kept_for_another():
    with serving() as (s, _):
        # Control goes to the first, so that answers differ; the rest do not wait for theirs.
        first = Master(s.port)
        first.ask_for_control(1)
        for number in range(2, 32):
            words = struct.pack(">BHHB4H", WRITE, REQUEST, 4, 8, 1, number, 50, 0)
            with socket.create_connection(("127.0.0.1", s.port), 5.0) as talk:
                talk.sendall(struct.pack(">HHHB", 7, 0, len(words) + 1, 1) + words)
        first.close()
        assert eventually(lambda: not s.status().peers)
        # Freed connections give their places to new ones.
        gc.collect()
        last = Master(s.port)
        last.ask_for_control(99)
        # All others are new, and read the last answer.
        others = [Master(s.port) for _ in range(12)]
        assert {master.answer()[0] for master in others} == {99}
        for master in (last, *others):
            master.close()


def test_a_lease_is_of_its_connection_and_its_number_opens_nothing_to_another():
    with serving() as (s, authority):
        owner, other = Master(s.port), Master(s.port)
        lease = owner.ask_for_control(1)
        refused = bytes((WRITE | 0x80, 3))
        assert owner.rotate(lease, 1)[0] == WRITE
        # As the owner, by its number, at any priority; its lease and its release.
        assert [other.ask_for_control(1, priority) for priority in (0, 255)] == [None, None]
        assert other.rotate(lease, 2) == refused
        assert other.rotate(lease, 0) == refused
        assert other.write(REQUEST, 2, 1, 0, 0) == refused
        # The owner repeats no number, and is not another master.
        assert owner.rotate(lease, 1) == refused
        assert owner.ask_for_control(2) is None
        assert owner.rotate(lease, 0)[0] == WRITE
        status = authority.status(time.monotonic())
        assert (status.owner, status.sequence) == ("modbus 1", 1)
        # A connection that is made again is another one.
        owner.close()
        assert owner.rotate(lease, 2) == refused
        for master in (owner, other):
            master.close()


def test_of_two_masters_at_once_one_has_control_and_the_other_is_refused_with_an_exception():
    with serving() as (s, authority):
        granted, answers, start = {1: None, 2: None}, {1: [], 2: []}, threading.Barrier(2)

        def play(number):
            master = Master(s.port)
            start.wait()
            for k in range(40):
                granted[number] = master.ask_for_control(number) or granted[number]
                answers[number].append(master.rotate(granted[number] or (0, 0), k + 1))
            master.close()

        threads = [threading.Thread(target=play, args=(number,)) for number in granted]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
        owner = authority.status(time.monotonic()).owner
        winner, loser = (1, 2) if owner == "modbus 1" else (2, 1)
        assert owner == f"modbus {winner}"
        assert granted[loser] is None
        assert set(answers[loser]) == {bytes((WRITE | 0x80, 3))}
        assert answers[winner][-1] == struct.pack(">BHH", WRITE, COMMAND, COMMAND_COUNT)
        assert authority.status(time.monotonic()).sequence == len(answers[winner])

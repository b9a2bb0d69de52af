# SPDX-License-Identifier: Apache-2.0
"""The calling side of WITS, over TCP and over a serial line: it comes back by itself, with waits that grow."""

import contextlib
import os
import socket

import pytest
from example_rig import pseudo_terminal, started, values
from hypothesis import given
from hypothesis import strategies as st
from waiting import eventually

from mwd_surface.rig.input import RigInputSettings
from mwd_surface.rig.interface import Backoff
from mwd_surface.rig.wits.connections import Wits0Client, Wits0ClientSettings, Wits0Serial, Wits0SerialSettings
from mwd_surface.rig.wits.format import Decoder
from mwd_surface.rig.wits.link import Wits0Settings

FAST = Backoff(first=0.01, longest=0.05)
ACCEPT = Wits0Settings(rig=RigInputSettings(accept=True))


def client(listener, *more):
    return Wits0Client(Wits0ClientSettings(port=listener.getsockname()[1], backoff=FAST), *more)


def frames_until(read, wanted):
    decoder, frames = Decoder(), []
    while not any(i.code == wanted for f in frames for i in f.items):
        data = read()
        assert data, "the other side ended"
        frames += decoder.feed(data)
    return frames


@contextlib.contextmanager
def recorder(port=0):
    """A recorder that listens, on a port of its own or the given one."""
    with socket.create_server(("127.0.0.1", port)) as listener:
        listener.settimeout(5.0)
        yield listener


@pytest.mark.fault_case(75)
@given(
    failures=st.integers(1, 10_000),
    first=st.floats(0.01, 60.0),
    longest=st.floats(0.01, 600.0),
)
def test_waits_double_up_to_the_longest_wait_and_are_shortened_by_up_to_half(failures, first, longest):
    wait = Backoff(first, longest).wait(failures)
    whole = min(longest, first * 2.0 ** min(failures - 1, 30))
    assert 0.5 * whole <= wait <= whole <= longest


def test_it_connects_sends_and_takes_rig_data_back():
    taken = []
    with recorder() as listener, started(client(listener, ACCEPT, taken.append)) as calling:
        connection, _ = listener.accept()
        connection.settimeout(5.0)
        with connection:
            calling.publish(values())
            frames = frames_until(lambda: connection.recv(4096), 717)
            assert any(f.number(713) == 40.0 for f in frames)
            connection.sendall(b"&&\r\n01081234.5\r\n!!\r\n")
            eventually(lambda: taken)
            assert float(taken[0]["bit_depth"][0]) == 1234.5
            assert calling.status().state == "connected"


@pytest.mark.fault_case(75)
def test_a_link_that_drops_again_and_again_is_taken_up_again_each_time():
    with recorder() as listener, started(client(listener)) as calling:
        calling.publish(values())
        for _ in range(5):
            connection, _ = listener.accept()
            frames_until(lambda connection=connection: connection.recv(4096), 713)
            connection.close()
        eventually(lambda: calling.status().sent >= 5)
        assert dict(calling.status().counts)["connections"] >= 5


def test_a_recorder_that_is_not_there_is_reported_and_it_goes_on_trying():
    with recorder() as listener:
        port, absent = listener.getsockname()[1], client(listener)
    with started(absent) as calling:
        eventually(lambda: calling.failures >= 3)
        assert calling.status().state == "connecting"
        assert str(port) in calling.status().reason
        with recorder(port) as listener:
            connection, _ = listener.accept()
            connection.close()


def test_a_serial_line_carries_the_same_both_ways():
    taken = []
    with pseudo_terminal() as (ours, device):
        settings = Wits0SerialSettings(device=device, backoff=FAST)
        with started(Wits0Serial(settings, ACCEPT, taken.append)) as line:
            line.publish(values())
            frames = frames_until(lambda: os.read(ours, 4096), 717)
            assert any(f.number(713) == 40.0 for f in frames)
            os.write(ours, b"&&\r\n01081234.5\r\n0121150")
            os.write(ours, b"00\r\n!!\r\n")
            eventually(lambda: taken)
            assert float(taken[0]["pressure"][0]) == 1.5e7
            assert line.status().state == "connected"


def test_a_serial_device_that_is_not_there_is_reported_and_tried_again():
    with started(Wits0Serial(Wits0SerialSettings(device="/dev/no-such-line", backoff=FAST))) as line:
        eventually(lambda: line.failures >= 2)
        assert "/dev/no-such-line" in line.status().reason

# SPDX-License-Identifier: Apache-2.0
"""The listening side of WITS: every peer gets every packet, none can hold up another, junk is survived."""

import contextlib
import dataclasses
import socket
import threading

import pytest
from example_rig import started, values
from example_surveys import survey, surveys
from waiting import eventually

from mwd_surface.rig.input import RigInputSettings
from mwd_surface.rig.wits.connections import Wits0Server, Wits0ServerSettings
from mwd_surface.rig.wits.format import Decoder
from mwd_surface.rig.wits.link import Wits0Settings

ACCEPT = Wits0Settings(rig=RigInputSettings(accept=True))


def server(talk=None, on_rig_state=None, **changes):
    return Wits0Server(Wits0ServerSettings(port=0, **changes), talk, on_rig_state)


@contextlib.contextmanager
def peer(port, receive_buffer=None):
    with socket.socket() as connection:
        if receive_buffer:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        connection.settimeout(5.0)
        connection.connect(("127.0.0.1", port))
        yield connection


def read_until(connection, wanted):
    """Frames up to and with the first that has the code."""
    decoder, frames = Decoder(), []
    while not any(i.code == wanted for f in frames for i in f.items):
        data = connection.recv(4096)
        assert data, "the server ended the connection"
        frames += decoder.feed(data)
    return frames


def ended(connection):
    """True once the other side closed."""
    with contextlib.suppress(ConnectionResetError):
        while connection.recv(4096):
            continue
    return True


def test_every_peer_gets_every_packet_and_a_new_survey_at_once():
    with started(server()) as s, peer(s.port) as one, peer(s.port) as two:
        eventually(lambda: s.peers == 2)
        s.publish(values())
        for connection in (one, two):
            codes = {i.code for f in read_until(connection, 111) for i in f.items}
            assert {717, 808, 919, 111} <= codes
        s.publish(values(surveys().add(survey(13, 44.0, 80.0), 660.0, 0.4)))
        for connection in (one, two):
            frame = read_until(connection, 713)[-1]
            assert (frame.number(708), frame.number(713)) == (660.0, 44.0)
        eventually(lambda: s.status().sent >= 10)


def test_a_peer_that_comes_later_gets_the_last_survey_first():
    with started(server()) as s:
        s.publish(values())
        with peer(s.port) as late:
            assert read_until(late, 713)[0].number(708) == 630.0


def test_it_starts_again_after_a_stop():
    s = server()
    for _ in range(2):
        with started(s), peer(s.port) as one:
            s.publish(values())
            read_until(one, 717)
    assert s.status().state == "stopped"


@pytest.mark.fault_case(71)
def test_a_peer_that_never_reads_loses_the_oldest_is_cut_off_and_delays_nobody():
    talk = Wits0Settings(queue_bytes=4096, send_timeout=1.0)
    with started(server(talk)) as s, peer(s.port, receive_buffer=2048) as deaf, peer(s.port) as good:
        eventually(lambda: s.peers == 2)
        got = threading.Event()

        def listen():
            with contextlib.suppress(OSError):
                while good.recv(65536):
                    got.set()

        reader = threading.Thread(target=listen)
        reader.start()
        table = values()
        number = iter(range(10**6))

        def flood():
            record = table.survey.record
            record = dataclasses.replace(record, survey=dataclasses.replace(record.survey, uuid=str(next(number))))
            news = dataclasses.replace(table.survey, record=record)
            s.publish(dataclasses.replace(table, surveys=(news,)))
            return s.cut_off == 1

        eventually(flood)
        assert got.is_set()
        eventually(lambda: s.peers == 1)
        status = s.status()
        assert status.dropped > 0
        assert status.peers[0].dropped == 0
        assert ended(deaf)
    reader.join(timeout=5.0)
    assert not reader.is_alive()


def test_junk_is_survived_and_counted_and_a_good_frame_after_it_is_read():
    with started(server()) as s, peer(s.port) as one:
        one.sendall(b"\0\xff&" * 3000 + b"&&\r\n" + b"x" * 100_000 + b"&&\r\n0108100\r\n!!\r\n")
        eventually(lambda: s.status().received == 1)
        counts = dict(s.status().counts)
        assert counts["broken_frames"] >= 1
        assert counts["junk_bytes"] > 0
        s.publish(values())
        read_until(one, 717)


def test_the_keep_alive_of_a_recorder_is_no_data():
    taken = []
    with started(server(ACCEPT, taken.append)) as s, peer(s.port) as one:
        one.sendall(b"&&\r\n1984PASON/EDR\r\n0111-9999\r\n!!\r\n&&\r\n0108-9999\r\n!!\r\n")
        eventually(lambda: s.status().received == 2)
        assert taken == []


def test_rig_data_are_handed_on_from_one_peer_only_and_only_when_accepted():
    taken = []
    with started(server(ACCEPT, taken.append)) as s, peer(s.port) as one, peer(s.port) as two:
        one.sendall(b"&&\r\n01082214.3\r\n01102215.0\r\n0120120\r\n!!\r\n")
        eventually(lambda: len(taken) == 1)
        assert float(taken[0]["bit_depth"][0]) == 2214.3
        assert int(taken[0]["valid"][0]) == 1 | 2 | 64
        two.sendall(b"&&\r\n0108100.0\r\n!!\r\n")
        eventually(lambda: dict(s.status().counts)["rig_strangers"] == 1)
        assert len(taken) == 1
    with started(server(on_rig_state=taken.append)) as s, peer(s.port) as one:
        one.sendall(b"&&\r\n01082214.3\r\n!!\r\n")
        eventually(lambda: s.status().received == 1)
        assert len(taken) == 1


@pytest.mark.fault_case(76)
def test_five_hundred_connections_leave_those_that_are_served_alone():
    with started(server(max_clients=4, max_per_peer=4)) as s, contextlib.ExitStack() as stack:
        served = [stack.enter_context(peer(s.port)) for _ in range(4)]
        eventually(lambda: s.peers == 4)
        for _ in range(500):
            with peer(s.port) as extra:
                assert ended(extra)
        assert s.refused == 500
        s.publish(values())
        for connection in served:
            read_until(connection, 717)


def test_a_connection_from_one_address_too_many_is_turned_away_and_its_place_comes_free():
    with started(server(max_per_peer=1)) as s:
        with peer(s.port) as one, peer(s.port) as two:
            assert ended(two)
            assert s.peers == 1
            one.close()
        eventually(lambda: s.peers == 0)
        with peer(s.port) as again:
            s.publish(values())
            read_until(again, 717)


def test_the_independent_reader_of_witskit_gets_surveys_and_its_handshake_is_no_data():
    import witskit.transport.tcp_reader as reader
    from witskit.decoder.wits_decoder import decode_frame as decode

    with started(server()) as s:
        s.publish(values())
        client = reader.TCPReader("127.0.0.1", s.port)
        stream = client.stream()
        frames = [next(stream) for _ in range(2)]
        eventually(lambda: s.status().received == 1)
        stream.close()
    decoded = [decode(f, use_metric_units=True, strict_mode=False) for f in frames]
    first = {d.symbol_code: d.parsed_value for d in decoded[0].data_points}
    assert (first["0708"], first["0713"], first["0715"]) == (630.0, 40.0, 79.8)
    assert any(d.symbol_code == "0717" for f in decoded for d in f.data_points)

# SPDX-License-Identifier: Apache-2.0
"""Live pressure over lines, WITS 0 and OPC UA: the samples sent arrive in Pa, and what is missing is said."""

import asyncio
import os
import socket
import threading
import time

import numpy as np
import pytest
from serial_lines import until

from mwd_surface.receiver import pressure_files
from mwd_surface.receiver.network_sources import LineSource, OpcUaSource, Pipe, TcpClient, WitsSource
from mwd_surface.receiver.pressure_table import columns_of
from mwd_surface.rig.wits import format as wits

TIME = np.arange(200) * 0.02
PRESSURE = np.round(2.0e7 + 1e5 * np.random.default_rng(1).normal(size=200), 2)


def received(source, count):
    rows = []

    def enough():
        rows.append(source.read())
        return sum(len(times) for times, _ in rows) >= count

    until(enough)
    return tuple(np.concatenate(part) for part in zip(*rows, strict=True))


def from_pipe(text, columns="", pieces=7):
    reading, writing = os.pipe()
    source = LineSource(Pipe(reading), columns_of(columns), time.monotonic)
    rows = []
    for piece in np.array_split(np.frombuffer(text.encode(), dtype=np.uint8), pieces):
        os.write(writing, piece.tobytes())
        rows.append(source.read())
    os.close(writing)
    rows.append(source.read())
    os.close(reading)
    assert source.ended
    return source, *(np.concatenate(part) for part in zip(*rows, strict=True))


@pytest.mark.parametrize("pieces", [1, 7, 100])
@pytest.mark.parametrize(
    ("head", "separator", "decimal", "columns"),
    [
        ("time_s,pressure_bar", ",", ".", ""),
        ("Zeit (s);SPP (bar)", ";", ",", ""),
        ("", " ", ".", "time_s=1,pressure_bar=2"),
        ("# a logger", "\t", ".", "time_s=1,pressure_bar=2"),
    ],
)
def test_lines_give_the_samples_that_a_file_of_them_gives(tmp_path, head, separator, decimal, columns, pieces):
    rows = [f"{t:.2f}{separator}{p / 1e5:.7f}".replace(".", decimal) for t, p in zip(TIME, PRESSURE, strict=True)]
    rows.insert(50, separator.join(["9.9", "Bad"]))
    text = "\n".join([*([head] if head else []), *rows]) + "\n"
    _, times, pressures = from_pipe(text, columns, pieces)
    (tmp_path / "p.csv").write_text(text)
    read = pressure_files.read(tmp_path / "p.csv", columns=columns)
    np.testing.assert_allclose(times, read.time_s, atol=1e-9)
    np.testing.assert_allclose(pressures, read.pressure_pa, rtol=1e-12)


def test_lines_with_stamps_go_on_behind_midnight_and_lines_without_times_arrive_in_order():
    clocks = [
        f"23:59:{58 + t:06.3f},{p}" if t < 2.0 else f"00:00:{t - 2:06.3f},{p}"
        for t, p in zip(TIME, PRESSURE, strict=True)
    ]
    _, times, _ = from_pipe("\n".join(["Rig time,SPP (Pa)", *clocks]) + "\n")
    np.testing.assert_allclose(times, TIME, atol=1e-6)
    _, times, pressures = from_pipe("\n".join(f"{p}" for p in PRESSURE) + "\n", "pressure_pa=1")
    assert np.all(np.diff(times) > 0.0)
    np.testing.assert_allclose(pressures, PRESSURE)


def test_lines_whose_columns_nothing_names_ask_for_them():
    source, times, _ = from_pipe("1,2\n3,4\n")
    assert not len(times)
    assert "--columns time_s=1,pressure_bar=2" in source.failure
    with pytest.raises(ValueError, match="unit is not known"):
        LineSource(Pipe(0), columns_of("pressure_furlong=1"), time.monotonic)


def test_wits_frames_over_tcp_give_their_item_and_a_lost_connection_is_opened_again():
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = WitsSource(
            TcpClient(*server.getsockname(), wits.KEEP_ALIVE), columns_of("pressure_psi=0121"), time.monotonic
        )
        for _ in range(2):
            asked = threading.Thread(target=lambda: until(lambda: source.read() and source.failure == ""))
            source._stream._next_try = 0.0
            asked.start()
            line, _ = server.accept()
            asked.join()
            line.sendall(b"".join(wits.encode([(108, "1234"), (121, f"{value}")]) for value in (2900, 2901, -999.25)))
            times, pressures = received(source, 2)
            np.testing.assert_allclose(pressures, [2900 * 6894.757293168, 2901 * 6894.757293168])
            assert times[1] > times[0]
            line.close()
            until(lambda: source.read() and "connecting again" in source.failure)
        source.close()
    with pytest.raises(ValueError, match="unit of its pressure"):
        WitsSource(Pipe(0), {}, time.monotonic)


def test_a_node_of_opc_ua_is_read_with_the_times_of_its_source():
    from asyncua import Server, ua

    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{found.getsockname()[1]}"
    go, end = threading.Event(), threading.Event()

    async def serve():
        server = Server()
        await server.init()
        server.set_endpoint(url)
        node = await server.nodes.objects.add_variable(ua.NodeId("SPP", 2), "SPP", 0.0)
        async with server:
            go.set()
            k = 0
            while not end.is_set():
                k += 1
                stamp = ua.uatypes.datetime.fromtimestamp(1_790_000_000 + 0.02 * k, ua.uatypes.timezone.utc)
                await node.write_value(ua.DataValue(ua.Variant(200.0 + k), SourceTimestamp=stamp))
                await asyncio.sleep(0.02)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    go.wait(10.0)
    source = OpcUaSource(url, columns_of("pressure_bar=ns=2;s=SPP"))
    times, pressures = received(source, 20)
    source.close()
    end.set()
    thread.join()
    steps = np.diff(pressures) / 1e5
    np.testing.assert_allclose(np.diff(times), 0.02 * steps, atol=1e-5)
    assert times[0] == 0.0

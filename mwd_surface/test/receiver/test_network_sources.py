# SPDX-License-Identifier: Apache-2.0
"""Live pressure over lines, WITS 0 and OPC UA: the samples sent arrive in Pa, and what is missing is said."""

import asyncio
import datetime as dt
import json
import os
import socket
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import eventually, samples_of

from mwd_surface.receiver import pressure_files
from mwd_surface.receiver.network_sources import LineSource, OpcUaSource, TcpClient, WitsSource
from mwd_surface.receiver.pressure_columns import columns_of
from mwd_surface.receiver.sources import Pipe
from mwd_surface.rig.wits import format as wits

TIME = np.arange(200) * 0.02
PRESSURE = np.round(2.0e7 + 1e5 * np.random.default_rng(1).normal(size=200), 2)


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


def assert_as_in_a_file(path, text, columns="", pieces=7):
    """Lines that come through a pipe give the samples that a file of them gives; return their times."""
    _, times, pressures = from_pipe(text, columns, pieces)
    path.write_text(text)
    read = pressure_files.read(path, columns=columns)
    np.testing.assert_allclose(times, read.time_s, atol=1e-9)
    np.testing.assert_allclose(pressures, read.pressure_pa, rtol=1e-12)
    return times


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
    assert_as_in_a_file(tmp_path / "p.csv", "\n".join([*([head] if head else []), *rows, ""]), columns, pieces)


def test_the_names_above_a_long_block_of_lines_are_read():
    """A logger that sends its buffer, or a file on standard input: thousands of lines arrive with the names."""
    lines = "".join(f"{0.02 * k:.2f},{200.0 + k % 7}\n" for k in range(5000))
    stream = Pieces("time_s,pressure_bar\n" + lines)
    times, pressures = LineSource(stream, {}, time.monotonic).read()
    assert len(times) == 5000
    assert pressures[:2] == pytest.approx([2.0e7, 2.01e7])


def test_a_signal_is_scaled_by_the_range_in_its_name_as_in_a_file(tmp_path):
    rows = [f"{t:.2f},{4.0 + 16.0 * p / 3.5e7:.7f}" for t, p in zip(TIME, PRESSURE, strict=True)]
    text = "\n".join(["time_s,SPP 4-20 mA (0-350 bar)", *rows, ""])
    assert_as_in_a_file(tmp_path / "p.csv", text)
    np.testing.assert_allclose(from_pipe(text)[2], PRESSURE, atol=10.0)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (lambda t, p: [{"time_s": t, "pressure_bar": p}], ""),
        (lambda t, p: [{"ts": t, "data": {"hookload": 3.0, "spp": p}}], "time_s=ts,pressure_bar=spp"),
        (lambda t, p: [[t, p]], "time_s=1,pressure_bar=2"),
        (lambda t, p: [{"samples": [{"time_s": t, "pressure_bar": p}]}], ""),
        (
            lambda t, p: [
                {"time_s": t, "tag": "rig/hookload", "value": 3.0, "unit": "kN"},
                {"time_s": t, "tag": "rig/spp", "value": p, "unit": "bar"},
            ],
            "",
        ),
    ],
)
def test_lines_of_json_give_the_samples_that_a_file_of_them_gives(tmp_path, rows, columns):
    pairs = [(round(t, 2), round(p / 1e5, 7)) for t, p in zip(TIME, PRESSURE, strict=True)]
    lines = [json.dumps(row) for t, p in pairs for row in rows(t, p)]
    lines.insert(50, lines[50][:9])
    assert len(assert_as_in_a_file(tmp_path / "p.jsonl", "\n".join([*lines, ""]), columns)) == len(TIME)


def test_lines_without_times_arrive_in_order():
    _, times, pressures = from_pipe("\n".join(f"{p}" for p in PRESSURE) + "\n", "pressure_pa=1")
    assert np.all(np.diff(times) > 0.0)
    np.testing.assert_allclose(pressures, PRESSURE)


class Pieces:
    """A stream that gives one piece of text a read; None is a lost connection."""

    def __init__(self, *pieces):
        self.pieces, self.failure, self.ended, self.breaks = list(pieces), "", False, 0

    def read(self):
        text = self.pieces.pop(0) if self.pieces else ""
        if text is None:
            self.breaks += 1
        return (text or "").encode()

    def close(self):
        self.ended = True


def from_pieces(pieces, columns):
    stream = Pieces(*pieces)
    source = LineSource(stream, columns_of(columns), time.monotonic)
    rows = [source.read() for _ in pieces]
    return source, *(np.concatenate(part) for part in zip(*rows, strict=True))


HOUR_S = 3600.0


def written_moment(form, seconds):
    moment = dt.datetime(2026, 3, 4, 22, 59, 30, tzinfo=dt.UTC) + dt.timedelta(seconds=float(seconds))
    digits = f"{moment:%H%M%S}".lstrip("0") or "0"
    return moment.strftime(form) if form else f"{digits}.{moment.microsecond // 10_000:02d}"


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("form", ["%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f", ""])
def test_times_of_lines_go_on_over_any_number_of_midnights(form, size):
    """A row every two seconds for a minute, then every 9 hours for four days."""
    times = np.concatenate([np.arange(30) * 2.0, 60.0 + 9.0 * HOUR_S * np.arange(1, 12)])
    lines = [f"{written_moment(form, t)};203.8\n" for t in times]
    pieces = ["".join(lines[k : k + size]) for k in range(0, len(lines), size)]
    _, got, values = from_pieces(pieces, "time=1,pressure_bar=2")
    np.testing.assert_allclose(got, times, atol=1e-6)
    np.testing.assert_allclose(values, 2.038e7)


def test_a_line_that_comes_late_at_midnight_is_not_a_day():
    clocks = [f"23:59:{59.6 + 0.02 * k:05.2f}" for k in range(20)] + ["00:00:00.02", "23:59:59.98", "00:00:00.04"]
    _, times, _ = from_pieces([f"{clock},200\n" for clock in clocks], "time=1,pressure_bar=2")
    np.testing.assert_allclose(times[-3:], [0.42, 0.38, 0.44], atol=1e-6)


@given(st.lists(st.integers(1, 60), min_size=3, max_size=30))
def test_the_times_of_lines_do_not_depend_on_how_the_lines_are_cut(sizes):
    """Unix ms and seconds without a unit; a read that holds one line is judged as the first lines were."""
    for factor, first in ((1000.0, 1_772_000_000_000.0), (1.0, 5.0)):
        lines = [f"{first + factor * 0.02 * k:.2f},203.8\n" for k in range(sum(sizes))]
        ends = np.cumsum(sizes)
        pieces = ["".join(lines[end - size : end]) for end, size in zip(ends, sizes, strict=True)]
        _, times, _ = from_pieces(pieces, "time=1,pressure_bar=2")
        if len(lines) >= 20:
            np.testing.assert_allclose(times, 0.02 * np.arange(len(lines)), atol=1e-6)


def test_titles_before_the_names_and_a_mark_of_each_column_are_read_as_in_files():
    lines = ["Rig 7", "Zeit;SPP (bar)", *(f"{46082 + 0.02 * k / 86_400:.10f};203,8" for k in range(40))]
    _, times, pressures = from_pieces([f"{line}\n" for line in lines], "")
    np.testing.assert_allclose(times, 0.02 * np.arange(40), atol=1e-5)
    np.testing.assert_allclose(pressures, 2.038e7)


@pytest.mark.parametrize(
    ("unit", "cells"), [("ma", "12.0 3.0 4.0 20.0"), ("mv", "12.0 3.0"), ("v", "1 5"), ("bar", "1")]
)
def test_a_signal_is_the_same_pressure_in_lines_frames_and_files(tmp_path, unit, cells):
    """A current below 3.6 mA is of a broken wire."""
    values = 100 * cells.split()
    rows = "".join(f"{0.02 * k:.2f},{value}\n" for k, value in enumerate(values))
    (tmp_path / "p.csv").write_text("time_s,x\n" + rows)
    read = pressure_files.read(tmp_path / "p.csv", columns=f"pressure_{unit}=x")
    _, times, pressures = from_pieces([rows, *20 * ["9.9,Bad\n"]], f"time_s=1,pressure_{unit}=2")
    np.testing.assert_allclose(pressures, read.pressure_pa, rtol=1e-12)
    np.testing.assert_allclose(times, read.time_s + times[0], atol=1e-9)
    frames = Pieces("")
    source = WitsSource(frames, columns_of(f"pressure_{unit}=0121"), time.monotonic)
    frames.pieces = [b"".join(wits.encode([(121, value)]) for value in [*values, "1"]).decode()]
    np.testing.assert_allclose(source.read()[1][: len(read.pressure_pa)], read.pressure_pa, rtol=1e-12)


def test_a_lost_connection_ends_the_line_and_the_frame_that_it_cut():
    rows = [f"{0.02 * k:.2f},203\n" for k in range(40)]
    _, times, pressures = from_pieces(
        ["".join(rows), "1.02,20", None, "1.10,203\n1.12,203\n"], "time_s=1,pressure_bar=2"
    )
    np.testing.assert_allclose(times[-3:], [0.78, 1.10, 1.12])
    np.testing.assert_allclose(pressures, 2.03e7)
    frame = wits.encode([(121, "2900")]).decode()
    source = WitsSource(Pieces(frame, frame[:-9], None, frame, frame), columns_of("pressure_pa=0121"), time.monotonic)
    np.testing.assert_allclose(np.concatenate([source.read()[1] for _ in range(5)]), 2900.0)


@pytest.mark.parametrize(
    ("row", "bar"),
    [
        ("{t:.2f} {p:.1f}", 203.8),
        ("{t:.2f},{p:.1f}", 203.8),
        ('"{t:.2f}", "{p:.1f}"', 203.8),
        ("{t:.2f}\t{p:.1f} bar", 203.8),
        ("{t:.2f}  {p:.3e}", 203.8),
        ("{t:.2f};1'{p:.1f}", 1203.8),
        ("{t:.2f};1,{p:.1f}", 1203.8),
        ("{t:.2f};1,203", 1203.0),
    ],
)
@pytest.mark.parametrize("mark", [".", ","])
def test_the_numbers_of_lines_have_any_marks_that_a_column_reveals(row, bar, mark):
    lines = [row.format(t=0.02 * k, p=203.8) for k in range(40)]
    if mark == ",":
        lines = [line.translate(str.maketrans(".,", ",.")) for line in lines]
        if "," in row:
            pytest.skip("separator") if ";" not in row else None
    source, times, pressures = from_pieces([f"{line}\n" for line in lines], "time_s=1,pressure_bar=2")
    np.testing.assert_allclose(times, 0.02 * np.arange(40), atol=1e-9)
    np.testing.assert_allclose(pressures, 1e5 * bar)
    assert source.failure == ""


@pytest.mark.parametrize(
    ("row", "columns", "question"),
    [
        (lambda k: f"{k},{k}", "", "--columns time_s=1,pressure_bar=2"),
        (lambda k: f"{20 * k},203.8", "time=1,pressure_bar=2", "time_s=1 or time_ms=1"),
        (lambda k: f"{k};1,{234 + k}", "time_s=1,pressure_psi=2", "decimal=comma or decimal=point"),
    ],
)
def test_what_lines_do_not_say_is_asked(row, columns, question):
    source, times, _ = from_pieces([f"{row(k)}\n" for k in range(30)], columns)
    assert not len(times)
    assert question in source.failure


@pytest.mark.parametrize(("mark", "psi"), [("point", 1234.0), ("Comma", 1.234)])
def test_the_decimal_mark_of_lines_can_be_said(mark, psi):
    pieces = [f"{k};1,{234 + k}\n" for k in range(30)]
    _, _, pressures = from_pieces(pieces, f"time_s=1,pressure_psi=2,decimal={mark}")
    assert pressures[0] == pytest.approx(psi * 6894.757293168)


@pytest.mark.parametrize(
    ("columns", "words"), [("pressure_furlong=1", "unit is not known"), ("time_s=0,pressure_bar=2", "counted from 1")]
)
def test_columns_that_cannot_be_are_refused(columns, words):
    with pytest.raises(ValueError, match=words):
        LineSource(Pieces(), columns_of(columns), time.monotonic)


@pytest.mark.parametrize("line", ["1.00", "1.00,Bad", "1.00,203.8,", "--", "1.00,-999.25"])
def test_lines_without_a_pressure_are_reported_until_one_has_a_pressure(line):
    good = "".join(f"{0.02 * k:.2f},203.8\n" for k in range(30))
    source, _, _ = from_pieces([good, *30 * [f"{line}\n"]], f"time_s=1,pressure_bar={3 if '8,' in line else 2}")
    assert f"such as {line!r}" in source.failure
    source._stream.pieces = [good.replace(",203.8", ",203.8,203.8") if "8," in line else good]
    source.read()
    assert source.failure == ""


def test_wits_frames_over_tcp_give_their_item_and_a_lost_connection_is_opened_again():
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = WitsSource(
            TcpClient(*server.getsockname(), wits.KEEP_ALIVE), columns_of("pressure_psi=0121"), time.monotonic
        )
        for _ in range(2):
            asked = threading.Thread(target=lambda: eventually(lambda: source.read() and source.failure == ""))
            source._stream._next_try = 0.0
            asked.start()
            line, _ = server.accept()
            asked.join()
            line.sendall(b"".join(wits.encode([(108, "1234"), (121, f"{value}")]) for value in (2900, 2901, -999.25)))
            times, pressures = samples_of(source.read, 2)
            np.testing.assert_allclose(pressures, [2900 * 6894.757293168, 2901 * 6894.757293168])
            assert times[1] > times[0]
            line.close()
            eventually(lambda: source.read() and "connecting again" in source.failure)
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
    times, pressures = samples_of(source.read, 20)
    source.close()
    end.set()
    thread.join()
    steps = np.diff(pressures) / 1e5
    np.testing.assert_allclose(np.diff(times), 0.02 * steps, atol=1e-5)
    assert times[0] == 0.0

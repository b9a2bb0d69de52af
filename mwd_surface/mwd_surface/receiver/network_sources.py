# SPDX-License-Identifier: Apache-2.0
"""
Live pressure from a rig's data system: lines of text (standard input, TCP), WITS level 0, OPC UA.

Reading does not wait for data; opening a TCP connection may take a second. The caller always names the unit of the
pressure, because the receiver cannot notice a wrong one.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.number_cells import is_null, split, value
from mwd_surface.receiver import json_columns, pressure_columns, table_times
from mwd_surface.receiver.gauge_scale import PRESSURES, in_pascal
from mwd_surface.receiver.sources import MOST_AT_ONCE
from mwd_surface.rig.wits import format as wits

_RETRY_S = 2.0  # time between two attempts to connect, s
_LONGEST_LINE = 4096  # longest line that can be a row of a table, bytes
_HEAD_LINES = 20  # number of first lines from which the format is determined
_LONGEST_HEAD = 2000  # largest number of lines that are kept while their format is not known
_SILENT_LINES = 20  # number of lines in a row without a pressure that is reported as a failure
# Cell of a line whose cells are separated by spaces: a number with a decimal comma, or a text without comma.
_CELL = r"(?:[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[^\s,]+)"
_SPACED_DECIMALS = re.compile(rf"^{_CELL}(?:\s+{_CELL})+$")
_KEEP_ALIVE_S = 30.0  # time between two messages that keep a connection alive, s
_SPPA = "0121"  # WITS item of the average standpipe pressure
_SAMPLING_MS = 20.0  # sampling interval that an OPC UA server is asked for, ms


class _Bytes(Protocol):
    """Interface of a stream of bytes; `failure` and `ended` as in `sources.Source`; `breaks` counts lost streams."""

    failure: str
    ended: bool
    breaks: int

    def read(self) -> bytes:
        """Return the bytes since the last call."""
        ...

    def close(self) -> None:
        """Stop reading, and close the stream if this object opened it."""
        ...


class TcpClient:
    """
    Bytes of a TCP connection; a lost connection is opened again.

    Parameters
    ----------
    keep_alive : bytes
        Bytes sent every half minute, for servers that drop a silent client.
    """

    def __init__(self, host: str, port: int, keep_alive: bytes = b"") -> None:
        self._where, self._keep_alive = (host, port), keep_alive
        self._line: socket.socket | None = None
        self._next_try = self._next_sign = -math.inf
        self.failure, self.ended, self.breaks = f"{host}:{port} has not answered yet", False, 0

    def read(self) -> bytes:
        """Return the bytes since the last call."""
        now = time.monotonic()
        if self.ended or (self._line is None and not self._opened(now)) or self._line is None:
            return b""
        data = bytearray()
        try:
            if self._keep_alive and now >= self._next_sign:
                self._next_sign = now + _KEEP_ALIVE_S
                self._line.send(self._keep_alive)
            while len(data) < MOST_AT_ONCE:
                more = self._line.recv(65536)
                if not more:
                    self._lose("ended the connection", now)
                    break
                data += more
        except BlockingIOError:
            pass
        except OSError as error:
            self._lose(error.strerror or str(error), now)
        return bytes(data)

    def close(self) -> None:
        """Close the connection."""
        if self._line is not None:
            self._line.close()
            self._line = None
        self.ended = True

    def _lose(self, reason: str, now: float) -> None:
        if self._line is not None:
            self._line.close()
            self.breaks += 1
        self._line, self._next_try = None, now + _RETRY_S
        self.failure = f"{self._where[0]}:{self._where[1]} {reason}; connecting again"

    def _opened(self, now: float) -> bool:
        if now < self._next_try:
            return False
        try:
            self._line = socket.create_connection(self._where, timeout=1.0)
        except OSError as error:
            self._lose(f"does not answer ({error.strerror or error})", now)
            return False
        self._line.setblocking(False)
        self.failure = ""
        return True


class _Arrivals:
    """Times of samples that arrive in blocks without times: evenly spread over the time since the last block."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._last = clock, clock()

    def times(self, count: int) -> Array:
        """Return times, s, of `count` samples that arrived since the last call, shape (count,)."""
        now, last = self._clock(), self._last
        if count == 0:
            return np.zeros(0)
        self._last = now
        return np.asarray(np.linspace(last, now, count + 1)[1:])


class _OfStream:
    """Common part of all sources that read a stream of bytes."""

    _stream: _Bytes
    _wrong: str  # sentence on the fault of the bytes; empty if there is none

    @property
    def failure(self) -> str:
        """Reason why no samples arrive; empty while samples may arrive."""
        return self._stream.failure or self._wrong

    @property
    def ended(self) -> bool:
        """Whether no more samples will come."""
        return self._stream.ended


class LineSource(_OfStream):
    """
    Pressure in lines of text: cells separated by commas, semicolons, tabs or spaces, or JSON in each line.

    Parameters
    ----------
    columns : mapping of str
        Columns as `pressure_columns.columns_of` reads them, by number or by the name in a first line; if empty, a first
        line must name time and pressure with their units. Without a time, the time of arrival counts.
    clock : callable
        Returns the present time, s.
    """

    def __init__(self, stream: _Bytes, columns: Mapping[str, str], clock: Callable[[], float]) -> None:
        self._stream, self._said, self._arrivals = stream, dict(columns), _Arrivals(clock)
        self._open, self._breaks = b"", 0
        pressure_columns.live_columns([], self._said)
        self._head: list[str] = []
        self._format: _Format | None = None
        # Keys of the JSON records, the header of the table made from them; None if the lines are not JSON.
        self._names: list[str] | None = None
        self._wrong, self._without, self._heard = "", 0, False

    def read(self) -> tuple[Array, Array]:
        """
        Return times, s, and pressures, Pa, since the last call; shape (n,) each.

        A line without a pressure is left out. The arrays are empty until the first lines have shown the format.
        """
        lines = self._lines()
        if self._format is None:
            self._head += lines
            if not self._head or (len(self._head) < _HEAD_LINES and not self._stream.ended):
                self._wrong = f"{len(self._head)} lines have arrived; {_HEAD_LINES} are needed to recognise the format"
                return np.zeros(0), np.zeros(0)
            try:
                table = self._from_json(self._head)
                self._format = _Format(table, self._said)
            except ValueError as error:
                self._wrong, self._names = str(error), None
                # Forget lines only now: the names may stand above a block of many lines that arrive at once.
                self._head = self._head[-_LONGEST_HEAD:]
                return np.zeros(0), np.zeros(0)
            lines, self._head = table[self._format.names :], []
        else:
            lines = self._from_json(lines)
        times, values = self._format.samples(lines)
        self._tell(lines, np.isfinite(values))
        known = np.isfinite(values) if times is None else np.isfinite(values) & np.isfinite(times)
        if times is None:
            return self._arrivals.times(int(known.sum())), values[known]
        return times[known], values[known]

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()

    def _lines(self) -> list[str]:
        """Return the complete lines since the last call, without comments; a lost stream ends its last line early."""
        data = self._open + self._stream.read()
        if self._stream.ended:
            data += b"\n"
        *lines, self._open = re.split(rb"[\r\n]+", data)
        self._open = self._open[-_LONGEST_LINE:]
        if self._stream.breaks != self._breaks:
            self._open, self._breaks = b"", self._stream.breaks
        texts = (line.decode("utf-8", errors="replace").strip() for line in lines if len(line) <= _LONGEST_LINE)
        return [text for text in texts if text and not text.startswith(("#", "!", "%"))]

    def _from_json(self, lines: list[str]) -> list[str]:
        """Return lines of JSON as rows of a table, at first with a line of names; return other lines unchanged."""
        begins = self._format is None
        if self._names is None and not (begins and all(json_columns.is_json(line) for line in lines)):
            return lines
        rows = [pressure_columns.untagged(row) for line in lines for row in json_columns.cells_of(line)]
        if self._names is None:
            self._names = list(dict.fromkeys(name for row in rows for name in row))
        cells = [[row.get(name, "").replace("\t", " ") for name in self._names] for row in rows]
        # If the caller gives the numbers of the columns, there is no line of names.
        named = begins and pressure_columns.live_columns([], self._said) is None
        return ["\t".join(row) for row in ([self._names, *cells] if named else cells)]

    def _tell(self, lines: list[str], known: Array) -> None:
        """Count the lines since the last pressure, and set the reason for a failure if there are too many."""
        last = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        self._without = len(lines) - last + (0 if last else self._without)
        self._heard = self._heard or last > 0
        if last:
            self._wrong = ""
        if lines and (self._without >= _SILENT_LINES or (self._without and not self._heard)):
            self._wrong = f"the last {self._without} lines have no pressure, such as {lines[-1][:40]!r}"


class _Format:
    """
    Format of lines, determined once from the first lines: separator, columns, decimal marks and times.

    Parameters
    ----------
    lines : list of str
        The first lines.
    said : mapping of str
        Columns that the caller names, as in `LineSource`.

    Raises
    ------
    ValueError
        Columns, units or decimal marks of the lines are ambiguous; the message names the option that states them.
    """

    def __init__(self, lines: list[str], said: Mapping[str, str]) -> None:
        self._separator = _separator(lines)
        self.names = 0  #: number of lines above the first row
        layout = pressure_columns.live_columns([], said)
        while layout is None and self.names < len(lines):
            layout = pressure_columns.live_columns(self._cells(lines[self.names]), said)
            self.names += 1
        if layout is None:
            raise ValueError(
                f"the line {lines[0][:40]!r} does not name time and pressure with their units; name their columns"
                " with --columns time_s=1,pressure_bar=2"
            )
        self._layout = layout
        rows = [self._cells(line) for line in lines[self.names :]]
        every = [cell for row in rows for cell in row]
        decimal = said.get("decimal", "")
        self._mark = pressure_columns.mark_of(_column(rows, layout.pressure), every, layout.unit, decimal)
        self._time_mark = self._mark
        self._stamps: table_times.Stamps | None = None
        if layout.time is not None:
            cells = [cell for cell in _column(rows, layout.time) if cell]
            # If the decimal mark of the times is ambiguous, use the mark of the pressure.
            with contextlib.suppress(ValueError):
                self._time_mark = pressure_columns.mark_of(cells, every, layout.time_unit, decimal)
            numbers = _numbers(cells, self._time_mark, layout.time_unit)
            try:
                self._stamps = table_times.Stamps(cells, numbers, layout.time_unit)
            except table_times.UnknownUnitError as error:
                at = layout.time + 1
                raise ValueError(
                    f"the time (column {at}) has no unit and {error}; set it with --columns time_s={at} or time_ms={at}"
                ) from error

    def samples(self, lines: list[str]) -> tuple[Array | None, Array]:
        """Return times since the first row, s (None without times), and pressures, Pa; NaN where unknown."""
        rows = [self._cells(line) for line in lines]
        numbers = _numbers(_column(rows, self._layout.pressure), self._mark, self._layout.unit)
        pressure, _ = in_pascal(numbers, self._layout.unit, self._layout.name)
        if self._stamps is None or self._layout.time is None:
            return None, pressure
        cells = _column(rows, self._layout.time)
        return self._stamps.seconds(cells, _numbers(cells, self._time_mark, self._layout.time_unit)), pressure

    def _cells(self, line: str) -> list[str]:
        return [cell.strip().strip('"') for cell in (line.split(self._separator) if self._separator else line.split())]


class WitsSource(_OfStream):
    """
    Pressure in frames of WITS level 0; with times of arrival, because WITS times have whole seconds.

    Parameters
    ----------
    columns : mapping of str
        The item and its unit, such as {"pressure_psi": "0121"}.

    Raises
    ------
    ValueError
        The unit is missing, or the item is not four digits.
    """

    def __init__(self, stream: _Bytes, columns: Mapping[str, str], clock: Callable[[], float]) -> None:
        code, self._unit = _named(columns, "a WITS item", _SPPA)
        if not re.fullmatch(r"\d{4}", code):
            raise ValueError(f"--columns: a WITS item has four digits, such as pressure_psi={_SPPA}, got {code!r}")
        self._code, self._stream, self._arrivals = int(code), stream, _Arrivals(clock)
        self._decoder, self._breaks = wits.Decoder(), 0
        self._wrong = ""

    def read(self) -> tuple[Array, Array]:
        """Return times, s, and pressures, Pa, since the last call."""
        frames = self._decoder.feed(self._stream.read())
        if self._stream.breaks != self._breaks:
            self._decoder, self._breaks = wits.Decoder(), self._stream.breaks
        values = [number for frame in frames if (number := frame.number(self._code)) is not None]
        if values:
            self._wrong = ""
        elif frames and not self._wrong:
            self._wrong = f"the frames of WITS have no item {self._code:04d} yet"
        pressure, _ = in_pascal(np.array(values, dtype=float), self._unit)
        known = np.isfinite(pressure)
        return self._arrivals.times(int(known.sum())), pressure[known]

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()


class OpcUaSource:
    """
    Pressure of a node of an OPC UA server, by subscription, with the times of its source.

    Parameters
    ----------
    columns : mapping of str
        The node and its unit, such as {"pressure_bar": "ns=2;s=SPP"}.

    Raises
    ------
    ValueError
        The node or the unit is missing.
    """

    def __init__(self, url: str, columns: Mapping[str, str]) -> None:
        self._node, self._unit = _named(columns, "a node of OPC UA", "")
        if not self._node:
            raise ValueError("--columns: name the node of the pressure, such as pressure_bar=ns=2;s=SPP")
        self._url = url
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._rows: list[tuple[float, float]] = []
        self._first = math.nan
        self.failure, self.ended = f"{url} has not answered yet", False
        self._thread = threading.Thread(target=lambda: asyncio.run(self._listen()), name="opcua", daemon=True)
        self._thread.start()

    def read(self) -> tuple[Array, Array]:
        """Return times since the first sample, s, and pressures, Pa, since the last call."""
        with self._lock:
            rows, self._rows = self._rows, []
        table = np.array(rows, dtype=float).reshape(-1, 2)
        if len(table) and math.isnan(self._first):
            self._first = float(table[0, 0])
        pressure, _ = in_pascal(table[:, 1], self._unit)
        known = np.isfinite(pressure)
        return table[known, 0] - self._first, pressure[known]

    def close(self) -> None:
        """Stop the thread and close the connection."""
        self._stop.set()
        self._thread.join(5.0)
        self.ended = True

    def datachange_notification(self, _node: Any, value: Any, data: Any) -> None:
        """Store one value from the server with its time; a value that is not a finite number becomes the failure."""
        stamp = data.monitored_item.Value.SourceTimestamp
        at = time.time() if stamp is None else stamp.timestamp()
        if isinstance(value, (int, float)) and math.isfinite(value):
            with self._lock:
                self._rows.append((at, float(value)))
            self.failure = ""
        else:
            self.failure = f"the node {self._node} has no number: {str(value)[:40]}"

    async def _listen(self) -> None:
        from asyncua import ua
        from asyncua.client.client import Client

        while not self._stop.is_set():
            try:
                async with Client(self._url, timeout=4.0) as client:
                    subscription = await client.create_subscription(100.0, self)
                    await subscription.subscribe_data_change(
                        client.get_node(self._node), queuesize=1000, sampling_interval=ua.Double(_SAMPLING_MS)
                    )
                    while not self._stop.is_set():
                        await asyncio.sleep(0.1)
                        await client.check_connection()
            except (OSError, TimeoutError, ua.uaerrors.UaError, ValueError) as error:
                self.failure = f"{self._url}: {error or type(error).__name__}"
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.to_thread(self._stop.wait, _RETRY_S), 2.0 * _RETRY_S)


def _separator(lines: list[str]) -> str:
    """Return the separator of the cells, "" for spaces; with spaces, commas may be decimal marks."""
    for separator in ";\t":
        if sum(separator in line for line in lines) * 2 > len(lines):
            return separator
    with_comma = [line for line in lines if "," in line]
    decimals = sum(bool(_SPACED_DECIMALS.match(line)) for line in with_comma)
    return "," if len(with_comma) * 2 > len(lines) and decimals * 2 <= len(with_comma) else ""


def _column(rows: list[list[str]], place: int) -> list[str]:
    return [row[place] if place < len(row) else "" for row in rows]


def _numbers(cells: list[str], mark: str, unit: str) -> Array:
    return np.array([_number(cell, mark, unit) for cell in cells], dtype=float)


def _number(cell: str, mark: str, unit: str) -> float:
    """Return the number of a cell, with or without `unit`; NaN without a number, with another unit, or for a null."""
    found = None if is_null(cell) else split(cell)
    if found is None or found[1].lower().rstrip(".") not in ("", unit):
        return math.nan
    try:
        number = value(found[0], mark)
    except ValueError:
        return math.nan
    return math.nan if is_null(number) else number


def _named(columns: Mapping[str, str], what: str, usual: str) -> tuple[str, str]:
    """
    Return the name of the pressure that the caller gives in `columns`, else `usual`, and its unit.

    what: noun for the message, such as "a WITS item". Raises ValueError if the unit is missing or unknown.
    """
    key, name = next(((key, name) for key, name in columns.items() if key.startswith("pressure")), ("", usual))
    unit = key.partition("_")[2]
    if unit not in PRESSURES:
        raise ValueError(
            f"--columns: name {what} with the unit of its pressure, such as pressure_bar={name or 'ns=2;s=SPP'}; units:"
            f" {', '.join(PRESSURES)}"
        )
    return name, unit

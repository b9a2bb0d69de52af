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
import os
import re
import select
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.number_cells import NULL_NUMBERS
from mwd_surface.receiver import pressure_table, table_times
from mwd_surface.rig.wits import format as wits

_RETRY_S = 2.0
_MOST_AT_ONCE = 1 << 20  # bytes read per call
_LONGEST_LINE = 4096  # characters; a longer line is not of a table
_DAY_S = 86_400.0
_KEEP_ALIVE_S = 30.0
_SPPA = "0121"  # WITS item of the average standpipe pressure


class _Bytes(Protocol):
    """Interface of a stream of bytes; `failure` and `ended` as in `sources.Source`."""

    failure: str
    ended: bool

    def read(self) -> bytes:
        """Return the bytes since the last call."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


class Pipe:
    """Bytes of a file descriptor, for example 0 for standard input."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.failure, self.ended = "", False

    def read(self) -> bytes:
        """Return the bytes since the last call."""
        data = bytearray()
        while not self.ended and len(data) < _MOST_AT_ONCE and select.select([self._descriptor], [], [], 0.0)[0]:
            more = os.read(self._descriptor, 65536)
            self.ended = not more
            data += more
        return bytes(data)

    def close(self) -> None:
        """Stop reading; the descriptor stays open."""
        self.ended = True


class TcpClient:
    """
    Bytes of a TCP connection, which is opened again when it is lost.

    Parameters
    ----------
    host, port : str, int
    keep_alive : bytes
        Bytes sent every half minute, for servers that drop a silent client.
    """

    def __init__(self, host: str, port: int, keep_alive: bytes = b"") -> None:
        self._where, self._keep_alive = (host, port), keep_alive
        self._line: socket.socket | None = None
        self._next_try = self._next_sign = -math.inf
        self.failure, self.ended = f"{host}:{port} has not answered yet", False

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
            while len(data) < _MOST_AT_ONCE:
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
        """Return times of samples that arrived since the last call, s."""
        now, last = self._clock(), self._last
        if count == 0:
            return np.zeros(0)
        self._last = now
        return np.asarray(np.linspace(last, now, count + 1)[1:])


class LineSource:
    """
    Pressure in lines of text: cells separated by commas, semicolons, tabs or spaces.

    Parameters
    ----------
    stream : Pipe or TcpClient
    columns : mapping of str
        Columns as `pressure_table.columns_of` reads them, by number or by the name in a first line; if empty, a first
        line must name time and pressure with their units. Without a time, the time of arrival counts.
    clock : callable
        Returns the present time, s.
    """

    def __init__(self, stream: _Bytes, columns: Mapping[str, str], clock: Callable[[], float]) -> None:
        self._stream, self._said, self._arrivals = stream, dict(columns), _Arrivals(clock)
        self._open = ""
        self._layout = pressure_table.live_columns([], self._said)
        self._first = self._last = math.nan
        self._wrong = ""

    @property
    def failure(self) -> str:
        """Reason why no samples arrive."""
        return self._stream.failure or self._wrong

    @property
    def ended(self) -> bool:
        """Whether no more samples will come."""
        return self._stream.ended

    def read(self) -> tuple[Array, Array]:
        """Return times, s, and pressures, Pa, since the last call; a line without a pressure is left out."""
        text = self._open + self._stream.read().decode("utf-8", errors="replace")
        if self._stream.ended:
            text += "\n"
        *lines, self._open = re.split(r"[\r\n]+", text)
        self._open = self._open[-_LONGEST_LINE:]
        rows = [row for line in lines if (row := self._row(line.strip())) is not None]
        if not rows:
            return np.zeros(0), np.zeros(0)
        values = np.array([value for _, value in rows])
        if self._layout is None or self._layout.time is None:
            return self._arrivals.times(len(rows)), values
        times = self._seconds([cell for cell, _ in rows])
        known = np.isfinite(times)
        return times[known], values[known]

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()

    def _row(self, line: str) -> tuple[str, float] | None:
        """Return the cell of the time and the pressure, Pa, of a line; None if it has none."""
        if not line or line.startswith(("#", "!", "%")) or len(line) > _LONGEST_LINE:
            return None
        cells = _cells(line)
        if self._layout is None:
            self._layout = pressure_table.live_columns(cells, self._said)
            if self._layout is None:
                self._wrong = (
                    f"the line {line[:40]!r} does not name time and pressure with their units; say which columns they"
                    " are with --columns time_s=1,pressure_bar=2"
                )
            return None
        layout = self._layout
        wanted = [layout.pressure, *([] if layout.time is None else [layout.time])]
        if max(wanted) >= len(cells):
            return None
        value = _number(cells[layout.pressure])
        if not math.isfinite(value):
            return None
        self._wrong = ""
        return ("" if layout.time is None else cells[layout.time]), value * layout.factor

    def _seconds(self, cells: list[str]) -> Array:
        """Return times since the first one, s; a clock continues after midnight."""
        import pyarrow as pa

        unit = "" if self._layout is None else self._layout.time_unit
        numbers = np.array([_number(cell) for cell in cells])
        if np.isfinite(numbers).all():
            times = numbers * table_times.UNITS[unit] if unit else table_times.of_numbers(numbers, unit)
        else:
            times = table_times.of_text(pa.chunked_array([pa.array(cells, pa.string())]))
        known = times[np.isfinite(times)]
        if known.size:
            if math.isnan(self._first):
                self._first = self._last = float(known[0])
            if known[0] < self._last - 0.5 * _DAY_S and self._last < 2.0 * _DAY_S:
                times = times + _DAY_S * math.ceil((self._last - known[0] - 0.5 * _DAY_S) / _DAY_S)
            self._last = float(np.nanmax(times))
        return np.asarray(times - self._first)


class WitsSource:
    """
    Pressure in frames of WITS level 0; the time of arrival counts, because the times of WITS have whole seconds.

    Parameters
    ----------
    stream : TcpClient
    columns : mapping of str
        The item and its unit, such as {"pressure_psi": "0121"}.
    clock : callable

    Raises
    ------
    ValueError
        The unit is missing, or the item is not four digits.
    """

    def __init__(self, stream: _Bytes, columns: Mapping[str, str], clock: Callable[[], float]) -> None:
        code, self._factor = _named(columns, "a WITS item", _SPPA)
        if not re.fullmatch(r"\d{4}", code):
            raise ValueError(f"--columns: a WITS item has four digits, such as pressure_psi={_SPPA}, got {code!r}")
        self._code, self._stream, self._arrivals = int(code), stream, _Arrivals(clock)
        self._decoder = wits.Decoder()
        self._wrong = ""

    @property
    def failure(self) -> str:
        """Reason why no samples arrive."""
        return self._stream.failure or self._wrong

    @property
    def ended(self) -> bool:
        """Whether no more samples will come."""
        return self._stream.ended

    def read(self) -> tuple[Array, Array]:
        """Return times, s, and pressures, Pa, since the last call."""
        frames = self._decoder.feed(self._stream.read())
        values = [number for frame in frames if (number := frame.number(self._code)) is not None]
        if values:
            self._wrong = ""
        elif frames and not self._wrong:
            self._wrong = f"the frames of WITS have no item {self._code:04d} yet"
        return self._arrivals.times(len(values)), np.array(values) * self._factor

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()


class OpcUaSource:
    """
    Pressure of a node of an OPC UA server, by subscription, with the times of its source.

    Parameters
    ----------
    url : str
    columns : mapping of str
        The node and its unit, such as {"pressure_bar": "ns=2;s=SPP"}.
    sampling_ms : float
        Sampling interval asked from the server.

    Raises
    ------
    ValueError
        The node or the unit is missing.
    """

    def __init__(self, url: str, columns: Mapping[str, str], sampling_ms: float = 20.0) -> None:
        self._node, self._factor = _named(columns, "a node of OPC UA", "")
        if not self._node:
            raise ValueError("--columns: name the node of the pressure, such as pressure_bar=ns=2;s=SPP")
        self._url, self._sampling_ms = url, sampling_ms
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
        return table[:, 0] - self._first, table[:, 1] * self._factor

    def close(self) -> None:
        """Stop the thread and close the connection."""
        self._stop.set()
        self._thread.join(5.0)
        self.ended = True

    def datachange_notification(self, _node: Any, value: Any, data: Any) -> None:
        """Keep one value that the server reports."""
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
                        client.get_node(self._node), queuesize=1000, sampling_interval=ua.Double(self._sampling_ms)
                    )
                    while not self._stop.is_set():
                        await asyncio.sleep(0.1)
                        await client.check_connection()
            except (OSError, TimeoutError, ua.uaerrors.UaError, ValueError) as error:
                self.failure = f"{self._url}: {error or type(error).__name__}"
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.to_thread(self._stop.wait, _RETRY_S), 2.0 * _RETRY_S)


def _cells(line: str) -> list[str]:
    """Return the cells of a line; a comma between digits is a decimal mark if another separator exists."""
    for separator in (";", "\t"):
        if separator in line:
            return [cell.strip().strip('"') for cell in line.split(separator)]
    if "," in line:
        return [cell.strip().strip('"') for cell in line.split(",")]
    return line.split()


def _number(cell: str) -> float:
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        return math.nan
    return math.nan if value in NULL_NUMBERS else value


def _named(columns: Mapping[str, str], what: str, usual: str) -> tuple[str, float]:
    """Return the name of the pressure and the factor of its unit to Pa."""
    key, name = next(((key, name) for key, name in columns.items() if key.startswith("pressure")), ("", usual))
    unit = key.partition("_")[2]
    if unit not in pressure_table.PRESSURES:
        raise ValueError(
            f"--columns: name {what} with the unit of its pressure, such as pressure_bar={name or 'ns=2;s=SPP'}; units:"
            f" {', '.join(pressure_table.PRESSURES)}"
        )
    return name, pressure_table.PRESSURES[unit]

# SPDX-License-Identifier: Apache-2.0
"""
Live sources of samples: a 4-20 mA gauge over Modbus, a WAV stream (sound card, pipe), bytes of a serial line.

Reading never blocks, so a node's timer or a plain loop can do it: `read` returns the samples since the last call, and
`failure` states in a sentence why none arrive. Times are times of arrival on the given clock.
"""

from __future__ import annotations

import dataclasses
import math
import os
import select
import struct
import threading
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import serial  # type: ignore[import-untyped]

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_surface.receiver.gauge_scale import FULL_SCALE_PA, GaugeSignal

_EMPTY = np.zeros(0)
_RETRY_S = 2.0  # time between two attempts to connect, s


class SampleSource(Protocol):
    """Interface of a source of samples."""

    @property
    def failure(self) -> str:
        """Reason why no samples arrive; empty while samples may arrive."""
        ...

    @property
    def ended(self) -> bool:
        """Whether no more samples will come."""
        ...

    def read(self) -> tuple[Array, Array]:
        """Return times, s, and samples since the last call; shape (n,) each."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


@dataclasses.dataclass(frozen=True)
class GaugeSettings:
    """Settings of a 4 to 20 mA pressure gauge behind a Modbus converter."""

    host: str = setting("127.0.0.1", "Address of the converter.")
    port: int = setting(502, "TCP port of the converter.", low=1, high=65535)
    unit: int = setting(1, "Unit (slave) number of the converter.", low=0, high=255)
    register: int = setting(0, "Input register of the channel, counted from 0.", low=0, high=65535)
    count_4_ma: int = setting(0, "Value of the register at 4 mA.", low=0, high=65535)
    count_20_ma: int = setting(65535, "Value of the register at 20 mA.", low=0, high=65535)
    pressure_4_ma: float = setting(0.0, "Pressure at 4 mA.", unit="Pa")
    pressure_20_ma: float = setting(3.5e7, "Pressure at 20 mA.", unit="Pa")
    rate_hz: float = setting(
        50.0,
        "Readings per second. At least 5 readings are needed in a pulse width, 2.5 in a period of a carrier.",
        unit="Hz",
        low=0.5,
        high=500.0,
    )

    def __post_init__(self) -> None:
        """Raise ValueError if both ends of the scale are the same."""
        if self.count_4_ma == self.count_20_ma or self.pressure_4_ma == self.pressure_20_ma:
            raise ValueError("count_20_ma, pressure_20_ma: must differ from those at 4 mA")


def gauge_pressure(settings: GaugeSettings, count: int) -> float:
    """Return the pressure of a register value, Pa; NaN if the current signals a failed gauge."""
    share = (count - settings.count_4_ma) / (settings.count_20_ma - settings.count_4_ma)
    scale = GaugeSignal(low_pa=settings.pressure_4_ma, high_pa=settings.pressure_20_ma)
    return float(scale.pressure(np.array(scale.low + share * (scale.high - scale.low))))


class ModbusGauge:
    """
    Gauge that is read at an even rate in a thread of its own, so that network delays do not block the caller.

    Parameters
    ----------
    clock : callable
        Returns the present time, s.
    """

    def __init__(self, settings: GaugeSettings, clock: Callable[[], float]) -> None:
        from pymodbus.client import ModbusTcpClient

        self._settings, self._clock = settings, clock
        self._client: Any = ModbusTcpClient(settings.host, port=settings.port, timeout=1.0, retries=0)
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._rows: list[tuple[float, float]] = []
        self.failure, self.ended = f"{settings.host}:{settings.port} has not answered yet", False
        self._thread = threading.Thread(target=self._poll, name="gauge", daemon=True)
        self._thread.start()

    def read(self) -> tuple[Array, Array]:
        """Return times, s, and pressures, Pa, read since the last call."""
        with self._lock:
            rows, self._rows = self._rows, []
        table = np.array(rows, dtype=float).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    def close(self) -> None:
        """Stop the thread and close the connection."""
        self._stop.set()
        self._thread.join(5.0)
        self._client.close()
        self.ended = True

    def _poll(self) -> None:
        period = 1.0 / self._settings.rate_hz
        due = self._clock()
        while not self._stop.is_set():
            self._read_register()
            due = max(due + period, self._clock() - period)
            self._stop.wait(_RETRY_S if self.failure else max(due - self._clock(), 0.0))

    def _read_register(self) -> None:
        from pymodbus.exceptions import ModbusException

        where, settings = f"{self._settings.host}:{self._settings.port}", self._settings
        if not self._client.connected and not self._client.connect():
            self.failure = f"{where} does not answer; check address, cable and power of the converter"
            return
        asked = self._clock()
        try:
            answer: Any = self._client.read_input_registers(settings.register, count=1, device_id=settings.unit)
        except (ModbusException, OSError, IndexError, ValueError, struct.error) as error:
            # pymodbus raises IndexError, ValueError or struct.error for a malformed answer.
            self._client.close()
            self.failure = f"{where}: {error}"
            return
        if answer.isError() or not answer.registers:
            self.failure = f"{where} has no input register {settings.register} of unit {settings.unit}"
            return
        pressure = gauge_pressure(settings, answer.registers[0])
        failed = math.isnan(pressure)
        words = f"the current is outside of 3.6 to 21 mA: the gauge at {where} or its cable has failed"
        self.failure = words if failed else ""
        if not failed:
            with self._lock:
                # The converter measured between request and answer, so take the middle of the two times.
                self._rows.append((0.5 * (asked + self._clock()), pressure))


class _Form(NamedTuple):
    """Format of a WAV: channels, bytes per sample, rate, Hz, and whether samples are floats."""

    channels: int
    width: int
    rate: float
    floats: bool


_WAV_FLOAT = 3  # format code of floats in a WAV header; 1 is PCM
# Limits in bytes: data read per call, and length of the header before the samples.
MOST_AT_ONCE, _MOST_HEADER = 1 << 20, 1 << 20
_WAV_BITS = {1: (8, 16, 24, 32), _WAV_FLOAT: (32, 64)}


def _shares(data: bytes, form: _Form) -> Array:
    """Return the samples as shares of full scale."""
    if form.floats:
        return np.frombuffer(data, dtype=f"<f{form.width}").astype(float)
    if form.width == 1:
        return (np.frombuffer(data, dtype=np.uint8).astype(float) - 128.0) / 128.0
    # 24-bit samples go into the upper bits of 32.
    wide = np.zeros((len(data) // form.width, 4), dtype=np.uint8)
    wide[:, 4 - form.width :] = np.frombuffer(data, dtype=np.uint8).reshape(-1, form.width)
    return wide.view("<i4")[:, 0] / 2.0**31


class Pipe:
    """Bytes of a file descriptor, for example 0 for standard input."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.failure, self.ended, self.breaks = "", False, 0

    def read(self) -> bytes:
        """Return the bytes since the last call."""
        data = bytearray()
        while not self.ended and len(data) < MOST_AT_ONCE and select.select([self._descriptor], [], [], 0.0)[0]:
            more = os.read(self._descriptor, 65536)
            self.ended = not more
            data += more
        return bytes(data)

    def close(self) -> None:
        """Stop reading; the descriptor stays open."""
        self.ended = True


class WavStream:
    """
    First channel of a WAV stream, PCM or float: of a sound card (`arecord -f S32_LE -r 400 | ...`) or a file.

    Parameters
    ----------
    descriptor : int
        File descriptor to read, for example 0 for standard input.
    """

    def __init__(self, descriptor: int) -> None:
        self._pipe = Pipe(descriptor)
        self._open = bytearray()
        self._form: _Form | None = None
        self._count = 0
        self.failure = ""

    @property
    def ended(self) -> bool:
        """Whether no more samples will come."""
        return self._pipe.ended

    def read(self) -> tuple[Array, Array]:
        """Return times since the first sample, s, and new samples, Pa, with a full scale of 1e7."""
        self._open += self._pipe.read()
        if self._form is None:
            try:
                self._form = self._header()
            except ValueError as error:
                self.failure = str(error)
                self.close()
                self._open.clear()
        if self._form is None:
            return _EMPTY, _EMPTY
        frame = self._form.channels * self._form.width
        whole = len(self._open) // frame * frame
        shares = _shares(bytes(self._open[:whole]), self._form)
        del self._open[:whole]
        one = shares.reshape(-1, self._form.channels)[:, 0]
        time = (self._count + np.arange(len(one))) / self._form.rate
        self._count += len(one)
        return time, one * FULL_SCALE_PA

    def close(self) -> None:
        """Stop reading; the descriptor stays open."""
        self._pipe.close()

    def _header(self) -> _Form | None:
        """
        Parse the header; return None until the samples begin, and raise ValueError if the header cannot be read.

        The size of the samples in the header is not used: when a stream begins, its length is not known.
        """
        if len(self._open) < 12:
            return None
        if self._open[:4] != b"RIFF" or self._open[8:12] != b"WAVE":
            raise ValueError("the stream is not a WAV")
        at, form = 12, None
        while len(self._open) >= at + 8:
            name, size = struct.unpack_from("<4sI", self._open, at)
            if (name == b"data" and form is None) or (name == b"fmt " and size < 16):
                raise ValueError("the WAV does not state the format of its samples")
            if name == b"data":
                del self._open[: at + 8]
                return form
            if at + 8 + size > _MOST_HEADER:
                raise ValueError(f"the WAV has no samples within its first {_MOST_HEADER} bytes")
            if len(self._open) < at + 8 + size:
                return None
            if name == b"fmt ":
                kind, channels, rate, _, _, bits = struct.unpack_from("<HHIIHH", self._open, at + 8)
                if kind == 0xFFFE and size >= 26 + 2:
                    # The extensible format states the kind of samples at the beginning of its sub-format.
                    (kind,) = struct.unpack_from("<H", self._open, at + 8 + 24)
                if bits not in _WAV_BITS.get(kind, ()) or channels == 0 or rate == 0:
                    raise ValueError(
                        f"the WAV has {channels} channels of {bits} bits, form {kind}; give PCM of 8, 16, 24 or 32"
                        " bits, or floats"
                    )
                form = _Form(channels, bits // 8, float(rate), kind == _WAV_FLOAT)
            at += 8 + size + size % 2
        return None


class SerialBytes:
    """
    Bytes of a serial line; the line is reopened when the connection is lost.

    Parameters
    ----------
    clock : callable
        Returns the present time, s.
    """

    def __init__(self, port: str, baud: int, clock: Callable[[], float]) -> None:
        self._port, self._baud, self._clock = port, baud, clock
        self._line: serial.Serial | None = None
        self._next_try = -math.inf
        self.failure, self.ended = "", False

    def read(self) -> tuple[Array, Array]:
        """
        Return the time of arrival, s, and the value, 0 to 255, of each byte since the last call; shape (n,) each.

        The arrays are empty while the line cannot be opened.
        """
        now = self._clock()
        if self.ended or (self._line is None and not self._opened(now)):
            return _EMPTY, _EMPTY
        try:
            data = self._line.read(max(self._line.in_waiting, 1)) if self._line is not None else b""
        except OSError as error:
            self.close()
            self.ended = False
            self.failure = f"{self._port} was lost: {error.strerror or error}"
            return _EMPTY, _EMPTY
        return np.full(len(data), now), np.frombuffer(data, dtype=np.uint8).astype(float)

    def close(self) -> None:
        """Close the line."""
        if self._line is not None:
            self._line.close()
            self._line = None
        self.ended = True

    def _opened(self, now: float) -> bool:
        if now < self._next_try:
            return False
        self._next_try = now + _RETRY_S
        try:
            self._line = serial.Serial(self._port, self._baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            self.failure = f"{self._port}: {getattr(error, 'strerror', None) or error}"
            return False
        self.failure = ""
        return True

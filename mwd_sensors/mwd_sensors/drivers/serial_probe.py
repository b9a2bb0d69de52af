# SPDX-License-Identifier: Apache-2.0
"""
A probe on a serial line: opens it, opens it again when it is lost, reads samples and keeps the unit's clock.

The line is read without waiting, so that a node's timer or a plain loop can do it.
"""

from __future__ import annotations

import dataclasses
import select
import time

import serial  # type: ignore[import-untyped]

from mwd_sensors.core.settings import setting
from mwd_sensors.drivers import mtdata2, probe_protocol
from mwd_sensors.drivers.mtdata2 import MtReader
from mwd_sensors.drivers.probe_protocol import ProbeReader
from mwd_sensors.drivers.readings import CLIP_WORDS, FAULT, Answer, Reading
from mwd_sensors.drivers.unit_clock import UnitClock

_RETRY_S = 1.0
_EXCHANGE_S, _FIRST_S = 1.0, 0.1  # between two requests of the unit's time, and before it is known
_END_OF_TIME_NS = 2**31 * 10**9  # of the messages' stamps


@dataclasses.dataclass(frozen=True)
class LineSettings:
    """The serial line of a probe."""

    port: str = setting("/dev/ttyUSB0", "Device of the serial line; of `mwd emulate`, the name it prints.", fixed=True)
    baud: int = setting(
        921600, "Speed; 8 data bits, no parity, 1 stop bit.", unit="bit/s", low=1200, high=12_000_000, fixed=True
    )
    protocol: str = setting(
        "binary",
        "What the line carries: binary (COBS frames with CRC-16), ascii (lines with CRC-16), xsens (MTData2).",
        choices=("binary", "ascii", "xsens"),
        fixed=True,
    )
    clock: str = setting(
        "host",
        "Stamps: host (the unit's time brought to that of this machine) or unit (as the unit says, such as of a "
        "recording that is played).",
        choices=("host", "unit"),
        fixed=True,
    )
    xsens_field_ut: float = setting(
        0.0,
        "Field that an MTi reads as 1: that of its place of calibration. 0: not known, its magnetometer is not used.",
        unit="uT",
        low=0.0,
        high=100.0,
        fixed=True,
    )
    wait_for_listener_s: float = setting(
        0.0,
        "Longest wait for subscribers before the line is opened; 0: open it at once.",
        unit="s",
        low=0.0,
        high=600.0,
        fixed=True,
    )


class SerialProbe:
    """
    One probe.

    Attributes
    ----------
    connected : bool
    failure : str
        Why the line cannot be opened or was lost; empty while it is open.
    connections : int
        Times that it was opened.
    info : str
        What the unit says of itself.
    clips : dict of str to int
        Samples in which each axis was clipped.
    faults : int
        Samples whose status says that the unit is not well.
    received : int
    """

    def __init__(self, settings: LineSettings) -> None:
        self._settings = settings
        self._line: serial.Serial | None = None
        self._next_try = self._next_exchange = 0.0
        self._counter = 0
        # Whether samples are wanted, and how many there were when that was last looked at.
        self._wanted, self._received_before = True, 0
        self.failure, self.info = "", ""
        self.connections = self.faults = self.received = 0
        self.clips: dict[str, int] = {}
        self._open_reader()

    def _open_reader(self) -> None:
        text = self._settings.protocol == "ascii"
        xsens = self._settings.protocol == "xsens"
        self._reader = MtReader(1e-6 * self._settings.xsens_field_ut) if xsens else ProbeReader(text)
        self.clock = UnitClock()

    @property
    def connected(self) -> bool:
        """Whether the line is open."""
        return self._line is not None

    @property
    def reader(self) -> MtReader | ProbeReader:
        """What reads the line, with its counters; another one after each opening."""
        return self._reader

    @property
    def offset_ns(self) -> int:
        """What is added to the unit's stamps, ns."""
        return self.clock.offset_ns if self._settings.clock == "host" else 0

    def poll(self, now_ns: int) -> list[Reading]:
        """Samples that have come since the last call; now_ns: time of the host, ns. Opens the line where need be."""
        moment = time.monotonic()
        if self._line is None:
            if moment >= self._next_try:
                self._next_try = moment + _RETRY_S
                self._open()
            return []
        try:
            data = self._line.read(max(self._line.in_waiting, 1))
            if moment >= self._next_exchange:
                awaited = self._settings.clock == "host" and self.clock.jumps < 0
                self._next_exchange = moment + (_FIRST_S if awaited else _EXCHANGE_S)
                self._exchange(now_ns)
        except OSError as error:
            self._lose(error)
            return []
        found = []
        for one in self._reader.take(data) if data else ():
            if isinstance(one, Answer):
                self._take_answer(one, now_ns)
            elif 0 <= one.stamp_ns + self.offset_ns < _END_OF_TIME_NS:
                found.append(one)
                self._note(one)
            else:
                self._reader.counters.broken += 1
        if found and self._settings.protocol == "xsens":
            self.clock.observe(found[-1].stamp_ns, now_ns)
        self.received += len(found)
        # Without the offset a sample has no time of the host.
        return [] if self._settings.clock == "host" and self.clock.jumps < 0 else found

    def stream(self, on: bool) -> bool:
        """Let the unit send samples, or not; whether the command could be sent."""
        self._wanted = on
        if self._line is None:
            return False
        try:
            return self._ask_for_samples()
        except OSError as error:
            self._lose(error)
            return False

    def close(self) -> None:
        """Close the line."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _open(self) -> None:
        settings = self._settings
        try:
            # A probe without power takes nothing: a write must not wait for it.
            self._line = serial.Serial(settings.port, settings.baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            self.failure = f"{settings.port}: {getattr(error, 'strerror', None) or error}"
            return
        self.failure = ""
        self.connections += 1
        self._next_exchange = 0.0
        self._open_reader()
        try:
            self._ask_for_samples()
            if settings.protocol != "xsens":
                self._command("info", 0)
        except OSError as error:
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        self.close()
        self.failure = f"{self._settings.port} was lost: {error.strerror or error}"

    def _exchange(self, now_ns: int) -> None:
        """Ask for the unit's time, and again for samples: a unit that was without power has forgotten the command."""
        silent, self._received_before = self.received == self._received_before, self.received
        if silent and self._wanted:
            self._ask_for_samples()
        if self._settings.protocol != "xsens":
            self._command("time", now_ns)

    def _ask_for_samples(self) -> bool:
        """Say whether samples are wanted; whether it could be sent."""
        if self._settings.protocol == "xsens":
            return self._write(mtdata2.message(mtdata2.GO_TO_MEASUREMENT if self._wanted else mtdata2.GO_TO_CONFIG))
        return self._command("start" if self._wanted else "stop", 0)

    def _command(self, name: str, now_ns: int) -> bool:
        self._counter += 1
        return self._write(probe_protocol.command(name, self._counter, self._settings.protocol == "ascii", now_ns))

    def _write(self, data: bytes) -> bool:
        """Send where the line takes bytes: on a full one pyserial would try for ever."""
        if self._line is None or not select.select([], [self._line], [], 0.0)[1]:
            return False
        return int(self._line.write(data)) == len(data)

    def _take_answer(self, answer: Answer, now_ns: int) -> None:
        if answer.kind == "info":
            self.info = answer.text
        elif 0 <= now_ns - answer.sent_ns < int(_EXCHANGE_S * 1e9):
            self.clock.observe(answer.unit_ns, now_ns, (now_ns - answer.sent_ns) // 2)

    def _note(self, reading: Reading) -> None:
        self.faults += int(bool(reading.status & FAULT))
        for bit, words in CLIP_WORDS.items() if reading.status else ():
            if reading.status & bit:
                self.clips[words] = self.clips.get(words, 0) + 1

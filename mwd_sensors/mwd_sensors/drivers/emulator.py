# SPDX-License-Identifier: Apache-2.0
"""
Emulate a probe without hardware: send samples of a recording or a scenario on a pseudo terminal.

The emulator obeys the commands of `probe_protocol`: start and stop the samples, report its time, report its name.
"""

from __future__ import annotations

import collections
import fcntl
import functools
import operator
import os
import select
import struct
import termios
import time
import tty
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from mwd_sensors.core.arrays import Samples
from mwd_sensors.drivers import mtdata2, polled_line, probe_protocol
from mwd_sensors.drivers.readings import LAYOUTS, UnitAnswer, UnitSample, readings_of

NAME = "mwd emulator 1"
XSENS_FIELD_T = 50e-6  #: field that the emulated MTi reports as 1, T; the driver's `xsens_field_ut` must be 50
PROTOCOLS = ("binary", "ascii", "xsens", "polled")
# Longest wait for commands between two samples, and for the host to read the line, s.
_WAIT_S = 0.02
# At the end the emulator keeps the line open until it has had no unread bytes for `_QUIET_S`, s, at most for
# `_LONGEST_DRAIN_S`, s: closing the line would discard unread bytes.
_QUIET_S, _LONGEST_DRAIN_S = 0.2, 10.0


class Emulator:
    """
    Emulated probe at the unit's end of a serial line.

    Parameters
    ----------
    protocol : str
        binary, ascii, xsens or polled. With xsens the unit sends no samples of a precision unit, and obeys start and
        stop only. With polled the unit replies to each request with its newest samples, and sends nothing by itself.
    link : Path, optional
        Symbolic link to create for the host's end of the line, whose own name is /dev/pts/....
    wait_for_start : bool
        Send nothing until the command start, or the first request, arrives.
    frame : PolledFrame, optional
        Frame of the protocol "polled"; None for the default frame.
    """

    def __init__(
        self,
        protocol: str,
        link: Path | None = None,
        wait_for_start: bool = False,
        frame: polled_line.PolledFrame | None = None,
    ) -> None:
        self._protocol = protocol
        self._unit = polled_line.PolledLineUnit(frame or polled_line.PolledFrame()) if protocol == "polled" else None
        self._values: dict[str, float] = {}
        self._asked: polled_line.Poll | bytes | None = None  # request that is not answered yet
        self._master, self._slave = os.openpty()
        for end in (self._master, self._slave):
            tty.setraw(end)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)  #: name of the host's end of the line, for the driver
        self._link = link
        if link is not None:
            if link.is_symlink():
                link.unlink()
            link.symlink_to(self.device)
        self._commands = probe_protocol.Splitter(protocol == "ascii")
        self._sending = not wait_for_start
        # For an MTi: bytes of commands received, and the readings since its last packet; polled: the newest readings.
        self._heard, self._beside = b"", dict[str, UnitSample]()
        self._answers: collections.deque[UnitAnswer] = collections.deque()
        self._counter = 0
        self._before_ns = 0
        # Clock of the unit: stamp of the first sample (at rate 0 of the newest), ns; steady time at which the first
        # sample was sent, s; unit seconds per second of the wall clock.
        self._unit_ns, self._began, self._rate = 0, 0.0, 0.0
        self.sent = 0  #: number of samples sent

    def play(self, blocks: Iterable[Mapping[str, Samples]], rate: float = 1.0) -> None:
        """
        Send all samples of the blocks, each a mapping of topic to samples, in the order of their stamps.

        rate is the number of sample seconds per second of the wall clock; 0 sends as fast as the line accepts the
        bytes, or as the host asks for the samples. Return when the host has read all bytes, or `_LONGEST_DRAIN_S` after
        the last sample.
        """
        for reading in _in_order(blocks):
            if not self._began:
                self._unit_ns = reading.stamp_ns
                while not self._sending:
                    self._obey(_WAIT_S)
                self._began, self._rate = time.monotonic(), rate
            while not self._sending:
                self._obey(_WAIT_S)
            if rate > 0.0:
                while (left := (reading.stamp_ns - self._time_ns()) * 1e-9 / rate) > 0.0:
                    self._obey(min(left, _WAIT_S))
            else:
                self._unit_ns = reading.stamp_ns
            self._send(self._encoded(reading))
            self._answer()
            if self._unit is not None and rate == 0.0 and reading.topic == "imu/data_raw":
                self._wait_for_request(self._unit)
            self.sent += 1
        self._drain()

    def _time_ns(self) -> int:
        """Return the unit's time, which continues between samples; at rate 0 it is the stamp of the last sample."""
        return self._unit_ns + int((time.monotonic() - self._began) * self._rate * 1e9)

    def close(self) -> None:
        """Close the line and remove its link."""
        os.close(self._master)
        os.close(self._slave)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _wait_for_request(self, unit: polled_line.PolledLineUnit) -> None:
        """Wait until the host has requested the newest values, at most for `_LONGEST_DRAIN_S`, s."""
        answered, end = unit.answered, time.monotonic() + _LONGEST_DRAIN_S
        while unit.answered == answered and time.monotonic() < end:
            self._obey(_WAIT_S)

    def _encoded(self, reading: UnitSample) -> bytes:
        if self._unit is not None:
            self._beside[reading.topic] = reading
            self._values |= dict(zip(polled_line.NAMES[reading.topic], reading.values, strict=True))
            self._values[polled_line.TIME] = reading.stamp_ns
            self._values[polled_line.STATUS] = functools.reduce(
                operator.or_, (one.status for one in self._beside.values())
            )
            return b""
        if self._protocol != "xsens":
            self._counter += 1
            return probe_protocol.sample(reading, self._counter, self._protocol == "ascii")
        if reading.topic != "imu/data_raw":
            self._beside[reading.topic] = reading
            return b""
        self._counter += 1
        interval = max((reading.stamp_ns - self._before_ns) * 1e-9, 1e-4) if self._before_ns else 0.01
        self._before_ns = reading.stamp_ns
        beside, self._beside = self._beside, {}
        return mtdata2.packet(reading, interval, reading.stamp_ns // 100_000, self._counter, beside, XSENS_FIELD_T)

    def _send(self, data: bytes) -> None:
        """Write all bytes and read commands meanwhile, so that two full queues cannot block each other."""
        while data:
            self._listen(0.0)
            _, ready, _ = select.select([], [self._master], [], _WAIT_S)
            if ready:
                data = data[os.write(self._master, data) :]

    def _drain(self) -> None:
        """Answer commands until the line has had no unread bytes for `_QUIET_S`, at most for `_LONGEST_DRAIN_S`."""
        began = busy = time.monotonic()
        while (now := time.monotonic()) < min(busy + _QUIET_S, began + _LONGEST_DRAIN_S):
            self._obey(_WAIT_S)
            if self._unread():
                busy = now

    def _unread(self) -> int:
        """Return the number of bytes on the line that the host has not read."""
        (count,) = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)))
        return int(count)

    def _obey(self, wait_s: float) -> None:
        """Wait at most wait_s, s, for commands; obey and answer them."""
        self._listen(wait_s)
        self._answer()

    def _answer(self) -> None:
        """
        Send the answers that wait; a polled unit answers only after its first IMU sample.

        The answers are sent between two frames, never within one.
        """
        if self._unit is not None and self._asked is not None and "imu/data_raw" in self._beside:
            asked, self._asked = self._asked, None
            self._send(asked if isinstance(asked, bytes) else polled_line.reply(self._unit.frame, asked, self._values))
        while self._answers:
            self._counter += 1
            told = self._answers.popleft()
            self._send(probe_protocol.answer(told, self._counter, self._protocol == "ascii"))

    def _listen(self, wait_s: float) -> None:
        """Read the commands that arrive within wait_s, s, and queue their answers."""
        ready, _, _ = select.select([self._master], [], [], wait_s)
        if not ready:
            return
        data = os.read(self._master, 4096)
        if self._protocol == "xsens":
            self._hear(data)
            return
        if self._unit is not None:
            self._asked = self._unit.feed(data) or self._asked
            self._sending = self._sending or self._asked is not None
            return
        for kind, content in self._commands.feed(data):
            asked = probe_protocol.requested(kind, content)
            if asked is None:
                continue
            name, host_ns = asked
            if name in ("start", "stop"):
                self._sending = name == "start"
                continue
            told = UnitAnswer("time", "", host_ns, self._time_ns()) if name == "time" else UnitAnswer("info", NAME)
            self._answers.append(told)

    def _hear(self, data: bytes) -> None:
        """Obey the newest command for an MTi: measure (start) or configure (stop); a command may arrive in parts."""
        self._heard = (self._heard + data)[-64:]
        start = self._heard.rfind(mtdata2.message(mtdata2.GO_TO_MEASUREMENT))
        stop = self._heard.rfind(mtdata2.message(mtdata2.GO_TO_CONFIG))
        if start != stop:  # both are -1 if neither command arrived
            self._sending = start > stop


def _in_order(blocks: Iterable[Mapping[str, Samples]]) -> Iterator[UnitSample]:
    """Yield the readings of each block in the order of stamps; the blocks follow each other in time."""
    for block in blocks:
        rows = [
            (one.stamp_ns, order, one)
            for order, topic in enumerate(LAYOUTS)
            if topic in block
            for one in readings_of(topic, block[topic])
        ]
        rows.sort(key=lambda row: row[:2])
        yield from (one for _, _, one in rows)

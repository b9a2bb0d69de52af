# SPDX-License-Identifier: Apache-2.0
"""
Connection to a probe on a serial line: open and reopen the line, read samples and track the unit's clock.

Reading does not block, so that a node's timer or a plain loop can do it.
"""

from __future__ import annotations

import collections
import dataclasses
import select
import time
from pathlib import Path

import serial  # type: ignore[import-untyped]

from mwd_sensors.core.settings import setting
from mwd_sensors.drivers import mtdata2, polled_line, probe_protocol
from mwd_sensors.drivers.mtdata2 import MtReader
from mwd_sensors.drivers.probe_protocol import ProbeReader
from mwd_sensors.drivers.readings import CLIP_WORDS, FAULT, UnitAnswer, UnitSample

_RETRY_S = 1.0  # time between two attempts to open the line
# Time between two requests for the time of the unit, s: usually, and while the offset of its clock is not known.
_EXCHANGE_S, _FIRST_S = 1.0, 0.1
_END_OF_TIME_NS = 2**31 * 10**9  # smallest stamp, ns, that does not fit into a message


@dataclasses.dataclass(frozen=True)
class LineSettings:
    """Serial line of a probe."""

    port: str = setting("/dev/ttyUSB0", "Device of the serial line; with `mwd emulate`, the name that it prints.")
    baud: int = setting(
        921600, "Speed of the line; 8 data bits, no parity, 1 stop bit.", unit="bit/s", low=1200, high=12_000_000
    )
    protocol: str = setting(
        "binary",
        "Protocol of the line: binary (COBS frames with CRC-16), ascii (text lines with CRC-16), xsens (MTData2) or "
        "polled (RS-485: this machine asks, the unit replies).",
        choices=("binary", "ascii", "xsens", "polled"),
    )
    clock: str = setting(
        "host",
        "Stamps of the samples: host (the unit's time converted to the time of this machine) or unit (unchanged, for "
        "example when a recording is played).",
        choices=("host", "unit"),
    )
    xsens_field_ut: float = setting(
        0.0,
        "Magnetic field that an MTi reports as 1: the field at the place of its calibration. 0 means not known; its "
        "magnetometer is then not used.",
        low=0.0,
        high=100.0,
    )
    frame_file: str = setting(
        "",
        "Frame of the protocol polled, a YAML file: address, requests, replies, timeout. Empty: Modbus RTU, unit 1, "
        "all values in input registers from 0.",
    )
    wait_for_listener_s: float = setting(
        0.0, "Longest wait for subscribers before the line is opened; 0 opens it at once.", low=0.0, high=600.0
    )


def polled_frame(settings: LineSettings) -> polled_line.PolledFrame:
    """
    Return the frame for the protocol "polled": the frame in `frame_file`, or the default frame if no file is set.

    Raises
    ------
    ValueError
        The file cannot be used, or `clock` is "unit" and the replies in the file do not contain the time of the unit.
    OSError
        The file cannot be read.
    """
    if not settings.frame_file:
        return polled_line.PolledFrame()
    frame = polled_line.read(Path(settings.frame_file).expanduser(), polled_line.PROBE_QUANTITIES)
    if settings.clock == "unit" and polled_line.TIME not in frame.quantities:
        raise ValueError("clock: the replies have no time of the unit; set clock to host")
    return frame


class SerialProbe:
    """Connection to one probe."""

    def __init__(self, settings: LineSettings) -> None:
        self._settings = settings
        self._frame = polled_frame(settings)
        self._polled_ns = -1  # unit time of the last polled sample
        self._line: serial.Serial | None = None
        self._next_try = self._next_exchange = 0.0
        self._counter = 0
        # Whether the unit shall send samples, and the number of samples received before the last exchange.
        self._wanted, self._received_before = True, 0
        self.failure = ""  #: reason why the line cannot be opened or was lost; empty while it is open
        self.connections = 0  #: number of times that the line was opened
        self.info = ""  #: name, serial number and version that the unit reports
        self.clips: dict[str, int] = {}  #: number of samples in which each axis was clipped
        self.faults = 0  #: number of samples in which the unit reports a fault
        self.received = 0  #: number of samples received
        self._open_reader()

    def _open_reader(self) -> None:
        self.clock = UnitClock()
        if self._settings.protocol == "polled":
            self._reader: MtReader | ProbeReader | polled_line.Master = polled_line.Master(self._frame)
            return
        text = self._settings.protocol == "ascii"
        xsens = self._settings.protocol == "xsens"
        self._reader = MtReader(1e-6 * self._settings.xsens_field_ut) if xsens else ProbeReader(text)

    @property
    def connected(self) -> bool:
        """Whether the line is open."""
        return self._line is not None

    @property
    def reader(self) -> MtReader | ProbeReader | polled_line.Master:
        """Decoder of the line with its counters; each opening of the line makes a new decoder."""
        return self._reader

    @property
    def offset_ns(self) -> int:
        """Offset that is added to the unit's stamps, ns."""
        return self.clock.offset_ns if self._settings.clock == "host" else 0

    def poll(self, now_ns: int) -> list[UnitSample]:
        """
        Return the samples that the unit has sent since the last call; now_ns is the host's time, ns since 1970.

        The result is empty while the line is not open, and until the offset of the unit's clock is known
        (`clock_known`). A line that is not open is opened, at most once in `_RETRY_S`.
        """
        moment = time.monotonic()
        if self._line is None:
            if moment >= self._next_try:
                self._next_try = moment + _RETRY_S
                self._open()
            return []
        try:
            data = self._line.read(max(self._line.in_waiting, 1))
            if isinstance(self._reader, polled_line.Master):
                return self._polled(self._reader, data, moment, now_ns)
            if moment >= self._next_exchange:
                awaited = self._settings.clock == "host" and not self.clock.known
                self._next_exchange = moment + (_FIRST_S if awaited else _EXCHANGE_S)
                self._exchange(now_ns)
        except OSError as error:
            self._lose(error)
            return []
        found: list[UnitSample] = []
        for one in self._reader.feed(data) if data else ():
            if isinstance(one, UnitAnswer):
                self._take_answer(one, now_ns)
            elif 0 <= one.stamp_ns + self.offset_ns < _END_OF_TIME_NS:
                if self._settings.clock == "host" and self.clock.hear(one.stamp_ns):
                    # Ask for the time of the new start at once.
                    self._next_exchange = 0.0
                    found.clear()
                found.append(one)
                self._note(one)
            else:
                self._reader.counters.broken += 1
        if found and self._settings.protocol == "xsens":
            self.clock.observe(found[-1].stamp_ns, now_ns)
        self.received += len(found)
        # Without a known offset a sample cannot be stamped with the host's time.
        return found if self.clock_known else []

    def _polled(self, master: polled_line.Master, data: bytes, moment: float, now_ns: int) -> list[UnitSample]:
        """
        Return the samples of the replies that `data` completes, and send the next request if it is due.

        moment is the steady time, s. A sample that the unit has sent before is skipped. The result is empty until the
        offset of the unit's clock is known.
        """
        found: list[UnitSample] = []
        for values, sent_s in master.feed(data, moment):
            # The unit measures somewhere between request and reply.
            half_ns = round(0.5 * (moment - sent_s) * 1e9)
            unit = values.get(polled_line.TIME)
            if unit is None:
                stamp_ns = now_ns - half_ns
            elif not 0 <= unit < _END_OF_TIME_NS:
                master.counters.broken += 1
                continue
            else:
                stamp_ns = int(unit)
                self.clock.observe(stamp_ns, now_ns, half_ns)
                if stamp_ns == self._polled_ns:
                    continue  # the unit sent the same sample as in its last reply
            self._polled_ns = stamp_ns
            found += polled_line.readings(values, stamp_ns)
        if self._wanted and (asked := master.due(moment)) and not self._write(asked):
            master.cancel()
        for one in found:
            self._note(one)
        self.received += len(found)
        return found if self.clock_known else []

    @property
    def clock_known(self) -> bool:
        """Whether samples can be stamped: True unless the offset from unit time to host time is needed and unknown."""
        timed = self._settings.protocol != "polled" or polled_line.TIME in self._frame.quantities
        return not timed or self._settings.clock == "unit" or self.clock.known

    def stream(self, on: bool) -> bool:
        """
        Tell the unit to send samples or to stop; return whether the command could be sent.

        A polled unit needs no command: the result is then whether the line is open.
        """
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
            # No write timeout: a probe without power reads nothing, and a write must not wait for it.
            self._line = serial.Serial(settings.port, settings.baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            self.failure = f"{settings.port}: {getattr(error, 'strerror', None) or error}"
            return
        self.failure = ""
        self.connections += 1
        self._next_exchange = 0.0
        self._open_reader()
        if settings.protocol == "polled":
            return
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
        """
        Request the unit's time, except from an Xsens unit.

        Repeat the start command if no samples arrived since the last call: the unit may have lost power.
        """
        silent, self._received_before = self.received == self._received_before, self.received
        if silent and self._wanted:
            self._ask_for_samples()
        if self._settings.protocol != "xsens":
            self._command("time", now_ns)

    def _ask_for_samples(self) -> bool:
        """
        Send the command to start or stop samples; return whether it could be sent.

        A polled unit needs no command; then return True.
        """
        if self._settings.protocol == "polled":
            return True
        if self._settings.protocol == "xsens":
            return self._write(mtdata2.message(mtdata2.GO_TO_MEASUREMENT if self._wanted else mtdata2.GO_TO_CONFIG))
        return self._command("start" if self._wanted else "stop", 0)

    def _command(self, name: str, now_ns: int) -> bool:
        self._counter += 1
        return self._write(probe_protocol.command(name, self._counter, self._settings.protocol == "ascii", now_ns))

    def _write(self, data: bytes) -> bool:
        """
        Send bytes if the line accepts data; return whether all bytes were sent.

        On a full line pyserial would try without end.
        """
        if self._line is None or not select.select([], [self._line], [], 0.0)[1]:
            return False
        return int(self._line.write(data)) == len(data)

    def _take_answer(self, answer: UnitAnswer, now_ns: int) -> None:
        if answer.kind == "info":
            self.info = answer.text
        elif 0 <= now_ns - answer.sent_ns < int(_EXCHANGE_S * 1e9):
            self.clock.observe(answer.unit_ns, now_ns, (now_ns - answer.sent_ns) // 2)

    def _note(self, reading: UnitSample) -> None:
        self.faults += int(bool(reading.status & FAULT))
        for bit, words in CLIP_WORDS.items() if reading.status else ():
            if reading.status & bit:
                self.clips[words] = self.clips.get(words, 0) + 1


# Clock of a unit compared with the host's clock: the offset to add to the unit's stamps.


# Number of newest observations whose smallest offset is used. With more of them the offset would lag behind a drift.
_KEPT = 600
_SLEW = 5e-4  # largest change of the offset per elapsed time, s/s
# A change above _STEP_NS means that a clock was set, but only if this many observations agree on it within _ALIKE_NS
# over at least _LASTING_NS. Otherwise messages were delayed in a busy host: they arrive all at once or with varying
# delay.
_STEP_NS, _AGREEING, _ALIKE_NS, _LASTING_NS = 200_000_000, 3, 50_000_000, 2_500_000_000
# A sample this much older than an earlier one comes from a unit that has restarted. Units that send the samples of each
# sensor in blocks stay within a second.
_RESTART_NS = 2_000_000_000


class UnitClock:
    """Estimate of the offset from the unit's time to the host's time."""

    def __init__(self) -> None:
        self.offset_ns = 0  #: offset in force; 0 before it is known
        self.jumps = -1  #: number of times that the offset changed at once; -1 before it is known
        self.known = False  #: whether the offset is that of the unit's present start
        self._seen: collections.deque[int] = collections.deque(maxlen=_KEPT)
        # Host time and offset of recent observations that differ from the present offset but agree with each other.
        self._off: list[tuple[int, int]] = []
        self._last_ns = self._unit_ns = self._newest_ns = 0

    def hear(self, unit_ns: int) -> bool:
        """
        Record the stamp of a sample; return whether it shows that the unit has restarted.

        The offset is then not known until several observations agree, because the offset of the earlier start would
        give stamps that are wrong by the time for which the unit had been running.
        """
        restarted = self.known and unit_ns < self._newest_ns - _RESTART_NS
        if restarted:
            self.known = False
            self._seen.clear()
            self._off.clear()
        self._newest_ns = unit_ns if restarted else max(self._newest_ns, unit_ns)
        return restarted

    def observe(self, unit_ns: int, host_ns: int, on_the_way_ns: int = 0) -> None:
        """
        Record that the unit's clock showed `unit_ns` at the host time `host_ns` minus on_the_way_ns.

        The offset is known once several observations agree on it: a unit that was just switched on may report a wrong
        time at first, and stamps that jump later would make the estimator lose its state. If the unit restarts, the
        offset changes at once. If a clock was set, the offset changes when several observations agree.

        on_the_way_ns is a known delay, such as half of the duration of an exchange, ns.
        """
        offset = host_ns - on_the_way_ns - unit_ns
        restarted = unit_ns < self._unit_ns - _STEP_NS
        self._unit_ns = unit_ns
        if not self.known:
            self._agree(host_ns, offset)
            if len(self._off) < _AGREEING:
                return
            self._jump(min(one for _, one in self._off))
        elif restarted:
            self._jump(offset)
        elif abs(offset - self.offset_ns) > _STEP_NS:
            self._doubt(host_ns, offset)
        else:
            self._off.clear()
            self._seen.append(offset)
        best = min(self._seen)
        most = int(_SLEW * max(host_ns - self._last_ns, 0)) if self._last_ns else _STEP_NS
        self.offset_ns += max(-most, min(most, best - self.offset_ns))
        self._last_ns = host_ns

    def _doubt(self, host_ns: int, offset: int) -> None:
        """
        Record an observation of the clock offset that differs from the present offset.

        If `_AGREEING` observations agree with each other over `_LASTING_NS`, they give the new offset.
        """
        self._agree(host_ns, offset)
        if len(self._off) >= _AGREEING and abs(host_ns - self._off[0][0]) >= _LASTING_NS:
            self._jump(min(one for _, one in self._off))
        # Limit the list, because a message arrives every few milliseconds.
        self._off = [self._off[0], *self._off[1:][-_AGREEING:]] if self._off else []

    def _agree(self, host_ns: int, offset: int) -> None:
        """Record an observation, and forget earlier observations that differ from it by more than `_ALIKE_NS`."""
        self._off = [one for one in self._off if abs(one[1] - offset) <= _ALIKE_NS]
        self._off.append((host_ns, offset))

    def _jump(self, offset: int) -> None:
        self._seen.clear()
        self._off.clear()
        self._seen.append(offset)
        self.jumps += 1
        self.offset_ns, self.known, self._newest_ns = offset, True, self._unit_ns

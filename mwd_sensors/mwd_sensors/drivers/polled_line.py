# SPDX-License-Identifier: Apache-2.0
"""
Polled line (RS-485, one master) with the CRC-16 of Modbus: master and unit, without access to a port.

Request: start bytes, address, command, fixed data, check. Reply: start bytes, address, command, number of data bytes
if `counted`, data, check. The check covers all bytes from the address on. The default settings are Modbus RTU.
A unit refuses a request as Modbus does: command + 128, then a code. The frame is described in a YAML file.
Source: Modbus Organization, MODBUS over Serial Line, Specification and Implementation Guide, V1.02, 2006.
"""

from __future__ import annotations

import dataclasses
import math
import struct
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import yaml

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_yaml, read_text
from mwd_sensors.core.settings import setting, unknown_key
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.drivers.readings import FIELDS, FrameCounters, UnitSample
from mwd_sensors.telemetry import meanings

FORMS = {
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "float32": "f",
    "float64": "d",
}
TIME, STATUS = "time", "status"
_AXES = {
    "imu/data_raw": ("rate", "force"),
    "gyro/data_raw": ("precision_rate", "precision_force"),
    "imu/mag": ("field",),
    "imu/temperature": (),
}
#: Quantities of each topic of a probe, in the order of its fields.
NAMES = {topic: tuple(f"{name}_{axis}" for name in names for axis in "xyz") for topic, names in _AXES.items()}
NAMES["imu/temperature"] = ("temperature",)
_CHECK_BYTES, _REFUSED, _CODE = 2, 0x80, {1: "unknown command", 2: "unknown data", 3: "wrong number", 4: "unit failed"}
_LARGEST_FLOAT32 = 3.4e38
# Unit of step and offset -> SI value of 1 in this unit. An unknown unit is refused, because its numbers would be wrong
# if they were read as SI.
_UNITS = {one: meanings.factor(one) for one in ("", "rad", "deg", "m/s^2", "g", "mg", "T", "mT", "uT", "nT", "G", "mG")}
_UNITS |= {one: meanings.factor(one) for one in ("degC", "rpm", "V", "mV", "A", "mA", "C", "Ah", "s", "h")}
_UNITS |= {"rad/s": 1.0, "deg/s": math.radians(1.0), "deg/h": math.radians(1.0) / 3600.0, "ms": 1e-3, "us": 1e-6}
_UNITS |= {"m": 1.0, "ft": 0.3048, "m/s": 1.0, "rad/m": 1.0, "m^3/s": 1.0, "gAPI": 1.0}
_UNITS |= {"Pa": 1.0, "bar": 1e5, "N": 1.0, "kN": 1e3, "N m": 1.0}
_LEAST_STEP = 1e-15  # smallest step: below the resolution of any gauge, and far above the smallest float in any unit
_LONGEST = 512  # largest number of bytes kept while no frame is complete; older bytes are dropped
_MODBUS_DATA = 4  # bytes between command and check of a usual Modbus request
_UNKNOWN_COMMAND, _UNKNOWN_DATA = 1, 2


def _octets(text: str, name: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise ValueError(f'{name}: "{text}" is not a number of bytes in hex, such as "0000 0012"') from error


@dataclasses.dataclass(frozen=True)
class ReplyItem:
    """Description of one number in a reply."""

    quantity: str = setting(
        doc="Quantity: for a probe rate_x, force_x, field_x (y, z), the same with precision_ before it for the "
        "precision unit, temperature, status, time; for a host a value of the table of signals. A name that begins "
        "with _ is skipped."
    )
    form: str = setting("float32", "Number format in the reply.", choices=tuple(FORMS))
    step: float = setting(1.0, "Change of the value when the number rises by 1; not 0.", low=-1e15, high=1e15)
    offset: float = setting(
        0.0,
        "Value that the number 0 stands for. For a dip, use the inclination with offset 90 and a negative step.",
        low=-1e15,
        high=1e15,
    )
    unit: str = setting("", "Unit of step and offset, such as deg or nT; without one it is SI.")

    def __post_init__(self) -> None:
        """Raise ValueError if the absolute step is smaller than `_LEAST_STEP`, or the unit is not known."""
        if abs(self.step) < _LEAST_STEP:
            raise ValueError(f"step: must not be 0, or nearer to 0 than {_LEAST_STEP:g}")
        if self.unit not in _UNITS:
            raise ValueError(f"unit: {self.unit!r} is not one of {', '.join(filter(None, _UNITS))}")

    @property
    def line(self) -> tuple[float, float]:
        """SI value of the number 0, and change of the SI value when the number rises by 1."""
        factor = _UNITS[self.unit]
        return self.offset * factor, self.step * factor


@dataclasses.dataclass(frozen=True)
class Poll:
    """One request and its reply."""

    command: int = setting(4, "Code of the command in the request; for Modbus, the function code.", low=0, high=127)
    request: str = setting("", "Bytes between command and check of the request, in hex.")
    items: tuple[ReplyItem, ...] = setting((), "Numbers of the reply, in order.")

    def __post_init__(self) -> None:
        """Raise ValueError if the bytes are not hexadecimal, or the reply has no numbers."""
        _octets(self.request, "request")
        if not self.items:
            raise ValueError("items: a reply needs at least one number")

    @property
    def data(self) -> bytes:
        """Bytes between command and check of the request."""
        return _octets(self.request, "request")

    @property
    def length(self) -> int:
        """Number of data bytes of the reply."""
        return sum(struct.calcsize(FORMS[item.form]) for item in self.items)


def _probe_polls() -> tuple[Poll, ...]:
    """Return the default poll of a probe: Modbus registers 0 to 36 with time, all sensors and status."""
    axes = [*NAMES["imu/data_raw"], *NAMES["imu/mag"], *NAMES["gyro/data_raw"], "temperature"]
    numbers = tuple(ReplyItem(name) for name in axes)
    items = (ReplyItem(TIME, "int64", 1e-9), *numbers, ReplyItem(STATUS, "uint16"))
    poll = Poll(items=items)
    return (dataclasses.replace(poll, request=f"0000{poll.length // 2:04x}"),)


@dataclasses.dataclass(frozen=True)
class PolledFrame:
    """Frame of a polled line, and the timing of the master's requests."""

    address: int = setting(1, "Address of the unit.", low=0, high=255)
    start: str = setting("", "Bytes before the address, in hex; not part of the check.")
    counted: bool = setting(True, "Whether a reply has the number of its data bytes after the command.")
    byte_order: str = setting(
        "big",
        "Order of the bytes of a number; swapped: words of two bytes, the lower word first (CDAB).",
        choices=("big", "little", "swapped"),
    )
    check_order: str = setting("low_first", "Order of the bytes of the check.", choices=("low_first", "high_first"))
    polls: tuple[Poll, ...] = setting(_probe_polls(), "Requests in turn, with their replies.")
    period_s: float = setting(0.01, "Time from one round of requests to the next.", low=0.001, high=60.0)
    timeout_s: float = setting(
        0.2,
        "Longest wait for a reply. A lower value repeats a lost request sooner, but takes a slow reply for a lost one.",
        low=0.002,
        high=10.0,
    )
    retries: int = setting(2, "Number of times that a request is repeated.", low=0, high=10)

    def __post_init__(self) -> None:
        """
        Check the polls.

        Raises ValueError if the start is not hexadecimal, there are no polls, two requests are equal, or a reply is too
        long.
        """
        _octets(self.start, "start")
        if not self.polls:
            raise ValueError("polls: at least one is needed")
        if len({request(self, poll) for poll in self.polls}) < len(self.polls):
            raise ValueError("polls: two requests are the same; their replies cannot be distinguished")
        longest = max(poll.length for poll in self.polls)
        if longest > (255 if self.counted else _LONGEST // 2):
            raise ValueError(f"polls: a reply of {longest} data bytes is too long")

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities that are not skipped."""
        return tuple(item.quantity for poll in self.polls for item in poll.items if not item.quantity.startswith("_"))


def read(path: Path, names: Iterable[str]) -> PolledFrame:
    """
    Read the frame of a polled line.

    Parameters
    ----------
    path : Path
        YAML file.
    names : iterable of str
        Names of the quantities that the file may contain.

    Raises
    ------
    ValueError
        The file is not YAML, describes an impossible frame, or names an unknown quantity.
    OSError
        The file cannot be read.
    """
    try:
        given = load_yaml(read_text(path, budgets.YAML)) or {}
    except (yaml.YAMLError, ValueError) as error:
        raise ValueError(without_contents(path, error)) from None
    if not isinstance(given, dict):
        # The path is a node parameter and may be the path of a secret by mistake. A secret is often a single word,
        # which is valid YAML, and must not be quoted.
        raise ValueError(without_contents(path, ValueError()))  # noqa: TRY004  (a fault of the file)
    try:
        frame = settings.from_mapping(PolledFrame, given)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    known = tuple(names)
    for name in frame.quantities:
        if name not in known:
            raise ValueError(f"{path}: {unknown_key(name, known, 'quantity')}")
    return frame


PROBE_QUANTITIES = (TIME, STATUS, *(name for names in NAMES.values() for name in names))


def check(data: bytes, frame: PolledFrame) -> bytes:
    """Return the two bytes of the CRC-16 of `data`, in the order `check_order` of the frame."""
    # Import the package only here, so that its absence stops the polled lines and nothing else.
    from pymodbus.framer import FramerRTU

    # The two bytes of this number are swapped, so big endian writes the low byte first.
    number: int = FramerRTU.compute_CRC(data)
    return number.to_bytes(_CHECK_BYTES, "big" if frame.check_order == "low_first" else "little")


def _sealed(frame: PolledFrame, body: bytes) -> bytes:
    return bytes.fromhex(frame.start) + body + check(body, frame)


def request(frame: PolledFrame, poll: Poll) -> bytes:
    """Return the bytes of the request of a poll."""
    return _sealed(frame, bytes([frame.address, poll.command]) + poll.data)


def reply(frame: PolledFrame, poll: Poll, values: Mapping[str, float]) -> bytes:
    """
    Return the bytes of the reply to a poll.

    values maps each quantity to its value in SI, the time to ns. A value that is missing, not finite, or outside the
    range of its form is sent as unknown.
    """
    data = b"".join(_packed(item, values.get(item.quantity, math.nan), frame) for item in poll.items)
    count = bytes([poll.length]) if frame.counted else b""
    return _sealed(frame, bytes([frame.address, poll.command]) + count + data)


def _refusal(frame: PolledFrame, command: int, code: int) -> bytes:
    return _sealed(frame, bytes([frame.address, command & 0x7F | _REFUSED, code]))


def _limits(form: str) -> tuple[int, int, int]:
    """Return lowest and highest number of an integer form, and the number that means unknown."""
    bits = 8 * struct.calcsize(FORMS[form])
    if form.startswith("u"):
        return 0, (1 << bits) - 2, (1 << bits) - 1
    return -(1 << bits - 1) + 1, (1 << bits - 1) - 1, -(1 << bits - 1)


def _packed(item: ReplyItem, value: float, frame: PolledFrame) -> bytes:
    offset, step = (0.0, _ticks(item)) if item.quantity == TIME else item.line
    line = (value - offset) / step
    if item.form.startswith("float"):
        largest = _LARGEST_FLOAT32 if item.form == "float32" else sys.float_info.max
        number: float = line if abs(line) <= largest else math.nan
    else:
        low, high, unknown = _limits(item.form)
        # Send a time in ns without float arithmetic, because it has more digits than a float.
        exact = step == 1 and offset == 0.0
        number = unknown if not math.isfinite(line) else int(value) if exact else round(line)
        number = number if low <= number <= high else unknown
    return _ordered(struct.pack(f">{FORMS[item.form]}", number), frame)


def _unpacked(item: ReplyItem, data: bytes, frame: PolledFrame) -> float:
    (number,) = struct.unpack(f">{FORMS[item.form]}", _ordered(data, frame))
    if not item.form.startswith("float") and number == _limits(item.form)[2] and item.quantity != STATUS:
        return math.nan
    offset, step = (0, _ticks(item)) if item.quantity == TIME else item.line
    value: float = offset + number * step
    return value


def _ticks(item: ReplyItem) -> int:
    """Return the time, ns, that one count of a time item stands for; at least 1."""
    return max(round(item.line[1] * NANOSECONDS), 1)


def _ordered(data: bytes, frame: PolledFrame) -> bytes:
    if frame.byte_order == "big":
        return data
    turned = data[::-1]
    if frame.byte_order == "little" or len(data) < 2:
        return turned
    return b"".join(turned[k : k + 2][::-1] for k in range(0, len(data), 2))


def _values(frame: PolledFrame, poll: Poll, data: bytes) -> dict[str, float]:
    """Decode the data of a reply; return quantity -> value in SI, except the time, which is in ns."""
    found, at = {}, 0
    for item in poll.items:
        size = struct.calcsize(FORMS[item.form])
        if not item.quantity.startswith("_"):
            found[item.quantity] = _unpacked(item, data[at : at + size], frame)
        at += size
    return found


def readings(values: Mapping[str, float], stamp_ns: int) -> list[UnitSample]:
    """Return one sample, stamped stamp_ns, for each topic whose values are all present and finite; the IMU is last."""
    status = values.get(STATUS, math.nan)
    bits = int(status) if math.isfinite(status) else 0
    rows = ((topic, tuple(values.get(name, math.nan) for name in NAMES[topic])) for topic in FIELDS)
    return [UnitSample(topic, stamp_ns, row, bits) for topic, row in rows if all(map(math.isfinite, row))]


class ReplyValues(NamedTuple):
    """Values of a reply by quantity, in SI (the time in ns), and the steady time at which the request was sent, s."""

    values: dict[str, float]
    sent_s: float


class Master:
    """
    Master of a polled line: sends the requests in turn and reads the replies.

    Times are in s by any steady clock. After a wait of `timeout_s` for a reply, the line must be quiet for another
    `timeout_s` before the request is repeated, so that a late reply is not mistaken for the reply to the next request.
    """

    def __init__(self, frame: PolledFrame) -> None:
        self.frame = frame
        #: Replies read, replies with errors, and requests without any reply in spite of all repetitions.
        self.counters = FrameCounters()
        self.trouble: dict[str, int] = {}  #: number of errors of each kind, by a sentence about the kind
        self._turn, self._tries = 0, 0
        self._sent: bytes = b""
        self._sent_s, self._free_s, self._round_s = -math.inf, -math.inf, -math.inf
        self._late_s = -math.inf
        self._held = b""

    def due(self, now_s: float) -> bytes:
        """
        Return the request to send at the steady time now_s, s; empty if none is due.

        If no reply has arrived for `timeout_s`, the reason is noted first, and the request is repeated or given up.
        """
        if self._sent:
            if now_s - self._sent_s < self.frame.timeout_s:
                return b""
            self._give_up(now_s)
        if now_s < self._free_s or (self._turn == 0 and not self._tries and now_s < self._round_s):
            return b""
        if self._turn == 0 and not self._tries:
            # A late round does not shift the next one. Missed rounds are not made up for: after a delay of more than a
            # period, only one round follows at once.
            self._round_s = max(self._round_s + self.frame.period_s, now_s)
        self._held = b""
        self._sent, self._sent_s = request(self.frame, self._poll), now_s
        return self._sent

    def cancel(self) -> None:
        """
        Take back a request that could not be sent.

        The request is due again; the first request of a round is due again in the next round.
        """
        self._sent = b""

    @property
    def _poll(self) -> Poll:
        return self.frame.polls[self._turn]

    def feed(self, data: bytes, now_s: float) -> list[ReplyValues]:
        """
        Accept bytes from the line; return the values of the reply that `data` completes, or an empty list.

        A refusal of the unit, and bytes that come without a request, are noted in `trouble`.
        """
        if not data:
            return []
        if not self._sent:
            late = now_s < self._late_s
            self._note("a reply later than timeout_s: raise timeout_s" if late else "bytes that nobody asked for")
            self._free_s = max(self._free_s, now_s + self.frame.timeout_s) if late else self._free_s
            self._late_s = self._free_s if late else self._late_s
            return []
        self._held = (self._held + data)[-_LONGEST:]
        # Many RS-485 adapters return the echo of the master's request.
        self._held = self._held.removeprefix(self._sent)
        start = bytes.fromhex(self.frame.start)
        head = start + bytes([self.frame.address])
        for at in range(len(self._held)):
            if not self._held.startswith(head, at):
                continue
            body = self._held[at + len(start) :]
            if self._is_refusal(body):
                self._note(f"the unit refuses command {self._poll.command}: {_CODE.get(body[2], f'code {body[2]}')}")
                self._finish(now_s)
                return []
            found = self._content(body)
            if found is not None:
                if at:
                    self._note("bytes before a reply: noise, or another unit")
                sent_s = self._sent_s
                self.counters.frames += 1
                self._finish(now_s)
                return [ReplyValues(found, sent_s)]
        return []

    def _is_refusal(self, body: bytes) -> bool:
        whole = 3 + _CHECK_BYTES
        refused = len(body) >= whole and body[1] == self._poll.command | _REFUSED
        return refused and check(body[:3], self.frame) == body[3:whole]

    def _expected(self) -> tuple[bytes, int]:
        """Return the bytes that follow the address in a reply, and the reply's length from the address on, bytes."""
        count = bytes([self._poll.length]) if self.frame.counted else b""
        head = bytes([self._poll.command]) + count
        return head, 1 + len(head) + self._poll.length + _CHECK_BYTES

    def _content(self, body: bytes) -> dict[str, float] | None:
        """Return the values of a reply that begins at `body`; None if it is incomplete or a byte is wrong."""
        head, size = self._expected()
        whole = body[:size]
        if len(whole) < size or not whole.startswith(head, 1):
            return None
        if check(whole[:-_CHECK_BYTES], self.frame) != whole[-_CHECK_BYTES:]:
            return None
        return _values(self.frame, self._poll, whole[1 + len(head) : -_CHECK_BYTES])

    def _finish(self, now_s: float) -> None:
        self._sent, self._held, self._tries = b"", b"", 0
        self._turn = (self._turn + 1) % len(self.frame.polls)
        self._free_s = now_s

    def _give_up(self, now_s: float) -> None:
        """Note why there was no reply; repeat the request, or after the last repetition send the next one."""
        self._note(self._why())
        self.counters.broken += bool(self._held)
        self._tries += 1
        if self._tries > self.frame.retries:
            self.counters.lost += 1
            self._finish(now_s)
        self._sent, self._held = b"", b""
        self._free_s = self._late_s = now_s + self.frame.timeout_s

    def _why(self) -> str:
        """Return a sentence on the bytes that came in place of a reply."""
        held, start = self._held, bytes.fromhex(self.frame.start)
        if not held:
            return "no reply: check power, wires A and B, baud and address"
        head, size = self._expected()
        for at in range(len(held)):
            if not held.startswith(start, at):
                continue
            body = held[at + len(start) :]
            if not body.startswith(head, 1):
                continue
            right = len(body) >= size and check(body[: size - 2], self.frame) == body[size - 2 : size]
            if body[0] != self.frame.address and right:
                return f"a reply of unit {body[0]} in place of unit {self.frame.address}: check the addresses"
            if body[0] == self.frame.address:
                if len(body) < size:
                    return "part of a reply: check the cable and the unit's power, or raise timeout_s"
                return "a reply with a wrong check: noise, termination of the line, or two units with one address"
        return "bytes that are not a reply: noise, wrong baud, or a frame that differs from frame_file"

    def _note(self, words: str) -> None:
        self.trouble[words] = self.trouble.get(words, 0) + 1


class PolledLineUnit:
    """Unit on a polled line: answers the requests of a master."""

    def __init__(self, frame: PolledFrame) -> None:
        self.frame = frame
        self.answered = 0  #: number of replies and refusals
        self.trouble: dict[str, int] = {}  #: number of errors of each kind, by a sentence about the kind
        self._held = b""
        self._requests = {request(frame, poll): poll for poll in frame.polls}

    def feed(self, data: bytes) -> Poll | bytes | None:
        """
        Accept bytes from the line.

        Returns
        -------
        Poll, bytes or None
            The poll of the last request, which the caller answers with `reply`; or the bytes of a refusal, which the
            caller sends; or None if nothing must be sent. A host that repeated its request gets one answer, with the
            newest values.
        """
        self._held = (self._held + data)[-_LONGEST:]
        found: Poll | bytes | None = None
        while (step := self._next()) is not None:
            used, one = step
            self._held = self._held[used:]
            found = one or found
        if found is not None:
            self.answered += 1
        return found

    def _next(self) -> tuple[int, Poll | bytes | None] | None:
        """
        Return the number of bytes to the end of the next complete request, and its poll or refusal.

        The second result is None for a request with a wrong check, which is not answered. Returns None without a
        complete request.
        """
        head = bytes.fromhex(self.frame.start) + bytes([self.frame.address])
        at = self._held.find(head)
        while at >= 0:
            rest = self._held[at:]
            for whole, poll in self._requests.items():
                if rest.startswith(whole):
                    return at + len(whole), poll
            body = rest[len(head) - 1 :]
            size = 2 + _MODBUS_DATA + _CHECK_BYTES
            if len(body) >= size and check(body[: size - 2], self.frame) == body[size - 2 : size]:
                return at + len(head) - 1 + size, self._refused(body[1])
            same = [whole for whole in self._requests if rest.startswith(whole[:-_CHECK_BYTES])]
            if same and len(rest) >= len(same[0]):
                self._note("a request with a wrong check was not answered: noise, or another frame")
                return at + len(same[0]), None
            at = self._held.find(head, at + 1)
        return None

    def _refused(self, command: int) -> bytes:
        known = command in {poll.command for poll in self.frame.polls}
        self._note(f"a request for {'other data' if known else f'command {command}'} was refused: check frame_file")
        return _refusal(self.frame, command, _UNKNOWN_DATA if known else _UNKNOWN_COMMAND)

    def _note(self, words: str) -> None:
        self.trouble[words] = self.trouble.get(words, 0) + 1

# SPDX-License-Identifier: Apache-2.0
"""
Decode and encode the serial protocol of an Xsens MTi: MTData2 packets with increments, field, temperature and status.

A message is 0xFA, bus (0xFF), kind, length, data, and a checksum byte that makes the sum of all bytes after 0xFA zero.
The data of MTData2 (kind 0x36) are items: identifier (2 bytes, big endian), length, content. The low bits of the
identifier give the number format. Increments (DeltaQ, DeltaV) are integrated over one interval of the unit. The driver
divides them by the interval to get mean rate and mean force, which the estimator expects (`tool.samples` integrated).

Source: Xsens, MT Low-Level Communication Protocol Documentation, sections "Message structure" and "MTData2".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core import frames
from mwd_sensors.drivers.readings import CLIPPED_ACCEL, CLIPPED_GYRO, CLIPPED_MAG, FAULT, FrameCounters, UnitSample

PREAMBLE, BUS, MTDATA2 = 0xFA, 0xFF, 0x36
GO_TO_MEASUREMENT, GO_TO_CONFIG = 0x10, 0x30
COUNT, FINE_TIME, TEMPERATURE = 0x1020, 0x1060, 0x0810
ACCELERATION, DELTA_V, RATE_OF_TURN, DELTA_Q, FIELD, STATUS = 0x4020, 0x4010, 0x8020, 0x8030, 0xC020, 0xE020
_TICK_NS, _WRAP = 100_000, 2**32  # unit of the fine time (0.1 ms), and where it wraps
_EXTENDED = 0xFF
# Bit number in the unit's status word -> bit of `UnitSample.status`.
_CLIPS = dict(zip(range(8, 17), (*CLIPPED_ACCEL, *CLIPPED_GYRO, *CLIPPED_MAG), strict=True))
# Number of values in each item that is read; all other items are ignored.
_WIDTHS = {COUNT: 1, FINE_TIME: 1, STATUS: 1, TEMPERATURE: 1}
_WIDTHS |= {ACCELERATION: 3, DELTA_V: 3, RATE_OF_TURN: 3, DELTA_Q: 4, FIELD: 3}
_KIND = 0xFFF0  # mask of an identifier without the number format
_LONGEST = 2 * 2048  # longest message, bytes
_WHOLE_BYTES = 8  # size of the longest integer
_FASTEST_S, _SLOWEST_S = 1e-4, 1.0  # shortest and longest plausible interval of the increments, s


def message(kind: int, data: bytes = b"") -> bytes:
    """Return the bytes of a message of a kind (one byte) with its data."""
    size = bytes([len(data)]) if len(data) < _EXTENDED else bytes([_EXTENDED]) + len(data).to_bytes(2, "big")
    body = bytes([BUS, kind]) + size + data
    return bytes([PREAMBLE]) + body + bytes([-sum(body) & 0xFF])


def item(identifier: int, content: bytes) -> bytes:
    """Return the bytes of an item of MTData2."""
    return struct.pack(">HB", identifier, len(content)) + content


class MtReader:
    """
    Decoder of the bytes of an MTi.

    Parameters
    ----------
    field_t : float
        Field that the unit reports as 1, T: the field at the place of its calibration. If it is 0 (not known),
        magnetometer items are ignored.
    """

    def __init__(self, field_t: float = 0.0) -> None:
        self.counters = FrameCounters()
        self.without_interval = 0  #: number of packets ignored because the interval of their increments is not known
        self._field_t = field_t
        self._held = b""
        self._ticks = -1
        self._time_ns = 0
        self._count = -1

    def feed(self, data: bytes) -> list[UnitSample]:
        """Accept bytes and return the samples of the complete packets."""
        self._held += data
        found: list[UnitSample] = []
        while True:
            at = self._held.find(bytes([PREAMBLE, BUS]))
            if at < 0:
                # The last byte may be the first byte of a message.
                self._held = self._held[-1:] if self._held[-1:] == bytes([PREAMBLE]) else b""
                return found
            self._held = self._held[at:]
            size = self._size()
            if size is None or (len(self._held) < size <= _LONGEST):
                return found
            whole = self._held[:size]
            if size > _LONGEST or sum(whole[1:]) & 0xFF:
                self.counters.broken += 1
                self._held = self._held[1:]
                continue
            self._held = self._held[size:]
            self.counters.frames += 1
            if whole[2] == MTDATA2:
                found += self._packet(whole[6:-1] if whole[3] == _EXTENDED else whole[4:-1])

    def _size(self) -> int | None:
        """Return the size in bytes of the first message, or None if its length has not arrived yet."""
        if len(self._held) < 4:
            return None
        if self._held[3] != _EXTENDED:
            return 5 + self._held[3]
        return 7 + int.from_bytes(self._held[4:6], "big") if len(self._held) >= 6 else None

    def _packet(self, data: bytes) -> list[UnitSample]:
        items: dict[int, tuple[float, ...]] = {}
        at = 0
        while at + 3 <= len(data):
            identifier, size = struct.unpack_from(">HB", data, at)
            content = data[at + 3 : at + 3 + size]
            at += 3 + size
            kind = identifier & _KIND
            if kind in _WIDTHS and len(content) == size:
                items[kind] = _numbers(identifier, content)
        if at != len(data) or any(len(numbers) != _WIDTHS[kind] for kind, numbers in items.items()):
            self.counters.broken += 1
            return []
        return self._readings(items)

    def _readings(self, items: dict[int, tuple[float, ...]]) -> list[UnitSample]:
        if FINE_TIME not in items:
            self.without_interval += 1
            return []
        interval = self._advance(int(items[FINE_TIME][0]), int(items[COUNT][0]) if COUNT in items else None)
        status = _status(int(items[STATUS][0])) if STATUS in items else 0
        found = []
        if TEMPERATURE in items:
            found.append(UnitSample("imu/temperature", self._time_ns, items[TEMPERATURE][:1]))
        if FIELD in items and self._field_t > 0.0:
            field = tuple(self._field_t * value for value in items[FIELD])
            found.append(UnitSample("imu/mag", self._time_ns, field, status))
        motion = _motion(items, interval)
        if motion is not None:
            found.append(UnitSample("imu/data_raw", self._time_ns, motion, status))
        elif DELTA_V in items or DELTA_Q in items:
            self.without_interval += 1
        return found

    def _advance(self, ticks: int, count: int | None) -> float:
        """
        Advance the unit's time by the ticks of a packet; return the interval of the packet's increments, s.

        The interval is NaN for the first packet, and if it is not between `_FASTEST_S` and `_SLOWEST_S`. A unit that
        restarts counts from 0 again; the time then begins at 0.
        """
        before, self._count = self._count, -1 if count is None else count
        step, first = (ticks - self._ticks) % _WRAP, self._ticks < 0
        self._ticks = ticks
        if first or step > _WRAP // 2:
            self._time_ns = 0
            return math.nan
        packets = 1
        if count is not None and before >= 0:
            packets = (count - before) % 65536
            self.counters.lost += max(packets - 1, 0)
        self._time_ns += step * _TICK_NS
        interval = step * _TICK_NS * 1e-9 / max(packets, 1)
        return interval if _FASTEST_S <= interval <= _SLOWEST_S else math.nan


def _numbers(identifier: int, content: bytes) -> tuple[float, ...]:
    """
    Return the numbers of an item.

    Counter, fine time and status are one integer each, or an empty result for more than `_WHOLE_BYTES`. The low bits of
    the identifier give the format of all other items.
    """
    kind = identifier & _KIND
    if kind in (COUNT, FINE_TIME, STATUS):
        # A damaged length could give an integer that is larger than any float.
        return (float(int.from_bytes(content, "big")),) if len(content) <= _WHOLE_BYTES else ()
    form = identifier & 0x3
    code = (">f", ">i", ">Ih", ">d")[form]
    size = struct.calcsize(code)
    rows = struct.iter_unpack(code, content[: len(content) // size * size])
    if form == 1:
        return tuple(value / 2**20 for (value,) in rows)
    if form == 2:
        # Fixed point: the 32 fractional bits come before the 16 integer bits.
        return tuple(whole + part / 2**32 for part, whole in rows)
    return tuple(value for (value,) in rows)


def _motion(items: dict[int, tuple[float, ...]], interval: float) -> tuple[float, ...] | None:
    """
    Return rate, rad/s, and force, m/s^2, of a packet as six numbers, from the increments if the packet has them.

    Returns None if rate or force is missing, or if increments come without a known interval (NaN), s.
    """
    if DELTA_Q in items and DELTA_V in items:
        if math.isnan(interval):
            return None
        w, *vector = items[DELTA_Q]
        length = math.sqrt(sum(v * v for v in vector))
        angle = 2.0 * math.atan2(length, w)
        scale = angle / length if length > 0.0 else 2.0
        return (*(scale * v / interval for v in vector), *(v / interval for v in items[DELTA_V]))
    if RATE_OF_TURN in items and ACCELERATION in items:
        return (*items[RATE_OF_TURN], *items[ACCELERATION])
    return None


def _status(word: int) -> int:
    found = 0 if word & 1 else FAULT  # bit 0: the self-test passed
    for bit, ours in _CLIPS.items():
        found |= ours if word >> bit & 1 else 0
    return found


def _word(status: int) -> int:
    """Return the unit's status word for the bits of `UnitSample.status`; the inverse of `_status`."""
    return sum((1 << bit for bit, ours in _CLIPS.items() if status & ours), 0 if status & FAULT else 1)


def packet(
    reading: UnitSample,
    interval: float,
    ticks: int,
    count: int,
    beside: Mapping[str, UnitSample] | None = None,
    field_t: float = 1.0,
) -> bytes:
    """
    Encode an IMU sample as an MTi packet with increments, and with field and temperature since the previous packet.

    Parameters
    ----------
    reading : UnitSample
        Sample of imu/data_raw.
    interval : float
        Time since the previous packet, s.
    ticks, count : int
        Fine time in ticks, and packet counter.
    beside : mapping of str to UnitSample, optional
        Topic -> sample of imu/mag or imu/temperature since the previous packet.
    field_t : float
        Field that the unit reports as 1, T.
    """
    rate, force = np.array(reading.values[:3]), np.array(reading.values[3:])
    x, y, z, w = frames.quat_from_rotvec(rate * interval).tolist()
    content = item(COUNT, struct.pack(">H", count % 65536)) + item(FINE_TIME, struct.pack(">I", ticks % _WRAP))
    content += item(DELTA_Q | 3, struct.pack(">4d", w, x, y, z))
    content += item(DELTA_V | 3, struct.pack(">3d", *(force * interval).tolist()))
    beside = beside or {}
    if "imu/temperature" in beside:
        content += item(TEMPERATURE | 3, struct.pack(">d", *beside["imu/temperature"].values))
    if "imu/mag" in beside:
        content += item(FIELD | 3, struct.pack(">3d", *(value / field_t for value in beside["imu/mag"].values)))
    word = _word(reading.status | (beside["imu/mag"].status if "imu/mag" in beside else 0))
    return message(MTDATA2, content + item(STATUS, struct.pack(">I", word)))

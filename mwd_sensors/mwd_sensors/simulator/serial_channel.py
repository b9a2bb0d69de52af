# SPDX-License-Identifier: Apache-2.0
"""Serial line with byte errors and breaks, and the frames that a wired tool sends over it."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.pulse_tool import SentWord
from mwd_sensors.telemetry import on_air, serial_frames
from mwd_sensors.telemetry.on_air import Group
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


@dataclasses.dataclass(frozen=True)
class SerialChannel:
    """Errors of a serial line."""

    bit_errors: float = setting(0.0, "Probability that a data bit arrives wrong.", low=0.0, high=0.5)
    lost_bytes: float = setting(0.0, "Probability that a byte is lost (overrun, framing error).", low=0.0, high=0.5)
    breaks_per_hour: float = setting(0.0, "Number of breaks of the line per hour.", low=0.0, high=1000.0)
    break_s: float = setting(2.0, "Duration of a break.", low=0.0, high=600.0)


class SerialStream:
    """Serial line that changes and loses bytes and breaks at random times."""

    def __init__(self, channel: SerialChannel, baud: int, seed: int) -> None:
        self._channel, self._byte_s = channel, serial_frames.BITS_PER_BYTE / baud
        self._errors, self._breaks = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
        self._break = 0.0
        self._next_break()

    def _next_break(self) -> None:
        """Draw the time of the next break, s; infinity if the channel has no breaks."""
        hourly = self._channel.breaks_per_hour
        self._break += self._breaks.exponential(3600.0 / hourly) if hourly > 0.0 else np.inf

    def carry(self, start_s: float, data: bytes) -> bytes:
        """
        Return the bytes that arrive if `data` is sent.

        The bytes are sent without a pause from the time start_s, s, which must rise from call to call.
        """
        raw = np.frombuffer(data, dtype=np.uint8).copy()
        wrong = np.flatnonzero(self._errors.random(len(raw) * 8) < self._channel.bit_errors)
        np.bitwise_xor.at(raw, wrong // 8, (1 << wrong % 8).astype(np.uint8))
        kept = self._errors.random(len(raw)) >= self._channel.lost_bytes
        at = start_s + self._byte_s * np.arange(len(raw))
        while len(at) and self._break <= at[-1]:
            end = self._break + self._channel.break_s
            kept &= (at < self._break) | (at >= end)
            if end > at[-1]:
                break
            self._next_break()
        return raw[kept].tobytes()


def transmit(tool: ToolConfiguration, seconds: float, seed: int) -> tuple[bytes, tuple[SentWord, ...]]:
    """Return the bytes and the words of a transmission of random values: first a survey, then repeated toolfaces."""
    random = np.random.default_rng(seed)
    out, words = bytearray(), []
    kind, items, counter = "survey", tool.surveys[0], 0
    at = tool.transmit_delay_s
    while items and at < seconds:
        codes = tuple(int(random.integers(tool.table[item.name].codes(item.bits))) for item in items)
        frame = on_air.signal(tool, Group(kind, 0, 0, items), tool.sent(items, codes), counter).octets
        end = at + len(frame) * serial_frames.BITS_PER_BYTE / tool.serial.baud
        out += frame
        words += [SentWord(at, end, counter, item.name, item.bits, c) for item, c in zip(items, codes, strict=True)]
        at = max(end, at + tool.serial.period_s)
        kind, items, counter = "toolface", tool.sequence("toolface", 0), counter + 1
    return bytes(out), tuple(words)

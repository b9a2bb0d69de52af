"""A serial line with byte errors and breaks, and the frames that a wired tool sends through it."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.pulse_tool import SentWord
from mwd_sensors.telemetry import serial_frames
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


@dataclasses.dataclass(frozen=True)
class SerialChannel:
    """What a line does to bytes."""

    bit_errors: float = setting(0.0, "Probability that a data bit arrives wrong.", low=0.0, high=0.5)
    lost_bytes: float = setting(0.0, "Probability that a byte is lost (overrun, framing error).", low=0.0, high=0.5)
    breaks_per_hour: float = setting(0.0, "Times the line is broken.", low=0.0, high=1000.0)
    break_s: float = setting(2.0, "How long it stays broken.", unit="s", low=0.0, high=600.0)


def damaged(channel: SerialChannel, data: bytes, baud: int, random: np.random.Generator) -> bytes:
    """Bytes as they arrive; `data` is sent without a pause."""
    raw = np.frombuffer(data, dtype=np.uint8).copy()
    wrong = np.flatnonzero(random.random(len(raw) * 8) < channel.bit_errors)
    np.bitwise_xor.at(raw, wrong // 8, (1 << wrong % 8).astype(np.uint8))
    kept = random.random(len(raw)) >= channel.lost_bytes
    seconds = len(raw) * serial_frames.BITS_PER_BYTE / baud
    for at in random.uniform(0.0, seconds, random.poisson(channel.breaks_per_hour * seconds / 3600.0)):
        first, last = (round(t * baud / serial_frames.BITS_PER_BYTE) for t in (at, at + channel.break_s))
        kept[first:last] = False
    return raw[kept].tobytes()


def transmit(tool: ToolConfiguration, seconds: float, seed: int) -> tuple[bytes, tuple[SentWord, ...]]:
    """Bytes of random values, and what they stand for: a survey first, then toolfaces for ever."""
    random = np.random.default_rng(seed)
    out, words = bytearray(), []
    kind, items, counter = "survey", tool.surveys[0], 0
    at = tool.transmit_delay_s
    while at < seconds:
        codes = tuple(int(random.integers(tool.table[item.name].codes(item.bits))) for item in items)
        frame = _frame(tool, kind, items, codes, counter)
        end = at + len(frame) * serial_frames.BITS_PER_BYTE / tool.serial.baud
        out += frame
        words += [SentWord(at, end, counter, item.name, item.bits, c) for item, c in zip(items, codes, strict=True)]
        at = max(end, at + tool.serial.period_s)
        kind, items, counter = "toolface", tool.toolfaces[0], counter + 1
    return bytes(out), tuple(words)


def _frame(
    tool: ToolConfiguration, kind: str, items: tuple[SequenceItem, ...], codes: tuple[int, ...], counter: int
) -> bytes:
    if tool.serial.format == "ascii":
        pairs = zip(items, codes, strict=True)
        return serial_frames.encode_line(
            [serial_frames.written(item, tool.table[item.name], code) for item, code in pairs], tool.serial.check
        )
    return serial_frames.encode((kind, 0), counter, tool.sent(items, codes), items, tool.table_check)

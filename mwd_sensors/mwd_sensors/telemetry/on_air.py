# SPDX-License-Identifier: Apache-2.0
"""Signals that a tool transmits: groups of words as pulses, phases of a carrier or bytes on a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.telemetry import carrier, pulse_position, serial_frames
from mwd_sensors.telemetry.carrier import BlockName, Complex
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


class Group(NamedTuple):
    """
    Words sent together.

    kind ("survey", "toolface") and number identify the sequence; place is the position of the group in the sequence.
    """

    kind: str
    number: int
    place: int
    items: tuple[SequenceItem, ...]


class GroupSignal(NamedTuple):
    """Signal of a group of words; times are by the clock of the tool."""

    #: `duration_s`, `period_s`: duration of the signal, and shortest time from its start to the start of the next
    #: signal.
    duration_s: float
    period_s: float
    edges_s: tuple[float, ...] = ()  #: for pulses: start of each pulse relative to the start of the signal, s
    phases: tuple[float, ...] = ()  #: for a carrier: phase of each symbol, rad, 0 to 2 pi
    octets: bytes = b""  #: for a serial line: bytes of the frame or of the line of text


def groups(tool: ToolConfiguration, kind: str, number: int) -> tuple[Group, ...]:
    """
    Return the groups of a sequence sent once: single words for pulses, blocks for a carrier, one frame for a line.

    Parameters
    ----------
    kind : str
        "survey" or "toolface"; no groups if the tool sends no such sequence.
    number : int
        Number of the sequence; a number above the last one selects the last sequence.
    """
    items = tool.sequence(kind, number)
    if not items:
        return ()
    if tool.code == "psk":
        parts: Sequence[tuple[SequenceItem, ...]] = carrier.blocks_of(items, tool.carrier.block_bits)
    elif tool.code == "serial":
        parts = (items,)
    else:
        parts = [(item,) for item in items]
    return tuple(Group(kind, number, place, part) for place, part in enumerate(parts))


def signal(tool: ToolConfiguration, group: Group, sent: Sequence[int], counter: int = 0) -> GroupSignal:
    """
    Return the signal of a group.

    Parameters
    ----------
    sent : sequence of int
        Transmitted codes, including parity bits, as from `ToolConfiguration.sent`.
    counter : int
        Counter of serial frames.
    """
    if tool.code == "psk":
        phases = np.angle(block_symbols(tool, group, sent)) % (2.0 * np.pi)
        return GroupSignal(tool.carrier.block_s, tool.carrier.block_s, phases=tuple(phases.tolist()))
    if tool.code == "serial":
        octets = _frame(tool, group, sent, counter)
        on_line = len(octets) * serial_frames.BITS_PER_BYTE / tool.serial.baud
        return GroupSignal(on_line, max(on_line, tool.serial.period_s), octets=octets)
    edges: list[float] = []
    at = 0
    for code, length in zip(sent, (item.length for item in group.items), strict=True):
        one = pulse_position.encode(code, length)
        edges += [(at + edge) * tool.tu_s for edge in one.edges]
        at += one.length
    return GroupSignal(at * tool.tu_s, at * tool.tu_s, edges_s=tuple(edges))


def block_symbols(tool: ToolConfiguration, group: Group, sent: Sequence[int]) -> Complex:
    """Return the symbols of a block, shape (block_symbols,), each of magnitude 1; `sent` as in `signal`."""
    name, lengths = BlockName(group.kind, group.number, group.place), [item.length for item in group.items]
    return carrier.symbols(tool.carrier, carrier.block_bits(tool.carrier, name, sent, lengths, tool.table_check))


def sync(tool: ToolConfiguration) -> GroupSignal:
    """Return the signal of the sync, the pulse pattern with which a transmission starts."""
    duration = tool.sync.length_tu * tool.tu_s
    return GroupSignal(duration, duration, edges_s=tuple(edge * tool.tu_s for edge in tool.sync.edges_tu))


def _frame(tool: ToolConfiguration, group: Group, sent: Sequence[int], counter: int) -> bytes:
    if tool.serial.format == "binary":
        return serial_frames.encode((group.kind, group.number), counter, sent, group.items, tool.table_check)
    pairs = [(item, code >> 1 if item.parity else code) for item, code in zip(group.items, sent, strict=True)]
    texts = [serial_frames.written(item, tool.table[item.name], code) for item, code in pairs]
    return serial_frames.encode_line(texts, tool.serial.check)

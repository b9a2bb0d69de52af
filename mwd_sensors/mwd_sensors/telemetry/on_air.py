# SPDX-License-Identifier: Apache-2.0
"""What goes on air: words that are sent together, as pulses, as phases of a carrier or as bytes of a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.telemetry import carrier, serial_frames
from mwd_sensors.telemetry.carrier import BlockName
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


class Group(NamedTuple):
    """Words that go on air together: kind ("survey", "toolface") and number of their sequence, place in it."""

    kind: str
    number: int
    place: int
    items: tuple[SequenceItem, ...]


class Signal(NamedTuple):
    """
    A group on air, on the clock of the tool.

    Attributes
    ----------
    duration_s, period_s : float
        How long it lasts, and when the next one may begin after its start.
    edges_s : tuple of float
        Pulses: begin of each after the start.
    phases : tuple of float
        Carrier: of each symbol, rad, 0 to 2 pi.
    octets : bytes
        Serial line.
    """

    duration_s: float
    period_s: float
    edges_s: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()
    octets: bytes = b""


def groups(tool: ToolConfiguration, kind: str, number: int) -> tuple[Group, ...]:
    """
    Groups of one pass of a sequence: single words in pulses, blocks on a carrier, a whole frame on a line.

    Parameters
    ----------
    tool : ToolConfiguration
    kind : str
        "survey" or "toolface".
    number : int
        Of the sequence; beyond the last one, the last one.
    """
    sequences = tool.surveys if kind == "survey" else tool.toolfaces
    items = sequences[min(number, len(sequences) - 1)]
    if tool.code == "psk":
        parts: Sequence[tuple[SequenceItem, ...]] = carrier.blocks_of(items, tool.carrier.block_bits)
    elif tool.code == "serial":
        parts = (items,)
    else:
        parts = [(item,) for item in items]
    return tuple(Group(kind, number, place, part) for place, part in enumerate(parts))


def signal(tool: ToolConfiguration, group: Group, sent: Sequence[int], counter: int = 0) -> Signal:
    """
    Signal of a group.

    Parameters
    ----------
    tool : ToolConfiguration
    group : Group
    sent : sequence of int
        Codes as they are sent, as `ToolConfiguration.sent` gives them: parity bit included.
    counter : int
        Of serial frames.
    """
    lengths = [item.length for item in group.items]
    if tool.code == "psk":
        name = BlockName(group.kind, group.number, group.place)
        bits = carrier.block_bits(tool.carrier, name, sent, lengths, tool.table_check)
        phases = np.angle(carrier.symbols(tool.carrier, bits)) % (2.0 * np.pi)
        return Signal(tool.carrier.block_s, tool.carrier.block_s, phases=tuple(phases.tolist()))
    if tool.code == "serial":
        octets = _frame(tool, group, sent, counter)
        on_line = len(octets) * serial_frames.BITS_PER_BYTE / tool.serial.baud
        return Signal(on_line, max(on_line, tool.serial.period_s), octets=octets)
    edges: list[float] = []
    at = 0
    for code, length in zip(sent, lengths, strict=True):
        one = tool.pulses(code, length)
        edges += [(at + edge) * tool.tu_s for edge in one.edges]
        at += one.length
    return Signal(at * tool.tu_s, at * tool.tu_s, edges_s=tuple(edges))


def sync(tool: ToolConfiguration) -> Signal:
    """Start of a transmission in pulses."""
    duration = tool.sync.length_tu * tool.tu_s
    return Signal(duration, duration, edges_s=tuple(edge * tool.tu_s for edge in tool.sync.edges_tu))


def _frame(tool: ToolConfiguration, group: Group, sent: Sequence[int], counter: int) -> bytes:
    if tool.serial.format == "binary":
        return serial_frames.encode((group.kind, group.number), counter, sent, group.items, tool.table_check)
    pairs = [(item, code >> 1 if item.parity else code) for item, code in zip(group.items, sent, strict=True)]
    texts = [serial_frames.written(item, tool.table[item.name], code) for item, code in pairs]
    return serial_frames.encode_line(texts, tool.serial.check)

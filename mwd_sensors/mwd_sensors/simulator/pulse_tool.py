# SPDX-License-Identifier: Apache-2.0
"""Simulate a pulse tool: after each flow-on the tool sends a sync and a survey once, then toolfaces repeatedly."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.simulator.mud_channel import RATE_HZ, MudChannel, Pressure
from mwd_sensors.telemetry import pulse_position
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode


class SentWord(NamedTuple):
    """
    One transmitted word.

    start_s and end_s are by the clock of the surface, s. frame is the number of the transmitted sequence, from 0; raw
    is the transmitted code.
    """

    start_s: float
    end_s: float
    frame: int
    name: str
    bits: int
    raw: int


@dataclasses.dataclass(frozen=True)
class SentTransmission:
    """Everything that a tool transmitted: words, and begin and end of each pulse, shape (n, 2), s."""

    words: tuple[SentWord, ...]
    pulses: Array


@dataclasses.dataclass(frozen=True)
class LinkRun:
    """Simulated transmission through mud, and the standpipe pressure that it causes."""

    time_s: Array  #: shape (n,); times, s
    pressure_pa: Array  #: shape (n,); standpipe pressure, Pa
    strokes_s: tuple[Array, ...]  #: times of the counted strokes of each pump
    sent: SentTransmission  #: the transmission


def transmit(
    tool: ToolConfiguration, flows: tuple[tuple[float, float], ...], seed: int, clock: float = 0.0, resync: bool = False
) -> SentTransmission:
    """
    Return the simulated transmission of random values.

    Parameters
    ----------
    tool : ToolConfiguration
        Tool configuration; its first survey and toolface sequences are sent.
    flows : tuple of (float, float)
        Begin and end of each span with flow, s.
    seed : int
        Seed of the random values.
    clock : float
        Relative error of the tool's clock: 1e-3 makes all durations 0.1 % longer.
    resync : bool
        Whether each toolface sequence begins with its own sync.
    """
    random = np.random.default_rng(seed)
    tu = tool.tu_s * (1.0 + clock)
    words: list[SentWord] = []
    pulses: list[tuple[float, float]] = []
    frame = 0
    for begin, end in flows:
        at, items, number = begin + tool.transmit_delay_s, tool.surveys[0], 0
        first = True
        while True:
            codes = tuple(int(random.integers(tool.table[item.name].codes(item.bits))) for item in items)
            sent = encode(tool, items, codes, number if first or resync else None)
            if at + sent.length * tu > end:
                break
            pulses += [(at + edge * tu, at + (edge + pulse_position.PULSE_TU) * tu) for edge in sent.edges]
            head = sent.length - tool.length_tu(items)
            words += _placed(items, codes, at + head * tu, (tu, frame))
            at += sent.length * tu
            items, first = tool.sequence("toolface", 0), False
            frame += 1
            if not items:
                break
    return SentTransmission(tuple(words), np.array(pulses).reshape(-1, 2))


def _placed(
    items: tuple[SequenceItem, ...], codes: tuple[int, ...], at: float, clock: tuple[float, int]
) -> list[SentWord]:
    tu, frame = clock
    placed = []
    for item, code in zip(items, codes, strict=True):
        length = pulse_position.encode(0, item.length).length * tu
        placed.append(SentWord(at, at + length, frame, item.name, item.bits, code))
        at += length
    return placed


def link_run(
    channel: MudChannel,
    sent: SentTransmission,
    seconds: float,
    seed: int,
    drive: Callable[[Array], Array] = np.zeros_like,
) -> LinkRun:
    """
    Return the simulated standpipe pressure of a channel during a transmission.

    seed is the seed of the noise; drive returns the signal of a siren, -1 to 1, at times, s.
    """
    stream = Pressure(channel, sent.pulses, seed)
    stream.modulate(drive)
    blocks = []
    length = 0
    while length < seconds * RATE_HZ:
        blocks.append(stream.block())
        length += len(blocks[-1])
    pressure = np.concatenate(blocks)
    return LinkRun(np.arange(length) / RATE_HZ, pressure, tuple(stream.strokes()), sent)

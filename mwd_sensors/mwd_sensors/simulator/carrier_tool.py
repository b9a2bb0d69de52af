# SPDX-License-Identifier: Apache-2.0
"""Simulate a tool with a carrier: after each flow-on the tool sends a survey once, then toolfaces repeatedly."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.pulse_tool import LinkRun, SentTransmission, SentWord, link_run
from mwd_sensors.telemetry import on_air
from mwd_sensors.telemetry.carrier import Complex
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

# Medium -> share of a symbol's duration in which the phase changes. The rotor of a siren needs time for the change, a
# current source does not.
_SHIFT = {"mud": 0.1, "earth": 0.0, "coil": 0.0}
SIREN_PA = 2.0e5  # amplitude of a siren's pressure drop, Pa
_SIREN_RISE_S = 0.005  # time constant of a siren's pressure drop, s
# Two spans of symbols count as one if the gap between them is shorter than this share of a symbol: stamps are rounded.
_NO_GAP = 0.05


@dataclasses.dataclass(frozen=True)
class CarrierSpan:
    """Symbols as complex numbers of magnitude 1, shape (n,), that are sent without a break from the time begin_s, s."""

    begin_s: float
    symbols: Complex


@dataclasses.dataclass(frozen=True)
class CarrierSent:
    """Everything that a tool sent on a carrier."""

    words: tuple[SentWord, ...]
    spans: tuple[CarrierSpan, ...]  #: spans of symbols in order of time
    #: `frequency_hz`, `symbol_s`: carrier frequency, Hz, and symbol duration, s, by the clock of the surface.
    frequency_hz: float
    symbol_s: float
    shift: float  #: share of a symbol during which the phase changes from the phase of the previous symbol

    def drive(self, time_s: Array) -> Array:
        """Return the signal at times, s, shape (n,): a cosine of amplitude 1 while the tool sends, otherwise 0."""
        out = np.zeros(len(time_s))
        for span in self.spans:
            out += _driven(span, self.frequency_hz, self.symbol_s, self.shift, time_s)
        return out


class CarrierStream:
    """
    Signal of a carrier to which symbols are added while it is being sent.

    Parameters
    ----------
    medium : str
        Medium of the carrier: mud, earth or coil. A mud rotor needs time to change its phase.
    """

    def __init__(self, medium: str) -> None:
        self._shift = _SHIFT[medium]
        self._spans: list[tuple[CarrierSpan, float, float]] = []

    def add(self, begin_s: float, symbols: Complex, symbol_s: float, frequency_hz: float) -> None:
        """
        Send symbols from the time begin_s, s.

        If the new symbols follow the last ones without a gap, the carrier's phase continues. Symbols that are still
        being sent at that time are cut off at that time.
        """
        if self._spans:
            last, symbol, frequency = self._spans[-1]
            end = last.begin_s + len(last.symbols) * symbol
            if abs(begin_s - end) < _NO_GAP * symbol_s and (symbol, frequency) == (symbol_s, frequency_hz):
                symbols, begin_s = np.concatenate([last.symbols, symbols]), last.begin_s
                self._spans.pop()
            elif begin_s < end:
                kept = last.symbols[: max(math.floor((begin_s - last.begin_s) / symbol), 1)]
                self._spans[-1] = CarrierSpan(last.begin_s, kept), symbol, frequency
        self._spans.append((CarrierSpan(begin_s, symbols), symbol_s, frequency_hz))

    def drive(self, time_s: Array) -> Array:
        """Return the signal at times, s, shape (n,), like `CarrierSent.drive`; times must rise from call to call."""
        out = np.zeros(len(time_s))
        self._spans = [one for one in self._spans if one[0].begin_s + len(one[0].symbols) * one[1] > time_s[0] - 1.0]
        for span, symbol_s, frequency in self._spans:
            out += _driven(span, frequency, symbol_s, self._shift, time_s)
        return out


def _driven(span: CarrierSpan, frequency_hz: float, symbol_s: float, shift: float, time_s: Array) -> Array:
    """Return the signal of one span of symbols at times, s, shape (n,); 0 outside the span."""
    out = np.zeros(len(time_s))
    inside = (time_s >= span.begin_s) & (time_s < span.begin_s + len(span.symbols) * symbol_s)
    if not inside.any():
        return out
    since = time_s[inside] - span.begin_s
    place = np.minimum((since / symbol_s).astype(np.int64), len(span.symbols) - 1)
    turns = np.angle(span.symbols[1:] * np.conj(span.symbols[:-1]))
    phase = np.angle(span.symbols[0]) + np.concatenate([[0.0], np.cumsum(turns)])
    last = phase[np.maximum(place - 1, 0)]
    share = since / symbol_s - place
    done = np.minimum(share / shift, 1.0) if shift > 0.0 else np.ones(len(share))
    now = last + (phase[place] - last) * done
    out[inside] = np.cos(2.0 * math.pi * frequency_hz * since + now)
    return out


def transmit(
    tool: ToolConfiguration, flows: tuple[tuple[float, float], ...], seed: int, clock: float = 0.0
) -> CarrierSent:
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
    """
    random = np.random.default_rng(seed)
    carrier = tool.carrier
    length = carrier.block_s * (1.0 + clock)
    words: list[SentWord] = []
    spans = []
    frame = 0
    for begin, end in flows:
        at, blocks = begin + tool.transmit_delay_s, on_air.groups(tool, "survey", 0)
        first, sent = at, []
        while blocks and at + length <= end:
            for block in blocks:
                if at + length > end:
                    break
                codes = tuple(int(random.integers(tool.table[item.name].codes(item.bits))) for item in block.items)
                sent.append(on_air.block_symbols(tool, block, tool.sent(block.items, codes)))
                words += [
                    SentWord(at, at + length, frame, item.name, item.bits, code)
                    for item, code in zip(block.items, codes, strict=True)
                ]
                at += length
            blocks = on_air.groups(tool, "toolface", 0)
            frame += 1
        if sent:
            spans.append(CarrierSpan(first, np.concatenate(sent)))
    return CarrierSent(
        tuple(words),
        tuple(spans),
        carrier.frequency_hz / (1.0 + clock),
        (1.0 + clock) / carrier.symbol_rate_hz,
        _SHIFT[carrier.medium],
    )


def siren_run(channel: MudChannel, sent: CarrierSent, seconds: float, seed: int) -> LinkRun:
    """
    Return the simulated standpipe pressure with a siren in place of the valve.

    sent : signal of the siren.
    seconds : duration, s.
    seed : seed of the noise.
    """
    siren = dataclasses.replace(channel, valve_pa=SIREN_PA, rise_s=_SIREN_RISE_S)
    return link_run(siren, SentTransmission(sent.words, np.zeros((0, 2))), seconds, seed, sent.drive)

# SPDX-License-Identifier: Apache-2.0
"""Compile the receiver's kernels before the first sample arrives."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import on_air
from mwd_sensors.telemetry.pulse_position import PULSE_TU
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode
from mwd_surface.receiver.link.receivers import receiver_of

# Samples per time unit of the code, or per carrier period; more than in the receiver's grid, as from a gauge.
_SAMPLES = 100.0
_NOISE = 0.1  # standard deviation relative to the amplitude; the noise model needs some noise


def warm_up(tools: Iterable[ToolConfiguration]) -> None:
    """Receive an artificial survey of each tool, which runs every kernel, so that the first sample is not delayed."""
    for tool in tools:
        if tool.code != "serial":  # no kernel is needed to read bytes
            _receive_survey(tool)


def _receive_survey(tool: ToolConfiguration) -> None:
    carrier = tool.code == "psk"
    duration = tool.transmit_delay_s + tool.head_s + tool.seconds(tool.surveys[0])
    at = np.arange(0.0, duration, (1.0 / tool.carrier.frequency_hz if carrier else tool.tu_s) / _SAMPLES)
    receiver = receiver_of(tool)
    noise = np.random.default_rng(0).normal(0.0, _NOISE, len(at))
    since = at - tool.transmit_delay_s
    receiver.push(at, noise + (_carrier(tool, since) if carrier else _pulses(tool, since)))
    receiver.finish()


def _pulses(tool: ToolConfiguration, time_s: Array) -> Array:
    """Return the pulses of a survey of zeros at times from its start, s; shapes (n,), no unit."""
    items = tool.surveys[0]
    edges = np.array(encode(tool, items, (0,) * len(items), 0).edges) * tool.tu_s
    since = time_s - edges[np.maximum(np.searchsorted(edges, time_s, side="right") - 1, 0)]
    return ((since >= 0.0) & (since < PULSE_TU * tool.tu_s)).astype(float)


def _carrier(tool: ToolConfiguration, time_s: Array) -> Array:
    """Return the carrier of a survey of zeros at times from its start, s; shapes (n,), no unit."""
    phases: list[float] = []
    for group in on_air.groups(tool, "survey", 0):
        phases += on_air.signal(tool, group, tool.sent(group.items, (0,) * len(group.items))).phases
    symbol = np.floor(time_s * tool.carrier.symbol_rate_hz).astype(int)
    phase = np.array(phases)[np.clip(symbol, 0, len(phases) - 1)]
    return np.where(time_s >= 0.0, np.cos(2.0 * np.pi * tool.carrier.frequency_hz * time_s + phase), 0.0)

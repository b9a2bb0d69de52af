# SPDX-License-Identifier: Apache-2.0
"""
A second mud channel for benchmarks of the pulse receiver, which shares no code with the simulator's own.

The model differs on purpose. The line is a chain of scattering junctions (two sizes of drill pipe, heavy-weight pipe,
collars) with losses that grow as the root of the frequency, instead of Womersley's impedances. The surface end is a
reflector with the resonance of a dampener and a lossy manifold. The valve closes and opens at different speeds, and its
pulses differ in size and time. Pumps are sums of harmonics with sizes of their own, whose phase and size wander, plus a
knock of a valve at each stroke. Drilling noise is a coloured, heavy-tailed process whose level changes by the minute.
The flow-on has an overshoot and a slow relaxation of gelled mud. The stroke counter has jitter and misses strokes.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import pulse_position
from mwd_sensors.telemetry.pulse_position import packets, window_tu
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode

RATE_HZ = 50.0
_LENGTH = 4096  # samples of the impulse response: 82 s
FLOW_ON_S = 20.0


@dataclasses.dataclass(frozen=True)
class OtherMud:
    """Well and noise; see the module for the model. Pressures in Pa."""

    depth_m: float = 4000.0
    speed: float = 1190.0
    dampener_hz: float = 0.75
    gauge_m: float = 18.0
    pump_pa: float = 3.0e4
    drilling_pa: float = 1.6e4
    white_pa: float = 400.0


class Frame(NamedTuple):
    """One flow-on with one frame: samples, strokes with jitter, exact strokes, and the words as (name, code, begin)."""

    time_s: Array
    pressure_pa: Array
    strokes: dict[int, Array]
    exact: dict[int, Array]
    words: list[tuple[str, int, float]]


def _transfer(mud: OtherMud, frequency: Array) -> NDArray[np.complex128]:
    """Pressure at the gauge divided by that of the valve: scattering junctions, losses, reflecting ends."""
    f = np.maximum(frequency, 0.25 * frequency[1])
    area = np.array([0.0092, 0.0078, 0.0046, 0.0040])  # upper and lower pipe, heavy-weight pipe, collars, m^2
    length = np.array([0.6, 0.4, 0.0, 0.0]) * (mud.depth_m - 350.0) + np.array([0.0, 0.0, 200.0, 150.0])
    # Neper per metre. The loss that grows as the root has equal real and imaginary parts, so the response is causal.
    loss = (1.0 + 1.0j) * np.sqrt(f) * 2.3e-4 * np.sqrt(0.009 / area[:, None]) + 1.2e-4
    wave = np.exp(-(loss + 2j * math.pi * f / mud.speed) * length[:, None])
    # Reflector at the surface: dampener (closed below its resonance, open above) with a lossy manifold.
    ratio = f / mud.dampener_hz
    end = 0.85 * (1.0 - ratio**2 - 0.6j * ratio) / (1.0 + ratio**2 + 0.9j * ratio)
    delay = np.exp(-4j * math.pi * f * mud.gauge_m / mud.speed)
    # Fold the sections from the top: reflection seen from below and transmission to the gauge.
    reflected, passed = end * delay, 1.0 + end * delay
    for k in range(len(area)):
        junction = (area[k + 1] - area[k]) / (area[k + 1] + area[k]) if k + 1 < len(area) else 0.0
        reflected, passed = reflected * wave[k] ** 2, passed * wave[k]
        bottom = -junction
        passed = passed * (1.0 - bottom) / (1.0 - bottom * reflected * -1.0)
        reflected = (reflected - bottom) / (1.0 - bottom * reflected)
    bit = 0.55 * np.exp(-2j * math.pi * f * 2.0 * 22.0 / mud.speed)  # nozzles, 22 m below the valve
    return np.asarray(passed * (1.0 - bit) / (1.0 - 0.35 * reflected), dtype=np.complex128)


def response(mud: OtherMud) -> Array:
    """Impulse response from valve to gauge, shape (4096,)."""
    frequency = np.fft.rfftfreq(_LENGTH, 1.0 / RATE_HZ)
    gauge = 1.0 / (1.0 + 1j * frequency / 9.0) ** 3
    return np.asarray(np.fft.irfft(_transfer(mud, frequency) * gauge, _LENGTH))


def _ramp(time: Array, begin: float, closes: float) -> Array:
    """Smooth step of a valve that moves for `closes` seconds."""
    x = np.clip((time - begin) / closes, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def _pulses(edges: Array, width: float, seconds: float, random: np.random.Generator) -> Array:
    out = np.zeros(round(seconds * RATE_HZ))
    fine = 8
    for edge in edges:
        begin = edge + random.normal(0.0, 0.003)
        first = max(int((begin - 0.1) * RATE_HZ), 0)
        count = int((width + 0.6) * RATE_HZ)
        time = (first * fine + np.arange(count * fine) + 0.5) / (RATE_HZ * fine)
        shape = _ramp(time, begin, 0.09) - _ramp(time, begin + width, 0.15)
        one = random.normal(1.0, 0.04) * shape.reshape(count, fine).mean(axis=1)
        end = min(first + count, len(out))
        out[first:end] += one[: end - first]
    return out


def _drilling(count: int, random: np.random.Generator) -> Array:
    """Coloured, heavy-tailed noise of unit size: a resonance, 1/f, and a level that changes by the minute."""
    white = random.standard_t(5, size=count + 3000)
    b, a = signal.iirpeak(0.45, 1.2, RATE_HZ)
    slow = signal.lfilter([1.0], [1.0, -0.985], white)
    motion = signal.lfilter(b, a, random.normal(size=count + 3000))
    total = slow / slow.std() + 0.7 * motion / motion.std() + 0.15 * white / white.std()
    level = signal.lfilter([1.0], [1.0, -math.exp(-1.0 / (40.0 * RATE_HZ))], random.normal(size=count + 3000))
    return np.asarray((total / total.std() * np.exp(0.15 * level / level.std()))[3000:])


def _pumps(flow: Array, random: np.random.Generator) -> tuple[Array, list[Array]]:
    """Pressure of two pumps of unit size each, and the times of their strokes."""
    total, strokes = np.zeros(len(flow)), []
    for base in (1.37, 1.58):
        rate = base * (1.0 + 0.01 * random.normal())
        hunt = signal.lfilter([1.0], [1.0, -math.exp(-1.0 / (12.0 * RATE_HZ))], random.normal(size=len(flow)))
        turns = random.uniform() + np.cumsum(rate * flow * (1.0 + 0.002 * hunt / hunt.std())) / RATE_HZ
        sizes = np.array([0.5, 0.35, 1.0, 0.15, 0.12, 0.7, 0.1, 0.1, 0.35, 0.08]) * random.lognormal(0.0, 0.3, 10)
        one = np.zeros(len(flow))
        for k, size in enumerate(sizes, 1):
            wander = np.cumsum(random.normal(0.0, 0.008, len(flow)))
            one += size * np.cos(2.0 * math.pi * k * turns + 0.3 * wander + random.uniform(0.0, 6.3))
        at = np.flatnonzero(np.diff(np.floor(turns)) > 0)
        knock = np.zeros(len(flow))
        knock[at] = random.normal(1.0, 0.3, len(at))
        one += 2.0 * signal.lfilter([1.0, -1.0], [1.0, -1.3, 0.6], knock)
        total += one * flow
        share = (np.floor(turns[at + 1]) - turns[at]) / (turns[at + 1] - turns[at])
        strokes.append((at + 1 + share) / RATE_HZ)
    return total, strokes


def _level(time: Array, flow: Array) -> Array:
    """Standpipe pressure with an overshoot at flow-on and the relaxation of gelled mud."""
    since = np.maximum(time - FLOW_ON_S, 0.0)
    return np.asarray(2.1e7 * flow**1.75 * (1.0 + 0.04 * np.exp(-since / 9.0) + 0.004 * np.exp(-since / 60.0)))


def _noise(mud: OtherMud, time: Array, flow: Array, random: np.random.Generator) -> tuple[Array, list[Array]]:
    pumps, strokes = _pumps(flow, random)
    noise = mud.pump_pa * pumps + mud.drilling_pa * _drilling(len(time), random) * flow
    return noise + random.normal(0.0, mud.white_pa, len(time)), strokes


def valve_pa(mud: OtherMud, tool: ToolConfiguration, error: float, hours: int = 4) -> float:
    """
    Return the pressure drop of the valve, Pa, at which an ideal receiver decodes this share of words wrongly.

    The ideal receiver knows response, time, all other pulses and the mean spectrum of the noise; it uses soft parities.
    Its errors are counted in simulated noise whose level changes, so there are more of them than in stationary noise.
    """
    size = round(3600.0 * RATE_HZ)
    time = np.arange(size) / RATE_HZ
    pulse = np.zeros(size)
    one = _pulses(np.array([20.0]), tool.pulse_width_s, 80.0, np.random.default_rng(1))
    one = signal.oaconvolve(one / one.max(), response(mud))[:_LENGTH]
    pulse[: len(one)] = one
    frequency, spectrum = np.fft.rfftfreq(size, 1.0 / RATE_HZ), np.fft.rfft(pulse)
    metrics, wholes = [], []
    for hour in range(hours):
        random = np.random.default_rng(7000 + hour)
        noise, _ = _noise(mud, time, np.ones(size), random)
        coarse, density = signal.welch(noise, RATE_HZ, nperseg=4096, detrend="linear")
        band = (frequency > 0.05) & (frequency < 1.6 / tool.tu_s)
        matched = np.where(band, spectrum.conj() / np.interp(frequency, coarse, density), 0.0) * 2.0 / RATE_HZ
        metrics.append(np.fft.irfft(matched * np.fft.rfft(noise), size))
        wholes.append(np.fft.irfft(matched * spectrum, size))
    whole = np.mean(wholes, axis=0)
    low, high = 1e3, 1e8
    for _ in range(24):
        middle = math.sqrt(low * high)
        wrong = np.mean([_word_errors(one, whole, middle, tool) for one in metrics])
        low, high = (middle, high) if wrong > error else (low, middle)
    return high


def _word_errors(metric: Array, whole: Array, valve: float, tool: ToolConfiguration, bits: int = 13) -> float:
    """Share of wrong words of a receiver that knows everything but the words; metric: matched filter of the noise."""
    tu, at = tool.tu_s * RATE_HZ, 10000.0
    wrong: list[bool] = []
    random = np.random.default_rng(5)
    while at < len(metric) - 10000:
        # Best metric of words that differ from the sent word in an even and in an odd number of bits; its metric.
        best, truth = np.array([0.0, -np.inf]), 0.0
        for size in packets(bits):
            sent = int(random.integers(1 << size))
            places = np.arange(1 << size)
            noise = metric[np.rint(at + places * tu).astype(int)]
            signal_ = whole[np.rint(np.abs(places - sent) * tu).astype(int)] - 0.5 * whole[0]
            value = valve * noise + valve**2 * signal_
            odd = np.array([int(k ^ sent).bit_count() & 1 for k in places], dtype=bool)
            even_best, odd_best = value[~odd].max(), value[odd].max()
            best = np.array(
                [max(best[0] + even_best, best[1] + odd_best), max(best[1] + even_best, best[0] + odd_best)]
            )
            truth += value[sent]
            at += window_tu(size) * tu
        wrong.append(bool(best[0] > truth + 1e-9))
    return float(np.mean(wrong))


def frame(
    mud: OtherMud, tool: ToolConfiguration, valve: float, seed: int, jitter_s: float = 0.004, missed: float = 0.0
) -> Frame:
    """One flow-on with sync and survey sequence of random values, then some seconds without pulses."""
    random = np.random.default_rng(seed)
    items = tool.surveys[0]
    codes = tuple(int(random.integers(tool.table[item.name].codes(item.bits))) for item in items)
    sent = encode(tool, items, codes, 0)
    tu = tool.tu_s * (1.0 + random.normal(0.0, 4e-4))
    begin = FLOW_ON_S + tool.transmit_delay_s + random.uniform(0.0, 2.0)
    seconds = begin + sent.length * tu + 60.0 * tool.tu_s + 10.0
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    flow = np.clip((time - FLOW_ON_S) / 4.0, 0.0, 1.0)
    noise, exact = _noise(mud, time, flow, random)
    pulses = valve * _pulses(begin + np.array(sent.edges) * tu, tool.pulse_width_s, seconds, random)
    total = _level(time, flow) + noise + signal.oaconvolve(pulses, response(mud))[: len(time)]
    step = 4.0e7 / 2**16
    words, at = [], begin + (tool.sync.length_tu + tool.header_tu) * tu
    for item, code in zip(items, codes, strict=True):
        words.append((item.name, code, at))
        at += pulse_position.encode(0, item.length).length * tu
    counted = {pump: np.sort(one[random.uniform(size=len(one)) >= missed] + 0.0) for pump, one in enumerate(exact, 1)}
    strokes = {pump: np.sort(one + random.normal(0.0, jitter_s, len(one))) for pump, one in counted.items()}
    return Frame(time, np.round(total / step) * step, strokes, dict(enumerate(exact, 1)), words)

# SPDX-License-Identifier: Apache-2.0
"""
The telemetry link: word errors of the pulse receiver against what no receiver can beat, and its confidence.

    python tests/benchmarks/bench_link.py [seeds]
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
import time

import numpy as np
from scipy import signal

import telemetry_limits as limits
from mwd_sensors.simulator.mud_channel import RATE_HZ, MudChannel, Pressure, PressureNoise, Pump, WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.words import BELIEVED

FLOW_ON = 20.0
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.01)


def tool_of(width):
    return ToolConfiguration(pulse_width_s=width, toolface_sequences=("3{2{aTFA:6:P} Gama:8:P} Inc:12:P Azm:12:P",))


def seconds_of(tool, passes):
    on_air = tool.length_tu(tool.surveys[0]) + passes * tool.length_tu(tool.toolfaces[0]) + tool.sync.length_tu
    return FLOW_ON + tool.transmit_delay_s + (on_air + 60) * tool.tu_s + 5.0


def word_limit(channel, tool):
    """Word error of a receiver that knows channel, time and noise, the noise taken as stationary (pumps as lines)."""
    silent = dataclasses.replace(channel, flow_off_s=())
    stream = Pressure(silent, np.zeros((0, 2)), 99)
    noise = np.concatenate([stream.block() for _ in range(130)])[6000:]
    quiet = dataclasses.replace(
        silent, pumps=(), noise=PressureNoise(bit_pa=0.0, surface_pa=0.0, gauge_pa=0.0, adc_bits=24)
    )
    stream = Pressure(quiet, np.array([[20.0, 20.0 + tool.pulse_width_s]]), 0)
    pulse = np.concatenate([stream.block() for _ in range(8)])
    frequency, density = signal.welch(noise, RATE_HZ, nperseg=8000, detrend="linear")
    spectrum = np.fft.rfft(pulse - np.median(pulse), 8000) / RATE_HZ
    band = (frequency > 0.05) & (frequency < 1.6 / tool.tu_s)
    share = 4.0 * np.abs(spectrum[band]) ** 2 / density[band] * frequency[1]
    common = np.array([np.sum(share * np.cos(2.0 * np.pi * frequency[band] * lag * tool.tu_s)) for lag in range(12)])
    return limits.channel_word_error(common, 13)


def received_of(tool, run, sent, counted=False):
    """(right, confidence, believed) of each word that was sent; None where nothing was received; and the speed."""
    began = time.perf_counter()
    receiver = PulseReceiver(tool)
    for pump, strokes in enumerate(run.strokes_s if counted else ()):
        receiver.strokes(pump, strokes)
    words = receiver.push(run.time_s, run.pressure_pa).words + receiver.finish().words
    speed = run.time_s[-1] / (time.perf_counter() - began)
    late = np.median([w.start_s for w in words[:1]]) - sent.words[0].start_s if words else 0.0
    rows = []
    for one in sent.words:
        near = [w for w in words if w.name == one.name and abs(w.start_s - one.start_s - late) < 6.0 * tool.tu_s]
        rows.append((near[0].raw == one.raw, near[0].confidence, near[0].status == BELIEVED) if near else None)
    return rows, speed


def case(channel, tool, seeds, counted=False, clock=5e-4, passes=3):
    """Rows of all seeds, and the median speed; counted: the receiver is given the strokes of the pumps."""
    rows, speeds = [], []
    for seed in range(seeds):
        seconds = seconds_of(tool, passes)
        sent = transmit(tool, ((FLOW_ON, seconds),), seed, clock if seed % 2 else -clock)
        started = dataclasses.replace(channel, flow_off_s=((-100.0, FLOW_ON),))
        got, speed = received_of(tool, link_run(started, sent, seconds, 1000 + seed), sent, counted)
        rows += got
        speeds.append(speed)
    return rows, float(np.median(speeds))


def figures(rows):
    """Word error (a word not received is an error), share believed, share of the believed that is wrong."""
    wrong = np.mean([row is None or not row[0] for row in rows])
    believed = [row for row in rows if row is not None and row[2]]
    return wrong, len(believed) / len(rows), np.mean([not row[0] for row in believed]) if believed else 0.0


def line(name, rows, limit, speed):
    wrong, believed, false = figures(rows)
    print(
        f"| {name} | {len(rows)} | {limit:.3f} | {wrong:.3f} | {believed:.2f} | {false:.4f} | {speed:.0f} |", flush=True
    )


def main() -> None:
    """All tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    everything = []
    print("Word error; limit: channel, time and noise known, soft parity of 13 bits. Clock of the tool 0.05 % off.\n")
    head = "words | limit | word error | believed | of these wrong | x real time |\n|---|---|---|---|---|---|---|"
    print(f"| pulse width, depth | {head}")
    for width, depths in ((0.8, (3000, 5000, 6000)), (0.5, (3000, 4000, 5000)), (0.3, (2000, 3000, 4000))):
        for depth in depths:
            channel, tool = MudChannel(well=WellGeometry(depth_m=float(depth))), tool_of(width)
            rows, speed = case(channel, tool, seeds)
            everything += rows
            line(f"{width:g} s, {depth} m", rows, word_limit(channel, tool), speed)
    print(f"\n| 0.5 s, 3000 m, with | {head}")
    well, noise = WellGeometry(), PressureNoise()
    cases = {
        "a leaking valve": MudChannel(pumps=(Pump(1.45, leak=0.15), Pump(1.52))),
        "pumps 0.3 strokes/min apart": MudChannel(pumps=(Pump(1.45), Pump(1.455))),
        "hunting pumps": MudChannel(pumps=(Pump(1.45, hunting=0.01), Pump(1.52, hunting=0.01))),
        "a flat dampener": MudChannel(well=dataclasses.replace(well, precharge=0.0)),
        "an overcharged dampener": MudChannel(well=dataclasses.replace(well, precharge=1.2)),
        "stick-slip": MudChannel(noise=dataclasses.replace(noise, stick_slip_pa=5e5)),
        "stalls": MudChannel(noise=dataclasses.replace(noise, stalls_per_hour=60.0)),
        "gas": MudChannel(well=dataclasses.replace(well, bulk_modulus=6e8)),
    }
    for name, channel in cases.items():
        rows, speed = case(channel, tool_of(0.5), seeds)
        everything += rows
        line(name, rows, word_limit(channel, tool_of(0.5)), speed)
    print(f"\n| 0.3 s, 3000 m, strokes | {head}")
    for name, channel in {"healthy pumps": MudChannel(), **dict(itertools.islice(cases.items(), 3))}.items():
        limit = word_limit(channel, tool_of(0.3))
        for counted in (False, True):
            rows, speed = case(channel, tool_of(0.3), seeds, counted)
            everything += rows
            line(f"{name}, {'counted' if counted else 'not counted'}", rows, limit, speed)
    print("\n| confidence claimed | words | mean claimed | right |\n|---|---|---|---|")
    found = np.array([row[:2] for row in everything if row is not None], dtype=float)
    for low, high in itertools.pairwise(BINS):
        some = found[(found[:, 1] >= low) & (found[:, 1] < high)]
        if len(some):
            print(
                f"| {low:g} to {min(high, 1.0):g} | {len(some)} | {some[:, 1].mean():.3f} | {some[:, 0].mean():.3f} |"
            )


if __name__ == "__main__":
    main()

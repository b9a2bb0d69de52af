# SPDX-License-Identifier: Apache-2.0
"""
The downlink: commands through stick-slip and by flow, and hours of drilling in which there are none.

    python tests/benchmarks/bench_downlink.py [commands]
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from mwd_estimation.downhole.commands import DownlinkDecoder
from mwd_sensors.simulator.schedule import Rig, SchedulePhase, timeline
from mwd_sensors.simulator.steering import ROTATE, Steering, SteeringCommand, String
from mwd_sensors.telemetry.downlink import COMMANDS, FLOW, Downlink, DownlinkFrame, programme

RPM = math.pi / 30.0
RATE = 500
START = 1_700_000_000_000_000_000
DATA = 9
PUMPS = Downlink(medium=FLOW, ramp_s=8.0, hold_s=8.0, depth=0.2, least=0.01)
# Gyros of a conventional unit clip at 2 000 deg/s; noise of a sample, rad/s.
CLIP, NOISE = math.radians(2000.0), 0.02


def stamps(seconds):
    """Stamps of times after the start, s."""
    return START + np.round(seconds * 1e9).astype(np.int64)


def frames_of(count, random):
    """Commands drawn at random."""
    return [
        DownlinkFrame(k % 7 + 1, int(random.integers(len(COMMANDS))), int(random.integers(16))) for k in range(count)
    ]


def rotation(frames, rpm, steering, seed):
    """What the gyro sees while commands are sent through a string."""
    random = np.random.default_rng(seed)
    downlink = Downlink()
    shares = [1.0] * 300
    for frame in frames:
        ordered = programme(frame, downlink)
        shares += [ordered.at(0.2 * k) for k in range(math.ceil(ordered.duration_s / 0.2))] + [1.0] * 150
    seconds = 0.2 * len(shares)
    line = timeline((SchedulePhase(seconds=seconds + 60.0, rpm=rpm),), Rig(), 1000.0, (), random)
    string = String(steering, line, 0.3, RATE, random)
    count = round(0.2 * RATE)
    turned = []
    for k, share in enumerate(shares):
        string.command(SteeringCommand(ROTATE, rpm * share * RPM, valid_for=1.0))
        turned.append(string.advance(k * count, count)[0][1])
    seen = np.concatenate(turned)[::5]
    seen = np.clip(seen + NOISE * random.standard_normal(len(seen)), -CLIP, CLIP)
    return np.arange(len(seen)) * 5.0 / RATE, seen


def pumped(frames, seed):
    """What the tool's turbine sees while commands are sent by flow."""
    random = np.random.default_rng(seed)
    parts = [np.ones(600)]
    for frame in frames:
        ordered = programme(frame, PUMPS)
        parts += [np.array([ordered.at(0.2 * k) for k in range(math.ceil(ordered.duration_s / 0.2))]), np.ones(150)]
    flow = 0.033 * np.concatenate(parts)
    return 0.2 * np.arange(len(flow)), flow + 2e-4 * random.standard_normal(len(flow))


def drilled(hours, seed, full, rate=5.0):
    """Rotation or flow of stands that are drilled and slid, connections, and a driller who changes the rest."""
    random = np.random.default_rng(seed)
    values, value = [], 0.0
    while len(values) < hours * 3600.0 * rate:
        wanted = float(random.choice([0.0, full, full * random.uniform(0.5, 1.0)], p=[0.15, 0.35, 0.5]))
        ramp = np.linspace(value, wanted, max(round(random.uniform(1.0, 10.0) * rate), 1))
        values += [*ramp, *([wanted] * round(random.exponential(random.choice([10.0, 25.0, 300.0])) * rate))]
        value = wanted
    at = np.arange(len(values)) / rate
    shaken = 1.0 + random.uniform(0.0, 0.9) * np.sin(2.0 * math.pi * random.uniform(0.1, 0.3) * at)
    return at, np.array(values) * shaken


def row(name, frames, downlink, at, signal, least, most):
    """Commands and symbols found, and how fast."""
    began = time.process_time()
    found = [one.frame for one in DownlinkDecoder(downlink).push(stamps(at), signal)]
    speed = at[-1] / (time.process_time() - began)
    right = sum(one in frames for one in found)
    wrong = len(found) - right
    cells = (name, f"{least} .. {most}", len(frames), DATA * len(frames), len(frames) - right, wrong, f"{speed:.0f}")
    print(f"| {' | '.join(map(str, cells))} |")


def main() -> None:
    """All tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 45
    random = np.random.default_rng(1)
    print("Commands of 9 symbols, each sent once; the tool's own gyro or flow decodes them.\n")
    print("| channel | seen by the tool | commands | symbols | missed | wrong | times real time |")
    print("|---|---|---|---|---|---|---|")
    for rpm in (80.0, 110.0, 140.0):
        for name, steering in (("soft", 350.0), ("3 km", 473.0), ("stiff", 600.0)):
            frames = frames_of(count, random)
            at, seen = rotation(frames, rpm, Steering(stiffness_nm_rad=steering), int(rpm))
            spread = f"{seen[len(seen) // 9 :].min() / RPM:.0f}", f"{seen.max() / RPM:.0f} r/min"
            row(f"rotation {rpm:.0f} r/min, {name} string", frames, Downlink(), at, seen, *spread)
    frames = frames_of(count, random)
    at, seen = pumped(frames, 5)
    row("flow 2000 l/min", frames, PUMPS, at, seen, f"{seen.min() * 6e4:.0f}", f"{seen.max() * 6e4:.0f} l/min")
    hours = 8.0 * max(count // 9, 1)
    print(f"\nCommands found in drilling and connections without any, {hours:.0f} h each:\n")
    print("| medium | hours | commands |")
    print("|---|---|---|")
    for downlink, full in ((Downlink(), 13.0), (PUMPS, 0.033)):
        found = 0
        for seed in range(round(hours / 8.0)):
            at, seen = drilled(8.0, seed, full)
            found += len(DownlinkDecoder(downlink).push(stamps(at), seen))
        print(f"| {downlink.medium} | {hours:.0f} | {found} |")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""
The telemetry link beside pulse position: carriers in white noise, mud and earth, serial frames.

    python tests/benchmarks/bench_link_codes.py [seeds]
"""

from __future__ import annotations

import dataclasses
import sys
import time

import numpy as np
from scipy import signal

import telemetry_limits as limits
from mwd_sensors.simulator import carrier_tool, serial_channel
from mwd_sensors.simulator.earth_channel import RATE_HZ as EARTH_HZ
from mwd_sensors.simulator.earth_channel import EarthChannel, EarthVoltage, Ground, earth_run, response
from mwd_sensors.simulator.mud_channel import MudChannel, Pump, WellGeometry
from mwd_sensors.telemetry.serial_frames import BITS_PER_BYTE, frame_bytes
from mwd_sensors.telemetry.tool_configuration import starting
from mwd_surface.receiver.link.receivers import receiver_of
from mwd_surface.receiver.serial_receiver import SerialReceiver

FLOW_ON = 20.0
BLOCKS = 16
BITS = 64  # into the encoder: header, words, check


def carrier(**changes):
    """Tool on a carrier."""
    plain = starting("psk")
    return dataclasses.replace(plain, carrier=dataclasses.replace(plain.carrier, **changes), transmit_delay_s=30.0)


def received(tool, time_s, value):
    """Words of a recording, and how many times real time that took."""
    receiver = receiver_of(tool)
    began = time.process_time()
    done = receiver.push(time_s, value)
    done.add(receiver.finish())
    return done, time_s[-1] / (time.process_time() - began)


def blocks_of(sent, words, late):
    """For each block (or word) sent: all right, none believed wrongly."""
    rows = []
    for start in dict.fromkeys(word.start_s for word in sent):
        want = [(w.name, w.raw) for w in sent if w.start_s == start]
        near = [w for w in words if abs(w.start_s - start - late) < 0.45]
        believed = [(w.name, w.raw) for w in near if w.status == "believed"]
        rows.append((believed == want, all(one in want for one in believed)))
    return rows


def line(name, rows, limit, ebn0, speed):
    wrong, false = (1.0 - np.mean([row[k] for row in rows]) for k in (0, 1))
    print(f"| {name} | {len(rows)} | {limit} | {wrong:.3f} | {false:.4f} | {ebn0:.1f} | {speed:.0f} |", flush=True)


def case(seeds, tool, run_of):
    """Blocks of all seeds, mean Eb/N0 and median speed; run_of: (sent, time, value, delay) of a seed."""
    rows, ebn0, speeds = [], [], []
    for seed in range(seeds):
        sent, time_s, value, late = run_of(tool, seed)
        done, speed = received(tool, time_s, value)
        if late is None:
            late = np.median([w.start_s for w in done.words[:1]]) - sent.words[0].start_s if done.words else 0.0
        rows += blocks_of(sent.words, done.words, late)
        ebn0 += [frame.ebn0_db for frame in done.frames]
        speeds.append(speed)
    return rows, float(np.mean(ebn0)) if ebn0 else float("nan"), float(np.median(speeds))


def flows(tool):
    return ((FLOW_ON, FLOW_ON + tool.transmit_delay_s + BLOCKS * tool.carrier.block_s * 1.002),)


def clock(seed):
    return 1e-3 if seed % 2 else -1e-3


def white(ebn0_db):
    def run_of(tool, seed):
        sent = carrier_tool.transmit(tool, flows(tool), seed, clock(seed))
        time_s = np.arange(0.0, flows(tool)[0][1] + 5.0, 0.01)
        coded = 0.5 * sent.symbol_s / (2.0 if tool.carrier.modulation == "qpsk" else 1.0)
        sigma = np.sqrt(coded / limits.ratio(ebn0_db) * 100.0)
        noise = np.random.default_rng(1000 + seed).normal(size=len(time_s)) * sigma
        return sent, time_s, 1e4 * (sent.drive(time_s) + noise), 0.0

    return run_of


def mud(channel):
    def run_of(tool, seed):
        sent = carrier_tool.transmit(tool, flows(tool), seed, clock(seed))
        started = dataclasses.replace(channel, flow_off_s=((-100.0, FLOW_ON),))
        run = carrier_tool.siren_run(started, sent, flows(tool)[0][1] + 5.0, 1000 + seed)
        return sent, run.time_s, run.pressure_pa, None

    return run_of


def earth(channel):
    def run_of(tool, seed):
        sent = carrier_tool.transmit(tool, flows(tool), seed, clock(seed))
        return sent, *earth_run(channel, sent, flows(tool)[0][1] + 5.0, 1000 + seed), 0.1

    return run_of


def earth_ebn0(tool, channel):
    """Energy of a bit into the encoder over noise density that the map gives: response and noise at the carrier, dB."""
    quiet = dataclasses.replace(channel, ground=dataclasses.replace(channel.ground, source_v=0.01, source_a=0.01))
    stream = EarthVoltage(quiet, np.zeros_like, 99)
    noise = np.concatenate([stream.block() for _ in range(60)])
    frequency, density = signal.welch(noise, EARTH_HZ, nperseg=5000)
    band = np.abs(frequency - tool.carrier.frequency_hz) < tool.carrier.symbol_rate_hz
    # Lines are narrow and taken out: the median is what is left.
    one_sided = float(np.median(density[band]))
    size = float(np.abs(response(channel.ground, np.array([tool.carrier.frequency_hz])))[0])
    bits = 2.0 if tool.carrier.modulation == "qpsk" else 1.0
    coded = 0.5 * size**2 / tool.carrier.symbol_rate_hz / bits
    return 10.0 * np.log10(2.0 * coded / one_sided)


def carriers(seeds):
    head = "blocks | limit | block error | believed wrong | Eb/N0, dB | x real time |\n|---|---|---|---|---|---|---|"
    print("Blocks of 40 bits of words behind the K = 7 code; limit: union bound. Clock of the tool 0.1 % off.\n")
    print(f"| white noise | {head}")
    for modulation, ebn0_db in (("qpsk", 3.0), ("qpsk", 4.0), ("bpsk", 3.0), ("dpsk", 6.0)):
        tool = carrier(modulation=modulation, medium="earth")
        found = case(seeds, tool, white(ebn0_db))
        limit = f"{limits.coded_block_error(ebn0_db, BITS, modulation):.4f}"
        line(f"{modulation.upper()}, {ebn0_db:g} dB", found[0], limit, *found[1:])
    print(f"\n| siren of 2 bar, QPSK, 12 Hz | {head}")
    well = WellGeometry()
    for name, rate, channel in (
        ("2.5 symbols/s, 3000 m", 2.5, MudChannel(well=well)),
        ("1.25 symbols/s, 5000 m", 1.25, MudChannel(well=dataclasses.replace(well, depth_m=5000.0))),
        ("a pump's harmonic on it, 3000 m", 2.5, MudChannel(pumps=(Pump(1.5, leak=0.05), Pump(1.53)))),
    ):
        found = case(seeds, carrier(symbol_rate_hz=rate), mud(channel))
        line(name, found[0], "", *found[1:])
    print(f"\n| EM, QPSK, 6 Hz, 2.5 symbols/s | {head.replace('limit', 'Eb/N0 of the map, dB')}")
    tool = carrier(medium="earth", frequency_hz=6.0)
    for resistivity, depth in ((3.0, 1500.0), (3.0, 1700.0), (10.0, 3000.0), (10.0, 3300.0), (100.0, 5000.0)):
        channel = EarthChannel(Ground(bottom_m=(12000.0,), resistivity=(resistivity,), depth_m=depth))
        found = case(seeds, tool, earth(channel))
        line(f"{resistivity:g} ohm m, {depth:g} m", found[0], f"{earth_ebn0(tool, channel):.1f}", *found[1:])


def serial_frames(frames=10_000_000, bit_errors=1e-4):
    """
    Frames of a survey at a bit error rate: how many arrive, and how many words are wrong.

    Frames without a wrong bit need no receiver: only those hit, and their neighbours, are put through it.
    """
    tool = dataclasses.replace(
        starting("serial"), transmit_delay_s=0.0, toolface_sequences=("Inc:12 Azm:12 aTFA:6 Gama:8",)
    )
    size = frame_bytes(tool.toolfaces[0])
    random = np.random.default_rng(1)
    data, words = serial_channel.transmit(tool, 256.0, 3)
    pieces = data.split(b"\0")[1:-1]
    truth = [tuple(w.raw for w in words if w.frame == k) for k in range(1, len(pieces) + 1)]
    hit = random.binomial(frames, 1.0 - (1.0 - bit_errors) ** (8 * size))
    arrived = wrong = 0
    for _ in range(hit):
        at = int(random.integers(1, len(pieces) - 3))
        raw = bytearray(pieces[at] + b"\0")
        places = np.flatnonzero(random.random(8 * len(raw)) < bit_errors)
        for place in places if len(places) else [int(random.integers(8 * len(raw)))]:
            raw[place // 8] ^= 1 << place % 8
        stream = b"\0".join([pieces[at - 1], b""]) + bytes(raw) + b"\0".join([pieces[at + 1], pieces[at + 2], b""])
        values = np.frombuffer(stream, dtype=np.uint8)
        receiver = SerialReceiver(tool)
        done = receiver.push(np.arange(len(values)) * BITS_PER_BYTE / 9600.0, values)
        done.add(receiver.finish())
        got = {tuple(w.raw for w in done.words if w.frame == k) for k in range(len(done.frames))}
        arrived += truth[at] in got
        wrong += len(got - set(truth[at - 1 : at + 3]))
    print(
        f"\nSerial frames of {size} bytes at a bit error rate of {bit_errors:g}: {frames} sent, {hit} with wrong bits,"
        f" {hit - arrived} lost, {wrong} with a wrong value."
    )


def main() -> None:
    """All tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    carriers(seeds)
    serial_frames(10_000_000)


if __name__ == "__main__":
    main()

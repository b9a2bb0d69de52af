# SPDX-License-Identifier: Apache-2.0
"""Carriers in white noise, and what was received of them beside what was sent."""

import dataclasses

import numpy as np

import telemetry_limits as limits
from mwd_sensors.simulator.carrier_tool import transmit
from mwd_sensors.telemetry.tool_configuration import starting
from mwd_surface.receiver.carrier.carrier_receiver import CarrierReceiver

RATE_HZ = 100.0


def tool_of(modulation="qpsk", **changes):
    """Tool on a carrier, phases shifted at once."""
    plain = starting("psk")
    carrier = dataclasses.replace(plain.carrier, **{"modulation": modulation, "medium": "earth", **changes})
    return dataclasses.replace(plain, carrier=carrier, transmit_delay_s=10.0)


def white(tool, blocks, ebn0_db, seed=1, clock=0.0):
    """What was sent, and times and samples of it in white noise; a bit into the encoder has that energy over N0."""
    seconds = tool.transmit_delay_s + blocks * tool.carrier.block_s * (1.0 + abs(clock)) + 0.1
    sent = transmit(tool, ((0.0, seconds),), seed, clock)
    time = np.arange(0.0, seconds + 5.0, 1.0 / RATE_HZ)
    # A cosine of size 1 has power 1/2; two coded bits for each bit into the encoder.
    coded = 0.5 * sent.symbol_s / (2.0 if tool.carrier.modulation == "qpsk" else 1.0)
    density = 2.0 * coded / limits.ratio(ebn0_db) / 2.0
    noise = np.random.default_rng(1000 + seed).normal(size=len(time)) * np.sqrt(density * RATE_HZ)
    return sent, time, 2.0e7 + 1e4 * (sent.drive(time) + noise)


def decoded(tool, time, value):
    """All words and frames of a recording, and the receiver."""
    receiver = CarrierReceiver(tool)
    done = receiver.push(time, value)
    done.add(receiver.finish())
    return done, receiver


def block_errors(sent, words):
    """Whether each block that was sent is not received whole and believed."""
    errors = []
    for start in dict.fromkeys(word.start_s for word in sent.words):
        want = [(w.name, w.raw) for w in sent.words if w.start_s == start]
        got = [(w.name, w.raw) for w in words if abs(w.start_s - start) < 0.5 and w.status == "believed"]
        errors.append(want != got)
    return errors

# SPDX-License-Identifier: Apache-2.0
"""Runs of the simulated link, and what was received of them beside what was sent."""

import functools

import numpy as np

from mwd_sensors.simulator.mud_channel import MudChannel, WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry import pulse_position
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pulse.pulse_receiver import decode

FLOW_ON = 20.0


TOOLS = {"0.8": ToolConfiguration(), "0.5": ToolConfiguration(pulse_width_s=0.5)}


@functools.cache
def simulated(width="0.8", depth=3000.0, seconds=420.0, seed=1, clock=0.0):
    """Run of a tool of that pulse width in a well with two pumps."""
    tool = TOOLS[width]
    channel = MudChannel(well=WellGeometry(depth_m=depth), flow_off_s=((-100.0, FLOW_ON),))
    return link_run(channel, transmit(tool, ((FLOW_ON, seconds),), seed, clock), seconds, seed)


@functools.cache
def reception(width="0.8", depth=3000.0, seconds=420.0, seed=1, clock=0.0):
    """What a receiver makes of such a run."""
    run = simulated(width, depth, seconds, seed, clock)
    return decode(TOOLS[width], run.time_s, run.pressure_pa)


def pairs(run, words, tool, depth):
    """(sent, received) of each word sent that was received at all."""
    late = depth / 1250.0 + 0.2
    found = []
    for sent in run.sent.words:
        near = [w for w in words if w.name == sent.name and abs(w.start_s - sent.start_s - late) < 4.0 * tool.tu_s]
        found += [(sent, near[0])] if near else []
    return found


def white(tool, sent, ebn0_db, rate_hz=None, seed=1):
    """Time and pressure of the pulses of a transmission in white noise of a given energy per bit."""
    rate = rate_hz or 16.0 / tool.tu_s
    time = np.arange(0.0, float(sent.pulses[-1, 1]) + 30.0 * tool.tu_s, 1.0 / rate)
    clean = np.zeros(len(time))
    for begin, end in sent.pulses:
        clean += np.clip((time - begin) * rate + 0.5, 0, 1) - np.clip((time - end) * rate + 0.5, 0, 1)
    # A pulse of size 1 has energy pulse width x 1^2 and carries bits per pulse; N0 / 2 is the density of the noise.
    bits = sum(item.length for item in tool.surveys[0])
    pulses = sum(len(pulse_position.encode(0, item.length).edges) for item in tool.surveys[0])
    density = tool.pulse_width_s * pulses / bits / 10.0 ** (ebn0_db / 10.0) / 2.0
    noise = np.random.default_rng(seed).normal(size=len(time)) * np.sqrt(density * rate)
    return time, 2.0e7 + 1e5 * (clean + noise)

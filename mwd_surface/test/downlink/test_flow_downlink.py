# SPDX-License-Identifier: Apache-2.0
"""A command by flow, from the person who asks for it to the tool's answer; the tool senses its own flow."""

import math
from collections import deque

import numpy as np
import pytest

from mwd_estimation.core.status import Status
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import Transmitter
from mwd_sensors.core import wire
from mwd_sensors.core.units import LPM
from mwd_sensors.simulator.sonde import CommandedFlow
from mwd_sensors.telemetry.downlink import FLOW, Downlink
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.downlink.machine import DownlinkState, InterlockReadings, Machine
from mwd_surface.downlink.settings import DownlinkSettings

START = 1_700_000_000_000_000_000
FULL = 2000.0 * LPM
STEP = 0.2
RAMP_S = 4.0
NOISE = 12.0 * LPM  # of the turbine in the tool, 1 sigma
TOOL = ToolConfiguration(
    pulse_width_s=0.8,
    transmit_delay_s=25.0,
    downlink=Downlink(medium=FLOW, ramp_s=8.0, hold_s=8.0, depth=0.2, pulse_widths_s=(0.3, 0.5, 0.8)),
    survey_sequences=("DLnk:10:P Inc:12:P Azm:12:P",),
    toolface_sequences=("2{aTFA:6:P} DLnk:10:P",),
)


class Loop:
    """Pumps that obey the machine, a tool that senses its flow, and a surface that hears the tool's words."""

    def __init__(self):
        self.machine = Machine(TOOL, DownlinkSettings())
        self.pumps = CommandedFlow(lambda t: np.array([np.full(len(t), FULL), 0.0 * t, 0.0 * t]), FULL, RAMP_S)
        self.tool, self.on_air, self.echoes = Transmitter(TOOL, Transmit()), deque(), []
        self.random = np.random.default_rng(3)
        self.now, self.flows = 0.0, []

    def play(self, seconds, until=None):
        """Go on so long at most, until the machine is in a state."""
        for _ in range(math.ceil(seconds / STEP)):
            self._step()
            if self.machine.state == until:
                break
        return self.machine.state

    def _step(self):
        self.now += STEP
        flow = float(self.pumps(np.array([self.now]))[0, 0])
        self.flows.append((self.now, flow))
        self._tool(flow + NOISE * self.random.standard_normal())
        while self.on_air and self.on_air[0][0] <= self.now:
            self.echoes.append(self.on_air.popleft())
            self.machine.on_echo(self.echoes[-1][1], self.now)
        seen = InterlockReadings(0.1, flow, 0.0, 2.0e7 * (flow / FULL) ** 1.75, False, True, 0.5)
        self.machine.update(self.now, seen)
        if self.machine.set_point is None:
            self.pumps.release(self.now)
        else:
            self.pumps.ask(self.now, self.machine.set_point, 2.0)

    def _tool(self, flow):
        stamp = START + round(self.now * 1e9)
        imu, row, turbine = (layout.empty(1) for layout in (wire.IMU, wire.ATTITUDE, wire.TOOL_FLOW))
        imu["stamp_ns"] = row["stamp_ns"] = turbine["stamp_ns"] = stamp
        turbine["flow"] = flow
        row["north"], row["status"] = 1, int(Status.ROTATING)
        for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
            row[name], row["sigma_" + name] = 0.7, 0.01
        self.tool.take_flow(turbine)
        self.tool.take_rotation(imu)
        for sent in self.tool.advance(row, None):
            if sent.name == "DLnk":
                self.on_air.append(((sent.start_ns - START) * 1e-9 + sent.duration_s, sent.raw))

    def send(self):
        self.machine.draft("pulse_width", 0.5, "Ann", self.now)
        self.machine.submit("Ann", self.now)
        self.machine.decide(True, "Bo", self.now, self.machine.number)
        return self.play(60.0, DownlinkState.RUNNING)


@pytest.fixture(scope="module")
def loop():
    one = Loop()
    one.play(60.0)
    return one


@pytest.mark.slow(4)
def test_an_abort_gives_the_flow_back_within_a_second_and_the_tool_obeys_nothing(loop):
    assert loop.send() == DownlinkState.RUNNING
    while loop.flows[-1][1] > 0.85 * FULL:
        assert loop.play(STEP) == DownlinkState.RUNNING
    at = loop.now
    loop.machine.abort("seen enough", "Ann", loop.now)
    loop.play(RAMP_S)
    after = np.array([row for row in loop.flows if row[0] > at])
    # Two steps pass before the pumps turn: one until they are told, one until it shows.
    risen = FULL / RAMP_S * (1.0 - 2.0 * STEP)
    assert after[after[:, 0] <= at + 1.0, 1].max() >= min(after[:, 1].min() + risen, FULL) - 1e-9
    assert after[-1, 1] == pytest.approx(FULL)
    assert loop.play(300.0) == DownlinkState.ABORTED
    assert loop.machine.in_force == Machine(TOOL, DownlinkSettings()).in_force
    assert {code for _, code in loop.echoes} == {0}


@pytest.mark.slow(8)
def test_a_command_is_confirmed_by_the_tool_s_own_answer_in_new_pulses(loop):
    assert loop.send() == DownlinkState.RUNNING
    seconds = loop.machine.programme.duration_s + 600.0
    assert loop.play(seconds, DownlinkState.CONFIRMED) == DownlinkState.CONFIRMED
    assert loop.machine.in_force.pulse_width == TOOL.downlink.pulse_widths_s.index(0.5)
    assert loop.echoes[-1][1] == loop.machine.request.frame.echo
    flows = np.array(loop.flows)[:, 1]
    assert flows.min() == pytest.approx(0.8 * FULL, rel=1e-3)
    assert flows[-1] == pytest.approx(FULL)

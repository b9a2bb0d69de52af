# SPDX-License-Identifier: Apache-2.0
"""The controller of `toolface_hold` on a toolface that comes over a link alone: a siren, a word every eight seconds."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from toolface_hold import HoldSettings, Reading, ToolfaceHold

from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.steering import HOLD, SteeringCommand
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_feed import LinkFeed
from mwd_surface.runs.simulate import SimulatedTool

pytestmark = pytest.mark.slow(3)

SCENARIO = Path(__file__).parent / "scenarios" / "steered_link.yaml"
WANTED = math.radians(60.0)
SLIDES_S, HELD_S = 60.0, 150.0  # s of the run: rotation ends, and the toolface should be where it is wanted
BLOCK_S = 0.5


class LinkedRun:
    """A run whose controller knows what the surface hears; one row a block: time, s, true and shown toolface, sigma."""

    def __init__(self):
        self.story = read(SCENARIO)
        self.sonde = Sonde(self.story)
        self.tool = SimulatedTool(self.sonde)
        string = self.story.steering
        lag = string.static_nm * string.pipe_radius_m / string.stiffness_nm_rad
        self.feed = LinkFeed(self.story.telemetry.tool, AgeRules(quill_lag_m=lag), pytest.fail)
        # Slower than on a wire: between two words the prediction is all there is.
        settings = HoldSettings(WANTED, period=1.0, gain=3.0, integral=0.03, rate_gain=0.0)
        self.controller = ToolfaceHold(dataclasses.replace(settings, worst_sigma=math.radians(25.0)))
        self.rows = []

    def play(self):
        done = 0.0
        for block in self.sonde.blocks(BLOCK_S):
            done = min(done + BLOCK_S, self.sonde.duration)
            for heard in self.tool.take(block, done)[1]:
                stamp = self.sonde.stamp_ns(heard.start_s, of_tool=False)
                self.feed.push(stamp, heard.period_s, heard.values)
            if self.feed.heard:
                self._steer(block, done)
        return np.array(self.rows)

    def _steer(self, block, done):
        attitude, stamp = self.feed.link.attitude, self.sonde.stamp_ns(done, of_tool=False)
        for rig in block["rig/state"][-1:]:
            attitude.speed = float(rig["rate_of_penetration"])
            attitude.rotating = abs(float(rig["rotary_speed"])) > 0.5
        now = self.feed.seconds(stamp)
        attitude.take_quill(now, self.sonde.string.quill)
        row = attitude.sample(now, stamp, None)
        angle, sigma = float(row["gravity_toolface"][0]), float(row["sigma_gravity_toolface"][0])
        command = None
        if SLIDES_S < done <= SLIDES_S + 2.0:
            command = SteeringCommand(HOLD, valid_for=3.0)
        elif done > SLIDES_S:
            reading = Reading(done, done, 0, angle, sigma, False) if math.isfinite(sigma) else None
            command = self.controller.update(done, reading)
        if command is not None:
            self.sonde.command(
                SteeringCommand(command.mode, turn=getattr(command, "turn", 0.0), valid_for=command.valid_for)
            )
        self.rows.append((done, float(block["truth"]["gravity_toolface"][-1]), angle, sigma))


@pytest.fixture(scope="module")
def held():
    run = LinkedRun()
    rows = run.play()
    assert run.tool.link.late == 0
    return rows[rows[:, 0] > HELD_S]


def off(angle, wanted):
    return np.degrees((angle - wanted + math.pi) % math.tau - math.pi)


def test_the_toolface_is_held_over_the_link(held):
    assert np.abs(off(held[:, 1], WANTED)).max() < 30.0
    assert np.sqrt(np.mean(off(held[:, 1], WANTED) ** 2)) < 10.0


def test_what_is_shown_between_words_is_where_the_tool_is(held):
    shown = held[np.isfinite(held[:, 3])]
    assert len(shown) > 0.85 * len(held)
    error = np.radians(off(shown[:, 2], shown[:, 1]))
    # One word every eight seconds: neighbouring rows share their error, so the mean of the squares is what is judged.
    assert np.mean((error / shown[:, 3]) ** 2) < 2.0
    assert np.degrees(np.sqrt(np.mean(error**2))) < 12.0

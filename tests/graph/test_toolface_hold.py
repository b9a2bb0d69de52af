# SPDX-License-Identifier: Apache-2.0
"""The estimator inside a control loop: a controller brings the simulated string to a toolface, and refuses bad ones."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from toolface_hold import HOLD, ORIENT, Command, HoldSettings, Reading, ToolfaceHold

from mwd_estimation.core.status import Status
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.simulator import scenario, steering
from mwd_sensors.simulator.sonde import Sonde

SCENARIO = Path(__file__).parent / "scenarios" / "steered.yaml"
TAKES_OVER, SETTLED, ENDS = 15.0, 75.0, 225.0  # s
WANTED = math.radians(60.0)
GOOD = Reading(stamp=100.0, received=100.0, mode=0, angle=0.5, sigma=0.01, rotating=False)


def error_deg(angle, wanted):
    return math.degrees((angle - wanted + math.pi) % math.tau - math.pi)


def closed_loop(wanted, seed, silent_from=math.inf):
    """Scenario, estimator and controller in one loop, 0.1 s at a time: times, true errors in deg, and commands."""
    sonde = Sonde(scenario.read(SCENARIO, {"seed": seed}))
    estimator, controller = Pipeline(EstimatorSettings()), ToolfaceHold(HoldSettings(wanted))
    times, errors, commands, reading = [], [], [], None
    for block in sonde.blocks(0.1):
        now = sonde.time
        estimator.push_mag(block["imu/mag"])
        found = estimator.push_imu(block["imu/data_raw"]).attitude
        if len(found) and now < silent_from:
            last = found[-1]
            reading = Reading(
                float(last["stamp_ns"] - sonde.epoch_ns) * 1e-9,
                now,
                0,
                float(last["gravity_toolface"]),
                float(last["sigma_gravity_toolface"]),
                bool(last["status"] & Status.ROTATING),
            )
        command = controller.update(now, reading) if now > TAKES_OVER else None
        if command is not None:
            commands.append((now, command))
            sonde.command(steering.SteeringCommand(command.mode, 0.0, command.turn, command.valid_for))
        times.append(now)
        errors.append(error_deg(float(block["truth"]["gravity_toolface"][-1]), wanted))
        if now > min(silent_from + 10.0, ENDS):
            break
    return np.array(times), np.array(errors), commands, sonde, controller


@pytest.mark.slow(5)
def test_a_string_that_sticks_and_slips_is_brought_to_a_toolface_and_held_within_10_degrees():
    times, errors, commands, sonde, _ = closed_loop(math.radians(200.0), 8)
    before = sonde.scenario.schedule[0].rpm * 6.0
    turned = np.abs(np.diff(errors[times < TAKES_OVER]))
    assert before > 0.0
    assert turned.max() > 30.0
    assert commands[0][1].mode == HOLD
    assert {command.mode for _, command in commands} == {HOLD, ORIENT}
    held = np.abs(errors[times > SETTLED])
    assert held.max() < 10.0
    assert np.sqrt(np.mean(held**2)) < 3.0


def test_without_a_controller_the_motor_turns_the_toolface_away():
    times, errors, _, _, _ = closed_loop(WANTED, 7, silent_from=0.0)
    assert len(times) > 0
    assert np.abs(errors).max() > 90.0


@pytest.mark.slow
def test_when_the_toolface_stops_the_controller_does_and_so_does_the_top_drive():
    _, _, commands, sonde, controller = closed_loop(WANTED, 7, silent_from=25.0)
    stale = HoldSettings(WANTED).stale_after
    assert commands[-1][0] <= 25.0 + stale + 0.1
    assert "old" in controller.why
    assert sonde.string.obeys == steering.HOLD


@pytest.mark.parametrize(
    ("reading", "now", "why"),
    [
        (None, 100.0, "no toolface yet"),
        (GOOD, 103.0, "3.0 s old"),
        (dataclasses.replace(GOOD, mode=1), 100.0, "other kind"),
        (dataclasses.replace(GOOD, sigma=math.nan), 100.0, "not certain"),
        (dataclasses.replace(GOOD, sigma=0.5), 100.0, "not certain"),
    ],
)
def test_what_cannot_be_trusted_is_not_acted_upon(reading, now, why):
    controller = ToolfaceHold(HoldSettings(WANTED))
    assert controller.update(now, reading) is None
    assert why in controller.why


def test_it_turns_the_shorter_way_at_most_one_step_a_period():
    controller = ToolfaceHold(HoldSettings(math.radians(10.0)))
    command = controller.update(100.0, dataclasses.replace(GOOD, angle=math.radians(350.0)))
    assert command == Command(ORIENT, HoldSettings(0.0).step)
    assert controller.update(100.1, dataclasses.replace(GOOD, stamp=100.1, received=100.1)) is None


def test_a_turning_string_gets_the_command_to_hold_first():
    controller = ToolfaceHold(HoldSettings(WANTED))
    assert controller.update(100.0, dataclasses.replace(GOOD, rotating=True)) == Command(HOLD)

# SPDX-License-Identifier: Apache-2.0
"""Steering: a string that winds up, sticks and slips under a top drive that obeys, with the same bits each time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.simulator import steering
from mwd_sensors.simulator.schedule import Rig, SchedulePhase, timeline
from mwd_sensors.simulator.steering import HOLD, ORIENT, ROTATE, Steering, SteeringCommand, String

RATE = 2000
RPM = math.pi / 30.0
EASY = Steering(static_nm=50.0, kinetic_nm=50.0, motor_nm=0.0, damping_nms=100.0)


class Played:
    """A string and everything it did."""

    def __init__(self, settings=EASY, rpm=0.0, rop=15.0, kind="drill", **rig):
        phase = SchedulePhase(kind=kind, seconds=300.0, rpm=rpm, rop_m_h=rop)
        line = timeline((phase,), Rig(**rig), 1000.0, (), np.random.default_rng(1))
        self.string = String(settings, line, 0.3, RATE, np.random.default_rng(2))
        self.count = 0
        self.turn, self.drive = np.empty((3, 0)), np.empty((0, 2))

    def obey(self, *command, **fields):
        self.string.command(SteeringCommand(*command, **{"valid_for": 1e6, **fields}))
        return self

    def play(self, seconds, block=1000):
        for _ in range(round(seconds * RATE / block)):
            turn, drive = self.string.advance(self.count, block)
            self.count += block
            self.turn, self.drive = np.hstack([self.turn, turn]), np.vstack([self.drive, drive])
        return self


def test_without_commands_the_top_drive_does_what_the_schedule_says():
    played = Played(rpm=90.0).play(10.0)
    scheduled = played.string._timeline.angle(np.arange(played.count) / RATE)[1]
    assert_allclose(played.drive[:, 0], scheduled, atol=1e-12)
    assert played.string.obeys is None


def test_rate_and_acceleration_are_the_derivatives_of_the_angle():
    turn = Played(Steering(), rpm=60.0).play(20.0).turn
    assert_allclose(np.diff(turn[0]), 0.5 * (turn[1, 1:] + turn[1, :-1]) / RATE, atol=1e-12)
    assert_allclose(np.diff(turn[1]), turn[2, :-1] / RATE, atol=1e-12)


def test_the_spring_twists_by_torque_over_stiffness():
    played = Played(rpm=120.0).play(90.0)
    steady = played.drive[-RATE:, 1].mean()
    assert steady == pytest.approx(EASY.static_nm, rel=0.02)
    wound = (played.string._state["drive"] - played.string._state["end"])[0]
    assert wound == pytest.approx(steady / EASY.stiffness_nm_rad, rel=0.01)


def test_the_motor_turns_the_string_to_the_left():
    held = Played(Steering(motor_unsteady=0.0, static_nm=100.0, kinetic_nm=100.0), rop=60.0).obey(HOLD).play(120.0)
    assert held.turn[0, -1] == pytest.approx(0.3 - 800.0 / 473.0, abs=0.05)


def test_a_heavy_friction_sticks_and_slips_at_low_speed_only():
    slow = Played(Steering(), rpm=60.0).play(60.0).turn[1, -20 * RATE :]
    assert slow.min() < 0.5 * RPM
    assert 90.0 * RPM < slow.max() < 180.0 * RPM
    smooth = Played(Steering(damping_nms=300.0), rpm=180.0).play(60.0).turn[1, -20 * RATE :]
    assert smooth.max() - smooth.min() < 10.0 * RPM


def test_a_string_creeps_to_where_it_is_turned_while_it_slides_along_and_stands_still_otherwise():
    standing = Played(Steering(), kind="circulate", rpm=0.0).obey(ORIENT, turn=1.0).play(60.0)
    assert abs(standing.turn[0, -1] - 0.3) < 1e-3
    sliding = Played(Steering(motor_nm=0.0, static_nm=200.0, kinetic_nm=200.0), rop=60.0)
    assert sliding.obey(ORIENT, turn=1.0).play(60.0).turn[0, -1] == pytest.approx(1.3, abs=0.05)


def test_a_turn_ends_where_it_should_within_the_limits_of_the_top_drive():
    played = Played().obey(ORIENT, turn=-2.0).play(10.0)
    angle = np.cumsum(played.drive[:, 0]) / RATE
    assert angle[-1] == pytest.approx(-2.0, abs=0.01)
    assert angle.min() > -2.01
    assert np.abs(played.drive[:, 0]).max() <= EASY.orient_rpm * RPM + 1e-9
    assert np.abs(np.diff(played.drive[:, 0])).max() * RATE <= EASY.ramp_rpm_s * RPM * (1.0 + 1e-9)


def test_a_turn_asked_for_while_it_rotates_counts_from_where_it_comes_to_rest():
    played = Played().obey(ROTATE, rotary_speed=60.0 * RPM).play(5.0)
    stands = played.string._state[0].drive + 0.5 * (60.0 * RPM) ** 2 / (20.0 * RPM)
    played.obey(ORIENT, turn=0.5).play(15.0)
    assert played.string._state[0].drive == pytest.approx(stands + 0.5, abs=0.01)


def test_when_commands_stop_the_top_drive_does():
    played = Played().obey(ROTATE, rotary_speed=60.0 * RPM, valid_for=4.0).play(3.5)
    assert played.drive[-1, 0] == pytest.approx(60.0 * RPM)
    played.play(5.0)
    assert played.drive[-1, 0] == 0.0
    assert played.string.obeys == HOLD


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (SteeringCommand(7), "mode"),
        (SteeringCommand(ROTATE, rotary_speed=math.nan), "rotary_speed"),
        (SteeringCommand(ROTATE, rotary_speed=201.0 * RPM), "rotary_speed"),
        (SteeringCommand(ORIENT, turn=13.0), "turn"),
        (SteeringCommand(HOLD, valid_for=0.0), "valid_for"),
        (SteeringCommand(HOLD, valid_for=math.inf), "valid_for"),
        (SteeringCommand(steering.PUMP, flow_rate=-1.0), "flow_rate"),
    ],
)
def test_what_the_top_drive_cannot_do_is_refused_and_changes_nothing(command, words):
    played = Played()
    with pytest.raises(ValueError, match=words):
        played.string.command(command)
    assert played.string.obeys is None


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="kinetic_nm"):
        steering.Steering(static_nm=1.0, kinetic_nm=2.0)
    with pytest.raises(ValueError, match="motor_band_hz"):
        steering.Steering(motor_band_hz=(1.0, 0.5))


def test_a_run_that_starts_under_way_starts_wound_up_and_turning():
    played = Played(Steering(motor_unsteady=0.0), rpm=150.0, running_start=True).play(0.5)
    assert played.turn[0, 0] == 0.3
    assert abs(played.turn[2, 0]) < 0.05


def test_a_command_that_returns_gives_the_string_back_to_the_schedule_within_the_ramp():
    played = Played(rpm=90.0).play(20.0).obey(ROTATE, 60.0 * RPM, valid_for=2.0, returns=True).play(1.9)
    assert played.drive[-1, 0] == pytest.approx(60.0 * RPM, abs=0.1)
    assert played.string.obeys == ROTATE
    played.play(2.0)
    assert played.drive[-1, 0] == pytest.approx(90.0 * RPM, abs=1e-9)
    assert played.string.obeys is None
    assert np.abs(np.diff(played.drive[20 * RATE :, 0])).max() <= EASY.ramp_rpm_s * RPM / RATE * (1.0 + 1e-9)


def test_a_release_gives_the_string_back_at_once():
    played = Played(rpm=90.0).play(20.0).obey(ROTATE, 60.0 * RPM).play(5.0).obey(steering.RELEASE).play(2.0)
    assert played.drive[-1, 0] == pytest.approx(90.0 * RPM, abs=1e-9)


@pytest.mark.parametrize("damping", [0.0, 23.0, 500.0])
@pytest.mark.parametrize("speed", [120.0, -120.0])
def test_a_top_drive_gives_no_more_torque_than_the_limit_and_stalls_there(speed, damping):
    stuck = Steering(static_nm=90_000.0, kinetic_nm=90_000.0, motor_nm=0.0, damping_nms=damping)
    played = Played(stuck, rop=0.0)
    played.string.limit_torque(6000.0)
    played.obey(ROTATE, rotary_speed=speed * RPM).play(30.0)
    assert np.abs(played.drive[:, 1]).max() <= 6000.0 * 1.001
    assert played.drive[-1, 1] == pytest.approx(math.copysign(6000.0, speed), rel=0.01)
    assert played.drive[-1, 0] == pytest.approx(0.0, abs=0.01)
    played.string.limit_torque(8000.0)
    assert played.play(10.0).drive[-1, 1] == pytest.approx(math.copysign(8000.0, speed), rel=0.01)


def test_a_torque_limit_that_is_not_reached_changes_no_bit():
    free, limited = Played(Steering()), Played(Steering())
    limited.string.limit_torque(20_000.0)
    for played in (free, limited):
        played.obey(ROTATE, rotary_speed=60.0 * RPM).play(20.0)
    assert np.abs(free.drive[:, 1]).max() < 20_000.0
    assert np.array_equal(free.drive, limited.drive)

# SPDX-License-Identifier: Apache-2.0
"""Motion: differentiated truth equals the rates, nothing leaves its hole, sensors feel what they must."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.core import frames
from mwd_sensors.simulator import motion
from mwd_sensors.simulator.schedule import Rig, SchedulePhase, timeline
from mwd_sensors.simulator.vibration import (
    Hunting,
    PerTurn,
    RandomVibration,
    Shocks,
    StickSlip,
    Sweep,
    Tone,
    Vibrations,
    Whirl,
    draw_hits,
    draw_lines,
)

EVERYTHING = Vibrations(
    random=(RandomVibration((8.0, 60.0), (5.0, 10.0, 10.0), (20.0, 5.0, 5.0)),),
    tones=(Tone(0.3, (3.0, 0.0, 0.0), (0.0, 2.0, 0.0)),),
    per_turn=(PerTurn(2, (0.5, 0.2, 0.0), 0.05, 30.0),),
    whirl=(Whirl(12.0, 30.0, (1.0, 2.0), (0.2, 0.4)),),
    sweeps=(Sweep(10.0, 60.0, 20.0, (0.2, 0.1, 10.0), (1.0, 3.0, 2.0)),),
    stick_slip=StickSlip(0.4, 1.2, True),
    hunting=Hunting(6.0),
)
SCHEDULE = (
    SchedulePhase("drill", 12.0, rpm=120.0, rop_m_h=3000.0),
    SchedulePhase("connection", 6.0),
    SchedulePhase("slide", 8.0, rop_m_h=1800.0, toolface_deg=75.0),
    SchedulePhase("circulate", 6.0, rpm=60.0),
    SchedulePhase("move", 6.0, rop_m_h=-1500.0),
    SchedulePhase("still", 4.0, pumps=False),
)


def moved(vibrations=EVERYTHING, phases=SCHEDULE, rig=None, stations=((0, 5, 20), (30, 20, 40), (60, 88, 70)), seed=3):
    rng = np.random.default_rng(seed)
    line = timeline(phases, rig or Rig(), 30.0, tuple((w.burst_s, w.pause_s) for w in vibrations.whirl), rng)
    active = {item.when: line.active(item.when) for item in vibrations.shocks}
    table = np.array(stations, dtype=float)
    path = motion.well_path(table[:, 0], np.radians(table[:, 1]), np.radians(table[:, 2]))
    return motion.SimulatedMotion(
        path, line, 2.0, vibrations, draw_lines(vibrations, rng), draw_hits(vibrations.shocks, active, rng)
    )


@pytest.mark.parametrize("second", [1, 5, 10, 14, 20, 25, 31, 36, 44])
def test_differentiated_truth_equals_the_rates(second):
    rate = 40000.0
    k = moved().at(int(second * rate), 2001, rate)
    dt = 2.0 / rate
    assert_allclose((k.position_n[2:] - k.position_n[:-2]) / dt, k.velocity_n[1:-1], atol=2e-5)
    assert_allclose((k.velocity_n[2:] - k.velocity_n[:-2]) / dt, k.acceleration_n[1:-1], atol=2e-3)
    assert_allclose((k.rate_t[2:] - k.rate_t[:-2]) / dt, k.rate_dot_t[1:-1], atol=2e-3)
    mat_dot = (k.mat_nt[2:] - k.mat_nt[:-2]) / dt
    assert_allclose(mat_dot, np.cross(k.mat_nt[1:-1], k.rate_t[1:-1, None, :]), atol=2e-5)


def test_attitude_is_a_rotation_and_agrees_with_the_angles_of_the_hole():
    k = moved(Vibrations(), (SchedulePhase("still", 5.0, pumps=False),)).at(0, 10, 100.0)
    inclination, azimuth, _ = frames.hole_angles(k.mat_nt)
    assert_allclose(k.mat_nt @ k.mat_nt.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (10, 3, 3)), atol=1e-14)
    # 28 m lies on the arc from (5, 20) to (20, 40) deg, close to its end.
    assert np.degrees(inclination[0]) == pytest.approx(19.0, abs=0.1)
    assert np.degrees(azimuth[0]) == pytest.approx(39.4, abs=0.3)


def test_a_vertical_start_builds_without_a_jump():
    stations = ((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (60.0, 20.0, 130.0))
    phases = (SchedulePhase("move", 40.0, rop_m_h=3600.0),)
    k = moved(Vibrations(), phases, Rig(pick_up_m=0.0), stations).at(0, 4000, 100.0)
    assert np.abs(k.rate_t).max() < 0.02
    _, azimuth, _ = frames.hole_angles(k.mat_nt)
    assert np.degrees(azimuth[-1]) == pytest.approx(130.0)
    assert np.abs(np.diff(k.mat_nt, axis=0)).max() < 2e-4


def test_arcs_pass_through_the_stations():
    md, inc = np.array([0.0, 30.0, 60.0, 95.0]), np.radians([2.0, 10.0, 45.0, 91.0])
    azi = np.radians([350.0, 10.0, 60.0, 75.0])
    path = motion.well_path(md, inc, azi)
    tangent = np.stack([np.sin(inc) * np.cos(azi), np.sin(inc) * np.sin(azi), np.cos(inc)], axis=-1)
    for k in range(3):
        bend = path.curvature[k] * (md[k + 1] - md[k])
        reached = np.cos(bend) * path.tangent[k] + np.sin(bend) * path.normal[k]
        assert_allclose(reached, tangent[k + 1], atol=1e-14)
        # Minimum curvature, ratio factor form (Sawaryn and Thorogood, SPE 84246).
        half = np.tan(0.5 * bend) / (0.5 * bend)
        step = 0.5 * (md[k + 1] - md[k]) * half * (tangent[k] + tangent[k + 1])
        assert_allclose(path.position[k + 1] - path.position[k], step, atol=1e-12)


@pytest.mark.parametrize(
    ("md", "inc", "azi", "words"),
    [([0.0, 0.0], [0.1, 0.1], [0.0, 0.0], "ascend"), ([0.0, 10.0], [0.5 * np.pi] * 2, [0.0, np.pi], "turns back")],
)
def test_a_path_that_turns_back_or_goes_up_in_depth_is_refused(md, inc, azi, words):
    with pytest.raises(ValueError, match=words):
        motion.well_path(md, inc, azi)


@pytest.mark.slow
def test_shocks_leave_neither_velocity_nor_displacement_and_keep_their_area():
    item = Shocks(2.0, (50.0, 100.0), (0.5, 4.0), 15.0)
    phases = (SchedulePhase("drill", 30.0, rpm=0.0, rop_m_h=0.0),)
    m = moved(Vibrations(shocks=(item,)), phases, Rig(running_start=True))
    assert 40 < len(m.hits.time) < 80
    assert m.hits.displacement.max() <= 0.0155
    k = m.at(0, 60000, 2000.0)
    away = k.position_n - k.position_n[0]
    assert np.abs(away).max() < 0.0155
    assert_allclose(away[-1], 0.0, atol=1e-12)
    # Sum of the accelerations times the step is the velocity: no pulse is lost between two instants.
    summed = np.cumsum(k.acceleration_n, axis=0)[:-1] / 2000.0
    assert_allclose(summed, 0.5 * (k.velocity_n[1:] + k.velocity_n[:-1]), atol=0.35)
    assert_allclose(k.acceleration_n.sum(axis=0) / 2000.0, 0.0, atol=1e-9)
    peak = np.linalg.norm(m.at(0, 960000, 32000.0).acceleration_n, axis=1).max()
    assert 85.0 * 9.80665 < peak < 100.5 * 9.80665


def test_a_lever_arm_feels_the_centripetal_acceleration():
    phases = (SchedulePhase("circulate", 20.0, rpm=180.0),)
    k = moved(Vibrations(), phases, Rig(running_start=True), ((0.0, 90.0, 0.0),)).at(2000, 400, 2000.0)
    measured, rates = np.empty((400, 3)), np.empty((400, 3))
    lever = np.array([0.0, 0.05, 0.0])
    motion.sensed(k, lever, motion.EarthAtPlace(np.zeros(3), 9.8, 0.0), rates, measured)
    omega = 180.0 * 2.0 * np.pi / 60.0
    expected = np.array([0.0, -(omega**2) * 0.05, 0.0]) - 9.8 * k.mat_nt[:, 2, :]
    assert_allclose(measured, expected, atol=1e-9)
    assert_allclose(rates, [[omega, 0.0, 0.0]] * 400, atol=1e-12)


def test_energy_and_displacement_stay_bounded_for_an_hour():
    m = moved(phases=(SchedulePhase("drill", 3600.0, rpm=120.0, rop_m_h=0.0),))
    for second in (10, 1800, 3590):
        k = m.at(second * 2000, 4000, 2000.0)
        # The heave of the string apart (3 m/s^2 at 0.3 Hz is 0.84 m), a sonde stays in its hole.
        assert np.abs(k.position_n - k.position_n.mean(axis=0)).max() < 0.9
        assert np.abs(k.velocity_n).max() < 3.0

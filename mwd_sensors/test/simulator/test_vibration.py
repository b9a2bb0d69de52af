# SPDX-License-Identifier: Apache-2.0
"""Vibration: the asked spectrum, level and envelope, from displacements that stay bounded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from mwd_sensors.simulator import vibration
from mwd_sensors.simulator.vibration import Hunting, RandomVibration, Shocks, StickSlip, Sweep, Tone, Vibrations, Whirl

RATE = 2000.0


def shaken(vibrations, seconds=60.0, start=0.0, level=1.0, seed=1):
    n = round(seconds * RATE)
    envelopes = np.zeros((len(vibration.ENVELOPES), 3, n))
    envelopes[:, 0] = level
    out = np.zeros((vibration.CHANNELS, 3, n))
    drawn = vibration.draw_lines(vibrations, np.random.default_rng(seed))
    vibration.add_lines(drawn, envelopes, start, 1.0 / RATE, out)
    return out


def test_random_vibration_has_the_asked_level_and_band():
    out = shaken(Vibrations(random=(RandomVibration((8.0, 300.0), (10.0, 20.0, 30.0), (5.0, 0.0, 2.0), 200),)))
    assert_allclose(out[:3, 2].std(axis=1), [10.0, 20.0, 30.0], rtol=0.02)
    assert_allclose(np.degrees(out[3:, 1].std(axis=1)), [0.0, 2.0, 5.0], rtol=0.02, atol=1e-12)
    frequency, power = signal.welch(out[2, 2], RATE, nperseg=2000)
    inside = (frequency > 20.0) & (frequency < 290.0)
    level = power[inside][:260].reshape(-1, 10).mean(axis=1)
    # Flat at rms^2 / bandwidth inside, nothing outside.
    assert_allclose(level, 30.0**2 / 292.0, rtol=0.6)
    assert level.mean() == pytest.approx(30.0**2 / 292.0, rel=0.1)
    assert power[frequency > 310.0].max() < 1e-3 * level.mean()
    # 30 m/s^2 from 8 Hz up integrates to a millimetre.
    assert np.abs(out[2, 0]).max() < 0.01


def test_sums_of_sines_are_near_to_gaussian():
    a = shaken(Vibrations(random=(RandomVibration((8.0, 300.0), (10.0, 0.0, 0.0)),)))[0, 2]
    assert np.mean((a / a.std()) ** 4) == pytest.approx(3.0, abs=0.3)
    assert np.abs(a).max() > 3.5 * a.std()


def test_velocity_and_acceleration_are_derivatives_of_the_displacement_under_a_changing_envelope():
    n, dt = 20001, 5e-5
    t = np.arange(n) * dt
    envelopes = np.zeros((len(vibration.ENVELOPES), 3, n))
    envelopes[:] = [t**2, 2.0 * t, np.full(n, 2.0)]
    out = np.zeros((6, 3, n))
    drawn = vibration.draw_lines(
        Vibrations(random=(RandomVibration((5.0, 50.0), (1.0, 1.0, 1.0), (9.0, 9.0, 9.0)),)), np.random.default_rng(2)
    )
    vibration.add_lines(drawn, envelopes, 0.0, dt, out)
    assert_allclose(np.gradient(out[:, 0], dt, axis=1)[:, 1:-1], out[:, 1, 1:-1], atol=1e-4)
    assert_allclose(np.gradient(out[:, 1], dt, axis=1)[:, 1:-1], out[:, 2, 1:-1], atol=5e-3)


def test_whirl_runs_round_the_hole_against_the_rotation():
    y, z = shaken(Vibrations(whirl=(Whirl(12.0, 30.0),)), 1.0)[1:3]
    assert_allclose(np.hypot(y[2], z[2]), 30.0, rtol=1e-9)
    assert_allclose(np.hypot(y[0], z[0]), 30.0 / (2.0 * math.pi * 12.0) ** 2, rtol=1e-9)
    # y is left, z high side: left to high side is clockwise looking down-hole, so backward is a falling angle.
    assert_allclose(np.diff(np.unwrap(np.arctan2(z[0], y[0]))) * RATE, -2.0 * math.pi * 12.0, rtol=1e-6)
    y, z = shaken(Vibrations(whirl=(Whirl(12.0, 30.0, backward=False),)), 1.0)[1:3]
    assert np.diff(np.unwrap(np.arctan2(z[0], y[0]))).min() > 0.0


@pytest.mark.parametrize(("sticky", "low", "high"), [(False, 0.0, 2.0), (True, 0.0, 8.0 / 3.0)])
def test_stick_slip_swings_the_speed_between_standstill_and_its_peak(sticky, low, high):
    omega = 150.0 * 2.0 * math.pi / 60.0
    out = shaken(Vibrations(stick_slip=StickSlip(0.2, 1.0, sticky)), 20.0, level=omega)
    speed = (omega + out[5, 1]) / omega
    assert speed.min() == pytest.approx(low, abs=1e-3)
    assert speed.max() == pytest.approx(high, abs=1e-3)
    assert speed.mean() == pytest.approx(1.0, abs=1e-9)


def test_tones_have_their_amplitude_and_hunting_its_angle():
    out = shaken(Vibrations(tones=(Tone(0.3, (3.0, 0.0, 0.0), (0.0, 2.0, 0.0)),), hunting=Hunting(6.0)), 600.0)
    assert np.abs(out[0, 2]).max() == pytest.approx(3.0, rel=1e-3)
    assert np.abs(out[0, 0]).max() == pytest.approx(3.0 / (0.6 * math.pi) ** 2, rel=1e-3)
    assert np.degrees(np.abs(out[3, 1]).max()) == pytest.approx(2.0, rel=1e-3)
    assert np.degrees(out[5, 0].std()) == pytest.approx(6.0, rel=0.15)


def test_a_sweep_goes_up_and_down_with_constant_acceleration():
    sweep = Sweep(10.0, 150.0, 332.0, (0.0, 0.0, 50.0))
    amplitude, power, phase = np.array([0, 0, 50.0, 0, 0, 0]), np.full(6, 2.0), np.zeros(6)
    lines = vibration.SweepLines(sweep.low_hz, sweep.high_hz, sweep.period_s, amplitude, power, phase)
    for start, expected in ((0.0, 10.0), (83.0, 80.0), (165.5, 150.0), (249.0, 80.0), (331.0, 10.0)):
        out = np.zeros((6, 3, 2000))
        vibration.add_sweep(lines, start, 1.0 / RATE, out)
        assert np.abs(out[2, 2]).max() == pytest.approx(50.0, rel=0.01)
        crossings = np.count_nonzero(np.diff(np.signbit(out[2, 2])))
        assert crossings / 2 == pytest.approx(expected, abs=1.2)


def test_shocks_are_drawn_only_inside_their_intervals_with_the_asked_sizes():
    shocks, intervals = (Shocks(2.0, (50.0, 100.0), (0.5, 4.0), 15.0),), {"drilling": [(10.0, 70.0)]}
    drawn = vibration.draw_hits(shocks, intervals, np.random.default_rng(1))
    assert 90 < len(drawn.time) < 130
    assert ((drawn.time > 10.0) & (drawn.time < 70.0)).all()
    assert ((drawn.peak / 9.80665 > 50.0) & (drawn.peak / 9.80665 < 100.0)).all()
    assert_allclose(np.linalg.norm(drawn.direction, axis=1), 1.0)
    assert drawn.displacement.max() < 0.0155

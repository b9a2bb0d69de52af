# SPDX-License-Identifier: Apache-2.0
"""Clipping in the bounded filter: velocities lost in shocks that samples show, and in those that they do not."""

import math

import numpy as np
import pytest
from gravity_runs import Drilled, drilled, error_deg, followed, inclination_error, rms, toolface_error

from consistency import assert_consistent
from mwd_estimation.gravity.bounded import alignment, clipping, scale
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.state import TILT, VEL
from simulated_sonde import simulated

# Every other or third second a slide hits the wall. Means of 20 ms show less of a clipped shock than of the vibration.
RARE_SHOCKS = {
    "well": {"stations": [[0.0, 50.0, 60.0]]},
    "schedule": [{"kind": "slide", "seconds": 100.0, "rop_m_h": 0.0, "toolface_deg": 40.0}],
    "rate_hz": 50,
    "vibration": {
        "random": [{"band_hz": [8.0, 300.0], "acceleration_mps2": [10.0, 10.0, 10.0]}],
        "shocks": [{"rate_hz": 0.4, "peak_g": [20.0, 80.0], "width_ms": [0.5, 3.0], "clearance_mm": 10.0}],
    },
}


@pytest.mark.slow
def test_rare_shocks_that_do_not_stand_out_in_long_samples_cost_no_tilt_either():
    errors, sigmas, directions = [], [], []
    for seed in range(51, 54):
        data = drilled("rot155", **RARE_SHOCKS, seed=seed)
        got, late = followed(data), data.after(20.0)
        errors.append(inclination_error(got, data.down)[late])
        sigmas.append(got.sigma_inclination[late])
        directions.append(error_deg(got, data.down)[late])
    assert rms(np.array(directions)) < 0.06
    assert_consistent(np.stack(errors), np.stack(sigmas), correlated=True)


@pytest.mark.slow(5)
def test_the_roll_is_followed_through_a_clipping_gyro_in_a_steep_hole():
    """The pull of the sensor's circle is up to sixteen times what gravity has across the axis."""
    errors, sigmas = [], []
    for seed, inclination_deg, rate_hz in ((61, 15.0, 100), (62, 30.0, 50), (63, 8.0, 200)):
        data = drilled(
            "gyroclip",
            seed=seed,
            rate_hz=rate_hz,
            well={"stations": [[0.0, inclination_deg, 60.0]]},
            schedule=[{"kind": "drill", "seconds": 40.0, "rpm": 225.0, "rop_m_h": 0.0}],
        )
        got, every = followed(data), slice(10 * rate_hz, None, rate_hz // 50)
        errors.append(toolface_error(got, data.down)[every])
        sigmas.append(got.sigma_toolface[every])
    assert math.degrees(rms(np.array(errors))) < 5.0
    assert_consistent(np.stack(errors), np.stack(sigmas), correlated=True)


@pytest.mark.slow(10)
@pytest.mark.parametrize("seed", [7001, 7003, 7102])
def test_sigma_covers_a_roll_lost_to_a_clipping_gyro_among_shocks_and_whirl(seed):
    # If the scale is that of the time before clipping, and the roll is never lost, 5 to 8 % are beyond 3 sigma, and 0.7
    # to 2 % are more than 10 deg of toolface off.
    samples, _ = simulated("stick_slip_hell", seed=seed)
    imu, truth = samples["imu/data_raw"], samples["truth"]
    down = truth["gravity"][np.searchsorted(truth["stamp_ns"], imu["stamp_ns"])]
    data = Drilled(imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"], down)
    got, late = followed(data), data.after(10.0)
    off = np.abs(toolface_error(got, data.down))[late]
    beyond = off > 3.0 * got.sigma_toolface[late]
    tilted = np.abs(inclination_error(got, data.down))[late] > 3.0 * got.sigma_inclination[late]
    assert np.mean(beyond | tilted) < 0.04
    assert np.mean(beyond & (off > math.radians(10.0))) < 0.002
    # The roll is known for most of the time.
    assert math.degrees(np.median(got.sigma_toolface[late])) < 2.0


def test_a_lost_roll_has_the_sigma_of_a_full_circle_until_clipping_ends():
    p = bounded.BoundedParams()
    s = bounded.initial(p).record[0]
    s.clipping.sign, s.sums.time, s.settled = 1.0, 0.015, 60.0
    s.P[TILT, TILT] = math.radians(20.0) ** 2
    # A wrong roll makes the innovations larger than expected.
    for _ in range(10):
        clipping.follow_roll(s, 0.5)
    scale.publish(p, s)
    assert s.sigma_toolface < math.pi
    for _ in range(10):
        clipping.follow_roll(s, 4.0)
    clipping.follow_roll(s, 0.0)
    scale.publish(p, s)
    assert s.sigma_toolface == math.pi
    clipping.clear(s)
    assert not s.clipping.lost


def _gate(rate_hz: float, interval_s: float) -> float:
    """Gate in units of the usual square after shocks at this rate, from samples of 0.01 s that span the interval."""
    s = bounded.initial(bounded.BoundedParams()).record[0]
    s.shocks, s.sums.time, s.period, s.innovations.usual = rate_hz * clipping.SHOCK_MEMORY, interval_s, 0.01, 1.0
    return clipping.jump_gate(s)


def test_the_more_shocks_were_seen_the_smaller_an_innovation_shows_a_velocity_lost():
    # Of 100 samples of Gaussian vibration a second 0.23 are beyond 2.2 times the usual: chi-square of 3 beyond 14.52.
    assert _gate(0.2, 0.03) == clipping.NEVER
    for rate_hz in (1.0, 8.0):
        # A square is beyond the gate by chance with exp(-gate / 2) at most, as often as a shock comes in the interval.
        often = 1.0 - math.exp(-(rate_hz - 0.23) * 0.03)
        assert math.exp(-_gate(rate_hz, 0.03) / 2.0) == pytest.approx(often, rel=1e-6)


@pytest.mark.parametrize("interval_s", [0.2, 1.0])
def test_shocks_that_come_faster_than_updates_leave_a_gate_above_zero(interval_s):
    # Ten shocks a second, and an update of a slow unit or at the end of a gap: a shock is never quite certain.
    assert 0.0 < _gate(10.0, interval_s) < _gate(10.0, 0.1)


@pytest.mark.parametrize("rate_hz", [1000, 2000, 4000])
def test_velocity_lost_in_a_clipped_shock_has_the_same_variance_at_every_sampling_rate(rate_hz):
    p = bounded.BoundedParams()
    s = bounded.initial(p).record[0]
    before, force, duration = s.P[VEL + 1, VEL + 1], p.accel_range, 0.003
    for _ in range(round(duration * rate_hz)):
        clipping.follow_shocks(p, s, 1.0 / rate_hz, (0.0, force, -p.gravity), force**2, True)
    clipping.follow_shocks(p, s, 1.0 / rate_hz, (0.0, 0.0, -p.gravity), 0.0, False)
    assert s.P[VEL + 1, VEL + 1] - before == pytest.approx(1.1 * (clipping.LOST * duration * force) ** 2)
    clipping.follow_shocks(p, s, 1.0 / rate_hz, (0.0, force, -p.gravity), force**2, True)
    assert s.shock_time == pytest.approx(1.0 / rate_hz)


def test_a_start_takes_out_the_learnt_pull_and_what_the_x_gyro_did_not_carry():
    p = bounded.BoundedParams()
    s = bounded.initial(p).record[0]
    inclination, rate, lever = math.radians(15.0), 30.0, np.array([0.02, 0.008])
    s.lever[:], s.last_w[0] = lever, rate
    gravity = np.array([math.cos(inclination), 0.6 * math.sin(inclination), 0.8 * math.sin(inclination)])
    force = -p.gravity * gravity
    # The circle's centripetal acceleration is 7.6 times what gravity has across the axis.
    force[1:] -= rate**2 * lever
    for _ in range(20):
        assert not alignment.average(p, s, 0.01, np.array([0.0, 50.0, 0.0]), False)
    assert not alignment.average(p, s, 0.01, force, True)
    found = [alignment.average(p, s, 0.01, force, False) for _ in range(29)]
    assert found.index(True) == len(found) - 1
    assert s.g_t == pytest.approx(gravity, abs=1e-9)


def test_one_wrong_force_within_the_vibration_leaves_the_inclination_within_its_sigma():
    # A velocity of 0.3 m/s from one sample: it had tilted a sliding tool by 0.5 deg, 40 sigma.
    n, at = 4000, 2000
    stamps = np.arange(n) * 10_000_000
    rng = np.random.default_rng(3)
    gravity = np.array([math.cos(0.9), 0.0, math.sin(0.9)])
    # Vibration without a velocity of its own: differences of a bounded displacement.
    wobble = rng.normal(size=(n + 2, 3)) * 3.5e-4
    force = -9.81 * gravity + np.diff(wobble, n=2, axis=0) / 1e-4
    gyro = 1e-3 * rng.normal(size=(n, 3))
    p = bounded.BoundedParams()
    clean = bounded.run(p, bounded.initial(p), stamps, gyro, force)
    for axis, value in ((0, 30.0), (1, -30.0), (2, 30.0), (2, -20.0)):
        wrong = force.copy()
        wrong[at, axis] += value
        got = bounded.run(p, bounded.initial(p), stamps, gyro, wrong)
        error = np.abs(got.inclination - clean.inclination)
        assert (error <= 3.5 * got.sigma_inclination + 1e-12).all(), (axis, value)


@pytest.mark.parametrize("roll_sigma_deg", [0.5, 10.0])
def test_a_large_innovation_is_not_taken_for_a_shock_while_the_roll_is_uncertain(roll_sigma_deg):
    s = bounded.initial(bounded.BoundedParams()).record[0]
    s.since_shock, s.sums.time = 10.0, 0.03
    s.P[TILT, TILT] = math.radians(roll_sigma_deg) ** 2
    assert clipping.jump_gate(s) < clipping.NEVER
    s.clipping.seen = True
    assert (clipping.jump_gate(s) < clipping.NEVER) == (roll_sigma_deg < 1.0)

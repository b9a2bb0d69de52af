# SPDX-License-Identifier: Apache-2.0
"""Biases of the gyros over a run: time moves them, stations show them, and a unit unlike its statement is found out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from mwd_estimation.gyrocompass import gyro_errors
from mwd_estimation.gyrocompass.azimuth_posterior import posterior
from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, EARTH_RATE
from mwd_sensors.core.frames import wrap_pi

PARAMS = SeekParams(gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, gyro_ramp_deg_h2=3.0, gyro_walk_deg_h_rth=0.3)
EARTH, BIAS = slice(0, 2), slice(2, 5)
HORIZONTAL, DOWN = EARTH_RATE * math.cos(math.radians(34.0)), -EARTH_RATE * math.sin(math.radians(34.0))
NOISE = 0.3 * DEG_PER_HOUR


def station(bias: Array, heading: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """What a still tool at any toolface finds of Earth rate and biases, rad/s, that knew nothing of either."""
    mat = Rotation.random(random_state=rng).as_matrix()
    earth = np.array([HORIZONTAL * math.cos(heading), -HORIZONTAL * math.sin(heading), 0.0])
    reading = earth + mat @ bias + NOISE * rng.standard_normal(3)
    H = np.hstack([np.eye(3)[:, :2], mat])
    P = np.diag([(3.0 * HORIZONTAL) ** 2] * 2 + [(500.0 * DEG_PER_HOUR) ** 2] * 3)
    gain = np.linalg.solve(H @ P @ H.T + NOISE**2 * np.eye(3), H @ P).T
    return gain @ reading, P - gain @ H @ P


@pytest.mark.parametrize("seconds", [30.0, 1800.0, 40000.0])
def test_time_passes_in_any_steps(seconds):
    begun = gyro_errors.stated(PARAMS)
    assert_allclose(begun.covariance, np.transpose(begun.covariance, (0, 2, 1)))
    whole = gyro_errors.after(begun, PARAMS, seconds)
    steps = gyro_errors.after(gyro_errors.after(begun, PARAMS, 0.3 * seconds), PARAMS, 0.7 * seconds)
    assert_allclose(steps.covariance, whole.covariance, rtol=1e-9, atol=1e-30)
    assert_allclose(steps.mean, whole.mean)


def test_each_pair_of_scales_has_its_exact_posterior_and_evidence():
    x, P = station(np.array([3.0, -4.0, 2.0]) * DEG_PER_HOUR, 0.7, np.random.default_rng(1))
    errors = gyro_errors.stated(PARAMS)
    parts = gyro_errors.parts(errors, x, P, np.array([0.0, 0.0, 0.1, 0.2, 0.3]), EARTH, BIAS)
    for k in (0, 21, 47):
        C = errors.covariance[k][:3, :3]
        information = np.linalg.inv(P) + np.pad(np.linalg.inv(C), ((2, 0), (2, 0)))
        S = np.linalg.inv(information)
        assert_allclose(parts[k].S, S[EARTH, EARTH], rtol=1e-5, atol=1e-6 * S[0, 0])
        assert_allclose(parts[k].earth, (S @ np.linalg.solve(P, x))[EARTH], rtol=1e-5)
        evidence = multivariate_normal.logpdf(x[BIAS], np.zeros(3), P[BIAS, BIAS] + C) + 1.5 * math.log(math.tau)
        assert parts[k].log_weight == pytest.approx(errors.log_weight[k] + evidence)


@pytest.mark.parametrize(("bias", "walk"), [(5.0, 0.3), (1.0, 0.0), (15.0, 0.0)], ids=["stated", "better", "worse"])
def test_stations_of_a_run_find_the_biases_of_any_unit_with_an_honest_sigma(bias, walk):
    rng, errors, sigmas = np.random.default_rng(3), [], []
    for _ in range(40):
        true, known = bias * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        for _ in range(6):
            heading = rng.uniform(0.0, math.tau)
            x, P = station(true, heading, rng)
            found = posterior(gyro_errors.parts(known, x, P, np.zeros(5), EARTH, BIAS), HORIZONTAL, heading)
            known = gyro_errors.after(gyro_errors.learnt(known, x, P, EARTH, BIAS, HORIZONTAL), PARAMS, 1800.0)
            true = true + walk * DEG_PER_HOUR * math.sqrt(0.5) * rng.standard_normal(3)
        errors.append(float(wrap_pi(found.mean - heading)))
        sigmas.append(found.sigma)
    off, sigma = np.array(errors), np.array(sigmas)
    assert np.mean(np.abs(off) > 3.0 * sigma) < 0.05
    assert np.mean((off / sigma) ** 2) < 1.6
    # At the sixth station the bias is known to a part of what is stated, which alone is 23 deg.
    assert np.median(sigma) < math.radians(10.0)


def test_biases_that_step_after_they_are_known_are_found_again():
    rng, off, sigma = np.random.default_rng(5), [], []
    for _ in range(40):
        true, known = 5.0 * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        for k in range(8):
            if k == 6:
                true = 5.0 * DEG_PER_HOUR * rng.standard_normal(3)
            heading = rng.uniform(0.0, math.tau)
            x, P = station(true, heading, rng)
            found = posterior(gyro_errors.parts(known, x, P, np.zeros(5), EARTH, BIAS), HORIZONTAL, heading)
            known = gyro_errors.learnt(known, x, P, EARTH, BIAS, HORIZONTAL)
            known = gyro_errors.after(gyro_errors.maybe_stepped(known, PARAMS), PARAMS, 1800.0)
            if k >= 6:
                off.append(float(wrap_pi(found.mean - heading)))
                sigma.append(found.sigma)
    beyond = np.mean(np.abs(off) > 3.0 * np.array(sigma))
    assert beyond < 0.1

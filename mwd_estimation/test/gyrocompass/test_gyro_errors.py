# SPDX-License-Identifier: Apache-2.0
"""Biases of the gyros over a run: time moves them, stations show them, and a unit unlike its statement is found out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from mwd_estimation.gyrocompass import gyro_errors
from mwd_estimation.gyrocompass.azimuth_posterior import posterior
from mwd_estimation.gyrocompass.gyro_errors import GyroErrors, Sought
from mwd_estimation.gyrocompass.seek_refusal import WORST_SIGMA
from mwd_estimation.gyrocompass.seek_state import SeekParams, kernel_params
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, EARTH_RATE
from mwd_sensors.core.frames import wrap_pi

PARAMS = SeekParams(gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, gyro_ramp_deg_h2=3.0, gyro_walk_deg_h_rth=0.3)
P_SI = kernel_params(PARAMS)
HORIZONTAL, DOWN = EARTH_RATE * math.cos(math.radians(34.0)), -EARTH_RATE * math.sin(math.radians(34.0))
NOISE = 0.3 * DEG_PER_HOUR
PRIOR = np.diag([*np.square(P_SI.start_bias), *[P_SI.bias_ramp**2] * 3, *[P_SI.g_sensitivity**2] * 4])
# What a seek supposes: any Earth rate, errors of the gyros, and a heading that the gyros do not change.
START = np.diag([*[(3.0 * HORIZONTAL) ** 2] * 2, *np.diag(PRIOR), 1e-12, (3.0 * HORIZONTAL) ** 2])


def reading(bias: Array, heading: float, rng: np.random.Generator, mat: Array) -> tuple[Array, Array]:
    """Rates of a still tool, and their slopes by what a seek finds, shape (3, 14)."""
    earth = np.array([HORIZONTAL * math.cos(heading), -HORIZONTAL * math.sin(heading), DOWN])
    H = np.hstack([mat.T[:, :2], np.eye(3), np.zeros((3, 8)), mat.T[:, 2:]])
    return mat.T @ earth + bias + NOISE * rng.standard_normal(3), H


def sought(value: Array, H: Array) -> Sought:
    gain = np.linalg.solve(H @ START @ H.T + NOISE**2 * np.eye(3), H @ START).T
    return Sought(gain @ value, START - gain @ H @ START, PRIOR)


def azimuth(known: GyroErrors, found: Sought, heading: float) -> tuple[float, float]:
    """Error and sigma of the azimuth, rad."""
    joined = gyro_errors.joined(known, found).at(DOWN)
    circle = posterior(gyro_errors.parts(known, joined), HORIZONTAL, heading)
    return float(wrap_pi(circle.mean - heading)), circle.sigma


def half_an_hour_later(known: GyroErrors, found: Sought) -> GyroErrors:
    """Return the knowledge of the gyro's errors half an hour after a station."""
    joined = gyro_errors.joined(known, found).at(DOWN)
    later = gyro_errors.between_stations(gyro_errors.learnt(known, joined, HORIZONTAL), PARAMS)
    return gyro_errors.after(later, PARAMS, 1800.0)


# Units that a rate of errors is estimated from: few in the gate, many at night.
DRAWN = pytest.mark.parametrize("units", [15, pytest.param(40, marks=pytest.mark.nightly)])


def any_toolface(rng: np.random.Generator) -> Array:
    return np.asarray(Rotation.random(random_state=rng).as_matrix())


@pytest.mark.parametrize("seconds", [30.0, 1800.0, 40000.0])
def test_time_passes_in_any_steps(seconds):
    begun = gyro_errors.stated(PARAMS)
    assert_allclose(begun.covariance, np.transpose(begun.covariance, (0, 2, 1)))
    whole = gyro_errors.after(begun, PARAMS, seconds)
    steps = gyro_errors.after(gyro_errors.after(begun, PARAMS, 0.3 * seconds), PARAMS, 0.7 * seconds)
    assert_allclose(steps.covariance, whole.covariance, rtol=1e-9, atol=1e-30)
    assert_allclose(steps.mean, whole.mean)


def test_a_ramp_is_the_same_after_ten_minutes_and_another_after_two_hours_unless_it_lasts():
    begun = gyro_errors.stated(PARAMS)
    begun.mean[:, 3:6] = 1.0
    kept = {seconds: gyro_errors.after(begun, PARAMS, seconds).mean[:, 3] for seconds in (600.0, 7200.0)}
    lasts = kept[7200.0] == 1.0
    assert 0.0 < lasts.mean() < 0.5
    assert kept[600.0].min() > 0.8
    assert kept[7200.0][~lasts].max() < 0.2


def test_each_kind_of_unit_has_its_exact_posterior_and_evidence_whatever_the_seek_supposed():
    rng = np.random.default_rng(1)
    value, H = reading(np.array([3.0, -4.0, 2.0]) * DEG_PER_HOUR, 0.7, rng, any_toolface(rng))
    errors = gyro_errors.stated(PARAMS)
    found = gyro_errors.joined(errors, sought(value, H)).at(DOWN)
    log, evidence = found.log_evidence, []
    # Given the vertical Earth rate, it is a known part of the reading.
    value, H, known = value - H[:, 13] * DOWN, H[:, :13], START[:13, :13]
    for k, covariance in enumerate(errors.covariance):
        start = known.copy()
        start[2:12, 2:12] = covariance
        S = H @ start @ H.T + NOISE**2 * np.eye(3)
        gain = np.linalg.solve(S, H @ start).T
        unit = np.sqrt(np.diag(start))
        assert_allclose(found.mean[k] / unit, gain @ value / unit, atol=1e-4)
        exact = start - gain @ H @ start
        assert_allclose(found.covariance[k] / np.outer(unit, unit), exact / np.outer(unit, unit), atol=1e-4)
        evidence.append(multivariate_normal.logpdf(value, np.zeros(3), S))
    assert_allclose(log - log[0], np.array(evidence) - evidence[0], atol=1e-3)


@pytest.mark.slow(2)
@DRAWN
@pytest.mark.parametrize(("bias", "walk"), [(5.0, 0.3), (1.0, 0.0), (15.0, 0.0)], ids=["stated", "better", "worse"])
def test_stations_of_a_run_find_the_biases_of_any_unit_with_an_honest_sigma(bias, walk, units):
    rng, errors, sigmas = np.random.default_rng(3), [], []
    for _ in range(units):
        true, known = bias * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        for _ in range(5):
            heading = rng.uniform(0.0, math.tau)
            known = half_an_hour_later(known, sought(*reading(true, heading, rng, any_toolface(rng))))
            true = true + walk * DEG_PER_HOUR * math.sqrt(0.5) * rng.standard_normal(3)
        heading = rng.uniform(0.0, math.tau)
        off, sigma = azimuth(known, sought(*reading(true, heading, rng, any_toolface(rng))), heading)
        errors.append(off)
        sigmas.append(sigma)
    off, sigma = np.array(errors), np.array(sigmas)
    assert np.mean(np.abs(off) > 3.0 * sigma) < 0.05
    assert np.mean((off / sigma) ** 2) < 1.6
    # At the sixth station the bias is known to a part of what is stated, which alone is 23 deg.
    assert np.median(sigma) < math.radians(10.0)


@pytest.mark.slow(0.5)
@DRAWN
def test_stations_at_one_attitude_do_not_show_their_azimuth_by_being_many(units):
    rng, errors, sigmas = np.random.default_rng(4), [], []
    for _ in range(units):
        true, known = 5.0 * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        mat, heading = any_toolface(rng), rng.uniform(0.0, math.tau)
        known = half_an_hour_later(known, sought(*reading(true, heading, rng, mat)))
        # As `GyroStation` does: what the first has shown of the biases, the others only use.
        for _ in range(8):
            known = gyro_errors.after(known, PARAMS, 1800.0)
        off, sigma = azimuth(known, sought(*reading(true, heading, rng, mat)), heading)
        errors.append(off)
        sigmas.append(sigma)
    assert np.mean((np.array(errors) / sigmas) ** 2) < 1.6


def test_a_kind_of_unit_that_does_not_fit_keeps_its_own_biases():
    known = gyro_errors.stated(PARAMS)
    rng, mat = np.random.default_rng(6), np.eye(3)
    value, H = reading(np.full(3, 10.0 * DEG_PER_HOUR), 1.0, rng, mat)
    gain = np.linalg.solve(H @ START @ H.T + (0.01 * NOISE) ** 2 * np.eye(3), H @ START).T
    found = Sought(gain @ value, START - gain @ H @ START, PRIOR)
    later = gyro_errors.learnt(known, gyro_errors.joined(known, found).at(DOWN), HORIZONTAL)
    assert set(later.kind[:, 0]) == set(known.kind[:, 0])
    assert np.diagonal(later.covariance, axis1=1, axis2=2).min() > 0.0


@pytest.mark.slow(3)
@DRAWN
def test_biases_that_step_after_they_are_known_are_found_again(units):
    rng, off, sigma = np.random.default_rng(5), [], []
    for _ in range(units):
        true, known = 5.0 * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        for k in range(8):
            if k == 6:
                true = 5.0 * DEG_PER_HOUR * rng.standard_normal(3)
            heading = rng.uniform(0.0, math.tau)
            found = sought(*reading(true, heading, rng, any_toolface(rng)))
            if k >= 6:
                error, one = azimuth(known, found, heading)
                off.append(error)
                sigma.append(one)
            known = half_an_hour_later(known, found)
    z = np.array(off) / sigma
    assert np.mean(np.abs(z) > 3.0) < 0.05
    assert np.mean(z**2) < 2.0


@pytest.mark.slow(4)
@DRAWN
def test_a_ramp_that_lasts_is_found_in_a_run_and_makes_few_azimuths_wrong(units):
    """Biases that drift steadily by 10 deg/h per hour, either way, where 3 deg/h per hour are stated."""
    rng, off, sigma, late = np.random.default_rng(11), [], [], []
    for _ in range(units):
        true, known = 5.0 * DEG_PER_HOUR * rng.standard_normal(3), gyro_errors.stated(PARAMS)
        ramp = 10.0 * DEG_PER_HOUR * rng.choice([-1.0, 1.0], 3)
        for k in range(7):
            heading = rng.uniform(0.0, math.tau)
            found = sought(*reading(true, heading, rng, any_toolface(rng)))
            error, one = azimuth(known, found, heading)
            if one < WORST_SIGMA:
                off.append(error)
                sigma.append(one)
                late.append(k > 3)
            known = half_an_hour_later(known, found)
            true = true + 0.5 * ramp
    assert np.count_nonzero(late) > units
    assert np.mean(np.abs(off) > 3.0 * np.array(sigma)) < 0.04


def test_a_vertical_rate_that_the_latitude_does_not_have_is_a_misfit_in_sigmas():
    """A unit with known biases: right at its own latitude, far off at any other."""
    rng = np.random.default_rng(8)
    value, H = reading(np.zeros(3), 0.7, rng, any_toolface(rng))
    errors, seek = gyro_errors.stated(PARAMS), sought(value, H)
    known = dataclasses.replace(errors, covariance=1e-6 * errors.covariance)
    misfits = {}
    for told in (34.0, 44.0, -34.0):
        latitude = math.radians(told)
        found = gyro_errors.joined(known, seek).at(-EARTH_RATE * math.sin(latitude))
        misfits[told] = posterior(gyro_errors.parts(known, found), EARTH_RATE * math.cos(latitude)).misfit
    assert misfits[34.0] < 9.0
    assert min(misfits[44.0], misfits[-34.0]) > 9.0

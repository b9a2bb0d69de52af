# SPDX-License-Identifier: Apache-2.0
"""Magnetic azimuth and its axial correction: inverse pairs, sigma against error, slopes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import floats

from mwd_estimation.magnetic import axial_correction
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.pi / 180.0
TOTAL, DIP = 50e-6, 72.0 * DEG
HORIZONTAL, VERTICAL = TOTAL * math.cos(DIP), TOTAL * math.sin(DIP)
SENSORS = np.diag([0.004**2] * 3 + [70e-9**2] * 3)


def reference_covariance(total=TOTAL, dip=DIP, sigma_total=145e-9, sigma_dip=0.218 * DEG):
    jac = np.array([[np.cos(dip), -total * np.sin(dip)], [np.sin(dip), total * np.cos(dip)]])
    return jac @ np.diag([sigma_total**2, sigma_dip**2]) @ jac.T


def readings(inc, azi, toolface, horizontal=HORIZONTAL, vertical=VERTICAL, axial=0.0):
    mat_tn = np.swapaxes(mat_nt(inc, azi, toolface), -1, -2)
    b_t = mat_tn @ np.array([horizontal, 0.0, vertical])
    b_t[..., 0] += axial
    return mat_tn @ np.array([0.0, 0.0, -9.81]), b_t


def corrected(f_t, b_t, total=TOTAL, dip=DIP, **priors):
    """The correction of these readings in a field of this strength and dip."""
    field = total * np.cos(dip), total * np.sin(dip)
    if np.ndim(total):
        covariance = np.stack([reference_covariance(*one) for one in zip(total, dip, strict=True)])
    else:
        covariance = reference_covariance(total, dip)
    return axial_correction.axial_correction(f_t, b_t, *field, SENSORS, covariance, **priors)


ANY_ANGLE = floats(0.0, 2.0 * math.pi)


@pytest.mark.fault_case(25, 32)
@settings(max_examples=40, deadline=None)
@given(azi=ANY_ANGLE, toolface=ANY_ANGLE, axial=floats(-2e-5, 2e-5), dip=floats(-1.2, 1.2))
@pytest.mark.parametrize("inc", [0.2, 1.0, 2.0, 3.0])
def test_correction_finds_azimuth_and_interference_in_every_quadrant_and_hemisphere(inc, azi, toolface, axial, dip):
    h, v = TOTAL * math.cos(dip), TOTAL * math.sin(dip)
    f_t, b_t = readings(inc, azi, toolface, h, v, axial)
    done = corrected(f_t, b_t, dip=dip)
    assert wrap_pi(done.azimuth - azi) == pytest.approx(0.0, abs=1e-6)
    assert done.interference == pytest.approx(axial, abs=1e-10)


def monte_carlo(inc, azi, runs, seed, axial=900e-9, **priors):
    """Errors of azimuth and interference over their sigmas, for `runs` noisy stations at random toolface."""
    rng = np.random.default_rng(seed)
    inc, azi = np.full(runs, inc), np.full(runs, azi) if np.isscalar(azi) else azi
    total, dip = TOTAL + rng.normal(0, 145e-9, runs), DIP + rng.normal(0, 0.218 * DEG, runs)
    f_t, b_t = readings(inc, azi, rng.uniform(0, 6.28, runs), axial=axial)
    f_t = f_t + rng.normal(0, 0.004, f_t.shape)
    b_t = b_t + rng.normal(0, 70e-9, b_t.shape)
    done = corrected(f_t, b_t, total, dip, **priors)
    return wrap_pi(done.azimuth - azi), done


# 400 runs: the mean of a squared unit normal lies within 1 +- 0.14 in 95 of 100 cases; 1 +- 0.2 in 99.5.
@pytest.mark.parametrize(
    ("inc", "azi"), [(3, 30), (30, 0), (30, 90), (60, 90), (75, 70), (45, 200), (120, 300), (88, 20)]
)
def test_corrected_azimuth_and_interference_err_by_their_sigma(inc, azi):
    error, done = monte_carlo(inc * DEG, azi * DEG, 400, 11, plausible=3e-6)
    assert np.mean((error / done.sigma_azimuth) ** 2) == pytest.approx(1.0, abs=0.2)
    assert np.mean(((done.interference - 900e-9) / done.sigma_interference) ** 2) == pytest.approx(1.0, abs=0.2)
    # One degree of freedom left.
    assert np.mean(done.chi_square) == pytest.approx(1.0, abs=0.3)


def test_sigma_stays_honest_where_the_geometry_is_singular():
    # A horizontal hole around east: a posterior is right over its prior, so azimuth and interference are drawn.
    rng = np.random.default_rng(5)
    azi, axial = rng.uniform(0.0, math.pi, 400), rng.normal(0.0, 3e-6, 400)
    error, done = monte_carlo(89.5 * DEG, azi, 400, 12, axial, plausible=3e-6)
    assert np.mean((error / done.sigma_azimuth) ** 2) == pytest.approx(1.0, abs=0.3)
    assert np.max(np.abs(error / done.sigma_azimuth)) < 6.0


@pytest.mark.parametrize("axial", [-20e-6, 20e-6, 40e-6])
@pytest.mark.parametrize(("inc", "azi"), [(80, 88), (85, 272), (89, 90), (90, 90), (100, 268)])
def test_sigma_stays_honest_there_with_interference_as_strong_as_the_field(inc, azi, axial):
    error, done = monte_carlo(inc * DEG, azi * DEG, 100, 13, axial, plausible=3e-6)
    # Due east the mean of the posterior is right by symmetry.
    assert np.mean((error / done.sigma_azimuth) ** 2) < 1.8
    assert np.percentile(np.abs(error / done.sigma_azimuth), 95) < 2.5
    off = (done.interference - axial) / done.sigma_interference
    assert np.mean(off**2) < 1.8


@pytest.mark.parametrize(("azi", "axial"), [(0, -40e-6), (60, -40e-6), (135, 22e-6), (180, 40e-6), (225, 22e-6)])
def test_a_mirror_is_reported_where_neither_interference_is_imaginable(azi, axial):
    # Exactly horizontal, 50 uT at 60 deg dip: the mirror asks for several times the plausible interference too.
    f_t, b_t = readings(90 * DEG, azi * DEG, 0.7, 25e-6, 50e-6 * math.sin(60 * DEG), axial)
    done = corrected(f_t, b_t, 50e-6, 60 * DEG, plausible=3e-6)
    assert done.mirror
    two = done.both
    assert np.min(np.abs(wrap_pi(two - azi * DEG))) < 0.01 * DEG
    assert np.min(np.abs(wrap_pi(two - (180 - azi) * DEG))) < 0.01 * DEG
    assert done.sigma_azimuth == pytest.approx(min(abs(wrap_pi(two[1] - two[0])) * math.sqrt(0.5), 1.82), rel=0.02)


@pytest.mark.fault_case(25)
def test_sigma_explodes_towards_the_horizontal_east_west_hole_and_not_elsewhere():
    def sigma(inc, azi):
        return corrected(*readings(inc * DEG, azi * DEG, 0.7), plausible=3e-6).sigma_azimuth / DEG

    assert sigma(30, 90) < sigma(60, 90) < sigma(80, 90) < sigma(88, 90)
    assert sigma(88, 90) > 5.0
    assert sigma(90, 90) > 5.0
    assert sigma(90, 10) < 2.0
    assert sigma(0.1, 0) > 5.0


def test_a_horizontal_hole_has_a_mirror_solution_unless_the_interference_is_bounded():
    f_t, b_t = readings(90 * DEG, 20 * DEG, 1.0, axial=900e-9)
    free, bound = corrected(f_t, b_t), corrected(f_t, b_t, plausible=3e-6)
    assert free.mirror
    assert free.sigma_azimuth > 90 * DEG
    assert not bound.mirror
    assert bound.azimuth / DEG == pytest.approx(20.0, abs=1e-6)


@pytest.mark.fault_case(26)
def test_cross_axial_interference_shows_as_misfit_and_is_not_taken_for_axial():
    f_t, b_t = readings(40 * DEG, 130 * DEG, 1.0)
    # Along the field seen across the axis: the cross-axis field is longer than any azimuth allows.
    assert corrected(f_t, b_t + np.array([0.0, 3e-6, 3e-6])).chi_square > 10.83


def test_a_vertical_hole_gives_nan_beside_good_stations():
    f_t, b_t = readings(np.array([0.0, 0.8]), np.array([0.0, 2.0]), 0.5)
    f_t[0] = [-9.81, 0.0, 0.0]
    done = corrected(f_t, b_t)
    assert np.isnan(done.azimuth[0])
    assert done.azimuth[1] == pytest.approx(2.0, abs=1e-9)


def test_a_plausible_interference_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="plausible"):
        corrected(*readings(0.5, 0.5, 0.5), plausible=0.0)

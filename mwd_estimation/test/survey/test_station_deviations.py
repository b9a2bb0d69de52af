# SPDX-License-Identifier: Apache-2.0
"""Totals against the reference: slopes, deviations, and what a gross fault looks like."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.error_model import BENCH
from mwd_estimation.core.magnetic_geometry import dip
from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.acceptance import totals
from mwd_estimation.survey.station_deviations import deviation_covariance, deviations, gross_faults, totals_jacobian
from mwd_sensors.core.frames import mat_nt

DEG = math.pi / 180.0
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "test")


def readings(inc, azi_magnetic, toolface):
    mat_tn = mat_nt(inc * DEG, azi_magnetic * DEG, toolface * DEG).T
    return mat_tn @ [0.0, 0.0, -9.81], mat_tn @ np.array([REFERENCE.horizontal, 0.0, REFERENCE.vertical])


def test_slopes_of_the_totals_agree_with_finite_differences():

    f_t, b_t = readings(50, 70, 130)

    def totals(x):
        return np.array([np.linalg.norm(x[:3]), np.linalg.norm(x[3:]), dip(x[:3], x[3:])])

    x, jac = np.concatenate([f_t, b_t]), totals_jacobian(f_t, b_t)
    for k, step in enumerate([1e-5] * 3 + [1e-11] * 3):
        change = np.zeros(6)
        change[k] = step
        slope = (totals(x + change) - totals(x - change)) / (2.0 * step)
        assert jac[:, k] * step == pytest.approx(slope * step, rel=1e-4, abs=1e-14)


def test_a_field_with_interference_deviates_until_it_is_taken_off_and_gravity_by_itself():
    f_t, b_t = readings(60, 40, 10)
    nothing, axial = np.zeros((6, 6)), np.array([2e-6, 0.0, 0.0])
    with_it = deviations(f_t, b_t + axial, REFERENCE, nothing, BENCH, 0.0, True)
    without = deviations(f_t, b_t + axial, REFERENCE, nothing, BENCH, 2e-6, True)
    assert abs(with_it.field) > 2e-7
    assert without.field == pytest.approx(0.0, abs=1e-12)
    assert without.dip == pytest.approx(0.0, abs=1e-9)
    assert without.gravity == pytest.approx(0.0, abs=1e-9)


def test_what_is_not_known_deviates_by_nan():
    f_t, b_t = readings(60, 40, 10)
    found = deviations(f_t, b_t, None, np.zeros((6, 6)), BENCH, 0.0, True)
    assert np.isnan([found.gravity, found.field, found.dip]).all()
    light = deviations(0.99 * f_t, b_t, None, np.zeros((6, 6)), BENCH, 0.0, True)
    assert light.gravity < -0.04


def test_the_reference_s_own_sigmas_are_in_the_covariance():
    f_t, b_t = readings(60, 40, 10)
    spread = deviation_covariance(f_t, b_t, REFERENCE, np.zeros((6, 6)), 0.0)
    sigmas = [REFERENCE.sigma_gravity, REFERENCE.sigma_total, REFERENCE.sigma_dip]
    assert np.sqrt(np.diagonal(spread)) == pytest.approx(sigmas)


@pytest.mark.parametrize(
    ("g_total", "b_total", "dip_", "words"),
    [
        (1.0, 5e-5, 1.2, "in g?"),
        (9.81, 50.0, 1.2, "in uT?"),
        (9.81, 5e4, 1.2, "in nT?"),
        (9.81, 5e-5, -72 * DEG, "flipped sign"),
    ],
)
def test_a_wrong_unit_or_sign_is_named(g_total, b_total, dip_, words):
    (found,) = gross_faults(g_total, b_total, dip_, REFERENCE)
    assert words in joined([found])


def test_sound_totals_are_no_fault():
    assert gross_faults(9.81, 5e-5, 72 * DEG, REFERENCE) == []


@pytest.mark.parametrize(
    ("reads", "deviates", "standard"),
    [(9.7803, 0.0, False), (9.7903, 0.01, False), (9.80665, 0.0, True), (9.8, 0.0, True), (9.83665, 0.03, True)],
)
def test_a_tool_that_calls_standard_gravity_one_g_is_held_against_that_where_it_is_nearer(reads, deviates, standard):
    equator = dataclasses.replace(REFERENCE, gravity=9.7803)
    f_t, b_t = readings(60, 40, 10)
    found = deviations(f_t * reads / 9.81, b_t, equator, np.zeros((6, 6)), BENCH, 0.0, True)
    assert found.gravity == pytest.approx(deviates, abs=1e-9)
    assert found.standard == standard
    assert ("standard gravity" in joined(totals(found, "toolcode"))) == standard

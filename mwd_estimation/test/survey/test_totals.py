# SPDX-License-Identifier: Apache-2.0
"""Totals against the reference: slopes, deviations, limits, and what a gross fault looks like."""

import dataclasses
import math

import numpy as np
import pytest
from bench_errors import BENCH

from mwd_estimation.core.magnetic_geometry import dip
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.totals import (
    Deviations,
    against_limits,
    bounds,
    deviation_covariance,
    deviations,
    field_faults,
    gravity_faults,
    judge,
    totals_jacobian,
)
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import mat_nt

DEG = math.pi / 180.0
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "test")


def readings(inc, azi_magnetic, toolface):
    mat_tn = mat_nt(inc * DEG, azi_magnetic * DEG, toolface * DEG).T
    return mat_tn @ [0.0, 0.0, -9.81], mat_tn @ np.array([REFERENCE.horizontal, 0.0, REFERENCE.vertical])


def named_by(reasons):
    """Codes of reasons and of the reasons behind them."""
    return {one.code for reason in reasons for one in (reason, *reason.causes)}


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
    ("g_total", "b_total", "dip_", "named"),
    [
        (9.81, 5e-5, 72 * DEG, []),
        (1.0, 5e-5, 1.2, [(ReasonCode.GRAVITY_IN_G, ())]),
        (9.81, 50.0, 1.2, [(ReasonCode.FIELD_IN_OTHER_UNIT, ("uT",))]),
        (9.81, 5e4, 1.2, [(ReasonCode.FIELD_IN_OTHER_UNIT, ("nT",))]),
        (9.81, 5e-5, -72 * DEG, [(ReasonCode.DIP_SIGN, ())]),
    ],
)
def test_a_wrong_unit_or_sign_is_named_and_sound_totals_are_no_fault(g_total, b_total, dip_, named):
    found = gravity_faults(g_total) + field_faults(b_total, dip_, REFERENCE)
    assert [(one.code, one.names) for one in found] == named


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
    codes = {ReasonCode.GRAVITY_OFF_STANDARD, ReasonCode.GRAVITY_WITHIN_STANDARD}
    assert bool(codes & named_by(against_limits(found, QualitySettings()))) == standard


COVARIANCE = np.diag([0.006**2, 200e-9**2, (0.25 * DEG) ** 2])


def apart(gravity=0.0, field=0.0, dip=0.0):
    return Deviations(gravity, field, dip, COVARIANCE)


@pytest.mark.fault_case(8)
@pytest.mark.parametrize(
    ("quantity", "off", "limits", "verdict", "limit"),
    [
        ("gravity", 0.03, "service", "doubtful", 2.5e-3 * STANDARD_GRAVITY),
        ("gravity", 0.05, "service", "reject", 2.5e-3 * STANDARD_GRAVITY),
        ("field", -320e-9, "service", "doubtful", 300e-9),
        ("field", -500e-9, "iscwsa", "reject", 300e-9),
        ("dip", 0.3 * DEG, "iscwsa", "doubtful", 0.25 * DEG),
        ("dip", 0.5 * DEG, "custom", "doubtful", 0.45 * DEG),
        ("field", 450e-9, "toolcode", "doubtful", 400e-9),
        ("field", 650e-9, "toolcode", "reject", 400e-9),
    ],
)
def test_a_deviation_beyond_its_limit_is_named_with_value_and_limit(quantity, off, limits, verdict, limit):
    judged = judge(apart(**{quantity: off}), QualitySettings(limits))
    assert judged.verdict == verdict
    assert judged.reasons[0] == Reason(ReasonCode(f"{quantity}_off"), pytest.approx(off), pytest.approx(limit))


def test_deviations_that_fit_singly_but_not_together_are_doubted_by_the_tool_code():
    cov = np.diag([0.006**2, 200e-9**2, (0.25 * DEG) ** 2])
    cov[1, 2] = cov[2, 1] = 0.95 * 200e-9 * 0.25 * DEG
    judged = judge(Deviations(0.0, 300e-9, -0.375 * DEG, cov), QualitySettings())
    assert judged.verdict == "reject"
    assert judged.reasons[0].code is ReasonCode.TOTALS_OFF_TOGETHER


def test_unknown_deviations_are_not_judged():
    assert judge(Deviations(math.nan, math.nan, math.nan, COVARIANCE), QualitySettings()).verdict == "accept"
    assert against_limits(Deviations(math.nan, math.nan, math.nan, COVARIANCE), QualitySettings("service")) == []


def test_an_accepted_station_says_what_it_was_held_against():
    off, quality = apart(0.01, -193e-9, -0.22 * DEG), QualitySettings("service")
    assert judge(off, quality).verdict == "accept"
    (remark,) = against_limits(off, quality)
    codes = ReasonCode.GRAVITY_WITHIN, ReasonCode.FIELD_WITHIN, ReasonCode.DIP_WITHIN
    limits = 2.5e-3 * STANDARD_GRAVITY, 300e-9, 0.45 * DEG
    causes = tuple(map(Reason, codes, off.values.tolist(), map(pytest.approx, limits)))
    assert (remark.code, remark.causes) == (ReasonCode.WITHIN_LIMITS, causes)


@pytest.mark.parametrize("limits", ["service", "iscwsa", "custom", "toolcode"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_station_is_accepted_up_to_its_bounds_and_doubted_beyond(limits, axis):
    quality = QualitySettings(limits)
    most = bounds(apart(), quality)
    for share, verdict in ((0.999, "accept"), (1.001, "doubtful")):
        off = np.zeros(3)
        off[axis] = share * most[axis]
        assert judge(apart(*off), quality).verdict == verdict
        assert (bounds(apart(*off), quality) == most).all()


def test_what_is_not_judged_has_no_bound():
    most = bounds(Deviations(0.0, math.nan, 0.0, COVARIANCE), QualitySettings("service"))
    assert np.isnan(most).tolist() == [False, True, False]


@pytest.mark.parametrize("use", [judge, bounds])
def test_unknown_limits_are_an_error_that_lists_the_known(use):
    with pytest.raises(ValueError, match="service, iscwsa, toolcode, custom"):
        use(apart(), QualitySettings("strict"))


def test_limits_of_one_s_own_are_in_force_by_name_only():
    own = QualitySettings("custom", (4.0, 500.0, 0.6))
    with pytest.raises(ValueError, match="the order is gravity"):
        QualitySettings("custom", (500.0, 4.0, 0.6))
    with pytest.raises(ValueError, match=r"0\.5 nT is below the lowest limit on the field, 1 nT"):
        QualitySettings("custom", (4.0, 0.5, 0.6))
    assert bounds(apart(), own) == pytest.approx([4e-3 * STANDARD_GRAVITY, 500e-9, 0.6 * DEG])
    assert judge(apart(field=-480e-9), own).verdict == "accept"
    assert judge(apart(field=-480e-9), dataclasses.replace(own, limits="service")).verdict == "reject"

# SPDX-License-Identifier: Apache-2.0
"""Stations of a run: a linear problem has its exact answer, what is shared is not averaged away, gyros are judged."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from consistency import consistency
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.posterior import circle, field_model, hypotheses
from mwd_estimation.survey.posterior.field_model import Shared
from mwd_estimation.survey.posterior.hypotheses import EXTERNAL_UT, Hypothesis, Priors, external_weights
from mwd_estimation.survey.posterior.run_filter import RunFilter
from mwd_sensors.core.frames import mat_nt, wrap_pi

REFERENCE = Reference(total=5e-5, dip=1.15, declination=0.0, gravity=9.81)
SIGMAS = field_model.nominal_sigmas(SensorErrors(), REFERENCE, False)
ALONE = Priors(axial=0.0, cross_axial=0.0, reference=0.0, sensor=0.0, external=0.0, turned=0.0, string_change=0.0)
FIELD_N = np.array([REFERENCE.horizontal, 0.0, REFERENCE.vertical])


def station(inclination, azimuth, toolface, bias=(0.0, 0.0, 0.0), noise=0.0, rng=None):
    mat_tn = mat_nt(inclination, azimuth, toolface).T
    off = np.array(bias) + (noise * rng.normal(size=3) if rng is not None else 0.0)
    return field_model.geometry(mat_tn @ [0.0, 0.0, -9.81], mat_tn @ FIELD_N + off, np.zeros((6, 6)), REFERENCE, 0.0)[0]


def read(evidence):
    return circle.read(evidence.azimuths, evidence.by_azimuth.sum(axis=1) / circle.widths(evidence.azimuths))


def learnt(model, one):
    """The evidence of a station, from which the run has learnt."""
    evidence = model.evidence(one)
    model.learn(one, evidence)
    return evidence


def ratio(evidence, azimuth):
    """Error of the azimuth over its sigma."""
    found = read(evidence)
    return abs(float(wrap_pi(found.mean - azimuth))) / found.sigma


@pytest.mark.parametrize(("inclination", "azimuth"), [(0.3, 1.0), (1.0, 4.0), (1.5, 0.3)])
def test_a_sound_tool_alone_has_the_sigma_of_the_linear_problem(inclination, azimuth):
    model = RunFilter(ALONE, SIGMAS)
    one = station(inclination, azimuth, 0.7)
    found = read(model.evidence(one))
    assert abs(wrap_pi(found.mean - azimuth)) < 0.05 * found.sigma
    assert found.sigma == pytest.approx(model.nominal_sigma(one, azimuth), rel=0.08)


def test_a_field_turned_about_the_vertical_is_too_improbable_to_widen_the_sigma_of_sound_stations():
    one = station(1.0, 2.0, 0.7)
    alone, turned = (RunFilter(dataclasses.replace(ALONE, turned=share), SIGMAS) for share in (0.0, 0.003))
    assert read(turned.evidence(one)).sigma == pytest.approx(read(alone.evidence(one)).sigma, rel=0.1)


def test_without_a_gyro_only_the_azimuths_of_the_field_are_resolved_finely():
    angles = RunFilter(Priors(), SIGMAS).evidence(station(1.0, 2.0, 0.7)).angles
    fine = angles[1:][np.diff(angles) < 0.9 * np.diff(circle.coarse())[0]]
    assert fine.size > 100
    assert (np.abs(fine - 2.0) < 0.25).all()


@pytest.mark.slow
def test_the_declination_is_never_averaged_away():
    model, rng = RunFilter(ALONE, SIGMAS), np.random.default_rng(1)
    least = SIGMAS.shared[Shared.DECLINATION]
    for k in range(25):
        evidence = learnt(model, station(0.2 + 0.05 * k, 0.4 + 0.03 * k, 1.3 * k, noise=2e-8, rng=rng))
    assert read(evidence).sigma > least
    _, covariance = model.shared()
    assert math.sqrt(covariance[Shared.DECLINATION, Shared.DECLINATION]) == pytest.approx(least, rel=0.02)


@pytest.mark.parametrize("has_field", [True, False])
def test_without_a_gyro_the_declination_changes_no_other_quantity_and_adds_its_variance(has_field):
    wide = dataclasses.replace(SIGMAS, shared=SIGMAS.shared.copy())
    wide.shared[Shared.DECLINATION] *= 20.0
    run = [station(0.3 + 0.2 * k, 0.4 + 0.2 * k, 1.3 * k, (5e-7, 0.0, 0.0)) for k in range(5)]
    run[2]["has_field"] = has_field
    live, revised = [], []
    for sigmas in (SIGMAS, wide):
        model, later = RunFilter(Priors(), sigmas), RunFilter(Priors(), sigmas)
        for one in run[:2]:
            learnt(model, one)
        for one in reversed(run[3:]):
            learnt(later, one)
        live.append(model.evidence(run[2]))
        revised.append(model.evidence(run[2], model.between(later)))
    for narrow, turned in (live, revised):
        np.testing.assert_allclose(turned.log, narrow.log, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(turned.by_kind, narrow.by_kind, rtol=1e-6, atol=1e-12)
        if has_field:
            added = (1.0 + SIGMAS.own[-1] ** 2) * (20.0**2 - 1.0) * SIGMAS.shared[Shared.DECLINATION] ** 2
            assert read(turned).sigma ** 2 - read(narrow).sigma ** 2 == pytest.approx(added, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("east_ut", [-1.2, 1.2])
def test_a_crust_that_shows_in_total_and_dip_leaves_the_declination_as_uncertain(east_ut):
    reference, rng = Reference(total=5.6e-5, dip=1.4, declination=0.0, gravity=9.81), np.random.default_rng(4)
    model = RunFilter(Priors(), field_model.nominal_sigmas(SensorErrors(), reference, False))
    field_n = np.array([reference.horizontal, east_ut * 1e-6, reference.vertical + 1.2e-6])
    for k in range(20):
        azimuth = 0.4 + 0.05 * k
        mat_tn = mat_nt(0.2 + 0.06 * k, azimuth, 1.3 * k).T
        b_t = mat_tn @ field_n + 2e-8 * rng.normal(size=3)
        one = field_model.geometry(mat_tn @ [0.0, 0.0, -9.81], b_t, np.zeros((6, 6)), reference, 0.0)[0]
        evidence = learnt(model, one)
    assert model.probabilities(evidence.by_kind)[Hypothesis.REFERENCE] > 0.9
    assert ratio(evidence, azimuth) < 3.0


@pytest.mark.parametrize("when", ["before", "here", "after"])
def test_a_gyro_that_says_nothing_leaves_the_declination_as_uncertain(when):
    reference = Reference(total=5.6e-5, dip=1.4, declination=0.0, gravity=9.81)
    sigmas = field_model.nominal_sigmas(SensorErrors(), reference, False)
    field_n = np.array([reference.horizontal, 0.0, reference.vertical + 1.2e-6])

    def of(gyro):
        models = RunFilter(Priors(), sigmas), RunFilter(Priors(), sigmas)
        for k, place in [*enumerate(["before"] * 8), *((k, "after") for k in range(15, 8, -1)), (8, "here")]:
            mat_tn = mat_nt(0.2 + 0.06 * k, 0.4 + 0.05 * k, 1.3 * k).T
            force = mat_tn @ [0.0, 0.0, -9.81]
            one = field_model.geometry(force, mat_tn @ field_n, np.zeros((6, 6)), reference, 0.0)[0]
            model = models[place == "after"]
            if gyro and place == when:
                model.expect_gyro()
                one = with_gyro(one, 0.4 + 0.05 * k, 0.1, 0.5)
            if place != "here":
                learnt(model, one)
        return read(models[0].evidence(one, models[0].between(models[1]))).sigma

    assert of(True) == pytest.approx(of(False), rel=0.05)


@pytest.mark.slow
def test_a_run_learns_the_string_s_field_and_errs_by_its_sigma():
    rng, errors, sigmas = np.random.default_rng(2), [], []
    for _ in range(20):
        model = RunFilter(ALONE, SIGMAS)
        bias = rng.normal(size=3) * SIGMAS.shared[:3] * 1e-6
        for k in range(12):
            learnt(model, station(0.2 + 0.1 * k, 0.5 + 0.05 * k, rng.uniform(0.0, math.tau), bias))
        mean, covariance = model.shared()
        errors.append(mean[:3] - bias * 1e6)
        sigmas.append(np.sqrt(np.diagonal(covariance))[:3])
    found = consistency([(np.array(errors), np.array(sigmas))], correlated=False, confidence=0.999)
    # Reference and scales are without error here, so that errors are smaller than their sigmas.
    assert found.nees <= found.high
    assert (np.mean(sigmas, axis=0) < 0.7 * SIGMAS.shared[:3]).all()


def test_the_hypothesis_that_was_drawn_leads_once_it_shows():
    model = RunFilter(Priors(), SIGMAS)
    for k in range(8):
        evidence = learnt(model, station(0.3 + 0.12 * k, 0.5 + 0.05 * k, 1.1 * k, (5e-6, 0.0, 0.0)))
    odds = model.probabilities(evidence.by_kind)
    assert sum(odds.values()) == pytest.approx(1.0)
    assert odds[Hypothesis.CLEAN] < 0.05
    beside = station(1.3, 0.9, 2.0, (5e-6, 4e-6, -3e-6))
    assert model.probabilities(model.evidence(beside).by_kind)[Hypothesis.EXTERNAL] > 0.9


# 1 sigma of the string's field along the axis, T, that a lateral to the east hides: its azimuth errs by degrees.
HIDDEN = 2e-6


def trip(gap_hours, rng):
    """Errors over sigma at the stations of a lateral to the east, a new string since the build, this long after it."""
    model, off, hours = RunFilter(Priors(), SIGMAS), [], 0.0
    for k in range(14):
        lateral = k >= 6
        hours += gap_hours if k == 6 else 0.5
        inclination, azimuth = (1.55, 1.57 + 0.01 * (k - 6)) if lateral else (0.1 + 0.12 * k, 0.3 + 0.2 * k)
        bias = (HIDDEN * (1.0 if lateral else 0.05), 0.0, 0.0)
        one = station(inclination, azimuth, rng.uniform(0.0, math.tau), bias, 1e-8, rng)
        model.pass_time(hours, hypotheses.hazard(model.priors, gap_hours) * lateral + 0.005 * k)
        evidence = learnt(model, one)
        if lateral:
            off.append(ratio(evidence, azimuth))
    return off


@pytest.mark.slow(2)
def test_a_string_that_changed_during_a_trip_is_not_taken_for_the_one_before():
    rng = np.random.default_rng(5)
    assert max(trip(30.0, rng)) < 3.0
    # The premise: had the string stayed for certain, the same readings would be taken for an azimuth far off.
    assert min(trip(0.5, rng)) > 3.0


def test_the_field_of_a_string_changes_little_in_an_hour_of_drilling_and_by_its_own_size_in_a_day():
    model, along, changed = RunFilter(Priors(), SIGMAS), Shared.FIELD_BIAS, []
    for k in range(49):
        model.pass_time(0.5 * k)
        share = model.state.covariance[:, along, along] / model.filters.variance[:, along] - 1.0
        np.testing.assert_allclose(share, share[0], atol=1e-9)
        changed.append(math.sqrt(share[0]))
    assert changed[0] == 0.0
    assert 0.06 < changed[2] < 0.1
    assert 0.9 < changed[-1] < 1.1


@pytest.mark.slow(2)
def test_remanence_that_grows_steadily_through_a_landing_stays_within_sigma():
    rng, model, off = np.random.default_rng(7), RunFilter(Priors(), SIGMAS), []
    for k in range(20):
        inclination, azimuth = min(0.5 + 0.08 * k, 1.55), 1.3 + 0.015 * k
        bias = (HIDDEN * min(max((k - 4) / 12.0, 0.0), 1.0), 0.0, 0.0)
        one = station(inclination, azimuth, rng.uniform(0.0, math.tau), bias, 1e-8, rng)
        model.pass_time(0.5 * k, 0.005 * k)
        off.append(ratio(learnt(model, one), azimuth))
    assert max(off) < 3.0


def test_the_string_is_known_to_be_another_the_less_the_longer_the_gap():
    priors = Priors()
    chances = [-math.expm1(-hypotheses.hazard(priors, hours)) for hours in (0.0, 1.0, 3.0, 8.0, 12.0, 30.0, 300.0)]
    assert chances == sorted(chances)
    assert chances[0] == pytest.approx(priors.string_change)
    assert chances[2] < 2.0 * priors.string_change
    assert chances[-1] == pytest.approx(0.5, abs=0.01)
    # A time that is not known is no gap.
    assert hypotheses.hazard(priors, math.nan) == hypotheses.hazard(priors, 0.0)


@pytest.mark.slow(2)
def test_a_new_string_leaves_what_is_known_of_the_sensors_and_the_reference():
    rng, model = np.random.default_rng(6), RunFilter(Priors(), SIGMAS)
    for k in range(8):
        learnt(model, station(0.2 + 0.12 * k, 0.4 + 0.5 * k, rng.uniform(0.0, math.tau), noise=1e-8, rng=rng))
    _, before = model.shared()
    model.pass_time(0.0, 1.0)
    model.pass_time(1e3, 30.0)
    # Measured without information: the change is joined with the filters.
    model.observe(np.zeros((1, field_model.SIZE)), np.zeros(1), np.eye(1))
    _, after = model.shared()
    string = [Shared.FIELD_BIAS + k for k in range(3)]
    assert (np.diag(after)[string] > 4.0 * np.diag(before)[string]).all()
    rest = list(range(Shared.FIELD_SCALE, Shared.OUTSIDE))
    np.testing.assert_allclose(np.diag(after)[rest], np.diag(before)[rest], rtol=0.05)


def with_gyro(one, azimuth, noise, lasting=0.0):
    one["gyro"], one["gyro_other"], one["gyro_lasting"], one["gyro_variance"] = azimuth, azimuth, lasting, noise**2
    return one


def test_a_gyro_is_weighed_by_its_variance_and_shows_the_declination():
    model = RunFilter(Priors(external=0.0, turned=0.0, gyro_step=0.0, gyro_outlier=0.0), SIGMAS)
    evidence = learnt(model, with_gyro(station(1.0, 2.0, 0.3), 2.0, 1e-3))
    assert read(evidence).sigma < 1.2e-3
    _, covariance = model.shared()
    assert math.sqrt(covariance[Shared.DECLINATION, Shared.DECLINATION]) < 0.95 * SIGMAS.shared[Shared.DECLINATION]


def test_a_gyro_far_from_a_field_in_order_leaves_both_azimuths_open():
    model = RunFilter(Priors(), SIGMAS)
    found = read(model.evidence(with_gyro(station(1.0, 2.0, 0.3), 2.3, 0.02)))
    azimuths = [found.mean, *(azimuth for azimuth, share in found.alternatives if share > 0.03)]
    assert sorted(azimuths) == pytest.approx([2.0, 2.3], abs=0.02)


def test_the_field_of_a_storm_is_correlated_over_three_hours():
    assert hypotheses.kept(3.0) == pytest.approx(math.exp(-1.0), rel=0.05)


def test_steel_at_one_station_is_as_likely_as_not_at_the_next():
    model = RunFilter(dataclasses.replace(ALONE, external=0.02), SIGMAS)
    beside = learnt(model, station(1.0, 2.0, 0.7, bias=(0.0, 8e-6, 0.0)))
    assert model.probabilities(beside.by_kind)[Hypothesis.EXTERNAL] > 0.99
    # A station without a magnetic reading shows what is expected there.
    following = station(1.0, 2.0, 0.7)
    following["has_field"] = False
    expected = model.probabilities(model.evidence(following).by_kind)[Hypothesis.EXTERNAL]
    assert expected == pytest.approx(0.5, abs=0.07)


def test_a_gyro_is_expected_to_fail_as_often_as_it_did_only_after_some_twenty_stations():
    model = RunFilter(dataclasses.replace(ALONE, gyro_adrift=0.0, gyro_fails=0.0), SIGMAS)
    for k in range(5):
        learnt(model, with_gyro(station(1.0, 2.0, 0.3 * k), 3.0 + 0.5 * k, 1e-3))
    # Five failures in five stations, against a prior worth twenty stations: 5 / 25, and not all of the next ones.
    assert model.gyro_shares(model.state)[2] == pytest.approx(0.2, abs=0.03)


def drawn(model, horizontal, rng):
    """A station of the model's own priors, its azimuth, where the field is so weak, uT."""
    reference = dataclasses.replace(REFERENCE, dip=math.acos(horizontal * 1e-6 / REFERENCE.total))
    mat_tn = mat_nt(rng.uniform(0.05, 1.9), azimuth := rng.uniform(0.0, math.tau), rng.uniform(0.0, math.tau)).T
    field_n = np.array([reference.horizontal, 0.0, reference.vertical])
    force, noise = mat_tn @ [0.0, 0.0, -9.81], np.diag([1e-6] * 3 + [1e-16] * 3)
    one = field_model.geometry(force, mat_tn @ field_n, noise, reference, 0.0)[0]
    kind = rng.choice(len(model.filters.weight), p=model.filters.weight)
    shared = rng.normal(size=field_model.SIZE) * np.sqrt(model.filters.variance[kind])
    shared[Shared.TOTAL : Shared.OUTSIDE] += SIGMAS.own * rng.normal(size=3)
    residual, slopes, turns = np.zeros(3), np.zeros((3, field_model.SIZE)), np.zeros((3, 3))
    field_model.predicted(azimuth, one, SIGMAS.shared, residual, slopes, turns)
    weight = external_weights(model.priors)
    outside = rng.choice(np.append(EXTERNAL_UT, 0.0), p=weight) * rng.normal(size=3)
    own = rng.multivariate_normal(np.zeros(3), one["noise"])
    one["field"] += slopes @ shared + turns @ rng.normal(0.0, 1e-3, 3) + own + outside
    return one, azimuth + SIGMAS.shared[Shared.DECLINATION] * shared[Shared.DECLINATION]


@pytest.mark.slow
def test_where_the_field_is_weak_stations_of_its_own_priors_lie_anywhere_in_the_posterior():
    # Simulation-based calibration (Talts et al., 2018): the share of probability that is denser than the truth.
    rng, shares = np.random.default_rng(9), []
    for _ in range(300):
        model = RunFilter(Priors(turned=0.0), SIGMAS)
        one, azimuth = drawn(model, rng.uniform(9.0, 15.0), rng)
        evidence = model.evidence(one)
        mass = evidence.by_azimuth.sum(axis=1)
        density = mass / circle.widths(evidence.azimuths)
        shares.append(float(mass[density > density[np.argmin(np.abs(wrap_pi(evidence.azimuths - azimuth)))]].sum()))
    assert kstest(shares, "uniform").pvalue > 0.01
    assert np.mean(np.array(shares) > 0.99) < 0.03


@pytest.mark.slow
def test_a_bias_of_a_gyro_that_steps_is_learnt_as_one_that_stays():
    model, step, off = RunFilter(Priors(), SIGMAS), 0.12, []
    for k in range(14):
        azimuth = 0.5 + 0.03 * k
        one = with_gyro(station(0.6 + 0.04 * k, azimuth, 0.9 * k), azimuth + step * (k > 5), 0.02, 0.007)
        off.append(ratio(learnt(model, one), azimuth))
    assert max(off) < 3.0
    mean, covariance = model.shared()
    assert mean[Shared.GYRO] * 0.007 == pytest.approx(step, abs=3.0 * 0.007 * math.sqrt(covariance[-1, -1]))
    assert mean[Shared.GYRO] * 0.007 > 0.08


@given(ages=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=4))
@settings(max_examples=20, deadline=None)
def test_the_error_of_a_gyro_adrift_depends_on_its_age_and_not_on_the_order_of_the_stations(ages):
    model, lasting = RunFilter(Priors(gyro_fails=0.0), SIGMAS), 0.01
    model.expect_gyro()
    for age in ages:
        model.pass_time(age, gyro=(age, lasting))
    adrift = model.filters.adrift
    expected = 1.0 + hypotheses.drifted(ages[-1]) / lasting**2
    np.testing.assert_allclose(model.state.covariance[adrift, Shared.GYRO, Shared.GYRO], expected, rtol=1e-9)
    np.testing.assert_allclose(model.state.covariance[~adrift, Shared.GYRO, Shared.GYRO], 1.0)


def test_of_two_azimuths_that_fit_a_gyro_the_field_takes_one():
    model = RunFilter(Priors(), SIGMAS)
    both = with_gyro(station(1.0, 2.0, 0.3), 2.01, 0.05)
    both["gyro_other"] = math.pi - 2.01
    found = read(model.evidence(both))
    assert abs(wrap_pi(found.mean - 2.0)) < 0.02
    assert found.alternatives == ()

"""Fusion: weights by covariance, angles wrapped, disagreement an alarm and never an average."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from north_signals import measured, motion, still
from numpy.testing import assert_allclose

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_estimation.survey import azimuth_fusion
from mwd_estimation.survey.azimuth_fusion import GYRO, Candidate
from mwd_sensors.core.constants import DEG_PER_HOUR
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

DEG = math.radians(1.0)
DIP = Reason(ReasonCode.DIP_OFF, 6.0 * DEG, 0.45 * DEG)
LOOSE = Reason(ReasonCode.CORRECTION_UNCERTAIN)
# S1 table 2 (field): dip of the gyro column, azimuth of the conventional and of the gyro tool, deg.
S1_FIELD = [(19.74, 136.63, 159.42), (20.81, 179.23, 161.53), (22.28, 185.60, 163.17)]


def candidate(method: str, azimuth_deg: float, sigma_deg: float, **more: object) -> Candidate:
    family = GYRO if method == "gyro" else azimuth_fusion.MAGNETIC
    return Candidate(method, azimuth_deg * DEG, sigma_deg * DEG, family, **more)


def test_independent_azimuths_are_weighed_by_the_inverse_of_their_variance() -> None:
    fused = azimuth_fusion.fuse([candidate("corrected", 10.0, 1.0), candidate("gyro", 11.0, 2.0)])
    assert fused.weights == pytest.approx((0.8, 0.2))
    assert fused.azimuth / DEG == pytest.approx(10.2)
    assert fused.sigma / DEG == pytest.approx(math.sqrt(0.8))
    assert fused.chi_square == pytest.approx(0.2)
    assert fused.method == "fused"
    assert not fused.alarm


def test_a_shared_declination_does_not_average_out() -> None:
    shared = {"declination": 0.5 * DEG}
    fused = azimuth_fusion.fuse([candidate(m, 40.0, 1.0, shared=shared) for m in ("corrected", "msa")])
    assert fused.sigma / DEG == pytest.approx(math.sqrt(0.25 + 0.75 / 2.0))


def test_two_methods_on_one_reading_are_one_opinion() -> None:
    raw, axial = azimuth_fusion.same_sensors([candidate("raw", 40.2, 0.8), candidate("corrected", 40.0, 1.3)])
    fused = azimuth_fusion.fuse([raw, axial])
    assert fused.weights == (1.0, 0.0)
    assert fused.sigma == pytest.approx(0.8 * DEG)
    assert fused.method == "raw"
    assert fused.reasons[1].code == ReasonCode.AZIMUTH_ADDS_NOTHING


@given(
    base=st.floats(0.0, 2.0 * math.pi),
    apart=st.floats(-1.0, 1.0),
    sigmas=st.tuples(st.floats(0.3, 5.0), st.floats(0.3, 5.0)),
)
def test_the_mean_lies_between_and_turns_with_its_azimuths(
    base: float, apart: float, sigmas: tuple[float, float]
) -> None:
    pair = [
        Candidate("corrected", base, sigmas[0] * DEG),
        Candidate("gyro", base + apart * DEG, sigmas[1] * DEG, GYRO),
    ]
    fused = azimuth_fusion.fuse(pair, azimuth_fusion.Settings(disagreement_sigmas=10.0))
    shift = float(wrap_pi(fused.azimuth - base)) / DEG
    assert min(0.0, apart) - 1e-9 <= shift <= max(0.0, apart) + 1e-9
    assert 0.0 <= fused.azimuth < 2.0 * math.pi
    assert sum(fused.weights) == pytest.approx(1.0)
    assert fused.sigma <= min(sigmas) * DEG * (1.0 + 1e-12)


def test_the_mean_of_359_and_1_is_north() -> None:
    fused = azimuth_fusion.fuse([candidate("corrected", 359.0, 1.0), candidate("gyro", 1.0, 1.0)])
    assert abs(wrap_pi(fused.azimuth)) < 1e-9


def test_least_variance_weights_match_the_formula_and_are_never_negative() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        root = rng.standard_normal((4, 4))
        V = root @ root.T + 0.1 * np.eye(4)
        w, variance = azimuth_fusion.least_variance(V)
        assert (w >= 0.0).all()
        assert w.sum() == pytest.approx(1.0)
        assert variance == pytest.approx(w @ V @ w)
        free = np.linalg.solve(V, np.ones(4))
        free /= free.sum()
        if (free >= 0.0).all():
            assert_allclose(w, free, atol=1e-9)
        for other in rng.dirichlet(np.ones(4), 50):
            assert variance <= other @ V @ other + 1e-12


def test_fused_errors_fit_the_fused_sigma() -> None:
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(400):
        declination = rng.standard_normal() * 0.3
        azimuths = [
            50.0 + declination + 0.4 * rng.standard_normal(),
            50.0 + declination + 0.9 * rng.standard_normal(),
            50.0 + 0.6 * rng.standard_normal(),
        ]
        shared = {"declination": 0.3 * DEG}
        fused = azimuth_fusion.fuse(
            [
                candidate("msa", azimuths[0], 0.5, shared=shared),
                candidate("corrected", azimuths[1], math.hypot(0.3, 0.9), shared=shared),
                candidate("gyro", azimuths[2], 0.6),
            ],
            azimuth_fusion.Settings(disagreement_sigmas=10.0),
        )
        errors.append(wrap_pi(fused.azimuth - 50.0 * DEG) / fused.sigma)
    # Chi-square, 400 degrees of freedom: 95 % band.
    assert 0.866 < np.mean(np.square(errors)) < 1.143


@pytest.mark.parametrize(("dip_deg", "magnetic_deg", "true_deg"), S1_FIELD)
def test_s1_field_case_follows_the_gyro_where_the_magnetic_tool_is_22_degrees_off(
    dip_deg: float, magnetic_deg: float, true_deg: float
) -> None:
    latitude_deg, noise = 44.0, 0.01
    clean = motion(123.5, latitude_deg * DEG, (90.0 - dip_deg) * DEG, true_deg * DEG, still, 50.0)
    rng = np.random.default_rng(round(100.0 * true_deg))
    gyro_t, accel_t = measured(
        clean, rng, noise, accel_noise_ug=30.0, bias=rng.standard_normal(3) * 0.01 * DEG_PER_HOUR
    )
    params = SeekParams(
        latitude_deg=latitude_deg,
        mode="still",
        gyro_noise_deg_rth=noise,
        gyro_x_noise_deg_rth=noise,
        gyro_bias_deg_h=0.01,
        gyro_x_bias_deg_h=0.01,
        scale_x_ppm=300.0,
    )
    state = north_seek.initial()
    north_seek.run(params, state, clean.stamp_ns, gyro_t, accel_t)
    north = north_seek.solution(params, state)
    assert north.success, north.reason
    fused = azimuth_fusion.fuse(
        [
            candidate("raw", magnetic_deg, 1.0, doubt=(Reason(ReasonCode.FIELD_OFF, 3100e-9, 300e-9),)),
            Candidate("gyro", north.azimuth, north.sigma, GYRO),
        ]
    )
    assert abs(wrap_pi(fused.azimuth - true_deg * DEG)) < 3.0 * fused.sigma
    assert fused.sigma < 0.5 * DEG
    assert abs(wrap_pi(fused.azimuth - true_deg * DEG)) < 1.0 * DEG
    assert fused.weights == (0.0, 1.0)
    assert fused.method == "gyro"
    assert "gyro is used" in joined(fused.alarm)
    assert "sigma) from gyro and its check failed: total field +3100 nT off" in joined(fused.alarm)


def test_where_no_check_failed_the_gyro_wins_over_external_interference_and_the_alarm_is_raised() -> None:
    fused = azimuth_fusion.fuse([candidate("corrected", 100.0, 0.5), candidate("gyro", 110.0, 1.0)])
    assert fused.azimuth / DEG == pytest.approx(110.0)
    assert fused.sigma / DEG == pytest.approx(1.0)
    assert "corrected azimuth is -10.0 deg (8.9 sigma) from gyro; gyro is used, because ext" in joined(fused.alarm)
    assert fused.reasons[:1] == fused.alarm


def test_a_gyro_off_by_little_more_than_chance_raises_the_alarm_and_leaves_what_a_whole_run_says() -> None:
    fused = azimuth_fusion.fuse([candidate("msa", 100.0, 0.1), candidate("gyro", 104.2, 1.26)])
    assert fused.method == "msa"
    assert fused.azimuth / DEG == pytest.approx(100.0)
    assert fused.sigma / DEG == pytest.approx(math.hypot(0.1, 4.2))
    assert "gyro azimuth is +4.2 deg (3.3 sigma) from multi-station" in joined(fused.alarm)
    assert azimuth_fusion.fuse([candidate("msa", 100.0, 0.1), candidate("gyro", 105.2, 1.26)]).method == "gyro"
    assert azimuth_fusion.fuse([candidate("raw", 100.0, 0.1), candidate("gyro", 104.2, 1.26)]).method == "gyro"


def test_between_equals_the_more_certain_wins_and_its_sigma_covers_the_difference() -> None:
    pair = [candidate("gyro", 100.0, 0.5), Candidate("gyro still", 110.0 * DEG, 1.0 * DEG, GYRO)]
    fused = azimuth_fusion.fuse(pair)
    assert fused.azimuth / DEG == pytest.approx(100.0)
    assert fused.sigma / DEG == pytest.approx(math.hypot(0.5, 10.0))
    assert "no check says which is wrong" in joined(fused.alarm)


def test_raw_gives_way_to_corrected_without_widening() -> None:
    fused = azimuth_fusion.fuse(
        [candidate("raw", 90.0, 0.3), candidate("corrected", 98.0, 0.6), candidate("gyro", 98.5, 1.0)]
    )
    assert fused.weights[0] == 0.0
    assert 98.0 < fused.azimuth / DEG < 98.5
    assert fused.sigma < 0.6 * DEG
    assert "removes more interference" in joined(fused.alarm)


def test_a_failed_check_that_agrees_is_left_out_without_an_alarm() -> None:
    fused = azimuth_fusion.fuse([candidate("corrected", 40.0, 0.5, doubt=(DIP,)), candidate("gyro", 40.4, 1.0)])
    assert fused.weights == (0.0, 1.0)
    assert not fused.alarm
    assert fused.reasons[0] == Reason(ReasonCode.CHECK_FAILED, causes=(DIP,))


def test_the_only_azimuth_is_given_with_an_alarm_when_its_check_failed() -> None:
    fused = azimuth_fusion.fuse([candidate("raw", 40.0, 0.5, doubt=(DIP,)), candidate("gyro", 0.0, 90.0)])
    assert fused.method == "raw"
    assert fused.alarm[0].causes == (DIP,)
    assert fused.reasons[1].code == ReasonCode.AZIMUTH_UNCERTAIN


def test_nothing_usable_gives_no_azimuth_and_says_why() -> None:
    fused = azimuth_fusion.fuse([candidate("corrected", 40.0, 0.5, refused=LOOSE)])
    assert math.isnan(fused.azimuth)
    assert fused.method == "none"
    assert fused.reasons == (LOOSE,)
    assert azimuth_fusion.fuse([]).method == "none"
    assert azimuth_fusion.fuse([candidate("raw", math.nan, math.nan)]).reasons == (Reason(ReasonCode.NO_AZIMUTH),)


def test_shared_terms_larger_than_sigma_are_an_error() -> None:
    with pytest.raises(ValueError, match="more than its sigma"):
        azimuth_fusion.fuse([candidate("raw", 1.0, 0.1, shared={"declination": 0.2 * DEG})])


def test_s1_field_scenario_from_raw_samples_to_the_fused_azimuth() -> None:
    path = SCENARIOS / "s1_field.yaml"
    sonde = Sonde(scenario.read(path))
    blocks = []
    for block in sonde.blocks(8.0):
        blocks.append(block)
        if len(blocks) == 38:
            break
    ahrs, mag, precision, truth = (
        np.concatenate([block[topic] for block in blocks])
        for topic in ("imu/data_raw", "imu/mag", "gyro/data_raw", "truth")
    )
    rates = north_seek.dual_unit(
        precision["stamp_ns"], precision["angular_velocity"], ahrs["stamp_ns"], ahrs["angular_velocity"], 300.0 * DEG
    )
    # The figures of the grade tactical_north, with what the scenario's tumble leaves of the g-sensitivity.
    params = SeekParams(
        latitude_deg=43.8,
        gravity=sonde.reference.gravity,
        gyro_noise_deg_rth=0.05,
        gyro_x_noise_deg_rth=0.05,
        gyro_bias_deg_h=5.0,
        gyro_x_bias_deg_h=5.0,
        scale_x_ppm=300.0,
        leak_urad=300.0,
        lead_sigma_ms=3.0,
        g_sensitivity_deg_h_g=0.05,
        accel_bias_ug=300.0,
        gyro_walk_deg_h_rth=0.1,
    )
    state = north_seek.initial()
    north_seek.run(params, state, precision["stamp_ns"], rates, precision["linear_acceleration"])
    north = north_seek.solution(params, state)
    assert north.success, north.reason
    assert north.method == "two_position"
    at_rest = slice(500, 5000)
    read = magnetic_geometry.raw_azimuth(
        ahrs["linear_acceleration"][at_rest].mean(axis=0), mag["magnetic_field"][at_rest].mean(axis=0)
    )
    disturbed = Candidate("raw", float(read) + sonde.reference.declination, 1.0 * DEG)
    azimuth = float(truth["azimuth"][-1])
    assert abs(wrap_pi(disturbed.azimuth - azimuth)) > 20.0 * DEG
    fused = azimuth_fusion.fuse([disturbed, Candidate("gyro", north.azimuth, north.sigma, GYRO)])
    assert fused.method == "gyro"
    assert fused.alarm[0].code == ReasonCode.DISAGREES_EXTERNAL_INTERFERENCE
    error = abs(float(wrap_pi(fused.azimuth - azimuth)))
    assert error < 2.0 * DEG
    assert error < 2.5 * fused.sigma
    assert fused.sigma < 1.1 * DEG

# SPDX-License-Identifier: Apache-2.0
"""Multi-station analysis on drawn runs: accuracy, honest sigma, slopes, refusals where nothing can be seen."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_surface.surveys import multi_station_analysis
from mwd_surface.surveys.multi_station_analysis import StationsProblem, analyse, corrected

DEG = math.pi / 180.0
TOTAL, DIP, GRAVITY = 50e-6, 71.3 * DEG, 9.81
QUIET = {
    "vary": 0.15,
    "bias": 25e-9,
    "scale": 0.0003,
    "f_bias": 0.001,
    "f_scale": 0.0001,
    "sigma_total": 40e-9,
    "sigma_dip": 0.05 * DEG,
    "noise": 15e-9,
    "f_noise": 0.0015,
}


def drawn_run(
    kind,
    seed,
    n=40,
    noise=20e-9,
    f_noise=0.002,
    bias=70e-9,
    scale=0.0016,
    f_bias=0.004,
    f_scale=0.0005,
    sigma_total=143e-9,
    sigma_dip=0.218 * DEG,
    vary=1.0,
    axial=None,
):
    """A build to near horizontal with 650 nT axial, or an east-west horizontal with 900 nT, errors drawn."""
    rng, k = np.random.default_rng(seed), np.arange(n)
    if kind == "build":
        inc, azi, axial = (
            np.linspace(5, 85, n) * DEG,
            (70 + 3 * np.sin(k / 5)) * DEG,
            650e-9 if axial is None else axial,
        )
    else:
        inc, azi, axial = (90 + 1.5 * np.sin(k / 4)) * DEG, (90 + 4 * np.sin(k / 7)) * DEG, 900e-9
    mat_tn = np.swapaxes(mat_nt(inc, azi, rng.uniform(0, 2 * np.pi, n)), 1, 2)
    total, dip = TOTAL + rng.normal(0, 60e-9 * vary, n), DIP + rng.normal(0, 0.08 * DEG * vary, n)
    b_n = np.stack([total * np.cos(dip), 0 * dip, total * np.sin(dip)], axis=1)
    b_t, f_t = np.einsum("nij,nj->ni", mat_tn, b_n), mat_tn @ np.array([0, 0, -GRAVITY])
    biases, scales = rng.normal(0, bias, 3) + np.array([axial, 0, 0]), rng.normal(0, scale, 3)
    b_t = b_t * (1 + scales) + biases + rng.normal(0, noise, (n, 3))
    f_t = f_t * (1 + rng.normal(0, f_scale, 3)) + rng.normal(0, f_bias, 3) + rng.normal(0, f_noise, (n, 3))
    reference = Reference(
        TOTAL + rng.normal(0, sigma_total),
        DIP + rng.normal(0, sigma_dip),
        gravity=GRAVITY + rng.normal(0, 3e-4),
        sigma_total=sigma_total,
        sigma_dip=sigma_dip,
    )
    return f_t, b_t, reference, inc, azi, biases, scales


def rms_deg(values):
    return float(np.degrees(np.sqrt(np.mean(np.square(values)))))


@pytest.mark.parametrize(("kind", "raw", "to_beat"), [("build", 1.5, 0.089), ("east-west", 3.2, 0.290)])
def test_the_azimuth_beats_the_figures_of_the_tool_compared_with(kind, raw, to_beat):
    errors, before = [], []
    for seed in range(25):
        f_t, b_t, reference, _, azi, _, _ = drawn_run(kind, seed, **QUIET)
        done = analyse(f_t, b_t, reference)
        assert done.refused is None
        errors.append(wrap_pi(done.azimuth - azi))
        before.append(wrap_pi(done.azimuth_raw - azi))
    assert rms_deg(before) == pytest.approx(raw, abs=0.15)
    assert rms_deg(errors) < to_beat


@pytest.mark.parametrize("kind", ["build", "east-west"])
def test_azimuth_inclination_and_every_estimated_error_err_by_their_sigma(kind):
    azimuth, inclination, estimates, chi = [], [], [], []
    for seed in range(40):
        f_t, b_t, reference, inc, azi, biases, scales = drawn_run(kind, seed, bias=math.hypot(70e-9, 150e-9))
        done = analyse(f_t, b_t, reference)
        azimuth.append(np.mean((wrap_pi(done.azimuth - azi) / done.sigma_azimuth) ** 2))
        inclination.append(np.mean(((done.inclination - inc) / done.sigma_inclination) ** 2))
        estimates.append((done.estimate[:6] - np.r_[biases, scales]) / done.sigma[:6])
        chi.append(done.chi_square / done.degrees)
    # Stations of one run err together: 40 runs are about 40 degrees of freedom, 95 % band 1 -+ 0.44.
    assert 0.6 < np.mean(azimuth) < 1.48
    assert 0.6 < np.mean(inclination) < 1.48
    spread = np.mean(np.square(estimates), axis=0)
    # The axial prior is 2000 nT, so its error is all posterior; scales hardly observed keep their prior.
    assert (spread[:3] > 0.5).all()
    assert (spread < 1.6).all()
    assert np.mean(chi) == pytest.approx(1.0, abs=0.06)


def test_interference_is_found_with_its_sigma_and_the_readings_corrected():
    f_t, b_t, reference, _, _, biases, _ = drawn_run("build", 3, axial=2e-6)
    done = analyse(f_t, b_t, reference)
    assert abs(done.estimate[0] - biases[0]) < 3 * done.sigma[0]
    assert done.sigma[0] < 200e-9
    assert done.observable[:3].all()
    _, b_c = corrected(f_t, b_t, done.estimate)
    assert np.std(np.linalg.norm(b_c, axis=1)) < np.std(np.linalg.norm(b_t, axis=1))


def test_slope_of_the_residuals_agrees_with_finite_differences():
    f_t, b_t, reference, *_ = drawn_run("build", 1, n=6)
    problem = StationsProblem(f_t, b_t, reference, SensorErrors())
    used = np.ones(6, dtype=bool)
    x = np.random.default_rng(2).normal(0, 1, 15)
    slope = problem.slope(x, used)
    for k in range(15):
        change = np.zeros(15)
        change[k] = 1e-4
        numeric = (problem.residual(x + change, used) - problem.residual(x - change, used)) / 2e-4
        assert slope[:, k] == pytest.approx(numeric, rel=1e-5, abs=1e-6), k


def hidden_string():
    """Twelve stations beside magnetic east, horizontal, toolface fixed: nothing moves, the string does not show."""
    mat_tn = mat_nt(89 * DEG, 90 * DEG, 1.0).T
    reference = Reference(TOTAL, DIP, gravity=GRAVITY)
    b_t = np.tile(mat_tn @ np.array([reference.horizontal, 0, reference.vertical]) + [9e-7, 0, 0], (12, 1))
    return np.tile(mat_tn @ np.array([0, 0, -GRAVITY]), (12, 1)), b_t, reference


def test_what_the_attitudes_do_not_show_is_named_and_keeps_its_prior():
    done = analyse(*hidden_string())
    assert not done.observable[0]
    assert done.sigma[0] == pytest.approx(done.prior[0], rel=0.1)
    assert "gyro" in text(done.refused)
    assert (done.sigma_azimuth > 5 * DEG).all()


def test_a_string_that_does_not_show_is_as_strong_as_the_tool_states():
    usual, weaker = analyse(*hidden_string()), analyse(*hidden_string(), SensorErrors(axial_interference_nt=22.0))
    bias = SensorErrors.magnetometer_bias_nt * 1e-9
    assert usual.prior[0] == pytest.approx(math.hypot(bias, 2000e-9))
    assert weaker.prior[0] == pytest.approx(math.hypot(bias, 200e-9))
    assert (weaker.sigma_azimuth < 0.2 * usual.sigma_azimuth).all()


def test_a_station_beside_casing_is_left_out_and_reported():
    f_t, b_t, reference, _, azi, _, _ = drawn_run("build", 4, **QUIET)
    b_t[7] += [0.5e-6, -2e-6, 1.5e-6]
    done = analyse(f_t, b_t, reference)
    assert not done.used[7]
    assert done.used.sum() == 39
    good = done.used
    assert rms_deg(wrap_pi(done.azimuth - azi)[good]) < 0.15
    assert done.refused is None


def test_a_disturbance_that_changes_along_the_run_is_refused():
    f_t, b_t, reference, *_ = drawn_run("build", 5, **QUIET)
    b_t[20:, 1] += np.linspace(0, 6e-6, 20)
    done = analyse(f_t, b_t, reference)
    assert "do not fit one set of errors" in text(done.refused)


def test_a_wrong_reference_beyond_its_sigma_is_refused_by_chi_square(monkeypatch):
    f_t, b_t, reference, *_ = drawn_run("build", 6, **QUIET)
    wrong = replace(reference, dip=reference.dip - 2 * DEG)
    monkeypatch.setattr(multi_station_analysis, "_OUTLIER_SIGMA", 100.0)
    done = analyse(f_t, b_t, wrong)
    assert "chi-square" in text(done.refused)


def test_few_stations_still_give_a_sigma_and_no_false_confidence():
    f_t, b_t, reference, _, azi, _, _ = drawn_run("build", 7, n=3)
    done = analyse(f_t, b_t, reference)
    assert (np.abs(wrap_pi(done.azimuth - azi)) < 4 * done.sigma_azimuth).all()


def test_a_vertical_station_among_others_gives_finite_sigmas():
    f_t, b_t, reference, *_ = drawn_run("build", 9, n=10)
    f_t[0] = [-GRAVITY, 0.0, 0.0]
    done = analyse(f_t, b_t, reference)
    assert np.isfinite(done.sigma_azimuth).all()
    assert done.sigma_azimuth[0] > 10 * DEG


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f, b, r: (f[:1], b[:1], r), "two stations"),
        (lambda f, b, r: (f[:, :2], b, r), "same shape"),
        (lambda f, b, r: (np.where(f > 9, np.nan, f), np.full_like(b, np.nan), r), "finite"),
        (lambda f, b, _: (f, b, Reference()), "strength and dip"),
    ],
)
def test_input_that_cannot_be_analysed_is_refused(spoil, words):
    f_t, b_t, reference, *_ = drawn_run("build", 8, n=4)
    with pytest.raises(ValueError, match=words):
        analyse(*spoil(f_t, b_t, reference))

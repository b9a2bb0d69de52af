"""A survey station: angles, norths, choice of azimuth, covariance against drawn errors, verdicts for broken sensors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import floats, lists, sampled_from

from mwd_estimation.assembly.sag import SagCorrection
from mwd_estimation.core.error_model import BENCH, SensorErrors
from mwd_estimation.core.reason_text import text, texts
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.acceptance import QualitySettings
from mwd_estimation.survey.station import StationSettings, station
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.pi / 180.0
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "test")


def readings(inc, azi_magnetic, toolface, axial=0.0, reference=REFERENCE):
    mat_tn = mat_nt(inc * DEG, azi_magnetic * DEG, toolface * DEG).T
    b_t = mat_tn @ np.array([reference.horizontal, 0.0, reference.vertical]) + np.array([axial, 0.0, 0.0])
    return mat_tn @ np.array([0.0, 0.0, -9.81]), b_t


def test_angles_totals_and_a_grid_azimuth_come_out_of_clean_readings():
    shot = station(*readings(35, 120, 40), REFERENCE)
    got = [shot.inclination, shot.azimuth, shot.gravity_toolface, shot.dip]
    assert np.degrees(got) == pytest.approx([35, 122, 40, 72], abs=1e-6)
    assert (shot.north, shot.method, shot.verdict, shot.corrected) == ("grid", "raw", "accept", False)
    assert shot.g_total == pytest.approx(9.81)
    assert shot.b_total == pytest.approx(50e-6)
    assert text(shot.reasons[0]).startswith("within limits")


@pytest.mark.parametrize(("north", "azimuth"), [("magnetic", 120.0), ("true", 123.0), ("grid", 122.0), ("best", 122.0)])
def test_the_north_asked_for_is_the_north_given(north, azimuth):
    shot = station(*readings(35, 120, 40), REFERENCE, StationSettings(north=north))
    assert math.degrees(shot.azimuth) == pytest.approx(azimuth)
    assert shot.north == ("grid" if north == "best" else north)


def test_axial_interference_is_corrected_when_there_is_some_and_reported_with_its_sigma():
    shot = station(*readings(60, 100, 40, 2e-6), REFERENCE)
    assert shot.method == "corrected"
    assert shot.corrected
    assert shot.verdict == "accept"
    assert math.degrees(shot.azimuth) == pytest.approx(102.0, abs=0.01)
    assert shot.interference == pytest.approx(2e-6, abs=2e-9)
    assert any("axial interference +2000 +-" in reason for reason in texts(shot.reasons))
    raw, corrected = shot.by_method("raw"), shot.by_method("corrected")
    assert abs(math.degrees(raw.azimuth) - 102.0) > 2.0
    assert math.degrees(corrected.azimuth) == pytest.approx(102.0, abs=0.01)
    # Totals are given as measured.
    assert abs(shot.b_total - 50e-6) > 100e-9
    assert shot.by_method("gyro") is None


def test_interference_that_geometry_hides_is_refused_with_the_reason_and_not_corrected():
    shot = station(*readings(89, 90, 40, 3e-6), REFERENCE, StationSettings(azimuth_method="corrected"))
    assert shot.method == "raw"
    assert shot.verdict in ("doubtful", "reject")
    assert "east-west" in text(shot.by_method("corrected").refused)
    assert any("not corrected" in reason for reason in texts(shot.reasons))


def test_without_reference_the_azimuth_is_labelled_magnetic_and_uncorrected():
    shot = station(*readings(35, 120, 40, 2e-6))
    assert (shot.north, shot.method, shot.corrected, shot.verdict) == ("magnetic", "raw", False, "doubtful")
    assert "no reference field: magnetic azimuth, uncorrected" in text(shot.reasons[0])
    assert math.isnan(shot.interference)


def test_asking_for_true_north_without_declination_gives_magnetic_and_says_so():
    shot = station(*readings(35, 120, 40), replace(REFERENCE, declination=None), StationSettings(north="true"))
    assert shot.north == "magnetic"
    assert shot.verdict == "doubtful"
    assert "true azimuth needs the declination" in text(shot.reasons[0])


def test_magnetic_toolface_near_vertical_is_the_heading_of_the_scribe_line():
    shot = station(*readings(0.3, 200, 25), REFERENCE)
    assert math.degrees(shot.magnetic_toolface) == pytest.approx((202 + 25) % 360, abs=0.3)
    assert any("magnetic toolface" in reason for reason in texts(shot.reasons))


def test_covariance_of_the_angles_matches_drawn_errors_for_both_azimuths():
    errors = replace(BENCH, axial_interference_nt=0.0)
    for method, axial in (("raw", 0.0), ("corrected", 2e-6)):
        settings = StationSettings(azimuth_method=method, errors=errors)
        f_t, b_t = readings(50, 70, 130, axial)
        cov = station(f_t, b_t, REFERENCE, settings).covariance
        rng, offs = np.random.default_rng(4), []
        for _ in range(200):
            f = f_t + rng.normal(0, 0.004, 3) + rng.normal(0, 0.0005, 3) * f_t
            b = b_t + rng.normal(0, 70e-9, 3) + rng.normal(0, 0.0016, 3) * b_t
            drawn = replace(
                REFERENCE,
                total=50e-6 + rng.normal(0, REFERENCE.sigma_total),
                dip=72 * DEG + rng.normal(0, REFERENCE.sigma_dip),
                declination=3 * DEG + rng.normal(0, math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal))),
            )
            shot = station(f, b, drawn, settings)
            truth = np.radians([50, 72, 130])
            offs.append(wrap_pi(np.array([shot.inclination, shot.azimuth, shot.gravity_toolface]) - truth))
        nees = np.mean([off @ np.linalg.solve(cov, off) for off in offs]) / 3.0
        # 600 degrees of freedom: 95 % band 1 +- 0.113.
        assert nees == pytest.approx(1.0, abs=0.12), method


@pytest.mark.parametrize(
    ("inc", "azi", "axial_nt", "expected_nt"),
    [
        (3, 40, 220, 220),
        (30, 90, 220, 220),
        (60, 90, 220, 220),
        (88, 30, 220, 220),
        (60, 20, 1500, 220),
        (30, 200, 1500, 220),
        # Unannounced, and not seen at a glance.
        (30, 90, 500, 220),
        (45, 70, 1500, 220),
        (60, 90, 500, 220),
        (60, 90, 1500, 220),
        (88, 30, 1500, 220),
        (75, 60, 3000, 220),
        # Hidden: doubtful, and with the sigma of what could be there.
        (88, 90, 900, 220),
        (30, 90, 1500, 1500),
        (60, 90, 1500, 1500),
        (88, 90, 1500, 1500),
    ],
)
def test_the_azimuth_chosen_errs_by_its_sigma_with_interference_drawn(inc, azi, axial_nt, expected_nt):
    settings = StationSettings(errors=replace(BENCH, axial_interference_nt=float(expected_nt)))
    rng, score = np.random.default_rng(inc + azi), []
    sigma_declination = math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal))
    for _ in range(150):
        f_t, b_t = readings(inc, azi, rng.uniform(0, 360), rng.normal(0, axial_nt * 1e-9))
        drawn = replace(
            REFERENCE,
            total=50e-6 + rng.normal(0, REFERENCE.sigma_total),
            dip=72 * DEG + rng.normal(0, REFERENCE.sigma_dip),
            declination=3 * DEG + rng.normal(0, sigma_declination),
        )
        f_t = f_t * (1 + rng.normal(0, 0.0005, 3)) + rng.normal(0, 0.004, 3)
        b_t = b_t * (1 + rng.normal(0, 0.0016, 3)) + rng.normal(0, 70e-9, 3)
        shot = station(f_t, b_t, drawn, settings)
        score.append((wrap_pi(shot.azimuth - (azi + 2) * DEG) / shot.sigma_azimuth) ** 2)
    # 150 degrees of freedom: 95 % band 1 -+ 0.23, 99.5 % 1 -+ 0.33.
    assert np.mean(score) == pytest.approx(1.0, abs=0.33)


def test_interference_beyond_the_expected_that_shows_widens_the_sigma_of_the_raw_azimuth():
    raw = [station(*readings(60, 90, 40, e), REFERENCE).by_method("raw").sigma for e in (0.0, 3e-6)]
    assert raw[1] > 3 * raw[0]


def test_the_correction_is_taken_unasked_where_a_short_collar_is_expected():
    short = StationSettings(errors=SensorErrors(axial_interference_nt=1500.0))
    f_t, b_t = readings(60, 90, 40)
    assert station(f_t, b_t, REFERENCE, short).method == "corrected"
    assert station(f_t, b_t, REFERENCE).method == "raw"
    assert station(*readings(89, 90, 40), REFERENCE, short).method == "raw"


@pytest.mark.parametrize(("inc", "azi"), [(75, 90), (88, 75), (89, 90), (90, 268)])
def test_an_attitude_that_hides_interference_makes_the_azimuth_doubtful(inc, azi):
    for axial in (0.0, 1.5e-6):
        shot = station(*readings(inc, azi, 40, axial), REFERENCE)
        assert shot.verdict != "accept"
        (doubt,) = shot.azimuth_doubts
        assert doubt in shot.reasons
        assert "can hardly be seen in this attitude, 1000 nT of it turn the azimuth by" in text(doubt)
        assert shot.sigma_azimuth > 1.5 * DEG
    # Who counts on as much, knows what he has.
    settings = StationSettings(errors=SensorErrors(axial_interference_nt=3000.0))
    shot = station(*readings(inc, azi, 40), REFERENCE, settings)
    assert shot.azimuth_doubts == ()
    assert shot.sigma_azimuth > 8.0 * DEG or shot.corrected


@pytest.mark.parametrize("axial", [-40e-6, 20e-6, 40e-6])
@pytest.mark.parametrize(("inc", "azi"), [(85, 88), (89, 90), (90, 272)])
def test_a_strongly_magnetised_string_east_west_is_corrected_as_well_as_it_can_be_and_doubtful(inc, azi, axial):
    shot = station(*readings(inc, azi, 40, axial), REFERENCE)
    assert shot.method == "corrected"
    assert shot.verdict == "doubtful"
    assert abs(wrap_pi(shot.azimuth - (azi + 2) * DEG)) < 1.5 * shot.sigma_azimuth
    assert shot.sigma_azimuth > 3.0 * DEG
    assert text(shot.azimuth_doubts[0]).startswith("axial interference")
    assert "corrected as well as it can be" in text(shot.azimuth_doubts[0])
    assert set(shot.azimuth_doubts) <= set(shot.reasons)


def test_who_trusts_his_collar_gets_the_sigma_of_the_tool_code_and_no_doubt():
    shot = station(*readings(88, 90, 40), REFERENCE, StationSettings(plausible_interference_nt=220.0))
    assert shot.verdict == "accept"
    # MWD+SRGM at 88 deg due east: 1.01 deg.
    assert math.degrees(shot.sigma_azimuth) == pytest.approx(1.01, abs=0.05)


@pytest.mark.parametrize(("inc", "azi"), [(30, 90), (45, 70), (60, 90), (75, 60), (88, 30)])
def test_an_attitude_that_shows_interference_raises_no_doubt(inc, azi):
    shot = station(*readings(inc, azi, 40), REFERENCE)
    assert shot.verdict == "accept"
    assert shot.azimuth_doubts == ()


def test_noise_of_the_averages_adds_to_the_sigmas():
    f_t, b_t = readings(50, 70, 130)
    noisy = station(f_t, b_t, REFERENCE, covariance_f=np.eye(3) * 0.02**2, covariance_b=np.eye(3) * 300e-9**2)
    clean = station(f_t, b_t, REFERENCE)
    assert noisy.sigma_inclination > clean.sigma_inclination
    assert noisy.sigma_azimuth > clean.sigma_azimuth
    assert noisy.sigma_toolface > clean.sigma_toolface


def test_known_sag_misalignment_and_toolface_offset_are_taken_off():
    f_t, b_t = readings(60, 100, 0)
    settings = StationSettings(sag=SagCorrection(math.radians(0.2)), toolface_offset_deg=29.0, misalignment_y_deg=0.0)
    shot = station(f_t, b_t, REFERENCE, settings)
    assert math.degrees(shot.inclination) == pytest.approx(60 + 0.2 * math.sin(60 * DEG))
    assert "inclination corrected for sag by +0.17 deg" in texts(shot.reasons)
    assert math.degrees(shot.gravity_toolface) == pytest.approx(29.0)
    # Scribe line on the high side: the hole axis bent half a degree away from +z is lower, bent to +y turns right or
    # left.
    bent = station(f_t, b_t, REFERENCE, StationSettings(misalignment_y_deg=0.5))
    assert abs(math.degrees(bent.inclination) - 60) == pytest.approx(0.5, abs=1e-3)
    turned = station(f_t, b_t, REFERENCE, StationSettings(misalignment_z_deg=0.5))
    assert abs(math.degrees(turned.azimuth) - 102) == pytest.approx(0.5 / math.sin(60 * DEG), abs=1e-2)
    assert math.degrees(turned.inclination) == pytest.approx(60, abs=0.01)


def test_misalignment_settings_say_where_the_hole_axis_lies_in_tool_axes():
    hole = mat_nt(60 * DEG, 100 * DEG, 40 * DEG)
    for name, axis in (("misalignment_y_deg", [0, 1, 0]), ("misalignment_z_deg", [0, 0, 1])):
        from mwd_sensors.core.frames import mat_from_quat, quat_from_rotvec

        mat_th = mat_from_quat(quat_from_rotvec(np.array(axis) * 1.5 * DEG))
        f_t = mat_th @ hole.T @ np.array([0, 0, -9.81])
        b_t = mat_th @ hole.T @ np.array([REFERENCE.horizontal, 0, REFERENCE.vertical])
        shot = station(f_t, b_t, REFERENCE, StationSettings(**{name: 1.5}))
        assert np.degrees([shot.inclination, shot.azimuth, shot.gravity_toolface]) == pytest.approx([60, 102, 40])


@pytest.mark.parametrize("limits", ["service", "iscwsa", "toolcode"])
def test_a_casing_beside_the_tool_is_rejected_under_every_set_of_limits(limits):
    f_t, b_t = readings(30, 100, 40)
    casing = np.array([0.0, 2.5e-6, -2e-6])
    shot = station(f_t, b_t + casing, REFERENCE, StationSettings(quality=QualitySettings(limits=limits)))
    assert shot.verdict == "reject"
    assert not shot.corrected


def test_broken_sensors_are_named_and_what_is_left_is_given():
    f_t, b_t = readings(30, 100, 40)
    dead = station(f_t, np.full(3, np.nan), REFERENCE)
    assert dead.verdict == "reject"
    assert math.degrees(dead.inclination) == pytest.approx(30)
    assert dead.sigma_azimuth == pytest.approx(math.pi)
    assert "no magnetometer" in text(dead.reasons[0])
    blind = station(np.full(3, np.nan), b_t, REFERENCE)
    assert (blind.verdict, math.isnan(blind.inclination)) == ("reject", True)
    flipped = station(-f_t, b_t, REFERENCE)
    assert any("flipped sign" in reason for reason in texts(flipped.reasons))
    in_g = station(f_t / 9.81, b_t, REFERENCE)
    assert any("a reading in g?" in reason for reason in texts(in_g.reasons))
    in_nt = station(f_t, b_t * 1e9)
    assert any("a reading in nT?" in reason for reason in texts(in_nt.reasons))
    assert {flipped.verdict, in_g.verdict, in_nt.verdict} == {"reject"}


def test_a_fault_of_the_readings_rejects_the_station():
    f_t, b_t = readings(30, 100, 40)
    shot = station(f_t, b_t, REFERENCE, faults=(Reason(ReasonCode.TOOL_NOT_STILL),))
    assert shot.verdict == "reject"
    assert Reason(ReasonCode.TOOL_NOT_STILL) in shot.reasons


def test_a_weak_horizontal_field_asks_for_a_gyro():
    polar = Reference(57e-6, 86 * DEG, 0.0, 0.0, 9.83, "test")
    shot = station(*readings(30, 100, 40, reference=polar), polar)
    assert shot.verdict in ("doubtful", "reject")
    assert any("take a gyro" in reason for reason in texts(shot.reasons))


def test_an_exactly_vertical_hole_keeps_finite_sigmas():
    shot = station([-9.81, 0.0, 0.0], [48e-6, 15e-6, 1e-6], REFERENCE)
    assert shot.inclination == 0.0
    assert np.isfinite(shot.covariance).all()
    assert shot.sigma_azimuth == pytest.approx(math.pi)
    assert shot.sigma_inclination > 0.02 * DEG


def test_a_field_along_gravity_gives_no_azimuth_and_says_so():
    shot = station([-9.81 * 0.6, 0.0, 9.81 * 0.8], [30e-6, 0.0, -40e-6], REFERENCE)
    assert math.isnan(shot.azimuth)
    assert shot.sigma_azimuth == pytest.approx(math.pi)
    assert "no horizontal field" in text(shot.reasons[-1])


READING = floats(-1e6, 1e6) | floats(-20.0, 20.0) | floats(-1e-4, 1e-4) | sampled_from([0.0, math.nan, math.inf])


@settings(max_examples=200, deadline=None)
@given(lists(READING, min_size=6, max_size=6), sampled_from([None, REFERENCE]))
def test_no_reading_however_broken_raises_or_is_accepted_without_cause(axes, reference):
    shot = station(axes[:3], axes[3:], reference)
    assert shot.verdict == "reject" or abs(shot.g_total - 9.81) < 1.0
    assert shot.reasons
    if math.isfinite(shot.inclination):
        assert np.isfinite(shot.covariance).all()
        assert np.linalg.eigvalsh(shot.covariance).min() > -1e-9


def test_totals_deviate_by_their_covariance_when_errors_are_drawn():
    rng, chi = np.random.default_rng(8), []
    for _ in range(800):
        f_t, b_t = readings(50, 70, rng.uniform(0, 360), rng.normal(0, 220e-9))
        drawn = replace(
            REFERENCE,
            total=50e-6 + rng.normal(0, REFERENCE.sigma_total),
            dip=72 * DEG + rng.normal(0, REFERENCE.sigma_dip),
            gravity=9.81 + rng.normal(0, REFERENCE.sigma_gravity),
        )
        f_t = f_t * (1 + rng.normal(0, 0.0005, 3)) + rng.normal(0, 0.004, 3)
        b_t = b_t * (1 + rng.normal(0, 0.0016, 3)) + rng.normal(0, 70e-9, 3)
        off = station(f_t, b_t, drawn, StationSettings(azimuth_method="raw")).deviations
        values = np.array([off.gravity, off.field, off.dip])
        chi.append(values @ np.linalg.solve(off.covariance, values))
    # 2400 degrees of freedom: 95 % band 3 -+ 0.17.
    assert np.mean(chi) == pytest.approx(3.0, abs=0.25)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="f_t: expected three axes"):
        station([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="covariance_b: expected shape"):
        station([0, 0, 9.8], [1e-5, 0, 4e-5], covariance_b=np.ones(3))


def test_better_sensors_give_smaller_sigmas():
    f_t, b_t = readings(50, 70, 130)
    good = StationSettings(errors=SensorErrors(magnetometer_bias_nt=10.0, axial_interference_nt=10.0))
    assert station(f_t, b_t, REFERENCE, good).sigma_azimuth < station(f_t, b_t, REFERENCE).sigma_azimuth


def test_without_a_magnetometer_true_north_needs_no_declination():
    settings = StationSettings(north="true")
    assert station([-6.0, 1.0, 7.7], [math.nan] * 3, None, settings).north == "true"
    assert station([-6.0, 1.0, 7.7], [2e-5, 1e-5, 4e-5], None, settings).north == "magnetic"

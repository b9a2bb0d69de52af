# SPDX-License-Identifier: Apache-2.0
"""A survey station: angles, norths, azimuth and sigma against drawn errors, verdicts of each quantity."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bench_errors import BENCH
from hypothesis import given, settings
from hypothesis.strategies import floats, lists, sampled_from

from consistency import consistency
from mwd_estimation.assembly.sag import SagCorrection
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.station import StationSettings, station
from mwd_estimation.survey.station_record import Verdicts
from mwd_sensors.core.frames import mat_from_quat, mat_nt, quat_from_rotvec, wrap_pi

DEG = math.pi / 180.0
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "test")


def readings(inc, azi_magnetic, toolface, axial=0.0, reference=REFERENCE):
    mat_tn = mat_nt(inc * DEG, azi_magnetic * DEG, toolface * DEG).T
    b_t = mat_tn @ np.array([reference.horizontal, 0.0, reference.vertical]) + np.array([axial, 0.0, 0.0])
    return mat_tn @ np.array([0.0, 0.0, -9.81]), b_t


def codes(shot):
    return {reason.code for reason in shot.reasons}


def test_angles_totals_and_a_grid_azimuth_come_out_of_clean_readings():
    shot = station(*readings(35, 120, 40), REFERENCE)
    got = [shot.inclination, shot.gravity_toolface, shot.dip]
    assert np.degrees(got) == pytest.approx([35, 40, 72], abs=1e-6)
    assert math.degrees(shot.azimuth) == pytest.approx(122.0, abs=0.05)
    assert math.degrees(shot.by_method("raw").azimuth) == pytest.approx(122.0, abs=1e-6)
    assert (shot.north, shot.method, shot.verdict, shot.corrected) == ("grid", "fused", "accept", True)
    assert shot.g_total == pytest.approx(9.81)
    assert shot.b_total == pytest.approx(50e-6)
    assert shot.verdicts == Verdicts("accept", "accept", "accept")
    assert shot.headline is None
    assert shot.reasons[-1].code is ReasonCode.WITHIN_LIMITS
    assert dict(shot.hypotheses)["clean"] > 0.8


@pytest.mark.parametrize(("north", "azimuth"), [("magnetic", 120.0), ("true", 123.0), ("grid", 122.0), ("best", 122.0)])
def test_the_north_asked_for_is_the_north_given(north, azimuth):
    shot = station(*readings(35, 120, 40), REFERENCE, StationSettings(north=north))
    assert math.degrees(shot.azimuth) == pytest.approx(azimuth, abs=0.05)
    assert shot.north == ("grid" if north == "best" else north)


@pytest.mark.fault_case(34)
def test_without_reference_the_azimuth_is_labelled_magnetic_and_uncorrected():
    shot = station(*readings(35, 120, 40, 2e-6))
    assert (shot.north, shot.method, shot.corrected, shot.verdict) == ("magnetic", "raw", False, "doubtful")
    assert shot.reasons[0].code is ReasonCode.NO_REFERENCE_FIELD
    assert math.isnan(shot.interference)


@pytest.mark.parametrize(("inc", "azi"), [(90, 90), (60, 20), (30, 90), (88, 270), (110, 60)])
@pytest.mark.parametrize("axial_nt", [900, -1500])
def test_without_reference_the_sigma_covers_a_string_that_may_be_magnetised(inc, azi, axial_nt):
    shot = station(*readings(inc, azi, 40, axial_nt * 1e-9))
    for azimuth, sigma in ((shot.azimuth, shot.sigma_azimuth), (shot.azimuths[0].azimuth, shot.azimuths[0].sigma)):
        assert abs(wrap_pi(azimuth - azi * DEG)) < 2.0 * sigma
    assert shot.sigma_azimuth > station(*readings(inc, azi, 40), REFERENCE).by_method("raw").sigma


def test_asking_for_true_north_without_declination_gives_magnetic_and_says_so():
    shot = station(*readings(35, 120, 40), replace(REFERENCE, declination=None), StationSettings(north="true"))
    assert (shot.north, shot.verdict) == ("magnetic", "doubtful")
    assert shot.reasons[0].code is ReasonCode.NORTH_UNKNOWN


def test_magnetic_toolface_near_vertical_is_the_heading_of_the_scribe_line():
    shot = station(*readings(0.3, 200, 25), REFERENCE)
    assert math.degrees(shot.magnetic_toolface) == pytest.approx((202 + 25) % 360, abs=0.3)
    assert shot.verdict == "accept"
    assert shot.verdicts == Verdicts("accept", "not_determined", "not_determined")


@pytest.mark.parametrize(("inc", "verdict"), [(2.5, "not_determined"), (10.0, "accept")])
def test_an_azimuth_that_the_lie_of_the_tool_in_the_hole_leaves_open_is_not_determined(inc, verdict):
    shot = station(*readings(inc, 200, 25), REFERENCE)
    assert shot.verdict == shot.verdicts.inclination == "accept"
    assert shot.verdicts.azimuth == verdict
    # The tool's own axis is known.
    assert station(*readings(inc, 200, 25), REFERENCE, StationSettings(errors=BENCH)).verdicts.azimuth == "accept"


@pytest.mark.fault_case(27, 31)
@given(inc=floats(20.0, 160.0), azi=floats(0.0, 360.0), dip=floats(80.0, 89.9), south=sampled_from([1.0, -1.0]))
@settings(max_examples=40, deadline=None)
def test_near_a_pole_the_field_and_not_the_vertical_is_why_an_azimuth_is_uncertain(inc, azi, dip, south):
    reference = replace(REFERENCE, total=58e-6, dip=south * dip * DEG)
    shot = station(*readings(inc, azi, 20, 5e-7, reference), reference)
    assert shot.verdicts.azimuth != "not_determined"
    assert ReasonCode.AZIMUTH_NOT_DETERMINED not in codes(shot)
    if dip > 88.0:
        assert shot.verdict == "doubtful"


def test_the_reading_whose_mirror_was_once_accepted_is_doubtful_with_both_azimuths_and_their_odds():
    reference = Reference(61e-6, -70 * DEG, 13 * DEG, None, 9.81, "test")
    shot = station([-0.30117, -2.19084, 9.55549], np.array([19019.8, -14296.8, 54757.3]) * 1e-9, reference)
    assert shot.verdicts.azimuth == "doubtful"
    assert shot.verdicts.inclination == "accept"
    assert abs(wrap_pi(shot.azimuth - 7.8 * DEG)) < shot.sigma_azimuth
    ((other, odds),) = shot.alternatives
    assert abs(math.degrees(other) - 197.8) < 5.0
    assert 0.003 < odds < 0.5
    assert shot.headline.code is ReasonCode.AZIMUTHS_FIT


def test_axial_interference_shows_in_the_hypotheses_and_the_azimuth_is_freed_of_it():
    shot = station(*readings(60, 40, 40, 2e-6), REFERENCE)
    assert shot.corrected
    assert abs(wrap_pi(shot.azimuth - 42 * DEG)) < 0.3 * shot.sigma_azimuth
    assert max(shot.hypotheses, key=lambda one: one[1])[0] == "axial"
    assert shot.interference == pytest.approx(2e-6, abs=3.0 * shot.sigma_interference)
    assert math.degrees(shot.by_method("corrected").azimuth) == pytest.approx(42.0, abs=0.01)
    # Totals are given as measured.
    assert abs(shot.b_total - 50e-6) > 100e-9
    assert shot.by_method("gyro") is None


@pytest.mark.parametrize(("inc", "azi"), [(88, 88), (90, 268)])
def test_a_strongly_magnetised_string_east_west_leaves_the_azimuth_doubtful_and_its_sigma_true(inc, azi):
    for axial in (-40e-6, 5e-6, 20e-6):
        shot = station(*readings(inc, azi, 40, axial), REFERENCE)
        assert shot.verdicts.azimuth == "doubtful"
        assert shot.verdicts.inclination == "accept"
        assert abs(wrap_pi(shot.azimuth - (azi + 2) * DEG)) < 2.0 * shot.sigma_azimuth
        assert shot.sigma_azimuth > 3.0 * DEG


@pytest.mark.parametrize("external", [[0.0, 2.5e-6, -2e-6], [4e-6, 1e-6, 3e-6]])
def test_steel_beside_the_tool_leaves_the_inclination_accepted_and_the_azimuth_doubtful(external):
    f_t, b_t = readings(30, 100, 40)
    shot = station(f_t, b_t + np.array(external), REFERENCE)
    assert shot.verdict == shot.verdicts.azimuth == "doubtful"
    assert shot.verdicts.inclination == shot.verdicts.toolface == "accept"
    assert abs(wrap_pi(shot.azimuth - 102 * DEG)) < 3.0 * shot.sigma_azimuth


def test_fixed_limits_of_field_and_dip_hold_beside_the_posterior():
    f_t, b_t = readings(30, 100, 40)
    for limits in ("service", "iscwsa"):
        settings = StationSettings(quality=QualitySettings(limits=limits))
        assert station(f_t, b_t, REFERENCE, settings).verdict == "accept"
        assert station(f_t, b_t + np.array([0.0, 2.5e-6, -2e-6]), REFERENCE, settings).verdict == "reject"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inc", "azi", "axial_nt", "accepted"),
    [
        *((*attitude, 220, 38) for attitude in ((10, 40), (30, 90), (60, 90), (88, 30))),
        # Interference beyond the tool code.
        *((*attitude, 0) for attitude in ((60, 20, 1500), (30, 90, 1500), (75, 60, 3000), (88, 90, 900))),
    ],
)
def test_stations_err_by_less_than_their_sigma_and_those_of_sound_tools_are_accepted(inc, azi, axial_nt, accepted):
    rng = np.random.default_rng(inc + azi)
    shots = [_drawn(inc, azi, rng, axial_nt * 1e-9) for _ in range(40)]
    errors = [wrap_pi(shot.azimuth - (azi + 2) * DEG) for shot in shots]
    found = consistency([(errors, [shot.sigma_azimuth for shot in shots])], correlated=False, confidence=0.999)
    # A sigma that holds what one station cannot exclude may be larger than the errors.
    assert found.nees <= found.high
    assert sum(shot.verdict == "accept" for shot in shots) >= accepted


def _drawn(inc, azi, rng, axial):
    """A station with the errors of the tool code drawn; axial interference, 1 sigma, T."""
    f_t, b_t = readings(inc, azi, rng.uniform(0, 360), rng.normal(0, axial))
    declination = rng.normal(0, math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal)))
    drawn = replace(_drawn_reference(rng), declination=REFERENCE.declination + declination)
    return station(*_with_errors(f_t, b_t, rng), drawn, StationSettings(errors=BENCH))


def _drawn_reference(rng):
    total, dip = rng.normal(0, REFERENCE.sigma_total), rng.normal(0, REFERENCE.sigma_dip)
    return replace(REFERENCE, total=REFERENCE.total + total, dip=REFERENCE.dip + dip)


def _with_errors(f_t, b_t, rng):
    """Readings with scales and biases of the tool code drawn."""
    f_t = f_t * (1 + rng.normal(0, 0.0005, 3)) + rng.normal(0, 0.004, 3)
    return f_t, b_t * (1 + rng.normal(0, 0.0016, 3)) + rng.normal(0, 70e-9, 3)


def test_noise_of_the_averages_adds_to_the_sigmas():
    f_t, b_t = readings(50, 70, 130)
    noisy = station(f_t, b_t, REFERENCE, covariance_f=np.eye(3) * 0.02**2, covariance_b=np.eye(3) * 300e-9**2)
    clean = station(f_t, b_t, REFERENCE)
    assert noisy.sigma_inclination > clean.sigma_inclination
    assert noisy.sigma_azimuth > clean.sigma_azimuth
    assert noisy.sigma_toolface > clean.sigma_toolface


def test_known_sag_misalignment_and_toolface_offset_are_taken_off():
    f_t, b_t = readings(60, 100, 0)
    settings = StationSettings(sag=SagCorrection(math.radians(0.2)), toolface_offset_deg=29.0)
    shot = station(f_t, b_t, REFERENCE, settings)
    assert math.degrees(shot.inclination) == pytest.approx(60 + 0.2 * math.sin(60 * DEG))
    (sag,) = [reason for reason in shot.reasons if reason.code is ReasonCode.SAG_CORRECTED]
    assert math.degrees(sag.value) == pytest.approx(0.2 * math.sin(60 * DEG))
    assert math.degrees(shot.gravity_toolface) == pytest.approx(29.0)
    # Scribe line on the high side: the hole axis bent half a degree away from +z is lower, bent to +y turns right or
    # left.
    bent = station(f_t, b_t, REFERENCE, StationSettings(hole_axis_deg=(0.5, 0.0)))
    assert abs(math.degrees(bent.inclination) - 60) == pytest.approx(0.5, abs=1e-3)
    turned = station(f_t, b_t, REFERENCE, StationSettings(hole_axis_deg=(0.0, 0.5)))
    assert abs(math.degrees(turned.azimuth) - 102) == pytest.approx(0.5 / math.sin(60 * DEG), abs=1e-2)
    assert math.degrees(turned.inclination) == pytest.approx(60, abs=0.01)


def test_misalignment_settings_say_where_the_hole_axis_lies_in_tool_axes():
    hole = mat_nt(60 * DEG, 100 * DEG, 40 * DEG)
    for angles, axis in (((1.5, 0.0), [0, 1, 0]), ((0.0, 1.5), [0, 0, 1])):
        mat_th = mat_from_quat(quat_from_rotvec(np.array(axis) * 1.5 * DEG))
        f_t = mat_th @ hole.T @ np.array([0, 0, -9.81])
        b_t = mat_th @ hole.T @ np.array([REFERENCE.horizontal, 0, REFERENCE.vertical])
        shot = station(f_t, b_t, REFERENCE, StationSettings(hole_axis_deg=angles))
        assert np.degrees([shot.inclination, shot.azimuth, shot.gravity_toolface]) == pytest.approx(
            [60, 102, 40], abs=0.05
        )


def test_without_a_sensor_what_is_left_is_given():
    f_t, b_t = readings(30, 100, 40)
    dead = station(f_t, np.full(3, np.nan), REFERENCE)
    assert dead.verdict == "reject"
    assert dead.reasons[0] == Reason(ReasonCode.INCLINATION_ONLY, causes=(Reason(ReasonCode.NO_MAGNETOMETER),))
    assert math.degrees(dead.inclination) == pytest.approx(30)
    assert dead.sigma_azimuth == pytest.approx(math.pi)
    blind = station(np.full(3, np.nan), b_t, REFERENCE)
    assert (blind.verdict, math.isnan(blind.inclination)) == ("reject", True)


@pytest.mark.parametrize("toolface", [0, 70, 200])
@pytest.mark.parametrize(("force", "field"), [(-1.0, 1.0), (1.0, -1.0)])
def test_a_flipped_sensor_leaves_neither_an_accepted_inclination_nor_an_accepted_azimuth(toolface, force, field):
    f_t, b_t = readings(40, 120, toolface)
    shot = station(force * f_t, field * b_t, REFERENCE)
    assert shot.verdict == "reject"
    assert ReasonCode.DIP_SIGN in codes(shot)
    assert "accept" not in (shot.verdicts.inclination, shot.verdicts.azimuth)


@pytest.mark.parametrize(
    ("force", "field", "code"),
    [
        (1.0 / 9.81, 1.0, ReasonCode.GRAVITY_IN_G),
        (1.0, 1e9, ReasonCode.FIELD_IN_OTHER_UNIT),
        (1.0, 1e-3, ReasonCode.FIELD_IN_OTHER_UNIT),
        (1.0, 1e-6, ReasonCode.FIELD_NOT_EARTH),
    ],
)
def test_another_unit_is_named_and_no_steel(force, field, code):
    f_t, b_t = readings(40, 120, 70)
    shot = station(force * f_t, field * b_t, REFERENCE)
    assert shot.verdict == "reject"
    assert shot.headline.code is code


def test_a_fault_of_the_readings_rejects_the_station():
    f_t, b_t = readings(30, 100, 40)
    shot = station(f_t, b_t, REFERENCE, faults=(Reason(ReasonCode.TOOL_NOT_STILL),))
    assert shot.verdict == "reject"
    assert Reason(ReasonCode.TOOL_NOT_STILL) in shot.reasons


@pytest.mark.fault_case(28)
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
    assert shot.headline == Reason(ReasonCode.INCLINATION_ONLY, causes=(Reason(ReasonCode.NO_HORIZONTAL_FIELD),))


READING = floats(-1e6, 1e6) | floats(-20.0, 20.0) | floats(-1e-4, 1e-4) | sampled_from([0.0, math.nan, math.inf])


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(lists(READING, min_size=6, max_size=6), sampled_from([None, REFERENCE]))
def test_no_reading_however_broken_raises_or_is_accepted_without_cause(axes, reference):
    shot = station(axes[:3], axes[3:], reference)
    assert shot.verdict == "reject" or abs(shot.g_total - 9.81) < 1.0
    assert shot.reasons
    if math.isfinite(shot.inclination):
        assert np.isfinite(shot.covariance).all()
        assert np.linalg.eigvalsh(shot.covariance).min() > -1e-9


@pytest.mark.slow
def test_totals_deviate_by_their_covariance_when_errors_are_drawn():
    rng, chi = np.random.default_rng(8), []
    for _ in range(400):
        f_t, b_t = readings(50, 70, rng.uniform(0, 360), rng.normal(0, 220e-9))
        drawn = replace(_drawn_reference(rng), gravity=9.81 + rng.normal(0, REFERENCE.sigma_gravity))
        off = measured(*_with_errors(f_t, b_t, rng), drawn).station.deviations
        values = np.array([off.gravity, off.field, off.dip])
        chi.append(values @ np.linalg.solve(off.covariance, values))
    # 1200 degrees of freedom: 95 % band 3 -+ 0.24.
    assert np.mean(chi) == pytest.approx(3.0, abs=0.25)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="f_t: expected three axes"):
        station([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="covariance_b: expected shape"):
        station([0, 0, 9.8], [1e-5, 0, 4e-5], covariance_b=np.ones(3))


def test_without_a_magnetometer_true_north_needs_no_declination():
    settings = StationSettings(north="true")
    assert station([-6.0, 1.0, 7.7], [math.nan] * 3, None, settings).north == "true"
    assert station([-6.0, 1.0, 7.7], [2e-5, 1e-5, 4e-5], None, settings).north == "magnetic"

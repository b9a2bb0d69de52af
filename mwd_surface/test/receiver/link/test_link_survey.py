# SPDX-License-Identifier: Apache-2.0
"""A survey from words: totals judged, sigma by the tool's own words or the tool code, within its chi-square band."""

import dataclasses
import math

import numpy as np
import pytest
from example_words import received

from consistency import assert_consistent
from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import frames
from mwd_sensors.telemetry import meanings
from mwd_surface.receiver.link.link_survey import SurveyTime, survey
from mwd_surface.receiver.words import BELIEVED, ERASED, LinkValue, believed
from mwd_surface.surveys.survey_record import checked_survey

REFERENCE = Reference(50e-6, math.radians(70.0), math.radians(2.0), math.radians(0.5), 9.82, "test")
AT = SurveyTime(1_700_000_000_000_000_000, 30.0)


def words(inc=40.0, azm=100.0, g=9.82 / 9.80665, b=50.0, dip=70.0, **status):
    given = {"Inc": inc, "Azm": azm, "Grav": g, "MagF": b, "DipA": dip}
    return [received(name, value, status=status.get(name, BELIEVED)) for name, value in given.items()]


def made(sent, reference=REFERENCE, **quality):
    return survey(believed(sent), AT, 1, "mud_pulse", reference, quality=QualitySettings(**quality))


def test_a_sound_survey_is_accepted_with_angles_from_grid_north():
    found = checked_survey(made(words()))
    assert math.degrees(found.inclination) == pytest.approx(40.0, abs=0.03)
    assert math.degrees(found.azimuth) == pytest.approx(100.0 + 2.0 - 0.5, abs=0.06)
    assert found.north == North.GRID
    assert Verdict(found.verdict) == Verdict.ACCEPT
    assert found.verdicts == ("accept", "accept", "not determined")
    assert found.has_readings
    assert found.has_reference


@pytest.mark.parametrize(
    ("change", "inclination"), [({"b": 52.5}, "accept"), ({"dip": 73.0}, "accept"), ({"g": 1.02}, "reject")]
)
def test_totals_off_the_reference_reject_the_azimuth_and_gravity_also_the_inclination(change, inclination):
    found = made(words(**change))
    assert found.verdicts[:2] == (inclination, "reject")
    assert found.headline


def test_the_verdict_is_by_the_settings_that_the_estimator_has_too():
    assert made(words(dip=70.3)).verdicts[1] == "accept"
    found = made(words(dip=70.3), limits="iscwsa")
    assert found.verdicts[1] == "doubtful"
    assert found.dip_limit == math.radians(0.25)
    assert made(words(), far_probability=1e-4, far_deg=0.5).verdicts[1] == "doubtful"


def test_a_convergence_of_zero_is_no_grid_as_in_the_tool():
    assert made(words(), dataclasses.replace(REFERENCE, convergence=0.0)).north == North.TRUE


def test_an_erased_azimuth_leaves_the_inclination():
    found = made(words(Azm=ERASED))
    assert not found.has_azimuth
    assert found.verdicts[:2] == ("accept", "reject")
    assert "not received" in found.headline


def test_without_the_inclination_there_is_no_survey():
    assert made(words(Inc=ERASED)) is None


def test_a_total_that_was_not_received_is_said_to_be_unchecked():
    assert any("not checked: total field" in reason for reason in made(words(MagF=ERASED)).reasons)


def test_without_a_reference_the_azimuth_stays_magnetic():
    found = made(words(), None)
    assert (found.north, math.degrees(found.azimuth)) == (North.MAGNETIC, pytest.approx(100.0, abs=0.06))
    assert math.isnan(found.g_limit)
    assert math.isnan(found.b_limit)


def test_the_same_words_have_the_same_identity_and_others_another():
    assert made(words()).uuid == made(words()).uuid
    assert made(words()).uuid != made(words(azm=101.0)).uuid


def test_the_sigma_of_the_tool_takes_the_place_of_the_tool_codes():
    found = made([*words(), received("sInc", 0.5), received("sAzm", 2.0)])
    assert math.degrees(found.sigma_inclination) == pytest.approx(0.5, rel=0.3)
    assert math.degrees(found.sigma_azimuth) == pytest.approx(2.0, rel=0.3)


@pytest.mark.parametrize("inc", [10.0, 45.0, 80.0])
def test_sigma_of_inclination_and_azimuth_is_within_its_chi_square_band(inc):
    """Readings drawn with the errors of the tool code, rounded to words, against the truth."""
    errors, random = SensorErrors(), np.random.default_rng(11)
    drawn_errors, sigmas = [], []
    for _ in range(300):
        azm = random.uniform(0.0, 360.0)
        mat_nt = frames.mat_nt(math.radians(inc), math.radians(azm), 0.0)
        f_t = mat_nt.T @ np.array([0.0, 0.0, -9.82])
        b_t = mat_nt.T @ (50e-6 * np.array([math.cos(REFERENCE.dip), 0.0, math.sin(REFERENCE.dip)]))
        drawn = random.normal(size=6) * np.sqrt(np.diagonal(errors.covariance(f_t, b_t)))
        f_t, b_t = f_t + drawn[:3], b_t + drawn[3:]
        b_t[0] += random.normal() * errors.axial_interference_nt * 1e-9
        off = random.normal(size=3) * np.sqrt(np.diagonal(errors.alignment(math.radians(inc))))
        measured_inc = float(frames.inclination(f_t)) + off[0]
        field = REFERENCE.sigma_declination_field / (50e-6 * math.cos(REFERENCE.dip))
        declination = math.hypot(REFERENCE.sigma_declination, field) * random.normal()
        measured_azm = float(magnetic_geometry.raw_azimuth(f_t, b_t)) + off[1] + declination
        found = made(words(inc=math.degrees(measured_inc), azm=math.degrees(measured_azm) % 360.0))
        error = float(frames.wrap_pi(found.azimuth - math.radians(azm + 1.5)))
        drawn_errors.append((found.inclination - math.radians(inc), error))
        sigmas.append((found.sigma_inclination, found.sigma_azimuth))
    assert_consistent(np.array(drawn_errors), np.array(sigmas))


def test_an_erased_word_is_left_out():
    assert meanings.B_TOTAL not in believed([received("MagF", 48.0, status=ERASED)])
    assert isinstance(believed([received("Inc", 3.0)])[meanings.INCLINATION], LinkValue)

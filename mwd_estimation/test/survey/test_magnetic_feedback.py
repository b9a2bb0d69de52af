"""How the field is read, and what changes the reading."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Binner
from mwd_estimation.survey.azimuth_fusion import Settings as FusionSettings
from mwd_estimation.survey.decision import decided
from mwd_estimation.survey.magnetic_feedback import NORTH_CODES, MagneticFeedback
from mwd_estimation.survey.static_survey import BIN_NS, BinSet, StillSurvey
from mwd_estimation.survey.static_survey import Params as StillParams
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core.frames import mat_nt

ALARM = Reason(ReasonCode.DISAGREES_EXTERNAL_INTERFERENCE, 0.4, 3.0, (8.0,), ("raw", "gyro"))
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")


def taken(axial=2e-6):
    """A survey of a tool at rest whose string is magnetised along its axis."""
    rng = np.random.default_rng(3)
    n = 1600
    stamps = 1_700_000_000 * 10**9 + np.arange(n) * 10**7
    mat = mat_nt(0.8, 1.9, 0.3)
    field_n = 5e-5 * np.array([np.cos(1.1) * np.cos(0.05), np.cos(1.1) * np.sin(0.05), np.sin(1.1)])
    force = mat.T @ [0.0, 0.0, -9.81] + 5e-3 * rng.normal(size=(n, 3))
    field = mat.T @ field_n + [axial, 0.0, 0.0] + 5e-8 * rng.normal(size=(n, 3))
    imu = Binner(6, BIN_NS).add(stamps, np.hstack([1e-3 * rng.normal(size=(n, 3)), force]))
    mag = Binner(3, BIN_NS).add(stamps, field)
    still = StillSurvey(StillParams())
    for one, beside in zip(imu, mag, strict=True):
        average = still.add(BinSet(one, beside))
        if average is not None:
            return decided(average, 1, REFERENCE, StationSettings(), None, FusionSettings())
    raise AssertionError("no survey was taken")


def test_without_a_reference_the_field_is_read_from_magnetic_north():
    feedback = MagneticFeedback(StationSettings(), None)
    assert (feedback.north, feedback.in_force.north, feedback.interference) == (
        "magnetic",
        NORTH_CODES["magnetic"],
        None,
    )
    assert not feedback.in_force.corrected


def test_what_an_uncertain_gyro_left_open_is_in_the_sigma_until_the_two_are_compared_again():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    one, _ = taken(0.0)
    usual = feedback.in_force.model.sigma_north
    feedback.take(dataclasses.replace(one, alarm=(), left_open=0.4), None)
    assert feedback.in_force.unresolved == 0.4
    assert feedback.in_force.model.sigma_north == pytest.approx(math.hypot(usual, 0.4))
    feedback.take(one, None)
    assert feedback.in_force.unresolved == 0.4
    feedback.take(dataclasses.replace(one, alarm=()), None)
    assert (feedback.in_force.unresolved, feedback.in_force.model.sigma_north) == (0.0, usual)


def test_a_corrected_station_takes_its_interference_off_from_then_on_until_the_reference_changes():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    before = feedback.in_force
    assert feedback.north == "grid"
    one, analysis = taken()
    feedback.take(one, analysis)
    assert feedback.in_force is not before
    assert feedback.in_force.corrected
    assert feedback.interference[0] == pytest.approx(2e-6, abs=3.0 * feedback.interference[1])
    assert feedback.in_force.model.interference[0] == feedback.interference[0]
    assert feedback.in_force.update.axial == feedback.interference
    feedback.set_reference(dataclasses.replace(REFERENCE, total=4.9e-5))
    assert feedback.interference is None
    assert not feedback.in_force.corrected


def test_a_gyro_that_was_preferred_to_the_field_makes_it_suspect_until_they_agree():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    one, analysis = taken()
    alarmed = dataclasses.replace(one, alarm=(ALARM,), weights={"gyro": 1.0})
    feedback.take(alarmed, analysis)
    assert feedback.in_force.external_interference
    feedback.take(dataclasses.replace(one, alarm=None), analysis)
    assert feedback.in_force.external_interference
    feedback.take(dataclasses.replace(one, alarm=()), analysis)
    assert not feedback.in_force.external_interference


def test_the_uncertainty_of_the_declination_is_in_the_reading():
    sure = MagneticFeedback(StationSettings(north="magnetic"), REFERENCE).in_force.model
    true = MagneticFeedback(StationSettings(north="true"), REFERENCE).in_force.model
    assert sure.sigma_north == 0.0
    assert true.sigma_north == pytest.approx(math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal)))
    assert true.north_correction == pytest.approx(0.05)

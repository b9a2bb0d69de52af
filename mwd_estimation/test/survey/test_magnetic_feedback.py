# SPDX-License-Identifier: Apache-2.0
"""How the field is read, and what changes the reading."""

import dataclasses
import math

import numpy as np
import pytest
from tool_streams import earth_field, streams

from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Binner
from mwd_estimation.survey.decision import SurveyDecision
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.magnetic_feedback import MagneticFeedback
from mwd_estimation.survey.static_survey import BIN_NS, BinSet, StillSurvey
from mwd_estimation.survey.station import StationSettings
from mwd_estimation.survey.station_record import Verdicts
from mwd_estimation.survey.survey_settings import SurveySettings
from mwd_sensors.core.frames import mat_nt

REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")


def taken(axial=5e-7):
    """A survey of a tool at rest whose string is magnetised along its axis."""
    mat = np.broadcast_to(mat_nt(0.8, 1.9, 0.3), (1600, 3, 3))
    imu, mag = streams(mat, np.random.default_rng(3), field_n=earth_field(declination=0.05))
    values = np.hstack([imu["angular_velocity"], imu["linear_acceleration"]])
    field = mag["magnetic_field"] + [axial, 0.0, 0.0]
    bins = zip(
        Binner(6, BIN_NS).add(imu["stamp_ns"], values), Binner(3, BIN_NS).add(mag["stamp_ns"], field), strict=True
    )
    still = StillSurvey(SurveySettings())
    average = next(found for one in bins if (found := still.add(BinSet(*one))) is not None)
    begun = SurveyDecision(StationSettings(), FaultHistory()).begin(average, 1, REFERENCE, None)
    return begun.survey, begun.shared


def test_without_a_reference_the_field_is_read_from_magnetic_north():
    feedback = MagneticFeedback(StationSettings(), None)
    assert (feedback.north, feedback.in_force.north, feedback.interference) == (
        "magnetic",
        North.MAGNETIC,
        None,
    )
    assert not feedback.in_force.corrected


def test_a_corrected_station_takes_its_interference_off_from_then_on_until_the_reference_changes():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    before = feedback.in_force
    assert feedback.north == "grid"
    one, shared = taken()
    feedback.take(one, shared)
    assert feedback.in_force is not before
    assert feedback.in_force.corrected
    assert feedback.interference[0] == pytest.approx(5e-7, abs=3.0 * feedback.interference[1])
    assert feedback.in_force.model.interference[0] == feedback.interference[0]
    assert feedback.in_force.update.axial == feedback.interference
    feedback.set_reference(dataclasses.replace(REFERENCE, total=4.9e-5))
    assert feedback.interference is None
    assert not feedback.in_force.corrected


def test_the_uncertainty_of_the_declination_is_in_the_reading():
    sure = MagneticFeedback(StationSettings(north="magnetic"), REFERENCE).in_force.model
    true = MagneticFeedback(StationSettings(north="true"), REFERENCE).in_force.model
    assert sure.sigma_north == 0.0
    assert true.sigma_north == pytest.approx(math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal)))
    assert true.north_correction == pytest.approx(0.05)


def doubted(survey, **changes):
    quantities = Verdicts("accept", "doubtful", "accept")
    return dataclasses.replace(survey, station=dataclasses.replace(survey.station, quantities=quantities, **changes))


def test_after_a_doubted_survey_the_sigma_of_the_samples_holds_what_it_left_open_until_one_is_accepted():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    one, shared = taken(0.0)
    usual = feedback.in_force.model.sigma_north
    feedback.take(doubted(one, sigma_azimuth=0.3, alternatives=((one.station.azimuth + 1.0, 0.04),)), shared)
    assert feedback.in_force.unresolved == pytest.approx(math.hypot(0.3, 0.2))
    assert feedback.in_force.model.sigma_north == pytest.approx(math.hypot(usual, feedback.in_force.unresolved))
    feedback.take(one, shared)
    assert (feedback.in_force.unresolved, feedback.in_force.model.sigma_north) == (0.0, usual)


def test_a_field_from_outside_makes_the_samples_suspect_until_a_survey_is_accepted():
    feedback = MagneticFeedback(StationSettings(), REFERENCE)
    one, shared = taken()
    feedback.take(doubted(one, hypotheses=(("clean", 0.1), ("external", 0.9))), shared)
    assert feedback.in_force.external_interference
    feedback.take(one, shared)
    assert not feedback.in_force.external_interference

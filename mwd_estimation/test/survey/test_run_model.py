# SPDX-License-Identifier: Apache-2.0
"""Stations of a run after a string that turned: what its means show is known before the first station."""

import math

import numpy as np
import pytest

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.turning_means import Turning
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core.frames import mat_nt, wrap_pi

GRAVITY, TOTAL, DIP = 9.81, 5e-5, 1.1
REFERENCE = Reference(TOTAL, DIP, 0.0, None, GRAVITY, "test")
SETTINGS = StationSettings()
INCLINATION, AZIMUTH = 0.6, 1.2
TURN = np.radians([0.0, 1.5, -1.3])


def readings(toolface, turn, across):
    """Force, m/s^2, and field, T, of a tool whose accelerometers are turned and which has a field across its axis."""
    mat = mat_nt(INCLINATION, AZIMUTH, toolface)
    force = mat.T @ [0.0, 0.0, -GRAVITY]
    field = mat.T @ (TOTAL * np.array([math.cos(DIP), 0.0, math.sin(DIP)])) + [0.0, *across]
    return force + np.cross(turn, force), field


def shown(turn, across, *, rate=(12.0, 0.0, 0.0)):
    """Means over the turns of such a tool."""
    force, field = np.mean([readings(toolface, turn, across) for toolface in np.arange(8) * math.tau / 8.0], axis=0)
    return Turning(force, field, np.array(rate), 0.03, 30e-9)


def taken(turn, across, turning):
    """Finding and station of the first station of such a tool."""
    one = measured(*readings(0.4, turn, across), REFERENCE, SETTINGS)
    finding = RunModel(SETTINGS).take(one, turning=turning)
    return finding, judged(one, finding, SETTINGS)


def test_a_field_across_the_axis_is_known_before_the_first_station():
    across = np.array([7e-7, -6e-7])
    _, without = taken(np.zeros(3), across, None)
    finding, station = taken(np.zeros(3), across, shown(np.zeros(3), across))
    error = abs(wrap_pi(station.azimuth - AZIMUTH))
    assert error < 0.3 * abs(wrap_pi(without.azimuth - AZIMUTH))
    assert station.sigma_azimuth < without.sigma_azimuth
    assert error < 3.0 * station.sigma_azimuth
    assert station.verdicts.azimuth == "accept"
    assert finding.hypotheses[Hypothesis.CROSS_AXIAL] > 0.5


def test_turned_accelerometers_are_named_before_the_first_station():
    finding, station = taken(TURN, np.zeros(2), shown(TURN, np.zeros(2)))
    assert finding.hypotheses[Hypothesis.SENSOR] > 0.5
    assert station.verdict == "doubtful"
    assert abs(station.inclination - INCLINATION) < 3.0 * station.sigma_inclination
    assert abs(wrap_pi(station.azimuth - AZIMUTH)) < 3.0 * station.sigma_azimuth


def test_a_tool_that_is_turned_as_a_whole_is_no_defect_of_a_sensor():
    # All three triads have the axis of rotation elsewhere, alike.
    force, field, rate = (np.array([a, 0.03 * a, -0.02 * a]) for a in (-8.1, 3.3e-5, 12.0))
    sound = taken(np.zeros(3), np.zeros(2), Turning(force, field, rate, 0.03, 30e-9))
    assert sound[0].hypotheses[Hypothesis.SENSOR] < 0.05
    assert sound[1].verdict == "accept"


@pytest.mark.parametrize("share", [0.9, 0.3])
def test_what_was_told_already_counts_once(share):
    one = measured(*readings(0.4, TURN, np.zeros(2)), REFERENCE, SETTINGS)
    first = shown(TURN, np.zeros(2))
    better = Turning(first.force, first.field, first.rate, share * first.sigma_force, first.sigma_field)
    alone, again = RunModel(SETTINGS), RunModel(SETTINGS)
    alone.take(one, turning=better)
    again.take(one, turning=first, learn=False)
    again.take(one, turning=better)
    mean, covariance = (part[12:15] if part.ndim == 1 else part[12:15, 12:15] for part in alone.shared())
    other, spread = (part[12:15] if part.ndim == 1 else part[12:15, 12:15] for part in again.shared())
    np.testing.assert_allclose(other, mean, atol=math.radians(0.25))
    assert np.trace(spread) > 0.3 * np.trace(covariance)

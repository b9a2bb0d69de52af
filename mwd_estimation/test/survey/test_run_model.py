# SPDX-License-Identifier: Apache-2.0
"""Stations of a run after a string that turned: what its means show is known before the first station."""

import dataclasses
import math

import numpy as np
import pytest
from bench_errors import BENCH

from consistency import assert_consistent
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel, Taken
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.turning_string import Across, Turning
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core.frames import mat_nt, wrap_pi

GRAVITY, TOTAL, DIP = 9.81, 5e-5, 1.1
REFERENCE = Reference(TOTAL, DIP, 0.0, None, GRAVITY, "test")
SETTINGS = StationSettings()
INCLINATION, AZIMUTH = 0.6, 1.2
TURN = np.radians([0.0, 1.5, -1.3])


def readings(toolface, turn, across, azimuth=AZIMUTH):
    """Force, m/s^2, and field, T, of a tool whose accelerometers are turned and which has a field across its axis."""
    mat = mat_nt(INCLINATION, azimuth, toolface)
    force = mat.T @ [0.0, 0.0, -GRAVITY]
    field = mat.T @ (TOTAL * np.array([math.cos(DIP), 0.0, math.sin(DIP)])) + [0.0, *across]
    return force + np.cross(turn, force), field


def shown(turn, across, *, sigma_deg=0.2):
    """What such a tool shows while it turns."""
    return Turning(Across(np.array([turn[2], -turn[1]]), math.radians(sigma_deg)), Across(np.asarray(across), 70e-9))


def taken(turn, across, turning):
    """Finding and station of the first station of such a tool."""
    one = measured(*readings(0.4, turn, across), REFERENCE, SETTINGS)
    finding = RunModel(SETTINGS).take(Taken(one, turning=turning))
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


def test_a_small_turn_that_calibration_leaves_is_no_defect():
    turn = np.radians([0.0, 0.25, -0.2])
    finding, station = taken(np.zeros(3), np.zeros(2), shown(turn, np.zeros(2)))
    assert finding.hypotheses[Hypothesis.SENSOR] < 0.05
    assert station.verdict == "accept"


def test_what_was_told_already_counts_once():
    one = measured(*readings(0.4, TURN, np.zeros(2)), REFERENCE, SETTINGS)
    first, better = shown(TURN, np.zeros(2)), shown(TURN, np.zeros(2), sigma_deg=0.1)
    alone, again = RunModel(SETTINGS), RunModel(SETTINGS)
    alone.take(Taken(one, turning=better), learn=False)
    for turning in (first, first, better, better):
        again.take(Taken(one, turning=turning), learn=False)
    for now, then in zip(again.shared(), alone.shared(), strict=True):
        # No filter falls below its floor, which is all that a second telling changes.
        at = slice(12, 15) if now.ndim == 1 else (slice(12, 15), slice(12, 15))
        np.testing.assert_allclose(now[at], then[at], rtol=5e-3, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("mount_deg", [0.25, 1.0])
def test_single_stations_of_a_tool_err_by_their_sigma_where_it_states_how_its_mount_may_be_turned(mount_deg):
    rng, found = np.random.default_rng(8), []
    settings = dataclasses.replace(SETTINGS, errors=dataclasses.replace(BENCH, mount_deg=mount_deg))
    for _ in range(40):
        turn, azimuth = np.radians(mount_deg) * rng.standard_normal(3), rng.uniform(0.0, math.tau)
        one = measured(*readings(rng.uniform(0.0, math.tau), turn, np.zeros(2), azimuth), REFERENCE, settings)
        station = judged(one, RunModel(settings).take(Taken(one)), settings)
        found.append((station, station.inclination - INCLINATION, wrap_pi(station.azimuth - azimuth)))
    assert_consistent([off for _, off, _ in found], [station.sigma_inclination for station, _, _ in found])
    assert all(abs(off) < 3.0 * station.sigma_azimuth for station, _, off in found)
    accepted = [station.verdicts.inclination == "accept" for station, _, _ in found]
    assert any(accepted) == (mount_deg < 0.3)

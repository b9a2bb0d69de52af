# SPDX-License-Identifier: Apache-2.0
"""A gyro azimuth of a station: two positions show the bias, what cannot be found is refused, cuts change nothing."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Binner
from mwd_estimation.gyrocompass.seek_state import TACTICAL, white_noise
from mwd_estimation.gyrocompass.station import GyroStation
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_sensors.core import input_covariance, wire
from mwd_sensors.core.constants import DEG_PER_HOUR, EARTH_RATE
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.settings import changed

START = 1_700_000_000 * 10**9
RATE = 100
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, gravity=9.81, source="test")
TURN = math.radians(18.0)  # rad/s


def _samples(
    azimuth=2.2, inclination=1.0, rest=60.0, turn_rate=TURN, bias=4.0, turned=0.0, seed=1, latitude=44.0, noise=0.02
):
    """Rest, half a turn about the axis, rest again, with a biased gyro; `turned` turns the horizontal field, rad."""
    rng = np.random.default_rng(seed)
    turning = round(math.pi / turn_rate * RATE)
    rates = np.concatenate([np.zeros(round(rest * RATE)), np.full(turning, math.pi / turning * RATE)])
    rates = np.concatenate([rates, np.zeros(round(rest * RATE))])
    n = len(rates)
    mat = mat_nt(inclination, np.full(n, azimuth), np.cumsum(rates) / RATE)
    phi = math.radians(latitude)
    earth_n = EARTH_RATE * np.array([math.cos(phi), 0.0, -math.sin(phi)])
    direction = 0.05 + turned
    field_n = 5e-5 * np.array([np.cos(1.1) * np.cos(direction), np.cos(1.1) * np.sin(direction), np.sin(1.1)])
    force = np.einsum("kji,j->ki", mat, [0, 0, -9.81])
    imu, precision, mag = wire.IMU.empty(n), wire.IMU.empty(n), wire.MAG.empty(n)
    for samples in (imu, precision, mag):
        samples["stamp_ns"] = START + np.arange(n) * (10**9 // RATE)
    white = math.radians(noise) / 60.0 * math.sqrt(RATE)
    precision["angular_velocity"] = np.einsum("kji,j->ki", mat, earth_n) + np.array([0.0, bias, -bias]) * DEG_PER_HOUR
    precision["angular_velocity"] += white * rng.normal(size=(n, 3))
    precision["angular_velocity"][:, 0] += rates
    precision["linear_acceleration"] = force + 3e-3 * rng.normal(size=(n, 3))
    imu["angular_velocity"] = 1e-3 * rng.normal(size=(n, 3))
    imu["angular_velocity"][:, 0] += rates
    imu["linear_acceleration"] = force + 5e-3 * rng.normal(size=(n, 3))
    mag["magnetic_field"] = np.einsum("kji,j->ki", mat, field_n) + 5e-8 * rng.normal(size=(n, 3))
    return imu, precision, mag


def _settings(**changes):
    gyro = {"place.lat_deg": 44.0, "tool.precision.gyro.noise_deg_sqrt_h": 0.02, "tool.precision.gyro.g_deg_h_g": 0.1}
    return changed(EstimatorSettings(), {**gyro, **changes})


def _surveys(streams, settings, cuts=(), duration=50.0):
    """Surveys that were asked for as the tool came to rest in its second position."""
    imu, precision, mag = streams
    pipeline, surveys = Pipeline(settings, REFERENCE), []
    ask = len(imu) - 54 * RATE
    for block in np.split(np.arange(len(imu)), sorted({*cuts, ask})):
        if len(block) and block[0] == ask:
            pipeline.request_survey(duration)
        pipeline.push_mag(mag[block])
        pipeline.push_precision(precision[block])
        surveys += pipeline.push_imu(imu[block]).surveys
    return surveys


def _gyro(survey):
    return survey.station.by_method("gyro")


@pytest.mark.slow
def test_two_positions_find_north_that_one_refuses():
    first, second = _surveys(_samples(), _settings())
    assert "half a turn" in text(_gyro(first).refused)
    assert first.weights["gyro"] == 0.0
    found = _gyro(second)
    assert found.refused is None
    assert found.sigma < math.radians(2.0)
    assert abs(wrap_pi(found.azimuth - 2.2)) < 3.0 * found.sigma
    assert 0.0 < second.weights["gyro"] < 1.0
    assert sum(second.weights.values()) == pytest.approx(1.0)
    assert second.station.method == "fused"
    assert abs(wrap_pi(second.station.azimuth - 2.2)) < 3.0 * second.station.sigma_azimuth


@pytest.mark.slow
def test_a_gyro_outweighs_a_field_that_is_turned_from_outside_or_leaves_the_station_doubtful():
    station = _surveys(_samples(turned=math.radians(22.0)), _settings())[-1].station
    near = abs(wrap_pi(station.azimuth - 2.2)) < 3.0 * station.sigma_azimuth
    assert near or station.verdicts.azimuth == "doubtful"
    assert dict(station.hypotheses)["external"] > 0.05


@pytest.mark.slow
def test_clip_flags_of_the_precision_unit_reach_the_seek_whatever_the_cut():
    imu, precision, mag = _samples()
    flagged = (np.arange(len(imu)) % 200 == 0)[:, None] & np.array([False, True, False])
    input_covariance.mark_clipped(precision, "angular_velocity", flagged)
    whole, pieces = (_surveys((imu, precision, mag), _settings(), cuts) for cuts in ((), range(37, len(imu), 251)))
    assert [_gyro(survey).refused.code for survey in whole] == [ReasonCode.GYRO_CLIPPED] * len(whole)
    assert [_gyro(survey) for survey in whole] == [_gyro(survey) for survey in pieces]


@pytest.mark.slow
def test_any_cut_into_blocks_gives_the_same_gyro_azimuth():
    streams = _samples()
    whole = _surveys(streams, _settings())
    pieces = _surveys(streams, _settings(), cuts=range(37, len(streams[0]), 251))
    for one, other in zip(whole, pieces, strict=True):
        assert one.station.azimuth == other.station.azimuth
        assert one.weights == other.weights
    assert _gyro(whole[-1]) == _gyro(pieces[-1])


@pytest.mark.slow
def test_an_unknown_latitude_is_reported_and_costs_nothing_else():
    survey = _surveys(_samples(), _settings(**{"place.lat_deg": None}))[-1]
    assert _gyro(survey).refused.code is ReasonCode.LATITUDE_UNKNOWN
    assert survey.station.method == "fused"
    assert survey.station.verdict == "accept"


def test_without_a_precision_unit_there_is_no_gyro_azimuth_and_no_word_of_it():
    imu, _, mag = _samples()
    pipeline = Pipeline(_settings(), REFERENCE)
    pipeline.push_mag(mag)
    (survey, *_) = pipeline.push_imu(imu).surveys
    assert _gyro(survey) is None
    assert "gyro" not in survey.weights


@pytest.mark.slow
def test_a_turn_that_takes_too_long_begins_the_seek_anew(monkeypatch):
    quick = _surveys(_samples(turn_rate=TURN), _settings())[-1]
    short = dataclasses.replace(derivation.gyrocompass_params(_settings()), longest_turn_s=2.0)
    monkeypatch.setattr(derivation, "gyrocompass_params", lambda _: short)
    slow = _surveys(_samples(turn_rate=TURN), _settings())[-1]
    assert slow.weights["gyro"] < quick.weights["gyro"]
    assert _gyro(slow).sigma > 1.5 * _gyro(quick).sigma


@pytest.mark.slow
@pytest.mark.fault_case(31)
def test_near_the_pole_the_gyro_is_refused_with_the_reason():
    survey = _surveys(_samples(latitude=88.0), _settings(**{"place.lat_deg": 88.0}))[-1]
    assert _gyro(survey).refused.code is ReasonCode.LATITUDE_POLAR


def test_the_noise_is_read_off_a_tool_at_rest_whatever_the_pumps_do():
    rng, n = np.random.default_rng(2), 400
    stamps = START + np.arange(n) * (10**9 // RATE)
    unit = math.radians(1.0) / 60.0 * math.sqrt(RATE)
    quiet = 0.02 * unit * rng.normal(size=(n, 3)) + 1e-4
    assert white_noise(stamps, quiet) == pytest.approx(0.02, rel=0.1)
    # 37 Hz of pump, twenty times the noise of a sample, mostly averages out over a tenth of a second.
    shaken = quiet + 0.4 * unit * np.sin(2.0 * math.pi * 37.0 * np.arange(n) / RATE)[:, None]
    assert white_noise(stamps, shaken) < 0.1
    spoiled = quiet.copy()
    spoiled[7] = np.nan
    assert white_noise(stamps, spoiled) == pytest.approx(0.02, rel=0.1)
    assert white_noise(stamps[:20], quiet[:20]) is None


def _feed(station, streams, start_s=0.0, settled_s=2.0):
    """Samples of a tool that rests or turns quietly to a gyro station, bin by bin, from a given time on."""
    imu, precision = streams[0], streams[1]
    stamps = imu["stamp_ns"] + round(start_s * 1e9)
    values = np.hstack([imu["angular_velocity"], imu["linear_acceleration"]])
    values_p = np.hstack([precision["angular_velocity"], precision["linear_acceleration"]])
    rest = 0.0
    for closed in Binner(6, BIN_NS).add(stamps, values):
        inside = stamps // BIN_NS == closed.index
        still = bool(abs(closed.mean[0]) < 0.03)
        rest = rest + 0.5 if still else 0.0
        station.add(closed, 0.5, rest > settled_s, still, UnitSamples(stamps[inside], values_p[inside]))


def _rest(station, seconds, bias, noise=0.02, start_s=0.0, settled_s=2.0, azimuth=2.2, seed=3):
    """A tool that rests at one toolface; bias of y and of z the other way, deg/h."""
    streams = _samples(azimuth=azimuth, rest=seconds, bias=bias, seed=seed, noise=noise)
    first = tuple(stream[: round(seconds * RATE)] for stream in streams)
    _feed(station, first, start_s, settled_s)


def _station(bias=5.0, **changes):
    """A station of a unit with this bias, deg/h."""
    biases = {"gyro_bias_deg_h": bias, "gyro_x_bias_deg_h": bias, "gyro_ramp_deg_h2": 0.6 * bias}
    return GyroStation(dataclasses.replace(TACTICAL, latitude_deg=44.0, g_sensitivity_deg_h_g=0.0, **biases, **changes))


def test_a_gyro_that_fits_the_latitude_finds_north_in_one_position_and_says_how_well():
    station = _station()
    _rest(station, 122.0, 0.02, noise=0.01)
    found = station.solution()
    assert found.success, found.reason
    assert found.method == "still"
    assert abs(wrap_pi(found.azimuth - 2.2)) < math.radians(0.5)
    assert math.radians(0.25) < found.sigma < math.radians(5.0)


@pytest.mark.parametrize("latitude_deg", [-90.0, 86.0, 90.0])
def test_near_a_pole_every_station_is_refused_for_its_latitude(latitude_deg):
    station = GyroStation(dataclasses.replace(TACTICAL, latitude_deg=latitude_deg))
    # The axis lies elsewhere the second time: that seek begins with what the first has learnt.
    for start, inclination in ((0.0, 1.0), (35.0, 1.1)):
        _feed(station, tuple(stream[: 35 * RATE] for stream in _samples(inclination=inclination)), start)
        assert station.solution().reason.code is ReasonCode.LATITUDE_POLAR
        assert station.pending() is None


def test_a_refusal_states_which_seek_goes_on_behind_it():
    station = _station()
    _rest(station, 70.0, 0.02, noise=0.01)
    began_ns = station.solution().began_ns
    station.refuse(Reason(ReasonCode.TOOL_NOT_STILL), forget=False)
    assert began_ns is not None
    assert station.solution().began_ns == began_ns
    station.refuse(Reason(ReasonCode.TOOL_NOT_STILL), forget=True)
    assert station.solution().began_ns is None


def test_a_gyro_with_a_bias_gets_no_credit_for_fitting_the_latitude():
    station = _station()
    _rest(station, 122.0, 4.0, noise=0.01)
    assert not station.solution().success


def test_the_bias_that_two_positions_showed_serves_the_next_station_while_the_tool_stays_on():
    station, streams = _station(), _samples(bias=4.0)
    _feed(station, streams)
    assert station.solution().success
    end_s = len(streams[0]) / RATE
    shaken = _samples(rest=2.0, bias=4.0, turn_rate=0.5)
    shaken[0]["linear_acceleration"] += 3.0 * np.random.default_rng(1).normal(size=(len(shaken[0]), 3))
    shaken[0]["angular_velocity"][:, 0] += 1.0
    _feed(station, shaken, end_s)
    assert station.solution().reason.code is ReasonCode.TOOL_NOT_STILL
    end_s += len(shaken[0]) / RATE
    _rest(station, 42.0, 4.0, start_s=end_s, azimuth=1.0)
    found = station.solution()
    assert found.success, found.reason
    assert found.method == "still"
    assert found.sigma < math.radians(3.0)
    assert abs(wrap_pi(found.azimuth - 1.0)) < 3.0 * found.sigma
    # Switched off meanwhile: nothing of it is known any more.
    _rest(station, 42.0, 4.0, start_s=end_s + 100.0, azimuth=1.0)
    assert not station.solution().success


def test_what_the_gyro_waits_for_is_reported_until_waiting_brings_nothing():
    station = _station(0.05)
    assert station.pending() is None
    _rest(station, 10.0, 0.0)
    assert station.pending().code is ReasonCode.SEEK_TOO_SHORT
    _rest(station, 60.0, 0.0, start_s=10.0, settled_s=0.0)
    assert station.pending().code is ReasonCode.SEEK_IMPROVES
    precise = _station(0.01, gyro_noise_deg_rth=0.003)
    _rest(precise, 60.0, 0.0, noise=0.003)
    assert precise.pending() is None
    assert precise.solution().success
    blind = GyroStation(dataclasses.replace(TACTICAL, latitude_deg=math.nan))
    _rest(blind, 10.0, 0.0)
    assert blind.pending() is None

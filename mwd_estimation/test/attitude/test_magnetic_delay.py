# SPDX-License-Identifier: Apache-2.0
"""Delay of the magnetometer's stamps: found by changes of the rotary speed, corrected, and not made up."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from tool_streams import REFERENCE, START, earth_field, seen, streams

from mwd_estimation.attitude.magnetic_delay import SPAN_NS, MagneticDelay
from mwd_estimation.core.status import Status
from mwd_estimation.nodes.diagnostics import input_diagnostics
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.core.settings import from_mapping


def drilled(late_s=0.0, cross_axial=(0.0, 0.0), rates=((0.0, 12.0), (11.0, 20.0), (0.0, 8.0), (7.0, 20.0))):
    """IMU and magnetometer of a string that turns at each of the rates, rad/s, for `seconds` s each."""
    rate = np.concatenate([np.full(round(seconds * 100), value) for value, seconds in rates])
    # A string takes two seconds to change its speed.
    rate = np.convolve(np.pad(rate, 100, mode="edge"), np.full(201, 1.0 / 201.0), mode="valid")
    mat = mat_nt(0.9, np.full(len(rate), 1.9), np.cumsum(rate) * 0.01)
    imu, mag = streams(mat, np.random.default_rng(4), rate=rate)
    mag["stamp_ns"] += round(late_s * 1e9)
    mag["magnetic_field"] += [0.0, *cross_axial]
    return imu, mag


def estimated(imu, mag, cuts=(), settings=None):
    """The pipeline after all samples, its rows and its faults; magnetic samples arrive by their stamps."""
    pipeline, rows, faults = Pipeline(settings or EstimatorSettings(), REFERENCE), [], []
    edges = [START - 10**12, *(int(imu["stamp_ns"][k]) for k in cuts), START + 10**12]
    for first, last in itertools.pairwise(edges):
        pipeline.push_mag(mag[(mag["stamp_ns"] >= first) & (mag["stamp_ns"] < last)])
        output = pipeline.push_imu(imu[(imu["stamp_ns"] >= first) & (imu["stamp_ns"] < last)])
        rows.append(output.attitude)
        faults += output.health
    return pipeline, np.concatenate(rows), faults


@pytest.mark.parametrize("steel_ut", [(6.0, 5.0, 4.0), (-4.0, 6.0, 6.0), (5.0, -8.0, 2.0)])
def test_steel_that_comes_near_while_the_speed_changes_is_not_taken_for_a_delay(steel_ut):
    # The string passes steel while its speed rises, and the field turns by up to 20 deg.
    imu, mag = drilled()
    near = np.clip(imu["angular_velocity"][:, 0], 0.0, 11.0)[:, None] / 11.0
    turned = np.cumsum(imu["angular_velocity"][:, 0]) * 0.01
    mat = mat_nt(0.9, np.full(len(imu), 1.9), turned)
    mag["magnetic_field"] += near * seen(mat, 1e-6 * np.array(steel_ut))
    pipeline, _, _ = estimated(imu, mag)
    assert abs(pipeline.mag_late_ns) < 5_000_000


@pytest.mark.parametrize("inclination", [0.6, 0.9, 1.2])
@pytest.mark.parametrize(("side", "strength_uwb"), [(0.9, 400.0), (3.9, -400.0), (4.0, -400.0)])
def test_steel_that_the_string_leaves_as_it_starts_to_rotate_is_not_taken_for_a_delay(inclination, side, strength_uwb):
    # The sensor rests 1.3 m from the magnetic pole of a casing shoe, then drills away from it at 1800 m/h.
    imu, _ = drilled(rates=((0.0, 15.0), (11.5, 20.0), (0.0, 12.0)))
    stamps, rate = imu["stamp_ns"], imu["angular_velocity"][:, 0]
    mat = mat_nt(inclination, np.full(len(imu), 1.9), np.cumsum(rate) * 0.01)
    axis, right = mat[0, :, 0], np.array([-math.sin(1.9), math.cos(1.9), 0.0])
    away = math.cos(side) * right + math.sin(side) * np.cross(axis, right)
    drilled_m = np.cumsum(np.clip(rate / 11.5, 0.0, 1.0)) * 0.01 * 0.5
    from_pole = (0.5 + drilled_m)[:, None] * axis - 1.2 * away
    steel_n = strength_uwb * 1e-6 / (4.0 * math.pi) * from_pole / np.linalg.norm(from_pole, axis=1)[:, None] ** 3
    field = np.einsum("kji,kj->ki", mat, earth_field() + steel_n)
    delay = MagneticDelay()
    for begin in range(START, int(stamps[-1]), SPAN_NS):
        part = (stamps >= begin) & (stamps < begin + SPAN_NS)
        delay.take(stamps[part], mat[part, 2], rate[part])
        delay.take_mag(stamps[part], field[part])
        assert delay.judge(begin + SPAN_NS) == 0


@pytest.mark.fault_case(51)
@pytest.mark.parametrize("late_s", [0.03, 0.1, 0.25, -0.06])
def test_a_delay_is_measured_as_the_speed_changes_and_corrected(late_s):
    pipeline, rows, faults = estimated(*drilled(late_s))
    assert pipeline.mag_late_ns * 1e-9 == pytest.approx(late_s, abs=0.008)
    assert faults == []
    turning = rows[-300:]
    assert (turning["status"] & int(Status.MAG_DISTURBED) == 0).mean() > 0.95
    assert np.abs(turning["azimuth"] - 1.9).max() < 4.0 * turning["sigma_azimuth"].max()
    (shown,) = input_diagnostics(pipeline)
    assert ("late" if late_s > 0.0 else "early") in shown.message


def fails(imu, how):
    """The gyro of the string is mounted the wrong way round, stuck, sends no numbers, or clips about x at 5 rad/s."""
    rates = imu["angular_velocity"]
    if how == "reversed":
        rates *= -1.0
    elif how == "stuck":
        rates[:] = rates[0]
    elif how == "no numbers":
        rates[:] = np.nan
    else:
        rates[:, 0] = np.clip(rates[:, 0], -5.0, 5.0)


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("how", ["reversed", "stuck", "no numbers", "clipped"])
@pytest.mark.parametrize("late_s", [0.0, 0.1])
def test_the_delay_is_found_and_none_made_up_where_the_gyro_fails(how, late_s):
    imu, mag = drilled(late_s)
    fails(imu, how)
    narrow = {"tool": {"gyro": {"range_deg_s": [math.degrees(5.0), 2000.0, 2000.0]}}} if how == "clipped" else {}
    pipeline, _, _ = estimated(imu, mag, settings=from_mapping(EstimatorSettings, narrow))
    assert pipeline.mag_late_ns * 1e-9 == pytest.approx(late_s, abs=0.005)


@pytest.mark.parametrize("cross_axial", [(0.0, 0.0), (1.5e-6, -1e-6)])
def test_a_magnetometer_in_time_is_left_alone_biased_or_not(cross_axial):
    pipeline, _, _ = estimated(*drilled(cross_axial=cross_axial))
    assert pipeline.mag_late_ns == 0
    assert input_diagnostics(pipeline) == []


@pytest.mark.parametrize(("how", "every"), [({}, 100), ({"rates": ((8.0, 40.0),)}, 1)], ids=["slow", "one speed"])
def test_samples_a_second_apart_or_one_speed_show_no_delay(how, every):
    imu, mag = drilled(0.03, **how)
    assert estimated(imu[::every], mag[::every])[0].mag_late_ns == 0


@pytest.mark.parametrize("first_off", [-0.3, 0.25, 0.6])
@pytest.mark.parametrize("begins_s", [0.0, 0.07, 0.33])
def test_a_toolface_that_settles_at_one_speed_shows_no_delay(first_off, begins_s):
    # As a filter that begins in a turning string, or whose accelerometer's axes are mixed up from two seconds on.
    seconds = begins_s + np.arange(500) * 0.01
    stamps = START + np.round(seconds * 1e9).astype(np.int64)
    since = np.where(seconds < begins_s + 2.0, seconds - begins_s, seconds - begins_s - 2.0)
    truth, off = 12.57 * seconds, first_off * np.exp(-since / 0.4)
    delay = MagneticDelay()
    delay.take(stamps, np.column_stack([0.8 + 0.0 * truth, _across(truth + off)]), np.full(500, 12.57))
    delay.take_mag(stamps, 3e-5 * np.column_stack([0.0 * truth, _across(truth + 0.9)]))
    assert delay.judge(START + SPAN_NS) == 0
    assert delay.sigma_s > 0.05


def _across(angle):
    return 0.6 * np.column_stack([np.sin(angle), np.cos(angle)])


def test_the_correction_is_the_same_bits_however_the_streams_are_cut():
    imu, mag = drilled(0.1)
    whole, rows, _ = estimated(imu, mag)
    pieces, again, _ = estimated(imu, mag, range(70, len(imu), 333))
    assert whole.mag_late_ns == pieces.mag_late_ns
    assert whole.mag_late_ns != 0
    assert rows.tobytes() == again.tobytes()


def test_what_waits_stays_bounded_without_a_magnetometer():
    delay = MagneticDelay()
    for k in range(100):
        stamps = START + k * SPAN_NS + np.arange(500) * 10_000_000
        delay.take(stamps, np.tile([0.5, 0.0, 0.8], (500, 1)), np.zeros(500))
        assert delay.judge(int(stamps[-1])) == 0
        assert sum(len(part) for part, _ in delay._imu) <= 500


def test_a_delay_outlives_time_that_goes_back():
    imu, mag = drilled(0.1)
    pipeline, _, _ = estimated(imu, mag)
    known = pipeline.mag_late_ns
    pipeline.push_mag(mag[:500])
    pipeline.push_imu(imu[:500])
    assert pipeline.counters.set_back == 1
    assert pipeline.mag_late_ns == known
    pipeline.reset()
    assert pipeline.mag_late_ns == 0
    assert dataclasses.asdict(pipeline.counters)["set_back"] == 1

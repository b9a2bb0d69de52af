# SPDX-License-Identifier: Apache-2.0
"""Faulty sensors: the estimate that remains is right, and nothing wrong carries a small sigma once a fault is named."""

from __future__ import annotations

import dataclasses
import functools
from types import SimpleNamespace

import numpy as np
import pytest
from tool_streams import place_of

from consistency import assert_consistent
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, MAG, FaultCode, FaultUnit, SensorFault
from mwd_estimation.core.status import Status
from mwd_estimation.core.time_bins import Average
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.tool import Accelerometer, Tool
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.static_survey import StillAverage
from mwd_sensors.core.frames import wrap_pi
from simulated_sonde import simulated

pytestmark = pytest.mark.slow(0.7)

SCHEDULE = [
    {"kind": "drill", "seconds": 34.0, "rpm": 100.0, "rop_m_h": 0.0},
    {"kind": "still", "seconds": 32.0, "pumps": False},
]
FAULT = int(Status.SENSOR_FAULT)


@functools.cache
def sent(component, word, axis="all", start_s=0.0, seconds=1e9, seed=1):
    fault = {"component": component, "fault": word, "axis": axis, "start_s": start_s, "seconds": seconds}
    streams, sonde = simulated("bench/drillvib", schedule=SCHEDULE, faults=[fault], seed=seed)
    return {topic: streams[topic] for topic in ("imu/mag", "imu/data_raw", "truth")}, sonde.reference


def estimated(case, cut=10**9):
    streams, field = case
    # A tool that was calibrated before the run.
    tool = Tool(accelerometer=Accelerometer(bias_ug=0.0, scale_ppm=0.0, misalignment_mrad=0.15))
    pipeline, output = Pipeline(EstimatorSettings(tool=tool, place=place_of(field))), Output.empty(0)
    imu, mag, place = streams["imu/data_raw"], streams["imu/mag"], 0
    for start in range(0, len(imu), cut):
        block = imu[start : start + cut]
        stop = int(np.searchsorted(mag["stamp_ns"], block["stamp_ns"][-1], side="right"))
        pipeline.push_mag(mag[place:stop])
        place = stop
        output = output.joined(pipeline.push_imu(block))
    return output, pipeline


def tilt_errors(output, streams):
    """Of inclination, rad, where a sigma is given, after the fault was named; and those sigmas."""
    truth, rows = streams["truth"], output.attitude
    named = rows["status"] & FAULT != 0
    given = named & np.isfinite(rows["sigma_inclination"])
    return rows["inclination"][given] - truth["inclination"][given], rows["sigma_inclination"][given], named


@pytest.mark.parametrize("cut", [50, 2000])
@pytest.mark.parametrize(("doubted_s", "has_a_say"), [((16.5,), False), ((6.0, 16.5), True), ((1.0, 16.5), False)])
def test_a_survey_in_a_turning_string_is_judged_by_the_doubts_up_to_its_end(doubted_s, has_a_say, cut):
    survey = SimpleNamespace(average=SimpleNamespace(start_ns=5 * 10**9), end_ns=15 * 10**9, weights={})
    stamps = np.arange(0, 20 * 10**9, 10**7)
    suspect = np.where(np.isin(stamps, np.array(doubted_s) * 1e9), np.uint8(ACCEL), np.uint8(0))
    faults = FaultHistory()
    for start in range(0, len(stamps), cut):
        faults.doubt(stamps[start : start + cut], suspect[start : start + cut])
    assert (faults.against(survey, 0) is not None) == has_a_say
    assert faults.against(survey) is not None


@pytest.mark.fault_case(2)
@pytest.mark.parametrize(
    ("component", "word", "axis", "bit"),
    [
        ("gyro", "flipped", "x", GYRO),
        ("gyro", "in_deg_s", "all", GYRO),
        ("gyro", "off", "all", GYRO),
        ("accel", "swapped", "xy", ACCEL),
        ("accel", "in_g", "all", ACCEL),
        ("accel", "flipped", "all", ACCEL),
        ("mag", "swapped", "xy", MAG),
        ("mag", "in_gauss", "all", MAG),
        ("mag", "stuck", "all", MAG),
    ],
)
def test_once_named_a_fault_withholds_what_hangs_on_it_and_leaves_the_rest(component, word, axis, bit):
    case = sent(component, word, axis)
    output, pipeline = estimated(case)
    errors, sigmas, named = tilt_errors(output, case[0])
    assert np.argmax(named) < 1100
    assert named[1100:].all()
    assert any(one.unusable & bit for one in pipeline.sensor_faults)
    rows = output.attitude[1100:]
    if bit == ACCEL:
        assert np.isnan(rows["sigma_inclination"]).all()
        assert np.isnan(rows["sigma_gravity_toolface"]).all()
    else:
        assert len(errors)
        assert np.mean(np.abs(errors) < 3.0 * sigmas) > 0.97
        still = output.attitude[-1000:]
        assert np.all(still["sigma_inclination"] < np.radians(1.0))
    if bit in (ACCEL, MAG):
        assert np.isnan(rows["sigma_azimuth"]).all()
        assert output.surveys
        assert all(one.station.verdict == "reject" for one in output.surveys)
        assert ReasonCode.SENSOR_FAULT in {one.code for one in output.surveys[-1].station.reasons}
    else:
        truth = case[0]["truth"][-500:]
        known = output.attitude[-500:]
        assert np.all(known["sigma_azimuth"] > 0.0)
        off = np.abs(wrap_pi(known["azimuth"] - truth["azimuth"]))
        assert np.mean(off < 3.0 * known["sigma_azimuth"]) > 0.97


@pytest.mark.parametrize(
    ("component", "word", "axis", "start_s"),
    [
        ("gyro", "swapped", "xy", 0.0),
        ("accel", "in_g", "all", 0.0),
        ("accel", "stuck", "all", 12.1),
        ("gyro", "in_deg_s", "all", 12.1),
        ("mag", "in_nt", "all", 12.1),
    ],
)
def test_before_a_fault_is_named_its_numbers_are_not_called_certain_for_long(component, word, axis, start_s):
    case = sent(component, word, axis, start_s)
    rows, truth = estimated(case)[0].attitude, case[0]["truth"]
    named = int(np.argmax(rows["status"] & FAULT != 0))
    doubted = rows["status"] & int(Status.SENSOR_SUSPECT) != 0
    assert doubted[:named].any()
    assert not doubted[: round(100.0 * start_s)].any()
    for name in ("inclination", "gravity_toolface", "azimuth"):
        off = np.abs(wrap_pi(rows[name] - truth[name][: len(rows)]))
        wrong = (off > np.maximum(4.0 * rows[f"sigma_{name}"], 0.02)) & np.isfinite(rows[f"sigma_{name}"])
        assert np.count_nonzero(wrong[:named]) <= 100, name
    level = doubted if component != "mag" else np.zeros_like(doubted)
    known = np.isfinite(rows["sigma_inclination"])
    assert np.all(rows["sigma_inclination"][level & known] == np.pi)
    assert np.all(rows["sigma_azimuth"][doubted & np.isfinite(rows["sigma_azimuth"])] == np.pi)


def test_a_survey_whose_time_a_doubt_touches_is_doubtful_with_the_reason():
    record = FaultHistory()
    stamps = np.arange(400) * 10_000_000
    survey = estimated(sent("temperature", "ok"))[0].surveys[0]
    average = dataclasses.replace(survey.average, start_ns=6_000_000_000, end_ns=14_000_000_000)
    at = dataclasses.replace(survey, average=average)
    assert record.judge(at) is at
    suspect = np.where(stamps >= 3_000_000_000, ACCEL, 0).astype(np.uint8)
    # At 13 s: begun two seconds after its end, by evidence of its time. A survey at rest is judged late enough for it.
    for shift, at_its_end, later in ((0, False, False), (4, True, True), (13, False, True), (18, False, False)):
        record = FaultHistory()
        record.doubt(stamps + shift * 10**9, suspect)
        judged, against = record.judge(at).station, record.against(at)
        assert (judged.verdict == "doubtful") == at_its_end, shift
        assert (against is not None) == later, shift
        if at_its_end:
            assert judged.reasons[0] == Reason(ReasonCode.SENSOR_SUSPECT, names=("accelerometer",))
        if against is not None:
            assert against.judge(at).station.verdict == "doubtful"


def fault_of(code, sensor, place, since_ns, cleared_ns=0):
    """A fault of the conventional unit."""
    none = (0, 0, 0)
    return SensorFault(code, FaultUnit.CONVENTIONAL, place, 0.0, 0.0, none, sensor, since_ns, cleared_ns=cleared_ns)


def test_a_failed_magnetometer_is_no_reading_and_does_not_touch_a_gyro_azimuth():
    survey = estimated(sent("temperature", "ok"))[0].surveys[0]
    half = survey.end_ns - survey.stamp_ns
    imu, mag = Average(np.zeros(6), np.eye(6), 400), Average(np.ones(3), np.eye(3), 400)
    still = StillAverage(survey.stamp_ns - half, survey.stamp_ns + half, imu, mag, None, None, requested=False)
    failed = fault_of(FaultCode.STUCK, MAG, 6, survey.stamp_ns)
    gone = dataclasses.replace(failed, cleared_ns=survey.stamp_ns - half)
    by_gyro = dataclasses.replace(survey, weights={"raw": 0.0, "gyro": 1.0})
    shared = dataclasses.replace(survey, weights={"raw": 0.3, "gyro": 0.7})
    for change, reads in ((failed, False), (gone, True)):
        record = FaultHistory()
        record.note(change)
        assert (record.readable(still).mag is not None) == reads
        assert record.judge(by_gyro) is by_gyro
        for rests_on_it in (survey, shared):
            assert (record.judge(rests_on_it).station.verdict == "reject") != reads
    record.note(dataclasses.replace(failed, place=3, unusable=ACCEL))
    assert record.judge(by_gyro).station.verdict == "reject"


def test_a_fault_that_ended_during_a_survey_is_reported_with_how_long_it_lasted():
    survey = estimated(sent("temperature", "ok"))[0].surveys[0]
    begin, record = survey.average.start_ns, FaultHistory()
    dead = fault_of(FaultCode.DEAD, ACCEL, 3, begin, cleared_ns=begin + 25 * 10**8)
    record.note(dead)
    station = record.judge(survey).station
    assert station.verdict == "reject"
    ended = Reason(ReasonCode.SENSOR_FAULT_ENDED, 2.5, fault=dataclasses.replace(dead, cleared_ns=0))
    assert station.reasons[0] == ended


def test_a_field_that_no_tool_meets_is_not_used_and_stops_nothing():
    output, pipeline = estimated(sent("mag", "in_nt"))
    assert pipeline.counters.rejected >= 6000
    assert len(output.attitude)
    assert any(one.code == FaultCode.UNIT for one in pipeline.sensor_faults)


def test_when_a_fault_has_gone_the_estimate_begins_anew_and_is_right():
    errors, sigmas = [], []
    for seed in range(1, 5):
        case = sent("accel", "stuck", "y", 10.0, 10.0, seed)
        output, pipeline = estimated(case)
        assert [one.code for one in output.health] == [FaultCode.STUCK, FaultCode.STUCK]
        assert pipeline.sensor_faults == []
        rows, truth = output.attitude, case[0]["truth"]
        named = rows["status"] & FAULT != 0
        assert 1200 < np.argmax(named) < 1400
        assert not named[2400:].any()
        errors.append((rows["inclination"] - truth["inclination"])[3000:])
        sigmas.append(rows["sigma_inclination"][3000:])
        reasons = {one.station.reasons[0].code for one in output.surveys if one.station.verdict == "reject"}
        assert not reasons & {ReasonCode.SENSOR_FAULT, ReasonCode.SENSOR_FAULT_ENDED}
    assert_consistent(np.stack(errors), np.stack(sigmas), correlated=True, name="inclination")


def spoilt(how, start):
    """Streams of a sound tool whose magnetometer gives out at an IMU sample while it turns; the reference."""
    streams, field = sent("temperature", "ok")
    mag = streams["imu/mag"].copy()
    after = mag["stamp_ns"] >= streams["imu/data_raw"]["stamp_ns"][start]
    last = mag["magnetic_field"][int(np.argmax(after))].copy()
    values = {"no numbers": np.nan, "zeros": 0.0, "frozen": last}
    if how == "one axis":
        mag["magnetic_field"][after, 1] = last[1]
    else:
        mag["magnetic_field"][after] = values[how]
    return {**streams, "imu/mag": mag}, field


@pytest.mark.parametrize("how", ["no numbers", "zeros", "frozen", "one axis"])
def test_a_magnetometer_that_gives_out_leaves_the_azimuth_to_the_gyros(how):
    case = spoilt(how, 2000)
    output, pipeline = estimated(case)
    assert any(one.unusable == MAG for one in pipeline.sensor_faults)
    rows, truth = output.attitude, case[0]["truth"]
    named = np.flatnonzero(rows["status"] & FAULT != 0)
    assert named[0] < 2500
    assert np.all(rows["sigma_azimuth"][named] > 0.0)
    off = wrap_pi(rows["azimuth"] - truth["azimuth"][: len(rows)])[named]
    assert np.all(np.abs(off) < 3.0 * rows["sigma_azimuth"][named])
    assert np.all(rows["sigma_azimuth"][named] < np.radians(8.0))
    assert np.all(rows["status"][named[500:]] & int(Status.GYRO_AIDED) != 0)


def test_one_that_gave_out_before_the_azimuth_had_a_sound_one_takes_it_along():
    rows = estimated(spoilt("one axis", 300))[0].attitude
    named = rows["status"] & FAULT != 0
    assert named.any()
    assert np.isnan(rows["sigma_azimuth"][named]).all()


@pytest.mark.parametrize(
    ("make", "cut", "count"),
    [
        (lambda: sent("gyro", "flipped", "x"), 1, 800),
        (lambda: sent("gyro", "flipped", "x"), 37, 2400),
        (lambda: spoilt("one axis", 1400), 37, 2400),
        pytest.param(lambda: spoilt("one axis", 1400), 1, 2400, marks=pytest.mark.nightly),
    ],
)
def test_the_same_bits_come_out_however_the_samples_are_cut(make, cut, count):
    case = make()
    whole, _ = estimated(case)
    streams = {topic: samples[:count] for topic, samples in case[0].items()}
    parts, _ = estimated((streams, case[1]), cut)
    assert parts.attitude.tobytes() == whole.attitude[:count].tobytes()
    assert parts.gravity.tobytes() == whole.gravity[:count].tobytes()
    assert parts.health == [one for one in whole.health if one.since_ns < streams["truth"]["stamp_ns"][-1]]


def test_surveys_have_the_same_reasons_however_the_samples_are_cut():
    case = sent("mag", "swapped", "xy")
    whole, _ = estimated(case)
    parts, _ = estimated(case, 53)
    assert parts.attitude.tobytes() == whole.attitude.tobytes()
    assert [one.station.reasons for one in parts.surveys] == [one.station.reasons for one in whole.surveys]

# SPDX-License-Identifier: Apache-2.0
"""Every latch has a way back: a fault that ends leaves the estimate of a healthy tool, and is past, not present."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.sensor_fault import FaultCode, FaultUnit
from mwd_estimation.core.status import Status
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.simulator import faults, scenario
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

pytestmark = pytest.mark.slow(0.8)

TOPICS = ("imu/mag", "gyro/data_raw", "imu/temperature", "imu/data_raw")
SCHEDULE = [
    {"kind": "drill", "seconds": 70.0, "rpm": 100.0, "rop_m_h": 0.0},
    {"kind": "still", "seconds": 60.0, "pumps": False},
]
# Start and end of the fault, s; time after its end from which the output equals that of a healthy run, s.
BEGINS, ENDS, AFTER = 15.0, 32.0, 30.0
BLOCK_S = 5.0


@functools.cache
def sent(name="drillvib"):
    changes = {"schedule": SCHEDULE, "faults": [], "precision": {"grade": "tactical_north"}}
    sonde = Sonde(scenario.read(SCENARIOS / "bench" / f"{name}.yaml", changes))
    blocks = list(sonde.blocks(10.0))
    return {topic: np.concatenate([block[topic] for block in blocks]) for topic in TOPICS}, sonde.reference


def seconds(samples):
    return (samples["stamp_ns"] - sent()[0]["imu/data_raw"]["stamp_ns"][0]) * 1e-9


def estimated(streams, come=None, place=None):
    """Return the output for streams in blocks; come: times of arrival by topic, where other than the stamps."""
    field = sent()[1]
    place = place or Place(
        field="fixed",
        total_nt=field.total * 1e9,
        dip_deg=np.degrees(field.dip),
        declination_deg=np.degrees(field.declination),
        lat_deg=38.0,
    )
    pipeline, output = Pipeline(EstimatorSettings(place=place)), Output.empty(0)
    arrival = {topic: (come or {}).get(topic, seconds(samples)) for topic, samples in streams.items()}
    pushes = (pipeline.push_mag, pipeline.push_precision, pipeline.push_temperature)
    end = max(float(times.max()) for times in arrival.values())
    for start in np.arange(0.0, end + BLOCK_S, BLOCK_S):
        now = {t: samples[(arrival[t] >= start) & (arrival[t] < start + BLOCK_S)] for t, samples in streams.items()}
        for push, topic in zip(pushes, TOPICS[:3], strict=True):
            push(now[topic])
        output = output.joined(pipeline.push_imu(now["imu/data_raw"]))
    return output.joined(pipeline.finish()), pipeline


@functools.cache
def healthy(name="drillvib"):
    return estimated(sent(name)[0])


def _refusal(station):
    refused = station.by_method("gyro").refused
    return None if refused is None else refused.code


def assert_back(output, pipeline, name="drillvib", after=ENDS + AFTER):
    """Nothing stands, what was named has ended, and the estimate is that of a healthy run within its sigma."""
    clean, _ = healthy(name)
    assert pipeline.sensor_faults == []
    began = [one.check for one in output.health if not one.cleared_ns]
    assert {one.check for one in output.health if one.cleared_ns} == set(began)
    places = np.searchsorted(clean.attitude["stamp_ns"], output.attitude["stamp_ns"])
    late = seconds(output.attitude) > after
    rows, others = output.attitude[late], clean.attitude[np.minimum(places[late], len(clean.attitude) - 1)]
    assert not (rows["status"] & (Status.SENSOR_FAULT | Status.NO_MAG)).any()
    for field in ("inclination", "azimuth"):
        sigma = rows[f"sigma_{field}"]
        assert (sigma > 0.0).all()
        assert (np.abs(wrap_pi(rows[field] - others[field])) < 3.0 * np.hypot(sigma, others[f"sigma_{field}"])).all()
    assert len(output.surveys) == len(clean.surveys) > 0
    last, expected = output.surveys[-1].station, clean.surveys[-1].station
    assert last.verdict == expected.verdict
    assert abs(wrap_pi(last.azimuth - expected.azimuth)) < 3.0 * np.hypot(last.sigma_azimuth, expected.sigma_azimuth)
    # The precision unit is used again.
    assert _refusal(last) == _refusal(expected)
    return began


CASES = [
    ("accel", "stuck", "x", FaultCode.STUCK),
    pytest.param("accel", "stuck", "all", FaultCode.DEAD, marks=pytest.mark.nightly),
    ("accel", "nan", "all", FaultCode.INVALID),
    ("accel", "garbage", "all", FaultCode.NOISE),
    pytest.param("accel", "in_g", "all", FaultCode.UNIT, marks=pytest.mark.nightly),
    ("accel", "saturated", "z", FaultCode.SATURATED),
    ("accel", "flipped", "y", FaultCode.AXES),
    ("accel", "flipped", "all", FaultCode.SIGN),
    pytest.param("gyro", "nan", "all", FaultCode.INVALID, marks=pytest.mark.nightly),
    ("gyro", "in_deg_s", "all", FaultCode.UNIT),
    ("gyro", "flipped", "x", FaultCode.AXES),
    ("mag", "off", "all", FaultCode.SILENT),
    ("mag", "stuck", "all", FaultCode.DEAD),
    pytest.param("mag", "garbage", "all", FaultCode.NOISE, marks=pytest.mark.nightly),
    ("mag", "in_nt", "all", FaultCode.UNIT),
    pytest.param("mag", "in_gauss", "all", FaultCode.UNIT, marks=pytest.mark.nightly),
    ("mag", "flipped", "all", FaultCode.SIGN),
    ("mag", "swapped", "yz", FaultCode.AXES),
    pytest.param("precision_gyro", "stuck", "y", FaultCode.STUCK, marks=pytest.mark.nightly),
    ("precision_gyro", "nan", "all", FaultCode.INVALID),
    pytest.param("precision_gyro", "in_deg_s", "all", FaultCode.UNIT, marks=pytest.mark.nightly),
    ("precision_gyro", "garbage", "all", None),
    ("precision_gyro", "flipped", "x", FaultCode.AXES),
    ("precision_gyro", "repeated_stamps", "all", FaultCode.STAMPS),
    ("precision_accel", "in_g", "all", FaultCode.UNIT),
    ("precision_accel", "delayed", "all", None),
    pytest.param("precision_accel", "garbage", "all", None, marks=pytest.mark.nightly),
]


@pytest.mark.parametrize(("component", "word", "axis", "code"), CASES)
def test_a_fault_that_ends_leaves_no_trace(component, word, axis, code):
    streams = dict(sent()[0])
    topic = faults.COMPONENTS[component][0]
    fault = Fault(component, word, axis, start_s=BEGINS, seconds=ENDS - BEGINS)
    state = faults.start([fault], np.random.default_rng(1))
    streams[topic] = faults.spoil(state, topic, streams[topic], seconds(streams[topic]))[0]
    output, pipeline = estimated(streams)
    began = assert_back(output, pipeline)
    if code is not None:
        assert int(code) in {check % 1000 // 9 for check in began}


@pytest.mark.fault_case(48)
@pytest.mark.parametrize(
    ("name", "until_s"),
    [
        ("drillvib", 32.0),
        ("stickslip", 1e9),
        pytest.param("drillvib", 1e9, marks=pytest.mark.nightly),
        pytest.param("vib50", 1e9, marks=pytest.mark.nightly),
    ],
)
def test_loss_of_a_third_is_held_against_no_sensor(name, until_s):
    rng, streams = np.random.default_rng(5), dict(sent(name)[0])
    for topic in ("imu/mag", "gyro/data_raw", "imu/data_raw"):
        lost = (rng.random(len(streams[topic])) < 0.3) & (seconds(streams[topic]) < until_s)
        streams[topic] = streams[topic][~lost]
    output, pipeline = estimated(streams)
    assert output.health == []
    assert pipeline.sensor_faults == []
    assert all(_refusal(one.station) in (None, ReasonCode.GYRO_BIAS_UNKNOWN) for one in output.surveys)


@pytest.mark.fault_case(9)
@pytest.mark.parametrize(
    ("axis", "rate"),
    [
        (0, 0.05),
        (1, 0.02),
        pytest.param(2, 0.3, marks=pytest.mark.nightly),
        pytest.param(1, 0.1, marks=pytest.mark.nightly),
        pytest.param(1, 0.6, marks=pytest.mark.nightly),
    ],
)
def test_a_gyro_that_drifts_is_named_at_rest_and_the_healthy_unit_stays_in_use(axis, rate):
    streams = dict(sent()[0])
    imu = streams["imu/data_raw"] = streams["imu/data_raw"].copy()
    imu["angular_velocity"][:, axis] += rate * np.clip((seconds(imu) - 20.0) / 20.0, 0.0, 1.0)
    output, pipeline = estimated(streams)
    assert [(one.unit, one.code) for one in pipeline.sensor_faults] == [(FaultUnit.CONVENTIONAL, FaultCode.REST_RATE)]
    assert len(output.surveys) == 1
    station = output.surveys[-1].station
    assert station.verdict == "accept"
    assert _refusal(station) in (None, ReasonCode.GYRO_BIAS_UNKNOWN)
    # The azimuth that the gyro carried astray is not kept: the field gives it anew.
    late = seconds(output.attitude) > 100.0
    rows, others = output.attitude[late], healthy()[0].attitude[late]
    assert (rows["sigma_azimuth"] > 0.0).all()
    assert (np.abs(wrap_pi(rows["azimuth"] - others["azimuth"])) < 3.0 * rows["sigma_azimuth"]).all()


def test_a_gyro_that_has_drifted_and_is_replaced_is_used_again():
    streams = dict(sent()[0])
    imu = streams["imu/data_raw"] = streams["imu/data_raw"].copy()
    time_s = seconds(imu)
    imu["angular_velocity"][:, 1] += 0.1 * ((time_s > 75.0) & (time_s < 95.0))
    output, pipeline = estimated(streams)
    assert [(one.code, bool(one.cleared_ns)) for one in output.health if one.unit == FaultUnit.CONVENTIONAL] == [
        (FaultCode.REST_RATE, False),
        (FaultCode.REST_RATE, True),
    ]
    assert pipeline.sensor_faults == []
    assert not (output.attitude["status"][-500:] & Status.SENSOR_FAULT).any()


@pytest.mark.fault_case(51)
@pytest.mark.parametrize(
    ("topic", "off", "one"),
    [
        ("imu/mag", 5.0, True),
        ("imu/mag", -12.0, False),
        ("gyro/data_raw", 1e8, True),
        ("gyro/data_raw", 12.0, False),
        *(
            pytest.param("imu/mag", *one, marks=pytest.mark.nightly)
            for one in ((1e8, True), (12.0, False), (3600.0, False))
        ),
        *(
            pytest.param("gyro/data_raw", *one, marks=pytest.mark.nightly)
            for one in ((5.0, True), (-12.0, False), (3600.0, False))
        ),
    ],
)
def test_stamps_that_were_wrong_leave_no_trace(topic, off, one):
    streams = dict(sent()[0])
    samples = streams[topic] = streams[topic].copy()
    time_s = seconds(samples)
    hit = (time_s >= BEGINS) & (time_s < ENDS)
    hit = np.arange(len(hit)) == hit.argmax() if one else hit
    samples["stamp_ns"][hit] += round(off * 1e9)
    output, pipeline = estimated(streams, {topic: time_s})
    assert_back(output, pipeline)


def test_an_accelerometer_that_was_reversed_without_a_reference_points_down_again_while_the_string_turns():
    streams = dict(sent()[0])
    for topic in ("imu/data_raw", "gyro/data_raw"):
        samples = streams[topic] = streams[topic].copy()
        hit = (seconds(samples) >= BEGINS) & (seconds(samples) < ENDS)
        samples["linear_acceleration"][hit] *= -1.0
    output, pipeline = estimated(streams, place=Place(lat_deg=38.0))
    found = [(one.code, bool(one.cleared_ns)) for one in output.health if one.unit == FaultUnit.CONVENTIONAL]
    assert found == [(FaultCode.POINTS_UP, False), (FaultCode.POINTS_UP, True)]
    assert pipeline.sensor_faults == []
    clean = healthy()[0].attitude
    late = seconds(output.attitude) > ENDS + AFTER
    error = np.abs(output.attitude["inclination"] - clean["inclination"])[late]
    assert (error < 3.0 * np.hypot(output.attitude["sigma_inclination"], clean["sigma_inclination"])[late]).all()


def test_a_rate_that_was_set_is_the_usual_one_after_half_a_minute():
    streams = dict(sent()[0])
    imu = streams["imu/data_raw"]
    kept = (seconds(imu) < BEGINS) | (np.arange(len(imu)) % 2 == 0)
    streams["imu/data_raw"] = imu[kept]
    output, pipeline = estimated(streams)
    assert [(one.code, bool(one.cleared_ns)) for one in output.health] == [
        (FaultCode.RATE, False),
        (FaultCode.RATE, True),
    ]
    assert output.health[1].cleared_ns - output.health[0].since_ns < 40 * 10**9
    assert pipeline.sensor_faults == []


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda rates: np.random.default_rng(1).uniform(-35.0, 35.0, rates.shape), FaultCode.NOISE),
        (lambda rates: np.random.default_rng(1).uniform(-0.5, 0.5, rates.shape), FaultCode.ADRIFT),
        (lambda rates: rates * np.array([0.3, 1.0, 1.0]), FaultCode.ADRIFT),
    ],
)
def test_a_gyro_that_does_not_turn_as_the_tool_does_is_named_and_hardly_spoils_a_value(wrong, code):
    clean, _ = healthy()
    streams = dict(sent()[0])
    imu = streams["imu/data_raw"] = streams["imu/data_raw"].copy()
    hit = (seconds(imu) >= BEGINS) & (seconds(imu) < ENDS)
    imu["angular_velocity"][hit] = wrong(imu["angular_velocity"][hit])
    output, _ = estimated(streams)
    found = [one for one in output.health if one.unit == FaultUnit.CONVENTIONAL and not one.cleared_ns]
    assert code in {one.code for one in found}
    assert {one.unusable for one in found} == {1}
    ended = [one for one in output.health if one.code == code and one.cleared_ns]
    assert ended
    # From two seconds on, when it is in doubt at the latest.
    late = (seconds(imu) >= BEGINS + 2.0) & (seconds(imu) < ENDS)
    for field in ("inclination", "azimuth"):
        sigma = output.attitude[f"sigma_{field}"]
        error = np.abs(wrap_pi(output.attitude[field] - clean.attitude[field]))
        known = late & np.isfinite(sigma) & np.isfinite(error)
        # Unknown angles count as correct: while the tool turns, the azimuth is unknown if no gyro can be used.
        assert (error[known] > 4.0 * sigma[known] + 0.01).sum() < 0.06 * late.sum(), field


def test_random_rates_of_the_precision_unit_do_not_carry_the_azimuth():
    clean, _ = healthy()
    streams = dict(sent()[0])
    fine = streams["gyro/data_raw"] = streams["gyro/data_raw"].copy()
    hit = (seconds(fine) >= BEGINS) & (seconds(fine) < ENDS)
    fine["angular_velocity"][hit] = np.random.default_rng(1).uniform(-1.7, 1.7, (int(hit.sum()), 3))
    output, _ = estimated(streams)
    sigma = output.attitude["sigma_azimuth"]
    error = np.abs(wrap_pi(output.attitude["azimuth"] - clean.attitude["azimuth"]))
    known = np.isfinite(sigma) & np.isfinite(error)
    assert (error[known] <= 3.0 * sigma[known]).all()

# SPDX-License-Identifier: Apache-2.0
"""Sonde: the same bytes however it is asked, and readings that invert to the truth."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.core import frames, wire
from mwd_sensors.simulator import scenario, steering
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS
from simulated_sonde import samples_of, simulated

SHORT = {
    "schedule": [
        {"kind": "still", "seconds": 2.0, "pumps": False},
        {"kind": "drill", "seconds": 4.0, "rpm": 120.0, "rop_m_h": 360.0},
        {"kind": "still", "seconds": 2.0, "pumps": False},
    ]
}
STILL = {"schedule": [{"kind": "still", "seconds": 4.0, "pumps": False}]}
IDEAL = {"ahrs": {"grade": "ideal", "output": "sampled"}, "precision": {"grade": "ideal"}}


def run(name="default", **changes):
    samples, sonde = simulated(name, **changes)
    return sonde, samples


def sonde_of(name="default", **changes):
    return Sonde(scenario.read(SCENARIOS / f"{name}.yaml", changes))


@functools.cache
def short():
    """The sonde of the short run, and its samples, which no test changes."""
    return run(**SHORT)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["default", "faults", "bench/shocks"])
def test_the_same_bytes_come_out_whatever_the_block_length(name):
    changes = dict(SHORT)
    if name == "faults":
        changes["faults"] = [
            {"component": component, "fault": word, "start_s": 0.5 * k, "seconds": 1.3}
            for k, word in enumerate(("stuck", "garbage", "delayed", "intermittent", "slow"))
            for component in ("gyro", "accel")
        ]
        changes["link"] = {
            "loss": 0.05,
            "duplicates": 0.05,
            "reorder": 0.05,
            "clock_jump_at_s": 4.0,
            "clock_jump_s": 9.0,
        }
    whole, *others = (samples_of(sonde_of(name, **changes), block_s=seconds) for seconds in (1.0, 0.01, 0.37, 100.0))
    for other in others:
        for topic in wire.SONDE_TOPICS:
            assert whole[topic].tobytes() == other[topic].tobytes(), topic


@pytest.mark.slow
def test_the_same_seed_is_the_same_run_and_another_is_another():
    first, again, other = (run(**SHORT, seed=seed)[1]["imu/data_raw"].tobytes() for seed in (1, 1, 2))
    assert first == again != other


@pytest.mark.fault_case(57)
def test_a_tool_that_is_started_again_has_the_same_motion_and_no_sample_of_before():
    """The estimator took the repeated noise for a buffer sent twice, and marked the sonde faulty for minutes."""
    story = scenario.read(SCENARIOS / "default.yaml", STILL)
    starts = [samples_of(Sonde(story, starts_before=start)) for start in range(3)]
    for before, after in itertools.combinations(starts, 2):
        for name in ("position", "orientation"):
            assert before["truth"][name].tobytes() == after["truth"][name].tobytes()
        # A sensor with a coarse step repeats single numbers, but never the six of an IMU sample.
        same = [
            (before["imu/data_raw"][field] == after["imu/data_raw"][field]).all(axis=1)
            for field in ("angular_velocity", "linear_acceleration")
        ]
        assert not (same[0] & same[1]).any()
        for topic, field in (("gyro/data_raw", "angular_velocity"), ("imu/mag", "magnetic_field")):
            assert (before[topic][field] == after[topic][field]).all(axis=1).mean() < 0.1, topic


@pytest.mark.parametrize(
    ("topic", "field", "expected"),
    [
        ("imu/data_raw", "angular_velocity", [12.569747550620397, 0.0036198468590499934, 0.008549127289161573]),
        ("imu/data_raw", "linear_acceleration", [-9.813208107667432, 0.817136010630007, 3.1559590740751284]),
        ("gyro/data_raw", "angular_velocity", [5.235987588818406, 0.004327796028850754, 0.0036551336869903727]),
        ("imu/mag", "magnetic_field", [5.1525000000000006e-05, 2.1150000000000002e-05, -1.3000000000000001e-05]),
        ("truth", "position", [18.847510643669523, 18.372103030746732, 54.012352725413926]),
    ],
)
def test_an_old_seed_keeps_its_meaning(topic, field, expected):
    # Recorded once: a change here is a change of every run that people have made, and belongs into the change log.
    assert_allclose(short()[1][topic][field][500], expected, rtol=1e-9)


def test_a_noise_free_sonde_at_rest_is_inverted_to_1e_9():
    sonde, out = run(**STILL, **IDEAL, interference={})
    imu, mag, truth = out["imu/data_raw"], out["imu/mag"], out["truth"]
    f_t, b_t = imu["linear_acceleration"], mag["magnetic_field"]
    assert_allclose(frames.inclination(f_t), truth["inclination"], atol=1e-9)
    assert_allclose(frames.gravity_toolface(f_t), truth["gravity_toolface"], atol=1e-9)
    mat_n = frames.mat_nt(truth["inclination"], 0.0, truth["gravity_toolface"])
    level = np.einsum("nij,nj->ni", mat_n, b_t)
    azimuth = np.arctan2(-level[:, 1], level[:, 0]) + sonde.reference.declination
    assert_allclose(frames.wrap_pi(azimuth - truth["azimuth"]), 0.0, atol=1e-9)
    assert_allclose(np.linalg.norm(b_t, axis=1), sonde.reference.total, rtol=1e-12)
    # Level axes turned by the azimuth: the Earth rate is all that the gyros feel.
    mat_nt = frames.mat_nt(truth["inclination"], truth["azimuth"], truth["gravity_toolface"])
    rate_n = np.einsum("nij,nj->ni", mat_nt, out["gyro/data_raw"]["angular_velocity"])
    lat = np.radians(sonde.scenario.place.latitude_deg)
    assert_allclose(rate_n, 7.292115e-5 * np.array([[np.cos(lat), 0.0, -np.sin(lat)]] * len(rate_n)), atol=1e-13)


def test_noise_free_readings_carry_the_attitude_through_drilling():
    sonde, out = run(**SHORT, ahrs={"grade": "ideal"}, precision=None)
    truth, imu = out["truth"], out["imu/data_raw"]
    mat_en = frames.mat_from_quat(truth["orientation"])
    dt = 1.0 / sonde.scenario.rate_hz
    turned = frames.mat_from_quat(frames.quat_from_rotvec(imu["angular_velocity"][1:] * dt))
    # Against inertial space; the Earth's turn of 7 urad in 0.1 s is inside the tolerance of one step.
    predicted = mat_en[:-1] @ turned
    error = np.abs(predicted - mat_en[1:]).max(axis=(1, 2))
    assert error.max() < 1e-4
    # Integrated specific force and gravity give the change of the true velocity.
    down = np.array([0.0, 0.0, sonde.reference.gravity])
    mat_ne = frames.MAT_EN @ mat_en
    change = np.cumsum(np.einsum("nij,nj->ni", mat_ne[1:], imu["linear_acceleration"][1:]) + down, axis=0) * dt
    assert_allclose(change, truth["velocity"][1:] - truth["velocity"][0], atol=0.01)
    assert np.abs(truth["velocity"]).max() > 0.1


@pytest.mark.slow
def test_the_noise_is_that_of_the_grade():
    _, out = run(schedule=[{"kind": "still", "seconds": 60.0, "pumps": False}])
    gyro = out["imu/data_raw"]["angular_velocity"]
    # 0.007 deg/s/sqrt(Hz) in the 50 Hz band of samples averaged over 10 ms.
    assert_allclose(np.degrees(np.diff(gyro, axis=0).std(axis=0)) / np.sqrt(2.0), 0.07, rtol=0.06)
    accel = out["imu/data_raw"]["linear_acceleration"]
    assert_allclose(np.diff(accel, axis=0).std(axis=0) / np.sqrt(2.0) / 9.80665e-6, 1200.0, rtol=0.08)
    covariance = out["imu/data_raw"]["angular_velocity_covariance"][0].reshape(3, 3)
    assert np.degrees(np.sqrt(covariance[0, 0])) == pytest.approx(0.07, rel=0.02)
    bias = out["truth"]["gyro_bias"].mean(axis=0)
    earth = np.abs(gyro.mean(axis=0) - bias)
    assert earth.max() < 7.3e-5 + 4 * np.radians(0.007 / np.sqrt(60.0))


def test_the_precision_unit_clips_while_the_string_rotates_and_the_ahrs_does_not():
    _, out = short()
    rotating = out["truth"]["activity"] == 2
    x = np.degrees(out["gyro/data_raw"]["angular_velocity"][:, 0])
    assert np.abs(x).max() == pytest.approx(300.0, abs=1e-3)
    ahrs = np.degrees(out["imu/data_raw"]["angular_velocity"][rotating, 0])
    assert 700.0 < ahrs.max() < 800.0


@pytest.mark.slow
def test_point_samples_are_aliased_and_integrated_ones_are_not():
    drilled = {"precision": None, "schedule": [{"kind": "drill", "seconds": 20.0, "rop_m_h": 0.0}]}
    unit = {"grade": "mti3_calibrated", "output": "sampled", "lever_mm": [100.0, 0.0, 0.0]}
    integrated, sampled = (run("bench/drillvib", **drilled, **ahrs)[1]["imu/data_raw"] for ahrs in ({}, {"ahrs": unit}))
    assert sampled["linear_acceleration"][:, 0].std() > 1.7 * integrated["linear_acceleration"][:, 0].std()


def test_topics_have_their_rates_and_stamps():
    sonde, out = short()
    assert sonde.duration == pytest.approx(12.0, abs=4.0)
    count = round(sonde.duration * 100)
    for topic in ("imu/data_raw", "imu/mag", "gyro/data_raw", "truth"):
        stamps = out[topic]["stamp_ns"]
        assert len(stamps) == count
        assert np.all(np.diff(stamps) == 10_000_000)
        assert stamps[0] == sonde.epoch_ns + 10_000_000
    assert len(out["imu/temperature"]) == count // 100
    assert len(out["rig/state"]) == count // 20
    assert np.all(out["imu/data_raw"]["orientation_covariance"][:, 0] == -1.0)
    rig = out["rig/state"]
    assert np.all(rig["bit_depth"] <= rig["hole_depth"] + 1e-9)
    assert rig["pressure"].max() == pytest.approx(110e5)
    assert rig["rotary_speed"].max() == pytest.approx(120.0 * 2.0 * np.pi / 60.0)


def test_truth_is_one_story():
    _, out = short()
    truth = out["truth"]
    mat_nt = frames.MAT_EN @ frames.mat_from_quat(truth["orientation"])
    assert_allclose(mat_nt[:, 2, :], truth["gravity"], atol=1e-12)
    inclination, azimuth, toolface = frames.hole_angles(mat_nt)
    assert_allclose(inclination, truth["inclination"], atol=1e-12)
    assert_allclose(frames.wrap_pi(azimuth - truth["azimuth"]), 0.0, atol=1e-9)
    assert_allclose(frames.wrap_pi(toolface - truth["gravity_toolface"]), 0.0, atol=1e-9)
    still = truth["activity"] == 0
    assert np.abs(truth["velocity"][still][:100]).max() == 0.0
    assert_allclose(np.linalg.norm(truth["specific_force"][:100], axis=1), 9.7967, atol=1e-3)


def test_the_clock_drifts_and_jitters_but_the_rig_s_does_not():
    sonde, out = run(**SHORT, clock={"drift_ppm": 100.0, "jitter_us": 50.0})
    nominal = sonde.epoch_ns + np.arange(1, len(out["truth"]) + 1) * 10_000_000
    off = out["imu/data_raw"]["stamp_ns"] - nominal
    assert off[-1] == pytest.approx(sonde.duration * 1e-4 * 1e9, abs=3e5)
    assert np.diff(off).std() == pytest.approx(50e3 * np.sqrt(2.0), rel=0.1)
    assert np.all(out["rig/state"]["stamp_ns"] % 200_000_000 == sonde.epoch_ns % 200_000_000)


def test_temperature_rises_with_depth_and_warms_up():
    warming = {"surface_c": 20.0, "gradient_c_km": 1.0, "warm_up_c": 10.0, "warm_up_s": 2.0}
    _, out = run(**STILL, temperature=warming)
    truth = out["truth"]["temperature"]
    # 60 m along a hole that leans by 20 to 32 deg is about 53 m deep.
    assert truth[0] == pytest.approx(20.05, abs=0.1)
    assert truth[-1] - truth[0] == pytest.approx(10.0 * (1.0 - np.exp(-2.0)), abs=0.05)


def test_a_fault_injected_while_running_starts_now_and_ok_ends_it():
    sonde = sonde_of()
    blocks = sonde.blocks(0.5)
    next(blocks)
    sonde.inject(Fault("mag", "off"))
    assert len(next(blocks)["imu/mag"]) == 0
    sonde.inject(Fault("mag", "ok"))
    assert len(next(blocks)["imu/mag"]) == 50
    with pytest.raises(ValueError, match="no axes"):
        sonde.inject(Fault("temperature", "stuck", "x"))


def test_other_rates_run_and_a_zero_block_is_refused():
    sonde, out = run(**SHORT, rate_hz=500, rig_hz=1)
    assert len(out["imu/data_raw"]) == round(sonde.duration * 500)
    with pytest.raises(ValueError, match="positive"):
        next(sonde.blocks(0.0))


def test_asked_again_the_sonde_goes_on_where_it_was():
    sonde = sonde_of(**SHORT)
    stamps = [next(sonde.blocks(seconds))["truth"]["stamp_ns"] for seconds in (0.25, 0.03, 2.0)]
    stamps.extend(block["truth"]["stamp_ns"] for block in sonde.blocks(1.0))
    assert np.array_equal(np.diff(np.concatenate(stamps)), np.full(round(sonde.duration * 100) - 1, 10_000_000))
    assert list(sonde.blocks(1.0)) == []


def test_the_stamp_of_time_zero_can_be_set():
    sonde = Sonde(scenario.read(SCENARIOS / "default.yaml"), epoch_ns=5_000_000_000)
    assert next(sonde.blocks(0.1))["truth"]["stamp_ns"][0] == 5_010_000_000


STEERED = {
    "schedule": [{"kind": "drill", "seconds": 12.0, "rpm": 60.0, "rop_m_h": 20.0}],
    "steering": {},
    "vibration": {},
}


@pytest.mark.slow
def test_commands_steer_and_are_the_same_run_whatever_the_block_length():
    def run_with(seconds):
        sonde = sonde_of(**STEERED)
        parts, given = [], False
        for block in sonde.blocks(seconds):
            parts.append(block)
            if not given and sonde.time >= 6.0 - 1e-9:
                sonde.command(steering.SteeringCommand(steering.HOLD))
                given = True
        return {topic: np.concatenate([part[topic] for part in parts]) for topic in wire.SONDE_TOPICS}

    whole, fine = run_with(0.5), run_with(0.1)
    assert all(whole[topic].tobytes() == fine[topic].tobytes() for topic in wire.SONDE_TOPICS)
    assert whole["rig/state"]["rotary_speed"][25] == pytest.approx(2.0 * np.pi)
    assert whole["rig/state"]["rotary_speed"][-1] == 0.0
    assert set(whole["truth"]["activity"][[500, -1]]) == {2, 1}
    # The gyro feels what the truth says.
    sensed, true = whole["imu/data_raw"]["angular_velocity"][:, 0], whole["truth"]["angular_velocity"][:, 0]
    assert np.abs(sensed - true)[100:-100].max() < 0.2
    assert true.max() > 9.0


def test_a_rig_that_takes_no_commands_says_so():
    sonde = sonde_of(**SHORT)
    with pytest.raises(ValueError, match="does not obey commands"):
        sonde.command(steering.SteeringCommand(steering.HOLD))


def test_a_string_that_sticks_by_itself_is_not_shaken_by_the_schedule_too():
    with pytest.raises(ValueError, match="remove stick_slip and hunting"):
        sonde_of("stick_slip_hell", steering={})


def test_in_compressed_time_the_rig_reports_the_rate_of_penetration_and_the_depth_runs_ahead():
    schedule = [{"kind": "drill", "seconds": 10.0, "rop_m_h": 20.0}]
    rig = run(schedule=schedule, rig={"time_lapse": 180.0})[1]["rig/state"]
    depth, hours = rig["bit_depth"], (rig["stamp_ns"] - rig["stamp_ns"][0]) / 3600e9
    assert rig["rate_of_penetration"].max() * 3600.0 == pytest.approx(20.0)
    assert np.diff(depth).max() / np.diff(hours).max() == pytest.approx(180.0 * 20.0)

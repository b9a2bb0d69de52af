"""Calibration: a tumble gives back the drawn errors, applied it removes them, and a poor run is refused."""

from __future__ import annotations

import functools
import pathlib

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from mwd_sensors import calibration, scenario
from mwd_sensors.sonde import Sonde

SCENARIOS = pathlib.Path(__file__).parents[2] / "bags" / "scenarios"


@functools.cache
def tumbled():
    sonde = Sonde(scenario.read(SCENARIOS / "tumble.yaml"))
    blocks = list(sonde.blocks(10.0))
    out = {topic: np.concatenate([block[topic] for block in blocks]) for topic in blocks[0]}
    stamps = [out[topic]["stamp_ns"].astype(float) for topic in ("imu/data_raw", "imu/temperature")]
    celsius = np.interp(stamps[0], stamps[1], out["imu/temperature"]["temperature"])
    imu = out["imu/data_raw"]
    readings = imu["angular_velocity"], imu["linear_acceleration"], out["imu/mag"]["magnetic_field"], celsius
    field = sonde.reference.total, sonde.reference.dip
    return sonde, out, readings, calibration.calibrate(*readings, 100.0, sonde.reference.gravity, field)


def test_the_rests_of_a_tumble_are_found():
    _, out, readings, _ = tumbled()
    found = calibration.rests(*readings, 100.0)
    assert len(found.first) == 30
    for first, last in zip(found.first, found.last, strict=True):
        assert np.abs(out["truth"]["angular_velocity"][first:last]).max() < 1e-9


def test_temperature_and_bias_of_every_triad_come_back():
    sonde, _, _, got = tumbled()
    for fitted, triad, tolerance in (
        (got.accelerometer, sonde.ahrs.accelerometer, 4e-3),
        (got.gyro, sonde.ahrs.gyro, 3e-4),
        (got.magnetometer, sonde.magnetometer, 2.5e-8),
    ):
        assert fitted.poses >= 29
        warm = fitted.reference_c - sonde._temperature_error - 25.0
        assert_allclose(fitted.bias, triad.bias + warm * triad.bias_per_c, atol=tolerance)
        assert_allclose(fitted.bias_per_c, triad.bias_per_c, atol=tolerance / 10.0)


def test_residuals_fall_to_the_noise():
    _, _, _, got = tumbled()
    assert got.accelerometer.after < 0.05 * got.accelerometer.before
    assert got.accelerometer.after < 1.5e-3
    assert got.magnetometer.after < 0.05 * got.magnetometer.before
    assert got.gyro.after < 0.3 * got.gyro.before


def test_applied_to_readings_the_correction_brings_strength_and_dip_back():
    sonde, out, readings, got = tumbled()
    found = calibration.rests(*readings, 100.0)
    still = (found.first + found.last) // 2
    celsius = readings[3][still]
    f_t, b_t = got.accelerometer(found.accel, celsius), got.magnetometer(found.mag, celsius)
    assert_allclose(np.linalg.norm(f_t, axis=1), sonde.reference.gravity, atol=3e-3)
    assert_allclose(np.linalg.norm(b_t, axis=1), sonde.reference.total, rtol=5e-4)
    down = -f_t / np.linalg.norm(f_t, axis=1, keepdims=True)
    dip = np.arcsin(np.sum(b_t * down, axis=1) / np.linalg.norm(b_t, axis=1))
    assert_allclose(dip, sonde.reference.dip, atol=5e-4)
    assert out["truth"].shape[0] == len(readings[3])


def test_a_stand_that_knows_its_attitude_gives_all_figures():
    rng = np.random.default_rng(1)
    truth = rng.standard_normal((40, 3))
    truth *= 9.8 / np.linalg.norm(truth, axis=1, keepdims=True)
    celsius = rng.uniform(10.0, 90.0, 40)
    matrix = np.eye(3) + 0.01 * rng.standard_normal((3, 3))
    bias, per_c = np.array([0.1, -0.2, 0.3]), np.array([1e-3, 0.0, -2e-3])
    reading = truth @ matrix.T + bias + per_c * (celsius - celsius.mean())[:, None]
    got = calibration.fit_stand(reading, truth, celsius)
    assert_allclose(got.matrix, np.linalg.inv(matrix), atol=1e-12)
    assert_allclose(got.bias, bias, atol=1e-12)
    assert_allclose(got.bias_per_c, per_c, atol=1e-13)
    assert_allclose(got(reading, celsius), truth, atol=1e-11)
    assert got.before > 0.1
    assert got.after < 1e-11


def test_strength_alone_gives_everything_but_a_rotation():
    rng = np.random.default_rng(2)
    truth = rng.standard_normal((60, 3))
    truth *= 9.8 / np.linalg.norm(truth, axis=1, keepdims=True)
    draw = 0.003 * rng.standard_normal((3, 3))
    matrix = np.eye(3) + draw + draw.T
    bias = np.array([0.05, -0.02, 0.03])
    reading = truth @ matrix.T + bias
    got = calibration.fit_strength(reading, 9.8, np.full(60, 25.0))
    assert_allclose(got.matrix, np.linalg.inv(matrix), atol=1e-9)
    assert_allclose(got.bias, bias, atol=1e-8)
    assert np.all(got.bias_per_c == 0.0)


def test_runs_that_cannot_carry_a_calibration_are_refused():
    still = np.tile([0.0, 0.0, 9.8], (3000, 1))
    with pytest.raises(ValueError, match="at least 12"):
        calibration.rests(np.zeros((3000, 3)), still, None, np.zeros(3000), 100.0)
    one_way = np.tile([0.0, 0.0, 9.8], (20, 1))
    with pytest.raises(ValueError, match="turn the probe further"):
        calibration.fit_stand(one_way, one_way, np.full(20, 25.0))
    with pytest.raises(ValueError, match="turn the probe further"):
        calibration.fit_strength(one_way, 9.8, np.full(20, 25.0))


def test_a_calibration_is_written_and_read_back_exactly():
    _, _, readings, got = tumbled()
    text = yaml.safe_dump(calibration.as_table(got))
    back = calibration.from_table(yaml.safe_load(text))
    for name in ("gyro", "accelerometer", "magnetometer"):
        first, second = getattr(got, name), getattr(back, name)
        assert np.array_equal(first(readings[1], readings[3]), second(readings[1], readings[3]))
        assert (first.after, first.poses) == (second.after, second.poses)


@pytest.mark.parametrize(
    ("spoil", "match"),
    [
        (lambda table: table.pop("gyro"), "gyro is missing"),
        (lambda table: table["gyro"].pop("bias"), r"gyro\.bias is missing"),
        (lambda table: table["gyro"].update(bias=[0.0, 1.0]), "shape"),
        (lambda table: table["gyro"].update(bias=[0.0, 1.0, float("nan")]), "finite"),
        (lambda table: table["accelerometer"].update(matrix=[[9.8, 0, 0], [0, 9.8, 0], [0, 0, 9.8]]), "identity"),
        (lambda table: table.update(compass={}), "compass"),
    ],
)
def test_a_spoilt_table_is_refused_with_its_reason(spoil, match):
    table = calibration.as_table(tumbled()[3])
    spoil(table)
    with pytest.raises(ValueError, match=match):
        calibration.from_table(table)

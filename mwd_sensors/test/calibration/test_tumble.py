# SPDX-License-Identifier: Apache-2.0
"""Calibration: a tumble gives back the drawn errors, applied it removes them, and a poor run is refused."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from mwd_sensors.calibration import tumble
from mwd_sensors.calibration.triad_calibration import as_table, from_table
from mwd_sensors.calibration.tumble import fit_sigmas, rests
from simulated_sonde import simulated

pytestmark = pytest.mark.slow(0.4)


@functools.cache
def tumbled():
    out, sonde = simulated("tumble")
    stamps = [out[topic]["stamp_ns"].astype(float) for topic in ("imu/data_raw", "imu/temperature")]
    celsius = np.interp(stamps[0], stamps[1], out["imu/temperature"]["temperature"])
    imu = out["imu/data_raw"]
    readings = imu["angular_velocity"], imu["linear_acceleration"], out["imu/mag"]["magnetic_field"], celsius
    field = sonde.reference.total, sonde.reference.dip
    return sonde, out, readings, tumble.calibrate(*readings, 100.0, sonde.reference.gravity, field)


def test_the_rests_of_a_tumble_are_found():
    _, out, readings, _ = tumbled()
    found = rests(*readings, 100.0)
    assert len(found.first) == 60
    for first, last in zip(found.first, found.last, strict=True):
        assert np.abs(out["truth"]["angular_velocity"][first:last]).max() < 1e-9


# Tolerances are about 4 sigma of 24 seeds.
@pytest.mark.parametrize(
    ("triad", "bias_within", "per_c_within", "scale_per_c_within"),
    [("accelerometer", 1e-3, 8e-5, 4e-6), ("gyro", 6e-5, 1.2e-5, np.inf), ("magnetometer", 2.5e-8, 1.5e-9, 2e-5)],
)
def test_bias_and_temperature_of_every_triad_come_back_and_err_as_their_sigmas_say(
    triad, bias_within, per_c_within, scale_per_c_within
):
    sonde, out, readings, got = tumbled()
    found = rests(*readings, 100.0)
    still = np.concatenate([np.arange(a, z) for a, z in zip(found.first, found.last, strict=True)])
    fitted = getattr(got, triad)
    if triad == "magnetometer":
        drawn = sonde.magnetometer
        bias = drawn.bias + (got.gyro.reference_c - sonde._temperature_error - 25.0) * drawn.bias_per_c
    else:
        # Bias of the run, what wandered included.
        drawn = getattr(sonde.ahrs, triad)
        bias = out["truth"]["accel_bias" if triad == "accelerometer" else "gyro_bias"][still].mean(axis=0)
    errors = fitted.bias - bias, fitted.bias_per_c - drawn.bias_per_c, fitted.scale_per_c - drawn.scale_per_c
    sigmas = fitted.sigma_bias, fitted.sigma_bias_per_c, fitted.sigma_scale_per_c
    for error, within in zip(errors, (bias_within, per_c_within, scale_per_c_within), strict=True):
        assert np.abs(error).max() < within
    ratios = np.concatenate(errors) / np.concatenate(sigmas)
    assert np.abs(ratios).max() < 4.0
    assert 0.1 < np.sqrt(np.mean(ratios**2)) < 2.0
    assert fitted.poses >= 59


def test_sigmas_of_a_fit_agree_with_the_spread_of_many_fits():
    rng = np.random.default_rng(5)
    design, figures = rng.standard_normal((60, 4)), np.array([1.0, -2.0, 0.5, 0.0])
    found, stated = [], []
    for _ in range(200):
        read = design @ figures + 1e-3 * rng.standard_normal(60)
        found.append(np.linalg.lstsq(design, read, rcond=None)[0])
        stated.append(fit_sigmas(design, design @ found[-1] - read))
    assert_allclose(np.mean(stated, axis=0) / np.std(found, axis=0), 1.0, atol=0.2)


def test_residuals_fall_to_the_noise():
    _, _, _, got = tumbled()
    assert got.accelerometer.after < 0.05 * got.accelerometer.before
    assert got.accelerometer.after < 6e-4
    assert got.magnetometer.after < 0.05 * got.magnetometer.before
    assert got.gyro.after < 0.3 * got.gyro.before


def test_applied_to_readings_the_correction_brings_strength_and_dip_back():
    sonde, _, readings, got = tumbled()
    found = rests(*readings, 100.0)
    still = (found.first + found.last) // 2
    celsius = readings[3][still]
    f_t, b_t = got.accelerometer(found.accel, celsius), got.magnetometer(found.mag, celsius)
    assert_allclose(np.linalg.norm(f_t, axis=1), sonde.reference.gravity, atol=3e-3)
    assert_allclose(np.linalg.norm(b_t, axis=1), sonde.reference.total, rtol=5e-4)
    down = -f_t / np.linalg.norm(f_t, axis=1, keepdims=True)
    dip = np.arcsin(np.sum(b_t * down, axis=1) / np.linalg.norm(b_t, axis=1))
    assert_allclose(dip, sonde.reference.dip, atol=5e-4)


def test_strength_alone_gives_everything_but_a_rotation():
    rng = np.random.default_rng(2)
    truth = rng.standard_normal((60, 3))
    truth *= 9.8 / np.linalg.norm(truth, axis=1, keepdims=True)
    draw = 0.003 * rng.standard_normal((3, 3))
    matrix = np.eye(3) + draw + draw.T
    bias = np.array([0.05, -0.02, 0.03])
    reading = truth @ matrix.T + bias
    got = tumble.fit_strength(reading, 9.8, np.full(60, 25.0))
    assert_allclose(got.matrix, np.linalg.inv(matrix), atol=1e-9)
    assert_allclose(got.bias, bias, atol=1e-8)
    assert np.all(got.bias_per_c == 0.0)


def test_runs_that_cannot_carry_a_calibration_are_refused():
    still = np.tile([0.0, 0.0, 9.8], (3000, 1))
    with pytest.raises(ValueError, match="at least 12"):
        rests(np.zeros((3000, 3)), still, None, np.zeros(3000), 100.0)
    one_way = np.tile([0.0, 0.0, 9.8], (20, 1))
    with pytest.raises(ValueError, match="turn the probe further"):
        tumble.fit_strength(one_way, 9.8, np.full(20, 25.0))


def test_a_calibration_is_written_and_read_back_exactly():
    _, _, readings, got = tumbled()
    text = yaml.safe_dump(as_table(got))
    back = from_table(yaml.safe_load(text))
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
    table = as_table(tumbled()[3])
    spoil(table)
    with pytest.raises(ValueError, match=match):
        from_table(table)

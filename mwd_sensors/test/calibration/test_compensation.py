# SPDX-License-Identifier: Apache-2.0
"""Compensation: known errors go at every temperature, in blocks of any length, and nothing else is touched."""

import dataclasses

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.calibration.triad_calibration import Calibration, TriadCalibration
from mwd_sensors.core import wire

S = wire.NANOSECONDS


def triad(seed, size):
    rng = np.random.default_rng(seed)
    sigmas = dict.fromkeys(("sigma_bias", "sigma_bias_per_c", "sigma_scale_per_c"), np.zeros(3))
    return TriadCalibration(
        matrix=np.eye(3) + 0.01 * rng.standard_normal((3, 3)),
        bias=0.01 * size * rng.standard_normal(3),
        bias_per_c=1e-4 * size * rng.standard_normal(3),
        scale_per_c=1e-4 * rng.standard_normal(3),
        sigma_matrix=np.zeros((3, 3)),
        reference_c=30.0,
        before=0.0,
        after=0.0,
        poses=20,
        **sigmas,
    )


CALIBRATION = Calibration(triad(1, 1.0), triad(2, 10.0), triad(3, 5e-5))


def spoilt(fitted, truth, celsius):
    """Readings of the model: (1 + scale_per_c warm) (inverse(matrix) truth) + bias + bias_per_c warm."""
    warm = (celsius - fitted.reference_c)[:, None]
    seen = truth @ np.linalg.inv(fitted.matrix).T
    return (1.0 + fitted.scale_per_c * warm) * seen + fitted.bias + fitted.bias_per_c * warm


def stream(count=500):
    """IMU, magnetometer and temperature of a run whose temperature steps every second; and the truths."""
    rng = np.random.default_rng(4)
    imu, mag = wire.IMU.empty(count), wire.MAG.empty(count)
    imu["stamp_ns"] = mag["stamp_ns"] = np.arange(1, count + 1) * (S // 100)
    temperature = wire.TEMPERATURE.empty(count // 100)
    temperature["stamp_ns"] = np.arange(count // 100) * S
    temperature["temperature"] = 20.0 + 7.0 * np.arange(count // 100)
    celsius = temperature["temperature"][(imu["stamp_ns"] - 1) // S]
    truths = rng.standard_normal((3, count, 3)) * np.array([1.0, 10.0, 5e-5])[:, None, None]
    imu["angular_velocity"] = spoilt(CALIBRATION.gyro, truths[0], celsius)
    imu["linear_acceleration"] = spoilt(CALIBRATION.accelerometer, truths[1], celsius)
    mag["magnetic_field"] = spoilt(CALIBRATION.magnetometer, truths[2], celsius)
    imu["orientation_covariance"][:, 0] = -1.0
    return imu, mag, temperature, truths


def compensated(temperature, calibration=CALIBRATION):
    """A compensation that knows these temperatures."""
    made = Compensation(calibration)
    made.push_temperature(temperature)
    return made


def test_known_errors_are_taken_out_at_every_temperature():
    imu, mag, temperature, truths = stream()
    compensation = compensated(temperature)
    out = compensation.imu(imu)
    assert_allclose(out["angular_velocity"], truths[0], atol=1e-12)
    assert_allclose(out["linear_acceleration"], truths[1], atol=1e-12)
    assert_allclose(compensation.mag(mag)["magnetic_field"], truths[2], atol=1e-16)
    assert compensation.without_temperature == 0
    for name in ("orientation_covariance", "stamp_ns"):
        assert_array_equal(out[name], imu[name])


def test_blocks_of_any_length_give_the_same_bits():
    imu, _, temperature, _ = stream()
    whole = compensated(temperature)
    parts, found = Compensation(CALIBRATION), []
    for k in range(0, len(imu), 7):
        block = imu[k : k + 7]
        until = block["stamp_ns"][-1]
        since = imu["stamp_ns"][k - 1] if k else -1
        parts.push_temperature(temperature[(temperature["stamp_ns"] <= until) & (temperature["stamp_ns"] > since)])
        found.append(parts.imu(block))
    assert_array_equal(whole.imu(imu), np.concatenate(found))


def test_without_a_temperature_the_calibration_s_own_is_taken_and_counted():
    imu, _, _, _ = stream(200)
    broken = wire.TEMPERATURE.empty(1)
    broken["temperature"] = np.nan
    compensation = compensated(broken)
    out = compensation.imu(imu)
    assert compensation.without_temperature == 200
    assert_array_equal(out["angular_velocity"], CALIBRATION.gyro(imu["angular_velocity"], np.full(200, 30.0)))


def test_a_magnetometer_without_calibration_is_left_alone():
    _, mag, _, _ = stream(200)
    assert Compensation(dataclasses.replace(CALIBRATION, magnetometer=None)).mag(mag) is mag


def test_what_it_remembers_is_bounded():
    temperature = wire.TEMPERATURE.empty(10_000)
    temperature["stamp_ns"] = np.arange(10_000) * S
    compensation = compensated(temperature)
    assert len(compensation._stamps) == 4096
    assert compensation._stamps[-1] == 9_999 * S

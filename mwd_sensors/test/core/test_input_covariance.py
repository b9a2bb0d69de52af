# SPDX-License-Identifier: Apache-2.0
"""What the covariances of samples say, and what they must not do."""

import numpy as np
import pytest

from mwd_sensors.core import mount, wire
from mwd_sensors.core.input_covariance import ABSENT, TOO_SMALL, UNBELIEVABLE, NoiseWatch, clipped, judge, mark_clipped


def imu(covariance, field="angular_velocity", n=5):
    samples = wire.IMU.empty(n)
    samples["stamp_ns"] = np.arange(n) * 10_000_000
    samples["angular_velocity"], samples["linear_acceleration"] = 0.1, 9.8
    samples[f"{field}_covariance"] = covariance
    return samples


def diagonal(*variances):
    return np.diag(variances).ravel()


def noise_of(samples, cut=1000):
    """The noise that is taken from the samples, block by block."""
    watch = NoiseWatch()
    for k in range(0, len(samples), cut):
        watch.take(samples[k : k + cut], wire.IMU.type_name)
    return watch.noise


@pytest.mark.fault_case(13)
def test_zeros_mean_unknown_and_change_nothing():
    samples = imu(0.0)
    judged = judge(samples, wire.IMU.type_name)
    assert judged.samples is samples
    assert judged.notes == {}


@pytest.mark.fault_case(14)
@pytest.mark.parametrize("field", ["angular_velocity", "linear_acceleration"])
def test_a_vector_that_is_declared_absent_is_not_used_even_if_it_holds_numbers(field):
    samples = imu([-1.0, *[0.0] * 8], field)
    judged = judge(samples, wire.IMU.type_name)
    assert np.isnan(judged.samples[field]).all()
    assert judged.notes == {field: ABSENT}
    assert np.isfinite(samples[field]).all()
    mag = wire.MAG.empty(2)
    mag["magnetic_field"], mag["magnetic_field_covariance"] = 5e-5, [-1.0, *[0.0] * 8]
    assert np.isnan(judge(mag, wire.MAG.type_name).samples["magnetic_field"]).all()


@pytest.mark.fault_case(15)
@pytest.mark.parametrize(
    "covariance",
    [
        [np.nan, *[0.0] * 8],
        [np.inf, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-6],
        [1e-6, 0.0, 0.0, 0.0, -1e-6, 0.0, 0.0, 0.0, 1e-6],
        [1e-6, 5e-7, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-6],
        [1e-6, 2e-6, 0.0, 2e-6, 1e-6, 0.0, 0.0, 0.0, 1e-6],
        [1e12, 0.0, 0.0, 0.0, 1e12, 0.0, 0.0, 0.0, 1e12],
        [1e308, *[1e308] * 8],
    ],
)
def test_what_is_no_covariance_is_named_and_the_numbers_stay(covariance):
    judged = judge(imu(covariance), wire.IMU.type_name)
    assert judged.notes == {"angular_velocity": UNBELIEVABLE}
    assert (judged.samples["angular_velocity"] == 0.1).all()


def test_a_sound_covariance_and_one_of_a_planar_sensor_pass():
    for covariance in (diagonal(1e-6, 2e-6, 3e-6), diagonal(1e-6, 1e-6, 0.0)):
        assert judge(imu(covariance), wire.IMU.type_name).notes == {}


def test_samples_without_covariances_and_other_messages_pass():
    part = wire.IMU.empty(3)[["stamp_ns", "angular_velocity"]]
    assert judge(part, wire.IMU.type_name).notes == {}
    assert judge(wire.TEMPERATURE.empty(2), wire.TEMPERATURE.type_name).notes == {}


def test_the_stated_noise_is_that_of_the_first_samples_however_they_are_cut():
    samples = imu(diagonal(1e-6, 4e-6, 1e-6), n=40)
    samples["angular_velocity_covariance"][20:] *= 100.0
    found = noise_of(samples)
    assert found == noise_of(samples, cut=1)
    assert found["angular_velocity"].sigma == pytest.approx(2e-3)
    assert found["angular_velocity"].density == pytest.approx(2e-4)
    assert found["linear_acceleration"].sigma == 0.0


@pytest.mark.parametrize("covariance", [[-1.0, *[4.0] * 8], [np.nan] * 9, [1e12, *[0.0] * 8]])
def test_what_is_absent_or_no_covariance_states_no_noise(covariance):
    assert noise_of(imu(covariance, n=20))["angular_velocity"].sigma == 0.0


def test_a_first_sample_that_was_clipped_states_the_noise_of_its_other_axes():
    samples = imu(diagonal(1e-6, 4e-6, 1e-6), n=20)
    mark_clipped(samples, "angular_velocity", np.arange(60).reshape(20, 3) == 0)
    assert noise_of(samples)["angular_velocity"].sigma == pytest.approx(2e-3)


def not_credible(stated, rates, still):
    """Return the reasons why samples with these rates and this stated variance are not credible."""
    samples, watch = imu(diagonal(*[stated] * 3), n=200), NoiseWatch()
    samples["angular_velocity"] = rates
    for part in np.array_split(samples, 70):
        watch.take(part, wire.IMU.type_name)
        watch.rest(part, wire.IMU.type_name, still=still)
    return watch.not_credible


@pytest.mark.fault_case(16)
def test_a_covariance_a_million_times_too_small_is_not_credible_and_an_honest_one_or_that_of_a_moving_tool_is():
    noise = np.random.default_rng(2).normal(scale=1e-3, size=(200, 3))
    assert not_credible(1e-12, noise, still=True) == {"angular_velocity": TOO_SMALL}
    assert not_credible(1e-6, noise, still=True) == {}
    assert not_credible(1e-12, np.tile([[5.0], [0.1]], (100, 3)), still=False) == {}


@pytest.mark.parametrize("vector", ["angular_velocity", "linear_acceleration"])
@pytest.mark.parametrize("known", [0.0, 1e-4])
def test_axes_marked_as_clipped_are_found_in_the_axes_of_a_tool_too(vector, known):
    samples = imu(known * np.eye(3).ravel(), vector)
    axes = np.arange(15).reshape(5, 3) % 4 == 0
    mark_clipped(samples, vector, axes)
    assert np.array_equal(clipped(samples, vector), axes)
    assert judge(samples, wire.IMU.type_name).notes == {}
    turned = mount.resolve(mount.MountSettings(imu="z-down")).imu_in_tool(samples)
    assert np.array_equal(clipped(turned, vector), np.abs(mount.PRESETS["z-down"] @ axes.T).T != 0.0)


@pytest.mark.parametrize("variance", [*(10.0**k for k in range(-12, 9)), -1.0, np.nan, np.inf])
def test_the_stand_ins_of_drivers_without_a_covariance_are_no_clipping(variance):
    for vector in ("angular_velocity", "linear_acceleration"):
        assert not clipped(imu(diagonal(*[variance] * 3), vector), vector).any()
    assert not clipped(wire.IMU.empty(3)[["stamp_ns", "angular_velocity"]], "angular_velocity").any()

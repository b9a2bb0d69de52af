# SPDX-License-Identifier: Apache-2.0
"""A tumble through a bag: the injected errors come back within their sigmas, and the file keeps every figure."""

import dataclasses
import functools
import tempfile
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.calibration.triad_calibration import as_table
from mwd_sensors.calibration.tumble import rests
from mwd_sensors.core import wire
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs import calibration_run, simulate
from project import SCENARIOS

pytestmark = pytest.mark.slow

TUMBLE = SCENARIOS / "tumble.yaml"


@functools.cache
def folder():
    return tempfile.TemporaryDirectory(prefix="mwd_calibration_")


@functools.cache
def tumbled():
    """Folder of the bag, its run, the calibration and the sonde that was asked for the truth."""
    path = Path(folder().name) / "tumble"
    given = scenario.read(TUMBLE)
    simulate.record(given, path, "w1", TUMBLE.read_bytes())
    with Bag(path) as bag:
        run, _ = calibration_run.recorded(bag, "ahrs")
        gravity, field = calibration_run.field_of(calibration_run.scenario_of(bag))
    return path, run, calibration_run.calibrated(run, gravity, field), Sonde(given)


def rests_of(run):
    return rests(run.imu["angular_velocity"], run.imu["linear_acceleration"], run.mag, run.celsius, run.rate)


def test_injected_errors_come_back_within_their_sigmas_through_the_bag():
    path, _, found, sonde = tumbled()
    with Bag(path) as bag:
        truth = np.concatenate([block["/w1/truth"][1] for block in bag.blocks(["/w1/truth"])])
    warm = found.gyro.reference_c - sonde._temperature_error - 25.0
    magnetometer = sonde.magnetometer
    for fitted, drawn, bias in (
        (found.accelerometer, sonde.ahrs.accelerometer, truth["accel_bias"].mean(axis=0)),
        (found.gyro, sonde.ahrs.gyro, truth["gyro_bias"].mean(axis=0)),
        (found.magnetometer, magnetometer, magnetometer.bias + warm * magnetometer.bias_per_c),
    ):
        assert np.all(np.abs(fitted.bias - bias) < 3.0 * fitted.sigma_bias)
        assert np.all(np.abs(fitted.bias_per_c - drawn.bias_per_c) < 3.0 * fitted.sigma_bias_per_c)
        # The sigmas say something: the errors that were injected are many times larger.
        assert np.sqrt(np.mean((fitted.bias / fitted.sigma_bias) ** 2)) > 10.0


def test_corrected_samples_show_gravity_and_field_at_every_temperature():
    path, run, found, sonde = tumbled()
    compensation, raw, corrected, field = Compensation(found), [], [], []
    with Bag(path) as bag:
        for block in bag.blocks(["/w1/imu/data_raw", "/w1/imu/mag", "/w1/imu/temperature"]):
            if "/w1/imu/temperature" in block:
                compensation.push_temperature(block["/w1/imu/temperature"][1])
            raw.append(block["/w1/imu/data_raw"][1])
            corrected.append(compensation.imu(raw[-1]))
            field.append(compensation.mag(block["/w1/imu/mag"][1])["magnetic_field"])
    found_rests = rests_of(run)
    still = np.concatenate([np.arange(a, z) for a, z in zip(found_rests.first, found_rests.last, strict=True)])
    before, after = (
        np.linalg.norm(np.concatenate(part)["linear_acceleration"], axis=1)[still] - sonde.reference.gravity
        for part in (raw, corrected)
    )
    # The noise of one sample is 0.012 m/s^2.
    assert np.sqrt(np.mean(before**2)) > 0.025
    assert np.sqrt(np.mean(after**2)) < 0.0135
    assert abs(np.mean(after)) < 1e-3
    strength = np.linalg.norm(np.concatenate(field), axis=1)[still]
    assert np.mean(strength) == pytest.approx(sonde.reference.total, abs=2e-8)
    assert compensation.without_temperature <= 100
    assert len(run.imu) == len(np.concatenate(corrected))


def test_a_bag_and_the_scenario_itself_give_the_same_samples_to_calibrate(tmp_path):
    tumble = scenario.read(TUMBLE)
    begun = dataclasses.replace(tumble, schedule=tumble.schedule[:8], cycles=1)
    simulate.record(begun, tmp_path / "tumble")
    with Bag(tmp_path / "tumble") as bag:
        run, _ = calibration_run.recorded(bag, "ahrs")
    again = calibration_run.simulated(begun, "ahrs")
    assert len(run.imu) > 4000
    for name in run.imu.dtype.names:
        assert_array_equal(run.imu[name], again.imu[name])
    assert_array_equal(run.mag, again.mag)
    assert_array_equal(run.celsius, again.celsius)
    assert (run.source, again.source) == ("bag tumble", "scenario tumble, seed 1")


@pytest.mark.parametrize("tick_s", [0.016, 0.08])
def test_a_coarse_clock_loses_no_sample_of_a_calibration(tick_s):
    tumble = scenario.read(TUMBLE)
    begun, tick = dataclasses.replace(tumble, schedule=tumble.schedule[:8], cycles=1), round(tick_s * 1e9)
    topics = (calibration_run.UNITS["ahrs"], "imu/mag", "imu/temperature")
    blocks = list(Sonde(begun).blocks(10.0))
    joined = {topic: np.concatenate([block[topic] for block in blocks]) for topic in topics}
    sound = calibration_run._run("sound", "ahrs", joined, topics)
    for topic in topics[:2]:
        joined[topic]["stamp_ns"] = joined[topic]["stamp_ns"] // tick * tick
    coarse = calibration_run._run("coarse", "ahrs", joined, topics)
    assert_array_equal(coarse.imu["angular_velocity"], sound.imu["angular_velocity"])
    assert coarse.rate == pytest.approx(sound.rate, rel=0.01)
    # The times of the first second are not known yet.
    late = slice(100, None)
    assert np.std(np.linalg.norm(coarse.mag - sound.mag, axis=1)[late]) < 1e-7


def test_the_file_keeps_every_figure(tmp_path):
    _, _, found, _ = tumbled()
    calibration_run.write(tmp_path / "new" / "cal.yaml", found, {"from": "here", "gravity_mps2": 9.8})
    assert as_table(calibration_run.read(tmp_path / "new" / "cal.yaml")) == as_table(found)


@pytest.mark.fault_case(23)
def test_the_temperatures_of_the_run_bound_those_of_the_tool_with_what_its_slopes_still_hold_for(tmp_path):
    _, _, found, _ = tumbled()
    calibration_run.write(tmp_path / "cal.yaml", found, {"temperature_c": [25.0, 85.0]})
    tool = calibration_run.within_calibration(EstimatorSettings(), tmp_path / "cal.yaml").tool
    assert tool.calibrated_c == (15.0, 95.0)
    calibration_run.write(tmp_path / "old.yaml", found, {})
    assert calibration_run.within_calibration(EstimatorSettings(), tmp_path / "old.yaml") == EstimatorSettings()


def test_people_see_residuals_and_errors_with_their_units():
    _, _, found, _ = tumbled()
    rows = calibration_run.residuals(found)
    assert [row[0] for row in rows] == ["accelerometers", "gyros", "magnetometers"]
    assert all(after < 0.5 * before for _, _, before, after, _ in rows)
    lines = calibration_run.errors(found)
    assert len(lines) == 12
    assert lines[0][1] == "bias, µg"
    assert all(len(values) == 3 and "±" in values[0] for _, _, values in lines)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: [", "is not YAML"),
        ("other: 1", "is not a calibration; `mwd calibrate` makes one"),
        ("{about: {unit: precision}, calibration: {}}", "a calibration of the unit 'precision', not of 'ahrs'"),
        ("calibration: {gyros: {}}", "no triad 'gyros'"),
        ("calibration: {gyro: {matrix: 1}}", "gyro.matrix must be finite and of shape"),
    ],
)
def test_a_file_that_is_no_calibration_is_named_with_its_reason(tmp_path, text, sentence):
    path = tmp_path / "cal.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=sentence) as refused:
        calibration_run.read(path)
    assert str(path) in str(refused.value)


def test_runs_that_cannot_be_used_are_refused(tmp_path):
    samples = wire.IMU.empty(500)
    samples["stamp_ns"] = np.arange(500) * 10_000_000
    with BagWriter(tmp_path / "b") as bag:
        channel = bag.topic("/imu/data_raw", wire.IMU.type_name)
        bag.write_rows(channel, wire.IMU.encode(samples, "imu"), samples["stamp_ns"])
    with Bag(tmp_path / "b") as bag:
        with pytest.raises(ValueError, match="there is no temperature"):
            calibration_run.recorded(bag, "ahrs")
        with pytest.raises(BagError, match="gyro/data_raw"):
            calibration_run.recorded(bag, "precision")
        assert calibration_run.scenario_of(bag) is None
    short = scenario.parse("{name: s, schedule: [{kind: still, seconds: 3.0}], precision: null}")
    with pytest.raises(ValueError, match="no precision unit"):
        calibration_run.simulated(short, "precision")
    with pytest.raises(ValueError, match="a tumble needs at least 12 attitudes"):
        calibration_run.calibrated(calibration_run.simulated(short, "ahrs"), 9.8, None)


SWAPPED = [0, 2, 1]


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ("accelerometer exchanged", "gyros"),
        ("accelerometer reversed", "magnetometers"),
        ("gyro in degrees", "gyros"),
        ("magnetometer exchanged", "magnetometers"),
        ("magnetometer in uT", "magnetometers"),
        ("field of another place", "magnetometers"),
    ],
)
def test_a_calibration_with_larger_errors_than_any_sensor_has_is_refused_with_what_to_check(wrong, name):
    path, run, _, _ = tumbled()
    with Bag(path) as bag:
        gravity, field = calibration_run.field_of(calibration_run.scenario_of(bag))
    imu, mag = run.imu.copy(), run.mag
    if wrong == "accelerometer exchanged":
        imu["linear_acceleration"] = imu["linear_acceleration"][:, SWAPPED]
    elif wrong == "accelerometer reversed":
        imu["linear_acceleration"] *= -1.0
    elif wrong == "gyro in degrees":
        imu["angular_velocity"] = np.radians(imu["angular_velocity"])
    elif wrong == "magnetometer exchanged":
        mag = mag[:, SWAPPED]
    elif wrong == "magnetometer in uT":
        mag = mag * 1e-6
    else:
        field = (field[0], field[1] - 0.9)
    with pytest.raises(ValueError, match=f"{name}: .* is more than a sensor has: check the unit"):
        calibration_run.calibrated(dataclasses.replace(run, imu=imu, mag=mag), gravity, field)

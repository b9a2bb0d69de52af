# SPDX-License-Identifier: Apache-2.0
"""Recordings as others make them: what is found, and that the command printed processes them as the sound one."""

import csv
import shlex
from pathlib import Path

import numpy as np
import pytest

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_sensors.core.frames import mat_from_quat, quat_from_rotvec
from mwd_sensors.core.mount import PRESETS
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import app
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.inspection import inspect
from mwd_surface.runs import simulate
from running_graph import samples_of

pytestmark = pytest.mark.slow(0.3)

SCENARIO = """
name: other
seed: 5
date: 2026-03-01T06:00:00
place: {latitude_deg: 58.4, longitude_deg: 1.88}
well: {stations: [[0.0, 30.0, 40.0], [60.0, 30.0, 40.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule: [{kind: still, seconds: 14.0, pumps: false}, {kind: drill, seconds: 26.0, rpm: 120.0, rop_m_h: 20.0}]
"""
PLACE = {"place.field": "model", "place.lat_deg": 58.4, "place.lon_deg": 1.88, "survey.north": "true"}
Z = PRESETS["z-down"]
# Name: what is done to force, rate and field, and the options that the command must have.
BAGS = {
    "sound": (lambda v: v, lambda v: v, lambda v: v, []),
    "g": (lambda v: v / 9.80665, lambda v: v, lambda v: v, ["--accel-unit", "g"]),
    "degrees": (lambda v: v, np.degrees, lambda v: v, ["--gyro-unit", "deg/s"]),
    "gauss": (lambda v: v, lambda v: v, lambda v: 1e4 * v, ["--mag-unit", "G"]),
    "all units": (
        lambda v: v / 9.80665,
        np.degrees,
        lambda v: 1e6 * v,
        ["--accel-unit", "g", "--gyro-unit", "deg/s", "--mag-unit", "uT"],
    ),
    "reversed": (lambda v: -v, lambda v: v, lambda v: v, ["--accelerometer", "down"]),
    "z-down": (lambda v: v @ Z, lambda v: v @ Z, lambda v: v @ Z, ["--mount", "imu=z-down"]),
}


@pytest.fixture(scope="module")
def sent(tmp_path_factory):
    """IMU and magnetic samples of a sound tool."""
    folder = tmp_path_factory.mktemp("sent")
    (folder / "scenario.yaml").write_text(SCENARIO)
    simulate.record(read(folder / "scenario.yaml"), folder / "bag")
    return samples_of(folder / "bag", "/imu/data_raw"), samples_of(folder / "bag", "/imu/mag")


def written(path, imu, mag, late_ns=0, frames=("imu_link", "imu_link")):
    with BagWriter(path) as bag:
        both = (("/sensors/imu", wire.IMU, imu), ("/sensors/mag", wire.MAG, mag))
        for (name, layout, rows), frame in zip(both, frames, strict=True):
            data = layout.encode(rows, frame)
            bag.write_rows(bag.topic(name, layout.type_name), data, rows["stamp_ns"] + late_ns)
    return path


def inspected(path, place=PLACE):
    with Bag(path) as bag:
        estimator = settings.changed(EstimatorSettings(), place)
        return inspect(bag, InputSettings(), estimator, path.parent / "out")


def processed(command):
    """Rows of surveys.csv by the command as it was printed."""
    words = shlex.split(command)
    assert words[:2] == ["mwd", "process"]
    assert app(words[1:], standalone_mode=False) is None
    with (Path(words[words.index("-o") + 1]) / "surveys.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


# Bags with one other unit, which "all units" has too.
ONE_UNIT = ("g", "degrees", "gauss")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly) if name in ONE_UNIT else name for name in BAGS]
)
def test_the_printed_command_reads_a_recording_as_it_was_made(name, sent, tmp_path):
    force, rate, field, options = BAGS[name]
    imu, mag = (one.copy() for one in sent)
    imu["linear_acceleration"], imu["angular_velocity"] = (
        force(imu["linear_acceleration"]),
        rate(imu["angular_velocity"]),
    )
    mag["magnetic_field"] = field(mag["magnetic_field"])
    found = inspected(written(tmp_path / "a bag", imu, mag))
    words = shlex.split(found.command)
    assert words[5:-6] == options
    assert words[-6:] == ["--lat", "58.4", "--lon", "1.88", "--date", "2026-03-01"]
    assert found.faults == []
    assert found.turns_about == ("z-down" if name == "z-down" else "x-down")
    assert found.rests == 1
    (survey,) = processed(found.command)
    assert survey["verdict"] == "accept"
    assert float(survey["inclination_deg"]) == pytest.approx(30.0, abs=0.1)
    assert float(survey["azimuth_deg"]) == pytest.approx(40.0, abs=2.0)


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("y-up", "imu_link"),
        ("z-down", "mag_link"),
        pytest.param("x-up", "mag_link", marks=pytest.mark.nightly),
    ],
)
def test_a_magnetometer_mounted_otherwise_than_the_imu_is_found_by_the_dip(name, frame, sent, tmp_path):
    imu, mag = (one.copy() for one in sent)
    mag["magnetic_field"] = mag["magnetic_field"] @ PRESETS[name]
    found = inspected(written(tmp_path / "bag", imu, mag, frames=("imu_link", frame)))
    assert shlex.split(found.command)[5:7] == ["--mount", f"mag={name}"]
    (survey,) = processed(found.command)
    assert survey["verdict"] == "accept"
    assert float(survey["azimuth_deg"]) == pytest.approx(40.0, abs=2.0)


def test_a_unit_mounted_askew_is_named_with_its_angle_and_read_by_the_printed_mount(sent, tmp_path):
    imu, mag = (one.copy() for one in sent)
    turn = mat_from_quat(quat_from_rotvec([0.0, np.radians(35.0), 0.0]))
    for samples, field in ((imu, "angular_velocity"), (imu, "linear_acceleration"), (mag, "magnetic_field")):
        samples[field] = samples[field] @ turn
    found = inspected(written(tmp_path / "bag", imu, mag))
    assert found.turns_about == "35 deg off x"
    assert any("mounted obliquely" in remark for remark in found.remarks)
    (survey,) = processed(found.command)
    assert survey["verdict"] == "accept"
    assert float(survey["inclination_deg"]) == pytest.approx(30.0, abs=0.2)
    assert float(survey["azimuth_deg"]) == pytest.approx(40.0, abs=2.0)


def test_a_unit_mounted_askew_is_not_accepted_where_no_mount_is_given(sent, tmp_path, monkeypatch):
    imu, mag = (one.copy() for one in sent)
    turn = mat_from_quat(quat_from_rotvec([0.0, np.radians(15.0), 0.0]))
    for samples, field in ((imu, "angular_velocity"), (imu, "linear_acceleration"), (mag, "magnetic_field")):
        samples[field] = samples[field] @ turn
    path = written(tmp_path / "bag", imu, mag)
    # The run knew nothing of the mount when it judged the station, and may revise it by others that it rejects neither.
    monkeypatch.setattr(Pipeline, "revisions", lambda pipeline: pipeline.judging_again(1)())
    (survey,) = processed(f"mwd process {path} -o {tmp_path / 'out'} --lat 58.4 --lon 1.88 --date 2026-03-01")
    assert survey["verdict"] == "reject"
    assert "15 deg off the unit's x" in (tmp_path / "out" / "faults.csv").read_text(encoding="utf-8")


def test_a_rest_is_long_enough_by_the_settings_given(sent, tmp_path):
    found = inspected(written(tmp_path / "bag", *sent), PLACE | {"survey.duration_s": 20.0})
    assert (found.rests, found.rest_s > 10.0) == (0, True)
    assert dict(found.missing)["surveys"].startswith("no rest lasted 22 s")


@pytest.mark.fault_case(50)
@pytest.mark.parametrize(("every", "known"), [(100, False), (25, False), (10, True)])
def test_samples_that_are_too_few_to_judge_a_rest_are_not_called_motion(every, known, sent, tmp_path):
    imu, mag = sent
    found = inspected(written(tmp_path / "bag", imu[::every], mag), PLACE)
    assert (found.rests is not None) == known
    assert ("too few samples" in dict(found.missing).get("surveys", "")) != known


def test_what_is_missing_is_named_with_the_result_that_needs_it(sent, tmp_path):
    found = inspected(written(tmp_path / "bag", *sent), place={})
    assert [result for result, _ in found.missing] == [
        "true north, checks of the field",
        "gyro azimuth",
        "depths, path, exports",
    ]
    assert shlex.split(found.command)[5:] == []


def test_gaps_repeated_stamps_and_another_clock_are_named(sent, tmp_path):
    imu, mag = (one.copy() for one in sent)
    imu = np.delete(imu, np.arange(1000, 1150))
    imu["stamp_ns"][500] = imu["stamp_ns"][499]
    found = inspected(written(tmp_path / "bag", imu, mag, late_ns=90_000_000_000))
    text = found.remarks
    assert "/sensors/imu: a gap of 1.51 s, 10.0 s after the start" in text
    assert "/sensors/imu: a sample has the stamp of the sample before it" in text
    assert "/sensors/mag: its clock is 90.0 s behind the clock of the recorder" in text

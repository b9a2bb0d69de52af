# SPDX-License-Identifier: Apache-2.0
"""The task of one worker: a recording becomes rows, once; what cannot be worked out is a row with its reason."""

import dataclasses

import numpy as np
import pyarrow.parquet as parquet
import pytest
import yaml

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_surface import __version__
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.fleet import fleet_dataset, fleet_task
from mwd_surface.fleet.fleet_dataset import DONE, FAILED
from mwd_surface.fleet.fleet_task import FleetWork
from mwd_surface.processing.bag_input import InputSettings

START = 1_772_344_800_000_000_000
CONFIG = fleet_task.config_text(settings.changed(EstimatorSettings(), {"gravity.method": "raw"}))


def recorded(path, **parameters):
    """A tool of two wells that keeps still for 16 s, recorded with parameters of the estimator."""
    rows = wire.IMU.empty(800)
    rows["stamp_ns"] = START + np.arange(800) * 20_000_000
    rows["linear_acceleration"] = np.array([-7.0, 2.0, 6.5])
    with BagWriter(path) as bag:
        for well in ("well_1", "well_2"):
            topic = bag.topic(f"/{well}/imu/data_raw", wire.IMU.type_name)
            bag.write_rows(topic, wire.IMU.encode(rows, "sonde_link"), rows["stamp_ns"])
        if parameters:
            bag.add_metadata("parameters/estimator", parameters)


def work_on(folder, **changes):
    """Return the task of the recording in a folder, whose rows go beside it."""
    given = {"config": CONFIG, "given": InputSettings(), **changes}
    return FleetWork(str(folder / "bag"), str(folder / "fleet"), **given)


@pytest.fixture
def work(tmp_path):
    recorded(tmp_path / "bag")
    return work_on(tmp_path)


def table(work, name):
    return parquet.read_table(f"{work.folder}/{name}").to_pylist()


def test_a_recording_becomes_rows_of_every_well(work):
    outcome = fleet_task.carry_out(work)
    assert not outcome.kept
    row = outcome.row
    assert (row["outcome"], row["wells"], row["samples"], row["surveys"]) == (DONE, 2, 1600, 2)
    assert row["surveys_accepted"] + row["surveys_doubtful"] + row["surveys_rejected"] == 2
    assert (row["start_ns"], row["end_ns"]) == (START, START + 799 * 20_000_000)
    assert row["seconds"] == pytest.approx(2 * 15.98)
    tilt = np.degrees(np.arctan2(np.hypot(2.0, 6.5), 7.0))
    assert row["inclination_lowest_deg"] == pytest.approx(tilt, abs=0.01)
    assert (row["version"], row["method"]) == (__version__, "raw")
    assert table(work, "bags") == [row]
    assert {s["well"] for s in table(work, "surveys")} == {"well_1", "well_2"}
    assert [s["inclination_deg"] for s in table(work, "surveys")] == pytest.approx([tilt] * 2, abs=0.01)
    # Without a magnetometer there is no azimuth, and no zero in its place.
    assert [s["azimuth_deg"] for s in table(work, "surveys")] == [None, None]
    assert sum(a["samples"] for a in table(work, "attitude")) == 1600


def test_the_second_time_nothing_is_worked_out(work, monkeypatch):
    first = fleet_task.carry_out(work)
    monkeypatch.setattr(fleet_task, "_tables", None)
    again = fleet_task.carry_out(work)
    assert again.kept
    assert (again.key, again.row) == (first.key, first.row)


def test_other_settings_or_another_reading_are_another_result(work):
    keys = {fleet_task.carry_out(work).key}
    other = fleet_task.config_text(
        settings.changed(EstimatorSettings(), {"gravity.method": "raw", "survey.duration_s": 4.0})
    )
    keys.add(fleet_task.carry_out(dataclasses.replace(work, config=other)).key)
    one_well = dataclasses.replace(work, given=InputSettings(imu_topic="/well_2/imu/data_raw"))
    outcome = fleet_task.carry_out(one_well)
    keys.add(outcome.key)
    assert outcome.row["wells"] == 1
    assert len(keys) == 3


def test_a_recording_brings_its_own_settings_unless_a_file_or_an_option_says_otherwise(tmp_path):
    recorded(tmp_path / "bag", **{"gravity.method": "mahony", "gravity.unheard_of": "1.0"})
    own = fleet_task.carry_out(work_on(tmp_path, changes=fleet_task.changes_text({}))).row
    assert own["method"] == "mahony"
    assert any("gravity.unheard_of" in one for one in own["warnings"])
    for changes, method in ((fleet_task.changes_text({"gravity.method": "kalman"}), "kalman"), ("", "raw")):
        assert fleet_task.carry_out(work_on(tmp_path, changes=changes)).row["method"] == method


def test_place_and_day_come_from_the_recording_and_an_old_day_has_the_older_model(tmp_path):
    place = {"place.field": "model", "place.lat_deg": "59.9", "place.lon_deg": "10.7", "place.date": "2019-03-01"}
    recorded(tmp_path / "bag", **place)
    work = work_on(tmp_path, changes=fleet_task.changes_text({}))
    row = fleet_task.carry_out(work).row
    assert row["outcome"] == DONE
    assert any("IGRF" in warning for warning in row["warnings"])
    assert all(survey["dip_reference_deg"] > 70.0 for survey in table(work, "surveys"))


def test_the_settings_a_worker_is_given_hold_every_one_of_them():
    chosen = settings.changed(EstimatorSettings(), {"gravity.method": "s3"})
    text = fleet_task.config_text(chosen)
    assert settings.from_mapping(EstimatorSettings, yaml.safe_load(text)) == chosen
    assert set(yaml.safe_load(text)) == set(settings.to_mapping(chosen))


def test_a_recording_that_is_not_there_is_an_outcome_without_a_key(work, tmp_path):
    outcome = fleet_task.carry_out(dataclasses.replace(work, bag=str(tmp_path / "gone.mcap")))
    assert (outcome.key, outcome.row["outcome"]) == ("", FAILED)
    assert outcome.row["reason"] == "cannot be read: No such file or directory"
    assert set(outcome.row) == set(fleet_dataset.SCHEMAS["bags"].names)
    assert not (tmp_path / "fleet").exists()


def test_a_recording_that_fails_has_a_row_with_its_reason_and_is_tried_again(work):
    wrong = dataclasses.replace(work, given=InputSettings(imu_topic="/nobody"))
    for _ in range(2):
        outcome = fleet_task.carry_out(wrong)
        assert (outcome.row["outcome"], outcome.kept) == (FAILED, False)
    assert "/nobody" in outcome.row["reason"]
    assert [row["reason"] for row in table(work, "bags")] == [outcome.row["reason"]]
    assert table(work, "surveys") == []


def test_a_full_disk_is_no_outcome_but_an_error(work, tmp_path):
    (tmp_path / "fleet").write_text("a file where the folder should be")
    with pytest.raises(OSError, match="fleet"):
        fleet_task.carry_out(work)

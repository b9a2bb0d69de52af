# SPDX-License-Identifier: Apache-2.0
"""config.yaml of a run: what was in force, read back as it was; other files in its place are refused in a sentence."""

from pathlib import Path

import pytest
import yaml

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings
from mwd_sensors.core.settings import SettingsError
from mwd_surface.processing.bag_input import InputSettings, Topics
from mwd_surface.processing.run_config import config_text, estimator_config, input_text, processed_input, read_config
from mwd_surface.processing.run_output import OutputSettings

TOPICS = Topics("/well_1/imu/data_raw", "/well_1/imu/mag", None, None, None)


def written(estimator=None, given=None, wanted=None):
    return config_text(estimator or EstimatorSettings(), given or InputSettings(), wanted or OutputSettings(), TOPICS)


def test_settings_of_results_that_this_version_cannot_use_are_left_out_and_named(tmp_path):
    before = settings.to_mapping(settings.changed(EstimatorSettings(), {"tool.gyro.bias_deg_h": 5.0}))
    before["tool"]["gyro"]["walk_deg_h_sqrt_h"] = 10.0
    before["tool"]["calibration_mrad"] = 0.15
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(before, sort_keys=False))
    (tmp_path / "input.yaml").write_text(input_text(Path("bag"), InputSettings(), calibrated=False))
    found = processed_input(tmp_path)
    assert found.estimator == settings.changed(EstimatorSettings(), {"tool.gyro.bias_deg_h": 5.0})
    assert [remark.partition(" of the results is not used: ")[0] for remark in found.remarks] == [
        "tool.gyro.walk_deg_h_sqrt_h = 10.0",
        "tool.calibration_mrad = 0.15",
    ]


def test_topics_and_what_was_asked_beside_the_settings_stand_in_comments_and_no_default():
    text = written(given=InputSettings(mag_unit="uT", end_s=9.0), wanted=OutputSettings(rate_hz=10.0))
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments[1:] == [
        "# imu: /well_1/imu/data_raw",
        "# mag: /well_1/imu/mag",
        "# mag_unit: uT",
        "# end_s: 9.0",
        "# rate_hz: 10.0",
    ]


def test_a_ros_parameter_file_serves_as_configuration_and_an_empty_one_changes_nothing(tmp_path):
    path = tmp_path / "estimator.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"gravity.method": "s3", "survey.duration_s": 4.0}}}))
    assert read_config(path) == {"gravity": {"method": "s3"}, "survey": {"duration_s": 4.0}}
    path.write_text(yaml.safe_dump({"estimator": {"ros__parameters": {"survey": {"duration_s": 4.0}}}}))
    assert read_config(path) == {"survey": {"duration_s": 4.0}}
    path.write_text("# empty\n")
    assert read_config(path) == {}
    with pytest.raises(FileNotFoundError):
        read_config(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("survay: {}", "survay: no such setting; did you mean survey"),
        ("tool: {nonsense: {}}", r"tool\.nonsense: no such setting"),
        ("{tool: 5, tool.latency_s: 0.03}", r"tool\.latency_s: tool is not a table, but 5"),
        ("{tool.latency_s: 0.03, tool: 5}", "tool: is a table of settings, but also given as 5"),
        ("[1, 2]", r"config\.yaml.*expected a table"),
        ("a: [", r"config\.yaml.*is not YAML"),
        (b"\xff\xfe", r"config\.yaml.*is not UTF-8 text"),
        *(
            (table.format(day), rf"config\.yaml: .*place\.date.*{day}")
            for day in ("2026-02-30", "2026-13-01", "soon")
            for table in ("place: {{date: {}}}", "/**: {{ros__parameters: {{place.date: {}}}}}")
        ),
    ],
)
def test_a_file_that_is_no_table_or_says_something_else_than_it_means_is_refused(tmp_path, content, message):
    path = tmp_path / "config.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SettingsError, match=message):
        estimator_config(path)


def test_what_was_read_and_how_comes_back_from_the_folder_of_the_results(tmp_path):
    assert processed_input(tmp_path) is None
    chosen = settings.changed(EstimatorSettings(), {"survey.duration_s": 5.0})
    given = InputSettings(mag_unit="uT", start_s=9.0, depths="depths.csv")
    (tmp_path / "config.yaml").write_text(written(chosen, given))
    (tmp_path / "input.yaml").write_text(input_text(Path("bags/run_7"), given, calibrated=True))
    found = processed_input(tmp_path)
    assert (found.recording, found.calibrated, found.estimator) == (Path("bags/run_7").resolve(), True, chosen)
    assert found.given == InputSettings(mag_unit="uT", start_s=9.0, depths=str(Path("depths.csv").resolve()))


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[1]", "recording: bag", "{recording: 7, calibrated: false}", "{recording: a, calibrated: maybe}"],
)
def test_an_edited_file_of_what_was_read_is_refused_by_name(tmp_path, text):
    (tmp_path / "config.yaml").write_text(written(EstimatorSettings()))
    (tmp_path / "input.yaml").write_text(text)
    with pytest.raises(SettingsError, match=r"input\.yaml"):
        processed_input(tmp_path)

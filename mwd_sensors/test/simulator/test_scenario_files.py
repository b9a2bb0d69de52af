# SPDX-License-Identifier: Apache-2.0
"""Scenarios are found by name or path, installed or in a checkout, and the documents list those that exist."""

import re

import pytest

from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator import scenario, scenario_files
from mwd_sensors.simulator.sonde import Sonde
from project import ROOT


@pytest.fixture
def checkout(monkeypatch):
    """Neither ROS nor this Python has the package installed."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr("sys.prefix", "/nowhere")


def test_in_a_checkout_the_scenarios_are_those_of_bags(checkout):
    assert scenario_files.folder() == ROOT / "bags" / "scenarios"
    names = scenario_files.names()
    assert {"default", "tumble", "bench/rot155"} <= set(names)
    assert scenario_files.find("bench/rot155") == ROOT / "bags" / "scenarios" / "bench" / "rot155.yaml"


def test_without_a_source_tree_the_installed_ones_are_found(checkout, monkeypatch, tmp_path):
    monkeypatch.setattr(scenario_files, "_SOURCES", tmp_path / "none")
    place = tmp_path / "share" / "mwd_sensors" / "scenarios"
    place.mkdir(parents=True)
    (place / "mine.yaml").write_text("name: mine")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert scenario_files.names() == {"mine": place / "mine.yaml"}


def test_a_path_does_as_well_and_an_unknown_name_gets_its_near_misses(checkout, tmp_path):
    (tmp_path / "own.yaml").write_text("name: own")
    assert scenario_files.find(str(tmp_path / "own.yaml")) == tmp_path / "own.yaml"
    with pytest.raises(SettingsError, match="defualt: no such scenario or file; did you mean default"):
        scenario_files.find("defualt")
    with pytest.raises(SettingsError, match=r"no such scenario or file; known: .*demo"):
        scenario_files.find("xyz")


def test_without_any_the_way_out_is_named(checkout, monkeypatch, tmp_path):
    monkeypatch.setattr(scenario_files, "_SOURCES", tmp_path / "none")
    with pytest.raises(SettingsError, match="give the path of a YAML file"):
        scenario_files.folder()


@pytest.mark.slow
def test_the_table_of_the_readme_lists_every_scenario_with_its_length(checkout):
    rows = re.findall(r"^\| `([\w/]+)` \| (\d+) (s|min) \|", (ROOT / "bags" / "README.md").read_text(), re.MULTILINE)
    assert {name for name, _, _ in rows} == set(scenario_files.names())
    for name, length, unit in rows:
        seconds = Sonde(scenario.read(scenario_files.find(name))).duration
        assert abs(seconds - float(length) * (60.0 if unit == "min" else 1.0)) <= (30.0 if unit == "min" else 0.6), name


def test_the_scenario_of_the_document_can_be_simulated():
    text = (ROOT / "docs" / "guide" / "scenarios.md").read_text()
    given = scenario.parse(re.search(r"```yaml\n(.*?)```", text, re.DOTALL).group(1))
    block = next(Sonde(given).blocks(1.0))
    assert given.name == "my_well"
    assert len(block["imu/data_raw"]) > 90


def test_the_mistake_of_the_document_is_answered_as_it_says():
    with pytest.raises(SettingsError, match=r"vibration.shoks: no such setting; did you mean shocks\?"):
        scenario.parse("{name: mine, vibration: {shoks: []}}")

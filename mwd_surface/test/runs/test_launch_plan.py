# SPDX-License-Identifier: Apache-2.0
"""What `mwd run` starts: arguments ROS understands, and nothing two runs could share by accident."""

import dataclasses
import os
import socket
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import yaml

from mwd_estimation.core.north import North
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import reference_of
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import settings
from mwd_sensors.simulator.motion import well_path
from mwd_sensors.simulator.scenario import parse, read
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.commands.node import node_main
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.runs import launch_plan
from mwd_surface.surveys.leg_settings import arranged
from mwd_surface.surveys.survey_list import SurveyList
from project import SCENARIOS

SURE = (1e-8, 0.0, 0.0, 0.0, 1e-8, 0.0, 0.0, 0.0, 1e-8)


def test_parameters_keep_their_type_through_the_yaml_of_ros():
    given = {
        "a": 30.0,
        "b": 1e-7,
        "c": True,
        "d": "2026-03-01",
        "e": 7,
        "f": ["x", "y:1"],
        "g": "it's",
        "h": -1.5e-9,
        "i": "",
    }
    words = launch_plan.parameter_words(given)
    read = {}
    for flag, word in zip(words[::2], words[1::2], strict=True):
        assert flag == "-p"
        name, _, value = word.partition(":=")
        read[name] = yaml.safe_load(value)
    assert read == given
    assert {name: type(value) for name, value in read.items()} == {name: type(value) for name, value in given.items()}


@pytest.mark.parametrize("override", ["", "field_override: [48000.0, 62.5, -3.0]"])
def test_the_estimator_gets_the_field_of_the_scenario(override):
    scenario = parse(f"{{name: x, date: 2026-05-04T10:00:00, {override}}}")
    set_value = settings.changed(EstimatorSettings(), launch_plan.reference_parameters(scenario))
    reference, truth = reference_of(set_value.place, 0), Sonde(scenario).reference
    assert reference.total == pytest.approx(truth.total, rel=1e-12)
    assert reference.dip == pytest.approx(truth.dip, rel=1e-12)
    assert reference.declination == pytest.approx(truth.declination, rel=1e-9)


def test_a_well_is_a_ros_namespace():
    assert launch_plan.checked_well("/pad_7/well_2/") == "pad_7/well_2"
    for bad in ("well 1", "7b", "a//b", "", "ä"):
        with pytest.raises(ValueError, match="letters, digits and underscores"):
            launch_plan.checked_well(bad)


def test_two_runs_at_once_get_two_ports_and_none_gets_a_port_that_is_taken():
    with launch_plan.page_port(None) as first, launch_plan.page_port(None) as second:
        assert first != second
        with pytest.raises(ValueError, match="another program listens there already"), launch_plan.page_port(first):
            pass
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"--port {port}"), launch_plan.page_port(port):
            pass


def test_rig_interfaces_of_a_run_are_on_this_machine_and_never_on_a_port_of_another_run():
    with launch_plan.rig_parameters() as first, launch_plan.rig_parameters() as second:
        assert first["rig.wits0_server.enabled"] is True
        ports = [value for given in (first, second) for key, value in given.items() if key.endswith(".port")]
        assert len(set(ports)) == len(ports)
        assert not any(key.endswith((".host", ".allow_network")) for key in first)
        assert len(launch_plan.rig_addresses(first)) == len(ports) // 2
        assert f"WITS 127.0.0.1:{first['rig.wits0_server.port']}" in launch_plan.rig_addresses(first)
    assert launch_plan.rig_addresses({}) == []


def test_a_rig_interface_whose_package_is_missing_stays_off(monkeypatch):
    monkeypatch.setattr(launch_plan.importlib.util, "find_spec", lambda _name: None)
    with launch_plan.rig_parameters() as parameters:
        assert [key for key in parameters if key.endswith(".enabled")] == ["rig.wits0_server.enabled"]


def test_two_runs_at_once_get_two_domains():
    with launch_plan.own_domain({}) as first, launch_plan.own_domain({}) as second:
        assert first != second
        assert 1 <= first <= 101


def test_the_domain_somebody_chose_is_kept():
    with launch_plan.own_domain({"ROS_DOMAIN_ID": "42"}) as domain:
        assert domain == 42
    with pytest.raises(ValueError, match="ROS_DOMAIN_ID is 'x'"), launch_plan.own_domain({"ROS_DOMAIN_ID": "x"}):
        pass


def test_nodes_are_discovered_on_this_machine_only_unless_set_otherwise(tmp_path):
    environment = launch_plan.graph_environment({}, 5, tmp_path)
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert environment["ROS_DOMAIN_ID"] == "5"
    assert Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"]).is_file()
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTRTPS_DEFAULT_PROFILES_FILE": "mine.xml"}
    set_value = launch_plan.graph_environment(own, 5, tmp_path)
    assert {name: set_value[name] for name in own} == own


def test_a_node_started_alone_has_the_same_middleware_unless_another_is_set(monkeypatch):
    monkeypatch.setitem(sys.modules, "some_node", types.SimpleNamespace(main=int))
    monkeypatch.setenv(launch_plan.PROFILES, "mine.xml")
    assert node_main("some_node") is int
    assert os.environ[launch_plan.PROFILES] == "mine.xml"
    monkeypatch.delenv(launch_plan.PROFILES)
    node_main("some_node")
    assert os.environ[launch_plan.PROFILES] == str(launch_plan.MIDDLEWARE)


def test_the_graph_to_visit_is_the_one_asked_for_else_the_one_that_runs():
    assert launch_plan.visited_domain({}, 7) == 7
    assert launch_plan.visited_domain({"ROS_DOMAIN_ID": "42"}, None) == 42
    with pytest.raises(ValueError, match="domain x: expected a number"):
        launch_plan.visited_domain({"ROS_DOMAIN_ID": "x"}, None)
    with (
        launch_plan.own_domain({}),
        launch_plan.own_domain({}),
        pytest.raises(ValueError, match="choose one with --domain"),
    ):
        launch_plan.visited_domain({}, None)


def test_locks_lie_in_a_folder_of_this_user_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with launch_plan.own_domain({}) as domain:
        assert (tmp_path / "mwd" / f"domain_{domain}.lock").is_file()
        assert (tmp_path / "mwd").stat().st_mode & 0o777 == 0o700
    (tmp_path / "mwd").chmod(0o777)
    with pytest.raises(ValueError, match="every middleware domain"), launch_plan.own_domain({}):
        pass


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENARIOS.glob("*.yaml")))
def test_the_path_of_each_scenario_starts_on_the_hole_that_the_simulator_drills(name):
    scenario = read(SCENARIOS / f"{name}.yaml")
    given = {k: v for k, v in launch_plan.surface_parameters(scenario).items() if k.startswith("leg.")}
    leg = settings.changed(SurfaceSettings(), given).leg
    assert leg.tie_on_vertical_depth is not None
    whole = arranged(SurveyList(), leg)
    well = scenario.well
    hole = well_path(*well.hole)
    first = max(well.bit_m - well.sensor_to_bit_m, 0.5)
    deeper = [row for row in zip(*well.hole, strict=True) if row[0] > leg.tie_on_depth]
    for k, (md, inclination, azimuth) in enumerate(deeper, start=1):
        survey = Survey(k, f"u{k}", k, float(inclination), float(azimuth), int(North.TRUE), covariance=SURE)
        whole = whole.add(survey, md, 0.0)
    assert not whole.definitive(bit_depth=first).assumed
    if launch_plan.tie_on_parameters(scenario).items() <= given.items():
        for record in whole.records:
            position = record.north, record.east, record.vertical_depth
            at = int(np.searchsorted(hole.md, record.measured_depth))
            assert position == pytest.approx(tuple(hole.position[at]), abs=1e-6)


def test_a_tie_on_of_the_scenario_s_author_replaces_the_whole_of_the_simulated_one():
    scenario = dataclasses.replace(read(SCENARIOS / "telemetry_deep.yaml"), surface={"leg.tie_on_depth": 50.0})
    tied = {k: v for k, v in launch_plan.surface_parameters(scenario).items() if k.startswith("leg.")}
    assert tied == {"leg.tie_on_depth": 50.0}

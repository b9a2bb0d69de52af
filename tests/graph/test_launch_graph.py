# SPDX-License-Identifier: Apache-2.0
"""The launch file of a well: the processes it describes, and these run to a survey."""

import pytest
import yaml

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan
from project import ROOT
from recorded_launch import processes
from running_graph import EXECUTABLES, until

LAUNCH = ROOT / "mwd_surface" / "launch" / "mwd.launch.py"
STORY = ROOT / "tests" / "graph" / "scenarios" / "short.yaml"


@pytest.mark.parametrize(
    ("source", "nodes"),
    [
        ("simulated", ["surface", "estimator", "sonde"]),
        ("probe", ["surface", "estimator", "probe"]),
        ("topics", ["surface", "estimator"]),
    ],
)
def test_each_source_starts_its_nodes_in_the_namespace_with_their_own_parameter_files(source, nodes):
    described = processes(LAUNCH, source=source, namespace="w1", surface_params_file="s.yaml", imu="/driver/imu")
    assert [one.executable for one in described.processes] == nodes
    for one in described.processes:
        assert one.package == EXECUTABLES[one.executable]
        assert (one.namespace, one.respawn) == ("w1", True)
        assert "imu/data_raw:=/driver/imu" in one.words
        files = [word for flag, word in zip(one.words, one.words[1:], strict=False) if flag == "--params-file"]
        assert files[0] == str(ROOT / one.package / "config" / f"{one.executable}.yaml")
        # A file for one node is laid over that one alone.
        assert ("s.yaml" in files) == (one.executable == "surface")
        assert ("wait_for_node:=estimator" in one.words) == (one.executable == "sonde")
        assert all((ROOT / one.package / "config" / file).exists() for file in files if file != "s.yaml")
    assert described.environment["FASTRTPS_DEFAULT_PROFILES_FILE"].endswith("fastdds.xml")


def test_another_source_is_refused_with_those_there_are():
    with pytest.raises(RuntimeError, match="simulated, probe, topics"):
        processes(LAUNCH, source="tool")


@pytest.mark.ros
@pytest.mark.slow(15)
def test_what_the_launch_file_starts_records_a_survey_and_ends_when_told(tmp_path):
    parameters = {
        "surface": {"folder": str(tmp_path / "data"), "page.port": 0, "record.name": "run"},
        "estimator": launch_plan.reference_parameters(read(STORY)),
        "sonde": {"scenario": str(STORY), "rate": 2.0},
    }
    file = tmp_path / "parameters.yaml"
    file.write_text(yaml.safe_dump({"/**": {node: {"ros__parameters": given} for node, given in parameters.items()}}))
    described = processes(LAUNCH, source="simulated", namespace="w1", params_file=str(file))
    with running_graph.graph(tmp_path) as graph:
        graph.environment |= described.environment
        names = [graph.start(one.executable, arguments=one.words) for one in described.processes]
        for name in names:
            until(lambda name=name: ": active" in graph.log(name), 120, f"{name} is active")
        until(lambda: "survey 2" in graph.log(names[0]), 120, "two surveys")
        assert [graph.end(name)[0] for name in reversed(names)] == [0, 0, 0]
        assert not any("Traceback" in graph.log(name) for name in names)
    (recording,) = (tmp_path / "data").rglob("*.mcap")
    with Bag(recording) as bag:
        counts = {name: topic.count for name, topic in bag.topics.items()}
    assert counts["/w1/survey"] >= 2
    assert counts["/w1/attitude"] > 1000

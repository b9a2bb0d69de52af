# SPDX-License-Identifier: Apache-2.0
"""The processes that the launch file of a well describes; `test_graph.py` runs them."""

import pytest

from project import ROOT
from recorded_launch import processes
from running_graph import EXECUTABLES

LAUNCH = ROOT / "mwd_surface" / "launch" / "mwd.launch.py"


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

# SPDX-License-Identifier: Apache-2.0
"""The programs of docs/rig/control.md against a surface node with the parameters printed above them."""

import asyncio
import re
import shutil
import subprocess
import sys

import pytest
from test_conformance import certified

import running_graph
from project import ROOT
from running_graph import CALL, until

PAGE = ROOT / "docs" / "rig" / "control.md"
pytestmark = [pytest.mark.ros, pytest.mark.slow(40)]

# A person who grants what waits.
PERSON = (
    CALL
    + """
import sys
from mwd_msgs.msg import ControlState
from mwd_msgs.srv import JudgeControl
rclpy.init()
node = rclpy.create_node("person", namespace=sys.argv[1])
seen = []
node.create_subscription(ControlState, "control/state", seen.append, 10)
while True:
    rclpy.spin_once(node, timeout_sec=0.1)
    if seen and seen[-1].pending:
        call(node, JudgeControl, "judge_control", decision=0, number=seen[-1].pending, operator_name="toolpusher")
        seen.clear()
"""
)


def block(language, title):
    """The first block of a language under a heading of the page."""
    section = PAGE.read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]
    return re.search(rf"```{language}\n(.*?)```", section, re.DOTALL).group(1)


def test_the_controllers_of_the_page_run_with_the_parameters_of_the_page(tmp_path):
    (tmp_path / "parameters.yaml").write_text(block("yaml", "Enabling it"))
    opcua = tmp_path / "data" / "well_1" / "opcua"
    (opcua / "trusted").mkdir(parents=True)
    certificate, key = asyncio.run(certified(tmp_path))
    shutil.copy(certificate, opcua / "trusted")
    with running_graph.graph(tmp_path) as graph:
        free = {"folder": tmp_path / "data", "page__port": 0, "rig__opcua__port": 0, "rig__modbus__port": 0}
        surface = graph.start(
            "surface", "well_1", arguments=["--params-file", str(tmp_path / "parameters.yaml")], **free
        )
        sonde = graph.start("sonde", "well_1", scenario=ROOT / "tests" / "graph" / "scenarios" / "steered.yaml")
        until(lambda: ": active" in graph.log(surface) and "scenario steered" in graph.log(sonde), 90, "both run")
        status = tmp_path / "data" / "well_1" / "rig_status.json"
        found = r"(opc\.tcp://[^\"]+).*(127\.0\.0\.1):(\d+)\""
        until(lambda: status.exists() and re.search(found, status.read_text(), re.DOTALL), 60, "the ports are open")
        url, host, port = re.search(found, status.read_text(), re.DOTALL).groups()

        def run(name, text, *arguments):
            (tmp_path / f"{name}.py").write_text(text)
            words = [sys.executable, tmp_path / f"{name}.py", *arguments]
            with (tmp_path / f"{name}.log").open("w") as log:
                graph.running[name] = subprocess.Popen(
                    list(map(str, words)), env=graph.environment, stdout=log, stderr=subprocess.STDOUT
                )
            return graph.running[name]

        run("person", PERSON, "/well_1")
        keys = (certificate, key, opcua / "own.der", "urn:mwd:conformance")
        programs = {"ROS": ("/well_1",), "OPC UA": (url, "well", *keys), "Modbus": (host, port, 7)}
        said = {}
        for title, arguments in programs.items():
            assert run(title, block("python", title), *arguments).wait(400) == 0, (
                tmp_path / f"{title}.log"
            ).read_text()
            said[title] = (tmp_path / f"{title}.log").read_text()
    assert "the driller controls top drive and pumps" in said["ROS"]
    assert "the driller controls top drive and pumps" in said["OPC UA"]
    assert "done" in said["Modbus"]
    assert graph.log(surface).count("granted by toolpusher") == 3

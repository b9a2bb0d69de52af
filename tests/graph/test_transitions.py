# SPDX-License-Identifier: Apache-2.0
"""Every lifecycle transition of every node, twice each, while the others send: no node crashes or falls silent."""

import subprocess
import sys

import pytest

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_sensors.telemetry import tool_configuration
from mwd_surface.runs import launch_plan
from project import ROOT
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(25)]
TIMES = 2
PLACE = {name.replace(".", "__"): value for name, value in running_graph.PLACE.items()}
LINK = ROOT / "tests" / "graph" / "scenarios" / "two_links.yaml"

SCRIPT = (
    running_graph.CALL
    + """
import sys, time
from lifecycle_msgs.msg import Transition as T
from lifecycle_msgs.srv import ChangeState, GetState
rclpy.init()
node = rclpy.create_node("manager")
times, names = int(sys.argv[1]), sys.argv[2:]
STATES = {1: "unconfigured", 2: "inactive", 3: "active"}
def change(name, number, label):
    done = call(node, ChangeState, f"{name}/change_state", transition=T(id=number))
    assert done.success, (name, number)
    time.sleep(0.2)  # of traffic in the new state
    state = call(node, GetState, f"{name}/get_state").current_state.label
    assert state == label, (name, state, label)
for name in names:
    for k in range(times):
        change(name, T.TRANSITION_DEACTIVATE, "inactive")
        change(name, T.TRANSITION_ACTIVATE, "active")
        change(name, T.TRANSITION_DEACTIVATE, "inactive")
        change(name, T.TRANSITION_CLEANUP, "unconfigured")
        change(name, T.TRANSITION_CONFIGURE, "inactive")
        change(name, T.TRANSITION_CLEANUP, "unconfigured")
        change(name, T.TRANSITION_CONFIGURE, "inactive")
        change(name, T.TRANSITION_ACTIVATE, "active")
        print(name, k + 1, flush=True)
print("all active", flush=True)
"""
)


def wait_active(graph, *nodes):
    for name in nodes:
        until(lambda name=name: ": active" in graph.log(name), 120, f"{name} is active")


def well(graph, folder):
    """A simulated tool, the estimator and the surface, each in a process."""
    surface = graph.start("surface", "w1", folder=folder / "data", page__port=0, control__enabled=True)
    estimator = graph.start("estimator", "w1", **PLACE)
    wait_active(graph, surface)
    sonde = graph.start("sonde", "w1", scenario="s3_rotation", rate=1.0, wait_for_listener_s=60.0)
    wait_active(graph, estimator, sonde)
    return (surface, estimator, sonde), ("/w1/surface", "/w1/estimator", "/w1/sonde")


def one_process(graph, folder):
    """The same three in one process and one executor."""
    parameters = {
        "surface": {"folder": str(folder / "data"), "page.port": 0},
        "estimator": running_graph.PLACE,
        "sonde": {"scenario": "s3_rotation", "rate": 1.0, "wait_for_listener_s": 60.0},
    }
    file = folder / "parameters.yaml"
    file.write_text(launch_plan.parameter_yaml(parameters, "w1"))
    process = graph.start("well", "w1", arguments=["--params-file", str(file)])
    until(lambda: graph.log(process).count(": active") >= 3, 120, "the nodes are active")
    return (process,), ("/w1/surface", "/w1/sonde", "/w1/estimator")


def link(graph, folder):
    """A link: the receiver hears the gauge of a simulated rig, and the surface hears the receiver."""
    telemetry = read(LINK).telemetry
    files = {}
    for name, tool in (("tool_file", telemetry.tool), ("second_tool_file", telemetry.second_tool)):
        files[name] = folder / f"{name}.yaml"
        files[name].write_text(tool_configuration.text(tool))
    surface = graph.start("surface", "w1", link__source="best", folder=folder / "data", page__port=0)
    receiver = graph.start("receiver", "w1", **files, **PLACE)
    estimator = graph.start("estimator", "w1", **{f"transmit__{name}": file for name, file in files.items()}, **PLACE)
    wait_active(graph, surface, receiver, estimator)
    sonde = graph.start("sonde", "w1", scenario=LINK, rate=1.0, wait_for_listener_s=60.0)
    wait_active(graph, sonde)
    return (surface, receiver, estimator, sonde), ("/w1/receiver", "/w1/surface")


def replayed(graph, folder):
    """A recording in a loop, and the estimator that listens to it."""
    estimator = graph.start("estimator", "w1", **PLACE)
    surface = graph.start("surface", "w1", folder=folder / "data", page__port=0)
    wait_active(graph, estimator, surface)
    settings = {"bag": ROOT / "bags" / "golden" / "stations" / "bag", "loop": True, "sensors_only": True}
    replay = graph.start("replay", "w1", **settings)
    wait_active(graph, replay)
    return (surface, estimator, replay), ("/w1/replay", "/w1/surface")


def probe(graph, folder):
    """A probe on a serial line that an emulator plays a recording into."""
    estimator = graph.start("estimator", "w1", **PLACE)
    wait_active(graph, estimator)
    line = folder / "line"
    words = ["emulate", ROOT / "bags" / "golden" / "stations" / "bag", "--protocol", "binary", "--link", line, "--wait"]
    with (folder / "emulator.log").open("w") as log:
        words = [sys.executable, "-P", "-m", "mwd_surface.cli", *map(str, words)]
        graph.running["emulator"] = subprocess.Popen(
            words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
        )
    until(line.exists, 60, "the line is there")
    node = graph.start("probe", "w1", port=line, protocol="binary", clock="unit")
    wait_active(graph, node)
    return (estimator, node), ("/w1/probe",)


@pytest.mark.parametrize("start", [well, one_process, link, replayed, probe])
def test_a_node_goes_through_its_transitions_while_the_others_send(tmp_path, start):
    with running_graph.graph(tmp_path) as graph:
        processes, names = start(graph, tmp_path)
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(TIMES), *names],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        ended = {name: graph.running[name].poll() for name in processes}
        assert set(ended.values()) == {None}, (ended, done.stdout, done.stderr)
        assert "all active" in done.stdout, (done.stdout, done.stderr[-2000:])
        for name in processes:
            assert graph.end(name)[0] == 0, graph.log(name)

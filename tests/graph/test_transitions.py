# SPDX-License-Identifier: Apache-2.0
"""Every lifecycle transition of every node, twice each, while the others send: no node crashes or falls silent."""

import sys

import pytest

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_sensors.telemetry import tool_configuration
from mwd_surface.runs import launch_plan
from project import ROOT
from running_graph import CALL, MWD, PLACE, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(11)]
LINK = ROOT / "tests" / "graph" / "scenarios" / "two_links.yaml"
RECORDING = ROOT / "bags" / "golden" / "stations" / "bag"

SCRIPT = (
    CALL
    + """
import sys, time
from lifecycle_msgs.msg import Transition as T
from lifecycle_msgs.srv import ChangeState, GetState
rclpy.init()
node = rclpy.create_node("manager")
def change(name, number, label):
    done = call(node, ChangeState, f"{name}/change_state", transition=T(id=number))
    assert done.success, (name, number)
    time.sleep(0.2)  # of traffic in the new state
    state = call(node, GetState, f"{name}/get_state").current_state.label
    assert state == label, (name, state, label)
for name in sys.argv[1:]:
    change(name, T.TRANSITION_DEACTIVATE, "inactive")
    change(name, T.TRANSITION_ACTIVATE, "active")
    change(name, T.TRANSITION_DEACTIVATE, "inactive")
    for _ in range(2):
        change(name, T.TRANSITION_CLEANUP, "unconfigured")
        change(name, T.TRANSITION_CONFIGURE, "inactive")
    change(name, T.TRANSITION_ACTIVATE, "active")
    print(name, flush=True)
print("all active", flush=True)
"""
)


def one_process(graph, folder):
    """A simulated tool, the estimator and the surface in one process and one executor."""
    parameters = {
        "surface": {"folder": str(folder / "data"), "page.port": 0, "control.enabled": True},
        "estimator": PLACE,
        "sonde": {"scenario": "s3_rotation", "rate": 1.0, "wait_for_listener_s": 60.0},
    }
    file = folder / "parameters.yaml"
    file.write_text(launch_plan.parameter_yaml(parameters, "w1"))
    process = graph.start("well", "w1", arguments=["--params-file", str(file)])
    until(lambda: graph.log(process).count(": active") >= 3, 120, "the nodes are active")
    return (process,), ("w1/surface", "w1/sonde", "w1/estimator")


def link(graph, folder):
    """Each node in a process: the receiver hears the gauge of a simulated rig, and the surface hears the receiver."""
    telemetry = read(LINK).telemetry
    files = {}
    for name, tool in (("tool_file", telemetry.tool), ("second_tool_file", telemetry.second_tool)):
        files[name] = folder / f"{name}.yaml"
        files[name].write_text(tool_configuration.text(tool))
    surface = graph.start("surface", "w1", link__source="best", folder=folder / "data", page__port=0)
    receiver = graph.start("receiver", "w1", **files, **PLACE)
    estimator = graph.start("estimator", "w1", **{f"transmit__{name}": file for name, file in files.items()}, **PLACE)
    graph.active(surface, receiver, estimator)
    sonde = graph.start("sonde", "w1", scenario=LINK, rate=1.0, wait_for_listener_s=60.0)
    graph.active(sonde)
    return (surface, receiver, estimator, sonde), (receiver, surface, estimator, sonde)


def recordings(graph, folder):
    """A probe on a serial line that an emulator plays a recording into, and a replay of this recording in a loop."""
    estimator = graph.start("estimator", "w1", **PLACE)
    graph.active(estimator)
    line = folder / "line"
    graph.begin("emulator", *MWD, "emulate", RECORDING, "--protocol", "binary", "--link", line, "--wait")
    until(line.exists, 60, "the line is there")
    probe = graph.start("probe", "w1", port=line, protocol="binary", clock="unit")
    replay = graph.start("replay", "w1", bag=RECORDING, loop=True, sensors_only=True)
    graph.active(probe, replay)
    return (estimator, probe, replay), (probe, replay)


@pytest.mark.parametrize("start", [one_process, link, recordings])
def test_a_node_goes_through_its_transitions_while_the_others_send(tmp_path, start):
    with running_graph.graph(tmp_path) as graph:
        processes, names = start(graph, tmp_path)
        done = graph.run(sys.executable, "-c", SCRIPT, *(f"/{name}" for name in names))
        ended = {name: graph.running[name].poll() for name in processes}
        assert set(ended.values()) == {None}, (ended, done.stdout, done.stderr)
        assert "all active" in done.stdout, (done.stdout, done.stderr[-2000:])
        for name in processes:
            assert graph.end(name)[0] == 0, graph.log(name)

# SPDX-License-Identifier: Apache-2.0
"""Every lifecycle transition of every node, five times each, while the others send: no node crashes or falls silent."""

import subprocess
import sys

import pytest

import running_graph
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(120)]
TIMES = 5

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
    time.sleep(0.4)  # of traffic in the new state
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


def test_a_node_goes_through_its_transitions_while_the_others_send(tmp_path):
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", "w1", folder=tmp_path / "data", page__port=0, control__enabled=True)
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in running_graph.PLACE.items()})
        until(lambda: ": active" in graph.log(surface), 90, "the surface is active")
        sonde = graph.start("sonde", "w1", scenario="s3_rotation", rate=1.0, wait_for_listener_s=60.0)
        until(lambda: ": active" in graph.log(estimator) and ": active" in graph.log(sonde), 90, "both active")
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(TIMES), "/w1/surface", "/w1/estimator", "/w1/sonde"],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=400,
            check=False,
        )
        ended = {name: process.poll() for name, process in graph.running.items()}
        assert set(ended.values()) == {None}, (ended, done.stdout, done.stderr)
        assert "all active" in done.stdout, (done.stdout, done.stderr[-2000:])
        for name in (surface, estimator, sonde):
            assert graph.end(name)[0] == 0, graph.log(name)

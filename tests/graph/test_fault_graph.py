# SPDX-License-Identifier: Apache-2.0
"""A fault injected into the running sonde is named by the running estimator, in its log and in /diagnostics."""

import json
import subprocess
import sys

import pytest

import running_graph
from project import SCENARIOS
from running_graph import CALL, PLACE, until

SCENARIO = SCENARIOS / "bench" / "drillvib.yaml"
pytestmark = [pytest.mark.ros, pytest.mark.slow(8)]

TALK = (
    CALL
    + """
import functools, json, time
from diagnostic_msgs.msg import DiagnosticArray
from mwd_msgs.srv import InjectFault
PATIENCE = 480.0
rclpy.init(); node = rclpy.create_node("talk"); reported = {}
inject = functools.partial(call, node, InjectFault, "/w1/inject_fault")
received = []
node.create_subscription(DiagnosticArray, "/diagnostics", received.append, 10)
def found(words, within):
    end, other = time.monotonic() + within, ""
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        for status in [one for array in received for one in array.status]:
            if "sensors" not in status.name: continue
            level, other = status.level, status.message
            if words in status.message:
                return [level[0] if isinstance(level, bytes) else int(level), status.message]
        received.clear()
    return [-1, other]
reported["healthy"] = found("healthy", PATIENCE)
reported["refused"] = inject(component="accel", fault="swapped").message
reported["injected"] = inject(component="accel", fault="swapped", axis="xz").success
reported["named"] = found("x and z exchanged", PATIENCE)
reported["cleared"] = inject(component="accel", fault="ok").success
reported["well"] = found("healthy", PATIENCE)
print(json.dumps(reported))
"""
)


def test_an_injected_fault_is_named_in_diagnostics_and_goes_when_it_is_taken_back(tmp_path):
    # Longer than any machine takes for what is asked.
    (tmp_path / "long.yaml").write_text(SCENARIO.read_text().replace("seconds: 120.0", "seconds: 3600.0"))
    with running_graph.graph(tmp_path) as graph:
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        until(lambda: ": active" in graph.log(estimator), 90, "the estimator is active")
        graph.start(
            "sonde", "w1", scenario=tmp_path / "long.yaml", wait_for_listener_s=60.0, fault_injection=True, rate=2.0
        )
        done = subprocess.run(
            [sys.executable, "-c", TALK],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=1800,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        reported = json.loads(done.stdout.splitlines()[-1])
        log = graph.log(estimator)
        graph.end(estimator)
    assert reported["healthy"][0] == 0
    assert "two axes" in reported["refused"]
    assert reported["injected"]
    assert reported["named"][0] == 2
    assert "accelerometer" in reported["named"][1]
    assert reported["cleared"]
    assert reported["well"][0] == 0
    assert "x and z exchanged; correct the axes" in log
    assert "(has ended)" in log

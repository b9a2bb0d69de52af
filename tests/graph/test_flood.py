# SPDX-License-Identifier: Apache-2.0
"""A running well names an injected fault, and a rogue publisher floods it: it answers, and is whole afterwards."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import running_graph
from project import SCENARIOS
from running_graph import CALL, LOOK, PLACE, sections, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(8)]
RATE, FLOOD = 10_000, 80_000

FAULT = (
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

# Both streams of samples and rig data, at this rate together or as fast as the machine can.
ROGUE = f"""
import time
import numpy as np, rclpy
from mwd_msgs.msg import RigState
from sensor_msgs.msg import Imu
from mwd_sensors.core import wire
from mwd_sensors.ros.qos import STREAM, offered
from mwd_surface.ros.topics import TOPICS
rclpy.init(); node = rclpy.create_node("rogue")
publishers = [
    (node.create_publisher(kind, "/w1/" + topic, offered(TOPICS[topic][1])), layout)
    for topic, kind, layout in (("imu/data_raw", Imu, wire.IMU), ("rig/state", RigState, wire.RIG_STATE))
]
began, sent = time.monotonic(), 0
while sent < {FLOOD}:
    if sent > (time.monotonic() - began) * {RATE}:
        time.sleep(0.01)
        continue
    for publisher, layout in publishers:
        samples = layout.empty(50)
        samples["stamp_ns"] = time.time_ns() + np.arange(50)
        for row in layout.encode(samples, "rogue_link"):
            publisher.publish(row.tobytes())
        sent += 50
print("sent", sent, flush=True)
"""

# Calls services until the flood is over; tells what was answered meanwhile, and what the well said of it.
TALK = (
    CALL
    + """
import json, os, sys, time
from mwd_msgs.msg import AlarmList
from mwd_msgs.srv import SetDepth, StartRecording
from std_srvs.srv import Trigger
rclpy.init(); node = rclpy.create_node("talk")
alarms = {}
node.create_subscription(AlarmList, "/w1/alarms", lambda got: alarms.update({a.id: a.text for a in got.alarms}), 10)
answers, longest = 0, 0.0
while not os.path.exists(sys.argv[1]) or answers < 20:
    for kind, name, fields in (
        (SetDepth, "set_depth", {"bit_depth": 50.0, "operator_name": "A. Smith"}),
        (Trigger, "split_recording", {}),
    ):
        began = time.monotonic()
        assert call(node, kind, "/w1/" + name, **fields).success
        longest, answers = max(longest, time.monotonic() - began), answers + 1
print(json.dumps({"answers": answers, "longest": longest, "alarms": alarms}))
"""
)


def is_live(page):
    """Whether the page shows a live attitude, a recording, and one source of rig data."""
    shown = sections(page)
    if not shown or shown["attitude"]["inclination"]["state"] != "live" or shown["recorder"]["state"] != "recording":
        return False
    return not any(alarm["active"] for alarm in shown["alarms"]["rows"] if alarm["id"].startswith("sources."))


def memory_mb(graph, *names):
    """Resident memory of nodes."""
    lines = (Path(f"/proc/{graph.running[name].pid}/status").read_text() for name in names)
    return [int(text.partition("VmRSS:")[2].split()[0]) / 1024 for text in lines]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A well with a fault, in a flood, and afterwards."""
    folder = tmp_path_factory.mktemp("flood")
    # Longer than any machine takes for what is asked.
    story = (SCENARIOS / "bench" / "drillvib.yaml").read_text().replace("seconds: 120.0", "seconds: 7200.0")
    (folder / "long.yaml").write_text(f"{story}rate_hz: 50\n")
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", folder=folder / "data", page__port=0, record__name="run")
        estimator = graph.start("estimator", "w1", **PLACE)
        settings = {"scenario": folder / "long.yaml", "fault_injection": True, "wait_for_listener_s": 60.0, "rate": 3.0}
        sonde = graph.start("sonde", "w1", **settings)
        graph.active(surface)
        page = graph.log(surface).split("page: ")[1].split()[0]
        until(lambda: is_live(page), 120, "a live attitude", LOOK)
        fault = graph.report(FAULT)
        before = memory_mb(graph, surface, estimator)
        rogue = subprocess.Popen([sys.executable, "-c", ROGUE], env=graph.environment, stdout=subprocess.PIPE)
        talk = subprocess.Popen(
            [sys.executable, "-c", TALK, str(folder / "over")], env=graph.environment, stdout=subprocess.PIPE
        )
        said, _ = rogue.communicate(timeout=600)
        (folder / "over").touch()
        told, _ = talk.communicate(timeout=600)
        after = memory_mb(graph, surface, estimator)
        until(lambda: is_live(page), 120, "the well as before the flood", LOOK)
        ends = [graph.end(name)[0] for name in (sonde, estimator, surface)]
        logs = "".join(graph.log(name) for name in (sonde, estimator, surface))
        return {
            "fault": fault,
            "estimator": graph.log(estimator),
            "sent": int(said.split()[1]),
            "told": json.loads(told.splitlines()[-1]),
            "growth": [b - a for a, b in zip(before, after, strict=True)],
            "ends": ends,
            "logs": logs,
        }


def test_an_injected_fault_is_named_in_diagnostics_and_goes_when_it_is_taken_back(run):
    fault = run["fault"]
    assert fault["healthy"][0] == 0
    assert "two axes" in fault["refused"]
    assert fault["injected"]
    assert fault["named"][0] == 2
    assert "accelerometer" in fault["named"][1]
    assert fault["cleared"]
    assert fault["well"][0] == 0
    assert "x and z exchanged; correct the axes" in run["estimator"]
    assert "(has ended)" in run["estimator"]


@pytest.mark.fault_case(55)
def test_services_answer_while_messages_flood_in(run):
    assert run["sent"] >= FLOOD
    assert run["told"]["answers"] >= 20


@pytest.mark.fault_case(55)
def test_a_flood_is_an_alarm_that_names_the_rogue(run):
    assert "rogue_link" in run["told"]["alarms"]["sources.rig/state"]


@pytest.mark.fault_case(55)
def test_memory_stays_bounded_and_no_node_is_lost(run):
    # A queue without bound would keep some hundred bytes of each message twice.
    assert max(run["growth"]) < 100.0
    assert run["ends"] == [0, 0, 0]
    assert "Traceback" not in run["logs"], run["logs"]

# SPDX-License-Identifier: Apache-2.0
"""Requests to a surface that is not active, and the same request of several clients at the same time."""

import json
import subprocess
import sys

import pytest

import running_graph
from mwd_surface.surveys.survey_store import decoded
from running_graph import CALL

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.fault_case(86)]

TALK = (
    CALL
    + """
import json, math, time
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from mwd_msgs import msg, srv
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from mwd_sensors.ros.qos import EVENT, LATCHED
rclpy.init()
nodes = [rclpy.create_node(f"talk_{k}") for k in range(4)]
node, executor, lists = nodes[0], SingleThreadedExecutor(), []
node.create_subscription(msg.SurveyList, "/w1/surveys", lists.append, LATCHED)

def told(answer): return [answer.success, answer.message]

def wait(true):
    end = time.monotonic() + 240.0
    while time.monotonic() < end and not true(): executor.spin_once(timeout_sec=0.1)
    assert true()

def together(kind, name, fields):
    # All clients have asked before any of them is answered.
    clients = [one.create_client(kind, "/w1/" + name) for one in nodes]
    wait(lambda: all(client.service_is_ready() for client in clients))
    asked = [client.call_async(kind.Request(**fields)) for client in clients]
    wait(lambda: all(future.done() for future in asked))
    return [told(future.result()) for future in asked]

name = dict(operator_name="A. Smith")
REQUESTS = {
    "accept_survey": (srv.JudgeSurvey, dict(sequence=1, reason="fits", measured_depth=30.0, **name)),
    "reject_survey": (srv.JudgeSurvey, dict(sequence=1, reason="steel", measured_depth=math.nan, **name)),
    "set_depth": (srv.SetDepth, dict(bit_depth=50.0, **name)),
    "stop_recording": (Trigger, {}),
    "start_recording": (srv.StartRecording, dict(name="two")),
    "split_recording": (Trigger, {}),
    "snapshot_recording": (Trigger, {}),
    "export": (srv.Export, dict(format="csv", name="list")),
    "judge_control": (srv.JudgeControl, dict(decision=2, **name)),
    "acknowledge_alarm": (srv.AcknowledgeAlarm, dict(id="nothing", **name)),
}

def move(transition):
    assert call(node, ChangeState, "/w1/surface/change_state", transition=Transition(id=transition)).success

def one(request, **other):
    kind, fields = REQUESTS[request]
    return told(call(node, kind, "/w1/" + request, **{**fields, **other}))

move(Transition.TRANSITION_CONFIGURE)
said = {"inactive": {request: one(request) for request in REQUESTS}}
move(Transition.TRANSITION_ACTIVATE)
for one_node in nodes: executor.add_node(one_node)
survey = msg.Survey(sequence=1, uuid="one", verdict=msg.Survey.DOUBTFUL, duration=10.0, samples=1000, g_total=9.8)
survey.header.stamp.sec = 1_800_000_000
node.create_publisher(msg.Survey, "/w1/survey", EVENT).publish(survey)
wait(lambda: lists and lists[-1].records)
for one_node in nodes: executor.remove_node(one_node)
said["wrong"] = [
    one(request, **{field: depth})
    for request, field in (("set_depth", "bit_depth"), ("accept_survey", "measured_depth"))
    for depth in (float("nan"), float("inf"), -7.0, 1e300)
]
for one_node in nodes: executor.add_node(one_node)
said["together"] = {request: together(kind, request, fields) for request, (kind, fields) in REQUESTS.items()}
print(json.dumps(said))
"""
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What a surface answered, and what it left on the disk."""
    folder = tmp_path_factory.mktemp("requests")
    kept = folder / "data" / "w1"
    kept.mkdir(parents=True)
    (kept / "control.json").write_text("[" * 9_000)
    settings = {"folder": folder / "data", "serve_page": False, "record__name": "run", "control__enabled": True}
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", autostart=False, **settings)
        done = subprocess.run(
            [sys.executable, "-c", TALK],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert done.returncode == 0, done.stderr + graph.log(surface)
        assert graph.end(surface)[0] == 0
        log = graph.log(surface)
    return {**json.loads(done.stdout.splitlines()[-1]), "log": log, "folder": kept}


def test_an_inactive_node_answers_every_request_with_the_reason(run):
    assert {name: (done, "not active" in why) for name, (done, why) in run["inactive"].items()} == dict.fromkeys(
        run["inactive"], (False, True)
    )


def test_a_depth_that_is_none_is_refused_by_name_whoever_asks(run):
    assert [done for done, _ in run["wrong"]] == [False] * 8
    assert all("depth" in why for _, why in run["wrong"])


def test_the_same_request_of_four_clients_at_once_is_answered_to_each_and_done_once(run):
    done = {name: [success for success, _ in answers] for name, answers in run["together"].items()}
    # A decision, a depth and a file may be given again, with the same result; only one recording can begin or end.
    assert all(done[name] == [True] * 4 for name in ("accept_survey", "reject_survey", "set_depth", "export"))
    assert sorted(done["stop_recording"]) == sorted(done["start_recording"]) == [False, False, False, True]
    assert all(message for answers in run["together"].values() for success, message in answers if not success)
    recordings = [path.name for path in (run["folder"] / "bags").iterdir() if path.is_dir()]
    assert sorted(recordings) == ["run", "two"]
    assert [path.name for path in (run["folder"] / "exports").glob("list*")] == ["list.csv"]
    (record,) = decoded((run["folder"] / "surveys" / "surveys.json").read_bytes()).records
    assert not record.in_use
    assert record.measured_depth == 30.0


@pytest.mark.fault_case(69)
def test_a_damaged_file_of_leases_takes_control_away_and_nothing_else(run):
    assert "nobody can have control" in run["log"]
    assert "delete it if the clock was not set back since the last lease" in run["log"]

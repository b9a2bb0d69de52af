# SPDX-License-Identifier: Apache-2.0
"""The estimator's actions with a real client on a real middleware: progress, results, refusals, cancelling."""

import json
import math
import subprocess
import sys

import pytest

import running_graph
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(2)]

SETTINGS = {
    "tool__precision__gyro__noise_deg_sqrt_h": 0.01,
    "tool__precision__gyro__bias_deg_h": 0.02,
    "tool__precision__gyro__g_deg_h_g": 0.0,
    "tool__precision__gyro__walk_deg_h_sqrt_h": 0.0,
    "survey__automatic": False,
    "place__field": "fixed",
    "place__lat_deg": 50.0,
    "place__total_nt": 48000.0,
    "place__dip_deg": 66.0,
    "place__declination_deg": 0.0,
}

CLIENT = """
import json, math, time
import numpy as np, rclpy
from rclpy.action import ActionClient
from sensor_msgs.msg import Imu, MagneticField
from mwd_msgs.action import NorthSeek, RotarySurvey
from mwd_msgs.msg import Dynamics, Survey, SurveyList, SurveyRecord
from mwd_msgs.srv import TakeSurvey
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.ros import qos

LATITUDE, RATE = math.radians(50.0), 50
EARTH = math.radians(15.041) / 3600.0 * np.array([math.cos(LATITUDE), 0.0, -math.sin(LATITUDE)])
FIELD = 48e-6 * np.array([math.cos(math.radians(66.0)), 0.0, math.sin(math.radians(66.0))])
rclpy.init(); node = rclpy.create_node("client"); reported = {}
rng = np.random.default_rng(1)
deep = qos.buffered(qos.STREAM)
sinks = {name: node.create_publisher(kind, name, deep)
         for name, kind in (("imu/data_raw", Imu), ("gyro/data_raw", Imu), ("imu/mag", MagneticField))}
state = {"k": 0, "roll": 0.5, "rate": 0.0}

def pump(count):
    for _ in range(count):
        state["k"] += 1
        state["roll"] += state["rate"] / RATE
        mat = mat_nt(math.radians(40.0), math.radians(100.0), state["roll"])
        stamp = 1_700_000_000 * 10**9 + state["k"] * (10**9 // RATE)
        imu, mag = wire.IMU.empty(1), wire.MAG.empty(1)
        imu["stamp_ns"] = mag["stamp_ns"] = stamp
        imu["linear_acceleration"] = -9.80665 * mat[2] + 1e-4 * rng.normal(size=3)
        imu["angular_velocity"] = mat.T @ EARTH + [state["rate"], 0.0, 0.0] + 2e-7 * rng.normal(size=3)
        mag["magnetic_field"] = mat.T @ FIELD + 2e-8 * rng.normal(size=3)
        sinks["imu/mag"].publish(wire.MAG.encode(mag, "sonde_link")[0].tobytes())
        sinks["gyro/data_raw"].publish(wire.IMU.encode(imu, "sonde_link")[0].tobytes())
        sinks["imu/data_raw"].publish(wire.IMU.encode(imu, "sonde_link")[0].tobytes())

def pump_for(seconds):  # of samples
    for _ in range(round(seconds * RATE / 5)): pump(5); rclpy.spin_once(node, timeout_sec=0.01)

def wait(future, feed=True, also=lambda: True, within=120.0):
    end = time.monotonic() + within
    while not (future.done() and also()):
        assert time.monotonic() < end, "too late"
        if feed: pump(5)
        rclpy.spin_once(node, timeout_sec=0.01)
    return future.result()

def ask(client, goal, feed=True, cancel_after=None):
    feedback = []
    handle = wait(client.send_goal_async(goal, lambda m: feedback.append(m.feedback)), feed)
    assert handle.accepted
    if cancel_after is not None:
        end = time.monotonic() + 60
        while len(feedback) < cancel_after and time.monotonic() < end: pump(5); rclpy.spin_once(node, timeout_sec=0.01)
        wait(handle.cancel_goal_async(), feed)
    answer = wait(handle.get_result_async(), feed)
    return answer.status, answer.result, feedback

received = []
node.create_subscription(Dynamics, "dynamics", received.append, qos.STATE)
north, rotary = ActionClient(node, NorthSeek, "north_seek"), ActionClient(node, RotarySurvey, "rotary_survey")
assert north.wait_for_server(30.0) and rotary.wait_for_server(30.0)
status, result, _ = ask(north, NorthSeek.Goal(), feed=False)
reported["silent"] = status, result.message
pump_for(10.0)
status, result, feedback = ask(north, NorthSeek.Goal(duration=40.0))
reported["north"] = status, result.success, result.azimuth, result.sigma, result.method, result.message
reported["progress"] = [(f.elapsed, f.remaining, f.sigma) for f in feedback]
status, result, _ = ask(north, NorthSeek.Goal(duration=30.0, mode="sideways"))
reported["bad"] = status, result.message
endless = [ask(client, goal(duration=1e9)) for client, goal in ((north, NorthSeek.Goal), (rotary, RotarySurvey.Goal))]
reported["endless"] = [(status, result.message) for status, result, _ in endless]
status, result, _ = ask(north, NorthSeek.Goal(duration=600.0), cancel_after=1)
reported["cancelled"] = status, result.message
first = wait(north.send_goal_async(NorthSeek.Goal(duration=600.0)))
status, result, _ = ask(north, NorthSeek.Goal(duration=30.0))
reported["second"] = status, result.message
wait(first.cancel_goal_async())
reported["first"] = wait(first.get_result_async()).status
status, result, _ = ask(rotary, RotarySurvey.Goal(duration=8.0))
reported["at rest"] = status, result.message
state["rate"] = 6.0
pump_for(6.0)
status, result, feedback = ask(rotary, RotarySurvey.Goal(duration=12.0))
s = result.survey
reported["rotary"] = status, result.message, s.kind, s.inclination, s.azimuth, s.covariance[8], len(feedback)
reported["dynamics"] = [(d.rotary_speed, d.samples, d.stick_slip_index) for d in received][-1]

# Another surface remembers seven surveys; then the recording that is fed begins again.
table = node.create_publisher(SurveyList, "surveys", qos.LATCHED)
table.publish(SurveyList(records=[SurveyRecord(survey=Survey(sequence=n)) for n in (3, 17, 5)]))
state["rate"] = 0.0
asked = node.create_client(TakeSurvey, "take_survey")
assert asked.wait_for_service(120.0)
pump_for(6.0)
answer = wait(asked.call_async(TakeSurvey.Request(duration=3.0)))
reported["numbered"] = answer.success, answer.sequence, answer.message
state["k"] = 0
pump_for(4.0)
answer = wait(asked.call_async(TakeSurvey.Request(duration=3.0)))
reported["again"] = answer.success, answer.sequence, answer.message
print(json.dumps(reported))
"""


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("actions")
    with running_graph.graph(folder) as graph:
        estimator = graph.start("estimator", **SETTINGS)
        until(lambda: ": active" in graph.log(estimator), 90, "the estimator is active")
        done = subprocess.run(
            [sys.executable, "-c", CLIENT],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, done.stderr + graph.log(estimator)
        assert graph.end(estimator)[0] == 0
        log = graph.log(estimator)
    return {**json.loads(done.stdout.splitlines()[-1]), "log": log}


SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


def test_a_north_seek_reports_its_progress_and_finds_north(reported):
    status, success, azimuth, sigma, method, message = reported["north"]
    assert (status, success) == (SUCCEEDED, True), message
    assert abs(azimuth - math.radians(100.0)) < 4.0 * sigma < math.radians(8.0)
    assert method == "still"
    assert "from true north" in message
    elapsed = [given[0] for given in reported["progress"]]
    assert elapsed == sorted(elapsed)
    assert len(elapsed) >= 2
    assert all(given[0] + given[1] == pytest.approx(40.0) for given in reported["progress"])


def test_what_cannot_be_done_is_ended_with_its_reason(reported):
    assert reported["silent"] == [ABORTED, "no north found: no samples arrive from the sonde"]
    assert reported["bad"][0] == ABORTED
    assert "mode: must be still" in reported["bad"][1]
    for status, message in reported["endless"]:
        assert status == ABORTED
        assert "must be at most 3600 s" in message
    assert reported["second"] == [ABORTED, "no north found: north is already being sought"]
    assert reported["at rest"][0] == ABORTED
    assert "take a survey at rest" in reported["at rest"][1]


def test_a_seek_can_be_cancelled(reported):
    assert reported["cancelled"] == [CANCELED, "no north found: cancelled"]
    assert reported["first"] == CANCELED


def test_a_rotary_survey_gives_inclination_and_azimuth_and_no_toolface(reported):
    status, message, kind, inclination, azimuth, toolface_variance, _ = reported["rotary"]
    assert status == SUCCEEDED, message
    assert kind == 1
    assert math.degrees(inclination) == pytest.approx(40.0, abs=0.1)
    assert math.degrees(azimuth) == pytest.approx(100.0, abs=0.3)
    assert math.isnan(toolface_variance)


def test_dynamics_are_published_while_it_turns(reported):
    speed, samples, index = reported["dynamics"]
    assert speed == pytest.approx(6.0, abs=0.2)
    assert samples > 100
    assert 0.0 <= index < 0.1


@pytest.mark.fault_case(58)
def test_numbers_that_a_list_remembers_are_not_given_again(reported):
    success, sequence, message = reported["numbered"]
    assert success, message
    assert sequence == 18


def test_a_recording_that_begins_again_begins_the_estimate_again_and_the_numbers_go_on(reported):
    success, sequence, message = reported["again"]
    assert success, message
    assert sequence == 19
    assert reported["log"].count("time went back by more than a second: the estimate began anew") == 1

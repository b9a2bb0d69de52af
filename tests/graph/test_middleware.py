# SPDX-License-Identifier: Apache-2.0
"""What the middleware says becomes a sentence: incompatible profiles, two publishers; and each node beats."""

import json
import os
import subprocess
import sys

import pytest

from mwd_surface.runs import launch_plan

pytest.importorskip("rclpy")
pytestmark = pytest.mark.ros

SCRIPT = """
import dataclasses, json, time
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import MagneticField, Temperature
from diagnostic_msgs.msg import DiagnosticStatus
from mwd_sensors.core.settings import setting
from mwd_sensors.ros import qos
from mwd_sensors.ros.lifecycle_node import GraphNode

@dataclasses.dataclass(frozen=True)
class Settings:
    rate: float = setting(1.0, "a rate")

class Reader(GraphNode):
    def configure(self):
        self.add_buffered_subscription(MagneticField, "imu/mag", qos.EVENT)
        self.add_subscription(Temperature, "imu/temperature", lambda message: None, qos.STREAM)

rclpy.init()
reader = Reader("reader", Settings(), namespace="w1")
one, two = (rclpy.create_node(name, namespace="w1") for name in ("tool", "tool_2"))
one.create_publisher(MagneticField, "imu/mag", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
one.create_publisher(Temperature, "imu/temperature", qos.STREAM)
two.create_publisher(Temperature, "imu/temperature", qos.STREAM)
beats = []
one.create_subscription(DiagnosticStatus, "heartbeat", beats.append, qos.STATE)
executor = EventsExecutor()
for node in (reader, one, two):
    executor.add_node(node)
reader.autostart()
end = time.monotonic() + 60
found = {}
while time.monotonic() < end and len(found) < 2:
    done = Future()
    executor.spin_until_future_complete(done, 0.5)
    found = {d.name: [d.message, d.remedy] for d in reader._middleware.diagnostics()}
print(json.dumps({"found": found, "beats": [[b.name, b.message] for b in beats]}))
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    with launch_plan.own_domain({}) as domain:
        environment = launch_plan.graph_environment(dict(os.environ), domain, tmp_path_factory.mktemp("log"))
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=240, check=False
        )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.fault_case(52)
def test_an_incompatible_publisher_is_named_with_both_profiles_and_a_remedy(said):
    message, remedy = said["found"]["middleware imu/mag"]
    assert "/w1/tool (best effort, volatile)" in message
    assert "reliable, transient local" in message
    assert remedy == "give both the same QoS profile"


@pytest.mark.fault_case(53)
def test_two_publishers_of_one_topic_are_named(said):
    message, remedy = said["found"]["middleware imu/temperature"]
    assert message == "imu/temperature has 2 publishers: /w1/tool, /w1/tool_2"
    assert "stop all but one" in remedy


def test_a_node_beats_with_its_state(said):
    assert ["/w1/reader", "active"] in said["beats"]

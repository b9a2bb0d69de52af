# SPDX-License-Identifier: Apache-2.0
"""The middleware's profile of the graph, against what the middleware does with it."""

import os
import subprocess
import sys

import pytest

from mwd_surface.runs import launch_plan

rclpy = pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from rclpy.qos import QoSProfile  # noqa: E402
from std_msgs.msg import String  # noqa: E402

PUBLISHER = """
import sys, time
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from std_msgs.msg import String
rclpy.init()
publisher = rclpy.create_node("publisher").create_publisher(String, "words", QoSProfile(depth=10))
while not publisher.get_subscription_count():
    time.sleep(0.05)
publisher.publish(String())
publisher.wait_for_all_acked(Duration(seconds=60))
# The first message is acknowledged when the subscription is matched, every later one at a heartbeat.
began = time.monotonic()
publisher.publish(String())
publisher.wait_for_all_acked(Duration(seconds=60))
print(time.monotonic() - began)
"""


@pytest.mark.ros
@pytest.mark.slow
def test_a_reliable_publisher_knows_within_a_deadline_what_its_subscribers_lack(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with launch_plan.own_domain({}) as domain:
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        node = rclpy.create_node("subscriber", context=context)
        node.create_subscription(String, "words", lambda _message: None, QoSProfile(depth=10))
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain), launch_plan.PROFILES: str(launch_plan.MIDDLEWARE)}
        words = [sys.executable, "-P", "-c", PUBLISHER]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=True)
        node.destroy_node()
        rclpy.shutdown(context=context)
    # The deadline is 1 s; without the profile it takes the middleware 3 s.
    assert float(done.stdout) < 1.0


TRANSPORTS = """
from pathlib import Path
import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("node")
node.create_subscription(String, "words", lambda _message: None, QoSProfile(depth=10))
print("fastrtps_port" in Path("/proc/self/maps").read_text())
"""


@pytest.mark.ros
@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
def test_a_node_receives_nothing_by_shared_memory(reach, monkeypatch):
    # A command that an earlier test ran in this process sets the profile for its node.
    monkeypatch.delenv(launch_plan.PROFILES, raising=False)
    with launch_plan.own_domain({}) as domain:
        found = []
        for profile in ({launch_plan.PROFILES: str(launch_plan.MIDDLEWARE)}, {}):
            environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": reach} | profile
            words = [sys.executable, "-P", "-c", TRANSPORTS]
            done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=True)
            found.append(done.stdout.split())
    # Without the profile it does: the test can see it.
    assert found == [["False"], ["True"]]

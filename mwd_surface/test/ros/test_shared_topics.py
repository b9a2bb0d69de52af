# SPDX-License-Identifier: Apache-2.0
"""Two publishers of a topic are an alarm, unless two nodes of a well publish it by design."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

import mwd_surface

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_sensors.ros.middleware_events import SHARED


def test_topics_that_estimator_and_surface_both_publish_raise_no_alarm():
    policy = yaml.safe_load((Path(mwd_surface.__file__).parent / "ros" / "security_policy.yaml").read_text())
    published = Counter(topic for node in ("estimator", "surface") for topic in policy[node]["publish"])
    assert {topic for topic, count in published.items() if count > 1 and topic[0] not in "/~"} == set(SHARED)

# SPDX-License-Identifier: Apache-2.0
"""Two publishers of a topic are an alarm, unless two nodes of a well publish it by design."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

import mwd_surface

events = pytest.importorskip("mwd_sensors.ros.middleware_events", reason="ROS is not installed for this Python")


def test_topics_that_estimator_and_surface_both_publish_raise_no_alarm():
    policy = yaml.safe_load((Path(mwd_surface.__file__).parent / "ros" / "security_policy.yaml").read_text())
    published = Counter(topic for node in ("estimator", "surface") for topic in policy[node]["publish"])
    shared = {topic for topic, count in published.items() if count > 1 and topic[0] not in "/~"}
    assert shared == set(events.SHARED)

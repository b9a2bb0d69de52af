# SPDX-License-Identifier: Apache-2.0
"""The groups for diagnostic_aggregator: every status of every node is in exactly one of them."""

import pytest
import yaml

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from rclpy.clock import Clock

from mwd_sensors.ros.diagnostics import OK, Diagnostic, diagnostic_array
from mwd_surface.ros.security_policy import shipped
from project import ROOT

GROUPS = yaml.safe_load((ROOT / "mwd_surface/config/diagnostics.yaml").read_text())["analyzers"]["ros__parameters"]


class Named:
    """What `diagnostic_array` asks of a node."""

    def __init__(self, name, well):
        self.name, self.well = name, well

    def get_clock(self):
        return Clock()

    def get_fully_qualified_name(self):
        return f"{self.well}/{self.name}"

    def get_namespace(self):
        return self.well or "/"


@pytest.mark.parametrize("well", ["", "/well_1", "/field/estimator"])
@pytest.mark.parametrize("node", [*shipped(), "replay"])
def test_each_status_is_in_one_group(node, well):
    (status,) = diagnostic_array(Named(node, well), [Diagnostic("imu/data_raw", OK, "arriving")]).status
    found = [
        name
        for name, group in GROUPS.items()
        if isinstance(group, dict) and any(part in status.name for part in group["contains"])
    ]
    assert len(found) == 1


def test_nodes_publish_more_often_than_their_status_grows_stale():
    assert all(group["timeout"] >= 5.0 for group in GROUPS.values() if isinstance(group, dict))

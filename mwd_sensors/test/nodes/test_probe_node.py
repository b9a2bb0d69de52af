"""What the node of a probe says of the unit."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.nodes.probe import ProbeNode
from mwd_sensors.ros.diagnostics import ERROR, OK


def test_a_unit_that_is_well_again_is_no_error_any_more():
    node, probe = SimpleNamespace(_faults_before=0), SimpleNamespace(faults=0, clips={})
    levels = []
    for faults in (0, 1, 3, 3):
        probe.faults = faults
        shown = ProbeNode._status_diagnostic(node, probe)
        levels.append(shown.level)
    assert levels == [OK, ERROR, ERROR, OK]
    assert ("faults", "3") in shown.values

# SPDX-License-Identifier: Apache-2.0
"""What the node of a probe says of the unit."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.nodes.probe import ProbeNode
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN


def shown(**states):
    """The diagnostic of a unit's status after each of these states, one after the other."""
    node, probe = SimpleNamespace(_faults_before=0, _clips_before={}), SimpleNamespace(faults=0, clips={})
    for name, values in states.items():
        for value in values:
            setattr(probe, name, value)
            yield ProbeNode._status_diagnostic(node, probe)


def test_a_unit_that_is_well_again_is_no_error_any_more():
    *before, last = shown(faults=[0, 1, 3, 3])
    assert [one.level for one in (*before, last)] == [OK, ERROR, ERROR, OK]
    assert ("faults", "3") in last.values


def test_the_warning_of_a_clipped_axis_lasts_as_long_as_it_clips():
    both = {"gyro x": 3, "accelerometer y": 1}
    none, gyro, accelerometer, last = shown(clips=[{}, {"gyro x": 3}, both, dict(both)])
    assert [one.level for one in (none, gyro, accelerometer, last)] == [OK, WARN, WARN, OK]
    assert "gyro x" in gyro.message
    assert "gyro x" not in accelerometer.message
    assert "accelerometer y" in accelerometer.message
    assert ("clipped gyro x", "3") in last.values

# SPDX-License-Identifier: Apache-2.0
"""What the node of a probe says of the unit."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.nodes.probe import ProbeNode
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN


def test_a_unit_that_is_well_again_is_no_error_any_more():
    node, probe = SimpleNamespace(_faults_before=0, _clips_before={}), SimpleNamespace(faults=0, clips={})
    levels = []
    for faults in (0, 1, 3, 3):
        probe.faults = faults
        shown = ProbeNode._status_diagnostic(node, probe)
        levels.append(shown.level)
    assert levels == [OK, ERROR, ERROR, OK]
    assert ("faults", "3") in shown.values


def test_the_warning_of_a_clipped_axis_lasts_as_long_as_it_clips():
    node, probe = SimpleNamespace(_faults_before=0, _clips_before={}), SimpleNamespace(faults=0, clips={})
    levels = []
    for clips in ({}, {"gyro x": 3}, {"gyro x": 3, "accelerometer y": 1}, {"gyro x": 3, "accelerometer y": 1}):
        probe.clips = dict(clips)
        shown = ProbeNode._status_diagnostic(node, probe)
        levels.append((shown.level, shown.message))
    assert levels == [
        (OK, "no axis clipped"),
        (WARN, "clipped: gyro x"),
        (WARN, "clipped: accelerometer y"),
        (OK, "no axis clipped"),
    ]
    assert ("clipped gyro x", "3") in shown.values

# SPDX-License-Identifier: Apache-2.0
"""Messages as tables and back."""

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_msgs.msg import Survey
from mwd_msgs.srv import JudgeSurvey
from sensor_msgs.msg import Imu

from mwd_surface.ros.graph_client import filled, plain


def test_fields_of_a_message_are_set_from_a_table_and_read_back():
    request = filled(JudgeSurvey.Request, {"sequence": 3, "operator_name": "A. Driller", "measured_depth": 7})
    assert plain(request)["sequence"] == 3
    assert plain(request)["measured_depth"] == 7.0
    imu = filled(Imu, {"header": {"frame_id": "a"}, "linear_acceleration": {"x": 9.5}})
    assert plain(imu)["header"]["frame_id"] == "a"
    assert plain(imu)["linear_acceleration"] == {"x": 9.5, "y": 0.0, "z": 0.0}
    assert plain(imu)["linear_acceleration_covariance"] == [0.0] * 9
    assert plain(Survey())["azimuths"] == []


def test_a_field_or_value_that_does_not_fit_is_named():
    with pytest.raises(ValueError, match="operator: unknown field; the fields are sequence"):
        filled(JudgeSurvey.Request, {"operator": "A"})
    with pytest.raises(ValueError, match="sequence: 'x' is not of type uint32"):
        filled(JudgeSurvey.Request, {"sequence": "x"})
    for field, value in {"sequence": 2**70, "measured_depth": 10**400, "reason": "\ud800"}.items():
        with pytest.raises(ValueError, match=f"{field}: "):
            filled(JudgeSurvey.Request, {field: value})
    for field, value in {"linear_acceleration_covariance": ["a"] * 9, "orientation": 1.0, "header": "a"}.items():
        with pytest.raises(ValueError, match=f"{field}: "):
            filled(Imu, {field: value})

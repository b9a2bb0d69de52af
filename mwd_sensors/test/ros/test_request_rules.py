# SPDX-License-Identifier: Apache-2.0
"""What a request may hold before any callback sees it."""

import math

import pytest

pytest.importorskip("rclpy")

from mwd_msgs import srv

from mwd_sensors.ros.request_rules import refusal


@pytest.mark.fault_case(86)
@pytest.mark.parametrize(
    ("request_", "word"),
    [
        (srv.SetDepth.Request(bit_depth=math.nan, operator_name="A. Smith"), "finite"),
        (srv.InjectFault.Request(component="gyro", fault="stuck", duration=math.nan), "finite"),
        (srv.TakeSurvey.Request(duration=math.inf), "finite"),
        (srv.SetDepth.Request(bit_depth=1.0, operator_name="A" * 1_000_000), "at most 500"),
        (srv.SetDepth.Request(bit_depth=1.0, operator_name="A\ud800"), "invisible character"),
        (srv.JudgeSurvey.Request(sequence=1, operator_name="A", reason="0110\r\n!!"), "one line"),
    ],
)
def test_what_no_log_can_hold_is_refused_by_name(request_, word):
    reason = refusal(request_)
    assert word in reason
    assert reason.split(":")[0] in request_.get_fields_and_field_types()


def test_ordinary_requests_pass():
    assert refusal(srv.JudgeSurvey.Request(sequence=3, operator_name="Åse Ødegård", reason="fits the gyro")) == ""
    assert refusal(srv.StartRecording.Request(name="")) == ""

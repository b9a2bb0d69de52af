# SPDX-License-Identifier: Apache-2.0
"""Messages leave in their order; one that the middleware refuses costs itself alone and is reported."""

import contextlib

import numpy as np
import pytest

from mwd_sensors.core import wire

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from sensor_msgs.msg import Imu

from mwd_sensors.ros import qos
from mwd_sensors.ros.refused_entity import RCLError, TopicPublisher


class Writer(contextlib.nullcontext):
    """The middleware's end: refuses the calls of these numbers."""

    def __init__(self, refused=()):
        super().__init__()
        self.refused, self.calls, self.published = refused, 0, []

    def get_logger_name(self):
        return "node"

    def publish_raw(self, data):
        self.calls += 1
        if self.calls in self.refused:
            raise RCLError("Failed to publish: cannot publish data")
        self.published.append(data)


def publisher_on(writer, *, active=True):
    events = PublisherEventCallbacks(use_default_callbacks=False)
    made = TopicPublisher(writer, Imu, "imu/data_raw", qos.STREAM, events, ReentrantCallbackGroup())
    made.errors = []
    made.on_refusal = made.errors.append
    if active:
        made.on_activate(None)
    return made


def rows(count):
    imu = wire.IMU.empty(count)
    imu["stamp_ns"] = 10**18 + np.arange(count) * 10**6
    return wire.IMU.encode(imu, "sonde_link")


def messages(count):
    return [row.tobytes() for row in rows(count)]


def test_rows_leave_as_messages_in_their_order_and_not_while_the_publisher_is_inactive():
    writer = Writer()
    publisher = publisher_on(writer)
    publisher.publish_rows(rows(5))
    publisher.publish_rows(rows(5)[:0])
    assert writer.published == messages(5)
    silent = Writer()
    publisher_on(silent, active=False).publish_rows(rows(5))
    assert silent.published == []


def test_a_refused_row_costs_itself_alone():
    writer = Writer(refused={2, 4})
    publisher = publisher_on(writer)
    publisher.publish_rows(rows(5))
    assert writer.published == [messages(5)[k] for k in (0, 2, 4)]
    assert [str(error) for error in publisher.errors] == ["Failed to publish: cannot publish data"] * 2


@pytest.mark.parametrize(("refused", "arrives"), [({1}, True), ({1, 2}, False)])
def test_a_single_message_is_tried_twice_before_it_is_reported(refused, arrives):
    (survey,), writer = messages(1), Writer(refused)
    publisher = publisher_on(writer)
    publisher.publish(survey)
    assert writer.published == [survey] * arrives
    assert len(publisher.errors) == (not arrives)


def test_another_error_is_the_caller_s():
    with pytest.raises(TypeError):
        publisher_on(Writer()).publish("words")

# SPDX-License-Identifier: Apache-2.0
"""Messages taken and decoded in one go: nothing lost, nothing out of order."""

import contextlib
import itertools
import os
from types import SimpleNamespace

import numpy as np
import pytest

from mwd_sensors.core import wire

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from mwd_sensors.ros import qos
from mwd_sensors.ros.message_buffer import MessageBuffer
from running_graph import until


class Handle(contextlib.nullcontext):
    """What rclpy gives access to: a reader's queue."""

    def __init__(self, waiting=()):
        super().__init__()
        self.waiting = enumerate(waiting, 1000)

    def take_message(self, _kind, raw):
        assert raw
        found = next(self.waiting, None)
        return found and (found[1], {"received_timestamp": found[0]})


def buffer_of(waiting):
    """The buffer of a subscription in whose queue these messages wait."""
    return MessageBuffer(SimpleNamespace(handle=Handle(waiting), msg_type=Imu))


def samples(count):
    imu = wire.IMU.empty(count)
    imu["stamp_ns"] = 10**18 + np.arange(count) * 10**6
    imu["angular_velocity"] = np.arange(3 * count).reshape(count, 3)
    return imu


def messages(count, frame="sonde_link"):
    return [row.tobytes() for row in wire.IMU.encode(samples(count), frame)]


def test_everything_that_waits_is_taken_oldest_first_with_its_time_of_arrival():
    buffer = buffer_of([b"first", b"second", b"third"])
    assert buffer.drain() == [(b"first", 1000), (b"second", 1001), (b"third", 1002)]
    assert buffer.drain() == []


def test_messages_decoded_together_are_those_decoded_one_by_one():
    together, errors = wire.decode_messages(wire.IMU, messages(5))
    assert errors == []
    assert together.tobytes() == samples(5).tobytes()
    assert len(wire.decode_messages(wire.IMU, [])[0]) == 0


def test_a_message_that_cannot_be_read_costs_only_itself():
    good = messages(4)
    big_endian = b"\0\0\0\0" + good[1][4:]
    for bad in (big_endian, good[1][:100], b"", good[1] + bytes(8)):
        found, errors = wire.decode_messages(wire.IMU, [good[0], bad, *good[2:]])
        assert found["stamp_ns"].tolist() == [samples(4)["stamp_ns"][k] for k in (0, 2, 3)]
        assert len(errors) == 1


def test_messages_of_two_frames_are_read_together():
    found, errors = wire.decode_messages(wire.IMU, [messages(2)[0], messages(2, "another_longer_frame")[1]])
    assert errors == []
    assert found.tobytes() == samples(2).tobytes()


def test_a_buffered_profile_differs_in_nothing_but_its_depth():
    buffered = qos.buffered(qos.EVENT)
    assert buffered.depth > qos.EVENT.depth
    assert (buffered.reliability, buffered.durability) == (qos.EVENT.reliability, qos.EVENT.durability)


@pytest.mark.fault_case(55)
def test_a_flood_is_taken_in_bounded_portions():
    buffer = buffer_of(itertools.repeat(b""))
    assert [buffer.drain()[-1].received_ns for _ in range(2)] == [10_999, 20_999]


@pytest.mark.ros
@pytest.mark.fault_case(50)
def test_a_full_queue_drops_the_oldest_messages():
    # Reliable: a message that the network loses would never arrive, and here only the queue may drop some.
    profile = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        node = rclpy.create_node("flooded", namespace=f"/p{os.getpid()}", context=context)
        full, large = (
            MessageBuffer(node.create_subscription(Imu, "imu", lambda _message: None, queue, raw=True))
            for queue in (profile, QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE))
        )
        publisher = node.create_publisher(Imu, "imu", QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE))
        until(lambda: publisher.get_subscription_count() == 2, 30, "both readers are known")
        sent = messages(2000)
        for message in sent:
            publisher.publish(message)
        until(lambda: sent[-1] in [one.data for one in large.drain()], 30, "the last message has arrived")
        taken = []
        until(lambda: taken.extend(one.data for one in full.drain()) or sent[-1] in taken, 30, "it is in the queue")
        assert len(taken) <= 60
        assert taken[-50:] == sent[-50:]
    finally:
        rclpy.shutdown(context=context)

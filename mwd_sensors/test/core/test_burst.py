# SPDX-License-Identifier: Apache-2.0
"""Bursts carry the samples of single messages to the bit, and say no to what they cannot carry."""

import numpy as np
import pytest

from mwd_sensors.core import burst, wire
from mwd_sensors.core.input_covariance import mark_clipped
from mwd_sensors.core.wire import WireError


def samples(count):
    random = np.random.default_rng(3)
    imu = burst.bare(count)
    imu["stamp_ns"] = 1_772_344_800_999_000_000 + np.arange(count) * 200_000
    imu["angular_velocity"] = random.normal(size=(count, 3))
    imu["linear_acceleration"] = random.normal(size=(count, 3)) * 9.8
    imu["angular_velocity_covariance"] = np.eye(3).ravel() * 1e-6
    imu["linear_acceleration_covariance"] = np.eye(3).ravel() * 1e-4
    return imu


@pytest.mark.parametrize("count", [1, 2, 25, 1000])
@pytest.mark.parametrize("frame", ["", "sonde_link", "a", "abc"])
def test_what_was_packed_is_unpacked_to_the_bit(count, frame):
    message = burst.encode(samples(count), frame)
    assert wire.frame_id(message) == frame
    assert burst.decode(message).tobytes() == samples(count).tobytes()


@pytest.mark.parametrize("frame", ["sonde_link", "a", "ab", "abc", "abcd"])
def test_the_middleware_reads_and_writes_the_same_bytes(frame):
    pytest.importorskip("rclpy", reason="ROS is not installed for this Python")
    from mwd_msgs.msg import ImuBurst
    from rclpy.serialization import deserialize_message, serialize_message

    imu = samples(7)
    message = deserialize_message(burst.encode(imu, frame), ImuBurst)
    assert message.header.frame_id == frame
    assert message.header.stamp == message.samples[0].stamp
    assert [s.stamp.sec * 10**9 + s.stamp.nanosec for s in message.samples] == imu["stamp_ns"].tolist()
    assert np.array([s.angular_velocity for s in message.samples]).tolist() == imu["angular_velocity"].tolist()
    assert burst.decode(serialize_message(message)).tobytes() == imu.tobytes()


def test_what_a_burst_cannot_carry_is_refused():
    oriented, unequal = samples(3), samples(3)
    oriented["orientation"][1] = 0.5
    unequal["linear_acceleration_covariance"][2] = 1.0
    for bad, words in (
        (samples(0), "1 to 1000"),
        (samples(1001), "1 to 1000"),
        (oriented, "no orientation"),
        (unequal, "must be equal"),
        (wire.MAG.empty(2), "dtype"),
    ):
        with pytest.raises(ValueError, match=words):
            burst.encode(bad, "sonde_link")


def test_bytes_that_are_no_burst_are_refused():
    good = burst.encode(samples(4), "sonde_link")
    lying = bytearray(good)
    at = len(good) - 4 * 56 - 4 - 4
    lying[at : at + 4] = (2**31).to_bytes(4, "little")
    for bad in (b"", good[:40], good[:-1], good + bytes(8), bytes(lying), b"\0\0" + good[2:]):
        with pytest.raises(WireError):
            burst.decode(bytes(bad))


@pytest.mark.parametrize("flagged", [[], [3], [0, 9], [4, 5, 6]])
def test_bursts_of_flagged_samples_bring_all_of_them_back(flagged):
    imu = samples(10)
    mark_clipped(imu, "linear_acceleration", np.isin(np.arange(10), flagged)[:, None] & np.array([True, False, True]))
    parts = burst.parts(imu, 4)
    got = np.concatenate([burst.decode(burst.encode(imu[part], "sonde_link")) for part in parts])
    assert got.tobytes() == imu.tobytes()
    assert max(len(imu[part]) for part in parts) <= 4
    assert burst.parts(imu[:0], 4) == []

# SPDX-License-Identifier: Apache-2.0
"""Bursts of a gauge: what the middleware reads and writes."""

import numpy as np
import pytest

from mwd_sensors.core import gauge_burst
from mwd_sensors.core.wire import WireError


@pytest.mark.parametrize("frame", ["rig_floor", "x", "gauge_of_pump_2"])
def test_a_burst_comes_back_as_it_went(frame):
    values = np.array([2.0e7, 2.1e7, 1.9e7])
    stamp, period, found = gauge_burst.decode(gauge_burst.encode(1_700_000_000_123_456_789, 0.01, values, frame))
    assert (stamp, period) == (1_700_000_000_123_456_789, 0.01)
    assert np.array_equal(found, values)


def test_the_middleware_reads_them():
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("mwd_msgs.msg")
    message = messages.PressureBurst(period=0.02, pressure=[1.5e7, 1.6e7])
    message.header.frame_id = "rig_floor"
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 34
    ours = gauge_burst.encode(12_000_000_034, 0.02, np.array([1.5e7, 1.6e7]))
    assert serialization.deserialize_message(ours, messages.PressureBurst) == message
    assert gauge_burst.decode(serialization.serialize_message(message))[:2] == (12_000_000_034, 0.02)


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [np.inf]])
def test_a_burst_without_samples_or_with_a_gap_is_refused(values):
    with pytest.raises(ValueError, match="values"):
        gauge_burst.encode(0, 0.01, np.array(values))


def test_cut_bytes_are_refused():
    whole = gauge_burst.encode(0, 0.01, np.arange(5.0))
    with pytest.raises(WireError):
        gauge_burst.decode(whole[:-9])


def test_the_middleware_reads_bytes_of_a_line_and_strokes():
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("mwd_msgs.msg")
    octets = np.frombuffer(b"\x00abc\xff", dtype=np.uint8)
    ours = gauge_burst.encode(12_000_000_034, 1e-3, octets)
    message = serialization.deserialize_message(ours, messages.SerialBurst)
    assert (message.period, bytes(message.data)) == (1e-3, octets.tobytes())
    stamp, _, found = gauge_burst.decode(serialization.serialize_message(message), gauge_burst.SERIAL)
    assert (stamp, found.tolist()) == (12_000_000_034, octets.tolist())
    for strokes in ([], [(1, 5_000_000_001), (2, 5_500_000_000), (1, 6_000_000_000)]):
        data = gauge_burst.encode_strokes(7_000_000_000, strokes, "rig")
        message = serialization.deserialize_message(data, messages.StrokeBurst)
        assert message.header.stamp.sec == 7
        times = [at.sec * 10**9 + at.nanosec for at in message.stamp]
        assert list(zip(message.pump, times, strict=True)) == strokes

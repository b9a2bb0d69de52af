# SPDX-License-Identifier: Apache-2.0
"""Packets of an MTi: increments as such, other formats of numbers, clip flags, and a damaged line."""

import struct

import numpy as np
import pytest

from mwd_sensors.drivers import mtdata2
from mwd_sensors.drivers.mtdata2 import MtReader, item, message, packet
from mwd_sensors.drivers.readings import CLIPPED_ACCEL, CLIPPED_GYRO, FAULT, UnitSample

MOTION = UnitSample("imu/data_raw", 0, (0.5, -12.0, 3.25, 9.5, -0.25, 160.0))


def test_a_message_of_the_protocol_document_has_its_check_sum():
    """GoToConfig and GoToMeasurement, as the document of the protocol lists them."""
    assert message(mtdata2.GO_TO_CONFIG) == bytes([0xFA, 0xFF, 0x30, 0x00, 0xD1])
    assert message(mtdata2.GO_TO_MEASUREMENT) == bytes([0xFA, 0xFF, 0x10, 0x00, 0xF1])


def test_increments_become_the_mean_rate_and_force_of_their_interval():
    reader = MtReader()
    data = b"".join(packet(MOTION, 0.01, 100 * k + 7, k) for k in range(4))
    got = [one for at in range(0, len(data), 11) for one in reader.feed(data[at : at + 11])]
    # The interval of the first packet is not known.
    assert reader.without_interval == 1
    assert [one.stamp_ns for one in got] == [10_000_000, 20_000_000, 30_000_000]
    for one in got:
        assert one.values == pytest.approx(MOTION.values, rel=1e-12)


def test_time_runs_on_over_the_end_of_its_counter_and_over_lost_packets():
    reader = MtReader()
    ticks = [2**32 - 100, 2**32, 2**32 + 300, 2**32 + 400]
    got = reader.feed(b"".join(packet(MOTION, 0.01, t, c) for t, c in zip(ticks, (65534, 65535, 2, 3), strict=True)))
    assert [one.stamp_ns for one in got] == [10_000_000, 40_000_000, 50_000_000]
    assert reader.counters.lost == 2
    # The increments after a gap are those of one interval.
    assert got[1].values == pytest.approx(MOTION.values, rel=1e-12)


def test_a_unit_that_restarts_counts_its_time_and_its_packets_from_the_start():
    reader, sample = MtReader(), UnitSample("imu/data_raw", 0, (0.1, 0.0, 0.0, 9.8, 0.0, 0.0))
    before = [packet(sample, 0.01, 36_000_000 + 100 * k, 500 + k) for k in range(5)]
    after = [packet(sample, 0.01, 100 * k, k) for k in range(3)]
    stamps = [one.stamp_ns for one in reader.feed(b"".join(before + after))]
    assert stamps == [10_000_000, 20_000_000, 30_000_000, 40_000_000, 10_000_000, 20_000_000]
    assert reader.counters.lost == 0


def test_clip_flags_and_self_test_reach_the_status():
    reader = MtReader()
    good = item(mtdata2.STATUS, struct.pack(">I", 1))
    assert packet(MOTION, 0.01, 0, 0).count(good) == 1
    words = (1, 1 | 1 << 9, 1 | 1 << 13, 0)
    sent = []
    for k, word in enumerate((1, *words)):
        content = packet(MOTION, 0.01, 100 * k, k)[4:-1].replace(good, item(mtdata2.STATUS, struct.pack(">I", word)))
        sent.append(message(mtdata2.MTDATA2, content))
    got = reader.feed(b"".join(sent))
    assert [one.status for one in got] == [0, CLIPPED_ACCEL[1], CLIPPED_GYRO[2], FAULT]


def _numbers(form, values):
    if form == 1:
        return b"".join(struct.pack(">i", round(v * 2**20)) for v in values)
    if form == 2:
        return b"".join(struct.pack(">Ih", round(v % 1.0 * 2**32), int(np.floor(v))) for v in values)
    return struct.pack(f">{len(values)}{'f' if form == 0 else 'd'}", *values)


@pytest.mark.parametrize("form", range(4))
def test_every_format_of_numbers_is_read(form):
    reader = MtReader(field_t=5e-5)
    field, rate, force = (0.5, -0.25, 0.875), (1.5, -2.25, 0.5), (9.75, -0.5, 0.125)
    content = item(mtdata2.FINE_TIME, struct.pack(">I", 5)) + item(mtdata2.TEMPERATURE | form, _numbers(form, (21.5,)))
    content += item(mtdata2.RATE_OF_TURN | form, _numbers(form, rate))
    content += item(mtdata2.ACCELERATION | form, _numbers(form, force)) + item(
        mtdata2.FIELD | form, _numbers(form, field)
    )
    temperature, mag, motion = reader.feed(message(mtdata2.MTDATA2, content))
    assert temperature.values == pytest.approx((21.5,))
    assert mag.values == pytest.approx([5e-5 * v for v in field])
    assert motion.values == pytest.approx((*rate, *force))


def test_a_field_of_unknown_size_is_left_out():
    content = item(mtdata2.FINE_TIME, struct.pack(">I", 5)) + item(mtdata2.FIELD, _numbers(0, (0.5, 0.5, 0.5)))
    assert MtReader().feed(message(mtdata2.MTDATA2, content)) == []


@pytest.mark.parametrize("identifier", [mtdata2.TEMPERATURE, mtdata2.RATE_OF_TURN | 1, mtdata2.FIELD | 2])
def test_an_item_of_another_size_is_counted_and_the_next_packet_read(identifier):
    reader = MtReader(field_t=5e-5)
    odd = item(mtdata2.FINE_TIME, bytes(4)) + item(identifier, bytes(3))
    other = item(mtdata2.FINE_TIME, bytes(4)) + item(0x7012, bytes(5)) + item(mtdata2.TEMPERATURE, bytes(4))
    (one,) = reader.feed(message(mtdata2.MTDATA2, odd) + message(mtdata2.MTDATA2, other))
    assert one.values == (0.0,)
    assert reader.counters.broken == 1


@pytest.mark.parametrize("identifier", [mtdata2.FINE_TIME, mtdata2.COUNT, mtdata2.STATUS])
def test_a_whole_number_of_a_damaged_length_is_counted_and_the_next_packet_read(identifier):
    reader = MtReader()
    huge = message(mtdata2.MTDATA2, item(identifier, b"\xff" * 200))
    other = item(mtdata2.FINE_TIME, bytes(4)) + item(mtdata2.TEMPERATURE, bytes(4))
    (one,) = reader.feed(huge + message(mtdata2.MTDATA2, other))
    assert one.values == (0.0,)
    assert reader.counters.broken == 1


def test_a_damaged_message_is_counted_and_the_next_one_read():
    reader = MtReader()
    good = [packet(MOTION, 0.01, 100 * k, k) for k in range(4)]
    damaged = bytearray(good[2])
    damaged[20] ^= 4
    assert len(reader.feed(b"\xfa\xff" + good[0] + good[1] + bytes(damaged) + good[3])) == 2
    assert reader.counters.broken >= 1
    assert reader.counters.lost == 1


def test_a_long_message_has_an_extended_length():
    content = item(mtdata2.FINE_TIME, struct.pack(">I", 5)) + item(mtdata2.TEMPERATURE | 3, struct.pack(">d", 3.5))
    content += b"".join(item(0x7FF0, bytes(200)) for _ in range(2))
    (one,) = MtReader().feed(message(mtdata2.MTDATA2, content))
    assert one.values == (3.5,)

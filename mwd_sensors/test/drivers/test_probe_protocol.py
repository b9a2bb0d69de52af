# SPDX-License-Identifier: Apache-2.0
"""What the line carries comes back to the bit, whatever the blocks it is read in, and what is damaged does not."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import burst
from mwd_sensors.drivers import probe_protocol
from mwd_sensors.drivers.probe_protocol import ProbeReader, Splitter, command, line, requested, sample
from mwd_sensors.drivers.readings import (
    CLIPPED_ACCEL,
    CLIPPED_GYRO,
    CLIPPED_MAG,
    FIELDS,
    UnitAnswer,
    UnitSample,
    readings_of,
    samples_of,
)

WARM = UnitSample("imu/temperature", 1, (21.5,))
finite = st.floats(allow_nan=False, allow_infinity=False)
widths = {
    topic: 6 if len(fields) == 2 else (1 if topic.endswith("temperature") else 3) for topic, fields in FIELDS.items()
}
readings = st.sampled_from(sorted(widths)).flatmap(
    lambda topic: st.builds(
        UnitSample,
        st.just(topic),
        st.integers(0, 2**63 - 1),
        st.tuples(*[finite] * widths[topic]),
        st.integers(0, 1023),
    )
)


@pytest.mark.slow
@pytest.mark.parametrize("text", [False, True])
@given(sent=st.lists(readings, max_size=8), cut=st.integers(1, 40))
def test_samples_come_back_to_the_bit_whatever_the_blocks(text, sent, cut):
    data = b"".join(sample(one, k, text) for k, one in enumerate(sent))
    reader = ProbeReader(text)
    got = [one for at in range(0, len(data), cut) for one in reader.feed(data[at : at + cut])]
    assert got == sent
    assert (reader.counters.frames, reader.counters.broken, reader.counters.lost) == (len(sent), 0, 0)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("bit", range(8))
def test_a_bit_that_the_line_turns_is_seen_in_every_place(text, bit):
    sent = [UnitSample("imu/mag", 5_000_000_000 + k, (1.25e-5, -4e-5, 0.1 * k), CLIPPED_ACCEL[1]) for k in range(3)]
    frames = [sample(one, k, text) for k, one in enumerate(sent)]
    for place in range(len(frames[1])):
        damaged = bytearray(frames[1])
        damaged[place] ^= 1 << bit
        reader = ProbeReader(text)
        got = reader.feed(frames[0] + bytes(damaged) + frames[2] + frames[0])
        assert all(one in sent for one in got)
        assert got[0] == sent[0]
        # A damaged end joins two frames; a damaged letter of the kind may leave a check that holds, but no sample.
        assert 2 <= len(got) <= 4


@pytest.mark.parametrize("before", [b"\x80\xfe noise $ and *", sample(WARM, 1, text=True)[:20]])
def test_bytes_before_a_line_of_text_cost_no_other_line(before):
    lines = [sample(UnitSample("imu/temperature", k, (21.5,)), k, text=True) for k in range(3)]
    reader = ProbeReader(text=True)
    assert [one.stamp_ns for one in reader.feed(lines[0] + before + lines[1] + lines[2])] == [0, 1, 2]
    assert (reader.counters.frames, reader.counters.broken) == (3, 1)


def test_a_gap_of_the_counter_counts_what_is_missing():
    reader = ProbeReader(False)
    reader.feed(b"".join(sample(WARM, counter, False) for counter in (250, 255, 2)))
    assert reader.counters.lost == 4 + 2


def test_the_rest_of_a_frame_at_the_beginning_is_no_fault_of_the_line():
    reader = ProbeReader(False)
    assert reader.feed(sample(WARM, 0, False)[3:] + sample(WARM, 1, False)) == [WARM]
    assert reader.counters.broken == 0


@pytest.mark.parametrize("text", [False, True])
def test_commands_and_answers_come_back(text):
    splitter = Splitter(text)
    for name in probe_protocol.COMMANDS:
        (asked,) = splitter.feed(command(name, 3, text, 1_772_344_800_123_456_789))
        assert requested(*asked) == (name, 1_772_344_800_123_456_789)
    reader = ProbeReader(text)
    told = [UnitAnswer("time", sent_ns=17, unit_ns=2**60), UnitAnswer("info", "probe 7 v1.2")]
    assert [one for k, a in enumerate(told) for one in reader.feed(probe_protocol.answer(a, k, text))] == told


def test_samples_of_the_graph_become_readings_and_back():
    samples = burst.bare(3)
    samples["stamp_ns"] = [10, 20, 30]
    samples["angular_velocity"] = np.arange(9).reshape(3, 3) / 7.0
    samples["linear_acceleration"] = [math.pi, -0.0, 1e-300]
    again = samples_of("imu/data_raw", readings_of("imu/data_raw", samples))
    assert again.tobytes() == samples.tobytes()
    assert samples_of("imu/data_raw", readings_of("imu/data_raw", samples), 5)["stamp_ns"].tolist() == [15, 25, 35]


@pytest.mark.parametrize("topic", ["imu/data_raw", "gyro/data_raw", "imu/mag"])
def test_clip_flags_of_a_line_come_back_from_the_samples(topic):
    bits = (*CLIPPED_ACCEL, *CLIPPED_GYRO) if topic != "imu/mag" else CLIPPED_MAG
    sent = [UnitSample(topic, k, (0.25,) * widths[topic], bit) for k, bit in enumerate((0, *bits, sum(bits)))]
    assert readings_of(topic, samples_of(topic, sent)) == sent


@pytest.mark.parametrize(
    "words",
    [
        ("TEMP", 0, 10**20, 50.0, 0),
        ("TEMP", 0, 5, 50.0, 70_000),
        ("CLOCK", 0, 5, -(10**30)),
        ("CLOCK", 0, 10**19, 5),
        # A number is missing.
        ("CLOCK", 0, 17),
    ],
)
def test_a_line_with_a_number_that_no_frame_could_hold_is_broken_and_what_follows_is_read(words):
    reader = ProbeReader(text=True)
    assert reader.feed(line(*words) + sample(WARM, 1, True)) == [WARM]
    assert reader.counters.broken == 1

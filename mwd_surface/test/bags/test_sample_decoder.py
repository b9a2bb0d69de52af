# SPDX-License-Identifier: Apache-2.0
"""Messages to samples: fast where the layout is fixed, right where it is not, and what is neither is counted."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from rosbags.typesys import Stores, get_typestore

from mwd_sensors.core import burst, wire
from mwd_surface.bags.bag_files import BagError, TopicInfo
from mwd_surface.bags.message_parts import part_of
from mwd_surface.bags.sample_decoder import SampleDecoder

START = 1_700_000_000_000_000_000
IMU = wire.IMU.type_name
STORE = get_typestore(Stores.ROS2_JAZZY)
TOPICS = {
    "/imu": TopicInfo("/imu", IMU, 0),
    "/note": TopicInfo("/note", "std_msgs/msg/String", 0),
    "/burst": TopicInfo("/burst", burst.TYPE_NAME, 0),
    "/own": TopicInfo("/own", "nobody_msgs/msg/Depth", 0, "ros2msg", "float64 depth\n"),
    "/lost": TopicInfo("/lost", "nobody_msgs/msg/Lost", 0),
}
NAMES = dict(enumerate(TOPICS))
IMU_, NOTE, BURST = 0, 1, 2


def imu(count):
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = START + np.arange(count)
    samples["angular_velocity"] = np.random.default_rng(1).normal(size=(count, 3))
    return samples


def encoded(samples, frame="sonde"):
    return [row.tobytes() for row in wire.IMU.encode(samples, frame)]


def part(messages, channel=IMU_):
    return part_of([(START + k, channel, data) for k, data in enumerate(messages)])


class Bench:
    """A decoder and what it reported."""

    def __init__(self, compressed=False):
        self.given = []
        self.decoder = SampleDecoder(TOPICS, compressed, self.given.append)

    def samples(self, messages, channel=IMU_, fields=None, wanted=None):
        found = list(self.decoder.samples(part(messages, channel), NAMES, fields or {}, wanted))
        assert all(len(log_ns) == len(samples) for _, log_ns, samples in found)
        return found


@pytest.fixture
def bench():
    return Bench()


def test_messages_of_one_size_come_back_to_the_bit(bench):
    ((name, log_ns, samples),) = bench.samples(encoded(imu(50)))
    assert (name, samples.tobytes()) == ("/imu", imu(50).tobytes())
    assert log_ns.tolist() == [START + k for k in range(50)]
    assert not bench.given


@pytest.mark.parametrize("frames", [["", "s", "imu_link_of_a_very_long_name_é"], ["ab", "abc"]])
def test_messages_with_frame_names_of_any_length_keep_their_order(bench, frames):
    """Names of two and three letters make messages of the same size."""
    messages = [encoded(imu(40)[k : k + 1], frames[k % len(frames)])[0] for k in range(40)]
    ((_, log_ns, samples),) = bench.samples(messages)
    assert samples.tobytes() == imu(40).tobytes()
    assert (np.diff(log_ns) > 0).all()
    assert not bench.given


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("fields", [wire.IMU.dtype.names, ("stamp_ns", "angular_velocity")])
def test_all_fields_or_those_asked_for_are_read_in_either_byte_order(bench, fields, little_endian):
    sent = (STORE.deserialize_cdr(data, IMU) for data in encoded(imu(5)))
    messages = [bytes(STORE.serialize_cdr(one, IMU, little_endian=little_endian)) for one in sent]
    asked = {} if fields == wire.IMU.dtype.names else {IMU: fields[1:]}
    ((_, _, samples),) = bench.samples(messages, fields=asked)
    assert samples.dtype.names == fields
    assert all(np.array_equal(samples[name], imu(5)[name]) for name in fields)
    # Reported each time; the bag keeps one note of a kind.
    assert all("rosbags" in text for text in bench.given)
    assert bool(bench.given) != little_endian


def test_topics_that_are_not_wanted_are_passed_over(bench):
    assert bench.samples(encoded(imu(5)), wanted={"/note"}) == []


def test_a_message_that_is_not_of_its_type_is_reported_and_left_out(bench):
    messages = encoded(imu(10))
    messages[4] = b"\0\1\0\0junk"
    ((_, log_ns, samples),) = bench.samples(messages)
    assert len(samples) == 9
    assert START + 4 not in log_ns
    assert [text.split(":")[0] for text in bench.given if "left out" in text] == ["/imu"]


def test_a_burst_gives_its_samples_at_the_time_of_the_burst(bench):
    sensed = imu(8)
    for name in ("orientation", "orientation_covariance"):
        sensed[name] = burst.bare()[name]
    messages = [burst.encode(sensed[k : k + 4], "sonde") for k in (0, 4)]
    ((_, log_ns, samples),) = bench.samples([*messages, b"\0\1\0\0junk"], channel=BURST)
    assert samples["angular_velocity"].tobytes() == imu(8)["angular_velocity"].tobytes()
    assert log_ns.tolist() == [START] * 4 + [START + 1] * 4
    assert sum("left out" in text for text in bench.given) == 1


@pytest.mark.fault_case(68)
def test_a_type_without_a_layout_stays_bytes_and_is_decoded_where_its_definition_is_known(bench):
    data = bytes(STORE.serialize_cdr(STORE.types["std_msgs/msg/String"]("pump on"), "std_msgs/msg/String"))
    ((_, _, samples),) = bench.samples([data], channel=NOTE)
    assert samples == [data]
    assert bench.decoder.decode("/note", data).data == "pump on"
    # This definition comes from the recording.
    assert bench.decoder.decode("/own", b"\0\1\0\0" + np.float64(1234.5).tobytes()).depth == 1234.5
    with pytest.raises(BagError, match="is not a std_msgs/msg/String"):
        bench.decoder.decode("/note", b"\0\1\0\0\xff\xff\xff\xffx")
    with pytest.raises(BagError, match="/lost cannot be decoded"):
        bench.decoder.decode("/lost", b"\0\1\0\0")


def test_messages_compressed_singly_are_unpacked_and_damaged_ones_left_out():
    bench, packer = Bench(compressed=True), zstandard.ZstdCompressor()
    messages = [packer.compress(data) for data in encoded(imu(4))]
    messages[1] = b"junk"
    messages[2] = messages[2][:-9]
    ((_, log_ns, samples),) = bench.samples(messages)
    assert log_ns.tolist() == [START, START + 3]
    assert samples.tobytes() == imu(4)[[0, 3]].tobytes()
    assert sum("left out" in text for text in bench.given) == 2


def test_a_message_that_claims_to_be_enormous_is_refused_without_unpacking_it():
    bench = Bench(compressed=True)
    assert bench.decoder.unzipped(zstandard.ZstdCompressor().compress(bytes(2**27))) is None
    assert "claims more than" in bench.given[0]


def test_a_message_of_many_sequences_has_unused_bytes_for_each_of_them():
    """The middleware counts the alignment of the items of each sequence, also of empty ones."""
    kind = "diagnostic_msgs/msg/DiagnosticArray"
    decoder = SampleDecoder({"/diagnostics": TopicInfo("/diagnostics", kind, 0)}, False, [].append)
    types = STORE.types
    status = types["diagnostic_msgs/msg/DiagnosticStatus"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "")
    rows = [status(level=0, name=f"node {k}", message="", hardware_id="", values=[]) for k in range(100)]
    data = bytes(STORE.serialize_cdr(types[kind](header, rows), kind))
    for unused in (0, 4, 4 * len(rows)):
        found = decoder.decode("/diagnostics", data + bytes(unused))
        assert [one.name for one in found.status] == [one.name for one in rows]
    with pytest.raises(BagError):
        decoder.decode("/diagnostics", data + bytes(2 * len(data)))

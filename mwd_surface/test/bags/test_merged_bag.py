# SPDX-License-Identifier: Apache-2.0
"""A copy with more topics: the original bytes, everything in order of time, readable by the libraries of others."""

from pathlib import Path

import numpy as np
import plotted_bag
import pytest
from mcap.reader import make_reader
from other_definitions import other_definitions
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap.recovery import check
from mwd_surface.bags.merged_bag import merged_bag

START = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)


def _source(path: Path, count: int = 3000) -> None:
    imu, mag = wire.IMU.empty(count), wire.MAG.empty(count // 10)
    imu["stamp_ns"] = START + np.arange(count) * 1_000_000
    imu["angular_velocity"] = np.random.default_rng(1).normal(size=(count, 3))
    mag["stamp_ns"] = START + np.arange(count // 10) * 10_000_000 + 4_000_000
    text = STORE.types["std_msgs/msg/String"]("pump on")
    with BagWriter(path, custom={"well": "w1"}, chunk_bytes=100_000) as writer:
        writer.attach("notes.txt", "text/plain", b"as drilled", START)
        writer.add_metadata("versions", {"sonde": "7"})
        one, two = writer.topic("/w1/imu/data_raw", wire.IMU.type_name), writer.topic("/w1/imu/mag", wire.MAG.type_name)
        other = writer.topic("/note", "std_msgs/msg/String")
        writer.write_rows(one, wire.IMU.encode(imu, "sonde_link"), imu["stamp_ns"] + 2000, imu["stamp_ns"] + 1000)
        # Later in the file than in time.
        writer.write_rows(two, wire.MAG.encode(mag, "s"), mag["stamp_ns"])
        for k in range(3):
            data = bytes(STORE.serialize_cdr(text, "std_msgs/msg/String"))
            writer.write(other, data + bytes(4 * k), START + k * 900_000_000)


def _attitude(count: int, step_ns: int) -> np.ndarray:
    samples = wire.ATTITUDE.empty(count)
    samples["stamp_ns"] = START + np.arange(count) * step_ns
    samples["inclination"] = np.arange(count)
    return samples


def _merge(source: Path, target: Path, attitude: np.ndarray, name: str = "/w1/attitude") -> str:
    with Bag(source) as bag, merged_bag(target, bag) as merged:
        channel, name = merged.topic(name, wire.ATTITUDE.type_name)
        done = 0
        for block, originals in bag.blocks_and_originals(["/w1/imu/data_raw"], block_messages=500):
            for one in originals:
                merged.add_originals(one)
            until = max(int(one.log_ns[-1]) for one in originals)
            cut = int(np.searchsorted(attitude["stamp_ns"], until, "right"))
            part = attitude[done:cut]
            merged.add_rows(channel, wire.ATTITUDE.encode(part, "sonde_link"), part["stamp_ns"])
            merged.flush(until)
            done = cut
            assert set(block) <= {"/w1/imu/data_raw"}
    return name


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A recording, and its copy with an attitude at 100 Hz."""
    path = tmp_path_factory.mktemp("bags")
    _source(path / "bag")
    _merge(path / "bag", path / "merged", _attitude(300, 10_000_000))
    return path


def _messages(path: Path) -> list[tuple[int, str, str, bytes]]:
    with Bag(path) as bag:
        assert bag.complete
        return list(bag.messages())


def test_originals_keep_their_bytes_and_the_new_lie_between_them_by_time(folder):
    merged, originals = _messages(folder / "merged"), _messages(folder / "bag")
    assert [m for m in merged if m[1] != "/w1/attitude"] == originals
    assert [m[0] for m in merged] == sorted(m[0] for m in merged)
    new = b"".join(m[3] for m in merged if m[1] == "/w1/attitude")
    assert new == wire.ATTITUDE.encode(_attitude(300, 10_000_000), "sonde_link").tobytes()
    with Bag(folder / "merged") as bag:
        assert bag.custom == {"well": "w1"}
        assert bag.attachments()[0].data == b"as drilled"
        assert bag.metadata()["versions"] == {"sonde": "7"}
        assert bag.topics["/note"].count == 3


def test_the_file_itself_is_in_order_of_time_with_indexes_times_and_sequences_as_they_were(folder):
    (file,) = (folder / "merged").glob("*.mcap")
    assert check(file).sound
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        schemas = {schema.name: schema.data for schema in reader.get_summary().schemas.values()}
        assert b"inclination" in schemas["mwd_msgs/msg/Attitude"]
        found = list(reader.iter_messages(log_time_order=False))
    assert [m.log_time for _, _, m in found] == sorted(m.log_time for _, _, m in found)
    imu = [m for _, channel, m in found if channel.topic == "/w1/imu/data_raw"]
    assert all(m.log_time - m.publish_time == 1000 for m in imu)
    assert [m.sequence for m in imu] == list(range(1, 3001))
    attitude = [m for _, channel, m in found if channel.topic == "/w1/attitude"]
    assert [m.sequence for m in attitude] == list(range(1, 301))
    with AnyReader([folder / "merged"]) as reader:
        connection = next(c for c in reader.connections if c.topic == "/w1/attitude")
        message = next(reader.deserialize(data, c.msgtype) for c, _, data in reader.messages([connection]))
        assert message.header.frame_id == "sonde_link"


def test_a_topic_that_is_there_already_is_not_mixed_with_the_new_one(folder, tmp_path):
    again = _merge(folder / "merged", tmp_path / "again", _attitude(30, 100_000_000))
    assert again == "/w1/processed/attitude"
    with Bag(tmp_path / "again") as bag:
        assert (bag.topics["/w1/attitude"].count, bag.topics[again].count) == (300, 30)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_recordings_of_others_are_merged_too(tmp_path, storage):
    imu = wire.IMU.empty(100)
    imu["stamp_ns"] = START + np.arange(100) * 1_000_000
    with Writer(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        one = writer.add_connection("/w1/imu/data_raw", wire.IMU.type_name, typestore=STORE)
        for row, stamp in zip(wire.IMU.encode(imu, "imu"), imu["stamp_ns"].tolist(), strict=True):
            writer.write(one, stamp, row.tobytes())
    _merge(tmp_path / "bag", tmp_path / "merged", _attitude(10, 10_000_000))
    merged = _messages(tmp_path / "merged")
    assert [m for m in merged if m[1] != "/w1/attitude"] == _messages(tmp_path / "bag")
    assert len(merged) == 110


def test_a_copy_that_fails_leaves_nothing(folder, tmp_path):
    with Bag(folder / "bag") as bag, pytest.raises(KeyboardInterrupt), merged_bag(tmp_path / "merged", bag):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_messages_of_another_definition_are_named_unreadable_and_copied_as_they_are(tmp_path):
    survey = "mwd_msgs/msg/Survey"

    def of(store, number):
        message = plotted_bag.blank(store, survey)
        message.sequence = number
        return np.frombuffer(store.serialize_cdr(plotted_bag.arrays(message), survey), dtype=np.uint8)

    with BagWriter(tmp_path / "source", other_definitions(tmp_path / "old")) as writer:
        channel = writer.topic("/w1/survey", survey)
        theirs = bytes(of(writer.definitions.typestore, 7))
        writer.write(channel, theirs, START)
    with Bag(tmp_path / "source") as bag, merged_bag(tmp_path / "merged", bag) as merged:
        assert "another definition" in bag.unread(survey)
        channel, name = merged.topic("/w1/survey", survey)
        for _, originals in bag.blocks_and_originals([]):
            for one in originals:
                merged.add_originals(one)
        merged.add_rows(channel, of(merged.definitions.typestore, 8)[None, :], np.array([START + 1]))
    with Bag(tmp_path / "merged") as bag:
        assert list(bag.unreadable) == ["/w1/survey"]
        assert [bag.decode(topic, data).sequence for _, topic, _, data in bag.messages()] == [8]
        file = bag.files[0]
    with file.open("rb") as stream:
        copied = {channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()}
    assert copied["/w1/survey"] == theirs
    assert copied.keys() == {"/w1/survey", name}

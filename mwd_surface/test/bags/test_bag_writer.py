# SPDX-License-Identifier: Apache-2.0
"""Bags as other programs read them: `rosbags` and `mcap` must find every message with its stamps and bytes."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from mwd_sensors.core import wire
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import DefinitionError, Definitions

START = 1_700_000_000_000_000_000
STREAM = [bag_metadata.qos_profile("best_effort", depth=5)]


def imu(count: int, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = START + np.arange(count) * 1_000_000
    samples["angular_velocity"] = random.normal(size=(count, 3))
    samples["linear_acceleration"] = random.normal(size=(count, 3))
    return samples


def by_rosbags(path) -> list[tuple[str, int, bytes]]:
    with Reader(path) as reader:
        return [(c.topic, stamp, bytes(data)) for c, stamp, data in reader.messages()]


def by_mcap(path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in reader.iter_messages()]


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_rows_and_single_messages_are_found_by_rosbags_and_mcap(tmp_path, compression):
    samples = imu(3000)
    rows = wire.IMU.encode(samples, "sonde_link")
    with BagWriter(tmp_path / "bag", compression=compression, chunk_bytes=100_000) as writer:
        a = writer.topic("/well/imu/data_raw", "sensor_msgs/msg/Imu", STREAM)
        b = writer.topic("/well/note", "std_msgs/msg/String")
        for k in range(0, 3000, 700):
            writer.write_rows(a, rows[k : k + 700], samples["stamp_ns"][k : k + 700])
            writer.write(b, b"\0\1\0\0\2\0\0\0a\0", START + k * 1_000_000, START + k * 1_000_000 - 5)
    found = by_rosbags(tmp_path / "bag")
    assert [row for topic, _, row in found if topic.endswith("data_raw")] == [row.tobytes() for row in rows]
    assert [stamp for topic, stamp, _ in found if topic.endswith("data_raw")] == samples["stamp_ns"].tolist()
    other = by_mcap(tmp_path / "bag" / "bag_0.mcap")
    assert len(other) == len(found) == 3005
    assert {log - publish for topic, log, publish, _ in other if topic == "/well/note"} == {5}


def test_a_strict_stream_reader_finds_nothing_wrong_with_checksums_and_indexes(tmp_path):
    samples = imu(2000)
    with BagWriter(tmp_path / "bag", chunk_bytes=50_000) as writer:
        channel = writer.topic("/imu/data_raw", "sensor_msgs/msg/Imu", STREAM)
        writer.write_rows(channel, wire.IMU.encode(samples, "s"), samples["stamp_ns"])
        writer.attach("report.txt", "text/plain", b"all well", START)
        writer.add_metadata("versions", {"mwd_surface": "0.1.0"})
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        assert sum(1 for _ in StreamReader(file, validate_crcs=True).records) > 2000
        file.seek(0)
        reader = make_reader(file, validate_crcs=True)
        statistics = reader.get_summary().statistics
        assert [item.data for item in reader.iter_attachments()] == [b"all well"]
        tables = {item.name: item.metadata for item in reader.iter_metadata()}
    assert (statistics.message_start_time, statistics.channel_message_counts) == (START, {1: 2000})
    assert (statistics.attachment_count, statistics.metadata_count) == (1, 2)
    assert tables["versions"] == {"mwd_surface": "0.1.0"}
    assert "topics_with_message_count" in tables["rosbag2"]["serialized_metadata"]


def test_quality_of_service_and_hash_in_the_channel_equal_those_in_metadata_yaml(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.topic("/a", "std_msgs/msg/String", STREAM)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        channel = make_reader(file).get_summary().channels[1]
    (topic,) = bag_metadata.read(tmp_path / "bag").topics
    assert bag_metadata.parse_qos(channel.metadata["offered_qos_profiles"]) == topic.qos == STREAM
    assert channel.metadata["topic_type_hash"] == topic.type_hash


def test_a_split_loses_no_message_and_every_file_opens_alone(tmp_path):
    samples = imu(900)
    rows = wire.IMU.encode(samples, "s")
    with BagWriter(tmp_path / "bag") as writer:
        channel = writer.topic("/imu/data_raw", "sensor_msgs/msg/Imu", STREAM)
        for k in range(3):
            part = slice(300 * k, 300 * (k + 1))
            writer.write_rows(channel, rows[part], samples["stamp_ns"][part])
            if k < 2:
                writer.split()
    assert [data for _, _, data in by_rosbags(tmp_path / "bag")] == [row.tobytes() for row in rows]
    for k in range(3):
        assert len(by_rosbags(tmp_path / "bag" / f"bag_{k}.mcap")) == 300
    assert bag_metadata.read(tmp_path / "bag").topics[0].count == 900


def test_an_empty_bag_opens(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.topic("/a", "std_msgs/msg/String")
    assert by_rosbags(tmp_path / "bag") == []
    assert by_mcap(tmp_path / "bag" / "bag_0.mcap") == []


def test_a_bag_appears_under_its_name_when_it_is_complete_and_never_replaces_another(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.topic("/a", "std_msgs/msg/String")
        assert not (tmp_path / "bag").exists()
    with pytest.raises(FileExistsError, match="exists already"):
        BagWriter(tmp_path / "bag")
    with pytest.raises(ValueError, match="channel: 7"), BagWriter(tmp_path / "other") as writer:
        writer.write(7, b"", START)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_a_type_without_definition_is_refused_or_recorded_without_one_as_asked(tmp_path):
    with BagWriter(tmp_path / "bag", Definitions([])) as writer:
        with pytest.raises(DefinitionError):
            writer.topic("/x", "mwd_msgs/msg/Survey")
        channel = writer.topic("/x", "mwd_msgs/msg/Survey", need_definition=False)
        writer.write(channel, b"\0\1\0\0", START)
    assert by_mcap(tmp_path / "bag" / "bag_0.mcap") == [("/x", START, START, b"\0\1\0\0")]


def test_wrong_arguments_are_named(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        channel = writer.topic("/a", "std_msgs/msg/String")
        with pytest.raises(ValueError, match="channel: 9"):
            writer.write(9, b"", START)
        with pytest.raises(ValueError, match="before 1970"):
            writer.write(channel, b"", -1)
        with pytest.raises(ValueError, match="rows"):
            writer.write_rows(channel, np.zeros((3, 4), np.uint8), [START])
        writer.write_rows(channel, np.zeros((0, 4), np.uint8), [])
    assert by_rosbags(tmp_path / "bag") == []


def test_a_topic_asked_for_twice_is_one_channel_and_another_type_is_another(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        first = writer.topic("/a", "std_msgs/msg/String")
        assert writer.topic("/a", "std_msgs/msg/String") == first
        assert writer.topic("/a", "std_msgs/msg/Int32") != first

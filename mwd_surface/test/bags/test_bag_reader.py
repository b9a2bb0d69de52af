# SPDX-License-Identifier: Apache-2.0
"""Bags of every kind against the messages that went in, and against `rosbags` on a real recording."""

from __future__ import annotations

import contextlib
import itertools
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.records import Header
from mcap.writer import IndexType, Writer
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore
from traced_memory import peak_bytes

from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import MAGIC, ChunkHead
from mwd_surface.bags.mcap.writer import chunk_prefix, packed

START = 1_700_000_000_000_000_000
HOUR = 3600 * 10**9
IMU, MAG = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
STORE = get_typestore(Stores.ROS2_JAZZY)


def imu(count: int, step_ns: int = 1_000_000) -> np.ndarray:
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = START + np.arange(count) * step_ns
    samples["angular_velocity"] = np.random.default_rng(1).normal(size=(count, 3))
    samples["orientation_covariance"][:, 0] = -1
    return samples


def mag(count: int, step_ns: int = 10_000_000) -> np.ndarray:
    samples = wire.MAG.empty(count)
    samples["stamp_ns"] = START + np.arange(count) * step_ns
    samples["magnetic_field"] = np.random.default_rng(2).normal(size=(count, 3)) * 5e-5
    return samples


def write_bag(path: Path, seconds: int = 5, **options) -> tuple[np.ndarray, np.ndarray]:
    """Imu at 1 kHz and field at 100 Hz, written topic by topic for each second."""
    a, b = imu(1000 * seconds), mag(100 * seconds)
    with BagWriter(path, **options) as writer:
        one, two = writer.topic("/well_7/imu/data_raw", IMU), writer.topic("/well_7/imu/mag", MAG)
        for k in range(seconds):
            for channel, layout, samples, rate in ((one, wire.IMU, a, 1000), (two, wire.MAG, b, 100)):
                part = samples[k * rate : (k + 1) * rate]
                writer.write_rows(channel, layout.encode(part, "sonde_link"), part["stamp_ns"])
    return a, b


def joined(bag: Bag, **options) -> dict[str, np.ndarray]:
    parts: dict[str, list[np.ndarray]] = {}
    for block in bag.blocks(**options):
        for name, (log_ns, samples) in block.items():
            assert (np.diff(log_ns) >= 0).all()
            parts.setdefault(name, []).append(samples)
    return {name: np.concatenate(some) for name, some in parts.items()}


@pytest.fixture(scope="module")
def bag_path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_bag(path, chunk_bytes=100_000)
    return path


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_samples_come_back_as_they_were_written(tmp_path, compression):
    a, b = write_bag(tmp_path / "bag", compression=compression, chunk_bytes=70_000)
    with Bag(tmp_path / "bag") as bag:
        found = joined(bag)
        assert bag.notes == []
        assert bag.complete
        assert (bag.start_ns, bag.end_ns) == (START, int(a["stamp_ns"][-1]))
        assert bag.message_count == 5500
    assert found["/well_7/imu/data_raw"].tobytes() == a.tobytes()
    assert found["/well_7/imu/mag"].tobytes() == b.tobytes()


def test_only_the_fields_asked_for_are_read_and_other_types_whole(bag_path):
    with Bag(bag_path) as bag:
        whole, some = joined(bag), joined(bag, fields={IMU: ("angular_velocity", "linear_acceleration")})
    imu_whole, imu_some = whole["/well_7/imu/data_raw"], some["/well_7/imu/data_raw"]
    assert imu_some.dtype.names == ("stamp_ns", "angular_velocity", "linear_acceleration")
    for name in imu_some.dtype.names:
        np.testing.assert_array_equal(imu_some[name], imu_whole[name])
    assert some["/well_7/imu/mag"].tobytes() == whole["/well_7/imu/mag"].tobytes()


@pytest.mark.slow
def test_a_recording_of_another_program_reads_as_rosbags_reads_it(broad_27):
    with RosbagsReader(broad_27) as reader:
        expected = [(stamp, c.topic, bytes(data)) for c, stamp, data in reader.messages()]
    with Bag(broad_27) as bag:
        found = [(stamp, topic, data) for stamp, topic, _, data in bag.messages()]
        assert any("no checksums" in note for note in bag.notes)
    key = lambda row: (row[0], row[1])  # noqa: E731
    assert [row[0] for row in found] == [row[0] for row in expected]
    assert sorted(found, key=key) == sorted(expected, key=key)
    with Bag(broad_27) as bag:
        blocks = joined(bag, topics=["/imu/data_raw"])
    rows = [STORE.deserialize_cdr(data, IMU) for _, topic, data in expected[:3000] if topic == "/imu/data_raw"]
    gyro = [[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in rows]
    assert np.array_equal(blocks["/imu/data_raw"]["angular_velocity"][: len(rows)], gyro)
    assert len(blocks["/imu/data_raw"]) == 54952


def test_a_bare_file_reads_as_its_directory_does(bag_path):
    with Bag(bag_path) as one, Bag(bag_path / "bag_0.mcap") as two:
        assert list(one.messages()) == list(two.messages())


def test_every_message_of_a_block_is_no_later_than_those_of_the_next(bag_path):
    with Bag(bag_path) as bag:
        blocks = list(bag.blocks(block_messages=300))
    assert len(blocks) > 8
    for before, after in itertools.pairwise(blocks):
        last = max(log_ns[-1] for log_ns, _ in before.values())
        assert last <= min(log_ns[0] for log_ns, _ in after.values())


def test_a_block_stays_near_its_size_even_when_a_chunk_is_larger(tmp_path):
    a, _ = write_bag(tmp_path / "bag", chunk_bytes=8_000_000)
    with Bag(tmp_path / "bag") as bag:
        sizes = [sum(len(log_ns) for log_ns, _ in block.values()) for block in bag.blocks(block_messages=500)]
        assert sum(sizes) == 5500
        assert max(sizes) <= 1000
        assert joined(bag, block_messages=500)["/well_7/imu/data_raw"].tobytes() == a.tobytes()


def test_messages_come_in_order_of_time_with_topic_type_and_bytes(bag_path):
    with Bag(bag_path) as bag:
        found = list(bag.messages())
    assert len(found) == 5500
    assert [row[0] for row in found] == sorted(row[0] for row in found)
    assert {row[1:3] for row in found} == {("/well_7/imu/data_raw", IMU), ("/well_7/imu/mag", MAG)}
    assert wire.MAG.decode(next(row[3] for row in found if row[2] == MAG))["stamp_ns"][0] == START


def test_a_range_of_time_includes_its_start_and_excludes_its_end(bag_path):
    first, last = START + 1_500_000_000, START + 2_500_000_000
    with Bag(bag_path) as bag:
        rows = [row[0] for row in bag.messages(start_ns=first, end_ns=last)]
        found = joined(bag, start_ns=first, end_ns=last)
    assert (rows[0], rows[-1], len(rows)) == (first, last - 1_000_000, 1100)
    assert len(found["/well_7/imu/data_raw"]) == 1000


def test_messages_out_of_order_in_the_file_are_put_in_order(tmp_path):
    samples = imu(2000)
    rows, stamps = wire.IMU.encode(samples, "s"), samples["stamp_ns"].tolist()
    with BagWriter(tmp_path / "bag", chunk_bytes=30_000) as writer:
        channel = writer.topic("/imu/data_raw", IMU)
        for k in np.random.default_rng(3).permutation(2000).tolist():
            writer.write(channel, rows[k].tobytes(), stamps[k])
    with Bag(tmp_path / "bag") as bag:
        assert joined(bag, block_messages=100)["/imu/data_raw"].tobytes() == samples.tobytes()
        assert [row[0] for row in bag.messages()] == stamps


def test_a_topic_is_found_in_any_namespace(bag_path):
    with Bag(bag_path) as bag:
        assert bag.find_topic(IMU, "imu/data_raw") == "/well_7/imu/data_raw"
        assert bag.find_topic(MAG) == "/well_7/imu/mag"
        with pytest.raises(BagError, match=r"no topic of sensor_msgs/msg/Imu.*ends in 'data'.*/well_7/imu/data_raw"):
            bag.find_topic(IMU, "data")
        with pytest.raises(BagError, match=r"no topic of sensor_msgs/msg/Temperature.*it has"):
            bag.find_topic("sensor_msgs/msg/Temperature")
        with pytest.raises(BagError, match="has no topic /imu"):
            next(bag.blocks(["/imu"]))


def test_two_topics_that_fit_are_both_named(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("/a/imu/data_raw", "/b/imu/data_raw"):
            writer.write(writer.topic(name, IMU), b"\0\1\0\0", START)
    with Bag(tmp_path / "bag") as bag, pytest.raises(BagError, match=r"2 topics.*/a/imu/data_raw, /b/imu/data_raw"):
        bag.find_topic(IMU, "imu/data_raw")


def rosbags_bag(path: Path, storage: StoragePlugin, mode: CompressionMode | None = None) -> np.ndarray:
    samples = imu(700)
    writer = RosbagsWriter(path, version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/imu/data_raw", IMU, typestore=STORE)
        for stamp, row in zip(samples["stamp_ns"].tolist(), wire.IMU.encode(samples, "s"), strict=True):
            writer.write(connection, stamp, row.tobytes())
    return samples


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("mode", [None, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_bags_of_rosbags_with_either_storage_and_any_compression_are_read(tmp_path, storage, mode):
    samples = rosbags_bag(tmp_path / "bag", storage, mode)
    with Bag(tmp_path / "bag") as bag:
        assert joined(bag)["/imu/data_raw"].tobytes() == samples.tobytes()
        assert [row[0] for row in bag.messages(start_ns=START + 5_000_000)] == samples["stamp_ns"].tolist()[5:]
        assert any("rosbags" in note for note in bag.notes) == (storage == StoragePlugin.SQLITE3)
        assert bag.storage == storage.name.lower()
        assert (bag.start_ns, bag.end_ns) == (START, int(samples["stamp_ns"][-1]))


@pytest.mark.parametrize("chunking", [True, False])
@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE])
@pytest.mark.parametrize("summary", [True, False])
def test_files_of_the_mcap_library_with_and_without_chunks_and_indexes_are_read(tmp_path, chunking, index, summary):
    samples = imu(500)
    repeated = dict.fromkeys(("repeat_channels", "repeat_schemas", "use_statistics"), summary)
    with (tmp_path / "x.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=4000, index_types=index, use_chunking=chunking, **repeated)
        writer.start("ros2")
        channel = writer.register_channel("/imu/data_raw", "cdr", writer.register_schema(IMU, "ros2msg", b""))
        for stamp, row in zip(samples["stamp_ns"].tolist(), wire.IMU.encode(samples, "s"), strict=True):
            writer.add_message(channel, stamp, row.tobytes(), stamp)
        writer.finish()
    with Bag(tmp_path / "x.mcap") as bag:
        assert joined(bag, block_messages=200)["/imu/data_raw"].tobytes() == samples.tobytes()
        assert bag.message_count == 500


def test_a_file_that_was_cut_off_is_read_to_its_last_good_chunk(bag_path, tmp_path):
    data = (bag_path / "bag_0.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    with Bag(bag_path) as bag:
        whole = [row[3] for row in bag.messages()]
    with Bag(tmp_path / "cut.mcap") as bag:
        rows = [row[3] for row in bag.messages()]
        assert not bag.complete
        assert any("interrupted" in note for note in bag.notes)
        assert bag.message_count == len(rows)
    assert 2500 < len(rows) < 5000
    assert set(rows) <= set(whole)


@pytest.mark.slow
@pytest.mark.fault_case(66)
def test_no_single_flipped_bit_ever_returns_wrong_data(tmp_path):
    write_bag(tmp_path / "bag", seconds=1, chunk_bytes=20_000)
    path = tmp_path / "bag" / "bag_0.mcap"
    data = path.read_bytes()
    with Bag(path) as bag:
        whole = set(bag.messages())
    random = np.random.default_rng(5)
    partial = 0
    for at in random.integers(0, len(data), 150).tolist():
        broken = bytearray(data)
        broken[at] ^= 1 << int(random.integers(8))
        (tmp_path / "broken.mcap").write_bytes(broken)
        try:
            with Bag(tmp_path / "broken.mcap") as bag:
                found = set(bag.messages())
                assert found <= whole
                assert found == whole or not bag.complete
                partial += found != whole
        except BagError:
            continue
    assert partial > 50


@pytest.mark.fault_case(66)
@pytest.mark.parametrize("at", [9, 60, 5000, -60])
def test_a_hostile_length_is_refused_in_bounded_memory(bag_path, tmp_path, at):
    data = bytearray((bag_path / "bag_0.mcap").read_bytes())
    data[at : at + 8] = (2**60).to_bytes(8, "little")
    (tmp_path / "evil.mcap").write_bytes(data)

    def read() -> None:
        with contextlib.suppress(BagError), Bag(tmp_path / "evil.mcap") as bag:
            sum(1 for _ in bag.messages())

    assert peak_bytes(read) < 100e6


@pytest.mark.fault_case(66)
def test_a_decompression_bomb_is_refused(tmp_path):
    bomb = zstandard.ZstdCompressor().compress(bytes(2**30))
    head = ChunkHead(START, START, 2**30, 0, "zstd", len(bomb), 0)
    (tmp_path / "bomb.mcap").write_bytes(MAGIC + packed(Header("ros2", "x")) + chunk_prefix(head) + bomb)
    with pytest.raises(BagError, match="above the limit"):
        Bag(tmp_path / "bomb.mcap")


@pytest.fixture(scope="module")
def day(tmp_path_factory) -> Path:
    """A recording of a day: imu at 4 Hz, a new file every hour, as the recorder splits."""
    path = tmp_path_factory.mktemp("day") / "bag"
    samples = imu(24 * 3600 * 4, 250_000_000)
    with BagWriter(path, in_place=True, chunk_bytes=100_000) as writer:
        topic = writer.topic("/well_7/imu/data_raw", IMU)
        for k, hour in enumerate(np.split(samples, 24)):
            if k:
                writer.finish_file()
                writer.begin_file()
            writer.write_rows(topic, wire.IMU.encode(hour, "sonde_link"), hour["stamp_ns"])
    return path


@pytest.mark.slow
@pytest.mark.fault_case(67)
def test_the_memory_for_a_day_is_that_for_an_hour(day):
    def read(hours: int) -> None:
        with Bag(day) as bag:
            count = sum(
                len(log_ns)
                for block in bag.blocks(end_ns=START + hours * HOUR, block_messages=4000)
                for log_ns, _ in block.values()
            )
        assert count == hours * 3600 * 4

    # What is loaded once for all bags does not count.
    read(1)
    peaks = [peak_bytes(lambda hours=hours: read(hours)) for hours in (1, 24)]
    assert peaks[1] < 1.3 * peaks[0] < 10e6


@pytest.mark.slow
@pytest.mark.fault_case(67)
def test_a_minute_anywhere_in_a_day_is_found_without_reading_the_day(day, monkeypatch):
    read = []
    whole_read = McapFile.read

    def counted(self, offset, size):
        read.append(size)
        return whole_read(self, offset, size)

    monkeypatch.setattr(McapFile, "read", counted)
    size = sum(file.stat().st_size for file in day.glob("*.mcap"))
    with Bag(day) as bag:
        for hour in (0.5, 12.0, 23.9):
            begin = START + round(hour * HOUR)
            stamps = [log_ns for log_ns, *_ in bag.messages(start_ns=begin, end_ns=begin + HOUR // 60)]
            assert stamps == list(range(begin, begin + HOUR // 60, 250_000_000))
    assert sum(read) < 0.03 * size


@pytest.mark.fault_case(66)
@pytest.mark.parametrize("time", ["'noon'", "1e300", "x'00ff'", "-5"])
def test_a_time_in_sqlite_that_is_none_ends_the_reading_with_a_note(tmp_path, time):
    samples = rosbags_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    with contextlib.closing(sqlite3.connect(next((tmp_path / "bag").glob("*.db3")))) as table, table:
        table.execute(f"UPDATE messages SET timestamp={time} WHERE id=15")  # noqa: S608
    with Bag(tmp_path / "bag") as bag:
        assert sum(len(block["/imu/data_raw"][0]) for block in bag.blocks()) < len(samples)
        assert any("not a time in ns" in note for note in bag.notes), bag.notes

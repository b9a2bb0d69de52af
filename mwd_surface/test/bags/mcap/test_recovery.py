# SPDX-License-Identifier: Apache-2.0
"""Recordings cut, flipped and overwritten: every complete record comes back, and nothing that was never written."""

from __future__ import annotations

import os
import shutil
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Header
from rosbags.rosbag2 import Reader

from mwd_sensors.core import wire
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.mcap.records import MAGIC, ChunkHead
from mwd_surface.bags.mcap.writer import chunk_prefix, message_prefix, packed

START = 1_700_000_000_000_000_000
IMU = "sensor_msgs/msg/Imu"


def record(path: Path, count: int = 800, **options) -> BagWriter:
    """A recording as the recorder leaves it when it is killed: every chunk on disk, no end."""
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = START + np.arange(count) * 1_000_000
    samples["linear_acceleration"] = np.random.default_rng(1).normal(size=(count, 3))
    writer = BagWriter(path, in_place=True, chunk_bytes=12_000, **options)
    channel = writer.topic("/imu/data_raw", IMU, [bag_metadata.qos_profile("best_effort")])
    writer.write_rows(channel, wire.IMU.encode(samples, "sonde_link"), samples["stamp_ns"])
    note = writer.topic("/note", "std_msgs/msg/String")
    writer.write(note, b"\0\1\0\0\2\0\0\0a\0", START)
    writer.attach("scenario.yaml", "application/yaml", b"a: 1", START)
    return writer


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "bag"
    record(path).close()
    return path


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as file:
        return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file, validate_crcs=True).iter_messages()]


@pytest.mark.slow
@pytest.mark.fault_case(61)
def test_a_file_cut_at_any_of_200_places_gives_back_every_complete_record_and_nothing_else(tmp_path):
    record(tmp_path / "bag", 300).close()
    data = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    everything = messages(tmp_path / "bag" / "bag_0.mcap")
    with Bag(tmp_path / "bag") as bag:
        spans = [span for one in bag.mcap for span in one.contents.spans]
    random = np.random.default_rng(7)
    for cut in [0, 7, 8, 9, *random.integers(10, len(data), 195).tolist(), len(data)]:
        source = tmp_path / "cut.mcap"
        source.write_bytes(data[:cut])
        target = tmp_path / "saved.mcap"
        report = recovery.recover_file(source, target)
        complete = [span for span in spans if span.offset + span.length <= cut]
        if not complete:
            assert report.messages == 0
            assert not target.exists()
            continue
        saved = messages(target)
        assert len(saved) == report.messages
        assert set(saved) <= set(everything)
        last = max(span.end_ns for span in complete)
        imu = [row for row in everything if row[0] == "/imu/data_raw" and row[1] <= last]
        assert [row for row in saved if row[0] == "/imu/data_raw"] == imu
        assert recovery.check(target).sound
        target.unlink()
    assert source.read_bytes() == data


@pytest.mark.slow
@pytest.mark.fault_case(61)
@pytest.mark.fault_case(66)
@pytest.mark.parametrize("rest", ["zeros", "noise", "earlier data"])
@pytest.mark.parametrize("compression", ["", "lz4"])
def test_whatever_stands_behind_the_place_where_writing_ended_no_message_is_changed(tmp_path, rest, compression):
    record(tmp_path / "bag", 200, compression=compression).close()
    data = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    everything = messages(tmp_path / "bag" / "bag_0.mcap")
    with Bag(tmp_path / "bag") as bag:
        spans = [span for one in bag.mcap for span in one.contents.spans]
    random = np.random.default_rng(32)
    source, target, most = tmp_path / "cut.mcap", tmp_path / "saved.mcap", 0
    for cut in random.integers(500, len(data), 60).tolist():
        behind = {"zeros": bytes(4096), "noise": random.bytes(4096), "earlier data": data[cut // 3 : cut // 3 + 4096]}
        source.write_bytes(data[:cut] + behind[rest])
        report = recovery.recover_file(source, target)
        assert set(messages(target) if report.messages else ()) <= set(everything)
        if compression:
            last = max((span.end_ns for span in spans if span.offset + span.length <= cut), default=0)
            least = sum(log_ns <= last for topic, log_ns, _ in everything if topic == "/imu/data_raw")
        else:
            # The messages of an incomplete chunk are saved too, except perhaps the last one.
            least = sum(data.count(data_of, 0, cut) > 0 for _, _, data_of in everything) - 1
        assert report.messages >= least
        most = max(most, least)
    assert most > 100


def test_a_byte_like_an_opcode_behind_a_torn_message_does_not_make_it_whole(tmp_path):
    record(tmp_path / "bag", 50, compression="").close()
    data = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    everything = messages(tmp_path / "bag" / "bag_0.mcap")
    _, _, torn = everything[25]
    end, random = data.index(torn) + len(torn), np.random.default_rng(33)
    for opcode in range(1, 16):
        behind = random.bytes(100) + bytes([opcode]) + random.bytes(4096)
        (tmp_path / "cut.mcap").write_bytes(data[: end - 100] + behind)
        recovery.recover_file(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
        assert 20 <= len(messages(tmp_path / "saved.mcap")) < 26, opcode
        assert set(messages(tmp_path / "saved.mcap")) <= set(everything), opcode


@pytest.mark.slow
def test_bit_flips_and_overwritten_blocks_never_raise_and_never_invent_a_message(whole, tmp_path):
    data = (whole / "bag_0.mcap").read_bytes()
    everything = set(messages(whole / "bag_0.mcap"))
    random = np.random.default_rng(11)
    for turn in range(80):
        broken = bytearray(data)
        for _ in range(1 + turn % 3):
            at = int(random.integers(len(data)))
            if turn % 2:
                broken[at] ^= 1 << int(random.integers(8))
            else:
                broken[at : at + 3000] = random.bytes(min(3000, len(data) - at))
        (tmp_path / "x.mcap").write_bytes(broken)
        report = recovery.recover_file(tmp_path / "x.mcap", tmp_path / "y.mcap")
        if report.target:
            saved = messages(report.target)
            assert len(saved) == report.messages
            assert set(saved) <= everything
            # Each place of damage costs the chunk it is in, and the one it runs into.
            assert len(saved) > 800 - 3 * 3 * 35
            report.target.unlink()


def test_a_killed_recording_becomes_a_whole_bag_with_the_original_beside_it(tmp_path):
    writer = record(tmp_path / "bag", custom={"well": "F-4"})
    written = writer.file.messages
    writer.file.close()
    original = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    assert recovery.is_unfinished(tmp_path / "bag")
    (report,) = recovery.recover_bag(tmp_path / "bag")
    assert report.messages == written
    assert report.kept.read_bytes() == original
    assert report.kept.name == "bag_0.mcap.damaged"
    assert not recovery.is_unfinished(tmp_path / "bag")
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == written
        assert sum(1 for _ in reader.messages()) == written
    with Bag(tmp_path / "bag") as bag:
        assert bag.notes == []
        assert [item.data for item in bag.attachments()] == [b"a: 1"]
        assert bag.metadata()["mwd_recovery"]["messages"] == str(written)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        statistics = make_reader(file, validate_crcs=True).get_summary().statistics
        assert (statistics.message_count, statistics.attachment_count) == (written, 1)


def test_a_table_that_cannot_be_read_is_a_damage_and_costs_only_itself(tmp_path):
    writer = record(tmp_path / "bag")
    writer.file.add_metadata("well", {"name": "F-4"})
    writer.close()
    path = tmp_path / "bag" / "bag_0.mcap"
    data = path.read_bytes()
    table = b"\4\0\0\0well" + struct.pack("<I", 15)
    assert data.count(table) == 1
    path.write_bytes(data.replace(table, table[:-4] + struct.pack("<I", 16)))
    assert not recovery.check(path).sound
    before = messages(path)
    (report,) = recovery.recover_bag(tmp_path / "bag")
    assert report.damages == 1
    assert messages(path) == before
    with Bag(tmp_path / "bag") as bag:
        assert "well" not in bag.metadata()
        assert [item.data for item in bag.attachments()] == [b"a: 1"]


def test_only_the_last_file_of_a_split_recording_is_touched_and_none_is_lost(tmp_path):
    writer = record(tmp_path / "bag")
    writer.split()
    writer.write(1, b"\0\1\0\0", START + 10**10)
    writer.file.close_chunk()
    writer.file.close()
    first = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    one, two = recovery.recover_bag(tmp_path / "bag")
    assert one.sound
    assert (two.messages, two.sound) == (1, False)
    assert (tmp_path / "bag" / "bag_0.mcap").read_bytes() == first
    about = bag_metadata.read(tmp_path / "bag")
    assert [file.count for file in about.files] == [801, 1]


def test_recovering_twice_changes_nothing_the_second_time(tmp_path):
    record(tmp_path / "bag").file.close()
    recovery.recover(tmp_path / "bag")
    before = {path.name: path.read_bytes() for path in (tmp_path / "bag").iterdir()}
    (report,) = recovery.recover(tmp_path / "bag")
    assert report.sound
    assert {path.name: path.read_bytes() for path in (tmp_path / "bag").iterdir()} == before


def test_power_lost_between_the_two_names_leaves_a_bag_that_is_recovered_next_time(tmp_path, monkeypatch):
    record(tmp_path / "bag").file.close()
    written = 801

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", stop)
    with pytest.raises(KeyboardInterrupt):
        recovery.recover_bag(tmp_path / "bag")
    monkeypatch.undo()
    (report,) = recovery.recover_bag(tmp_path / "bag")
    assert report.messages == written
    assert not list((tmp_path / "bag").glob("*recover*"))


def test_a_disk_without_hard_links_keeps_the_original_too(tmp_path, monkeypatch):
    record(tmp_path / "bag").file.close()

    def refuse(*_):
        raise OSError("not supported")

    monkeypatch.setattr(os, "link", refuse)
    (report,) = recovery.recover_bag(tmp_path / "bag")
    assert report.kept.exists()
    assert report.target.exists()


def test_a_file_with_nothing_in_it_is_set_aside_and_reported_so(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"")
    (report,) = recovery.recover_bag(tmp_path / "bag")
    assert report.target is None
    assert report.sentence() == "bag_0.mcap: nothing could be saved; the file is empty"
    assert [path.name for path in (tmp_path / "bag").iterdir()] == ["bag_0.mcap.damaged"]
    assert not recovery.is_unfinished(tmp_path / "bag")


def test_a_single_file_is_recovered_beside_the_original_which_stays(whole, tmp_path):
    data = (whole / "bag_0.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[: len(data) // 2])
    (report,) = recovery.recover(tmp_path / "a.mcap")
    assert report.target == tmp_path / "a.recovered.mcap"
    assert report.kept is None
    assert "saved" in report.sentence()
    assert (tmp_path / "a.mcap").read_bytes() == data[: len(data) // 2]
    with pytest.raises(ValueError, match="exists already"):
        recovery.recover(tmp_path / "a.mcap")
    with pytest.raises(ValueError, match="in place"):
        recovery.recover(whole, tmp_path / "x")


def test_a_stopped_recovery_leaves_no_trace(whole, tmp_path):
    source = tmp_path / "a.mcap"
    shutil.copy(whole / "bag_0.mcap", source)
    with pytest.raises(InterruptedError):
        recovery.recover_file(source, tmp_path / "b.mcap", lambda: False)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_check_sees_a_flipped_bit_in_a_chunk_and_one_in_an_index(whole, tmp_path):
    data = bytearray((whole / "bag_0.mcap").read_bytes())
    assert recovery.check(whole / "bag_0.mcap").sound
    with Bag(whole) as bag:
        span = bag.mcap[0].contents.spans[4]
    for at, damages in ((span.offset + 300, 1), (span.offset + span.length + 40, 0)):
        broken = bytearray(data)
        broken[at] ^= 4
        (tmp_path / "x.mcap").write_bytes(broken)
        report = recovery.check(tmp_path / "x.mcap")
        assert not report.sound
        assert report.damages == damages
        assert any("checksum" in note or "decompress" in note for note in report.notes)


def test_messages_whose_topic_was_lost_are_saved_under_its_number(tmp_path):
    path = tmp_path / "x.mcap"
    body = packed(Channel(1, "/a", "cdr", {}, schema_id=0))
    for number in (1, 2):
        body += message_prefix(number, 1, START, START, 3) + b"abc"
    path.write_bytes(MAGIC + packed(Header("ros2", "x")) + body)
    report = recovery.recover_file(path, tmp_path / "y.mcap")
    assert report.messages == 2
    assert messages(tmp_path / "y.mcap") == [("/a", START, b"abc"), ("/lost_topic_2", START, b"abc")]


@pytest.mark.parametrize("size", [2**60, 2**31, 200_000_000])
def test_hostile_lengths_are_passed_over_in_bounded_memory(whole, tmp_path, size):
    data = (whole / "bag_0.mcap").read_bytes()
    bad = chunk_prefix(ChunkHead(START, START, size, 0, "zstd", 16, 0)) + bytes(16)
    worse = bytes([Opcode.CHUNK]) + size.to_bytes(8, "little") + bytes(30)
    at = data.index(b"\x06", 9000)
    (tmp_path / "x.mcap").write_bytes(data[:at] + bad + worse + data[at:])
    tracemalloc.start()
    report = recovery.recover_file(tmp_path / "x.mcap", tmp_path / "y.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6
    assert report.messages > 600


@pytest.mark.fault_case(59)
def test_a_recording_that_goes_on_is_left_alone(tmp_path):
    writer = record(tmp_path / "bag")
    before = sorted(tmp_path.rglob("*"))
    for path in (tmp_path / "bag", tmp_path / "bag" / "bag_0.mcap"):
        with pytest.raises(ValueError, match="is being recorded"):
            recovery.recover(path)
    assert sorted(tmp_path.rglob("*")) == before
    # As after a kill: the file has no end, and nobody holds it.
    writer.file.close()
    (report,) = recovery.recover(tmp_path / "bag")
    assert report.messages == 801

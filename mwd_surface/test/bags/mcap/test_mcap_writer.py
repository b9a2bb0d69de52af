# SPDX-License-Identifier: Apache-2.0
"""One file as it grows: what is on disk at every moment, and what a refusing disk does to it."""

from __future__ import annotations

import contextlib
import errno
import os
from unittest import mock

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Schema

from mwd_surface.bags.mcap.contents import Chunk, parse_chunk_head
from mwd_surface.bags.mcap.reader import McapFile, declarations
from mwd_surface.bags.mcap.records import Decompressor
from mwd_surface.bags.mcap.writer import McapWriter

START = 1_700_000_000_000_000_000


def opened(path, **options) -> McapWriter:
    writer = McapWriter(path, **options)
    writer.add_schema(Schema(1, b"string data", "ros2msg", "std_msgs/msg/String"))
    writer.add_channel(Channel(1, "/a", "cdr", {"offered_qos_profiles": ""}, schema_id=1))
    return writer


def read(path):
    """Return the summary, messages in order of time, and attachments that the library mcap reads."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = [message for _, _, message in reader.iter_messages()]
        return reader.get_summary(), messages, list(reader.iter_attachments())


def counts(path) -> int:
    with contextlib.closing(McapFile(path)) as file:
        return sum(file.contents().counts.values())


def test_every_closed_chunk_can_be_read_while_the_file_still_grows(tmp_path):
    writer = opened(tmp_path / "a.mcap")
    for k in range(5):
        writer.write(1, b"hello", START + k, START + k)
        writer.close_chunk()
        writer.sync()
        assert counts(tmp_path / "a.mcap") == k + 1
    writer.finish(sync=True)
    assert counts(tmp_path / "a.mcap") == 5


def test_chunks_close_at_their_size_for_single_messages_and_for_rows(tmp_path):
    writer = opened(tmp_path / "a.mcap", chunk_bytes=1000)
    for k in range(100):
        writer.write(1, bytes(69), START + k, START + k)
    writer.write_rows(1, np.zeros((100, 69), np.uint8), START + np.arange(100), START + np.arange(100))
    writer.finish()
    summary, _, _ = read(tmp_path / "a.mcap")
    sizes = [index.uncompressed_size for index in summary.chunk_indexes]
    assert summary.statistics.message_count == 200
    assert max(sizes) <= 1200
    assert 18 <= len(sizes) <= 22


def test_sequence_numbers_count_the_messages_of_a_channel(tmp_path):
    writer = opened(tmp_path / "a.mcap")
    writer.write(1, b"x", START, START)
    writer.write_rows(1, np.zeros((3, 4), np.uint8), START + np.arange(3), START + np.arange(3))
    writer.write(1, b"x", START + 9, START + 9)
    writer.finish()
    assert [message.sequence for message in read(tmp_path / "a.mcap")[1]] == [1, 2, 3, 4, 5]


def test_every_message_index_points_at_its_message(tmp_path):
    writer = opened(tmp_path / "a.mcap", chunk_bytes=700)
    for k in range(30):
        writer.write(1, bytes([k]), START + k, START + k)
        writer.write_rows(1, np.full((2, 3), k, np.uint8), START + np.array([k, k]), START + np.array([k, k]))
    writer.finish()
    data = (tmp_path / "a.mcap").read_bytes()
    seen = 0
    for chunk in read(tmp_path / "a.mcap")[0].chunk_indexes:
        body = data[chunk.chunk_start_offset + 9 : chunk.chunk_start_offset + chunk.chunk_length]
        head = parse_chunk_head(body, len(body))
        plain = Decompressor()(head, body[head.data_at :])
        at = chunk.message_index_offsets[1]
        assert data[at] == Opcode.MESSAGE_INDEX
        entries = np.frombuffer(data[at + 15 : at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")], "<u8")
        for log_ns, offset in entries.reshape(-1, 2).tolist():
            assert plain[offset] == Opcode.MESSAGE
            assert int.from_bytes(plain[offset + 15 : offset + 23], "little") == log_ns
            seen += 1
    assert seen == 90


def test_declarations_come_again_in_every_sixteenth_chunk(tmp_path):
    writer = opened(tmp_path / "a.mcap", chunk_bytes=1)
    for k in range(40):
        writer.write(1, b"x", START + k, START + k)
    writer.finish()
    with contextlib.closing(McapFile(tmp_path / "a.mcap")) as file:
        chunks = [piece for piece in file.scan() if isinstance(piece, Chunk)]
    assert [k for k, piece in enumerate(chunks) if declarations(piece)[1]] == [0, 16, 32]


def test_stamps_of_attachments_and_order_of_time_are_kept(tmp_path):
    writer = opened(tmp_path / "a.mcap")
    writer.write(1, b"late", START + 50, START + 40)
    writer.write(1, b"early", START + 10, START + 5)
    writer.attach(Attachment(START - 1, START, "r.pdf", "application/pdf", b"%PDF"))
    writer.finish()
    summary, messages, (item,) = read(tmp_path / "a.mcap")
    assert summary.statistics.message_start_time == START + 10
    assert summary.statistics.message_end_time == START + 50
    assert [message.data for message in messages] == [b"early", b"late"]
    assert (item.log_time, item.create_time, item.data) == (START, START - 1, b"%PDF")


def test_a_disk_that_takes_half_a_record_leaves_a_file_that_ends_after_the_last_whole_one(tmp_path):
    writer = opened(tmp_path / "a.mcap")
    writer.write(1, b"first", START, START)
    writer.close_chunk()
    good = (tmp_path / "a.mcap").stat().st_size
    write, calls = os.write, []

    def full(file, data):
        calls.append(file)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:10])

    writer.write(1, b"second", START + 1, START + 1)
    with mock.patch.object(os, "write", full), pytest.raises(OSError, match="No space"):
        writer.close_chunk()
    assert (tmp_path / "a.mcap").stat().st_size == good
    # The message is still held, and goes out once the disk takes it.
    writer.finish()
    assert counts(tmp_path / "a.mcap") == 2


@pytest.mark.fault_case(62)
def test_a_file_whose_first_bytes_find_no_room_is_not_in_the_way_of_the_next_attempt(tmp_path):
    full = OSError(errno.ENOSPC, "no room")
    with mock.patch.object(os, "write", side_effect=full), pytest.raises(OSError, match="no room"):
        McapWriter(tmp_path / "a.mcap")
    McapWriter(tmp_path / "a.mcap").close()


def test_messages_given_up_are_counted_and_the_rest_is_a_sound_file(tmp_path):
    writer = opened(tmp_path / "a.mcap")
    writer.write(1, b"first", START, START)
    writer.close_chunk()
    for k in range(3):
        writer.write(1, b"more", START + 10 + k, START)
    assert writer.discard_pending() == 3
    writer.finish()
    statistics = read(tmp_path / "a.mcap")[0].statistics
    assert (statistics.message_count, statistics.message_end_time) == (1, START)


def test_an_existing_file_is_never_overwritten(tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        McapWriter(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"

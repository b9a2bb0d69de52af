# SPDX-License-Identifier: Apache-2.0
"""What a file holds, by its summary and by reading it through: both ways must agree, and damage must be named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Schema

from mwd_surface.bags.mcap.contents import Bare, Chunk, Damage, Other
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import FOOTER_BYTES, MAGIC, FormatError
from mwd_surface.bags.mcap.writer import McapWriter, message_prefix, packed

START = 1_700_000_000_000_000_000


def write(path: Path, messages: int = 400) -> bytes:
    writer = McapWriter(path, chunk_bytes=3000)
    writer.add_schema(Schema(1, b"string data", "ros2msg", "std_msgs/msg/String"))
    for number, name in ((1, "/a"), (2, "/b")):
        writer.add_channel(Channel(number, name, "cdr", {}, schema_id=1))
    for k in range(messages):
        writer.write(1 + k % 2, np.random.default_rng(k).bytes(40), START + k, START + k)
        if k == messages // 2:
            writer.attach(Attachment(START, START, "r.txt", "text/plain", b"text"))
            writer.add_metadata("t", {"a": "b"})
    writer.finish()
    return path.read_bytes()


def contents(path: Path, data: bytes):
    path.write_bytes(data)
    file = McapFile(path)
    try:
        return file.contents()
    finally:
        file.close()


@pytest.mark.slow
def test_the_summary_and_a_scan_of_the_same_file_agree(tmp_path):
    data = write(tmp_path / "a.mcap")
    by_summary = contents(tmp_path / "a.mcap", data)
    by_scan = contents(tmp_path / "b.mcap", data[: -FOOTER_BYTES - 8])
    assert by_summary.notes == []
    assert by_summary.complete
    assert by_scan.notes[0].startswith("b.mcap: the file has no end")
    for name in ("schemas", "channels", "counts", "spans", "attachments", "metadata", "checksums"):
        assert getattr(by_summary, name) == getattr(by_scan, name)


def test_a_cut_in_the_middle_keeps_everything_before_it_and_names_the_place(tmp_path):
    data = write(tmp_path / "a.mcap")
    found = contents(tmp_path / "b.mcap", data[: len(data) // 2])
    whole = contents(tmp_path / "a.mcap", data)
    assert not found.complete
    assert found.spans == whole.spans[: len(found.spans)]
    assert len(found.spans) > 2
    assert f"of {len(data) // 2} skipped: the file ends inside a record" in found.notes[-1]


@pytest.mark.parametrize("what", ["data", "length", "head", "opcode", "zeros"])
def test_damage_in_one_chunk_costs_only_that_chunk(tmp_path, what):
    data = bytearray(write(tmp_path / "a.mcap"))
    whole = contents(tmp_path / "a.mcap", bytes(data))
    hit = whole.spans[3]
    at, values = {
        "data": (hit.offset + 200, b"\xff\xff\xff"),
        "length": (hit.offset + 1, (hit.length + 70000).to_bytes(8, "little")),
        "head": (hit.offset + 9 + 16, b"\xff" * 8),
        "opcode": (hit.offset, b"\x77"),
        "zeros": (hit.offset, bytes(hit.length)),
    }[what]
    data[at : at + len(values)] = values
    found = contents(tmp_path / "b.mcap", bytes(data[: -FOOTER_BYTES - 8]))
    assert found.spans == whole.spans[:3] + whole.spans[4:]
    assert not found.complete
    assert sum("skipped" in note for note in found.notes) == 1


def test_a_topic_declared_in_the_clear_and_damaged_there_is_taken_from_its_guarded_copy(tmp_path):
    data = bytearray(write(tmp_path / "a.mcap"))
    at = data.index(b"/a")
    data[at + 1] = ord("x")
    found = contents(tmp_path / "b.mcap", bytes(data[: -FOOTER_BYTES - 8]))
    assert found.channels[1].topic == "/a"


def test_messages_outside_of_chunks_are_found_in_runs(tmp_path):
    record = b"".join(message_prefix(1, k, START + k, START, 8) + bytes(8) for k in range(20000))
    channel = packed(Channel(1, "/a", "cdr", {}, schema_id=0))
    data = MAGIC + packed(Header("ros2", "x")) + channel + record
    found = contents(tmp_path / "a.mcap", data)
    assert found.counts == {1: 20000}
    assert not found.checksums
    assert not any(span.in_chunk for span in found.spans)
    assert (found.spans[0].start_ns, found.spans[-1].end_ns) == (START, START + 19999)


def test_a_scan_meets_every_byte_of_the_data_section_exactly_once(tmp_path):
    random = np.random.default_rng(1)
    data = write(tmp_path / "a.mcap", 100)
    for _ in range(60):
        broken = bytearray(data)
        for at in random.integers(8, len(data), 3).tolist():
            broken[at] = int(random.integers(256))
        (tmp_path / "b.mcap").write_bytes(broken)
        file = McapFile(tmp_path / "b.mcap")
        at = 8
        for piece in file.scan():
            assert isinstance(piece, (Chunk, Bare, Other, Damage))
            assert piece.offset == at
            at = piece.end if isinstance(piece, Damage) else piece.offset + piece.length
            assert at > piece.offset
        assert at <= len(data)
        file.close()


def test_a_record_beyond_the_end_or_above_the_limit_is_not_read(tmp_path):
    write(tmp_path / "a.mcap")
    file = McapFile(tmp_path / "a.mcap")
    with pytest.raises(FormatError, match="beyond the end"):
        file.read(file.size - 3, 4)
    with pytest.raises(FormatError, match="above the limit"):
        file.read(0, 2**40)
    with pytest.raises(FormatError, match="expected a record"):
        file.body(8, Opcode.CHUNK)
    file.close()

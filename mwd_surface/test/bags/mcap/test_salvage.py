# SPDX-License-Identifier: Apache-2.0
"""Any flipped bit and any cut of a recording: `recover` ends in words and saves every message that is intact."""

from __future__ import annotations

import io
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from mwd_surface.bags.mcap.contents import parse_chunk_head
from mwd_surface.bags.mcap.records import Decompressor
from mwd_surface.bags.mcap.recovery import check, recover
from mwd_surface.bags.mcap.walk import walk_records

START = 1_700_000_000_000_000_000
KINDS = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "plain": {"compression": CompressionType.NONE},
    "no checksums": {"compression": CompressionType.NONE, "enable_crcs": False, "enable_data_crcs": False},
    "no chunks": {"use_chunking": False},
    "no summary": {
        "use_chunking": False,
        "use_statistics": False,
        "use_summary_offsets": False,
        "repeat_schemas": False,
        "repeat_channels": False,
    },
}


def recorded(**options) -> tuple[bytes, list[tuple[int, bytes]]]:
    """A file, and the times and bytes of its messages."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=120, **options)
    writer.start(profile="ros2")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channel = writer.register_channel("/note", "cdr", schema)
    messages = []
    for k in range(12):
        data = bytes([k]) * 12
        messages.append((START + k * 10**9, data))
        writer.add_message(channel, messages[-1][0], data, messages[-1][0], k)
    writer.finish()
    return file.getvalue(), messages


def cut_before_summary(data: bytes) -> bytes:
    """The file as a recorder leaves it that is killed."""
    return data[: next(begin for opcode, begin, _ in records(data) if opcode == Opcode.DATA_END)]


def records(data: bytes) -> list[tuple[int, int, int]]:
    """Opcode, begin and end of each record of a file."""
    found, at = [], 8
    while at + 9 <= len(data):
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        found.append((data[at], at, end))
        at = end
    return found


FILES = {kind: recorded(**options) for kind, options in KINDS.items()}
FILES |= {f"{kind}, killed": (cut_before_summary(data), sent) for kind, (data, sent) in list(FILES.items())}


def holders(kind: str) -> list[tuple[int, int, Counter]]:
    """Begin and end of each record that holds messages, and those messages."""
    data, sent = FILES[kind]
    found, left = [], list(sent)
    for opcode, begin, end in records(data):
        count = int(opcode == Opcode.MESSAGE)
        if opcode == Opcode.CHUNK:
            head = parse_chunk_head(data[begin + 9 : end], end - begin - 9)
            plain = Decompressor()(head, data[begin + 9 + head.data_at : end])
            count = len(walk_records(np.frombuffer(plain, dtype=np.uint8)).offset)
        if count:
            found.append((begin, end, Counter(left[:count])))
            del left[:count]
    assert not left
    return found


HOLDERS = {kind: holders(kind) for kind in FILES}


def saved(data: bytes, folder: Path) -> Counter:
    """Messages that `recover` saves; it must not raise anything."""
    source, target = folder / "bag.mcap", folder / "saved.mcap"
    target.unlink(missing_ok=True)
    source.write_bytes(data)
    (report,) = recover(source, target)
    assert report.sentence()
    if report.target is None:
        return Counter()
    assert check(target).sound
    with target.open("rb") as file:
        return Counter((m.log_time, m.data) for _, _, m in make_reader(file, validate_crcs=True).iter_messages())


def missing(kind: str, begin: int, end: int, data: bytes, folder: Path) -> Counter:
    """Messages that are in no damaged record and were not saved; bytes `begin` to `end` are damaged."""
    intact = Counter()
    for first, after, messages in HOLDERS[kind]:
        if after <= begin or first >= end:
            intact += messages
    return intact - saved(data, folder)


@pytest.mark.fault_case(61)
@pytest.mark.fault_case(66)
@pytest.mark.parametrize("kind", FILES)
def test_one_flipped_bit_costs_the_record_it_is_in_and_nothing_else(kind, tmp_path):
    data, _ = FILES[kind]

    # In the file of lz4, bit 3320 belongs to the end mark of a frame.
    # In the file without a summary, bit 4556 is in a head and bits 4223 and 4565 are in lengths of neighbours.
    @example(bit=4565)
    @example(bit=4556)
    @example(bit=4223)
    @example(bit=3320)
    @given(st.integers(0, 8 * len(data) - 1))
    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    def flip(bit):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not missing(kind, bit // 8, bit // 8 + 1, bytes(damaged), tmp_path)

    flip()


@pytest.mark.fault_case(61)
@pytest.mark.parametrize("kind", FILES)
def test_a_cut_costs_the_record_it_is_in_and_those_after_it(kind, tmp_path):
    data, _ = FILES[kind]

    @given(st.integers(0, len(data)))
    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    def cut(size):
        assert not missing(kind, size, len(data), data[:size], tmp_path)

    cut()


@pytest.mark.parametrize("kind", FILES)
def test_the_top_bit_of_every_time_may_flip(kind, tmp_path):
    data, _ = FILES[kind]
    for begin, end, _ in HOLDERS[kind]:
        # Of a message the log time, of a chunk the first.
        at = begin + (9 + 6 + 7 if data[begin] == Opcode.MESSAGE else 9 + 7)
        damaged = data[:at] + bytes([data[at] ^ 0x80]) + data[at + 1 :]
        assert not missing(kind, begin, end, damaged, tmp_path)

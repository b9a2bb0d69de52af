# SPDX-License-Identifier: Apache-2.0
"""The parsers and the walk: every damage is refused, and every record is found."""

from __future__ import annotations

import dataclasses
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Attachment, Channel, ChunkIndex, Metadata, Schema, Statistics

from mwd_surface.bags.mcap.contents import MessageSpan, parse, parse_attachment, parse_chunk_head, parse_span
from mwd_surface.bags.mcap.records import RECORD_HEAD, ChunkHead, Compressor, Decompressor, FormatError
from mwd_surface.bags.mcap.walk import records_in, walk_records
from mwd_surface.bags.mcap.writer import chunk_prefix, message_prefix, packed

words = st.text(max_size=12)
stamps = st.integers(0, 2**63 - 1)


@given(words, st.binary(max_size=50))
def test_a_flipped_bit_in_an_attachment_is_seen(name, data):
    item = Attachment(1, 2, name, "text/plain", data)
    body = packed(item)[9:]
    assert parse_attachment(body) == item
    if data:
        broken = bytearray(body)
        broken[-5] ^= 1
        with pytest.raises(FormatError, match="checksum"):
            parse_attachment(bytes(broken))


@given(stamps, stamps, words, st.dictionaries(st.integers(1, 9), st.integers(0, 10**9), max_size=3))
def test_a_chunk_index_gives_the_span_of_its_chunk(start, end, compression, offsets):
    index = ChunkIndex(
        chunk_length=22,
        chunk_start_offset=11,
        compression=compression,
        compressed_size=44,
        message_end_time=end,
        message_index_length=33,
        message_index_offsets=offsets,
        message_start_time=start,
        uncompressed_size=55,
    )
    assert parse_span(packed(index)[9:]) == MessageSpan(start, end, 11, 22, 55, frozenset(offsets), True)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_what_is_compressed_comes_back_and_every_damage_is_refused(compression):
    plain = np.random.default_rng(1).integers(0, 4, 5000, dtype=np.uint8).tobytes()
    data = Compressor(compression)(plain)
    crc = zlib.crc32(plain)
    head = ChunkHead(1, 2, len(plain), crc, compression, len(data), 0)
    record = chunk_prefix(head) + data
    parsed = parse_chunk_head(record[9:], len(record) - 9)
    assert record[9 + parsed.data_at :] == data
    assert Decompressor()(parsed, data) == plain
    for wrong in (
        ChunkHead(1, 2, len(plain) + 1, crc, compression, len(data), 0),
        ChunkHead(1, 2, len(plain), crc ^ 1, compression, len(data), 0),
    ):
        with pytest.raises(FormatError):
            Decompressor()(wrong, data)
    if compression:
        with pytest.raises(FormatError):
            Decompressor()(parsed, data[: len(data) // 2])


def test_an_unknown_compression_is_refused_both_ways():
    with pytest.raises(ValueError, match="'rar'"):
        Compressor("rar")
    record = chunk_prefix(ChunkHead(1, 2, 3, 4, "rar", 5, 0)) + b"12345"
    with pytest.raises(FormatError, match="'rar'"):
        parse_chunk_head(record[9:], len(record) - 9)


def test_a_chunk_above_the_limit_is_refused_before_anything_is_allocated():
    record = chunk_prefix(ChunkHead(1, 2, 2**60, 0, "zstd", 5, 0)) + b"12345"
    with pytest.raises(FormatError, match="above the limit"):
        parse_chunk_head(record[9:], len(record) - 9)


@given(st.binary(max_size=60))
def test_no_bytes_whatever_make_a_parser_do_more_than_refuse(data):
    kinds = (Schema, Channel, Metadata, Statistics)
    parsers = [lambda part, kind=kind: parse(kind, part) for kind in kinds]
    for parser in (*parsers, parse_attachment, parse_span, lambda part: parse_chunk_head(part, len(part))):
        try:
            parser(data)
        except FormatError:
            continue


def pairs(keys, values):
    return st.lists(st.tuples(keys, values), max_size=3, unique_by=lambda entry: entry[0])


maps = st.one_of(
    pairs(words, words).map(lambda entries: Channel(1, "/t", "cdr", dict(entries), 2)),
    pairs(words, words).map(lambda entries: Metadata("m", dict(entries))),
    pairs(st.integers(0, 65535), stamps).map(lambda entries: Statistics(0, 0, dict(entries), 0, 0, 0, 0, 0, 0)),
)


@given(maps, st.integers(0, 60), st.binary(max_size=3))
def test_a_map_has_exactly_the_length_that_stands_before_it(record, wrong, later_fields):
    """A map that ends early at the end of one of its entries looks like a record with fields of a later version."""
    kind, body = type(record), packed(record)[9:]
    field = "channel_message_counts" if kind is Statistics else "metadata"
    entries = list(getattr(record, field).items())
    shorter = [dataclasses.replace(record, **{field: dict(entries[:k])}) for k in range(len(entries) + 1)]
    ends = [len(packed(one)) - 9 for one in shorter]
    at = ends[0] - 4
    changed = body[:at] + wrong.to_bytes(4, "little") + body[at + 4 :] + later_fields
    if at + 4 + wrong in ends:
        assert parse(kind, changed) == shorter[ends.index(at + 4 + wrong)]
    else:
        with pytest.raises(FormatError):
            parse(kind, changed)
    if entries:
        twice = body[:at] + (2 * (ends[1] - at - 4)).to_bytes(4, "little") + 2 * body[at + 4 : ends[1]]
        with pytest.raises(FormatError):
            parse(kind, twice)


messages = st.tuples(st.integers(0, 65535), stamps, stamps, st.binary(max_size=20))


@settings(max_examples=50)
@given(st.lists(st.one_of(messages, st.binary(max_size=9)), max_size=12), st.integers(0, 40))
def test_the_walk_finds_the_records_in_whole_and_cut_data(items, cut):
    data, expected = b"", []
    for item in items:
        if isinstance(item, bytes):
            data += RECORD_HEAD.pack(0x0C, len(item)) + item
        else:
            channel, log_ns, publish_ns, payload = item
            data += message_prefix(channel, 1, log_ns, publish_ns, len(payload)) + payload
            expected.append((channel, log_ns, publish_ns, payload))
    for part in (data, data[: max(0, len(data) - cut)]):
        array = np.frombuffer(part, dtype=np.uint8)
        one = walk_records(array)
        found = [
            (int(c), int(t), int(p), part[a : a + n])
            for c, t, p, a, n in zip(one.channel, one.log_ns, one.publish_ns, one.offset, one.size, strict=True)
        ]
        assert found == expected[: len(found)]
        if part == data:
            assert found == expected
            assert len(one.others) == len(items) - len(expected)
            assert len(list(records_in(data))) == len(items)


@given(st.binary(max_size=200))
def test_no_bytes_whatever_lead_the_walk_out_of_its_data(data):
    array = np.frombuffer(data, dtype=np.uint8)
    one = walk_records(array)
    assert one.end <= len(data)
    assert (one.offset + one.size <= len(data)).all()


def test_a_length_beyond_all_bounds_ends_the_walk():
    data = message_prefix(1, 1, 5, 5, 0) + bytes([5]) + (2**64 - 9).to_bytes(8, "little") + bytes(40)
    found = walk_records(np.frombuffer(data, dtype=np.uint8))
    assert (len(found.offset), found.end) == (1, 31)
    with pytest.raises(FormatError):
        list(records_in(data))

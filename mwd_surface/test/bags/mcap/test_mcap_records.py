# SPDX-License-Identifier: Apache-2.0
"""The container's bytes against the `mcap` library, and the walk's two ways against each other."""

from __future__ import annotations

import io
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import ReadDataStream

from mwd_surface.bags.mcap.compression import Compressor, Decompressor
from mwd_surface.bags.mcap.decode import (
    parse_attachment,
    parse_channel,
    parse_chunk_head,
    parse_chunk_index,
    parse_metadata,
    parse_schema,
    parse_statistics,
)
from mwd_surface.bags.mcap.records import (
    Attachment,
    ChunkHead,
    ChunkIndex,
    FormatError,
    McapChannel,
    Schema,
    Statistics,
)
from mwd_surface.bags.mcap.walk import walk_plain, walk_records
from mwd_surface.bags.mcap.writer import (
    attachment_record,
    channel_record,
    chunk_index_record,
    chunk_prefix,
    message_prefix,
    metadata_record,
    packed_record,
    schema_record,
    statistics_record,
)

words = st.text(max_size=12)
tables = st.dictionaries(words, words, max_size=4)
stamps = st.integers(0, 2**63 - 1)


def body(record: bytes) -> ReadDataStream:
    assert int.from_bytes(record[1:9], "little") == len(record) - 9
    return ReadDataStream(io.BytesIO(record[9:]))


@pytest.mark.slow
@given(words, words, st.binary(max_size=30))
def test_a_schema_is_the_librarys_schema(name, encoding, data):
    record = schema_record(Schema(7, name, encoding, data))
    assert records.Schema.read(body(record)) == records.Schema(id=7, name=name, encoding=encoding, data=data)
    assert parse_schema(record[9:]) == Schema(7, name, encoding, data)


@given(words, tables)
def test_a_channel_is_the_librarys_channel(topic, metadata):
    channel = McapChannel(3, 7, topic, "cdr", metadata)
    record = channel_record(channel)
    found = records.Channel.read(body(record))
    assert (found.id, found.schema_id, found.topic, found.metadata) == (3, 7, topic, metadata)
    assert parse_channel(record[9:]) == channel


@given(stamps, words, st.binary(max_size=50))
def test_an_attachment_is_the_librarys_attachment_and_a_flipped_bit_in_it_is_seen(stamp, name, data):
    item = Attachment(stamp, stamp, name, "text/plain", data)
    record = attachment_record(item)
    found = records.Attachment.read(body(record))
    assert (found.log_time, found.name, found.data) == (stamp, name, data)
    assert parse_attachment(record[9:]) == item
    if data:
        broken = bytearray(record[9:])
        broken[-5] ^= 1
        with pytest.raises(FormatError, match="checksum"):
            parse_attachment(bytes(broken))


@given(stamps, stamps, st.dictionaries(st.integers(1, 9), st.integers(0, 10**9), max_size=3))
def test_a_chunk_index_and_statistics_are_the_librarys(start, end, offsets):
    index = ChunkIndex(start, end, 11, 22, offsets, 33, "zstd", 44, 55)
    record = chunk_index_record(index)
    found = records.ChunkIndex.read(body(record))
    assert (found.message_start_time, found.message_index_offsets, found.uncompressed_size) == (start, offsets, 55)
    assert parse_chunk_index(record[9:]) == index
    totals = Statistics(1, 2, 3, 4, 5, 6, start, end, offsets)
    record = statistics_record(totals)
    assert records.Statistics.read(body(record)).channel_message_counts == offsets
    assert parse_statistics(record[9:]) == totals


@given(words, tables)
def test_a_table_is_the_librarys_table(name, values):
    record = metadata_record(name, values)
    assert records.Metadata.read(body(record)) == records.Metadata(name=name, metadata=values)
    assert parse_metadata(record[9:]) == (name, values)


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
    parsers = (parse_schema, parse_channel, parse_attachment, parse_metadata, parse_chunk_index)
    for parser in (*parsers, parse_statistics, lambda part: parse_chunk_head(part, len(part))):
        try:
            parser(data)
        except FormatError:
            continue


messages = st.tuples(st.integers(0, 65535), stamps, stamps, st.binary(max_size=20))


@settings(max_examples=50)
@given(st.lists(st.one_of(messages, st.binary(max_size=9)), max_size=12), st.integers(0, 40))
def test_the_compiled_walk_and_the_plain_one_find_the_same_records_in_whole_and_cut_data(items, cut):
    data, expected = b"", []
    for item in items:
        if isinstance(item, bytes):
            data += packed_record(0x0C, item)
        else:
            channel, log_ns, publish_ns, payload = item
            data += message_prefix(channel, 1, log_ns, publish_ns, len(payload)) + payload
            expected.append((channel, log_ns, publish_ns, payload))
    for part in (data, data[: max(0, len(data) - cut)]):
        array = np.frombuffer(part, dtype=np.uint8)
        one, two = walk_records(array), walk_plain(array)
        for name in ("offset", "size", "channel", "log_ns", "publish_ns", "others"):
            assert np.array_equal(getattr(one, name), getattr(two, name))
            assert getattr(one, name).dtype == getattr(two, name).dtype
        assert one.end == two.end
        found = [
            (int(c), int(t), int(p), part[a : a + n])
            for c, t, p, a, n in zip(one.channel, one.log_ns, one.publish_ns, one.offset, one.size, strict=True)
        ]
        assert found == expected[: len(found)]
        if part == data:
            assert found == expected
            assert len(one.others) == len(items) - len(expected)


@given(st.binary(max_size=200))
def test_no_bytes_whatever_lead_the_walk_out_of_its_data(data):
    array = np.frombuffer(data, dtype=np.uint8)
    one, two = walk_records(array), walk_plain(array)
    assert one.end == two.end <= len(data)
    assert (one.offset + one.size <= len(data)).all()


def test_a_length_beyond_all_bounds_ends_the_walk():
    data = message_prefix(1, 1, 5, 5, 0) + bytes([5]) + (2**64 - 9).to_bytes(8, "little") + bytes(40)
    for walk in (walk_records, walk_plain):
        found = walk(np.frombuffer(data, dtype=np.uint8))
        assert (len(found.offset), found.end) == (1, 31)

# SPDX-License-Identifier: Apache-2.0
"""Small inputs that ask for much: each kind of file that `mwd` opens, made so that its reader would not end."""

from __future__ import annotations

import itertools
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import zstandard

from mwd_surface.bags.mcap.encode import channel_record, chunk_prefix, header_record, packed_record
from mwd_surface.bags.mcap.records import MAGIC, Channel, ChunkHead

MANY = 64 * 2**20


def merge_keys(path: Path) -> None:
    """YAML of 400 bytes whose merged tables double on each line."""
    lines = ["a: &a {x: 1}"]
    lines += [f"{new}: &{new} {{<<: [*{old}, *{old}]}}" for old, new in itertools.pairwise("abcdefghijklmnopqrst")]
    path.write_text("\n".join(lines))


def aliases(path: Path) -> None:
    """YAML whose aliases unfold ninefold on each line."""
    names = "abcdefghij"
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{new}: &{new} [{', '.join(['*' + old] * 9)}]" for old, new in itertools.pairwise(names)]
    path.write_text("\n".join(lines))


def long_number(path: Path) -> None:
    """YAML with a number of base 60 that takes minutes to convert."""
    path.write_text("seed: " + ":".join(["59"] * 500_000))


def deep(path: Path) -> None:
    """YAML or JSON nested 100 000 levels deep."""
    path.write_text("[" * 100_000)


def _chunks(path: Path, count: int) -> None:
    """MCAP of chunks that unpack to 64 MiB each."""
    plain = packed_record(0x80, bytes(MANY - 9))
    packed = zstandard.ZstdCompressor(level=1).compress(plain)
    chunk = chunk_prefix(ChunkHead(1, 2, len(plain), 0, "zstd", len(packed), 0)) + packed
    channel = channel_record(Channel(1, 0, "/a", "cdr", {}))
    path.write_bytes(MAGIC + header_record("x") + channel + chunk * count)


def mcap_of_zeros(path: Path) -> None:
    """MCAP of some 100 kB that unpacks to gigabytes."""
    _chunks(path, 64)


def mcap_of_records(path: Path) -> None:
    """MCAP whose one chunk holds seven million records of no bytes."""
    plain = packed_record(0x80, b"") * (MANY // 9)
    packed = zstandard.ZstdCompressor(level=1).compress(plain)
    chunk = chunk_prefix(ChunkHead(1, 2, len(plain), 0, "zstd", len(packed), 0)) + packed
    path.write_bytes(MAGIC + header_record("x") + chunk)


def packed_file(path: Path) -> None:
    """A recording that is packed as a whole, and holds 8 GB of zeros."""
    packer = zstandard.ZstdCompressor(level=1)
    with path.open("wb") as file:
        for _ in range(8):
            file.write(packer.compress(bytes(10**9 // 8)) * 8)


def endless_view(path: Path) -> None:
    """SQLite recording whose messages are computed by a view without end."""
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE schema(schema_version INTEGER, ros_distro TEXT); INSERT INTO schema VALUES (4, 'jazzy');"
            "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles"
            " TEXT, type_description_hash TEXT);"
            "INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr', '', '');"
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
            " SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(1000000) AS data FROM n;"
        )
    database.close()


def far_rows(path: Path) -> None:
    """Pressure of 60 000 samples, most of them most of a day apart."""
    times, now = [], 0.0
    for k in range(60_000):
        now += 0.1 if k % 2 else 80_000.0
        times.append(now)
    path.write_text("time_s,pressure_pa\n" + "".join(f"{t:.1f},2e7\n" for t in times))


def many_curves(path: Path) -> None:
    """LAS whose header has 16 000 curves."""
    curves = "".join(f"C{k}.M:\n" for k in range(16_000))
    path.write_text(f"~V\nVERS. 2.0:\nWRAP. NO:\n~W\nNULL. -999:\n~C\n{curves}~A\n1 2 3\n")


def wide_row(path: Path) -> None:
    """A table with one row of a million columns."""
    path.write_text("md_m,inc_deg,azi_deg\n0,0,0\n" + "1," * 1_000_000 + "\n")


def entities(path: Path) -> None:
    """XML whose entities unfold tenfold on each level."""
    lines = ['<!ENTITY a "xxxxxxxxxx">']
    lines += [f'<!ENTITY {new} "{f"&{old};" * 10}">' for old, new in itertools.pairwise("abcdefghij")]
    path.write_text(f"<?xml version='1.0'?><!DOCTYPE t [{''.join(lines)}]><t>&j;</t>")


def pipe(path: Path) -> None:
    """A named pipe that nobody writes."""
    os.mkfifo(path)


def device(path: Path) -> None:
    """A device that gives zeros without end."""
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    """A folder under the name of a file."""
    path.mkdir()


PLACES: dict[str, Callable[[Path], None]] = {"pipe": pipe, "device": device, "folder": folder}
YAML = {"merge keys": merge_keys, "aliases": aliases, "long number": long_number, "deep": deep}
MCAP = {"zeros": mcap_of_zeros, "records": mcap_of_records}
LISTS = {"curves.las": many_curves, "wide.csv": wide_row, "entities.xml": entities}

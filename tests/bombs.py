# SPDX-License-Identifier: Apache-2.0
"""Small inputs that ask for much: each kind of file that `mwd` opens, made so that its reader would not end."""

from __future__ import annotations

import functools
import io
import itertools
import os
import re
import sqlite3
import struct
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import zstandard
from mcap.records import Channel, Header
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from mwd_surface.bags.mcap.records import MAGIC, RECORD_HEAD, ChunkHead
from mwd_surface.bags.mcap.writer import chunk_prefix, packed

GRAVITY = ("gravity_x", "gravity_y", "gravity_z")
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


def directives(path: Path) -> None:
    """YAML with 200 000 directives, each of which the parser compares with all before it."""
    path.write_text("".join(f"%TAG !a{k}! x:\n" for k in range(200_000)) + "---\nseed: 1")


def deep(path: Path) -> None:
    """YAML or JSON nested 100 000 levels deep."""
    path.write_text("[" * 100_000)


def _chunks(path: Path, count: int) -> None:
    """MCAP of chunks that unpack to 64 MiB each."""
    plain = RECORD_HEAD.pack(0x80, MANY - 9) + bytes(MANY - 9)
    data = zstandard.ZstdCompressor(level=1).compress(plain)
    chunk = chunk_prefix(ChunkHead(1, 2, len(plain), 0, "zstd", len(data), 0)) + data
    channel = packed(Channel(1, "/a", "cdr", {}, schema_id=0))
    path.write_bytes(MAGIC + packed(Header("ros2", "x")) + channel + chunk * count)


def mcap_of_zeros(path: Path) -> None:
    """MCAP of some 100 kB that unpacks to gigabytes."""
    _chunks(path, 64)


def mcap_of_records(path: Path) -> None:
    """MCAP whose one chunk holds seven million records of no bytes."""
    plain = RECORD_HEAD.pack(0x80, 0) * (MANY // 9)
    data = zstandard.ZstdCompressor(level=1).compress(plain)
    chunk = chunk_prefix(ChunkHead(1, 2, len(plain), 0, "zstd", len(data), 0)) + data
    path.write_bytes(MAGIC + packed(Header("ros2", "x")) + chunk)


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


@functools.cache
def _ros1(compression: str) -> bytes:
    """ROS 1 bag of one chunk that unpacks to 100 MB."""
    with tempfile.TemporaryDirectory() as folder:
        writer = Ros1Writer(Path(folder) / "a.bag")
        writer.set_compression(Ros1Writer.CompressionFormat[compression])
        with writer:
            connection = writer.add_connection("/a", "std_msgs/msg/String", msgdef="string data\n", md5sum="0" * 32)
            writer.write(connection, 1, (10**8).to_bytes(4, "little") + bytes(10**8))
        return (Path(folder) / "a.bag").read_bytes()


def ros1_bz2(path: Path) -> None:
    """ROS 1 bag of some hundred bytes, packed by bz2."""
    path.write_bytes(_ros1("BZ2"))


def ros1_lz4(path: Path) -> None:
    """ROS 1 bag of 400 kB, packed by lz4."""
    path.write_bytes(_ros1("LZ4"))


def ros1_without_index(path: Path) -> None:
    """ROS 1 bag whose index is cut off."""
    data = bytearray(_ros1("BZ2"))
    at = data.index(b"index_pos=") + len("index_pos=")
    data[at : at + 8] = bytes(8)
    path.write_bytes(data)


def alternating_chunks(path: Path) -> None:
    """ROS 1 bag of two chunks whose messages alternate in time: a reader that holds one chunk unpacks 20 000 times."""
    store = get_typestore(Stores.ROS1_NOETIC)
    text, random = store.types["std_msgs/msg/String"], np.random.default_rng(0)
    writer = Ros1Writer(path)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store)
        for half in (0, 1):
            for k in range(10_000):
                data = store.serialize_ros1(text(data=random.bytes(50).hex()), "std_msgs/msg/String")
                writer.write(connection, 10**18 + (2 * k + half) * 1000, data)


def long_parquet(path: Path) -> None:
    """Attitude of eight million equal rows, half a gigabyte in memory, in some hundred kilobytes."""
    _parquet(path, 2_000_000, 4, "still")


def wide_parquet(path: Path) -> None:
    """Attitude of a million rows, each with the same word of a megabyte."""
    _parquet(path, 1_000_000, 1, "x" * 1_000_000)


def _parquet(path: Path, rows: int, groups: int, word: str) -> None:
    path.mkdir()
    (path / "surveys.csv").write_text("sequence\n")
    (path / "attitude.csv").unlink(missing_ok=True)
    numbers = {name: pa.array(np.zeros(rows)) for name in ("inclination_deg", "azimuth_deg", "toolface_deg", *GRAVITY)}
    status = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int32)), pa.array([word]))
    table = pa.table({"stamp_ns": pa.array(np.zeros(rows, dtype=np.int64)), **numbers, "status": status})
    with pq.ParquetWriter(path / "attitude.parquet", table.schema, compression="zstd") as writer:
        for _ in range(groups):
            writer.write_table(table)


def long_line(path: Path) -> None:
    """Attitude of one line of three gigabytes, which takes no room on the disk."""
    path.mkdir()
    (path / "surveys.csv").write_text("sequence\n")
    with (path / "attitude.csv").open("wb") as file:
        file.write(b"stamp_ns,inclination_deg,azimuth_deg,toolface_deg,gravity_x,gravity_y,gravity_z,status\n1")
        file.truncate(3 * 10**9)


def endless(path: Path) -> None:
    """File of ten gigabytes that takes no room on the disk."""
    with path.open("wb") as file:
        file.truncate(10**10)


def deep_json(path: Path) -> None:
    """JSON nested 100 000 levels deep."""
    path.write_text('{"a":' * 100_000)


def packed_messages(path: Path) -> None:
    """Folder of a recording whose messages are packed one by one, and hold a gigabyte each."""
    path.mkdir()
    with Rosbag2Writer(path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            "/imu/data_raw", "sensor_msgs/msg/Imu", typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        packed = zstandard.ZstdCompressor(level=1).compress(bytes(10**9))
        for k in range(20):
            writer.write(connection, k + 1, packed)
    about = path / "bag" / "metadata.yaml"
    text = about.read_text()
    text = re.sub(r"compression_format:.*", "compression_format: zstd", text)
    about.write_text(re.sub(r"compression_mode:.*", "compression_mode: MESSAGE", text))


def long_wav(path: Path) -> None:
    """WAV of a few bytes whose head claims four gigabytes of samples."""
    head = struct.pack(
        "<4sI4s4sIHHIIHH4sI", b"RIFF", 2**32 - 1, b"WAVE", b"fmt ", 16, 1, 1, 100, 200, 2, 16, b"data", 2**32 - 9
    )
    path.write_bytes(head + bytes(64))


def slow_wav(path: Path) -> None:
    """WAV of a megabyte at one sample in a second: most of a year of samples a second apart."""
    head = struct.pack(
        "<4sI4s4sIHHIIHH4sI", b"RIFF", 36 + 10**7, b"WAVE", b"fmt ", 16, 1, 1, 1, 2, 2, 16, b"data", 10**7
    )
    path.write_bytes(head + bytes(10**7))


def _xlsx(path: Path, *sheet: str) -> None:
    """Spreadsheet with the given text of its one sheet, in parts."""
    book = openpyxl.Workbook()
    book.active.append(["md_m", "inc_deg", "azi_deg"])
    plain = io.BytesIO()
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            with new.open(item.filename, "w") as file:
                for part in sheet if item.filename.endswith("sheet1.xml") else (old.read(item).decode(),):
                    file.write(part.encode())


_SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
)


def zeros_xlsx(path: Path) -> None:
    """Spreadsheet of 300 kB that unpacks to 300 MB."""
    head, tail = _SHEET.split("{}")
    _xlsx(path, head, *[" " * 10**6] * 300, tail)


def far_row_xlsx(path: Path) -> None:
    """Spreadsheet whose second row has number two thousand million."""
    _xlsx(
        path,
        _SHEET.format(
            '<row r="1"><c r="A1"><v>1</v></c></row><row r="2000000000"><c r="A2000000000"><v>1</v></c></row>'
        ),
    )


def wide_xlsx(path: Path) -> None:
    """Spreadsheet of 50 000 rows whose one cell stands at the far right."""
    _xlsx(path, _SHEET.format("".join(f'<row r="{k}"><c r="XFD{k}"><v>1</v></c></row>' for k in range(1, 50_000))))


def entities_xlsx(path: Path) -> None:
    """Spreadsheet whose sheet has entities that unfold tenfold on each level."""
    entities(path)
    _xlsx(path, path.read_text())


def _xlsx_with(path: Path, part: str, before: str, extra: str) -> None:
    """Spreadsheet of one cell with a text put into one of its parts, before the first place of another text."""
    book = openpyxl.Workbook()
    book.active.append(["md_m", "inc_deg", "azi_deg"])
    plain = io.BytesIO()
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            text = old.read(item).decode()
            new.writestr(item.filename, text.replace(before, extra + before, 1) if item.filename == part else text)


def styles_xlsx(path: Path) -> None:
    """Spreadsheet of one cell and nine million fonts: a part of a few kilobytes that takes minutes."""
    _xlsx_with(path, "xl/styles.xml", "</fonts>", "<font/>" * 9_000_000)


def sheets_xlsx(path: Path) -> None:
    """Spreadsheet whose 20 000 sheets are the same one."""
    sheets = (f'<sheet name="s{k}" sheetId="{k + 2}" state="visible" r:id="rId1"/>' for k in range(20_000))
    space = ' xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships"/>'
    _xlsx_with(path, "xl/workbook.xml", "</sheets>", "".join(sheets).replace("/>", space))


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
YAML = {
    "merge keys": merge_keys,
    "aliases": aliases,
    "long number": long_number,
    "deep": deep,
    "directives": directives,
}
MCAP = {"zeros": mcap_of_zeros, "records": mcap_of_records}
ROS1 = {"bz2": ros1_bz2, "lz4": ros1_lz4, "without index": ros1_without_index}
SHEETS = {
    "zeros": zeros_xlsx,
    "far row": far_row_xlsx,
    "wide": wide_xlsx,
    "entities": entities_xlsx,
    "styles": styles_xlsx,
    "many sheets": sheets_xlsx,
}
WAV = {"long": long_wav, "slow": slow_wav}
RUNS = {"long Parquet": long_parquet, "wide Parquet": wide_parquet, "long line": long_line}
FILES = {"endless": endless, "deep": deep_json}
LISTS = {"curves.las": many_curves, "wide.csv": wide_row, "entities.xml": entities}

# SPDX-License-Identifier: Apache-2.0
"""The files of a bag, found and opened: what is there is used, what is not or is unusual is reported."""

from __future__ import annotations

from pathlib import Path

import pytest
import zstandard

from mwd_surface.bags.bag_files import BagError, BagFiles
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap.records import MAGIC

START = 1_700_000_000_000_000_000
STRING, IMU = "std_msgs/msg/String", "sensor_msgs/msg/Imu"
QOS = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 2\n"


@pytest.fixture
def opened():
    """Opens a bag, and closes it when the test is over."""
    there = []

    def open_files(path: Path) -> BagFiles:
        there.append(BagFiles(path))
        return there[-1]

    yield open_files
    for files in there:
        files.close()


def written(path: Path, files: int = 1, **options) -> Path:
    """Three messages of /a and two of /b in each file, a second apart, and a file a minute."""
    with BagWriter(path, **options) as writer:
        a, b = writer.topic("/a", STRING, QOS), writer.topic("/b", IMU)
        for file in range(files):
            if file:
                writer.split()
            for k, channel in enumerate((a, b, a, b, a)):
                writer.write(channel, b"\0\1\0\0" + bytes(60), START + (60 * file + k) * 10**9)
    return path


def test_topics_counts_and_times_are_those_of_all_files_together(tmp_path, opened):
    bag = opened(written(tmp_path / "bag", files=12, custom={"well": "F-4"}))
    assert {name: (about.type_name, about.count) for name, about in bag.topics.items()} == {
        "/a": (STRING, 36),
        "/b": (IMU, 24),
    }
    assert (bag.start_ns, bag.end_ns) == (START, START + (60 * 11 + 4) * 10**9)
    # By number, not by letter: 2 comes before 10.
    assert [file.name for file in bag.files] == [f"bag_{k}.mcap" for k in range(12)]
    assert bag.size_bytes == sum(file.stat().st_size for file in bag.files)
    assert (bag.storage, bag.custom, bag.complete, bag.notes) == ("mcap", {"well": "F-4"}, True, [])


def test_a_topic_carries_its_definition_hash_and_profiles(tmp_path, opened):
    about = opened(written(tmp_path / "bag")).topics["/a"]
    assert (about.schema_encoding, about.serialization) == ("ros2msg", "cdr")
    assert "string data" in about.schema
    assert about.type_hash.startswith("RIHS01_")
    assert "depth: 7" in about.qos


def test_a_file_compressed_as_a_whole_is_unpacked_beside_nothing_of_the_users(tmp_path, opened):
    plain = written(tmp_path / "bag") / "bag_0.mcap"
    (tmp_path / "packed").mkdir()
    packed = tmp_path / "packed" / "bag_0.mcap.zstd"
    packed.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    bag = opened(packed)
    assert bag.topics["/a"].count == 3
    assert any("decompressed to a temporary file" in note for note in bag.notes)
    assert list(packed.parent.iterdir()) == [packed]
    scratch = Path(bag._scratch.name)
    bag.close()
    assert not scratch.exists()


def test_without_metadata_yaml_the_files_that_are_there_are_used(tmp_path, opened):
    path = written(tmp_path / "bag", files=2)
    (path / "metadata.yaml").unlink()
    bag = opened(path)
    assert bag.topics["/a"].count == 6
    assert any("metadata.yaml: No such file" in note for note in bag.notes)


def test_one_bad_file_of_several_is_skipped_and_named(tmp_path, opened):
    path = written(tmp_path / "bag", files=2)
    (path / "bag_0.mcap").write_bytes(b"not a bag at all")
    bag = opened(path)
    assert bag.topics["/a"].count == 3
    assert not bag.complete
    assert any(note.startswith("bag_0.mcap: ") and note.endswith("skipped") for note in bag.notes)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.mcap", b"", "empty"),
        ("x.mcap", b"not a bag at all", "does not begin like an MCAP file"),
        ("x.mcap", MAGIC, "holds no message"),
        ("x.txt", b"hello", "is not a bag"),
        ("x.db3", b"hello", "cannot be read"),
        ("x.mcap.zstd", b"hello", "does not decompress"),
        ("", None, "holds no recording"),
        ("nowhere", None, "there is nothing at"),
    ],
)
def test_what_is_no_bag_is_refused_with_a_hint(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match=words) as caught:
        BagFiles(tmp_path / name)
    assert str(caught.value) == f"{caught.value.sentence}; {caught.value.hint}"
    assert caught.value.hint


def edited(path, change):
    """Change the information in metadata.yaml of a bag."""
    import yaml

    file = path / "metadata.yaml"
    table = yaml.safe_load(file.read_text())
    change(table["rosbag2_bagfile_information"])
    file.write_text(yaml.safe_dump(table))
    return path


def beside(path, name, data):
    (path / name).write_bytes(data)


# Name: what is wrong in the folder or in metadata.yaml, and a part of the note.
WRONG = {
    "missing file": (lambda _p, t: t["relative_file_paths"].append("gone.mcap"), "missing: gone.mcap"),
    "renamed file": (lambda _p, t: t.update(relative_file_paths=["old.mcap"]), "bag_0.mcap also read"),
    "path out of the folder": (lambda _p, t: t["relative_file_paths"].append("../../etc/passwd"), "missing: passwd"),
    "text file": (
        lambda p, t: (beside(p, "a.txt", b"notes"), t["relative_file_paths"].append("a.txt")),
        "a.txt is not a recording",
    ),
    "extra copy": (
        lambda p, _t: beside(p, "copy.mcap", (p / "bag_0.mcap").read_bytes()),
        "copy.mcap left out, because it is a copy",
    ),
    "other storage": (
        lambda p, _t: beside(p, "old.db3", b"SQLite format 3\0" + bytes(100)),
        "old.db3 is a recording of another storage (sqlite3)",
    ),
    "fewer messages": (
        lambda _p, t: t["topics_with_message_count"][0].update(message_count=1),
        "/a has 1 messages there, but",
    ),
    "more messages": (lambda _p, t: t["topics_with_message_count"][0].update(message_count=10**18), "3 in the files"),
    "other type": (
        lambda _p, t: t["topics_with_message_count"][0]["topic_metadata"].update(type="std_msgs/msg/Empty"),
        "/a is std_msgs/msg/Empty there, but",
    ),
    "packed messages": (
        lambda _p, t: t.update(compression_mode="MESSAGE", compression_format="zstd"),
        "compressed one by one; they are not",
    ),
    "packed file": (
        lambda _p, t: t.update(compression_mode="FILE", relative_file_paths=["bag_0.mcap.zstd"]),
        "bag_0.mcap also read",
    ),
    "storage": (lambda _p, t: t.update(storage_identifier="sqlite3"), "says that the storage is sqlite3; it is mcap"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_metadata_yaml_says_wrongly_is_told_and_all_messages_are_read(fault, tmp_path, opened):
    change, note = WRONG[fault]
    path = written(tmp_path / "bag")
    bag = opened(edited(path, lambda table: change(path, table)))
    assert any(note in text for text in bag.notes), bag.notes
    assert bag.topics["/a"].count == 3
    assert bag.complete

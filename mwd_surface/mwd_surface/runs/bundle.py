# SPDX-License-Identifier: Apache-2.0
"""
Zip file for a bug report: versions, checks of the machine, settings, logs, survey list, end of the recording.

Secrets are not copied: parameters and lines that name a token or password are omitted, the contents of token files are
replaced wherever they occur, and the home folder is written as ~.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from mwd_sensors.core import budgets, wire
from mwd_sensors.core.input_files import read_file
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs.doctor import examine

# Number of bytes kept from the end of a log.
_LOG_BYTES = 2_000_000
# Words that mark a variable, a parameter or a line of text as secret.
_SECRET = re.compile(r"(?i)(token|password|passphrase|secret)")
# Files of a run that are copied; other files are only listed.
_TEXTS = ("*.log", "*.yaml", "surveys*.json", "surveys*.csv", "faults.csv", "rig_status.json")
# Prefixes of the environment variables that are copied.
_VARIABLES = ("ROS_", "RMW_", "FASTRTPS_", "AMENT_", "MWD_", "NUMBA_", "PYTHON")
_MOST_BYTES = 20_000_000  # largest size of one text file other than a log


@dataclasses.dataclass(frozen=True)
class Bundle:
    """Result of `write`: names in the zip, the recording whose end was copied (or None), and remarks on files."""

    names: list[str]
    recording: Path | None
    remarks: list[str]


def write(folder: Path, target: Path, minutes: float, versions: str, environment: Mapping[str, str]) -> Bundle:
    """
    Write the zip of a run, a well's folder or a recording; return its contents and remarks.

    Parameters
    ----------
    folder : Path
        Run, folder of a well, or recording; a folder is searched with all its subfolders.
    target : Path
        Zip file, which is written completely or not at all.
    minutes : float
        Length of the last part of the newest recording that is copied, min; 0: no recording is copied.
    versions : str
        Versions of this project and of its libraries.
    environment : mapping
        Environment variables of the process.

    Raises
    ------
    FileNotFoundError
        The folder does not exist.
    OSError
        The zip cannot be written.
    """
    if not folder.exists():
        raise FileNotFoundError(2, "there is no such run or recording", str(folder))
    secrets = _secrets(folder, environment)
    names: list[str] = []
    remarks: list[str] = []
    recording = newest_recording(folder) if minutes > 0.0 else None
    with tempfile.TemporaryDirectory(prefix="mwd_bundle_", dir=target.parent) as scratch:
        draft = Path(scratch) / "bundle.zip"
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as packed:
            for name, text in _texts(folder, versions, environment, remarks):
                packed.writestr(name, clean(text, secrets))
                names.append(name)
            if recording is not None:
                end = Path(scratch) / "recording"
                try:
                    copy_end(recording, end, minutes)
                    for file in sorted(end.iterdir()):
                        packed.write(file, f"recording/{file.name}")
                        names.append(f"recording/{file.name}")
                except (BagError, ValueError, FileNotFoundError) as error:
                    remarks.append(f"{recording} is not in the bundle: {error}")
        shutil.move(draft, target)
    return Bundle(names, recording, remarks)


def clean(text: str, secrets: tuple[str, ...]) -> str:
    """Return the text with lines that name a secret, words in `secrets` and the home folder replaced."""
    lines = ["(a line about a secret is left out)" if _SECRET.search(line) else line for line in text.splitlines()]
    joined = "\n".join(lines) + "\n"
    for word in secrets:
        joined = joined.replace(word, "***")
    home = str(Path.home())
    return joined.replace(home, "~") if len(home) > 1 else joined


def newest_recording(folder: Path) -> Path | None:
    """
    Return the recording in a folder or its subfolders that was written last; None if there is no recording.

    A file is returned unchanged.
    """
    if folder.is_file():
        return folder
    files = [row for ending in ("mcap", "db3", "mcap.zstd", "db3.zstd") for row in _below(folder, f"*.{ending}")]
    newest = max(files, key=lambda row: row[1].st_mtime, default=None)
    return None if newest is None else newest[0].parent


def copy_end(recording: Path, target: Path, minutes: float) -> int:
    """
    Copy the last minutes of a recording, with the last message of each latched topic before them.

    Metadata are copied too, except values whose names mean a secret. Return the number of messages.

    Raises
    ------
    BagError
        The path is not a recording.
    """
    with Bag(recording) as bag, BagWriter(target) as writer:
        begin = bag.end_ns - round(minutes * 60 * wire.NANOSECONDS)
        channels = {topic.name: writer.copy_topic(topic) for topic in bag.topics.values()}
        latched = [topic.name for topic in bag.topics.values() if "transient_local" in topic.qos]
        last = {name: (log_ns, data) for log_ns, name, _, data in _before(bag, latched, begin)}
        for name, (log_ns, data) in sorted(last.items(), key=lambda row: row[1][0]):
            writer.write(channels[name], data, log_ns)
        for log_ns, name, _, data in bag.messages(start_ns=begin):
            writer.write(channels[name], data, log_ns)
        for table, values in bag.metadata().items():
            if table == "rosbag2":
                continue  # this table is the metadata.yaml of the whole recording
            writer.add_metadata(table, {name: text for name, text in values.items() if not _SECRET.search(name)})
        return writer.messages


def _before(bag: Bag, topics: list[str], end_ns: int) -> Iterator[tuple[int, str, str, bytes]]:
    if topics and end_ns > bag.start_ns:
        yield from bag.messages(topics, end_ns=end_ns)


def _secrets(folder: Path, environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return the words that must not be copied: tokens in files of the folder, and secret environment variables."""
    words = [value for name, value in environment.items() if _SECRET.search(name)]
    for file, status in _below(folder, "*token*"):
        if status.st_size <= budgets.SECRET.size:
            with contextlib.suppress(FileNotFoundError):
                words += read_file(file, budgets.SECRET).decode(errors="replace").split()
    return tuple(sorted({word for word in words if len(word) >= 4}, key=len, reverse=True))


def _below(folder: Path, pattern: str) -> Iterator[tuple[Path, os.stat_result]]:
    """
    Yield path and status of the files in a folder and its subfolders, in order.

    A file that a running node removes meanwhile is skipped.
    """
    for file in sorted(folder.rglob(pattern)) if folder.is_dir() else ():
        with contextlib.suppress(FileNotFoundError):
            if file.is_file():
                yield file, file.stat()


def _texts(
    folder: Path, versions: str, environment: Mapping[str, str], remarks: list[str]
) -> Iterator[tuple[str, str]]:
    """Yield name and content of each text of the bundle; add files that disappear meanwhile to `remarks`."""
    yield "versions.txt", versions
    checks = examine(environment, folder if folder.is_dir() else folder.parent)
    yield "doctor.txt", "\n".join(f"{c.level.name:8}{c.name}: {c.state} {c.remedy}".rstrip() for c in checks)
    chosen = sorted(name for name in environment if name.startswith(_VARIABLES))
    yield "environment.txt", "\n".join(f"{name}={environment[name]}" for name in chosen)
    listing = _below(folder, "*") if folder.is_dir() else [(folder, folder.stat())]
    yield "files.txt", "\n".join(f"{status.st_size:>12} {file}" for file, status in listing)
    for pattern in _TEXTS:
        for file, status in _below(folder, pattern):
            if not file.is_symlink() and (pattern == "*.log" or status.st_size < _MOST_BYTES):
                try:
                    with file.open("rb") as opened:
                        opened.seek(max(status.st_size - _LOG_BYTES - 1, 0) if pattern == "*.log" else 0)
                        content = opened.read(max(_LOG_BYTES + 1, _MOST_BYTES))
                except FileNotFoundError:
                    remarks.append(f"{file} is not in the bundle: it was removed while the bundle was written")
                    continue
                if pattern == "*.log" and len(content) > _LOG_BYTES:
                    # Keep complete lines only: the rest of a cut line may contain a secret without the word, such as
                    # "token", that identifies the line.
                    content = content[-_LOG_BYTES:].partition(b"\n")[2]
                yield f"run/{file.relative_to(folder)}", content.decode(errors="replace")

# SPDX-License-Identifier: Apache-2.0
"""
Recovery of an interrupted or damaged recording into a complete file; the original is kept next to it.

A chunk with a matching checksum is copied unchanged. Damage raises no error; the report counts the damages. If the new
file cannot be written, OSError is raised.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from numpy.typing import NDArray

from mwd_sensors.core.output_files import sync_folder
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, File, MetadataError, Topic
from mwd_surface.bags.mcap.contents import Bare, Chunk, Contents, Damage, Other, parse, parse_attachment
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import INDEX_ENTRY, MESSAGE_PREFIX, FormatError
from mwd_surface.bags.mcap.walk import Walk
from mwd_surface.bags.mcap.writer import McapWriter, is_being_written

# Check of a file, and the report of a check or a recovery.


@dataclasses.dataclass(frozen=True)
class RecoveryReport:
    """Result of a recovery or a check."""

    source: Path  #: the file that was read
    #: The recovered file; None if there was nothing to save, or if only a check was requested.
    target: Path | None = None
    kept: Path | None = None  #: new path of the original if the recovered file took its name
    sound: bool = False  #: the source was valid, so that nothing was done
    messages: int = 0  #: number of messages that were saved, or that a check found
    damages: int = 0  #: number of places with bytes that could not be read
    lost_bytes: int = 0  #: number of bytes in those places
    #: `start_ns`, `end_ns`: log times of the first and the last message; 0 if no message was found.
    start_ns: int = 0
    end_ns: int = 0
    notes: tuple[str, ...] = ()  #: one sentence for each fault or anything unusual that was found

    def sentence(self) -> str:
        """Return the report in one line."""
        if self.sound:
            return f"{self.source.name} is in order: {self.messages} messages"
        seconds = (self.end_ns - self.start_ns) * 1e-9
        lost = (
            f"{self.lost_bytes} bytes in {self.damages} places could not be used"
            if self.damages
            else "nothing on the disk was damaged"
        )
        if self.messages == 0:
            return f"{self.source.name}: nothing could be saved; {'; '.join(self.notes[:1]) or lost}"
        where = f" (the original is kept as {self.kept.name})" if self.kept else ""
        return f"{self.source.name}: saved {self.messages} messages over {seconds:.1f} s; {lost}{where}"


def check(path: Path) -> RecoveryReport:
    """
    Return a report on a whole file, with the faults of its checksums, positions and counts.

    Raises OSError if the file cannot be read; damage raises no error.
    """
    try:
        file = McapFile(path)
    except FormatError as error:
        return RecoveryReport(path, damages=1, lost_bytes=path.stat().st_size, notes=(str(error),))
    with contextlib.closing(file):
        contents = file.contents()
        tally = Tally(contents)
        places, whole = set(), True
        for piece in file.scan():
            tally.add(piece)
            if isinstance(piece, Other) and piece.opcode == Opcode.DATA_END:
                whole = file.data_checksum_matches(piece.offset)
            if isinstance(piece, Chunk) and len(piece.walk.log_ns):
                places.add(piece.offset)
        notes = all_notes(contents, tally.notes)
        if not (whole or notes):
            notes.append("the checksum of the whole file does not match: an index between the chunks is damaged")
        if file.sound():
            indexed = {span.offset for span in contents.spans if span.in_chunk}
            if indexed != places:
                notes.append(f"the index names {len(indexed)} chunks, but the file has {len(places)} intact ones")
            if {k: v for k, v in contents.counts.items() if v} != tally.counts:
                notes.append("the message counts in the summary differ from the messages in the file")
        report = tally.report(path)
        return dataclasses.replace(report, sound=not notes and file.sound(), notes=tuple(notes))


@dataclasses.dataclass
class Tally:
    """Counts of messages and damages over the pieces of a scan."""

    contents: Contents
    #: Number of messages by channel; messages without a channel are left out.
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    damages: int = 0
    lost_bytes: int = 0  #: bytes that cannot be used
    notes: list[str] = dataclasses.field(default_factory=list)
    times: list[int] = dataclasses.field(default_factory=list)  #: first and last log time, ns; empty without messages

    def add(self, piece: Chunk | Bare | Other | Damage) -> None:
        """Add the messages, times and damage of a piece of the file to the report."""
        if isinstance(piece, Damage):
            self.damages += 1
            self.lost_bytes += piece.end - piece.offset
            self.notes.append(f"bytes {piece.offset} to {piece.end} cannot be used: {piece.reason}")
        elif isinstance(piece, (Chunk, Bare)):
            if piece.walk.impossible:
                self.damages += 1
                self.notes.append(
                    f"bytes {piece.offset} to {piece.offset + piece.length}: {piece.walk.impossible} messages have a"
                    " time after the year 2262"
                )
            numbers, counts = np.unique(piece.walk.channel, return_counts=True)
            for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
                if number in self.contents.channels:
                    self.counts[number] = self.counts.get(number, 0) + count
            if len(piece.walk.log_ns):
                self.times = [
                    min([*self.times[:1], int(piece.walk.log_ns.min())]),
                    max([*self.times[1:], int(piece.walk.log_ns.max())]),
                ]

    def report(self, source: Path) -> RecoveryReport:
        """Return the counts as a report on the file `source`."""
        return RecoveryReport(
            source,
            messages=sum(self.counts.values()),
            damages=self.damages,
            lost_bytes=self.lost_bytes,
            start_ns=self.times[0] if self.times else 0,
            end_ns=self.times[1] if self.times else 0,
            notes=tuple(self.notes),
        )


def all_notes(contents: Contents, met: Sequence[str]) -> list[str]:
    """Return the notes of the contents and the notes `met` during a scan, without repetitions."""
    # If the contents come from a scan, their notes describe the same damage already.
    return list(contents.notes) if contents.scanned else [*contents.notes, *met]


# Recovery of a file or a bag.

# Names of the metadata records in a recovered file: the contents of metadata.yaml, and the report of the recovery.
ROSBAG2_RECORD = "rosbag2"
RECOVERY_RECORD = "mwd_recovery"
# Endings of the name of a damaged original that is kept, and of a file that is being written.
KEPT = ".damaged"
_DRAFT = ".recovering"
_UNSIGNED = 2**64 - 1  # mask that turns an int64 back into the uint64 of a publication time


def _always() -> bool:
    return True


def recover(path: Path | str, output: Path | str | None = None) -> list[RecoveryReport]:
    """
    Recover a file or every file of a bag; return one report per file.

    A single file is left unchanged, and its valid content is written to `output` (by default ``<name>.recovered.mcap``
    in the same folder). In a bag's folder the recovered file takes the name of the damaged file, which is kept with
    `KEPT` added to its name, and metadata.yaml is rewritten.

    Raises
    ------
    OSError
        `path` cannot be read or the new file cannot be written.
    ValueError
        `output` was given for a folder, or exists already; or the recording is still running.
    """
    path = Path(path)
    if is_being_written(path):
        raise ValueError(f"{path} is being recorded: stop the recording first")
    if path.is_dir():
        if output is not None:
            raise ValueError("output: a bag's folder is recovered in place; omit output")
        return recover_bag(path)
    target = Path(output) if output is not None else path.with_name(f"{path.stem}.recovered.mcap")
    if target.exists():
        raise ValueError(f"output: {target} exists already")
    return [recover_file(path, target)]


def recover_file(source: Path, target: Path, going_on: Callable[[], bool] = _always) -> RecoveryReport:
    """
    Write every valid message of `source` to a new, complete file `target`; without a valid message, write no file.

    going_on : called between chunks; if it returns False, recovery stops and nothing is written.

    Raises
    ------
    OSError
        `source` cannot be opened or `target` cannot be written.
    InterruptedError
        `going_on` returned False.
    """
    draft = target.with_name(target.name + _DRAFT)
    draft.unlink(missing_ok=True)
    try:
        file = McapFile(source, damaged=True)
    except FormatError as error:
        return RecoveryReport(source, damages=1, lost_bytes=source.stat().st_size, notes=(str(error),))
    with contextlib.closing(file):
        contents = file.contents()
        writer = McapWriter(draft)
        try:
            report = _copy(file, contents, writer, going_on)
            if report.messages:
                writer.finish(sync=True)
            else:
                writer.close()
        except BaseException:
            writer.close()
            draft.unlink(missing_ok=True)
            raise
    if not report.messages:
        draft.unlink()
        return report
    draft.replace(target)
    sync_folder(target.parent)
    return dataclasses.replace(report, target=target)


def recover_bag(folder: Path, going_on: Callable[[], bool] = _always, *, thorough: bool = True) -> list[RecoveryReport]:
    """
    Recover a bag's folder: replace every damaged file by its recovered content, and rewrite metadata.yaml.

    thorough : False skips the check of chunks in a file that has its end and a valid summary.

    Returns one report for each MCAP file that was read. Errors as in `recover_file`.
    """
    reports = []
    for path in _files(folder):
        if not thorough and _has_end(path):
            continue
        first = check(path)
        if first.sound:
            reports.append(first)
            continue
        fresh = path.with_name(path.name + ".recovered")
        fresh.unlink(missing_ok=True)
        report = recover_file(path, fresh, going_on)
        kept = _free_name(path.with_name(path.name + KEPT))
        if report.target is None:
            path.rename(kept)
            reports.append(dataclasses.replace(report, kept=kept))
            continue
        # The old name must exist at every moment: link the original to a second name first, then replace the old name.
        try:
            os.link(path, kept)
        except OSError:
            # The file system does not support hard links.
            path.rename(kept)
        fresh.replace(path)
        sync_folder(folder)
        reports.append(dataclasses.replace(report, target=path, kept=kept))
    _renew_metadata(folder)
    return reports


def is_unfinished(bag: Path) -> bool:
    """Return whether a bag has a file without its end, or a file that no readable metadata.yaml names."""
    files = _files(bag)
    try:
        listed = {file.path for file in bag_metadata.read(bag).files}
    except MetadataError:
        listed = set()
    return bool({file.name for file in files} - listed) or not all(_has_end(file) for file in files)


def _copy(file: McapFile, contents: Contents, writer: McapWriter, going_on: Callable[[], bool]) -> RecoveryReport:
    for schema in contents.schemas.values():
        writer.add_schema(schema)
    for channel in contents.channels.values():
        if channel.schema_id and channel.schema_id not in contents.schemas:
            # The definition is lost; keep the messages with a type that has no definition.
            lost = Schema(channel.schema_id, b"", encoding="", name="")
            writer.add_schema(lost)
            contents.schemas[lost.id] = lost
        writer.add_channel(channel)
    for number in sorted(set(contents.counts) - set(contents.channels)):
        # Only the declaration of the topic is lost, not its messages.
        lost_topic = Channel(number, f"/lost_topic_{number}", "cdr", {}, schema_id=0)
        contents.channels[number] = lost_topic
        contents.notes.append(f"the declaration of topic {number} is lost: its messages are in {lost_topic.topic}")
        writer.add_channel(lost_topic)
    tally = Tally(contents)
    for piece in file.scan():
        if not going_on():
            raise InterruptedError(f"the recovery of {file.path} was stopped")
        tally.add(piece)
        if isinstance(piece, (Chunk, Bare)):
            _copy_messages(piece, contents.channels, writer)
        elif isinstance(piece, Other):
            _copy_other(piece, writer)
    report = tally.report(file.path)
    notes = tuple(all_notes(contents, report.notes))
    table = {
        "source": file.path.name,
        "messages": str(report.messages),
        "damages": str(report.damages),
        "lost_bytes": str(report.lost_bytes),
        "notes": "\n".join(notes[:100]),
    }
    writer.add_metadata(RECOVERY_RECORD, table)
    alone = metadata_of_files([(file.path.name, contents.channels, contents.schemas, writer)])
    writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": bag_metadata.serialized(alone)})
    return dataclasses.replace(report, notes=notes)


def _copy_messages(piece: Chunk | Bare, channels: Mapping[int, Channel], writer: McapWriter) -> None:
    walk = piece.walk
    numbers = np.unique(walk.channel).tolist()
    # Copy a chunk unchanged only if it has a checksum; otherwise the bytes between its messages may be damaged.
    whole = isinstance(piece, Chunk) and piece.head.crc and not walk.impossible
    if isinstance(piece, Chunk) and whole and all(number in channels for number in numbers):
        if numbers:
            writer.close_chunk()
            writer.copy_chunk(
                dataclasses.replace(
                    piece.head, start_ns=int(walk.log_ns.min()), end_ns=int(walk.log_ns.max()), data_at=0
                ),
                piece.data,
                {number: _entries(walk, number) for number in numbers},
            )
        return
    rows = zip(
        walk.channel.tolist(),
        walk.offset.tolist(),
        walk.size.tolist(),
        walk.log_ns.tolist(),
        walk.publish_ns.tolist(),
        strict=True,
    )
    for number, offset, size, log_ns, publish_ns in rows:
        if number in channels:
            writer.write(number, piece.plain[offset : offset + size], log_ns, publish_ns & _UNSIGNED)


def _copy_other(piece: Other, writer: McapWriter) -> None:
    if piece.opcode == Opcode.ATTACHMENT:
        writer.attach(parse_attachment(piece.body))
    elif piece.opcode == Opcode.METADATA:
        table = parse(Metadata, piece.body)
        if table.name not in (ROSBAG2_RECORD, RECOVERY_RECORD):
            writer.add_metadata(table.name, table.metadata)


def _entries(walk: Walk, number: int) -> NDArray[np.void]:
    mine = walk.channel == number
    entries = np.empty(int(mine.sum()), dtype=INDEX_ENTRY)
    entries["log_ns"] = walk.log_ns[mine]
    entries["offset"] = walk.offset[mine] - MESSAGE_PREFIX
    return entries


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"), key=lambda path: (len(path.name), path.name))


def _has_end(path: Path) -> bool:
    try:
        file = McapFile(path)
    except (FormatError, OSError):
        return False
    with contextlib.closing(file):
        return file.sound()


def _free_name(path: Path) -> Path:
    names: Iterator[Path] = (path.with_name(f"{path.name}{k or ''}") for k in range(10_000))
    return next(name for name in names if not name.exists())


def _renew_metadata(folder: Path) -> None:
    parts = []
    for path in _files(folder):
        with contextlib.closing(McapFile(path)) as file:
            contents = file.contents()
            parts.append((path.name, contents.channels, contents.schemas, contents))
    try:
        old = bag_metadata.read(folder)
    except MetadataError:
        old = BagMetadata([], [])
    if parts:
        bag_metadata.write(folder, dataclasses.replace(metadata_of_files(parts), custom=old.custom))


# Metadata of a bag from the contents of its files.


def metadata_of_files(
    parts: Sequence[tuple[str, dict[int, Channel], dict[int, Schema], McapWriter | Contents]],
) -> BagMetadata:
    """Return the metadata of a bag from the name, channels, schemas and totals of each file."""
    files: list[File] = []
    topics: dict[tuple[str, str], Topic] = {}
    for name, channels, schemas, source in parts:
        if isinstance(source, McapWriter):
            start, end = source.start_ns, source.end_ns
        else:
            start = min((span.start_ns for span in source.spans), default=None)
            end = max((span.end_ns for span in source.spans), default=0)
        files.append(File(name, start, end, sum(source.counts.values())))
        for number, channel in channels.items():
            schema = schemas.get(channel.schema_id)
            type_name = schema.name if schema else ""
            known = topics.get((channel.topic, type_name))
            topics[channel.topic, type_name] = Topic(
                channel.topic,
                type_name,
                source.counts.get(number, 0) + (known.count if known else 0),
                channel.metadata.get("topic_type_hash", ""),
                bag_metadata.qos_if_readable(channel.metadata.get("offered_qos_profiles", "")),
            )
    return BagMetadata(files=files, topics=list(topics.values()))

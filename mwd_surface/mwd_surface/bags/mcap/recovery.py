"""
What is left of an interrupted or damaged recording, made whole again; the original is kept beside it.

Sound chunks are copied as they are, so nothing that a checksum vouches for is ever rewritten. Damage never raises here:
it is what the report counts. Only a disk that refuses the new file does (OSError).
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, File, MetadataError, Topic
from mwd_surface.bags.mcap import format as mcap_format
from mwd_surface.bags.mcap.format import Channel, FormatError, Schema, Walk
from mwd_surface.bags.mcap.index import Bare, Chunk, Contents, Damage, McapFile, Other
from mwd_surface.bags.mcap.writer import McapWriter

ROSBAG2_RECORD = "rosbag2"
RECOVERY_RECORD = "mwd_recovery"
KEPT = ".damaged"
_DRAFT = ".recovering"


@dataclasses.dataclass(frozen=True)
class Report:
    """
    What recovery, or a check, found.

    Attributes
    ----------
    source : Path
        The file that was read.
    target : Path or None
        The sound file; None when there was nothing to save (or only a check was asked for).
    kept : Path or None
        Where the original lies now, when the sound file took its name.
    sound : bool
        The source was in order: nothing was done.
    messages, chunks : int
        Saved, or found when only checked.
    topics : mapping of str to int
        Messages of each topic.
    damages : int
        Places where bytes could not be used.
    lost_bytes : int
        Bytes in those places.
    orphans : int
        Messages left out because the declaration of their topic is lost.
    start_ns, end_ns : int
        Log times of the first and the last message; 0 when there is none.
    notes : tuple of str
        One sentence for each thing found.
    """

    source: Path
    target: Path | None = None
    kept: Path | None = None
    sound: bool = False
    messages: int = 0
    chunks: int = 0
    topics: Mapping[str, int] = dataclasses.field(default_factory=dict)
    damages: int = 0
    lost_bytes: int = 0
    orphans: int = 0
    start_ns: int = 0
    end_ns: int = 0
    notes: tuple[str, ...] = ()

    def sentence(self) -> str:
        """The report in one line for people."""
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


def _always() -> bool:
    return True


def recover(path: Path | str, output: Path | str | None = None) -> list[Report]:
    """
    Recover a file or every file of a bag.

    A file is left as it is, and the sound copy written to `output` (by default ``<name>.recovered.mcap`` beside it).
    In a bag's folder the sound copy takes the file's name, the original is kept with `KEPT` added to its name, and
    metadata.yaml is written anew.

    Raises
    ------
    OSError
        `path` cannot be read or the disk refuses the new file.
    ValueError
        `output` was given for a folder, or exists.
    """
    path = Path(path)
    if path.is_dir():
        if output is not None:
            raise ValueError("output: a bag's folder is recovered in place; leave output away")
        return recover_bag(path)
    target = Path(output) if output is not None else path.with_name(f"{path.stem}.recovered.mcap")
    if target.exists():
        raise ValueError(f"output: {target} exists already")
    return [recover_file(path, target)]


def recover_file(source: Path, target: Path, going_on: Callable[[], bool] = _always) -> Report:
    """
    Write every sound message of `source` to a new, complete file `target`.

    going_on : asked between chunks; False stops, and nothing is written.

    Raises
    ------
    OSError
        `source` cannot be opened or `target` cannot be written.
    InterruptedError
        `going_on` said so.
    """
    draft = target.with_name(target.name + _DRAFT)
    draft.unlink(missing_ok=True)
    try:
        file = McapFile(source)
    except FormatError as error:
        return Report(source, damages=1, lost_bytes=source.stat().st_size, notes=(str(error),))
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
    bag_metadata.sync_folder(target.parent)
    return dataclasses.replace(report, target=target)


def recover_bag(folder: Path, going_on: Callable[[], bool] = _always, *, thorough: bool = True) -> list[Report]:
    """
    Make a bag's folder whole: every damaged file replaced by what could be saved, metadata.yaml written anew.

    thorough : False believes a file that has its end and a sound summary without reading its chunks.

    Returns one report for each MCAP file that was read. Errors as `recover_file`.
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
        # The old name always leads to a file: first a second name for the original, then the new file under the old.
        try:
            os.link(path, kept)
        except OSError:
            # A disk without hard links.
            path.rename(kept)
        fresh.replace(path)
        bag_metadata.sync_folder(folder)
        reports.append(dataclasses.replace(report, target=path, kept=kept))
    _renew_metadata(folder)
    return reports


def is_unfinished(bag: Path) -> bool:
    """Whether a bag has a file without its end, or one that metadata.yaml does not name."""
    files = _files(bag)
    try:
        listed = {file.path for file in bag_metadata.read(bag).files}
    except MetadataError:
        listed = set()
    return bool({file.name for file in files} - listed) or not all(_has_end(file) for file in files)


def check(path: Path) -> Report:
    """Read a whole file and compare everything in it: checksums, places, counts. Raises OSError only."""
    try:
        file = McapFile(path)
    except FormatError as error:
        return Report(path, damages=1, lost_bytes=path.stat().st_size, notes=(str(error),))
    with contextlib.closing(file):
        contents = file.contents()
        tally = _Tally(contents)
        places, whole = set(), True
        for piece in file.scan():
            tally.meet(piece)
            if isinstance(piece, Other) and piece.opcode == mcap_format.DATA_END:
                whole = file.data_checksum_matches(piece.offset)
            if isinstance(piece, Chunk) and len(piece.walk.log_ns):
                places.add(piece.offset)
        notes = _notes(contents, tally.notes)
        if not (whole or notes):
            notes.append("the checksum of the whole does not match: an index between the chunks is damaged")
        if file.sound():
            indexed = {span.offset for span in contents.spans if span.in_chunk}
            if indexed != places:
                notes.append(f"the index names {len(indexed)} chunks, {len(places)} sound ones are there")
            if {k: v for k, v in contents.counts.items() if v} != tally.counts:
                notes.append("the summary counts other messages than are there")
        report = tally.report(path)
        return dataclasses.replace(report, sound=not notes and file.sound(), notes=tuple(notes))


@dataclasses.dataclass
class _Tally:
    """Counts what a scan meets."""

    contents: Contents
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    chunks: int = 0
    damages: int = 0
    lost_bytes: int = 0
    orphans: int = 0
    notes: list[str] = dataclasses.field(default_factory=list)
    times: list[int] = dataclasses.field(default_factory=list)

    def meet(self, piece: Chunk | Bare | Other | Damage) -> None:
        if isinstance(piece, Damage):
            self.damages += 1
            self.lost_bytes += piece.end - piece.offset
            self.notes.append(f"bytes {piece.offset} to {piece.end} cannot be used: {piece.reason}")
        elif isinstance(piece, (Chunk, Bare)):
            self.chunks += isinstance(piece, Chunk)
            numbers, counts = np.unique(piece.walk.channel, return_counts=True)
            for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
                if number in self.contents.channels:
                    self.counts[number] = self.counts.get(number, 0) + count
                else:
                    self.orphans += count
            if len(piece.walk.log_ns):
                self.times = [
                    min([*self.times[:1], int(piece.walk.log_ns.min())]),
                    max([*self.times[1:], int(piece.walk.log_ns.max())]),
                ]

    def report(self, source: Path) -> Report:
        topics: dict[str, int] = {}
        for number, count in self.counts.items():
            name = self.contents.channels[number].topic
            topics[name] = topics.get(name, 0) + count
        return Report(
            source,
            messages=sum(self.counts.values()),
            chunks=self.chunks,
            topics=topics,
            damages=self.damages,
            lost_bytes=self.lost_bytes,
            orphans=self.orphans,
            start_ns=self.times[0] if self.times else 0,
            end_ns=self.times[1] if self.times else 0,
            notes=tuple(self.notes),
        )


def _copy(file: McapFile, contents: Contents, writer: McapWriter, going_on: Callable[[], bool]) -> Report:
    for schema in contents.schemas.values():
        writer.add_schema(schema)
    for channel in contents.channels.values():
        if channel.schema_id and channel.schema_id not in contents.schemas:
            # Its definition is lost; the messages are kept, of a type without one.
            lost = Schema(channel.schema_id, "", "", b"")
            writer.add_schema(lost)
            contents.schemas[lost.id] = lost
        writer.add_channel(channel)
    tally = _Tally(contents)
    for piece in file.scan():
        if not going_on():
            raise InterruptedError(f"the recovery of {file.path} was stopped")
        tally.meet(piece)
        if isinstance(piece, (Chunk, Bare)):
            _copy_messages(piece, contents.channels, writer)
        elif isinstance(piece, Other):
            _copy_other(piece, writer)
    report = tally.report(file.path)
    notes = tuple(_notes(contents, report.notes))
    table = {
        "source": file.path.name,
        "messages": str(report.messages),
        "damages": str(report.damages),
        "lost_bytes": str(report.lost_bytes),
        "notes": "\n".join(notes[:100]),
    }
    writer.add_metadata(RECOVERY_RECORD, table)
    alone = _bag_of([(file.path.name, contents.channels, contents.schemas, writer)])
    writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": bag_metadata.serialized(alone)})
    return dataclasses.replace(report, notes=notes)


def _copy_messages(piece: Chunk | Bare, channels: Mapping[int, Channel], writer: McapWriter) -> None:
    walk = piece.walk
    numbers = np.unique(walk.channel).tolist()
    if isinstance(piece, Chunk) and all(number in channels for number in numbers):
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
            writer.write(number, piece.plain[offset : offset + size], log_ns, publish_ns)


def _copy_other(piece: Other, writer: McapWriter) -> None:
    try:
        if piece.opcode == mcap_format.ATTACHMENT:
            writer.attach(mcap_format.parse_attachment(piece.body))
        elif piece.opcode == mcap_format.METADATA:
            name, values = mcap_format.parse_metadata(piece.body)
            if name not in (ROSBAG2_RECORD, RECOVERY_RECORD):
                writer.add_metadata(name, values)
    except FormatError:
        # Its own damage; messages matter more, and the scan has counted the bytes.
        return


def _notes(contents: Contents, met: Sequence[str]) -> list[str]:
    # A scan for the contents has met the same damage already.
    return list(contents.notes) if contents.scanned else [*contents.notes, *met]


def _entries(walk: Walk, number: int) -> NDArray[np.void]:
    mine = walk.channel == number
    entries = np.empty(int(mine.sum()), dtype=mcap_format.INDEX_ENTRY)
    entries["log_ns"] = walk.log_ns[mine]
    entries["offset"] = walk.offset[mine] - mcap_format.MESSAGE_PREFIX
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
        bag_metadata.write(folder, dataclasses.replace(_bag_of(parts), custom=old.custom))


def _bag_of(
    parts: Sequence[tuple[str, dict[int, Channel], dict[int, Schema], McapWriter | Contents]],
) -> BagMetadata:
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
                _qos(channel),
            )
    return BagMetadata(files=files, topics=list(topics.values()))


def _qos(channel: Channel) -> list[dict[str, object]]:
    try:
        return bag_metadata.parse_qos(channel.metadata.get("offered_qos_profiles", ""))
    except ValueError:
        return []

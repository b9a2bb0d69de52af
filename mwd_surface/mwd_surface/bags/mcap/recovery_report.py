# SPDX-License-Identifier: Apache-2.0
"""Check of an MCAP file, and the report of a check or a recovery."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from mwd_surface.bags.mcap.contents import Bare, Chunk, Contents, Damage, Other
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import FormatError


@dataclasses.dataclass(frozen=True)
class RecoveryReport:
    """
    Result of a recovery or a check.

    Attributes
    ----------
    source : Path
        The file that was read.
    target : Path or None
        The recovered file; None if there was nothing to save, or if only a check was requested.
    kept : Path or None
        New path of the original if the recovered file took its name.
    sound : bool
        The source was valid, so that nothing was done.
    messages : int
        Number of messages that were saved, or that a check found.
    damages : int
        Number of places with bytes that could not be read.
    lost_bytes : int
        Number of bytes in those places.
    start_ns, end_ns : int
        Log times of the first and the last message; 0 if there is no message.
    notes : tuple of str
        One sentence for each fault or anything unusual that was found.
    """

    source: Path
    target: Path | None = None
    kept: Path | None = None
    sound: bool = False
    messages: int = 0
    damages: int = 0
    lost_bytes: int = 0
    start_ns: int = 0
    end_ns: int = 0
    notes: tuple[str, ...] = ()

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
    """
    Counts of messages and damages over the pieces of a scan.

    counts : number of messages by channel; messages without a channel are left out.
    lost_bytes : bytes that cannot be used.
    times : first and last log time, ns; empty without messages.
    """

    contents: Contents
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    damages: int = 0
    lost_bytes: int = 0
    notes: list[str] = dataclasses.field(default_factory=list)
    times: list[int] = dataclasses.field(default_factory=list)

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

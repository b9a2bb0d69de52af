# SPDX-License-Identifier: Apache-2.0
"""
Reading the contents of an MCAP file from its summary if that is valid, else by scanning the file from the beginning.

In a truncated or damaged file, reading continues after each damage: every chunk with a valid checksum is used, and
damage is reported. Before memory is allocated for a length in the file, the length is compared with the file's size.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Metadata, MetadataIndex, Schema, Statistics

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import open_regular
from mwd_surface.bags.mcap.contents import (
    Bare,
    Chunk,
    Contents,
    Damage,
    MessageSpan,
    Other,
    Piece,
    parse,
    parse_attachment,
    parse_chunk_head,
    parse_span,
)
from mwd_surface.bags.mcap.records import (
    FOOTER_BYTES,
    MAGIC,
    MAX_CHUNK_BYTES,
    MESSAGE_HEAD,
    MESSAGE_PREFIX,
    PREFIX,
    Decompressor,
    FormatError,
)
from mwd_surface.bags.mcap.walk import records_at, records_in, walk_records

_LATEST_NS = 2**63 - 1  # latest time that int64 can hold, ns
_WINDOW = 256 * 1024  # number of bytes read at once
_CHUNK_HEAD_BYTES = 128  # largest size of a chunk's header
# Records other than messages and chunks whose bodies are read while scanning.
_BODIES = (
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
)
_PRIVATE = 0x80  # opcodes from here on are reserved for private records
# Exact body size of each kind of record with a fixed length, and smallest body size of the other kinds, bytes.
_FIXED = {int(Opcode.FOOTER): 20, int(Opcode.DATA_END): 4}
_SHORTEST = {
    int(Opcode.HEADER): 8,
    int(Opcode.SCHEMA): 14,
    int(Opcode.CHANNEL): 16,
    int(Opcode.MESSAGE): MESSAGE_HEAD,
    int(Opcode.CHUNK): 40,
    int(Opcode.MESSAGE_INDEX): 6,
    int(Opcode.CHUNK_INDEX): 60,
    int(Opcode.ATTACHMENT): 36,
    int(Opcode.ATTACHMENT_INDEX): 48,
    int(Opcode.STATISTICS): 46,
    int(Opcode.METADATA): 8,
    int(Opcode.METADATA_INDEX): 20,
    int(Opcode.SUMMARY_OFFSET): 17,
}
_FOLLOWING = 4  # number of consecutive valid records after which a position counts as the beginning of a record


class McapFile:
    """
    An MCAP file opened for reading.

    Parameters
    ----------
    damaged : bool
        Whether to accept a file that does not begin like an MCAP file, because its first bytes may be damaged.

    Raises
    ------
    OSError
        The file cannot be opened.
    FormatError
        The file is empty or does not begin like an MCAP file.
    """

    def __init__(self, path: Path, *, damaged: bool = False) -> None:
        self.path = path
        self._file = open_regular(path)
        try:
            self.size = os.fstat(self._file).st_size
            begin = os.pread(self._file, len(MAGIC), 0)
            # Only a file without its end may stop in the middle of a record.
            self._cut_off = os.pread(self._file, len(MAGIC), max(self.size - len(MAGIC), 0)) != MAGIC
        except OSError:
            self.close()
            raise
        if begin != MAGIC and not (damaged and self.size > len(MAGIC)):
            self.close()
            raise FormatError("the file does not begin like an MCAP file" if begin else "the file is empty")

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def read(self, offset: int, size: int) -> bytes:
        """
        Return `size` bytes of the file from byte `offset`; several threads may call this at once.

        Raises
        ------
        FormatError
            The bytes reach beyond the end of the file, are more than the largest chunk that is allowed, or cannot be
            read from the disk.
        """
        if size > MAX_CHUNK_BYTES + _CHUNK_HEAD_BYTES:
            raise FormatError(f"a record of {size} bytes is above the limit of {MAX_CHUNK_BYTES}")
        if offset < 0 or offset + size > self.size:
            raise FormatError(f"a record at byte {offset} reaches beyond the end of the file")
        try:
            data = os.pread(self._file, size, offset)
        except OSError as error:
            raise FormatError(f"byte {offset} cannot be read from the disk: {error.strerror}") from error
        if len(data) != size:
            raise FormatError(f"the file became shorter than its {self.size} bytes while it was read")
        return data

    def body(self, offset: int, opcode: int) -> bytes:
        """
        Return the body of the record at byte `offset`.

        Raises FormatError if the record has another opcode, or as in `read`.
        """
        prefix = self.read(offset, PREFIX)
        if prefix[0] != opcode:
            raise FormatError(f"byte {offset}: expected a record {opcode}, found {prefix[0]}")
        return self.read(offset + PREFIX, int.from_bytes(prefix[1:], "little"))

    def plain(self, span: MessageSpan, decompress: Decompressor) -> bytes:
        """
        Return the bytes of the records in a span of the file; a chunk is decompressed and its checksum is verified.

        Raises
        ------
        FormatError
            The span is damaged.
        """
        if not span.in_chunk:
            return self.read(span.offset, span.length)
        body = self.body(span.offset, Opcode.CHUNK)
        head = parse_chunk_head(body, len(body))
        if head.size != span.size:
            raise FormatError(f"the chunk at byte {span.offset} has {head.size} bytes, its index {span.size}")
        return decompress(head, memoryview(body)[head.data_at : head.data_at + head.compressed_size])

    def contents(self) -> Contents:
        """Return the contents of the file; damage is described in `Contents.notes` and never raises an error."""
        try:
            found = self._summary()
        except FormatError as error:
            return self._scanned(str(error))
        if found is None:
            return self._scanned("")
        return found

    def sound(self) -> bool:
        """Return whether the file has its end and a summary whose checksum, if any, is valid; chunks are not read."""
        try:
            return self._summary() is not None
        except FormatError:
            return False

    def data_checksum_matches(self, data_end: int) -> bool:
        """
        Return whether the CRC in the DataEnd record at byte `data_end` matches the bytes before the record.

        True if the record has no CRC; False if the file cannot be read.
        """
        try:
            expected = int.from_bytes(self.body(data_end, Opcode.DATA_END)[:4], "little")
            crc, at = 0, 0
            while expected and at < data_end:
                data = self.read(at, min(_WINDOW, data_end - at))
                crc, at = zlib.crc32(data, crc), at + len(data)
        except FormatError:
            return False
        return crc == expected

    def scan(self) -> Iterator[Piece]:
        """Yield every piece of the data section in the order of the file; damage is a piece too and raises no error."""
        decompress, at, unpacked = Decompressor(), len(MAGIC), 0
        while at < self.size:
            try:
                piece = self._piece(at, decompress)
                unpacked += len(piece.plain) if isinstance(piece, Chunk) else 0
                budgets.MCAP.check_ratio(self.size, unpacked)
            except BudgetError as error:
                yield Damage(at, self.size, f"the file {error}")
                return
            except FormatError as error:
                end = self._resume(at)
                yield Damage(at, end, str(error))
                at = end
                continue
            at = piece.offset + piece.length
            if isinstance(piece, Other) and piece.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                yield piece
                return
            yield piece

    def _piece(self, at: int, decompress: Decompressor) -> Chunk | Bare | Other:
        prefix = self.read(at, min(PREFIX, self.size - at))
        if len(prefix) < PREFIX:
            raise FormatError("the file ends inside a record")
        opcode, length = prefix[0], int.from_bytes(prefix[1:], "little")
        if opcode == 0 or Opcode.DATA_END < opcode < _PRIVATE:
            raise FormatError(f"no record begins with {opcode}")
        if length > self.size - at - PREFIX:
            raise FormatError("the file ends inside a record")
        if length != _FIXED.get(opcode, length):
            raise FormatError(f"a record {opcode} of {length} bytes")
        total = PREFIX + length
        if opcode == Opcode.MESSAGE:
            return self._bare(at, total)
        if opcode == Opcode.CHUNK:
            body = self.read(at + PREFIX, length)
            head = parse_chunk_head(body, length)
            data = body[head.data_at : head.data_at + head.compressed_size]
            plain = decompress(head, data)
            walk = walk_records(np.frombuffer(plain, dtype=np.uint8))
            if walk.end != len(plain):
                raise FormatError(f"a chunk's records end at byte {walk.end} of {len(plain)}")
            # Use the size in the chunk's header, because the length of the chunk's record has no checksum.
            return Chunk(at, PREFIX + head.data_at + head.compressed_size, head, data, plain, walk)
        if self._has_wrong_length(at, length):
            raise FormatError("no record begins where this one ends")
        body = self.read(at + PREFIX, length) if opcode in _BODIES else b""
        if opcode == Opcode.ATTACHMENT:
            parse_attachment(body)
        elif opcode == Opcode.METADATA:
            parse(Metadata, body)
        return Other(opcode, at, total, body)

    def _bare(self, at: int, first: int) -> Bare:
        plain = self.read(at, min(max(_WINDOW, first), self.size - at))
        walk = walk_records(np.frombuffer(plain, dtype=np.uint8))
        end = int(walk.others[0]) if len(walk.others) else walk.end
        last = int(walk.offset[walk.offset <= end].max(initial=0)) - MESSAGE_PREFIX
        # Only the record after a message shows that the message is whole: after a power failure, zeros or other data
        # may stand in place of its end.
        if last >= 0 and (self._has_wrong_length(at + last, end - last - PREFIX) or not self._is_record(at + end)):
            end = last
        if end == 0:
            raise FormatError("a message is shorter than its head, or no record begins where it ends")
        return Bare(at, end, plain[:end], walk_records(np.frombuffer(plain[:end], dtype=np.uint8)))

    def _has_wrong_length(self, at: int, length: int) -> bool:
        """
        Return whether the length of the record at `at` probably has one wrong bit.

        This is so if no record follows a record of this length, but a record follows after one bit of the length is
        changed.
        """
        after = at + PREFIX
        if self.read(at, 1)[0] == Opcode.FOOTER or self._begins_records(after + length, first=False, cut_off=False):
            return False
        # The wrong bit may also be in the length of the next record; then this record is intact.
        return not self._follows_with_wrong_bit(after + length) and self._follows_with_wrong_bit(at)

    def _is_record(self, at: int) -> bool:
        """Return whether a record begins at `at`, perhaps with a wrong opcode or one wrong bit in its length."""
        if self._begins_records(at, first=False, steps=1) or self._follows_with_wrong_bit(at):
            return True
        try:
            after = at + PREFIX + int.from_bytes(self.read(at + 1, PREFIX - 1), "little")
        except FormatError:
            return False
        return self._begins_records(after, first=False, cut_off=False, steps=1)

    def _follows_with_wrong_bit(self, at: int) -> bool:
        """Return whether other records follow the record at `at` after one bit of its length is changed."""
        if not 0 <= at <= self.size - PREFIX:
            return False
        prefix, after = self.read(at, PREFIX), at + PREFIX
        opcode, length = prefix[0], int.from_bytes(prefix[1:], "little")
        if not 0 < opcode <= Opcode.DATA_END:
            return False
        changed = (length ^ 1 << bit for bit in range(64))
        likely = (other for other in changed if _SHORTEST.get(opcode, 0) <= other <= self.size - after)
        return any(self._begins_records(after + other) for other in likely)

    def _resume(self, at: int) -> int:
        """
        Return the position at which reading continues after damage at `at`.

        This is the end of the damaged record if another record begins there, else the next record that is found.
        """
        try:
            after = at + PREFIX + int.from_bytes(self.read(at + 1, 8), "little")
            if after <= self.size and self._begins_records(after, first=False, cut_off=False):
                return after
        except FormatError:
            # The length of this record is part of the damage.
            after = at
        return self._next_record(at + 1)

    def _next_record(self, at: int) -> int:
        """
        Return the first position from `at` on where records follow one another.

        Return the end of the file if there is no such position.
        """
        while at + PREFIX <= self.size:
            window = np.frombuffer(self.read(at, min(_WINDOW, self.size - at)), dtype=np.uint8)
            count = len(window) - PREFIX + 1
            # A likely record has a known opcode and a length whose upper bytes are 0, as in every record below 4 GB.
            likely = (window[:count] > 0) & (window[:count] <= Opcode.DATA_END)
            for k in range(5, PREFIX):
                likely &= window[k : k + count] == 0
            for hit in np.flatnonzero(likely).tolist():
                if self._begins_records(at + hit):
                    return at + hit
            at += count
        return self.size

    def _begins_records(self, at: int, *, first: bool = True, cut_off: bool = True, steps: int = _FOLLOWING) -> bool:
        """
        Return whether `steps` valid records follow one another from `at` on, or fewer up to the end of the file.

        first : whether there is no other evidence that a record begins at `at`. The record must then be complete, and
        be a message, a chunk with its header, or followed by another record.
        cut_off : whether the last record may reach beyond the end of a truncated file.
        """
        cut_off, behind = cut_off and self._cut_off, 0
        end = self.size if self._cut_off else self.size - len(MAGIC)
        for step in range(steps):
            sure = first and step == 0
            if at == end:
                return not sure if self._cut_off else behind == Opcode.FOOTER
            try:
                prefix = self.read(at, min(PREFIX, max(self.size - at, 0)))
                opcode, length = prefix[0], int.from_bytes(prefix[1:], "little")
                if not 0 < opcode <= Opcode.DATA_END and opcode < _PRIVATE:
                    return False
                if len(prefix) < PREFIX:
                    return cut_off and not sure
                if not sure and (length ^ _FIXED.get(opcode, length)).bit_count() == 1:
                    # The wrong bit may be in the length of this record instead of the length of the previous record.
                    length = _FIXED[opcode]
                if length < _SHORTEST.get(opcode, 0) or length != _FIXED.get(opcode, length):
                    return False
                if opcode == Opcode.CHUNK and length <= self.size - at - PREFIX:
                    parse_chunk_head(self.read(at + PREFIX, min(_CHUNK_HEAD_BYTES, length)), length)
                    return True
            except (FormatError, IndexError):
                return False
            if length > self.size - at - PREFIX:
                return cut_off and length <= MAX_CHUNK_BYTES and not sure
            at, behind = at + PREFIX + length, opcode
        return True

    def _summary(self) -> Contents | None:
        tail = FOOTER_BYTES + len(MAGIC)
        foot = self.read(self.size - tail, tail) if self.size > tail else b""
        if foot[-len(MAGIC) :] != MAGIC or foot[:1] != bytes([Opcode.FOOTER]):
            raise FormatError("the file has no end: its recording was interrupted")
        start, crc = int.from_bytes(foot[9:17], "little"), int.from_bytes(foot[25:29], "little")
        if start == 0:
            return None
        end = self.size - tail
        if not 0 < start <= end:
            raise FormatError("the end of the file states a wrong position of the summary")
        data = self.read(start, end - start)
        if crc and zlib.crc32(foot[:25], zlib.crc32(data)) != crc:
            raise FormatError("the summary's checksum does not match")
        return self._from_summary(data)

    def _from_summary(self, data: bytes) -> Contents | None:
        found, messages = Contents(), None
        # Use the plain loop: a summary has few records, and loading the compiled loop would take longer.
        for opcode, body in records_in(data):
            if opcode == Opcode.SCHEMA:
                schema = parse(Schema, body)
                found.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = parse(Channel, body)
                found.channels[channel.id] = channel
            elif opcode == Opcode.CHUNK_INDEX:
                span = parse_span(body)
                if max(span.start_ns, span.end_ns) > _LATEST_NS:
                    raise FormatError("the summary has times after the year 2262")
                found.spans.append(span)
            elif opcode == Opcode.STATISTICS:
                totals = parse(Statistics, body)
                found.counts, messages = totals.channel_message_counts, totals.message_count
            elif opcode == Opcode.ATTACHMENT_INDEX:
                attached = parse(AttachmentIndex, body)
                found.attachments.append((attached.offset, attached.length))
            elif opcode == Opcode.METADATA_INDEX:
                table = parse(MetadataIndex, body)
                found.metadata.append((table.offset, table.length))
        if messages is None or (messages and not (found.spans and found.channels)):
            return None
        try:
            budgets.MCAP.check_ratio(self.size, sum(span.size for span in found.spans))
        except BudgetError as error:
            # An index may name one chunk many times, and so exceed the budget: scan the file, which stops in time.
            raise FormatError(f"the file {error}") from error
        if found.spans:
            first = self.body(found.spans[0].offset, Opcode.CHUNK)
            found.checksums = parse_chunk_head(first, len(first)).crc != 0
        return found

    def _scanned(self, reason: str) -> Contents:
        found, ended = Contents(scanned=True), False
        if reason:
            found.notes.append(f"{self.path.name}: {reason}; read from its beginning instead")
        else:
            found.notes.append(f"{self.path.name}: has no index; read from its beginning instead")
        guarded: dict[int, Channel] = {}
        for piece in self.scan():
            if isinstance(piece, Damage):
                found.notes.append(
                    f"{self.path.name}: bytes {piece.offset} to {piece.end} of {self.size} skipped: {piece.reason}"
                )
                found.complete = False
            elif isinstance(piece, Other):
                self._note_other(piece, found, guarded)
                if piece.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    ended = True
                    self._note_repeated(piece.offset + piece.length, found)
            else:
                self._note_messages(piece, found, guarded)
        found.complete = found.complete and ended
        return found

    def _note_other(self, piece: Other, found: Contents, guarded: dict[int, Channel]) -> None:
        try:
            if piece.opcode == Opcode.SCHEMA:
                schema = parse(Schema, piece.body)
                found.schemas.setdefault(schema.id, schema)
            elif piece.opcode == Opcode.CHANNEL:
                channel = parse(Channel, piece.body)
                if channel.id not in guarded:
                    found.channels[channel.id] = channel
            elif piece.opcode == Opcode.ATTACHMENT:
                found.attachments.append((piece.offset, piece.length))
            elif piece.opcode == Opcode.METADATA:
                found.metadata.append((piece.offset, piece.length))
        except FormatError as error:
            found.notes.append(f"{self.path.name}: a record at byte {piece.offset} skipped: {error}")

    def _note_repeated(self, at: int, found: Contents) -> None:
        """
        Add the schemas and channels that were lost in damaged parts.

        They are read from the summary at byte `at`, which repeats all schemas and channels.
        """
        lost = Contents()
        with contextlib.suppress(FormatError):
            while at < self.size - len(MAGIC):
                piece = self._piece(at, Decompressor())
                at = piece.offset + piece.length
                if isinstance(piece, Other) and piece.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._note_other(piece, lost, {})
        found.schemas = lost.schemas | found.schemas
        found.channels = lost.channels | found.channels

    def _note_messages(self, piece: Chunk | Bare, found: Contents, guarded: dict[int, Channel]) -> None:
        walk, in_chunk = piece.walk, isinstance(piece, Chunk)
        if isinstance(piece, Chunk):
            found.checksums = found.checksums and piece.head.crc != 0
            schemas, channels = declarations(piece)
            # Data with a checksum has precedence over data without.
            found.schemas.update(schemas)
            found.channels.update(channels)
            guarded.update(channels)
        else:
            found.checksums = False
        if len(walk.log_ns) == 0:
            return
        numbers, counts = np.unique(walk.channel, return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            found.counts[number] = found.counts.get(number, 0) + count
        found.spans.append(
            MessageSpan(
                int(walk.log_ns.min()),
                int(walk.log_ns.max()),
                piece.offset,
                piece.length,
                len(piece.plain),
                frozenset(numbers.tolist()),
                in_chunk,
            )
        )


def declarations(piece: Chunk) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Return the schemas and channels inside a chunk, by id; records that cannot be parsed are left out."""
    schemas, channels = {}, {}
    for opcode, body in records_at(np.frombuffer(piece.plain, dtype=np.uint8), piece.walk.others):
        try:
            if opcode == Opcode.SCHEMA:
                schema = parse(Schema, body)
                schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = parse(Channel, body)
                channels[channel.id] = channel
        except FormatError:
            # The record was already wrong when it was written, because the checksum of the chunk matches. Its messages
            # have no topic.
            continue
    return schemas, channels

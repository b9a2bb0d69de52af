"""
A bag as arrays: blocks of samples in time order, in constant memory, at the speed of decompression.

Chunks of MCAP files are decompressed and decoded ahead in a thread, their messages gathered as rows without touching
them one by one. What that way cannot read (sqlite3 storage, messages compressed singly, big-endian or odd messages)
goes through `rosbags` by itself, and `Bag.notes` says so.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader as RosbagsReader

from mwd_sensors.core.arrays import Stamps
from mwd_surface.bags.bag_files import BagError, BagFiles, TopicInfo
from mwd_surface.bags.mcap import format as mcap_format
from mwd_surface.bags.mcap.format import Attachment, FormatError
from mwd_surface.bags.mcap.index import Span
from mwd_surface.bags.message_parts import NEVER, Block, Decoded, Originals, Part, blocks_of, part_of
from mwd_surface.bags.sample_decoder import Fields, SampleDecoder

# What a reader of bags needs, from one place.
__all__ = ["Bag", "BagError", "Block", "Message", "Originals", "TopicInfo"]

Message = tuple[int, str, str, bytes]
M = TypeVar("M", Part, Decoded)

_AHEAD = 4
_AHEAD_BYTES = 64 * 1024 * 1024


class Bag:
    """
    A recording opened for reading: a rosbag2 directory, or a bare ``.mcap`` or ``.db3`` file.

    Parameters
    ----------
    path : Path or str

    Attributes
    ----------
    topics : dict of str to TopicInfo
    start_ns, end_ns : int
        Log time of the first and of the last message; both 0 when there is none.
    notes : list of str
        What was unusual or damaged, one sentence each; grows while reading.
    files : list of Path
        The files read, as they lie on the disk.
    size_bytes : int
        Of these files.
    storage : str
        ``mcap`` or ``sqlite3``.
    custom : dict of str
        ``custom_data`` of metadata.yaml.
    complete : bool
        False for a recording that was cut off or is damaged, as far as known.

    Raises
    ------
    BagError
        There is nothing at `path`, it is no bag, or it holds no message.
    """

    def __init__(self, path: Path | str) -> None:
        self._opened = opened = BagFiles(Path(path))
        self.path, self.topics, self.notes, self.custom = opened.path, opened.topics, opened.notes, opened.custom
        self.start_ns, self.end_ns = opened.start_ns, opened.end_ns
        self.files, self.size_bytes, self.storage = opened.files, opened.size_bytes, opened.storage
        self.complete = opened.complete
        self._told: set[str] = set()
        self._decoder = SampleDecoder(self.topics, opened.message_compression, self._tell)

    @property
    def damaged_messages(self) -> int:
        """Skipped while reading because a layout or the compression was wrong."""
        return self._decoder.damaged

    @property
    def message_count(self) -> int:
        """Messages in all topics, as the bag's index says."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def find_topic(self, type_name: str, suffix: str = "") -> str:
        """
        The topic of a type whose name ends like this, in whatever namespace.

        suffix : relative name, for example ``imu/data_raw``, matched from a slash on; empty matches every name.

        Raises
        ------
        BagError
            There is none, or more than one; both list what there is.
        """
        tail = suffix.strip("/")
        of_type = [topic for topic in self.topics.values() if topic.type_name == type_name]
        found = [topic.name for topic in of_type if not tail or ("/" + topic.name.strip("/")).endswith("/" + tail)]
        if len(found) == 1:
            return found[0]
        if found:
            raise BagError(
                f"{self.path} has {len(found)} topics of {type_name} that end in {tail!r}: {', '.join(found)}",
                "name the one you mean",
            )
        wanted = f"that ends in {tail!r}" if tail else ""
        if of_type:
            hint = f"topics of that type: {', '.join(topic.name for topic in of_type)}; name the one you mean"
        else:
            hint = f"it has {', '.join(f'{topic.name} ({topic.type_name})' for topic in self.topics.values())}"
        raise BagError(f"{self.path} has no topic of {type_name} {wanted}".rstrip(), hint)

    def blocks(
        self,
        topics: Sequence[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        block_messages: int = 16384,
        fields: Fields | None = None,
    ) -> Iterator[Block]:
        """
        Samples in log-time order, block by block, in constant memory.

        Parameters
        ----------
        topics : sequence of str, optional
            Names as in `topics`; by default all.
        start_ns, end_ns : int, optional
            Log time from (inclusive) and to (exclusive).
        block_messages : int
            A block ends after about so many messages of all topics together.
        fields : mapping of str to tuple of str, optional
            By type name, which fields to read besides the stamp; types that are not named are read whole.

        Yields
        ------
        dict of str to (log_ns, samples)
            Only topics with a message in the block. log_ns, shape (n,), int64, not decreasing. Samples: a structured
            array of the type's layout in `wire.LAYOUTS`, or a list of bytes for types without one (see `decode`).
            A topic of bursts gives the samples they carry.
            Everything in one block was logged before, or at the same time as, everything in the next.

        Raises
        ------
        BagError
            A topic the bag doesn't have.
        """
        wanted = self._checked(topics)
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        count = 0

        def decoded(part: Part) -> Decoded:
            return Decoded(part.rank, list(self._decoder.samples(part, self._part_names(part), fields or {})))

        for group in self._groups(wanted, start_ns, end_ns, decoded):
            for one in group:
                for name, log_ns, samples in one.samples:
                    pieces.setdefault(name, []).append((log_ns, samples))
                count += len(one)
            if count >= block_messages:
                yield from blocks_of(pieces, block_messages)
                pieces, count = {}, 0
        if count:
            yield from blocks_of(pieces, block_messages)

    def blocks_and_originals(
        self,
        topics: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
        block_messages: int = 16384,
        fields: Fields | None = None,
    ) -> Iterator[tuple[Block, list[Originals]]]:
        """
        As `blocks`, and with each block every message of the bag of its time, those of other topics too, as it lies.

        A block has no upper size but that of the chunks of one time, and may be without a sample.
        """
        wanted = set(self._checked(topics))
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        originals: list[Originals] = []
        count = 0
        for group in self._groups(list(self.topics), start_ns, end_ns, lambda part: part):
            for part in group:
                for name, log_ns, samples in self._decoder.samples(part, self._part_names(part), fields or {}, wanted):
                    pieces.setdefault(name, []).append((log_ns, samples))
                originals.append(self._originals(part))
                count += len(part.log_ns)
            if count >= block_messages:
                yield next(blocks_of(pieces, NEVER), {}), originals
                pieces, originals, count = {}, [], 0
        if count:
            yield next(blocks_of(pieces, NEVER), {}), originals

    def messages(
        self, topics: Sequence[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Message]:
        """
        (log_ns, topic, type, bytes) of every message in log-time order, in constant memory.

        Messages with the same log time come in the order of the file. Arguments and errors as `blocks`.
        """
        wanted = self._checked(topics)
        for group in self._groups(wanted, start_ns, end_ns, lambda part: part):
            yield from self._in_order(group)

    def decode(self, topic: str, data: bytes) -> Any:
        """
        A message as an object with the fields of its type.

        Raises
        ------
        BagError
            The type is unknown here and in the bag, or the bytes are not of it.
        """
        return self._decoder.decode(topic, data)

    def attachments(self) -> list[Attachment]:
        """Files kept inside the bag; damaged ones are noted and left out."""
        return [mcap_format.parse_attachment(body) for body in self._extra("attachments", mcap_format.ATTACHMENT)]

    def metadata(self) -> dict[str, dict[str, str]]:
        """Named tables kept inside the bag; a later file's table of the same name replaces an earlier one's."""
        return dict(mcap_format.parse_metadata(body) for body in self._extra("metadata", mcap_format.METADATA))

    def close(self) -> None:
        """Close the files."""
        self._opened.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _checked(self, topics: Sequence[str] | None) -> list[str]:
        if topics is None:
            return list(self.topics)
        for name in topics:
            if name not in self.topics:
                raise BagError(f"{self.path} has no topic {name}", f"it has {', '.join(self.topics)}")
        return list(topics)

    def _groups(
        self, topics: list[str], start_ns: int | None, end_ns: int | None, made: Callable[[Part], M]
    ) -> Iterator[list[M]]:
        """Groups of what is made of each part: everything in one is logged no later than everything in the next."""
        start, end = start_ns or 0, NEVER if end_ns is None else end_ns
        if self._opened.rosbags is not None:
            for part in self._rosbags_parts(self._opened.rosbags, topics, start, end):
                yield [made(part)]
            return
        chosen: list[tuple[int, Span]] = []
        for number, (_, contents) in enumerate(self._opened.mcap):
            channels = {key for key, name in self._opened.names[number].items() if name in topics}
            for span in contents.spans:
                inside = span.end_ns >= start and span.start_ns < end
                if inside and (span.channels is None or not channels.isdisjoint(span.channels)):
                    chosen.append((number, span))
        chosen.sort(key=lambda item: (item[1].start_ns, item[0], item[1].offset))
        pending: list[M] = []
        for k, one in enumerate(self._ahead(chosen, topics, start, end, made)):
            if one is not None:
                pending.append(one)
            mark = chosen[k + 1][1].start_ns if k + 1 < len(chosen) else NEVER
            released, kept = [], []
            for waiting in pending:
                early, late = waiting.split(mark)
                if len(early):
                    released.append(early)
                if len(late):
                    kept.append(late)
            pending = kept
            if released:
                yield sorted(released, key=lambda one: one.rank)

    def _ahead(
        self, chosen: list[tuple[int, Span]], topics: list[str], start: int, end: int, made: Callable[[Part], M]
    ) -> Iterator[M | None]:
        """What is made of the parts of the chosen spans, loaded by a thread a few spans ahead of their use."""
        waiting: deque[tuple[concurrent.futures.Future[M], int]] = deque()
        wanted = []
        for names in self._opened.names:
            mask = np.zeros(65536, dtype=np.bool_)
            mask[[number for number, name in names.items() if name in topics]] = True
            wanted.append(mask)
        # One thread: it keeps ahead of any consumer, and a second one costs more in contended memory than it brings.
        pool = concurrent.futures.ThreadPoolExecutor(1, thread_name_prefix="bag")
        decompress = mcap_format.Decompressor()

        def load(number: int, span: Span) -> M:
            # While its bytes are at hand: later they would have to come from memory once more.
            return made(self._load(decompress, number, span, wanted[number], start, end))

        try:
            position, held = 0, 0
            while position < len(chosen) or waiting:
                while position < len(chosen) and len(waiting) < _AHEAD and (not waiting or held < _AHEAD_BYTES):
                    number, span = chosen[position]
                    waiting.append((pool.submit(load, number, span), span.size))
                    held += span.size
                    position += 1
                future, size = waiting.popleft()
                held -= size
                try:
                    yield future.result()
                except (FormatError, MemoryError) as error:
                    self.complete = False
                    self.notes.append(f"a damaged chunk was skipped: {error}")
                    yield None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _load(
        self,
        decompress: mcap_format.Decompressor,
        number: int,
        span: Span,
        wanted: NDArray[np.bool_],
        start: int,
        end: int,
    ) -> Part:
        data = np.frombuffer(self._opened.mcap[number][0].plain(span, decompress), dtype=np.uint8)
        walk = mcap_format.walk(data)
        if walk.end != len(data):
            raise FormatError(f"a chunk's records end at byte {walk.end} of {len(data)}")
        part = Part((number, span.offset), number, data, walk.log_ns, walk.offset, walk.size, walk.channel)
        chosen = wanted[walk.channel]
        if start > 0 or end < NEVER:
            chosen &= (walk.log_ns >= start) & (walk.log_ns < end)
        if not chosen.all():
            part = part.at(chosen)
        if len(part.log_ns) and (part.log_ns[1:] < part.log_ns[:-1]).any():
            part = part.at(np.argsort(part.log_ns, kind="stable"))
        return part

    def _in_order(self, group: list[Part]) -> Iterator[Message]:
        which = np.concatenate([np.full(len(part.log_ns), k) for k, part in enumerate(group)])
        inside = np.concatenate([np.arange(len(part.log_ns)) for part in group])
        order = np.argsort(np.concatenate([part.log_ns for part in group]), kind="stable")
        views = [memoryview(part.data) for part in group]  # type: ignore[arg-type]
        tables = [
            (part.log_ns.tolist(), part.offset.tolist(), part.size.tolist(), part.channel.tolist()) for part in group
        ]
        names = [self._part_names(part) for part in group]
        for k, row in zip(which[order].tolist(), inside[order].tolist(), strict=True):
            log_ns, offset, size, channel = tables[k]
            at = offset[row]
            name = names[k][channel[row]]
            data = bytes(views[k][at : at + size[row]])
            if self._opened.message_compression:
                unpacked = self._decoder.unzipped(data)
                if unpacked is None:
                    continue
                data = unpacked
            yield log_ns[row], name, self.topics[name].type_name, data

    def _part_names(self, part: Part) -> Mapping[int, str]:
        return self._opened.names[part.file] if self._opened.rosbags is None else dict(enumerate(self.topics))

    def _originals(self, part: Part) -> Originals:
        if self._opened.message_compression:
            rows = []
            for log_ns, at, size, channel in zip(part.log_ns, part.offset, part.size, part.channel, strict=True):
                data = self._decoder.unzipped(part.data[at : at + size].tobytes())
                if data is not None:
                    rows.append((int(log_ns), int(channel), data))
            plain = part_of(rows)
            part = dataclasses.replace(plain, rank=part.rank, file=part.file)
        places = {name: place for place, name in enumerate(self.topics)}
        table = np.zeros(65536, dtype=np.int64)
        for channel, name in self._part_names(part).items():
            table[channel] = places[name]
        framed = self._opened.rosbags is None and not self._opened.message_compression
        return Originals(part.data, part.log_ns, part.offset, part.size, table[part.channel], framed)

    def _rosbags_parts(self, reader: RosbagsReader, topics: list[str], start: int, end: int) -> Iterator[Part]:
        numbers = {name: number for number, name in enumerate(self.topics)}
        connections = [one for one in reader.connections if one.topic in topics]
        rows: list[tuple[int, int, bytes]] = []
        try:
            for connection, log_ns, data in reader.messages(connections, start or None, end if end < NEVER else None):
                rows.append((log_ns, numbers[connection.topic], bytes(data)))
                if len(rows) >= 4096:
                    yield part_of(rows)
                    rows = []
        except Exception as error:  # noqa: BLE001  (sqlite, rosbags and zstd each raise their own kinds)
            self.complete = False
            self.notes.append(f"reading stopped early: {error}")
        if rows:
            yield part_of(rows)

    def _extra(self, kind: str, opcode: int) -> Iterator[bytes]:
        for file, contents in self._opened.mcap:
            for offset, _ in getattr(contents, kind):
                try:
                    body = file.body(offset, opcode)
                    if opcode == mcap_format.ATTACHMENT:
                        mcap_format.parse_attachment(body)
                    else:
                        mcap_format.parse_metadata(body)
                except FormatError as error:
                    self._tell(f"one of the {kind} is damaged and left out: {error}")
                    continue
                yield body

    def _tell(self, note: str) -> None:
        # One note per kind and topic, not one per message.
        key = note.split("(")[0].split(": it ")[0][:80]
        if key not in self._told:
            self._told.add(key)
            self.notes.append(note)

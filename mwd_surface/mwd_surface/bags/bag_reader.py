# SPDX-License-Identifier: Apache-2.0
"""
Reading a bag as arrays: blocks of samples in time order, in constant memory, at the speed of decompression.

Messages are gathered as rows of arrays. sqlite3 storage, messages compressed one by one, and big-endian or irregular
messages are read through `rosbags`, which is slower; `Bag.notes` then has a remark on the reason.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import functools
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Stamps
from mwd_sensors.core.foreign_text import first_of
from mwd_surface.bags.bag_files import BagError, BagFiles, TopicInfo
from mwd_surface.bags.definitions import is_ours
from mwd_surface.bags.mcap.contents import MessageSpan, parse, parse_attachment
from mwd_surface.bags.mcap.records import Decompressor, FormatError
from mwd_surface.bags.mcap.walk import walk_records
from mwd_surface.bags.message_parts import NEVER, Block, MessagePart, blocks_of, part_of
from mwd_surface.bags.sample_decoder import Fields, SampleDecoder
from mwd_surface.bags.topic_info import REMEDY, listed, quantity_of, ros2_types

# Parts of the files in time order. A thread decompresses and decodes chunks of MCAP files ahead of their use; other
# storage is read through `rosbags`.

_AHEAD = 4  # number of spans loaded ahead of their use
_AHEAD_BYTES = 64 * 1024 * 1024  # largest decompressed size of these spans


class PartStream:
    """
    Reader of the parts of an opened bag.

    topics : mapping of str to TopicInfo
        All topics of the bag; in storage other than MCAP, the position of a topic is its channel number.
    on_damage : callable
        Called with a sentence for each damage found while reading.
    """

    def __init__(self, opened: BagFiles, topics: Mapping[str, TopicInfo], on_damage: Callable[[str], None]) -> None:
        self._opened, self._topics, self._on_damage = opened, topics, on_damage

    def groups(self, topics: list[str], start_ns: int | None, end_ns: int | None) -> Iterator[list[MessagePart]]:
        """
        Yield, in groups, the parts with messages of the given topics and log times.

        start_ns, end_ns : log time from (inclusive) and to (exclusive). No message of a group was logged later than
        any message of the next group.
        """
        start, end = start_ns or 0, NEVER if end_ns is None else end_ns
        if self._opened.other is not None:
            for part in self._other_parts(topics, start, end):
                yield [part]
            return
        chosen: list[tuple[int, MessageSpan]] = []
        for number, file in enumerate(self._opened.mcap):
            channels = {key for key, name in file.names.items() if name in topics}
            for span in file.contents.spans:
                inside = span.end_ns >= start and span.start_ns < end
                if inside and (span.channels is None or not channels.isdisjoint(span.channels)):
                    chosen.append((number, span))
        chosen.sort(key=lambda item: (item[1].start_ns, item[0], item[1].offset))
        pending: list[MessagePart] = []
        for k, one in enumerate(self._ahead(chosen, topics, start, end)):
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
        self,
        chosen: list[tuple[int, MessageSpan]],
        topics: list[str],
        start: int,
        end: int,
    ) -> Iterator[MessagePart | None]:
        """Yield the part of each chosen span, None if it is damaged; a thread loads a few spans ahead."""
        waiting: deque[tuple[concurrent.futures.Future[MessagePart], int]] = deque()
        wanted = []
        for file in self._opened.mcap:
            mask = np.zeros(65536, dtype=np.bool_)
            mask[[number for number, name in file.names.items() if name in topics]] = True
            wanted.append(mask)
        # Use one thread: a second one loses more to competition for memory bandwidth than it gains.
        pool = concurrent.futures.ThreadPoolExecutor(1, thread_name_prefix="bag")
        decompress = Decompressor()

        try:
            position, held = 0, 0
            while position < len(chosen) or waiting:
                while position < len(chosen) and len(waiting) < _AHEAD and (not waiting or held < _AHEAD_BYTES):
                    number, span = chosen[position]
                    loaded = pool.submit(self._load, decompress, number, span, wanted[number], start, end)
                    waiting.append((loaded, span.size))
                    held += span.size
                    position += 1
                future, size = waiting.popleft()
                held -= size
                try:
                    yield future.result()
                except (FormatError, MemoryError) as error:
                    self._on_damage(f"a damaged chunk was skipped: {error}")
                    yield None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _load(
        self,
        decompress: Decompressor,
        number: int,
        span: MessageSpan,
        wanted: NDArray[np.bool_],
        start: int,
        end: int,
    ) -> MessagePart:
        data = np.frombuffer(self._opened.mcap[number].file.plain(span, decompress), dtype=np.uint8)
        walk = walk_records(data)
        if walk.end != len(data):
            raise FormatError(f"a chunk's records end at byte {walk.end} of {len(data)}")
        if walk.impossible:
            self._on_damage(f"{walk.impossible} messages were left out, because their time is impossible")
        part = MessagePart((number, span.offset), number, data, walk.log_ns, walk.offset, walk.size, walk.channel)
        chosen = wanted[walk.channel]
        if start > 0 or end < NEVER:
            chosen &= (walk.log_ns >= start) & (walk.log_ns < end)
        if not chosen.all():
            part = part.at(chosen)
        if len(part.log_ns) and (part.log_ns[1:] < part.log_ns[:-1]).any():
            part = part.at(np.argsort(part.log_ns, kind="stable"))
        return self._from_ros1(part, number) if self._opened.mcap[number].ros1 else part

    def _from_ros1(self, part: MessagePart, number: int) -> MessagePart:
        """
        Return a part with its ROS 1 messages converted to the encoding of ROS 2.

        Messages that cannot be converted are reported and left out.
        """
        types = self._opened.mcap[number].ros1
        rows: list[tuple[int, int, bytes]] = []
        failed: dict[str, tuple[int, Exception]] = {}
        for log_ns, at, size, channel in zip(
            part.log_ns.tolist(), part.offset.tolist(), part.size.tolist(), part.channel.tolist(), strict=True
        ):
            data = part.data[at : at + size].tobytes()
            if channel in types:
                try:
                    data = bytes(ros2_types().ros1_to_cdr(data, types[channel]))
                except Exception as error:  # noqa: BLE001  (a decoder may raise any error on damaged bytes)
                    name = self._opened.mcap[number].names[channel]
                    failed[name] = failed.get(name, (0, error))[0] + 1, error
                    continue
            rows.append((log_ns, channel, data))
        for name, (count, reason) in failed.items():
            self._on_damage(f"{count} messages of {name} are not in the encoding of ROS 1 and are left out: {reason}")
        return dataclasses.replace(part_of(rows), rank=part.rank, file=part.file)

    def _other_parts(self, topics: list[str], start: int, end: int) -> Iterator[MessagePart]:
        """Yield the parts of a bag whose storage is not MCAP; an error ends the reading and is reported."""
        numbers = {name: number for number, name in enumerate(self._topics)}
        rows: list[tuple[int, int, bytes]] = []
        if self._opened.other is None:
            return
        try:
            for name, log_ns, data in self._opened.other.messages(topics, start or None, end if end < NEVER else None):
                rows.append((_checked_time(log_ns), numbers[name], bytes(data)))
                if len(rows) >= 4096:
                    yield part_of(rows)
                    rows = []
        except Exception as error:  # noqa: BLE001  (sqlite, rosbags and zstd each raise their own kinds)
            self._on_damage(f"reading stopped early: {error}")
        if rows:
            yield part_of(rows)


def _checked_time(log_ns: object) -> int:
    # A column of sqlite may hold a value of any type.
    if not isinstance(log_ns, int) or not 0 <= log_ns < NEVER:
        raise FormatError(f"the time of a message is {log_ns!r}, which is not a time in ns since 1970")
    return log_ns


# Types that users of a bag need can be imported from this module.
__all__ = ["Bag", "BagError", "Block", "Message", "MessagePart", "TopicInfo"]

E = TypeVar("E", Attachment, Metadata)

# Log time in ns, topic, type and bytes of a message.
Message = tuple[int, str, str, bytes]


class Bag(BagFiles):
    """
    A recording opened for reading: a rosbag2 directory, a bare ``.mcap`` or ``.db3`` file, or a ``.bag`` of ROS 1.

    Raises
    ------
    BagError
        `path` does not exist, is not a bag, or holds no message.
    """

    def __init__(self, path: Path | str) -> None:
        super().__init__(Path(path))
        for about in list(self.topics.values()):
            if about.type_name.startswith("mwd_msgs/") and not is_ours(about.type_name, about.type_hash, about.schema):
                problem = "it was recorded with another definition of this type"
                self.unreadable[about.name] = dataclasses.replace(self.topics.pop(about.name), problem=problem)
        for name, about in self.topics.items():
            if about.type_name == wire.VECTOR.type_name:
                self.topics[name] = dataclasses.replace(about, quantity=quantity_of(name))
        self._noted: set[str] = set()
        self._decoder = SampleDecoder(self.topics, self.message_compression, self._note_once)
        self._stream = PartStream(self, self.carried, self._note_damage)

    @property
    def message_count(self) -> int:
        """Number of messages in all topics, from the index of the bag."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def carried(self) -> dict[str, TopicInfo]:
        """Topics that a copy of the bag contains; topics of an MCAP file that cannot be read are copied unchanged."""
        return self.topics | self.unreadable if self.storage == "mcap" else self.topics

    def unread(self, *type_names: str) -> str:
        """Return a text that lists the unreadable topics of the given types, with the reasons; "" if there are none."""
        return listed([one for one in self.unreadable.values() if one.count and one.type_name in type_names])

    def find_topic(self, type_name: str, suffix: str = "") -> str:
        """
        Return the only topic of a type whose name ends with a suffix, in any namespace.

        suffix : relative name, for example ``imu/data_raw``, that must follow a slash; "" matches every name.

        Raises
        ------
        BagError
            No topic or several topics match; the message lists the candidates.
        """
        tail = suffix.strip("/")
        of_type = [topic for topic in self.topics.values() if topic.type_name == type_name]
        found = [topic.name for topic in of_type if not tail or ("/" + topic.name.strip("/")).endswith("/" + tail)]
        if len(found) == 1:
            return found[0]
        if found:
            raise BagError(
                f"{self.path} has {len(found)} topics of {type_name} that end in {tail!r}: {first_of(found)}",
                "name the one you mean",
            )
        wanted = f"that ends in {tail!r}" if tail else ""
        if unread := self.unread(type_name):
            raise BagError(f"{self.path} has no topic of {type_name} that can be read: {unread}", REMEDY)
        if of_type:
            hint = f"topics of that type: {first_of([topic.name for topic in of_type])}; name the one you mean"
        else:
            there = [f"{topic.name} ({topic.type_name or 'no type'})" for topic in self.topics.values()]
            hint = f"it has {first_of(there)}"
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
        Yield samples in log-time order, block by block, in constant memory.

        Parameters
        ----------
        topics : sequence of str, optional
            Names of topics, as in the attribute `topics`; by default all.
        start_ns, end_ns : int, optional
            Log time from (inclusive) and to (exclusive).
        block_messages : int
            Approximate number of messages per block, of all topics together.
        fields : mapping of str to tuple of str, optional
            By type name, the fields to read in addition to the stamp; types not named here are read completely.

        Yields
        ------
        dict of str to (log_ns, samples)
            Only topics with a message in the block. log_ns, shape (n,), int64, not decreasing. Samples: a structured
            array of the type's layout in `wire.LAYOUTS`, or a list of bytes for types without a layout (see `decode`).
            A topic of bursts yields the samples inside the bursts. A topic of vectors whose quantity is known yields
            samples of an IMU or a magnetometer. Every message of a block was logged before, or at the same time as,
            every message of the next block.

        Raises
        ------
        BagError
            A topic does not exist in the bag.
        """
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        count = 0
        for group in self._stream.groups(self._checked(topics), start_ns, end_ns):
            for part in group:
                count += self._add_samples(pieces, part, fields)
            if count >= block_messages:
                yield from filter(None, blocks_of(pieces, block_messages))
                pieces, count = {}, 0
        if count:
            yield from filter(None, blocks_of(pieces, block_messages))

    def blocks_and_originals(
        self,
        topics: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
        block_messages: int = 16384,
        fields: Fields | None = None,
    ) -> Iterator[tuple[Block, list[MessagePart]]]:
        """
        Yield blocks of samples like `blocks`, each with the unchanged messages of all topics in the block's time span.

        The channel number of an unchanged message is the position of its topic in `carried`.

        Each block but the last has at least `block_messages` messages of all topics, and more if many chunks overlap in
        time. A block may have no sample. Arguments and errors as in `blocks`.
        """
        wanted = set(self._checked(topics))
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        originals: list[MessagePart] = []
        count = 0
        for group in self._stream.groups(list(self.carried), start_ns, end_ns):
            for part in group:
                self._add_samples(pieces, part, fields, wanted)
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
        Yield (log_ns, topic, type, bytes) of every message in log-time order, in constant memory.

        Messages with the same log time come in the order of the file. Arguments and errors as in `blocks`.
        """
        wanted = self._checked(topics)
        for group in self._stream.groups(wanted, start_ns, end_ns):
            yield from self._in_order(group)

    def use_frame(self, topic: str, frame: str) -> None:
        """
        Decode to samples only those messages of a topic whose header has this frame; for a topic of several units.

        This has no effect on `messages`, nor in a recording whose messages are compressed one by one.
        """
        self._decoder.frames[topic] = frame

    @property
    def frames_used(self) -> Mapping[str, str]:
        """Frame of each topic that `use_frame` restricts to one frame."""
        return self._decoder.frames

    def decode(self, topic: str, data: bytes) -> Any:
        """
        Return a message as an object with the fields of its type.

        Raises
        ------
        BagError
            The type is unknown here and in the bag, or the bytes are not a message of the type.
        """
        return self._decoder.decode(topic, data)

    def attachments(self) -> list[Attachment]:
        """Return the files stored inside the bag; damaged files are noted and left out."""
        return list(self._extra("attachments", Opcode.ATTACHMENT, parse_attachment))

    def metadata(self) -> dict[str, dict[str, str]]:
        """
        Return the named tables stored inside the bag.

        If several files of the bag have a table of the same name, the table in the last file is returned.
        """
        tables = self._extra("metadata", Opcode.METADATA, functools.partial(parse, Metadata))
        return {table.name: table.metadata for table in tables}

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _checked(self, topics: Sequence[str] | None) -> list[str]:
        if topics is None:
            return list(self.topics)
        for name in topics:
            if name in self.unreadable:
                raise BagError(f"{self.path}: {self.unreadable[name].described()}", REMEDY)
            if name not in self.topics:
                raise BagError(f"{self.path} has no topic {name}", f"it has {first_of(list(self.topics))}")
        return list(topics)

    def _add_samples(
        self,
        pieces: dict[str, list[tuple[Stamps, Any]]],
        part: MessagePart,
        fields: Fields | None,
        wanted: set[str] | None = None,
    ) -> int:
        """Add the samples of a part, of all or of the wanted topics, to the pieces; return their number."""
        count = 0
        for name, log_ns, samples in self._decoder.samples(part, self._part_names(part), fields or {}, wanted):
            pieces.setdefault(name, []).append((log_ns, samples))
            count += len(log_ns)
        return count

    def _in_order(self, group: list[MessagePart]) -> Iterator[Message]:
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
            if self.message_compression:
                unpacked = self._decoder.unzipped(data)
                if unpacked is None:
                    continue
                data = unpacked
            yield log_ns[row], name, self.carried[name].type_name, data

    def _part_names(self, part: MessagePart) -> Mapping[int, str]:
        return self.mcap[part.file].names if self.other is None else dict(enumerate(self.carried))

    def _originals(self, part: MessagePart) -> MessagePart:
        if self.message_compression:
            rows = []
            for log_ns, at, size, channel in zip(part.log_ns, part.offset, part.size, part.channel, strict=True):
                data = self._decoder.unzipped(part.data[at : at + size].tobytes())
                if data is not None:
                    rows.append((int(log_ns), int(channel), data))
            plain = part_of(rows)
            part = dataclasses.replace(plain, rank=part.rank, file=part.file)
        places = {name: place for place, name in enumerate(self.carried)}
        table = np.zeros(65536, dtype=np.uint16)
        for channel, name in self._part_names(part).items():
            table[channel] = places[name]
        return dataclasses.replace(part, channel=table[part.channel])

    def _extra(self, kind: str, opcode: int, parser: Callable[[bytes], E]) -> Iterator[E]:
        for opened in self.mcap:
            for offset, _ in getattr(opened.contents, kind):
                try:
                    yield parser(opened.file.body(offset, opcode))
                except FormatError as error:
                    self._note_once(f"one of the {kind} is damaged and left out: {error}")

    def _note_damage(self, note: str) -> None:
        self.complete = False
        self.notes.append(note)

    def _note_once(self, note: str) -> None:
        # Keep one note per kind and topic, not one per message.
        key = note.split("(")[0].split(": it ")[0][:80]
        if key not in self._noted:
            self._noted.add(key)
            self.notes.append(note)

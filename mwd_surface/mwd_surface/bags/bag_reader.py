# SPDX-License-Identifier: Apache-2.0
"""
A bag as arrays: blocks of samples in time order, in constant memory, at the speed of decompression.

Messages are gathered as rows of arrays. sqlite3 storage, messages compressed singly, and big-endian or irregular
messages are read through `rosbags`, and `Bag.notes` says so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Stamps
from mwd_surface.bags.bag_files import BagError, BagFiles, TopicInfo
from mwd_surface.bags.definitions import is_ours
from mwd_surface.bags.mcap.decode import parse_attachment, parse_metadata
from mwd_surface.bags.mcap.records import Attachment, FormatError, Opcode
from mwd_surface.bags.message_parts import NEVER, Block, Decoded, Originals, Part, blocks_of, part_of
from mwd_surface.bags.part_stream import PartStream
from mwd_surface.bags.sample_decoder import Fields, SampleDecoder
from mwd_surface.bags.topic_info import REMEDY, listed, quantity_of

# Types that users of a bag need, importable from here.
__all__ = ["Bag", "BagError", "Block", "Message", "Originals", "TopicInfo"]

Message = tuple[int, str, str, bytes]


class Bag:
    """
    A recording opened for reading: a rosbag2 directory, a bare ``.mcap`` or ``.db3`` file, or a ``.bag`` of ROS 1.

    Parameters
    ----------
    path : Path or str

    Attributes
    ----------
    topics : dict of str to TopicInfo
        Those whose messages can be read.
    unreadable : dict of str to TopicInfo
        Those whose messages are in an encoding that cannot be read here; each says why.
    start_ns, end_ns : int
        Log time of the first and of the last message; both 0 when there is none.
    notes : list of str
        What was unusual or damaged, one sentence each; grows while reading.
    files : list of Path
        The files read, as they lie on the disk.
    size_bytes : int
        Of these files.
    storage : str
        ``mcap``, ``sqlite3`` or ``ros1``.
    custom : dict of str
        ``custom_data`` of metadata.yaml.
    complete : bool
        False for a recording that was cut off or is damaged, as far as known.
    lost_bytes : int
        Bytes of a ROS 1 recording behind the place where its reading ended.

    Raises
    ------
    BagError
        There is nothing at `path`, it is no bag, or it holds no message.
    """

    def __init__(self, path: Path | str) -> None:
        self._opened = opened = BagFiles(Path(path))
        self.path, self.topics, self.notes, self.custom = opened.path, opened.topics, opened.notes, opened.custom
        self.unreadable = opened.unreadable
        for about in list(self.topics.values()):
            if about.type_name.startswith("mwd_msgs/") and not is_ours(about.type_name, about.type_hash, about.schema):
                problem = "it was recorded with another definition of this type"
                self.unreadable[about.name] = dataclasses.replace(self.topics.pop(about.name), problem=problem)
        for name, about in self.topics.items():
            if about.type_name == wire.VECTOR.type_name:
                self.topics[name] = dataclasses.replace(about, quantity=quantity_of(name))
        self.start_ns, self.end_ns = opened.start_ns, opened.end_ns
        self.files, self.size_bytes, self.storage = opened.files, opened.size_bytes, opened.storage
        self.complete, self.lost_bytes = opened.complete, opened.lost_bytes
        self._noted: set[str] = set()
        self._decoder = SampleDecoder(self.topics, opened.message_compression, self._note_once)
        self._stream = PartStream(opened, self.carried, self._note_damage)

    @property
    def message_count(self) -> int:
        """Messages in all topics, as the bag's index says."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def carried(self) -> dict[str, TopicInfo]:
        """Topics that a copy of the bag has: those of an MCAP file that cannot be read are copied as they are."""
        return self.topics | self.unreadable if self.storage == "mcap" else self.topics

    def unread(self, *type_names: str) -> str:
        """Return the topics of some types whose messages cannot be read, and why, in words; empty for none."""
        return listed([one for one in self.unreadable.values() if one.count and one.type_name in type_names])

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
        if unread := self.unread(type_name):
            raise BagError(f"{self.path} has no topic of {type_name} that can be read: {unread}", REMEDY)
        if of_type:
            hint = f"topics of that type: {', '.join(topic.name for topic in of_type)}; name the one you mean"
        else:
            there = [f"{topic.name} ({topic.type_name or 'no type'})" for topic in self.topics.values()]
            hint = f"it has {', '.join(there)}"
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
            A topic of bursts gives the samples they carry, one of vectors whose quantity is known those of an IMU or of
            a magnetometer.
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

        for group in self._stream.groups(wanted, start_ns, end_ns, decoded):
            for one in group:
                for name, log_ns, samples in one.samples:
                    pieces.setdefault(name, []).append((log_ns, samples))
                count += len(one)
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
    ) -> Iterator[tuple[Block, list[Originals]]]:
        """
        As `blocks`, and with each block every message of the bag of its time, those of other topics too, as it lies.

        A block has no upper size but that of the chunks of one time, and may be without a sample.
        """
        wanted = set(self._checked(topics))
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        originals: list[Originals] = []
        count = 0
        for group in self._stream.groups(list(self.carried), start_ns, end_ns, lambda part: part):
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
        for group in self._stream.groups(wanted, start_ns, end_ns, lambda part: part):
            yield from self._in_order(group)

    def use_frame(self, topic: str, frame: str) -> None:
        """Read only messages of a topic in one frame as samples, because another unit publishes the topic too."""
        self._decoder.frames[topic] = frame

    @property
    def frames_used(self) -> Mapping[str, str]:
        """By topic, the frame whose messages alone are read as samples."""
        return self._decoder.frames

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
        return [parse_attachment(body) for body in self._extra("attachments", Opcode.ATTACHMENT)]

    def metadata(self) -> dict[str, dict[str, str]]:
        """Named tables kept inside the bag; a later file's table of the same name replaces an earlier one's."""
        return dict(parse_metadata(body) for body in self._extra("metadata", Opcode.METADATA))

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
            if name in self.unreadable:
                raise BagError(f"{self.path}: {self.unreadable[name].described()}", REMEDY)
            if name not in self.topics:
                raise BagError(f"{self.path} has no topic {name}", f"it has {', '.join(self.topics)}")
        return list(topics)

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
            yield log_ns[row], name, self.carried[name].type_name, data

    def _part_names(self, part: Part) -> Mapping[int, str]:
        return self._opened.names[part.file] if self._opened.other is None else dict(enumerate(self.carried))

    def _originals(self, part: Part) -> Originals:
        if self._opened.message_compression:
            rows = []
            for log_ns, at, size, channel in zip(part.log_ns, part.offset, part.size, part.channel, strict=True):
                data = self._decoder.unzipped(part.data[at : at + size].tobytes())
                if data is not None:
                    rows.append((int(log_ns), int(channel), data))
            plain = part_of(rows)
            part = dataclasses.replace(plain, rank=part.rank, file=part.file)
        places = {name: place for place, name in enumerate(self.carried)}
        table = np.zeros(65536, dtype=np.int64)
        for channel, name in self._part_names(part).items():
            table[channel] = places[name]
        return Originals(part.data, part.log_ns, part.offset, part.size, table[part.channel], part.framed)

    def _extra(self, kind: str, opcode: int) -> Iterator[bytes]:
        for file, contents in self._opened.mcap:
            for offset, _ in getattr(contents, kind):
                try:
                    body = file.body(offset, opcode)
                    if opcode == Opcode.ATTACHMENT:
                        parse_attachment(body)
                    else:
                        parse_metadata(body)
                except FormatError as error:
                    self._note_once(f"one of the {kind} is damaged and left out: {error}")
                    continue
                yield body

    def _note_damage(self, note: str) -> None:
        self.complete = False
        self.notes.append(note)

    def _note_once(self, note: str) -> None:
        # One note per kind and topic, not one per message.
        key = note.split("(")[0].split(": it ")[0][:80]
        if key not in self._noted:
            self._noted.add(key)
            self.notes.append(note)

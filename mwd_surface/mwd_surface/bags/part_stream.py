# SPDX-License-Identifier: Apache-2.0
"""
Reading the parts of a bag in time order, in constant memory.

A thread decompresses and decodes chunks of MCAP files ahead of their use; other storage is read through `rosbags`.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mwd_surface.bags.bag_files import BagFiles, TopicInfo
from mwd_surface.bags.mcap.compression import Decompressor
from mwd_surface.bags.mcap.contents import MessageSpan
from mwd_surface.bags.mcap.records import FormatError
from mwd_surface.bags.mcap.walk import walk_records
from mwd_surface.bags.message_parts import NEVER, Decoded, MessagePart, part_of
from mwd_surface.bags.topic_info import ros2_types

M = TypeVar("M", MessagePart, Decoded)

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

    def groups(
        self, topics: list[str], start_ns: int | None, end_ns: int | None, made: Callable[[MessagePart], M]
    ) -> Iterator[list[M]]:
        """
        Yield, in groups, the result of `made` for each part with messages of the given topics and log times.

        start_ns, end_ns : log time from (inclusive) and to (exclusive). No message of a group was logged later than
        any message of the next group.
        """
        start, end = start_ns or 0, NEVER if end_ns is None else end_ns
        if self._opened.other is not None:
            for part in self._other_parts(topics, start, end):
                yield [made(part)]
            return
        chosen: list[tuple[int, MessageSpan]] = []
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
        self,
        chosen: list[tuple[int, MessageSpan]],
        topics: list[str],
        start: int,
        end: int,
        made: Callable[[MessagePart], M],
    ) -> Iterator[M | None]:
        """Yield the result of `made` for each chosen span, None if it is damaged; a thread loads a few spans ahead."""
        waiting: deque[tuple[concurrent.futures.Future[M], int]] = deque()
        wanted = []
        for names in self._opened.names:
            mask = np.zeros(65536, dtype=np.bool_)
            mask[[number for number, name in names.items() if name in topics]] = True
            wanted.append(mask)
        # Use one thread: a second one loses more to competition for memory bandwidth than it gains.
        pool = concurrent.futures.ThreadPoolExecutor(1, thread_name_prefix="bag")
        decompress = Decompressor()

        def load(number: int, span: MessageSpan) -> M:
            # Call `made` in the loading thread, while the bytes are still in the cache.
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
        data = np.frombuffer(self._opened.mcap[number][0].plain(span, decompress), dtype=np.uint8)
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
        return self._from_ros1(part, number) if self._opened.ros1[number] else part

    def _from_ros1(self, part: MessagePart, number: int) -> MessagePart:
        """
        Return a part with its ROS 1 messages converted to the encoding of ROS 2.

        Messages that cannot be converted are reported and left out.
        """
        types = self._opened.ros1[number]
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
                    name = self._opened.names[number][channel]
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

# SPDX-License-Identifier: Apache-2.0
"""
One running recording: files, chunks, splits by time and size, and pauses while the disk is full.

Only one thread uses a session. If a write to the disk fails, the recording pauses, its file is completed as far as
possible, and writing is tried again later.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import errno
import math
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import Definitions
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import EventLevel, RecorderEvent, RecorderState

# Messages and commands for the writer thread, bounded in bytes.

OVERHEAD = 128  # memory that a waiting message needs in addition to its payload, bytes
_BATCH = 1000  # largest number of entries in a batch


class QueuedMessage(NamedTuple):
    """A received message that waits to be written."""

    topic: str
    type_name: str
    data: bytes
    #: `log_ns`, `publish_ns`: ns since the epoch.
    log_ns: int
    publish_ns: int
    qos: str = ""  #: offered profiles as YAML

    @property
    def size(self) -> int:
        """Memory that the message uses while it waits, bytes."""
        return len(self.data) + OVERHEAD


@dataclasses.dataclass
class WriterCommand:
    """A request that the writer thread carries out after all messages that were queued before the request."""

    run: Callable[[], Any]
    answer: concurrent.futures.Future[Any] = dataclasses.field(default_factory=concurrent.futures.Future)

    def carry_out(self) -> None:
        """Run the request and set its answer or its exception."""
        try:
            self.answer.set_result(self.run())
        except Exception as error:  # noqa: BLE001  (any error is passed to the caller)
            self.answer.set_exception(error)


class MessageQueue:
    """
    Messages and commands in the order in which they were delivered; no call waits.

    Parameters
    ----------
    limit : int
        Largest number of bytes that may wait.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.waiting_bytes = 0  #: number of bytes that wait now
        self.refused = 0  #: number of messages refused because the queue was full
        self.wake = threading.Event()  #: set when the writer should read the queue
        self._items: deque[QueuedMessage | WriterCommand] = deque()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: QueuedMessage) -> bool:
        """Accept a message and return True; if the queue is full, count the message as refused and return False."""
        with self._lock:
            if self.waiting_bytes + item.size > self.limit:
                self.refused += 1
                return False
            self.waiting_bytes += item.size
            self._items.append(item)
            filling = self.waiting_bytes > self.limit // 4
        if filling:
            self.wake.set()
        return True

    def command(self, run: Callable[[], Any]) -> concurrent.futures.Future[Any]:
        """Accept a command and return the future that will hold its answer."""
        command = WriterCommand(run)
        with self._lock:
            self._items.append(command)
        return command.answer

    def batch(self) -> list[QueuedMessage | WriterCommand]:
        """Remove and return the next entries, at most a thousand."""
        taken: list[QueuedMessage | WriterCommand] = []
        with self._lock:
            while self._items and len(taken) < _BATCH:
                item = self._items.popleft()
                taken.append(item)
                if isinstance(item, QueuedMessage):
                    self.waiting_bytes -= item.size
        return taken

    def cancel(self, error: Exception) -> None:
        """Empty the queue; its commands fail with the error."""
        with self._lock:
            commands = [item for item in self._items if isinstance(item, WriterCommand)]
            self._items.clear()
            self.waiting_bytes = 0
        for command in commands:
            command.answer.set_exception(error)


# The running recording.

EVENT_TYPE = "rcl_interfaces/msg/Log"
# Errors of a full disk, of an exhausted quota, and of a file above the largest size of the file system.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_LOOK = 0.5  # time between checks of the free disk space, s
_LOOK_BYTES = 8 * 1024 * 1024  # largest number of bytes written between two checks of the free disk space

Tables = Callable[[], Mapping[str, Mapping[str, str]]]


@dataclasses.dataclass(frozen=True)
class SessionHooks:
    """Functions that a session gets from its recorder."""

    tables: Tables  #: returns named tables of strings that are written to every file
    space: Callable[[Path], int]  #: returns the free bytes on the disk of a folder
    refused: Callable[[], int]  #: returns the number of messages of this recording that the queue refused
    #: Called with the level and text of an event; the recorder passes the event to `Session.record`.
    report: Callable[[EventLevel, str], None]


class Session:
    """
    One recording, from its first file to its last.

    Parameters
    ----------
    writer : BagWriter
        Writer with `in_place`, whose first file has been begun.
    folder : Path
        Folder whose disk is watched.
    event_topic : str
        Topic for events.
    """

    def __init__(
        self,
        writer: BagWriter,
        folder: Path,
        settings: RecorderSettings,
        definitions: Definitions,
        event_topic: str,
        hooks: SessionHooks,
    ) -> None:
        self.writer = writer
        #: `reason`: reason of a pause or failure.
        self.state, self.reason = RecorderState.RECORDING, ""
        self.writing = True  #: false while the disk is full or failing
        self.dropped = 0  #: number of messages removed from the queue but not written
        self.free: float = math.nan  #: free bytes on the disk at the last check; NaN if unknown
        self.began = time.monotonic()  #: monotonic time of the beginning, s
        self.unsaved_since: float | None = None  #: monotonic time of the oldest message not yet forced to the disk
        self._folder, self._settings, self._definitions = folder, settings, definitions
        self._event_topic, self._hooks = event_topic, hooks
        self._channels: dict[tuple[str, str], int] = {}
        self._file_began = self.began
        self._chunk_began: float | None = None
        self._last_ns = 0
        self._dropped_reported = 0
        self._pause_began = 0
        self._retry_at = 0.0
        self._checked_at = -1e9
        self._unchecked = 0
        self._odd: set[str] = set()
        self._waiting: deque[RecorderEvent] = deque(maxlen=200)  # events for the next message or file
        self._put_tables()

    def take(self, item: QueuedMessage) -> None:
        """Write a message; a message that cannot be written is counted and reported, in a pause only counted."""
        if not self.writing:
            self.dropped += 1
            return
        before = self.writer.messages
        try:
            self._write(item)
        except OSError as error:
            # A message that was added to the current chunk is not lost yet: it is counted if the chunk is discarded.
            self.dropped += self.writer.messages == before
            self.disk_failed(error)
        except Exception as error:  # noqa: BLE001  (one invalid message must not stop the recording of others)
            self.dropped += 1
            if item.topic not in self._odd:
                self._odd.add(item.topic)
                self._hooks.report(EventLevel.WARNING, f"messages of {item.topic} cannot be recorded: {error}")

    def periodic(self) -> None:
        """Carry out the tasks that are due: write chunks, sync, split, check the disk, report lost messages."""
        now = time.monotonic()
        if now - self._checked_at >= _LOOK or not self.writing:
            self._watch_disk()
        if not self.writing:
            return
        self._by_time()
        if self.state != RecorderState.RECORDING:
            return
        waiting = self.unsaved_since
        if waiting is not None and now - waiting >= self._settings.sync_seconds:
            # Close the current chunk too: otherwise a message of a quiet topic could wait for a chunk and then for a
            # sync.
            self.writer.file.close_chunk()
            self._chunk_began = None
            self.writer.file.sync()
            self.unsaved_since = None
        if self._settings.split_seconds and now - self._file_began >= self._settings.split_seconds:
            self._new_file()
        count = self.lost - self._dropped_reported
        if count > 0:
            self._dropped_reported += count
            self._hooks.report(EventLevel.ERROR, f"{count} messages were lost: the disk is slower than the data")

    @property
    def lost(self) -> int:
        """Number of messages of this recording that were lost."""
        return self._hooks.refused() + self.dropped

    def _write(self, item: QueuedMessage) -> None:
        topic, type_name, data, log_ns, publish_ns, qos = item
        if log_ns < 0:
            raise ValueError(f"its stamp {log_ns} lies before 1970")
        channel = self._channels.get((topic, type_name))
        if channel is None:
            channel = self._declare(topic, type_name, qos)
        jump = self._settings.time_jump_seconds * 1e9
        if jump and self._last_ns and abs(log_ns - self._last_ns) > jump:
            text = f"the clock jumped by {(log_ns - self._last_ns) * 1e-9:+.0f} s; a new file was begun"
            self._last_ns = log_ns
            self._new_file()
            if not self.writing:
                self.dropped += 1
                return
            self._hooks.report(EventLevel.WARNING, text)
        self._last_ns = log_ns
        self._record_events()
        size_before = self.writer.file.size
        self.writer.write(channel, data, log_ns, publish_ns)
        self._unchecked += len(data)
        now = time.monotonic()
        if self.unsaved_since is None:
            self.unsaved_since = now
        if self.writer.file.size != size_before:
            self._chunk_began = None
            self._after_chunk()
        elif self._chunk_began is None:
            self._chunk_began = now

    def _declare(self, topic: str, type_name: str, qos: str) -> int:
        try:
            profiles = bag_metadata.parse_qos(qos)
        except ValueError as error:
            profiles = []
            self._hooks.report(EventLevel.WARNING, f"{topic}: recorded without its quality of service: {error}")
        channel = self.writer.topic(topic, type_name, profiles, need_definition=False)
        self._channels[topic, type_name] = channel
        if not self.writer.has_definition(channel):
            self._hooks.report(
                EventLevel.WARNING, f"{topic}: recorded without a definition: {type_name} is unknown here"
            )
        return channel

    def _by_time(self) -> None:
        """Write the current chunk if its first message has waited for `chunk_seconds`."""
        if self._chunk_began is not None and time.monotonic() - self._chunk_began >= self._settings.chunk_seconds:
            self.writer.file.close_chunk()
            self._chunk_began = None
            self._after_chunk()

    def _after_chunk(self) -> None:
        limit = self._settings.split_bytes
        if limit and self.writer.file.size >= limit:
            self._new_file()
        # On a small disk with a small reserve, the space must be checked before the reserve is used up.
        if self._unchecked > min(_LOOK_BYTES, self._settings.min_free_bytes // 4):
            self._watch_disk()

    def _watch_disk(self) -> None:
        self._checked_at, self._unchecked = time.monotonic(), 0
        try:
            if self.writing:
                self.writer.check_file()
            else:
                # The folder may have been deleted since the pause began.
                self.writer.path.mkdir(parents=True, exist_ok=True)
            self.free = self._hooks.space(self._folder)
        except OSError as error:
            self.free = math.nan
            if self.writing:
                self.disk_failed(error)
            return
        low = self._settings.min_free_bytes
        if self.writing and self.free < low:
            reason = f"{self.free / 1e6:.0f} MB free on the disk of {self._folder}, {low / 1e6:.0f} MB must stay free"
            self._pause_writing(RecorderState.PAUSED_DISK_FULL, reason, gone=False)
        elif not self.writing and self.free >= low + low // 8 and time.monotonic() >= self._retry_at:
            self._resume()

    def _pause_writing(self, state: RecorderState, reason: str, *, gone: bool) -> None:
        # The event ends the file. If the file was moved or deleted, the event waits for the next file.
        self.writing = self.writing and not gone
        self._hooks.report(EventLevel.ERROR, f"recording paused: {reason}")
        self.writing = False
        self._pause_began = time.time_ns()
        self._retry_at = time.monotonic() + self._settings.retry_seconds
        self.unsaved_since = self._chunk_began = None
        try:
            self.writer.finish_file(sync=True)
        except FileNotFoundError:
            self.dropped += self.writer.give_up_file()
        except OSError:
            # The disk has no room for the current chunk or the summary: discard the chunk, and the summary may fit.
            self.dropped += self.writer.file.discard_pending()
            try:
                self.writer.finish_file(sync=True)
            except OSError:
                self.dropped += self.writer.give_up_file()
                self._hooks.report(
                    EventLevel.ERROR, f"{self.writer.file.path.name} has no end; the next start recovers it"
                )
        # Publish the pause only now, because a reader of the state may rely on a complete file.
        self.state, self.reason = state, reason

    def disk_failed(self, error: OSError) -> None:
        """Pause the recording, and complete the file as far as the disk allows."""
        full = error.errno in _FULL
        reason = words_of(error, self._folder)
        state = RecorderState.PAUSED_DISK_FULL if full else RecorderState.FAILED
        self._pause_writing(state, reason, gone=isinstance(error, FileNotFoundError))

    def _resume(self) -> None:
        self._retry_at = time.monotonic() + self._settings.retry_seconds
        try:
            self.writer.begin_file()
        except OSError as error:
            self.reason = words_of(error, self._folder)
            return
        self.writing, self._file_began = True, time.monotonic()
        self.state, self.reason = RecorderState.RECORDING, ""
        # The next message is later by the length of the pause, which is not a jump of the clock.
        self._last_ns = 0
        lost = self.lost - self._dropped_reported
        self._dropped_reported += lost
        seconds = (time.time_ns() - self._pause_began) * 1e-9
        self._put_tables()
        self._hooks.report(
            EventLevel.WARNING, f"recording goes on after a pause of {seconds:.0f} s; {lost} messages were lost"
        )

    def split(self) -> Path:
        """Continue in a new file; return the finished file."""
        done = self.writer.file.path
        self._new_file()
        return done

    def finish(self) -> None:
        """End the recording; if a write fails, complete the file as far as possible."""
        try:
            if self.writing:
                self._record_events()
                self.writer.close(sync=True)
        except OSError as error:
            self.disk_failed(error)

    def record(self, event: RecorderEvent) -> None:
        """
        Record an event; during a pause the event waits for the next file.

        Events before the first message wait for this message, because the time of the recording is not known yet.
        """
        self._waiting.append(event)
        if self.writing and self._last_ns:
            # Ignore an error of the disk here: it occurs again with the next message, where it is handled.
            with contextlib.suppress(OSError):
                self._record_events()

    def _new_file(self) -> None:
        self.writer.finish_file(sync=True)
        self.writing, self._chunk_began, self.unsaved_since = False, None, None
        try:
            self.writer.begin_file()
        except OSError as error:
            self.disk_failed(error)
            return
        self.writing, self._file_began = True, time.monotonic()
        self._put_tables()

    def _put_tables(self) -> None:
        for name, values in self._hooks.tables().items():
            self.writer.add_metadata(name, values)

    def _record_events(self) -> None:
        while self._waiting:
            # If writing an event fails, keep the event for the next file.
            self._record_event(self._waiting[0])
            self._waiting.popleft()

    def _record_event(self, event: RecorderEvent) -> None:
        self._definitions.load(EVENT_TYPE)
        types = self._definitions.typestore.types
        sec, nanosec = divmod(event.stamp_ns, 1_000_000_000)
        message = types[EVENT_TYPE](
            types["builtin_interfaces/msg/Time"](sec, nanosec), int(event.level), "recorder", event.text, "", "", 0
        )
        data = bytes(self._definitions.typestore.serialize_cdr(message, EVENT_TYPE))
        channel = self.writer.topic(self._event_topic, EVENT_TYPE)
        # Use the time of the recording, which may be simulated.
        self.writer.write(channel, data, self._last_ns or event.stamp_ns)
        if self._chunk_began is None:
            self._chunk_began = time.monotonic()
        if self.unsaved_since is None:
            self.unsaved_since = time.monotonic()


def words_of(error: OSError, folder: Path) -> str:
    """Return a text with the path and the reason of an error of the disk."""
    return f"{error.filename or folder}: {error.strerror or error}"


def free_bytes(folder: Path) -> int:
    """Return the free bytes on the disk of a folder."""
    return shutil.disk_usage(folder).free

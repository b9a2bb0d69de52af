# SPDX-License-Identifier: Apache-2.0
"""
The recorder, which writes all messages that it receives into a bag, in a thread of its own.

The caller never waits: messages go into a queue bounded in bytes. Messages that do not fit are counted, and an event in
the recording reports their number. Chunks are written to the disk at fixed intervals, so that a killed process or a
power failure loses at most `chunk_seconds` + `sync_seconds` of data. A file without its end is recovered at the next
start.
"""

from __future__ import annotations

import concurrent.futures
import datetime
import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mwd_sensors.core.foreign_text import unprintable
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import Definitions, installed
from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.recorder.session import (
    MessageQueue,
    QueuedMessage,
    Session,
    SessionHooks,
    WriterCommand,
    free_bytes,
    words_of,
)
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import EventLevel, RecorderError, RecorderEvent, RecorderState, RecorderStatus

_BATCHES = 20  # number of batches written between two checks of time and disk
_SNAPSHOT_S = 10.0  # longest wait for a snapshot to be written, s


class Recorder:
    """
    Recorder of messages into bags in a folder.

    Parameters
    ----------
    folder : Path
        Created if missing; one recorder at a time may use it.
    definitions : Definitions, optional
        Source of schema texts; by default the definitions of this installation.
    tables : callable, optional
        Returns named tables of strings (versions, parameters) that are put into every file as metadata.
    event_topic : str
        Full name of the topic under which events are recorded, as rcl_interfaces/Log.
    space : callable
        Returns the free bytes on the disk of a folder; replaced in tests.

    Raises
    ------
    RecorderError
        The folder cannot be created or written, or another recorder uses it.
    """

    def __init__(
        self,
        folder: Path | str,
        settings: RecorderSettings | None = None,
        definitions: Definitions | None = None,
        *,
        tables: Callable[[], Mapping[str, Mapping[str, str]]] = dict,
        event_topic: str = "/recorder/events",
        space: Callable[[Path], int] = free_bytes,
    ) -> None:
        self.folder = Path(folder)
        self.settings = settings or RecorderSettings()
        self._untaken: deque[RecorderEvent] = deque(maxlen=1000)
        self._definitions = definitions or installed()
        self._tables = tables
        self._event_topic = event_topic
        self._space = space
        self._queue = MessageQueue(self.settings.queue_bytes)
        self._session: Session | None = None
        #: Status of the last recording at its end, with the number of its lost messages, and with the reason if it
        #: ended in a pause; None before the first end of a recording.
        self.last: RecorderStatus | None = None
        kept = self.settings.snapshot_seconds
        self._ring = SnapshotRing(kept, self.settings.snapshot_bytes) if kept > 0 else None
        self._taking = self._ring is not None
        self._refused_before = 0
        self._free: float = math.nan
        self._closing = False
        self._deadline: float | None = None
        self._folder_lock = locked(self.folder)
        # List the bags before this recorder can begin one of its own.
        earlier = sorted(item for item in self.folder.iterdir() if item.is_dir())
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        self._recovery = RecoveryThread(earlier, lambda: not self._closing, self._report_later)

    # Methods for the thread of the caller.

    def put(
        self,
        topic: str,
        type_name: str,
        data: bytes,
        log_ns: int,
        publish_ns: int | None = None,
        qos: str = "",
    ) -> bool:
        """
        Accept one serialised message; never waits.

        Parameters
        ----------
        topic, type_name : str
            Full name, and ``package/msg/Name``.
        data : bytes
            Message as received from the middleware; must not be changed afterwards.
        log_ns, publish_ns : int
            Times at which the message was received and published, ns since the epoch.
        qos : str
            Offered profiles as YAML; used when the topic is first seen.

        Returns False if the message was not accepted: nothing is being recorded and no snapshot is kept, or the queue
        is full. A message that does not fit into the queue is counted.
        """
        if not self._taking:
            return False
        return self._queue.put(
            QueuedMessage(topic, type_name, data, log_ns, log_ns if publish_ns is None else publish_ns, qos)
        )

    def start(self, name: str = "", custom: Mapping[str, str] | None = None, timeout_s: float = 3.0) -> Path:
        """
        Begin a recording and return its folder.

        name : name of the new folder in `folder`, numbered if it is in use; by default from date and time (UTC).
        custom : ``custom_data`` of metadata.yaml.

        Raises
        ------
        RecorderError
            A recording is running already, the name is not a plain name, the disk has less than `min_free_bytes`
            free, cannot be written, or does not answer within `timeout_s`.
        """
        path: Path = self._command(lambda: self._start(name, dict(custom or {})), timeout_s)
        return path

    def stop(self, timeout_s: float = 3.0) -> Path:
        """
        Write the messages accepted so far, end the recording, and return its folder.

        Messages that are not written after 0.7 `timeout_s` are dropped and counted.

        Raises
        ------
        RecorderError
            No recording is running, or writing did not end within `timeout_s` (it then continues in the background).
        """
        self._deadline = time.monotonic() + 0.7 * timeout_s
        return Path(self._command(self._stop, timeout_s))

    def split(self, timeout_s: float = 3.0) -> Path:
        """Continue in a new file and return the finished file. Raises RecorderError like `stop`, and during a pause."""
        return Path(self._command(self._split_asked, timeout_s))

    def snapshot(self, name: str = "") -> Path:
        """
        Write the messages of the last `snapshot_seconds`, kept in memory, into a separate bag; return its folder.

        Raises
        ------
        RecorderError
            `snapshot_seconds` is 0, nothing has been received, or the disk cannot be written.
        """
        return Path(self._command(lambda: self._snapshot(name), _SNAPSHOT_S))

    def attach(self, name: str, media_type: str, data: bytes, log_ns: int, timeout_s: float = 3.0) -> None:
        """
        Attach a file to the recording, with the time log_ns, ns since the epoch.

        Raises RecorderError if no recording is running or it is paused, or the disk cannot be written or does not
        answer in `timeout_s`.
        """
        self._command(lambda: self._writing().writer.attach(name, media_type, data, log_ns), timeout_s)

    def add_metadata(self, name: str, values: Mapping[str, str], timeout_s: float = 3.0) -> None:
        """Store a named table of strings inside the recording. Errors as in `attach`."""
        self._command(lambda: self._writing().writer.add_metadata(name, dict(values)), timeout_s)

    def status(self) -> RecorderStatus:
        """Return the status; never waits."""
        return self._status_of(self._session)

    def _status_of(self, session: Session | None) -> RecorderStatus:
        return RecorderStatus(
            state=session.state if session else RecorderState.STOPPED,
            reason=session.reason if session else "",
            path=str(session.writer.path) if session else "",
            messages=session.writer.messages if session else 0,
            bytes=session.writer.bytes_written if session else 0,
            dropped=session.lost if session else 0,
            queued_bytes=self._queue.waiting_bytes,
            queue_limit=self._queue.limit,
            free_bytes=session.free if session else self._free,
            duration=time.monotonic() - session.began if session else 0.0,
            files=len(session.writer.files) + int(session.writing) if session else 0,
        )

    def drain_events(self) -> list[RecorderEvent]:
        """Return the events since the last call, oldest first, at most the last 1000; never waits."""
        taken = []
        # Remove the events one by one, because another thread may append events at the same time.
        while self._untaken:
            taken.append(self._untaken.popleft())
        return taken

    def close(self, timeout_s: float = 2.8) -> bool:
        """
        End the recording and the threads; return whether all was finished in time.

        If a slow disk has not accepted the queue after 0.7 `timeout_s`, the rest of the queue is dropped and counted.
        The file is then still completed if the disk responds; otherwise the next start recovers the file.
        """
        if not self._thread.is_alive():
            return True
        end = time.monotonic() + timeout_s
        self._deadline = end - 0.3 * timeout_s
        self._taking, self._closing = False, True
        self._queue.wake.set()
        self._thread.join(timeout_s)
        done = not self._thread.is_alive()
        self._recovery.join(max(0.0, end - time.monotonic()))
        if done:
            self._folder_lock.free()
        return done

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _command(self, run: Callable[[], Any], timeout_s: float) -> Any:
        if self._closing or not self._thread.is_alive():
            raise RecorderError("the recorder is closed")
        answer = self._queue.command(run)
        self._queue.wake.set()
        try:
            return answer.result(timeout_s)
        except concurrent.futures.TimeoutError:
            raise RecorderError(f"{self.folder}: the disk did not answer within {timeout_s:g} s") from None
        except OSError as error:
            raise RecorderError(words_of(error, self.folder)) from error

    # Methods that run in the writer thread.

    def _run(self) -> None:
        # Waiting adds at most 0.1 s to the age of unsaved data.
        pause = min(0.1, self.settings.chunk_seconds / 2)
        while True:
            if not self._queue:
                self._queue.wake.wait(pause)
            self._queue.wake.clear()
            closing = self._closing
            self._drain(_BATCHES)
            if self._session is not None:
                self._guarded(self._session.periodic)
            if closing:
                while self._queue:
                    self._drain(_BATCHES)
                if self._session is not None:
                    self._guarded(self._stop)
                self._queue.cancel(RecorderError("the recorder is closed"))
                return

    def _drain(self, batches: int) -> None:
        """Write at most `batches` batches of the queue; the caller checks time and disk between two calls."""
        for _ in range(batches):
            batch = self._queue.batch()
            if not batch:
                return
            for item in batch:
                if isinstance(item, WriterCommand):
                    item.carry_out()
                else:
                    self._store(item)

    def _store(self, item: QueuedMessage) -> None:
        if self._ring is not None:
            self._ring.keep(item)
        session = self._session
        if session is None:
            return
        if self._deadline is not None and time.monotonic() > self._deadline:
            session.dropped += 1
            return
        session.take(item)

    def _guarded(self, step: Callable[[], Any]) -> None:
        session = self._session
        try:
            step()
        except OSError as error:
            if session is not None and session.writing:
                session.disk_failed(error)
            else:
                self._report(EventLevel.ERROR, words_of(error, self.folder))
        except Exception as error:  # noqa: BLE001  (the thread must survive because messages keep arriving)
            self._report(EventLevel.ERROR, f"the recorder has an internal error: {error!r}")

    def _start(self, name: str, custom: dict[str, str]) -> Path:
        if self._session is not None:
            raise RecorderError(f"a recording is running already: {self._session.writer.path}")
        path = recording_path(self.folder, name, "mwd")
        self._free = self._space(self.folder)
        if self._free < self.settings.min_free_bytes:
            raise RecorderError(
                f"only {self._free / 1e6:.0f} MB are free on the disk of {self.folder}; "
                f"{self.settings.min_free_bytes / 1e6:.0f} MB must stay free (min_free_bytes)"
            )
        self._refused_before, self._deadline = self._queue.refused, None
        self._session = Session(
            self._writer(path, custom, in_place=True),
            self.folder,
            self.settings,
            self._definitions,
            self._event_topic,
            SessionHooks(self._tables, self._space, self._refused, self._report),
        )
        self._session.free = self._free
        self._taking = True
        self._report(EventLevel.INFO, f"recording to {path}")
        return path

    def _stop(self) -> Path:
        session = self._running()
        self._taking = self._ring is not None and not self._closing
        lost = session.lost
        text = f"recording of {session.writer.path} stopped{f'; {lost} messages were lost' if lost else ''}"
        self._report(EventLevel.WARNING if lost else EventLevel.INFO, text)
        session.finish()
        self.last = self._status_of(session)
        self._session, self._deadline, self._free = None, None, session.free
        if self.last.dropped > lost:
            text = f"{self.last.dropped - lost} messages were lost at the end of {session.writer.path}"
            self._report(EventLevel.ERROR, text)
        return session.writer.path

    def _split_asked(self) -> Path:
        return self._writing().split()

    def _snapshot(self, name: str) -> Path:
        if self._ring is None:
            raise RecorderError("no snapshot is kept: snapshot_seconds is 0")
        if not len(self._ring):
            raise RecorderError("nothing was received yet that a snapshot could hold")
        path = recording_path(self.folder, name, "snapshot")
        with self._writer(path, {}, in_place=False) as writer:
            self._ring.write(writer)
            for table, values in self._tables().items():
                writer.add_metadata(table, values)
        self._report(EventLevel.INFO, f"snapshot written to {path}")
        return path

    def _writer(self, path: Path, custom: dict[str, str], *, in_place: bool) -> BagWriter:
        compression = "" if self.settings.compression == "none" else self.settings.compression
        return BagWriter(
            path,
            self._definitions,
            in_place=in_place,
            compression=compression,
            chunk_bytes=self.settings.chunk_bytes,
            custom=custom,
        )

    def _refused(self) -> int:
        """Return the number of messages of this recording that the queue refused."""
        return self._queue.refused - self._refused_before

    def _running(self) -> Session:
        if self._session is None:
            raise RecorderError("no recording is running")
        return self._session

    def _writing(self) -> Session:
        session = self._running()
        if not session.writing:
            raise RecorderError(f"the recording is paused: {session.reason}")
        return session

    def _report(self, level: EventLevel, text: str) -> None:
        event = RecorderEvent(time.time_ns(), level, text)
        self._untaken.append(event)
        if self._session is not None:
            self._session.record(event)

    def _report_later(self, level: EventLevel, text: str) -> None:
        # Pass the event to the writer thread, because only this thread may write events.
        self._queue.command(lambda: self._report(level, text))


# The last seconds of all received messages, kept in bounded memory for a snapshot.


class SnapshotRing:
    """Messages of the last `seconds` seconds, limited to `most` bytes."""

    def __init__(self, seconds: float, most: int) -> None:
        self._seconds, self._most = seconds, most
        self._items: deque[tuple[float, QueuedMessage]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._items)

    def keep(self, item: QueuedMessage) -> None:
        """Add a message, and remove the oldest messages until the limits are met."""
        now = time.monotonic()
        self._items.append((now, item))
        self._bytes += item.size
        while self._items and (now - self._items[0][0] > self._seconds or self._bytes > self._most):
            self._bytes -= self._items.popleft()[1].size

    def write(self, writer: BagWriter) -> None:
        """Write the kept messages into a bag, oldest first."""
        for _, (topic, type_name, data, log_ns, publish_ns, qos) in self._items:
            profiles = bag_metadata.qos_if_readable(qos)
            channel = writer.topic(topic, type_name, profiles, need_definition=False)
            writer.write(channel, data, max(log_ns, 0), publish_ns)


# Background recovery of earlier recordings in a folder that were left unfinished.


class RecoveryThread:
    """
    A thread that recovers bags one after another.

    Parameters
    ----------
    bags : sequence of Path
        Folders of bags; finished bags are not changed.
    going_on : callable
        Returns False when recovery must stop.
    report : callable
        Called in this thread with the level and text of an event.
    """

    def __init__(
        self, bags: Sequence[Path], going_on: Callable[[], bool], report: Callable[[EventLevel, str], None]
    ) -> None:
        self._bags, self._going_on, self._report = bags, going_on, report
        self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)
        if bags:
            self._thread.start()

    def join(self, timeout_s: float) -> None:
        """Wait at most `timeout_s` seconds for the end of the thread."""
        if self._bags:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        for bag in self._bags:
            try:
                if not self._going_on() or not recovery.is_unfinished(bag):
                    continue
                reports = recovery.recover_bag(bag, self._going_on, thorough=False)
            except InterruptedError:
                return
            except OSError as error:
                self._report(EventLevel.ERROR, f"{bag} could not be recovered: {error}")
                continue
            for report in reports:
                if not report.sound:
                    self._report(EventLevel.WARNING, f"recovered in {bag.name}: {report.sentence()}")


# Folder of recordings: its lock, and the names of recordings.

LOCK_NAME = ".recorder.lock"


def locked(folder: Path) -> FolderLock:
    """
    Lock a folder for one recorder; create the folder if it is missing.

    Raises
    ------
    RecorderError
        The folder cannot be written, or another recorder uses it.
    """
    try:
        return FolderLock(folder, LOCK_NAME)
    except OSError as error:
        raise RecorderError(f"recordings cannot be written to {folder}: {error.strerror}") from error
    except FolderTakenError as error:
        raise RecorderError(
            f"another recorder (process {error.owner}) writes into {folder}; stop it or choose another folder"
        ) from None


def recording_path(folder: Path, name: str, prefix: str) -> Path:
    """
    Return the path of a new recording, named `name` or, if `name` is empty, by prefix, date and time (UTC).

    A name in use gets the suffix _2, _3 and so on: a node restarted after a crash records again and overwrites nothing.

    Raises
    ------
    RecorderError
        `name` contains a slash or another character that is not allowed, or begins with a dot.
    """
    if name and (name != Path(name).name or name.startswith(".") or unprintable(name)):
        raise RecorderError(f"{name!r} is not a plain name for a recording", "give a name without slashes")
    base = name or f"{prefix}_{datetime.datetime.now(datetime.UTC):%Y%m%dT%H%M%SZ}"
    paths = (folder / base if k == 1 else folder / f"{base}_{k}" for k in itertools.count(1))
    return next(path for path in paths if not path.exists())


def recordings_named(folder: Path, name: str) -> list[Path]:
    """Return the recordings in a folder that `recording_path` named `name`, `name`_2 and so on, oldest first."""
    paths = (folder / name if k == 1 else folder / f"{name}_{k}" for k in itertools.count(1))
    return list(itertools.takewhile(Path.exists, paths))

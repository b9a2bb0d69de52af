"""
The recorder: everything handed to it ends in a bag, written by a thread of its own.

The caller never waits: a message goes into a queue bounded in bytes, and what does not fit is counted and becomes an
event inside the recording. Chunks are closed and made durable by time, so that a killed process or a lost supply costs
at most `chunk_seconds` + `sync_seconds` of data; what such an end leaves is recovered at the next start.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import datetime
import enum
import errno
import fcntl
import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mwd_sensors.settings import setting
from mwd_surface.bags import bag_metadata, recovery
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import Definitions, installed

LOCK_NAME = ".recorder.lock"
EVENT_TYPE = "rcl_interfaces/msg/Log"
_OVERHEAD = 128  # what a queued message costs beyond its bytes
_BATCH = 1000
_BATCHES = 20
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class RecorderError(Exception):
    """A recorder that cannot do what was asked; one sentence with path and reason."""


class State(enum.IntEnum):
    """As in mwd_msgs/RecorderStatus."""

    STOPPED = 0
    RECORDING = 1
    PAUSED_DISK_FULL = 2
    FAILED = 3


class Level(enum.IntEnum):
    """Severity of an event, as in rcl_interfaces/Log."""

    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclasses.dataclass(frozen=True)
class RecorderSettings:
    """What people may choose of a recorder."""

    compression: str = setting(
        "zstd",
        "Compression of chunks: zstd for the least disk, none for the least work",
        choices=("zstd", "lz4", "none"),
    )
    chunk_bytes: int = setting(262_144, "A chunk is closed at this size", unit="B", low=1024, high=67_108_864)
    chunk_seconds: float = setting(1.0, "A chunk is closed after this time", unit="s", low=0.05, high=60.0)
    sync_seconds: float = setting(1.0, "Data are forced to the disk this often", unit="s", low=0.05, high=60.0)
    queue_bytes: int = setting(67_108_864, "Most that may wait to be written", unit="B", low=65_536)
    min_free_bytes: int = setting(536_870_912, "Recording pauses when less is free on the disk", unit="B", low=0)
    split_bytes: int = setting(2_147_483_648, "A new file is begun at this size; 0 never", unit="B", low=0)
    split_seconds: float = setting(3600.0, "A new file is begun after this time; 0 never", unit="s", low=0.0)
    time_jump_seconds: float = setting(
        60.0, "A new file is begun when the stamps jump by more; 0 never", unit="s", low=0.0
    )
    snapshot_seconds: float = setting(0.0, "The last seconds kept in memory for a snapshot; 0 none", unit="s", low=0.0)
    snapshot_bytes: int = setting(67_108_864, "Most that is kept for a snapshot", unit="B", low=0)
    retry_seconds: float = setting(
        2.0, "After a full or failing disk, writing is tried again this often", unit="s", low=0.05, high=3600.0
    )


@dataclasses.dataclass(frozen=True)
class Event:
    """Something the recorder did or suffered; stamp_ns in ns since the epoch."""

    stamp_ns: int
    level: Level
    text: str


@dataclasses.dataclass(frozen=True)
class RecorderStatus:
    """
    What a display shows of the recorder.

    Attributes
    ----------
    state : State
    reason : str
        Of a pause or failure, in words; empty otherwise.
    path : Path or None
        Folder of the recording at hand.
    messages, bytes : int
        Written in this recording; bytes on disk.
    dropped : int
        Received since the recording began, but not written: the queue was full, or the disk.
    queued_messages, queued_bytes, queue_limit : int
        Waiting to be written, and the most that may.
    free_bytes : int
        On the disk; -1 unknown.
    duration_s : float
        Since the recording began.
    files : int
        Of this recording.
    unsaved_s : float
        Age of the oldest data not yet forced to the disk: what a lost supply would cost now.
    recovered : tuple of recovery.Report
        Files of earlier recordings recovered at this start.
    """

    state: State
    reason: str
    path: Path | None
    messages: int
    bytes: int
    dropped: int
    queued_messages: int
    queued_bytes: int
    queue_limit: int
    free_bytes: int
    duration_s: float
    files: int
    unsaved_s: float
    recovered: tuple[recovery.Report, ...]


_Item = tuple[str, str, bytes, int, int, str, str]


@dataclasses.dataclass
class _Command:
    """A request carried out by the writer thread, in its place among the messages."""

    run: Callable[[], Any]
    answer: concurrent.futures.Future[Any]


@dataclasses.dataclass
class _Session:
    """The recording at hand; `writing` is false while its disk is full or failing."""

    writer: BagWriter
    began: float
    writing: bool = True
    channels: dict[tuple[str, str], int] = dataclasses.field(default_factory=dict)
    file_began: float = 0.0
    chunk_began: float | None = None
    unsaved_since: float | None = None
    last_ns: int = 0
    dropped: int = 0
    dropped_told: int = 0
    pause_began: int = 0
    retry_at: float = 0.0
    unchecked: int = 0
    odd: set[str] = dataclasses.field(default_factory=set)
    early: list[Event] = dataclasses.field(default_factory=list)


def free_bytes(folder: Path) -> int:
    """Bytes free on the disk of a folder."""
    return shutil.disk_usage(folder).free


class Recorder:
    """
    Records messages into bags below a folder.

    Parameters
    ----------
    folder : Path
        Created if missing; one recorder at a time may use it.
    settings : RecorderSettings
    definitions : Definitions, optional
        Where schema texts come from; by default this installation's.
    tables : callable, optional
        Returns named tables of strings (versions, parameters) that are put into every file as metadata.
    event_topic : str
        Full name of the topic under which events are recorded, as rcl_interfaces/Log.
    on_event : callable, optional
        Called with each Event from the writer thread; must return quickly, and may call nothing here that waits.
    space : callable
        Bytes free for a folder; replaced in tests.
    recover : bool
        Recover what earlier recordings in the folder left unfinished, in the background.

    Attributes
    ----------
    events : deque of Event
        The last 200, for a late reader; `take_events` is for one that wants each once.

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
        on_event: Callable[[Event], None] | None = None,
        space: Callable[[Path], int] = free_bytes,
        recover: bool = True,
    ) -> None:
        self.folder = Path(folder)
        self.settings = settings or RecorderSettings()
        self.events: deque[Event] = deque(maxlen=200)
        self._untaken: deque[Event] = deque(maxlen=1000)
        self._definitions = definitions or installed()
        self._tables = tables
        self._event_topic = event_topic
        self._on_event = on_event
        self._space = space
        self._queue: deque[_Item | _Command] = deque()
        self._queued_bytes = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._session: _Session | None = None
        self._ring: deque[tuple[float, _Item]] = deque()
        self._ring_bytes = 0
        self._taking = self.settings.snapshot_seconds > 0
        self._refused = 0
        self._state, self._reason = State.STOPPED, ""
        self._free = -1
        self._checked_at = -1e9
        self._closing = False
        self._deadline: float | None = None
        self._recovered: list[recovery.Report] = []
        self._lock_file = self._locked()
        # The list is taken before this recorder can begin a bag of its own.
        earlier = sorted(item for item in self.folder.iterdir() if item.is_dir()) if recover else []
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        self._recovery: threading.Thread | None = None
        if earlier:
            self._recovery = threading.Thread(target=self._recover, args=(earlier,), name="recovery", daemon=True)
            self._recovery.start()

    # For the caller's thread

    def put(
        self,
        topic: str,
        type_name: str,
        data: bytes,
        log_ns: int,
        publish_ns: int | None = None,
        qos: str = "",
        type_hash: str = "",
    ) -> bool:
        """
        Hand over one serialised message; never waits.

        Parameters
        ----------
        topic, type_name : str
            Full name, and ``package/msg/Name``.
        data : bytes
            As it came from the middleware; must not be changed afterwards.
        log_ns, publish_ns : int
            When it was received and published, ns since the epoch.
        qos, type_hash : str
            Offered profiles as YAML and RIHS01 hash; looked at when the topic is first seen.

        Returns False when it was not taken: nothing is being recorded, or the queue is full (then it is counted).
        """
        if not self._taking:
            return False
        size = len(data) + _OVERHEAD
        with self._lock:
            if self._queued_bytes + size > self.settings.queue_bytes:
                self._refused += 1
                return False
            self._queued_bytes += size
            self._queue.append(
                (topic, type_name, data, log_ns, log_ns if publish_ns is None else publish_ns, qos, type_hash)
            )
            hurry = self._queued_bytes > self.settings.queue_bytes // 4
        if hurry:
            self._wake.set()
        return True

    def start(self, name: str = "", custom: Mapping[str, str] | None = None, timeout_s: float = 3.0) -> Path:
        """
        Begin a recording; returns its folder.

        name : folder's name below `folder`; by default the time of day. custom : ``custom_data`` of metadata.yaml.

        Raises
        ------
        RecorderError
            One is running already, the name is taken or no plain name, or the disk refuses.
        """
        path: Path = self._ask(lambda: self._start(name, dict(custom or {})), timeout_s)
        return path

    def stop(self, timeout_s: float = 3.0) -> Path:
        """
        End the recording after everything handed over before; returns its folder.

        Raises
        ------
        RecorderError
            None is running, or the disk did not finish in time (it goes on in the background).
        """
        self._deadline = time.monotonic() + 0.7 * timeout_s
        path: Path = self._ask(self._stop, timeout_s)
        return path

    def split(self, timeout_s: float = 3.0) -> Path:
        """Go on in a new file; returns the finished one. Raises RecorderError as `stop`."""
        path: Path = self._ask(self._split_asked, timeout_s)
        return path

    def snapshot(self, name: str = "", timeout_s: float = 10.0) -> Path:
        """
        Write what the memory holds of the last seconds into a bag of its own; returns its folder.

        Raises
        ------
        RecorderError
            `snapshot_seconds` is 0, nothing has been received, or the disk refuses.
        """
        path: Path = self._ask(lambda: self._snapshot(name), timeout_s)
        return path

    def attach(self, name: str, media_type: str, data: bytes, log_ns: int, timeout_s: float = 3.0) -> None:
        """Keep a file inside the recording. Raises RecorderError when none is running."""
        self._ask(lambda: self._running().writer.attach(name, media_type, data, log_ns), timeout_s)

    def add_metadata(self, name: str, values: Mapping[str, str], timeout_s: float = 3.0) -> None:
        """Keep a named table of strings inside the recording. Raises RecorderError when none is running."""
        self._ask(lambda: self._running().writer.add_metadata(name, dict(values)), timeout_s)

    def status(self) -> RecorderStatus:
        """What a display shows; never waits."""
        session, now = self._session, time.monotonic()
        return RecorderStatus(
            state=self._state,
            reason=self._reason,
            path=session.writer.path if session else None,
            messages=session.writer.messages if session else 0,
            bytes=session.writer.bytes_written if session else 0,
            dropped=self._refused + session.dropped if session else 0,
            queued_messages=len(self._queue),
            queued_bytes=self._queued_bytes,
            queue_limit=self.settings.queue_bytes,
            free_bytes=self._free,
            duration_s=now - session.began if session else 0.0,
            files=len(session.writer.files) + int(session.writing) if session else 0,
            unsaved_s=now - session.unsaved_since if session and session.unsaved_since is not None else 0.0,
            recovered=tuple(self._recovered),
        )

    def take_events(self) -> list[Event]:
        """Events since the last call, oldest first (of very many, the last 1000); never waits."""
        taken = []
        # Another thread appends meanwhile; popping one by one is safe against that.
        while self._untaken:
            taken.append(self._untaken.popleft())
        return taken

    def close(self, timeout_s: float = 2.8) -> bool:
        """
        End the recording and the threads; returns whether all was finished within the time.

        A queue that a slow disk does not take in that time is dropped and counted; the file then still gets its end if
        the disk answers at all, else the next start recovers it.
        """
        if not self._thread.is_alive():
            return True
        self._deadline = time.monotonic() + 0.7 * timeout_s
        self._taking = False
        self._closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        done = not self._thread.is_alive()
        if self._recovery is not None:
            self._recovery.join(max(0.0, self._deadline + 0.3 * timeout_s - time.monotonic()))
        if done:
            os.close(self._lock_file)
        return done

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, run: Callable[[], Any], timeout_s: float) -> Any:
        if self._closing or not self._thread.is_alive():
            raise RecorderError("the recorder is closed")
        command = _Command(run, concurrent.futures.Future())
        with self._lock:
            self._queue.append(command)
        self._wake.set()
        try:
            return command.answer.result(timeout_s)
        except concurrent.futures.TimeoutError:
            raise RecorderError(f"{self.folder}: the disk did not answer within {timeout_s:g} s") from None
        except OSError as error:
            raise RecorderError(self._words(error)) from error

    def _words(self, error: OSError) -> str:
        return f"{error.filename or self.folder}: {error.strerror or error}"

    def _locked(self) -> int:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.folder / LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise RecorderError(f"recordings cannot be written to {self.folder}: {error.strerror}") from error
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            owner = os.pread(handle, 32, 0).decode(errors="replace").strip()
            os.close(handle)
            raise RecorderError(
                f"another recorder (process {owner or 'unknown'}) writes into {self.folder}; "
                "stop it or choose another folder"
            ) from None
        with contextlib.suppress(OSError):
            # Only a courtesy to whoever comes next; the lock itself needs no content.
            os.ftruncate(handle, 0)
            os.pwrite(handle, str(os.getpid()).encode(), 0)
        return handle

    # For the writer thread

    def _run(self) -> None:
        while True:
            if not self._queue:
                self._wake.wait(self._pause())
            self._wake.clear()
            closing = self._closing
            self._drain(_BATCHES)
            if self._session is not None:
                self._guarded(self._periodic)
            if closing:
                while self._queue:
                    self._drain(_BATCHES)
                if self._session is not None:
                    self._guarded(self._stop)
                self._cancel_rest()
                return

    def _pause(self) -> float:
        # A tenth of a second bounds what waiting adds to the age of unsaved data, and costs nothing.
        return min(0.1, self.settings.chunk_seconds / 2)

    def _drain(self, batches: int) -> None:
        """Take what is in the queue, so many batches at most: time and disk must be looked at in between."""
        for _ in range(batches):
            batch: list[_Item | _Command] = []
            with self._lock:
                while self._queue and len(batch) < _BATCH:
                    item = self._queue.popleft()
                    batch.append(item)
                    if not isinstance(item, _Command):
                        self._queued_bytes -= len(item[2]) + _OVERHEAD
            if not batch:
                return
            for item in batch:
                if isinstance(item, _Command):
                    self._carry_out(item)
                else:
                    self._take(item)

    def _carry_out(self, command: _Command) -> None:
        try:
            command.answer.set_result(command.run())
        except Exception as error:  # noqa: BLE001  (whatever it is belongs to the one who asked)
            command.answer.set_exception(error)

    def _cancel_rest(self) -> None:
        with self._lock:
            rest = [item for item in self._queue if isinstance(item, _Command)]
            self._queue.clear()
            self._queued_bytes = 0
        for command in rest:
            command.answer.set_exception(RecorderError("the recorder is closed"))

    def _take(self, item: _Item) -> None:
        if self.settings.snapshot_seconds > 0:
            self._keep(item)
        session = self._session
        if session is None:
            return
        if not session.writing or (self._deadline is not None and time.monotonic() > self._deadline):
            session.dropped += 1
            return
        before = session.writer.messages
        try:
            self._write(session, item)
        except OSError as error:
            # A message that reached the chunk at hand is not lost yet: it goes with the chunk.
            session.dropped += session.writer.messages == before
            self._disk_failed(session, error)
        except Exception as error:  # noqa: BLE001  (one odd message must not end the recording of the others)
            session.dropped += 1
            if item[0] not in session.odd:
                session.odd.add(item[0])
                self._tell(Level.WARNING, f"messages of {item[0]} cannot be recorded: {error}")

    def _write(self, session: _Session, item: _Item) -> None:
        topic, type_name, data, log_ns, publish_ns, qos, type_hash = item
        if log_ns < 0:
            raise ValueError(f"its stamp {log_ns} lies before 1970")
        channel = session.channels.get((topic, type_name))
        if channel is None:
            channel = self._declare(session, topic, type_name, qos, type_hash)
        jump = self.settings.time_jump_seconds * 1e9
        if jump and session.last_ns and abs(log_ns - session.last_ns) > jump:
            text = f"the clock jumped by {(log_ns - session.last_ns) * 1e-9:+.0f} s; a new file was begun"
            session.last_ns = log_ns
            self._new_file(session)
            if not session.writing:
                session.dropped += 1
                return
            self._tell(Level.WARNING, text)
        session.last_ns = log_ns
        if session.early:
            self._record_early(session)
        size_before = session.writer.file.size
        session.writer.write(channel, data, log_ns, publish_ns)
        session.unchecked += len(data)
        now = time.monotonic()
        if session.unsaved_since is None:
            session.unsaved_since = now
        if session.writer.file.size != size_before:
            session.chunk_began = None
            self._after_chunk(session)
        elif session.chunk_began is None:
            session.chunk_began = now

    def _declare(self, session: _Session, topic: str, type_name: str, qos: str, type_hash: str) -> int:
        try:
            profiles = bag_metadata.parse_qos(qos)
        except ValueError as error:
            profiles = []
            self._tell(Level.WARNING, f"{topic}: recorded without its quality of service: {error}")
        channel = session.writer.topic(topic, type_name, profiles, type_hash, need_definition=False)
        session.channels[topic, type_name] = channel
        if not session.writer.has_definition(channel):
            self._tell(Level.WARNING, f"{topic}: recorded without a definition, for {type_name} is unknown here")
        return channel

    def _by_time(self) -> None:
        """Close a chunk that is old enough."""
        session = self._session
        if session is None or session.chunk_began is None:
            return
        if time.monotonic() - session.chunk_began >= self.settings.chunk_seconds:
            session.writer.file.close_chunk()
            session.chunk_began = None
            self._after_chunk(session)

    def _after_chunk(self, session: _Session) -> None:
        limit = self.settings.split_bytes
        if limit and session.writer.file.size >= limit:
            self._new_file(session)
        if session.unchecked > 8 * 1024 * 1024:
            self._watch_disk(session)

    def _periodic(self) -> None:
        """What is due by time: chunk, sync, split, disk, drops."""
        session, now = self._session, time.monotonic()
        if session is None:
            return
        if now - self._checked_at >= 0.5 or not session.writing:
            self._watch_disk(session)
        if not session.writing:
            return
        self._by_time()
        waiting = session.unsaved_since
        if waiting is not None and now - waiting >= self.settings.sync_seconds:
            # The chunk at hand goes too: else a quiet topic's message could wait for a chunk and then for a sync.
            session.writer.file.close_chunk()
            session.chunk_began = None
            session.writer.file.sync()
            session.unsaved_since = None
        if self.settings.split_seconds and now - session.file_began >= self.settings.split_seconds:
            self._new_file(session)
        dropped = self._refused + session.dropped
        if dropped > session.dropped_told:
            count = dropped - session.dropped_told
            session.dropped_told = dropped
            self._tell(Level.ERROR, f"{count} messages were lost: the disk is slower than the data")

    def _watch_disk(self, session: _Session) -> None:
        self._checked_at, session.unchecked = time.monotonic(), 0
        try:
            self._free = self._space(self.folder)
        except OSError as error:
            self._free = -1
            if session.writing:
                self._disk_failed(session, error)
            return
        low = self.settings.min_free_bytes
        if session.writing and self._free < low:
            reason = f"{self._free / 1e6:.0f} MB free on the disk of {self.folder}, {low / 1e6:.0f} MB must stay free"
            self._pause_writing(session, State.PAUSED_DISK_FULL, reason)
        elif not session.writing and self._free >= low + low // 8 and time.monotonic() >= session.retry_at:
            self._resume(session)

    def _pause_writing(self, session: _Session, state: State, reason: str) -> None:
        self._tell(Level.ERROR, f"recording paused: {reason}")
        session.writing = False
        session.pause_began = time.time_ns()
        session.retry_at = time.monotonic() + self.settings.retry_seconds
        session.unsaved_since = session.chunk_began = None
        try:
            session.writer.finish_file(sync=True)
        except OSError:
            # No room even for the chunk at hand or for the summary: without the chunk there may be.
            session.dropped += session.writer.file.discard_pending()
            try:
                session.writer.finish_file(sync=True)
            except OSError:
                session.dropped += session.writer.give_up_file()
                self._tell(Level.ERROR, f"{session.writer.file.path.name} has no end; the next start recovers it")
        # Only now: whoever sees the pause may rely on the file.
        self._state, self._reason = state, reason

    def _disk_failed(self, session: _Session, error: OSError) -> None:
        full = error.errno in _FULL
        reason = self._words(error)
        self._pause_writing(session, State.PAUSED_DISK_FULL if full else State.FAILED, reason)

    def _resume(self, session: _Session) -> None:
        session.retry_at = time.monotonic() + self.settings.retry_seconds
        try:
            session.writer.begin_file()
        except OSError as error:
            self._reason = self._words(error)
            return
        session.writing, session.file_began = True, time.monotonic()
        self._state, self._reason = State.RECORDING, ""
        lost = self._refused + session.dropped - session.dropped_told
        session.dropped_told += lost
        seconds = (time.time_ns() - session.pause_began) * 1e-9
        self._put_tables(session)
        self._tell(Level.WARNING, f"recording goes on after a pause of {seconds:.0f} s; {lost} messages were lost")

    def _guarded(self, step: Callable[[], Any]) -> None:
        session = self._session
        try:
            step()
        except OSError as error:
            if session is not None and session.writing:
                self._disk_failed(session, error)
            else:
                self._tell(Level.ERROR, self._words(error))
        except Exception as error:  # noqa: BLE001  (the thread must live, for messages keep coming)
            self._tell(Level.ERROR, f"the recorder met a mistake of its own: {error!r}")

    def _start(self, name: str, custom: dict[str, str]) -> Path:
        if self._session is not None:
            raise RecorderError(f"a recording is running already: {self._session.writer.path}")
        path = self._path(name, "mwd")
        self._free = self._space(self.folder)
        if self._free < self.settings.min_free_bytes:
            raise RecorderError(
                f"only {self._free / 1e6:.0f} MB are free on the disk of {self.folder}; "
                f"{self.settings.min_free_bytes / 1e6:.0f} MB must stay free (min_free_bytes)"
            )
        now = time.monotonic()
        session = _Session(self._writer(path, custom, in_place=True), began=now, file_began=now)
        self._put_tables(session)
        self._refused, self._deadline = 0, None
        self._session = session
        self._state, self._reason = State.RECORDING, ""
        self._taking = True
        self._tell(Level.INFO, f"recording to {path}")
        return path

    def _stop(self) -> Path:
        session = self._running()
        self._taking = self.settings.snapshot_seconds > 0 and not self._closing
        dropped = self._refused + session.dropped
        text = f"recording of {session.writer.path} stopped"
        if dropped:
            text += f"; {dropped} messages were lost"
        self._tell(Level.WARNING if dropped else Level.INFO, text)
        try:
            if session.writing:
                self._record_early(session)
                session.writer.close(sync=True)
        except OSError as error:
            self._disk_failed(session, error)
        self._session, self._deadline = None, None
        self._state, self._reason = State.STOPPED, ""
        return session.writer.path

    def _split_asked(self) -> Path:
        session = self._running()
        if not session.writing:
            raise RecorderError(f"the recording is paused: {self._reason}")
        done = session.writer.file.path
        self._new_file(session)
        return done

    def _new_file(self, session: _Session) -> None:
        session.writer.finish_file(sync=True)
        session.chunk_began = session.unsaved_since = None
        try:
            session.writer.begin_file()
        except OSError as error:
            session.writing = False
            session.pause_began = time.time_ns()
            session.retry_at = time.monotonic() + self.settings.retry_seconds
            full = error.errno in _FULL
            self._state = State.PAUSED_DISK_FULL if full else State.FAILED
            self._reason = self._words(error)
            self._tell(Level.ERROR, f"recording paused: {self._reason}")
            return
        session.file_began = time.monotonic()
        self._put_tables(session)

    def _put_tables(self, session: _Session) -> None:
        for name, values in self._tables().items():
            session.writer.add_metadata(name, values)

    def _snapshot(self, name: str) -> Path:
        if self.settings.snapshot_seconds <= 0:
            raise RecorderError("no snapshot is kept: snapshot_seconds is 0")
        if not self._ring:
            raise RecorderError("nothing was received yet that a snapshot could hold")
        path = self._path(name, "snapshot")
        with self._writer(path, {}, in_place=False) as writer:
            for _, (topic, type_name, data, log_ns, publish_ns, qos, type_hash) in self._ring:
                try:
                    profiles = bag_metadata.parse_qos(qos)
                except ValueError:
                    profiles = []
                channel = writer.topic(topic, type_name, profiles, type_hash, need_definition=False)
                writer.write(channel, data, max(log_ns, 0), publish_ns)
            for table, values in self._tables().items():
                writer.add_metadata(table, values)
        self._tell(Level.INFO, f"snapshot written to {path}")
        return path

    def _keep(self, item: _Item) -> None:
        now = time.monotonic()
        self._ring.append((now, item))
        self._ring_bytes += len(item[2]) + _OVERHEAD
        while self._ring and (
            now - self._ring[0][0] > self.settings.snapshot_seconds or self._ring_bytes > self.settings.snapshot_bytes
        ):
            self._ring_bytes -= len(self._ring.popleft()[1][2]) + _OVERHEAD

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

    def _path(self, name: str, prefix: str) -> Path:
        if name:
            if name != Path(name).name or name.startswith("."):
                raise RecorderError(f"{name!r} is no plain name for a recording")
            path = self.folder / name
            if path.exists():
                raise RecorderError(f"{path} exists already; choose another name")
            return path
        now = datetime.datetime.now(datetime.UTC)
        base = f"{prefix}_{now:%Y%m%dT%H%M%SZ}"
        names = [base, *(f"{base}_{k}" for k in range(2, 1000))]
        return next(self.folder / one for one in names if not (self.folder / one).exists())

    def _running(self) -> _Session:
        if self._session is None:
            raise RecorderError("no recording is running")
        return self._session

    def _tell(self, level: Level, text: str) -> None:
        event = Event(time.time_ns(), level, text)
        self._note(event)
        session = self._session
        if session is not None and session.writing:
            if session.last_ns:
                # A disk that refuses the event is about to be met, and handled, by the messages themselves.
                with contextlib.suppress(OSError):
                    self._record_event(session, event)
            else:
                session.early.append(event)
        if self._on_event is not None:
            try:
                self._on_event(event)
            except Exception as error:  # noqa: BLE001  (a listener's mistake must not end the recording)
                self._note(Event(time.time_ns(), Level.ERROR, f"a listener to events failed: {error!r}"))

    def _note(self, event: Event) -> None:
        self.events.append(event)
        self._untaken.append(event)

    def _record_early(self, session: _Session) -> None:
        """Events from before the first message: only now is the recording's own time known."""
        early, session.early = session.early, []
        for event in early:
            self._record_event(session, event)

    def _record_event(self, session: _Session, event: Event) -> None:
        self._definitions.load(EVENT_TYPE)
        types = self._definitions.typestore.types
        sec, nanosec = divmod(event.stamp_ns, 1_000_000_000)
        message = types[EVENT_TYPE](
            types["builtin_interfaces/msg/Time"](sec, nanosec), int(event.level), "recorder", event.text, "", "", 0
        )
        data = bytes(self._definitions.typestore.serialize_cdr(message, EVENT_TYPE))
        channel = session.writer.topic(self._event_topic, EVENT_TYPE)
        # In the recording's own time, which may be a simulation's.
        session.writer.write(channel, data, session.last_ns or event.stamp_ns)
        if session.chunk_began is None:
            session.chunk_began = time.monotonic()
        if session.unsaved_since is None:
            session.unsaved_since = time.monotonic()

    # For the recovery thread

    def _recover(self, bags: list[Path]) -> None:
        for bag in bags:
            try:
                if self._closing or not recovery.is_unfinished(bag):
                    continue
                reports = recovery.recover_bag(bag, lambda: not self._closing, thorough=False)
            except InterruptedError:
                return
            except OSError as error:
                self._tell_later(Level.ERROR, f"{bag} could not be recovered: {error}")
                continue
            for report in reports:
                self._recovered.append(report)
                if not report.sound:
                    self._tell_later(Level.WARNING, f"recovered in {bag.name}: {report.sentence()}")

    def _tell_later(self, level: Level, text: str) -> None:
        # Events are written by the writer thread only.
        with self._lock:
            self._queue.append(_Command(lambda: self._tell(level, text), concurrent.futures.Future()))

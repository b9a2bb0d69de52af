"""
The recorder: everything handed to it ends in a bag, written by a thread of its own.

The caller never waits: a message goes into a queue bounded in bytes, and what does not fit is counted and becomes an
event inside the recording. Chunks are closed and made durable by time, so that a killed process or a lost supply costs
at most `chunk_seconds` + `sync_seconds` of data; what such an end leaves is recovered at the next start.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import datetime
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import Definitions, installed
from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.mcap.recovery_report import RecoveryReport
from mwd_surface.bags.recorder.session import OVERHEAD, Item, Session, free_bytes, words_of
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.snapshot import SnapshotRing
from mwd_surface.bags.recorder.status import Level, RecorderEvent, RecorderState, RecorderStatus

LOCK_NAME = ".recorder.lock"
_BATCH = 1000
_BATCHES = 20


class RecorderError(Exception):
    """A recorder that cannot do what was asked; one sentence with path and reason."""


@dataclasses.dataclass
class _Command:
    """A request carried out by the writer thread, in its place among the messages."""

    run: Callable[[], Any]
    answer: concurrent.futures.Future[Any]


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
        Called with each RecorderEvent from the writer thread; must return quickly and not wait for the recorder.
    space : callable
        Bytes free for a folder; replaced in tests.
    recover : bool
        Recover what earlier recordings in the folder left unfinished, in the background.

    Attributes
    ----------
    events : deque of RecorderEvent
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
        on_event: Callable[[RecorderEvent], None] | None = None,
        space: Callable[[Path], int] = free_bytes,
        recover: bool = True,
    ) -> None:
        self.folder = Path(folder)
        self.settings = settings or RecorderSettings()
        self.events: deque[RecorderEvent] = deque(maxlen=200)
        self._untaken: deque[RecorderEvent] = deque(maxlen=1000)
        self._definitions = definitions or installed()
        self._tables = tables
        self._event_topic = event_topic
        self._on_event = on_event
        self._space = space
        self._queue: deque[Item | _Command] = deque()
        self._queued_bytes = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._session: Session | None = None
        kept = self.settings.snapshot_seconds
        self._ring = SnapshotRing(kept, self.settings.snapshot_bytes) if kept > 0 else None
        self._taking = self._ring is not None
        self._refused = 0
        self._free = -1
        self._closing = False
        self._deadline: float | None = None
        self._recovered: list[RecoveryReport] = []
        self._folder_lock = self._locked()
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
        size = len(data) + OVERHEAD
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
        waiting = session.unsaved_since if session else None
        return RecorderStatus(
            state=session.state if session else RecorderState.STOPPED,
            reason=session.reason if session else "",
            path=session.writer.path if session else None,
            messages=session.writer.messages if session else 0,
            bytes=session.writer.bytes_written if session else 0,
            dropped=session.lost if session else 0,
            queued_messages=len(self._queue),
            queued_bytes=self._queued_bytes,
            queue_limit=self.settings.queue_bytes,
            free_bytes=session.free if session else self._free,
            duration_s=now - session.began if session else 0.0,
            files=len(session.writer.files) + int(session.writing) if session else 0,
            unsaved_s=now - waiting if waiting is not None else 0.0,
            recovered=tuple(self._recovered),
        )

    def take_events(self) -> list[RecorderEvent]:
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
            self._folder_lock.free()
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
        return words_of(error, self.folder)

    def _locked(self) -> FolderLock:
        try:
            return FolderLock(self.folder, LOCK_NAME)
        except OSError as error:
            raise RecorderError(f"recordings cannot be written to {self.folder}: {error.strerror}") from error
        except FolderTakenError as error:
            raise RecorderError(
                f"another recorder (process {error.owner}) writes into {self.folder}; stop it or choose another folder"
            ) from None

    # For the writer thread

    def _run(self) -> None:
        while True:
            if not self._queue:
                self._wake.wait(self._pause())
            self._wake.clear()
            closing = self._closing
            self._drain(_BATCHES)
            if self._session is not None:
                self._guarded(self._session.periodic)
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
            batch: list[Item | _Command] = []
            with self._lock:
                while self._queue and len(batch) < _BATCH:
                    item = self._queue.popleft()
                    batch.append(item)
                    if not isinstance(item, _Command):
                        self._queued_bytes -= len(item[2]) + OVERHEAD
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

    def _take(self, item: Item) -> None:
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
        self._refused, self._deadline = 0, None
        self._session = Session(
            self._writer(path, custom, in_place=True),
            self.folder,
            self.settings,
            self._definitions,
            event_topic=self._event_topic,
            tables=self._tables,
            space=self._space,
            refused=lambda: self._refused,
            tell=self._tell,
        )
        self._session.free = self._free
        self._taking = True
        self._tell(Level.INFO, f"recording to {path}")
        return path

    def _stop(self) -> Path:
        session = self._running()
        self._taking = self._ring is not None and not self._closing
        lost = session.lost
        text = f"recording of {session.writer.path} stopped"
        if lost:
            text += f"; {lost} messages were lost"
        self._tell(Level.WARNING if lost else Level.INFO, text)
        session.finish()
        self._session, self._deadline, self._free = None, None, session.free
        return session.writer.path

    def _split_asked(self) -> Path:
        session = self._running()
        if not session.writing:
            raise RecorderError(f"the recording is paused: {session.reason}")
        return session.split()

    def _snapshot(self, name: str) -> Path:
        if self._ring is None:
            raise RecorderError("no snapshot is kept: snapshot_seconds is 0")
        if not len(self._ring):
            raise RecorderError("nothing was received yet that a snapshot could hold")
        path = self._path(name, "snapshot")
        with self._writer(path, {}, in_place=False) as writer:
            self._ring.write(writer)
            for table, values in self._tables().items():
                writer.add_metadata(table, values)
        self._tell(Level.INFO, f"snapshot written to {path}")
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

    def _running(self) -> Session:
        if self._session is None:
            raise RecorderError("no recording is running")
        return self._session

    def _tell(self, level: Level, text: str) -> None:
        event = RecorderEvent(time.time_ns(), level, text)
        self._note(event)
        if self._session is not None:
            self._session.record(event)
        if self._on_event is not None:
            try:
                self._on_event(event)
            except Exception as error:  # noqa: BLE001  (a listener's mistake must not end the recording)
                self._note(RecorderEvent(time.time_ns(), Level.ERROR, f"a listener to events failed: {error!r}"))

    def _note(self, event: RecorderEvent) -> None:
        self.events.append(event)
        self._untaken.append(event)

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

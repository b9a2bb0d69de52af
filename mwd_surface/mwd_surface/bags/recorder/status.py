# SPDX-License-Identifier: Apache-2.0
"""State, status and events of the recorder, as its users see them."""

from __future__ import annotations

import dataclasses
import enum
from pathlib import Path

from mwd_surface.bags.mcap.recovery_report import RecoveryReport


class RecorderError(Exception):
    """A request that the recorder cannot carry out; one sentence with path and reason, and what to do about it."""

    def __init__(self, text: str, remedy: str = "free the disk, or make its folder writable") -> None:
        super().__init__(text)
        self.remedy = remedy


class RecorderState(enum.IntEnum):
    """State of the recorder; the numbers of mwd_msgs/RecorderStatus."""

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
class RecorderEvent:
    """An event of the recorder for the log; stamp_ns in ns since the epoch."""

    stamp_ns: int
    level: Level
    text: str


@dataclasses.dataclass(frozen=True)
class RecorderStatus:
    """
    Status of the recorder.

    Attributes
    ----------
    state : RecorderState
    reason : str
        Why it is paused or failed; empty otherwise.
    path : Path or None
        Folder of the current recording.
    messages, bytes : int
        Written in this recording; bytes on disk.
    dropped : int
        Received since the recording began but not written, because the queue or the disk was full.
    queued_messages, queued_bytes, queue_limit : int
        Waiting to be written, and the limit, bytes.
    free_bytes : int
        On the disk; -1 unknown.
    duration_s : float
        Since the recording began.
    files : int
        Of this recording.
    unsaved_s : float
        Age of the oldest data not yet forced to the disk, which a power failure would lose.
    recovered : tuple of RecoveryReport
        Files of earlier recordings recovered at this start.
    """

    state: RecorderState
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
    recovered: tuple[RecoveryReport, ...]

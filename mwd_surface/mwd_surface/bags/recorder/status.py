# SPDX-License-Identifier: Apache-2.0
"""State, status and events of the recorder, for its users."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import ClassVar

from mwd_sensors.core.message_record import MessageRecord


class RecorderError(Exception):
    """Raised if the recorder cannot carry out a request; the text gives path and reason, and `remedy` the advice."""

    def __init__(self, text: str, remedy: str = "free space on the disk, or make its folder writable") -> None:
        super().__init__(text)
        self.remedy = remedy


class RecorderState(enum.IntEnum):
    """State of the recorder, numbered as in mwd_msgs/RecorderStatus."""

    STOPPED = 0
    RECORDING = 1
    PAUSED_DISK_FULL = 2
    FAILED = 3


class EventLevel(enum.IntEnum):
    """Severity of an event, as in rcl_interfaces/Log."""

    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclasses.dataclass(frozen=True)
class RecorderEvent:
    """An event of the recorder for the log; `stamp_ns` is in ns since the epoch."""

    stamp_ns: int
    level: EventLevel
    text: str


@dataclasses.dataclass(frozen=True, eq=False)
class RecorderStatus(MessageRecord):
    """Status of the recorder; the fields that are sent are those of mwd_msgs/RecorderStatus."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/RecorderStatus"
    NOT_SENT: ClassVar[frozenset[str]] = frozenset({"queued_bytes", "queue_limit", "files"})

    state: RecorderState
    reason: str = ""  #: reason of a pause or failure; otherwise empty
    path: str = ""  #: folder of the current recording; empty if there is none
    #: `messages`, `bytes`: number of messages written in this recording, and number of their bytes on disk.
    messages: int = 0
    bytes: int = 0
    #: Number of messages received since the recording began but not written because queue or disk was full.
    dropped: int = 0
    free_bytes: float = math.nan  #: free bytes on the disk; NaN if unknown
    duration: float = 0.0  #: time since the recording began, s
    #: `queued_bytes`, `queue_limit`: number of bytes waiting to be written, and its limit.
    queued_bytes: int = 0
    queue_limit: int = 0
    files: int = 0  #: number of files of this recording

# SPDX-License-Identifier: Apache-2.0
"""
Bit depth by counting rods: the rods in the hole with their lengths, and the log of every change.

The depth is the length in front of the first rod plus the lengths of the rods in the hole. The operator enters each rod
that is added or removed. If the operator counts another number of rods than the tally has, the operator corrects the
tally and gives a reason. Each change is appended to the log, a table with one line for each change; reading the log
again restores the tally. A line that is incomplete after a crash does not affect the other lines.
"""

from __future__ import annotations

import csv
import dataclasses
import errno
import io
import math
import os
from pathlib import Path

from mwd_sensors.core.output_files import sync_folder
from mwd_sensors.core.settings import setting
from mwd_surface.signals.cells import plain, utc

COLUMNS = ("stamp_ns", "time_utc", "action", "length_m", "rods", "bit_depth_m", "operator", "reason")
_HEAD = ",".join(COLUMNS)
ADD, REMOVE, CORRECT = "add", "remove", "correct"
_MOST = 5000  # largest number of rods; a larger count is a typing error
_MOST_BYTES = 2 * 1024 * 1024  # largest number of bytes of a log that are read; about 20 000 changes


@dataclasses.dataclass(frozen=True)
class RodSettings:
    """Settings for counting the bit depth by rods."""

    length_m: float | None = setting(
        None, "Length of a rod. nan: the depth is not counted by rods.", low=0.1, high=30.0
    )
    first_m: float = setting(
        0.0, "Bit depth without a rod in the hole: the length of bit, probe and motor.", low=0.0, high=100.0
    )


@dataclasses.dataclass(frozen=True)
class RodChange:
    """One change of the rods in the hole, which is one line of the log."""

    stamp_ns: int
    action: str
    length: float  #: length of each changed rod, m
    #: `rods`, `bit_depth`: number of rods and bit depth, m, after the change.
    rods: int
    bit_depth: float
    operator: str
    reason: str = ""

    def line(self) -> str:
        """Return the change as a line of the log."""
        out = io.StringIO()
        cells = (self.length, self.rods, self.bit_depth, self.operator, self.reason)
        csv.writer(out, lineterminator="\n").writerow((self.stamp_ns, utc(self.stamp_ns), self.action, *cells))
        return out.getvalue()


@dataclasses.dataclass(frozen=True)
class RodTally:
    """Rods in the hole."""

    first: float  #: bit depth without a rod, m
    lengths: tuple[float, ...] = ()  #: length of each rod, m, starting at the bit
    changes: tuple[RodChange, ...] = ()  #: all changes of the tally so far, oldest first

    @property
    def bit_depth(self) -> float:
        """Measured depth of the bit, m."""
        return self.first + math.fsum(self.lengths)

    def add(self, stamp_ns: int, length: float, operator: str, reason: str = "") -> RodTally:
        """
        Return the tally with one more rod; length: length of the rod, m.

        Raises
        ------
        ValueError
            The length is not positive or above 30 m, there are too many rods, or the operator is empty.
        """
        _check_length(length)
        return self._with((*self.lengths, length), ADD, length, stamp_ns, operator, reason)

    def remove(self, stamp_ns: int, operator: str, reason: str = "") -> RodTally:
        """
        Return the tally without the last rod, at the collar of the hole.

        Raises
        ------
        ValueError
            There is no rod in the hole, or the operator is empty.
        """
        if not self.lengths:
            raise ValueError(
                "according to the tally no rod is in the hole; correct the tally to the number that you count"
            )
        return self._with(self.lengths[:-1], REMOVE, self.lengths[-1], stamp_ns, operator, reason)

    def correct(self, stamp_ns: int, count: int, length: float, operator: str, reason: str) -> RodTally:
        """
        Return the tally with the counted number of rods; rods are added or removed at the collar of the hole.

        Raises
        ------
        ValueError
            The reason or the operator is empty, or the count or the length of a rod is not possible.
        """
        _check_length(length)
        if not plain(reason):
            raise ValueError("reason: a correction of the tally needs one, for the log")
        if count < 0:
            raise ValueError(f"count: must not be negative, got {count}")
        missing = max(0, min(count, _MOST + 1) - len(self.lengths))
        lengths = (*self.lengths[:count], *[length] * missing)
        return self._with(lengths, CORRECT, length, stamp_ns, operator, reason)

    def _with(
        self, lengths: tuple[float, ...], action: str, length: float, stamp_ns: int, operator: str, reason: str
    ) -> RodTally:
        operator, reason = plain(operator), plain(reason)  # without line breaks: a change is one line of the log
        if not operator:
            raise ValueError("operator_name: must not be empty: it goes into the log")
        if len(lengths) > _MOST:
            raise ValueError(f"count: more than {_MOST} rods are not possible, got {len(lengths)}")
        depth = self.first + math.fsum(lengths)
        change = RodChange(stamp_ns, action, length, len(lengths), depth, operator, reason)
        return RodTally(self.first, lengths, (*self.changes, change))


def _check_length(length: float) -> None:
    if not (math.isfinite(length) and 0.0 < length <= 30.0):
        raise ValueError(f"length: a rod is longer than 0 m and at most 30 m, got {length:g}")


def disagreement(tally: RodTally, bit_depth: float, length: float, rods: float = 0.5) -> str:
    """
    Return a sentence if the depths of tally and rig differ by `rods` rods or more; otherwise an empty text.

    bit_depth: bit depth of the rig, m; NaN, if unknown, gives an empty text. length: length of a rod, m. rods: smallest
    difference that is reported, in rod lengths.
    """
    apart = tally.bit_depth - bit_depth
    if not math.isfinite(apart) or abs(apart) < rods * length:
        return ""
    way = "too many" if apart > 0.0 else "too few"
    return (
        f"{len(tally.lengths)} rods make {tally.bit_depth:.2f} m, the rig says {bit_depth:.2f} m: {way} rods are"
        f" in the tally (difference: {abs(apart) / length:.1f} rods), or the depth of the rig is wrong"
    )


def read_log(data: bytes, first: float) -> tuple[RodTally, int]:
    """
    Return the tally of a log, and the number of lines that cannot be read, such as a line that is incomplete.

    first: bit depth without a rod, m. Unreadable lines before a correction are not counted, because the correction sets
    the number of rods.
    """
    tally, bad = RodTally(first), 0
    # Each line is parsed by itself, so that a cell without closing quote does not include the next lines.
    for line in data.decode("utf-8-sig", errors="replace").split("\n"):
        if _HEAD.startswith(line.rstrip("\r")):
            continue
        try:
            tally = _changed(tally, next(csv.reader([line])))
        except (ValueError, csv.Error, StopIteration):
            bad += 1
        else:
            bad = 0 if tally.changes[-1].action == CORRECT else bad
    return tally, bad


def _changed(tally: RodTally, row: list[str]) -> RodTally:
    """Return a tally after the change in a row of the log; a row that is not a change raises ValueError."""
    stamp, _, action, length, rods, _, operator, reason = row
    stamp_ns = int(stamp)
    if not 0 <= stamp_ns < 2**63 or action not in (ADD, REMOVE, CORRECT):
        raise ValueError(row)
    if action == ADD:
        return tally.add(stamp_ns, float(length), operator, reason)
    if action == REMOVE:
        return tally.remove(stamp_ns, operator, reason)
    return tally.correct(stamp_ns, int(rods), float(length), operator, reason)


class RodLog:
    """
    The log of rods on disk.

    Parameters
    ----------
    most_bytes : int
        Largest number of bytes to read. Of a longer file only the end is read; its cut-off beginning counts as one
        unreadable line.
    """

    def __init__(self, path: Path, most_bytes: int = _MOST_BYTES) -> None:
        self.path, self._most = path, most_bytes
        self._kept = 0  # number of the tally's changes that are in the file

    def read(self, first: float) -> tuple[RodTally, int]:
        """
        Return the tally and the number of unreadable lines, as `read_log`; an empty tally if there is no file.

        first: bit depth without a rod, m.

        Raises
        ------
        OSError
            The file cannot be read.
        """
        if not self.path.exists():
            return RodTally(first), 0
        with self.path.open("rb") as file:
            cut = max(0, file.seek(0, os.SEEK_END) - self._most)
            file.seek(cut)
            data = file.read(self._most)
        tally, bad = read_log(data if not cut else b"?" + data, first)
        self._kept = len(tally.changes)
        return tally, bad

    def holds(self, tally: RodTally) -> bool:
        """Return whether the file holds all changes of a tally."""
        return self._kept == len(tally.changes)

    def keep(self, tally: RodTally) -> None:
        """
        Append the changes of a tally that the file does not hold yet.

        Raises
        ------
        OSError
            The file cannot be written. The next call appends the missing changes.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        # Unbuffered: after a failed write, closing the file does not write the data again.
        with self.path.open("ab+", buffering=0) as file:
            size = file.seek(0, os.SEEK_END)
            if size:
                file.seek(-1, os.SEEK_END)
            head = _HEAD + "\n" if not size else "" if file.read(1) == b"\n" else "\n"
            data = (head + "".join(one.line() for one in tally.changes[self._kept :])).encode()
            try:
                written = file.write(data)
                os.fsync(file.fileno())
            except OSError:
                file.truncate(size)
                raise
            if written != len(data):
                file.truncate(size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        # The lines are in the file even if the folder cannot be synced.
        self._kept = len(tally.changes)
        sync_folder(self.path.parent)

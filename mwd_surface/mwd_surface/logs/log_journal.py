# SPDX-License-Identifier: Apache-2.0
"""
Journal of log samples on disk, from which a restarted surface node restores the log and the health of the tool.

Each line of the file is one JSON value: a sample or, once a second, the bit depth and whether the pumps are on. A line
that is incomplete after a power cut is left out. The size of the file is limited: if the file grows too long, its older
half is dropped, and one line with the sums of the tool's health is written, so that the dropped samples still count.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any, BinaryIO

from mwd_sensors.core.output_files import write_whole
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.tool_health import HealthLedger

NAME = "log_samples.jsonl"
_MOST_BYTES = 64 * 1024 * 1024  # largest size of the file; about a week of data
_SUMS = "sums"
_UNREADABLE = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
_FIELDS = frozenset(field.name for field in dataclasses.fields(LogSample))


class LogJournal:
    """
    Journal of one well; call `close` at the end. Raises OSError if the file cannot be opened.

    Parameters
    ----------
    most_bytes : int
        Size of the file, bytes, above which its older half is dropped.
    """

    def __init__(self, path: Path, most_bytes: int = _MOST_BYTES) -> None:
        self._path, self._most_bytes = path, most_bytes
        self.unreadable = 0  #: number of lines that were left out when the file was read
        self.fault = ""  #: reason why lines cannot be written at present; empty if they can. See `try_again`
        self._health: HealthLedger | None = None
        self._lines: list[str] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            self._lines = lines_of(path)
        self._file: BinaryIO | None = self._opened()
        self._rig_ns = 0

    def _opened(self) -> BinaryIO:
        """Return the file, opened to append; end its last line if a full disk or a power cut left it incomplete."""
        file = self._path.open("a+b")
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            if file.read(1) != b"\n":
                file.write(b"\n")
        self._size = size
        return file

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            # Closing the file writes the last line again, which fails again on a full disk.
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def try_again(self) -> None:
        """Open the file again after a fault; `fault` is set again if the file still cannot be written."""
        if self.fault:
            self.fault = ""
            try:
                self._file = self._opened()
                self._write_sums()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.fault = f"{self._path}: {error.strerror or error}"
        self.close()

    def restore(self, log: DepthLog, health: HealthLedger) -> None:
        """
        Add all data of the file to a log and to a new account of the tool's health.

        The journal writes the sums of this account when it drops lines, and after a fault of the disk. Add each sample
        and each state of the rig to the account before writing it to the journal.
        """
        self.unreadable += restore(self._lines, log, health)
        self._lines, self._health = [], health
        if self._file is not None:
            self._bound()

    def add_sample(self, sample: LogSample) -> None:
        """Write a log sample."""
        self._write({name: _written(value) for name, value in vars(sample).items()})

    def add_rig(self, stamp_ns: int, bit_depth: float | None, pumping: bool | None) -> None:
        """Write the bit depth, m, and whether the pumps are on, at most once a second; None: unknown."""
        if not 0 <= stamp_ns - self._rig_ns < NANOSECONDS:
            self._rig_ns = stamp_ns
            self._write({"at": stamp_ns, "bit": bit_depth, "pumping": pumping})

    def _write(self, row: dict[str, Any]) -> None:
        if self.fault:
            return
        try:
            self._write_line(row)
        except OSError as error:
            self._fail(error)
        else:
            self._bound()

    def _write_line(self, row: dict[str, Any]) -> None:
        line = json.dumps(row, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        self._size += len(line)
        if self._file is not None:
            self._file.write(line)
            self._file.flush()

    def _write_sums(self) -> None:
        if self._health is not None:
            self._write_line({_SUMS: _written(self._health.sums())})

    def _bound(self) -> None:
        """If the file is too long, drop the oldest lines down to half of the largest size, and write the sums again."""
        if self._size <= self._most_bytes:
            return
        self.close()
        try:
            data = self._path.read_bytes()
            write_whole(self._path, data[data.find(b"\n", len(data) - self._most_bytes // 2) + 1 :])
            self._file = self._opened()
            self._write_sums()
        except OSError as error:
            self._fail(error)


def lines_of(path: Path) -> list[str]:
    """Return the lines of a journal; OSError if the file cannot be read."""
    return path.read_bytes().decode(errors="replace").splitlines()


def restore(lines: list[str], log: DepthLog, health: HealthLedger) -> int:
    """Add the data in the lines of a journal to a log and to a new account; return the number of unreadable lines."""
    begin = next((k + 1 for k in range(len(lines))[::-1] if _has_sums(lines[k], health)), 0)
    unreadable = 0
    for k, line in enumerate(lines):
        try:
            _restore(json.loads(line), log, health if k >= begin else None)
        except _UNREADABLE:
            unreadable += 1
    return unreadable


def _restore(row: Any, log: DepthLog, health: HealthLedger | None) -> None:
    if _SUMS in row:
        return
    if "at" in row:
        stamp_ns, depth, pumping = int(row["at"]), row["bit"], row["pumping"]
        if depth is not None:
            log.add_depth(stamp_ns, float(depth))
        if pumping is not None and health is not None:
            health.add_flow(stamp_ns, pumping=bool(pumping))
        return
    sample = LogSample(**{name: _read(value) for name, value in row.items() if name in _FIELDS})
    for valid in log.add([sample]):
        if health is not None:
            health.add(valid)


def _has_sums(line: str, health: HealthLedger) -> bool:
    """Restore an account from the sums in a line; return whether the line has valid sums."""
    if not line.startswith(f'{{"{_SUMS}"'):
        return False
    try:
        health.restore(_read(json.loads(line)[_SUMS]))
    except _UNREADABLE:
        return False
    return True


def _written(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _written(one) for name, one in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    return [_written(one) for one in value] if isinstance(value, (tuple, list)) else value


def _read(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _read(one) for name, one in value.items()}
    if isinstance(value, list):
        return tuple(_read(one) for one in value)
    return float(value) if value in ("nan", "inf", "-inf") else value

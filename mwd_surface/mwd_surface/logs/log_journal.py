# SPDX-License-Identifier: Apache-2.0
"""
Log samples on disk, so that a surface node that starts again has the log and the health of the tool from before.

The file holds one JSON value a line: a sample, or once a second the depth of the bit and whether the rig pumps. A line
that a power cut has torn is left out. The file is bounded: where it grows too long, its older half is dropped.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any, BinaryIO

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.tool_health import HealthLedger

NAME = "log_samples.jsonl"
_MOST_BYTES = 64 * 1024 * 1024  # about a week
_FIELDS = frozenset(field.name for field in dataclasses.fields(LogSample))


class LogJournal:
    """
    Journal of one well; call `close` at the end.

    Parameters
    ----------
    path : Path
    most_bytes : int
        Largest size of the file, bytes. If it is larger when it is opened, its older half is dropped.

    Attributes
    ----------
    unreadable : int
        Lines that were left out when it was read.
    fault : str
        Why the disk takes no lines at present; empty while it does. See `try_again`.
    """

    def __init__(self, path: Path, most_bytes: int = _MOST_BYTES) -> None:
        self.unreadable, self.fault, self._path = 0, "", path
        self._lines: list[str] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            data = path.read_bytes()
            if len(data) > most_bytes:
                data = data[data.find(b"\n", len(data) // 2) + 1 :]
                fresh = path.with_suffix(".writing")
                fresh.write_bytes(data)
                fresh.replace(path)
            self._lines = data.decode(errors="replace").splitlines()
        self._file: BinaryIO | None = self._opened()
        self._rig_ns = 0

    def _opened(self) -> BinaryIO:
        """Return the file, open to append; a line that was torn in a full disk or a power cut ends there."""
        file = self._path.open("a+b")
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            if file.read(1) != b"\n":
                file.write(b"\n")
        return file

    @classmethod
    def read(cls, path: Path) -> LogJournal:
        """Return the journal of a finished run, which changes nothing on the disk."""
        made = cls.__new__(cls)
        made.unreadable, made.fault, made._path, made._file, made._rig_ns = 0, "", path, None, 0
        made._lines = path.read_bytes().decode(errors="replace").splitlines()
        return made

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            # A full disk refuses the last line once more.
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def try_again(self) -> None:
        """Open the file again after a fault; `fault` stays if the disk still takes no line."""
        if self.fault:
            self.fault = ""
            try:
                self._file = self._opened()
                self._file.flush()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.fault = f"{self._path}: {error.strerror or error}"
        self.close()

    def restore(self, log: DepthLog, health: HealthLedger) -> None:
        """Hand all that the file held to a log and to an account of the tool's health."""
        for line in self._lines:
            try:
                self._restore(json.loads(line), log, health)
            except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
                self.unreadable += 1
        self._lines = []

    def _restore(self, row: Any, log: DepthLog, health: HealthLedger) -> None:
        if "at" in row:
            stamp_ns, depth, pumping = int(row["at"]), row["bit"], row["pumping"]
            if depth is not None:
                log.add_depth(stamp_ns, float(depth))
            if pumping is not None:
                health.add_flow(stamp_ns, pumping=bool(pumping))
            return
        sample = LogSample(**{name: _read(value) for name, value in row.items() if name in _FIELDS})
        for valid in log.add([sample]):
            health.add(valid)

    def add_sample(self, sample: LogSample) -> None:
        """Write a sample."""
        self._write({name: _written(value) for name, value in vars(sample).items()})

    def add_rig(self, stamp_ns: int, bit_depth: float | None, pumping: bool | None) -> None:
        """Write depth of the bit, m, and whether the rig pumps, once a second; None: unknown."""
        if not 0 <= stamp_ns - self._rig_ns < NANOSECONDS:
            self._rig_ns = stamp_ns
            self._write({"at": stamp_ns, "bit": bit_depth, "pumping": pumping})

    def _write(self, row: dict[str, Any]) -> None:
        if self.fault:
            return
        if self._file is None:
            raise ValueError("the journal was opened to be read")
        try:
            self._file.write(json.dumps(row, allow_nan=False, separators=(",", ":")).encode() + b"\n")
            self._file.flush()
        except OSError as error:
            self._fail(error)


def _written(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    return [_written(one) for one in value] if isinstance(value, tuple) else value


def _read(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_read(one) for one in value)
    return float(value) if value in ("nan", "inf", "-inf") else value

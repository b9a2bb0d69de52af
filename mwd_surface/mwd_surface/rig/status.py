# SPDX-License-Identifier: Apache-2.0
"""
State of the rig interfaces of a well in a small file in the well's folder, written every second for `mwd rig status`.

A file is used instead of a topic so that everyone who may read the folder can read the state without the middleware,
its domain or a password.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import load_json, read_text
from mwd_sensors.core.output_files import write_whole
from mwd_surface.rig.interface import InterfaceStatus, PeerStatus

FILE_NAME = "rig_status.json"
LASTS = 5.0  # age of a status from which its surface node hangs or was killed, s
_VERSION = 1  # version of the format of the file


class RigStatusError(ValueError):
    """Raised for a file that is not a rig status; the message names the file."""


@dataclasses.dataclass(frozen=True)
class RigStatus:
    """State of all interfaces of one well at one time."""

    well: str
    written: float  #: time of this status, s since the epoch
    process: int  #: process id of the surface node on its machine
    #: State of each interface; the `since` of their peers is in s since the epoch.
    interfaces: tuple[InterfaceStatus, ...]

    def alive(self, now: float) -> bool:
        """Return whether the status is less than `LASTS` s old: its surface node still runs; now: s since the epoch."""
        return -LASTS < now - self.written < LASTS


def write_status(path: Path, status: RigStatus) -> None:
    """
    Write a status file; an existing file is replaced as a whole.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    text = json.dumps({"version": _VERSION, **dataclasses.asdict(status)})
    write_whole(path, text, lasting=False)


def read_status(path: Path) -> RigStatus:
    """
    Return the status in a file.

    Raises
    ------
    OSError
        The file cannot be read.
    RigStatusError
        The file is not a rig status, or was written by another version of this program.
    """
    try:
        table = load_json(read_text(path, budgets.JSON))
        status = _status(table) if table["version"] == _VERSION else None
    except (KeyError, TypeError, ValueError) as error:
        raise RigStatusError(f"{path} is not a rig status ({error})") from error
    if status is None:
        raise RigStatusError(
            f"{path} was written by another version of this program: restart the surface node, or use its `mwd`"
        )
    return status


def _status(table: Mapping[str, Any]) -> RigStatus:
    interfaces = tuple(_interface(row) for row in table["interfaces"])
    return RigStatus(str(table["well"]), float(table["written"]), int(table["process"]), interfaces)


def status_files(folders: Sequence[Path]) -> list[Path]:
    """Return the status files in these folders, in the folders of their wells, and in the folders of wells' runs."""
    found = {path for folder in folders for depth in ("", "*/", "*/*/") for path in folder.glob(depth + FILE_NAME)}
    return sorted(found)


def dated(table: Sequence[InterfaceStatus], offset: float) -> tuple[InterfaceStatus, ...]:
    """
    Return the table with the `since` of each peer in s since the epoch instead of steady time.

    offset: time since the epoch minus steady time, s.
    """
    return tuple(
        dataclasses.replace(s, peers=tuple(dataclasses.replace(p, since=p.since + offset) for p in s.peers))
        for s in table
    )


def status_lines(table: Sequence[InterfaceStatus], now: float) -> list[str]:
    """
    Return the state of all interfaces as text: one line per interface and one per peer.

    now: present time on the clock of the peers' `since`, s.
    """
    if not table:
        return ["no rig interface is switched on"]
    lines = []
    for s in table:
        last = ", ".join(f"{name} {text}" for name, text in s.last)
        counts = ", ".join(f"{name} {count}" for name, count in s.counts if count)
        lines.append(
            f"{s.name}: {s.state}"
            + (f" at {s.address}" if s.address else "")
            + f"; out {s.sent}, in {s.received}, dropped {s.dropped}, refused {s.refused}"
            + (f", {counts}" if counts else "")
            + (f"; last {last}" if last else "")
            + (f"; {s.reason}" if s.reason else "")
        )
        lines += [
            f"  {p.address}: {max(0.0, now - p.since):.0f} s, out {p.sent} ({p.rate:.2f}/s), in {p.received},"
            f" dropped {p.dropped}" + (f", last {p.last}" if p.last else "")
            for p in s.peers
        ]
    return lines


def _interface(row: dict[str, Any]) -> InterfaceStatus:
    peers = tuple(PeerStatus(**peer) for peer in row["peers"])
    counts, last = ((tuple(pair) for pair in row[name]) for name in ("counts", "last"))
    return InterfaceStatus(**{**row, "peers": peers, "counts": tuple(counts), "last": tuple(last)})

# SPDX-License-Identifier: Apache-2.0
"""
How the rig interfaces of a well go, in a small file in its folder: written every second, read by `mwd rig status`.

A file rather than a topic, so that it can be read without the middleware, its domain or a password, by whoever may read
the well's folder.
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
LASTS = 5.0  # s; an older file is of a graph that hangs or was killed
_VERSION = 1


class RigStatusError(ValueError):
    """A file that is no rig status; the message names it."""


@dataclasses.dataclass(frozen=True)
class RigStatus:
    """
    All interfaces of one well as of a moment.

    written: s since the epoch. process: number of the surface's process on its machine. interfaces: with `since` of
    each peer as s since the epoch.
    """

    well: str
    written: float
    process: int
    interfaces: tuple[InterfaceStatus, ...]

    def alive(self, now: float) -> bool:
        """Whether it is of a graph that lives; now: s since the epoch."""
        return -LASTS < now - self.written < LASTS


def write_status(path: Path, status: RigStatus) -> None:
    """
    Replace the file as a whole.

    Raises
    ------
    OSError
        It cannot be written.
    """
    text = json.dumps({"version": _VERSION, **dataclasses.asdict(status)})
    write_whole(path, text, lasting=False)


def read_status(path: Path) -> RigStatus:
    """
    What a file says.

    Raises
    ------
    OSError
        It cannot be read.
    RigStatusError
        It is no rig status, or of another version of this program.
    """
    try:
        table = load_json(read_text(path, budgets.JSON))
        status = _status(table) if table["version"] == _VERSION else None
    except (KeyError, TypeError, ValueError) as error:
        raise RigStatusError(f"{path} is no rig status ({error})") from error
    if status is None:
        raise RigStatusError(f"{path} is of another version: restart the graph, or use its own `mwd`")
    return status


def _status(table: Mapping[str, Any]) -> RigStatus:
    interfaces = tuple(_interface(row) for row in table["interfaces"])
    return RigStatus(str(table["well"]), float(table["written"]), int(table["process"]), interfaces)


def status_files(folders: Sequence[Path]) -> list[Path]:
    """Status files in these folders, in those of their wells, and in those of the runs below."""
    found = {path for folder in folders for depth in ("", "*/", "*/*/") for path in folder.glob(depth + FILE_NAME)}
    return sorted(found)


def dated(table: Sequence[InterfaceStatus], offset: float) -> tuple[InterfaceStatus, ...]:
    """The table with the beginnings of peers in s since the epoch; offset: that clock minus the steady one, s."""
    return tuple(
        dataclasses.replace(s, peers=tuple(dataclasses.replace(p, since=p.since + offset) for p in s.peers))
        for s in table
    )


def status_lines(table: Sequence[InterfaceStatus], now: float) -> list[str]:
    """
    The state of all interfaces for people, one line each and one for every peer.

    now: of the clock that peers' times are of, s.
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

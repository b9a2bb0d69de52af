# SPDX-License-Identifier: Apache-2.0
"""
The survey list on disk: written whole, checked when read, never lost to a crash, an edit or half a write.

Two files stand in the folder: the list as it is and as it was one change before. A file carries the SHA-256 of its
own content. A new one is written beside, flushed to the disk and put in place by renaming, so that at any moment (a
kill, a power cut) at least one whole file is there. A file that fails its check is kept under another name, and the
one before is used; both facts are reported.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_json, read_file
from mwd_sensors.core.output_files import sync_folder
from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well

FORMAT = "mwd survey list"
VERSION = 1


class StoreError(RuntimeError):
    """The folder cannot be used: not writable, or another process keeps its list there."""


@dataclasses.dataclass(frozen=True)
class Loaded:
    """What came back: the list, a message for the operator (empty when all was well), and whether anything was lost."""

    surveys: SurveyList
    messages: tuple[str, ...] = ()
    fell_back: bool = False


class SurveyStore:
    """
    Keeper of one well's list in one folder; use as a context manager or call `close`.

    Raises
    ------
    StoreError
        The folder cannot be made or written, or another process has it.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.current = self.folder / "surveys.json"
        self.previous = self.folder / "surveys.previous.json"
        self._fresh = self.folder / "surveys.writing.json"
        try:
            self._lock = FolderLock(self.folder, "surveys.lock")
        except OSError as error:
            raise StoreError(
                f"cannot keep the survey list in {self.folder}: {error.strerror}; make it writable or choose another"
            ) from error
        except FolderTakenError as error:
            raise StoreError(f"another process ({error.owner}) keeps its survey list in {self.folder}") from None

    def close(self) -> None:
        """Give the folder free."""
        self._lock.free()

    def __enter__(self) -> SurveyStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def save(self, surveys: SurveyList) -> None:
        """
        Write the list; when this returns it is on the disk, and the list before is in `previous`.

        Raises
        ------
        StoreError
            The disk is full or refuses. The files that were there are untouched.
        ValueError
            The list has a text or number that a file cannot hold. Nothing is written.
        """
        data = encoded(surveys)
        try:
            with self._fresh.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            if self.current.exists():
                self._keep_current_as_previous()
            self._fresh.replace(self.current)
            sync_folder(self.folder)
        except OSError as error:
            raise StoreError(f"survey list not saved in {self.folder}: {error.strerror}") from error

    def load(self, well: Well, rules: ListRules) -> Loaded:
        """
        The newest whole list, under the given well and rules; an empty one where there is none yet.

        A damaged file is moved aside (surveys.damaged-1.json, -2, ...), never deleted. Where the well now names a
        north that the stations cannot be turned to, the stored one stays in force and a message says so.
        """
        messages: list[str] = []
        damaged = False
        for path in (self.current, self.previous):
            if not path.exists():
                continue
            try:
                stored = decoded(read_file(path, budgets.JSON), rules)
            except (ValueError, OSError) as error:
                damaged = True
                kept = self._put_aside(path)
                # The message goes into the log and to a page that needs no login.
                why = str(error) if isinstance(error, NotWholeError) else without_contents(path.name, error)
                messages.append(f"{path.name} is not whole ({why}); kept as {kept.name}")
                continue
            if path == self.previous:
                lost = "the last change may be missing" if damaged else f"{self.current.name} was missing"
                messages.append(f"survey list taken from {path.name}: {lost}; check it against the log")
            surveys, remarks = _under(stored, well, rules)
            return Loaded(surveys, (*messages, *remarks), path == self.previous)
        if damaged:
            messages.append("no whole survey list is left: starting with an empty one; the log has every survey")
        return Loaded(SurveyList(well=well, rules=rules), tuple(messages), damaged)

    def _keep_current_as_previous(self) -> None:
        # A second name for the same file, then a rename: `current` is there at every moment.
        second = self.folder / "surveys.linking.json"
        second.unlink(missing_ok=True)
        try:
            os.link(self.current, second)
        except OSError:
            # File systems without hard links (FAT, some network shares).
            second.write_bytes(read_file(self.current, budgets.JSON))
        second.replace(self.previous)

    def _put_aside(self, path: Path) -> Path:
        k = 1
        while (aside := self.folder / f"surveys.damaged-{k}.json").exists():
            k += 1
        path.rename(aside)
        return aside


class NotWholeError(ValueError):
    """A file is not a whole survey list; the message quotes nothing of it."""


def encoded(surveys: SurveyList) -> bytes:
    """The list as the bytes of a file: JSON, UTF-8, one record a line, with its own checksum."""
    content = surveys.to_mapping()
    records = ",\n".join(_canonical(r) for r in content.pop("records"))
    head = json.dumps({"format": FORMAT, "version": VERSION, "sha256": _checksum(surveys.to_mapping())})[:-1]
    rest = _canonical(content)[:-1]
    return f'{head}, "list": {rest},"records":[\n{records}\n]}}}}\n'.encode()


def decoded(data: bytes, rules: ListRules | None = None) -> SurveyList:
    """
    The list of a file's bytes.

    Raises
    ------
    ValueError
        Not JSON to the end, not a survey list, of a newer version, edited (checksum), or its content does not fit.
    """
    try:
        table = load_json(data.decode())
    except ValueError as error:
        at = f" at byte {error.start}" if isinstance(error, UnicodeDecodeError) else f": {error}"
        raise NotWholeError(f"half written or no JSON{at}") from error
    if not isinstance(table, dict) or table.get("format") != FORMAT or not isinstance(table.get("list"), dict):
        raise NotWholeError("no survey list")
    if table.get("version") != VERSION:
        version = table.get("version")
        which = f"version {version}" if type(version) is int and 0 <= version < 1000 else "an unknown version"
        raise NotWholeError(f"{which}, this program reads {VERSION}")
    if table.get("sha256") != _checksum(table["list"]):
        raise NotWholeError("its checksum does not fit: edited or corrupted")
    return SurveyList.from_mapping(table["list"], rules)


def _under(stored: SurveyList, well: Well, rules: ListRules) -> tuple[SurveyList, list[str]]:
    remarks = []
    if stored.records and stored.well.name != well.name:
        remarks.append(f"the stored list is of well {stored.well.name!r}, the configuration says {well.name!r}")
    try:
        return stored.configured(well, rules), remarks
    except ValueError as error:
        old = stored.well.north_reference
        remarks.append(f"{error}; {old} north stays in force")
        return stored.configured(dataclasses.replace(well, north_reference=old), rules), remarks


def _canonical(value: Any) -> str:
    # repr of a float is exact and the same everywhere, so equal content has equal bytes.
    return json.dumps(value, sort_keys=True, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(_canonical(content).encode()).hexdigest()

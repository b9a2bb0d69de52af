# SPDX-License-Identifier: Apache-2.0
"""
The survey list on disk: written as a whole, checked when read, and safe against crashes, edits and partial writes.

The folder holds two files: the present list, and the list before its last change. Each file carries the SHA-256 of its
content. A new file is written under another name, flushed to disk and renamed, so at least one complete file exists at
any moment (kill, power cut). A file that fails its check is kept under another name and the other file is used; both
facts are reported.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
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
    """Raised if the folder is not writable, a list cannot be saved, or another process keeps its list there."""


@dataclasses.dataclass(frozen=True)
class Loaded:
    """Result of loading: the list, and messages for the operator."""

    surveys: SurveyList
    messages: tuple[str, ...] = ()


class SurveyStore:
    """
    Folder that stores the survey list of one well; use it as a context manager or call `close`.

    Raises
    ------
    StoreError
        The folder cannot be created or written, or another process uses it.
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
                f"cannot write the survey list to {self.folder}: {error.strerror}; make the folder writable or choose "
                "another"
            ) from error
        except FolderTakenError as error:
            raise StoreError(f"another process ({error.owner}) keeps its survey list in {self.folder}") from None

    def close(self) -> None:
        """Release the folder for other processes."""
        self._lock.free()

    def __enter__(self) -> SurveyStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def save(self, surveys: SurveyList) -> None:
        """
        Write the list to the file `current`; the list that this file contained is kept in the file `previous`.

        Raises
        ------
        StoreError
            The disk is full or cannot be written. `current` is then a complete list: the old one, or the new one if
            only the sync of the folder failed.
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
        Return the newest complete list, with the given well and rules; an empty list if there is none yet.

        A damaged file is moved aside (surveys.damaged-1.json, -2, ...), never deleted. If the stations cannot be
        converted to the north that the well now names, the stored north stays in force and a message says so.
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
                # The message is logged and shown on a page without login, so it must not quote the file.
                why = str(error) if isinstance(error, NotWholeError) else without_contents(path.name, error)
                messages.append(f"{path.name} is not complete ({why}); kept as {kept.name}")
                continue
            if path == self.previous:
                lost = "the last change may be missing" if damaged else f"{self.current.name} was missing"
                messages.append(f"survey list read from {path.name}: {lost}; check it against the log")
            surveys, remarks = _under(stored, well, rules)
            return Loaded(surveys, (*messages, *remarks))
        if damaged:
            messages.append("no complete survey list is left: starting with an empty one; the log has every survey")
        return Loaded(SurveyList(well=well, rules=rules), tuple(messages))

    def _keep_current_as_previous(self) -> None:
        # Make a hard link to the file and rename the link, so that `current` exists at every moment.
        second = self.folder / "surveys.linking.json"
        second.unlink(missing_ok=True)
        try:
            os.link(self.current, second)
        except OSError:
            # Copy on file systems without hard links (FAT, some network shares).
            second.write_bytes(read_file(self.current, budgets.JSON))
        second.replace(self.previous)

    def _put_aside(self, path: Path) -> Path:
        k = 1
        while (aside := self.folder / f"surveys.damaged-{k}.json").exists():
            k += 1
        path.rename(aside)
        return aside


class NotWholeError(ValueError):
    """Raised if a file is not a complete survey list; the message quotes nothing of its content."""


def encoded(surveys: SurveyList) -> bytes:
    """Return the content of a list's file: JSON in UTF-8, one record per line, with a checksum of the list."""
    content = surveys.to_mapping()
    records = ",\n".join(_canonical(r) for r in content.pop("records"))
    head = json.dumps({"format": FORMAT, "version": VERSION, "sha256": _checksum(surveys.to_mapping())})[:-1]
    rest = _canonical(content)[:-1]
    return f'{head}, "list": {rest},"records":[\n{records}\n]}}}}\n'.encode()


def decoded(data: bytes, rules: ListRules | None = None) -> SurveyList:
    """
    Return the list in the content of a list's file.

    Raises
    ------
    ValueError
        The bytes are not complete JSON, not a survey list, of another version, edited (checksum), or have invalid
        content.
    """
    try:
        table = load_json(data.decode())
    except ValueError as error:
        at = f" at byte {error.start}" if isinstance(error, UnicodeDecodeError) else f": {error}"
        raise NotWholeError(f"incomplete or not JSON{at}") from error
    if not isinstance(table, dict) or table.get("format") != FORMAT or not isinstance(table.get("list"), dict):
        raise NotWholeError("not a survey list")
    if table.get("version") != VERSION:
        version = table.get("version")
        which = f"version {version}" if type(version) is int and 0 <= version < 1000 else "an unknown version"
        raise NotWholeError(f"{which}, this program reads {VERSION}")
    if table.get("sha256") != _checksum(table["list"]):
        raise NotWholeError("its checksum does not match: edited or corrupted")
    return SurveyList.from_mapping(table["list"], rules)


def _under(stored: SurveyList, well: Well, rules: ListRules) -> tuple[SurveyList, list[str]]:
    remarks = []
    if stored.records and stored.well.name != well.name:
        remarks.append(
            f"the stored list belongs to well {stored.well.name!r}, but the configuration names {well.name!r}"
        )
    try:
        return stored.configured(well, rules), remarks
    except ValueError as error:
        old = stored.well.north_reference
        remarks.append(f"{error}; {old} north stays in force")
        return stored.configured(dataclasses.replace(well, north_reference=old), rules), remarks


def _canonical(value: Any) -> str:
    # repr of a float is exact and the same on every machine, so equal content gives equal bytes.
    return json.dumps(value, sort_keys=True, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(_canonical(content).encode()).hexdigest()

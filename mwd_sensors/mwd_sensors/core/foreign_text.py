# SPDX-License-Identifier: Apache-2.0
"""
Make text from files and peers safe to show: no hidden characters, and no contents of files.

Names of topics and frames, messages of peers and errors of libraries may contain anything. `printable` escapes hidden
characters, for logs, alarms and terminals. `without_contents` returns a message about a file that cannot be used; the
message does not quote the file, because people who may not be allowed to read the file can see the message.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from mwd_sensors.core.hidden_characters import escaped, hidden
from mwd_sensors.core.settings import SettingsError


def printable(text: str) -> str:
    """
    Return a text in which codes replace all hidden characters, except tab and line end.

    A terminal would obey control characters, and a name with invisible marks would look like another name.
    """
    return escaped(text)


def unprintable(text: str) -> str:
    """Return the reason why a text cannot be printed on one line or written to a file; empty if it can."""
    if any(c in "\n\t" for c in text):
        return "has more than one line, or a tab; write one line"
    code = next(hidden(text), "")
    return f"has an invisible character ({code}); write the text again without this character" if code else ""


def first_of(names: Sequence[str], most: int = 20) -> str:
    """Return the first `most` names as text, each cut to 200 characters, with the number of further names."""
    shown = [name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}..." for name in names[:most]]
    more = [f"and {len(names) - most} more"] if len(names) > most else []
    return ", ".join(shown + more)


_LONGEST_NAME = 200


def not_a_file_name(name: str) -> str:
    """Return the reason if a text is a path instead of a plain file name; empty if it is a plain file name."""
    if name.strip() in (".", "..") or any(mark in name for mark in "/\\\0") or _DRIVE.match(name):
        return "is a path; give a file name without folders"
    return ""


_DRIVE = re.compile(r"\s*[A-Za-z]:")


def without_contents(path: Path | str, error: BaseException, advice: str = "") -> str:
    """
    Return a message that a file cannot be used, without quoting its content.

    The message goes to alarms, logs, recordings and a page without login, and the file may be a secret whose path
    somebody gave by mistake. advice is a command with which the user can find the cause.
    """
    if isinstance(error, OSError) or isinstance(error.__cause__, OSError):
        cause = error if isinstance(error, OSError) else error.__cause__
        return f"{path}: {getattr(cause, 'strerror', '') or 'cannot be read'}"
    line = re.search(r"\bline (\d{1,9})\b", str(error))
    more = f"; {advice} says why" if advice else ""
    return f"{path}{f', line {line[1]}' if line else ''}: does not have the expected content{more}"


@contextlib.contextmanager
def contents_hidden(path: Path | str, advice: str = "") -> Iterator[None]:
    """
    Hide the content of a file whose path is a node parameter.

    Errors raised within this context name the file but do not quote its content (`without_contents`).

    Raises
    ------
    SettingsError
        The code in this context could not use the file.
    """
    try:
        yield
    except (OSError, ValueError, RuntimeError, TypeError, KeyError) as error:
        raise SettingsError(without_contents(path, error, advice)) from None

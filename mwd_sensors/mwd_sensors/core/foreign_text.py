# SPDX-License-Identifier: Apache-2.0
"""
Text from files and peers, as it may be shown: without characters that a terminal obeys, and without file contents.

Names of topics and frames, messages of peers and the errors of libraries may hold anything. `printable` writes control
characters out, for logs, alarms and terminals. `without_contents` says that a file cannot be used without a word that
stands in it, where the text leaves the hands of who may read the file.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

from mwd_sensors.core.settings import SettingsError


def printable(text: str) -> str:
    """Return a text whose control characters, other than tab and line end, are written out: a terminal obeys them."""
    return text.translate(_WRITTEN_OUT)


_WRITTEN_OUT = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"}


def unprintable(text: str) -> str:
    """Why a text can be neither printed on one line nor written to a file; empty where it can."""
    if any(ord(c) < 32 or ord(c) == 127 for c in text):
        return "has control characters; write one line"
    if any("\ud800" <= c <= "\udfff" for c in text):
        return "has characters that are no text (not UTF-8); write it again"
    return ""


def without_contents(path: Path | str, error: BaseException, advice: str = "") -> str:
    """
    Say that a file cannot be used, without a word that stands in it.

    The text goes to alarms, logs, recordings and a page that needs no login: the file may be a secret that somebody
    named as a plan. advice: command that says more.
    """
    if isinstance(error, OSError) or isinstance(error.__cause__, OSError):
        cause = error if isinstance(error, OSError) else error.__cause__
        return f"{path}: {getattr(cause, 'strerror', '') or 'cannot be read'}"
    line = re.search(r"\bline (\d{1,9})\b", str(error))
    more = f"; {advice} says why" if advice else ""
    return f"{path}{f', line {line[1]}' if line else ''}: is not what it should be{more}"


@contextlib.contextmanager
def contents_hidden(path: Path | str, advice: str = "") -> Iterator[None]:
    """
    Read a file whose path is a parameter of a node; errors name the file and quote nothing of it (`without_contents`).

    Raises
    ------
    SettingsError
        The file cannot be used.
    """
    try:
        yield
    except (OSError, ValueError, RuntimeError, TypeError, KeyError) as error:
        raise SettingsError(without_contents(path, error, advice)) from None

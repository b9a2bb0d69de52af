# SPDX-License-Identifier: Apache-2.0
"""Make file names that every system accepts from names of wells."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 80  # bytes
# Names that Windows reserves, with any ending.
RESERVED = {"con", "prn", "aux", "nul", *(f"com{k}" for k in range(1, 10)), *(f"lpt{k}" for k in range(1, 10))}


def safe_name(*parts: str, longest: int = LONGEST) -> str:
    """
    Return one file name without folder or ending.

    Latin letters lose their marks (Å -> A); letters and digits of other scripts stay; every other character except dot,
    minus and underscore becomes an underscore. Never empty, hidden, reserved or longer than `longest` bytes of UTF-8,
    because file systems limit the bytes of a name.
    """
    words = []
    for part in parts:
        letters = (letter for letter in unicodedata.normalize("NFKC", part) if not unicodedata.combining(letter))
        words.append(re.sub(r"[^\w.-]+", "_", "".join(map(_plain, letters))).strip("._-"))
    name = "-".join(w for w in words if w).encode()[:longest].decode(errors="ignore").strip("._-")
    if not name:
        return "unnamed"
    return f"_{name}" if name.split(".")[0].lower() in RESERVED else name


def _plain(letter: str) -> str:
    """Return a Latin letter without its marks; any other character as it is."""
    bare = unicodedata.normalize("NFKD", letter)[0]
    return bare if bare.isascii() else letter

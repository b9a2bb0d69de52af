# SPDX-License-Identifier: Apache-2.0
"""File names, made from names of wells, that every operating system accepts."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 80  # largest number of bytes of a file name
# Names that Windows reserves, whatever the ending.
RESERVED = {"con", "prn", "aux", "nul", *(f"com{k}" for k in range(1, 10)), *(f"lpt{k}" for k in range(1, 10))}


def safe_name(*parts: str, longest: int = LONGEST) -> str:
    """
    Return one file name made of the parts, without folder and ending.

    Latin letters lose their diacritical marks (Å -> A). Letters and digits of other scripts are kept. Every other
    character except dot, minus and underscore becomes an underscore. The name is never empty, hidden, reserved or
    longer than `longest` bytes of UTF-8, because file systems limit the bytes of a name.
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
    """Return a Latin letter without its diacritical marks; any other character unchanged."""
    bare = unicodedata.normalize("NFKD", letter)[0]
    return bare if bare.isascii() else letter

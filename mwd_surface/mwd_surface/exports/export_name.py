# SPDX-License-Identifier: Apache-2.0
"""Make file names that every system accepts from names of wells."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 80
# Names that Windows reserves, with any ending.
RESERVED = {"con", "prn", "aux", "nul", *(f"com{k}" for k in range(1, 10)), *(f"lpt{k}" for k in range(1, 10))}


def safe_name(*parts: str) -> str:
    """
    Return one file name without folder or ending.

    Letters lose their marks if they have a plain form (Å -> A); every other character except letters, digits, dot,
    minus and underscore becomes an underscore. Never empty, hidden, reserved or longer than 80 characters.
    """
    words = []
    for part in parts:
        bare = "".join(c for c in unicodedata.normalize("NFKD", part) if not unicodedata.combining(c))
        words.append(re.sub(r"[^A-Za-z0-9._-]+", "_", bare).strip("._-"))
    name = "-".join(w for w in words if w)[:LONGEST].strip("._-")
    if not name:
        return "unnamed"
    return f"_{name}" if name.split(".")[0].lower() in RESERVED else name

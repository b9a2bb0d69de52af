# SPDX-License-Identifier: Apache-2.0
"""Tables of text, read back."""

import csv
from pathlib import Path


def rows_of(source):
    """Return the rows of a CSV file, or of its text or bytes, without the comments above its header."""
    data = source.read_bytes() if isinstance(source, Path) else source
    text = data.decode() if isinstance(data, bytes) else data
    return list(csv.DictReader([line for line in text.splitlines() if not line.startswith("#")]))

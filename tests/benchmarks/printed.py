# SPDX-License-Identifier: Apache-2.0
"""Tables of the benchmarks, printed as they come, so that a long run shows how far it is."""

from __future__ import annotations


def show(*lines: str) -> None:
    """Print lines at once."""
    print("\n".join(lines), flush=True)


def head(title: str, columns: str) -> None:
    """Begin a section with one table."""
    show("", f"### {title}", "", columns, "|" + "---|" * (columns.count("|") - 1))

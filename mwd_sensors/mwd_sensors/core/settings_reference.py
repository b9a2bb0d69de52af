# SPDX-License-Identifier: Apache-2.0
"""Show a settings dataclass as a table: name, type, default, unit, range and meaning of every parameter."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mwd_sensors.core.settings import Rule, flat

_KINDS = {bool: "bool", int: "int", float: "double", str: "string"}
_HEAD = "| name | type | default | unit | range | description |\n|---|---|---|---|---|---|\n"


def parameter_tables(settings: Any) -> str:
    """Return Markdown tables: the parameters for all users, then those for experts under a heading of their own."""
    leaves = flat(settings)
    plain = [(name, *leaf) for name, leaf in leaves.items() if not leaf[1].expert]
    expert = [(name, *leaf) for name, leaf in leaves.items() if leaf[1].expert]
    parts = [_HEAD + _rows(plain)] if plain else []
    if expert:
        title = "\n### For experts\n\nThe defaults need no attention.\n\n" if plain else ""
        parts.append(title + _HEAD + _rows(expert))
    return "".join(parts)


def _rows(leaves: Iterable[tuple[str, Any, Rule]]) -> str:
    return "".join(
        f"| `{name}` | {_kind(value)} | {_cell(value)} | {rule.unit} | {_range(rule)} | {_escaped(rule.doc)} |\n"
        for name, value, rule in leaves
    )


def _kind(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"{_KINDS.get(type(value[0]), 'string') if value else 'string'}[]"
    return _KINDS.get(type(value), "string")


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return ", ".join(_cell(one) for one in value)
    return f"{value:.8g}" if isinstance(value, float) else _escaped(str(value))


def _range(rule: Rule) -> str:
    if rule.choices:
        return ", ".join(rule.choices)
    if rule.low is None and rule.high is None:
        return ""
    low = "" if rule.low is None else f"{rule.low:g}"
    high = "" if rule.high is None else f"{rule.high:g}"
    return f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")

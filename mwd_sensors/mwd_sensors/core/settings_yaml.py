# SPDX-License-Identifier: Apache-2.0
"""A settings dataclass as the commented parameter file of its node: every default, with meaning, unit and bounds."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from typing import Any

import yaml

from mwd_sensors.core.settings import rule_of

_WIDTH = 118


def parameter_file(node: str, settings: Any) -> str:
    """
    YAML of a node's parameters, ready for ``--params-file``; one comment for each.

    node: name without namespace; the file holds for any namespace.
    """
    lines = [
        f"# Parameters of the {node} node with their defaults. Copy what you change into a file of your own and lay it",
        "# on top with --params-file: an unknown name or a value out of bounds is refused with a sentence. Parameters",
        "# marked expert need no attention with the defaults.",
        "/**:",
        f"  {node}:",
        "    ros__parameters:",
        "      # Configure and activate at start; false: wait for the lifecycle services.",
        "      autostart: true",
        "      # Before every frame in headers and transforms; auto: the namespace and a slash; empty: nothing.",
        "      frame_prefix: auto",
    ]
    return "\n".join(lines + _lines(settings, 6)) + "\n"


def _comment(field: dataclasses.Field[Any]) -> str:
    rule = rule_of(field)
    return f"Expert: {rule.text()}" if rule.expert else rule.text()


def _lines(settings: Any, indent: int) -> list[str]:
    lines = []
    for field in dataclasses.fields(settings):
        value, space = getattr(settings, field.name), " " * indent
        block = dataclasses.is_dataclass(value) and not isinstance(value, type)
        if block and not dataclasses.fields(value):
            # A name without a value is no parameter.
            continue
        comment = textwrap.wrap(_comment(field), _WIDTH - indent - 2)
        lines += [f"{space}# {line}" for line in comment]
        if block:
            lines += [f"{space}{field.name}:", *_lines(value, indent + 2)]
        else:
            # A parameter file has no empty list; one empty text stands for it.
            plain = (list(value) or [""]) if isinstance(value, (list, tuple)) else value
            # Nor has it an empty value: a number that is not given is nan.
            plain = math.nan if plain is None else plain
            text = yaml.safe_dump(plain, default_flow_style=True, width=10**6, allow_unicode=True)
            # A bare scalar ends with a document mark.
            scalar = text.removesuffix("...\n").strip()
            lines.append(f"{space}{field.name}: {scalar}")
    return lines

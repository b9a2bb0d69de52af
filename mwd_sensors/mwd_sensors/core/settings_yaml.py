# SPDX-License-Identifier: Apache-2.0
"""Write a settings dataclass as the commented parameter file of its node, with meaning, unit, bounds and default."""

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
    Return the YAML of a node's parameters for ``--params-file``, with a comment for each parameter.

    node is the name without namespace; the file is valid in any namespace.
    """
    lines = [
        f"# Parameters of the {node} node with their defaults. Copy the lines that you change into your own file and",
        "# pass it with --params-file. An unknown name or a value out of bounds is refused with a message. Parameters",
        "# marked Expert rarely need a change.",
        "/**:",
        f"  {node}:",
        "    ros__parameters:",
        "      # true: configure and activate at start. false: wait for the lifecycle services.",
        "      autostart: true",
        "      # Prefix of frame names in headers and transforms. auto: the namespace and a slash. Empty: no prefix.",
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
            # YAML cannot write a parameter block without entries.
            continue
        comment = textwrap.wrap(_comment(field), _WIDTH - indent - 2)
        lines += [f"{space}# {line}" for line in comment]
        if block:
            lines += [f"{space}{field.name}:", *_lines(value, indent + 2)]
        else:
            # A parameter file cannot hold an empty list; a list with one empty text stands for it.
            plain = (list(value) or [""]) if isinstance(value, (list, tuple)) else value
            # A parameter file cannot hold an empty value either: NaN stands for a number that is not given.
            plain = math.nan if plain is None else plain
            text = yaml.safe_dump(plain, default_flow_style=True, width=10**6, allow_unicode=True)
            # The YAML library writes a document mark (...) after a bare scalar.
            scalar = text.removesuffix("...\n").strip()
            lines.append(f"{space}{field.name}: {scalar}")
    return lines

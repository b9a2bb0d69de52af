# SPDX-License-Identifier: Apache-2.0
"""Descriptions of settings are sentences: people read them in parameter files, in the reference and in messages."""

import ast

import pytest

from project import ROOT

SOURCES = sorted(path for package in ROOT.glob("mwd_*") for path in (package / package.name).rglob("*.py"))


def descriptions(path):
    """Return line, and first and last characters, of each literal description of a setting in a file."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setting" and len(node.args) > 1:
            parts = node.args[1].values if isinstance(node.args[1], ast.JoinedStr) else [node.args[1]]
            first, last = (part.value if isinstance(part, ast.Constant) else "A." for part in (parts[0], parts[-1]))
            yield node.lineno, first, last


@pytest.mark.parametrize("path", [p for p in SOURCES if "setting(" in p.read_text()], ids=lambda p: p.stem)
def test_a_description_of_a_setting_is_a_sentence(path):
    wrong = [f"{path}:{line}" for line, first, last in descriptions(path) if first[:1].islower() or last[-1:] != "."]
    assert not wrong

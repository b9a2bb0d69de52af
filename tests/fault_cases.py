# SPDX-License-Identifier: Apache-2.0
"""The table of fault and bad-input cases, and the tests that hold each of them, read from the sources."""

from __future__ import annotations

import ast
import csv
import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("mwd_sensors/test", "mwd_estimation/test", "mwd_surface/test", "tests")
# Files whose tests need a browser: a case needs a test beside them, as not every machine has one.
_BROWSER = "tests/browser"


@dataclasses.dataclass(frozen=True)
class Held:
    """A test that holds cases, or a whole file of tests, whose name is then empty; whether it may be skipped."""

    file: str
    name: str
    numbers: tuple[int, ...]
    may_be_skipped: bool


@dataclasses.dataclass(frozen=True)
class Case:
    """One case: number, group, what happens, what an excellent system does, and what its tests leave out."""

    number: int
    group: str
    case: str
    expected: str
    not_covered: str


def cases() -> list[Case]:
    """Return the table, in order."""
    with (Path(__file__).parent / "fault_cases.csv").open(encoding="utf-8", newline="") as file:
        return [Case(**{**row, "number": int(row["number"])}) for row in csv.DictReader(file)]


@functools.cache
def held() -> tuple[Held, ...]:
    """Return every test that is marked with `fault_case`, in order of file and line."""
    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("test_*.py"))]
    return tuple(one for path in paths for one in _in_file(path))


def _in_file(path: Path) -> Iterator[Held]:
    file, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
    if "fault_case" not in text:
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            name, marks = node.name, node.decorator_list
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            name, marks = "", node.value.elts if isinstance(node.value, ast.List) else [node.value]
        else:
            continue
        numbers = tuple(
            ast.literal_eval(argument)
            for mark in marks
            if isinstance(mark, ast.Call) and _name(mark) == "fault_case"
            for argument in mark.args
        )
        if numbers:
            skipped = any(_name(mark) in ("skip", "skipif", "xfail") for mark in marks)
            yield Held(file, name, numbers, skipped or file.startswith(_BROWSER))


def _name(mark: ast.expr) -> str:
    function = mark.func if isinstance(mark, ast.Call) else mark
    return function.attr if isinstance(function, ast.Attribute) else ""


def page() -> str:
    """Return the table as Markdown, each case with the tests that hold it."""
    tests: dict[int, list[Held]] = {}
    for one in held():
        for number in one.numbers:
            tests.setdefault(number, []).append(one)
    lines = [
        "# Fault and bad-input cases\n",
        "Each row says what happens, what is expected, which tests hold it, and what these tests do not cover. The",
        "gate runs all tests and fails when a case has none. A test holds examples of a case, not all that its words",
        "may mean: the last column says where the limits are known. In every case: no node crashes or blocks, nothing",
        "that is not finite is published, a diagnostic names cause and remedy, the last good value stays with its age,",
        "sigma grows with the truth, recovery is automatic, and raw data stay recorded.\n",
    ]
    group = ""
    for case in cases():
        if case.group != group:
            group = case.group
            lines += [f"\n## {group}\n", "| no | case | expected | tests | not covered |", "|---|---|---|---|---|"]
        names = "<br>".join(
            f"`{one.name}` ({Path(one.file).name})" if one.name else f"`{Path(one.file).name}`"
            for one in tests.get(case.number, [])
        )
        lines.append(f"| {case.number} | {case.case} | {case.expected} | {names} | {case.not_covered} |")
    return "\n".join(lines) + "\n"

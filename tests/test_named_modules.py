# SPDX-License-Identifier: Apache-2.0
"""What comments and pages name is there, modules of a room (`survey.verdict`) and files; maps are complete."""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mwd_sensors", "mwd_estimation", "mwd_surface")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package / package).rglob("*.py"))
# The changelog tells of names that were; docs/reference is generated.
PAGES = [
    path
    for pattern in ("*.md", "mwd_*/*.md", "bags/**/*.md", "docs/**/*.md")
    for path in ROOT.glob(pattern)
    if path.name != "CHANGELOG.md" and "reference" not in path.relative_to(ROOT).parts
]
FOLDERS = {path.parent for path in SOURCES}
ROOMS: dict[str, set[str]] = {folder.name: set() for folder in FOLDERS if folder.name not in PACKAGES}
for folder in FOLDERS:
    if folder.name in ROOMS:
        ROOMS[folder.name] |= {entry.stem for entry in folder.iterdir()}
# A module may be called as a room is: `survey.accepted_surveys` is a function of rig/survey.py.
DEFINED = {
    room: {
        name
        for path in SOURCES
        if path.stem == room
        for name in re.findall(r"^(?:def |class )?(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    for room in ROOMS
}
# Blocks of parameters have names of rooms too; `surveys.csv` is a file of a run.
PARAMETERS = {
    name
    for path in ROOT.glob("mwd_*/config/*.yaml")
    for name in re.findall(r"(\w+):", path.read_text(encoding="utf-8"))
}
SUFFIXES = {"csv", "json", "las", "md", "parquet", "png", "py", "xml", "yaml"}
NAMED = re.compile(rf"(?<![\w./-])({'|'.join(sorted(ROOMS))})\.([a-z_]+\w)\b(?![(*-])")
FILE = re.compile(r"(?<![\w./-])((?:tests|bags|docs|mwd_\w+)/[\w/]+\.(?:py|md|yaml|js))\b")


def prose(path: Path) -> Iterator[str]:
    """The comments and docstrings of a module."""
    text = path.read_text(encoding="utf-8")
    if not NAMED.search(text) and not FILE.search(text):
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT or token.string.lstrip("r").startswith('"""'):
            yield token.string


def missing(text: str) -> list[str]:
    """Names in a text that nothing in the repository has."""
    known = PARAMETERS | SUFFIXES
    gone = [f"{r}.{name}" for r, name in NAMED.findall(text) if name not in ROOMS[r] | DEFINED[r] | known]
    return gone + [
        name for name in FILE.findall(text) if not list(ROOT.glob(name)) and not list(ROOT.glob(f"*/{name}"))
    ]


def test_modules_and_files_that_are_named_exist():
    found = {str(path.relative_to(ROOT)): [name for text in prose(path) for name in missing(text)] for path in SOURCES}
    found |= {str(path.relative_to(ROOT)): missing(path.read_text(encoding="utf-8")) for path in PAGES}
    assert {path: names for path, names in found.items() if names} == {}


def test_the_maps_leave_no_room_out_and_that_of_the_sensors_no_module():
    architecture = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    sensors = (ROOT / "mwd_sensors" / "README.md").read_text(encoding="utf-8")
    rooms = {path.relative_to(ROOT).parts[2] for path in SOURCES if len(path.relative_to(ROOT).parts) > 3}
    modules = {path.stem for path in SOURCES if path.parent.parent == ROOT / "mwd_sensors" / "mwd_sensors"}
    assert {room for room in rooms if f"`{room}`" not in architecture} == set()
    assert {name for name in modules - {"__init__"} if f"`{name}`" not in sensors} == set()


def test_a_name_that_nothing_has_is_found():
    assert missing("`survey.judgement`, tests/browser/test_page.py") == [
        "survey.judgement",
        "tests/browser/test_page.py",
    ]
    assert missing("`survey.verdict`, survey.duration_s, tests/test_layering.py") == []

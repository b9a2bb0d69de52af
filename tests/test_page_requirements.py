# SPDX-License-Identifier: Apache-2.0
"""What the documents say of page, parameters and tests is there."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]


def known_names():
    files = [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "mwd_surface" / "test").rglob("test_*.py")]
    return {
        name
        for file in files
        for name in re.findall(r"^def (test_\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    }


def test_each_element_of_the_page_is_held_by_tests_that_exist():
    text = (ROOT / "docs" / "guide" / "rig_floor_page.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \|(.*)$", text, re.MULTILINE)
    assert rows
    known = known_names()
    for number, row in rows:
        named = re.findall(r"`(test_\w+)`", row)
        assert named, number
        assert set(named) <= known, (number, set(named) - known)


def names(table, prefix=""):
    for key, value in table.items():
        if isinstance(value, dict):
            yield prefix + key
            yield from names(value, f"{prefix}{key}.")
        else:
            yield prefix + key


def test_each_parameter_that_the_troubleshooting_names_exists():
    text = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    known = set()
    for file in ROOT.glob("mwd_*/config/*.yaml"):
        (nodes,) = yaml.safe_load(file.read_text(encoding="utf-8")).values()
        for node in nodes.values():
            known |= set(names(node.get("ros__parameters", {})))
    named = set(re.findall(r"`([a-z_]+\.[a-z_.]+)(?::[^`]*)?`", text)) - {"faults.csv", "surveys.csv"}
    assert len(named) > 8
    assert named - known - {"place.lat_deg"} <= set(), named - known

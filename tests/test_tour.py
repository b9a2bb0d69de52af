# SPDX-License-Identifier: Apache-2.0
"""The timed tour is that of the README."""

import importlib.util
import re

from project import ROOT


def test_the_table_of_times_has_the_commands_of_the_readme_and_all_ended_well():
    spec = importlib.util.spec_from_file_location("tour", ROOT / "docs" / "tour.py")
    tour = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tour)
    rows = re.findall(r"^\| `(.+)` \| (\d+) \| (\d+) \|$", tour.TABLE.read_text(encoding="utf-8"), re.MULTILINE)
    assert [command for command, _, _ in rows] == tour.commands(), "run `make tour`"
    assert len(rows) > 10
    assert all(int(status) == command.startswith("mwd compare") for command, _, status in rows)

# SPDX-License-Identifier: Apache-2.0
"""Two sources of one topic: one is used, and it is always the same one."""

import pytest

from mwd_surface.live.source_selection import EQUAL, SourceSelection

SILENT_S = EQUAL.silent_after


@pytest.mark.fault_case(53)
def test_the_first_source_stays_in_force_however_much_another_says():
    selection = SourceSelection()
    used = {
        selection.choose(("rig_floor", "rogue", "rogue") if k == 0 else ("rogue", "rig_floor"), k) for k in range(20)
    }
    assert used == {"rig_floor"}
    assert selection.others(19) == ["rogue"]


def test_another_takes_over_only_after_a_silence_and_then_stays():
    selection = SourceSelection()
    selection.choose(("a",), 0.0)
    assert selection.choose(("b",), SILENT_S - 1.0) == "a"
    assert selection.choose(("b",), SILENT_S + 0.1) == "b"
    assert selection.choose(("a", "b"), SILENT_S + 1.0) == "b"
    assert selection.others(SILENT_S + 1.0) == ["a"]
    assert selection.others(3 * SILENT_S) == []

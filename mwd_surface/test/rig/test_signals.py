# SPDX-License-Identifier: Apache-2.0
"""The signal table gives every protocol its names, each once."""

import itertools
import re
from pathlib import Path

from mwd_surface.rig.modbus.map import COUNT
from mwd_surface.rig.signals import LIVE, OF_SURVEY, SIGNALS
from mwd_surface.rig.wits.records import SENT

RIG_PAGES = Path(__file__).resolve().parents[3] / "docs" / "rig"


def test_names_are_unique_in_each_protocol():
    for names in (
        [s.name for s in SIGNALS],
        [s.opcua for s in SIGNALS],
        [s.modbus for s in SIGNALS if s.modbus is not None],
        [s.wits for s in SIGNALS if s.wits is not None],
    ):
        assert len(names) == len(set(names))
    assert set(LIVE) | set(OF_SURVEY) == {s.name for s in SIGNALS}


def test_registers_do_not_overlap_and_items_are_sent():
    registers = sorted(s.modbus for s in SIGNALS if s.modbus is not None)
    assert all(after - before >= 2 for before, after in itertools.pairwise(registers))
    assert registers[-1] + 2 <= COUNT
    # The spare items of the survey record have no name of their own.
    assert {s.wits for s in SIGNALS if s.wits is not None} - set(SENT) == {722, 723, 724}


def test_every_signal_is_classified_and_documented():
    assert all(s.dwis and s.meaning for s in SIGNALS)
    opcua = (RIG_PAGES / "opcua.md").read_text()
    assert [s.opcua for s in SIGNALS if not re.search(rf"\b{s.opcua}\b", opcua)] == []
    wits = (RIG_PAGES / "wits.md").read_text()
    assert [s.wits for s in SIGNALS if s.wits and f"{s.wits:04d}" not in wits and str(s.wits % 100) not in wits] == []

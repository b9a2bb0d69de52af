# SPDX-License-Identifier: Apache-2.0
"""The signal table gives every protocol its names, each once."""

import itertools
import math
import re
from pathlib import Path

import pytest

from mwd_surface.rig.modbus.map import COUNT
from mwd_surface.rig.signal import TOOL, Signal
from mwd_surface.rig.signals import LIVE, OF_SURVEY, SIGNALS
from mwd_surface.rig.units import UNITS

RIG_PAGES = Path(__file__).resolve().parents[3] / "docs" / "rig"


def test_names_are_unique_in_each_protocol():
    for names in (
        [s.name for s in SIGNALS],
        [s.opcua for s in SIGNALS],
        [s.modbus for s in SIGNALS if s.modbus is not None],
        [s.wits.code for s in SIGNALS if s.wits is not None],
    ):
        assert len(names) == len(set(names))
    assert set(LIVE) | set(OF_SURVEY) == {s.name for s in SIGNALS}


def test_registers_do_not_overlap_and_items_are_sent():
    registers = sorted(s.modbus for s in SIGNALS if s.modbus is not None)
    assert all(after - before >= 2 for before, after in itertools.pairwise(registers))
    assert registers[-1] + 2 <= COUNT
    # The spare items of the survey record have no name of their own.
    assert {s.wits.code for s in SIGNALS if s.wits is not None and not s.wits.name} == {722, 723, 724}


def test_every_signal_is_classified_and_documented():
    assert all(s.dwis and s.meaning for s in SIGNALS)
    opcua = (RIG_PAGES / "opcua.md").read_text()
    assert [s.opcua for s in SIGNALS if not re.search(rf"\b{s.opcua}\b", opcua)] == []
    wits = (RIG_PAGES / "wits.md").read_text()
    assert [s.name for s in SIGNALS if s.wits and f"{s.wits.code:04d}" not in wits] == []


def test_a_signal_in_a_unit_that_no_protocol_knows_is_refused():
    with pytest.raises(ValueError, match="distance: unit 'furlong'"):
        Signal("distance", "furlong", "to the plan", TOOL, "Distance", ("Measurement",))


@pytest.mark.parametrize(
    ("unit", "si", "metric", "fps"),
    [
        ("m", 3.048, 3.048, 10.0),
        ("degC", 100.0, 100.0, 212.0),
        ("rad/s", math.pi, 30.0, 30.0),
        ("m^3/s", 3.785411784e-3, 227.12470704, 60.0),
        ("N m", 1355.8179483314004, 1.3558179483314, 1.0),
        ("m/s^2", 9.80665, 1.0, 1.0),
        ("rad/m", math.radians(3.0) / 30.0, 3.0, 3.048),
    ],
)
def test_a_wits_item_has_the_unit_of_its_system(unit, si, metric, fps):
    assert UNITS[unit].metric.of(si) == pytest.approx(metric)
    assert UNITS[unit].fps.of(si) == pytest.approx(fps)

# SPDX-License-Identifier: Apache-2.0
"""The signal table gives every page, protocol and file its names, each once."""

import csv
import dataclasses
import itertools
import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.exports import export_witsml
from mwd_surface.rig.modbus.map import COUNT
from mwd_surface.signals.table import (
    ATTITUDE,
    FACTS,
    FILE,
    LISTED,
    RIG,
    SERIES,
    SIGNALS,
    SOURCES,
    SURVEY_TABLE,
    TO_RIG,
    Signal,
    read_signals,
)
from mwd_surface.signals.units import UNITS
from mwd_surface.surveys.survey_record import SurveyRecord

DOCS = Path(__file__).resolve().parents[3] / "docs"


def test_names_are_unique_wherever_they_stand():
    for names in (
        [s.name for s in SIGNALS],
        [s.opcua for s in SIGNALS if s.opcua],
        [s.modbus for s in SIGNALS if s.modbus is not None],
        [s.wits.code for s in SIGNALS if s.wits is not None],
        [s.reads for s in SIGNALS if s.reads is not None],
        [place for s in SIGNALS for place in s.page],
        [listed.key for _, listed in SURVEY_TABLE],
        *([getattr(listed, kind) for _, listed in LISTED] for kind in ("title", "las")),
        [column.key for _, column in SERIES],
        [column.key for _, column in ATTITUDE],
    ):
        assert len(names) == len(set(names))


def test_registers_do_not_overlap_and_items_are_sent():
    registers = sorted(s.modbus for s in SIGNALS if s.modbus is not None)
    assert all(after - before >= 2 for before, after in itertools.pairwise(registers))
    assert registers[-1] + 2 <= COUNT
    # The spare items of the survey record have no name of their own.
    assert {s.wits.code for s in SIGNALS if s.wits is not None and not s.wits.name} == {722, 723, 724}


def test_every_signal_is_classified_and_documented():
    assert all(s.meaning for s in SIGNALS)
    assert all(s.dwis for s in TO_RIG)
    opcua = (DOCS / "rig" / "opcua.md").read_text()
    assert [s.opcua for s in (*TO_RIG, *FACTS) if not re.search(rf"\b{s.opcua}\b", opcua)] == []
    wits = (DOCS / "rig" / "wits.md").read_text()
    assert [s.name for s in SIGNALS if s.wits and f"{s.wits.code:04d}" not in wits] == []


def test_every_signal_appears_somewhere_and_its_source_is_used():
    seen = (*TO_RIG, *FACTS, *(s for s, _ in (*SURVEY_TABLE, *SERIES, *ATTITUDE)), *(s for s in SIGNALS if s.page))
    assert {s.name for s in seen} == {s.name for s in SIGNALS}
    assert {s.source for s in SIGNALS} == set(SOURCES)


def test_fields_doubts_and_tags_are_those_of_messages_and_schema():
    assert {s.field for s in SIGNALS if s.source == RIG} <= set(wire.RIG_VALID)
    names = {name for name, *_ in wire.ATTITUDE.fields}
    for signal, _ in ATTITUDE:
        assert {signal.field, f"sigma_{signal.field}"} <= names
    assert {doubt for s in SIGNALS for doubt in s.doubts} <= set(Status.__members__)
    assert {listed.witsml for _, listed in LISTED if listed.witsml} == {*export_witsml.STATION, *export_witsml.PLACE}
    records = {field.name for field in dataclasses.fields(SurveyRecord)}
    placed = {"north", "east", "vertical_depth", "vertical_section", "dogleg_severity", "build_rate", "turn_rate"}
    assert placed <= records & {p.removeprefix("surveys.") for s in SIGNALS for p in s.page}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unit": "furlong"}, "signal distance: unit 'furlong'"),
        ({"source": "rumour"}, "signal distance: source 'rumour'"),
        ({"type": "Float"}, "signal distance: type 'Float'"),
        ({"opcua": ""}, "signal distance: a signal sent to a rig"),
    ],
)
def test_a_signal_that_no_protocol_can_send_is_refused(changes, message):
    whole = {"unit": "m", "meaning": "to the plan", "source": RIG, "opcua": "Distance", "modbus": 8, **changes}
    with pytest.raises(ValueError, match=message):
        Signal("distance", **whole)


def test_a_row_that_is_no_signal_is_named(tmp_path):
    lines = FILE.read_text(encoding="utf-8").splitlines()
    (tmp_path / "table.csv").write_text("\n".join((lines[0], lines[1].replace("md_m 3", "md_m three"))))
    with pytest.raises(ValueError, match="survey_depth"):
        read_signals(tmp_path / "table.csv")


@pytest.mark.parametrize(
    ("unit", "si", "metric", "fps"),
    [
        ("m", 3.048, 3.048, 10.0),
        ("degC", 100.0, 100.0, 212.0),
        ("rad/s", math.pi, 30.0, 30.0),
        ("m^3/s", 3.785411784e-3, 227.12470704, 60.0),
        ("N m", 1355.8179483314004, 1.3558179483314, 1.0),
        ("N", 4448.2216152605, 0.44482216152605, 1.0),
        ("Pa", 6894.757293168, 6.894757293168, 1.0),
        ("m/s", 0.3048 / 3600.0, 0.3048, 1.0),
        ("m/s^2", 9.80665, 1.0, 1.0),
        ("rad/m", math.radians(3.0) / 30.0, 3.0, 3.048),
    ],
)
def test_a_wits_item_has_the_unit_of_its_system_and_back(unit, si, metric, fps):
    for scale, number in ((UNITS[unit].metric, metric), (UNITS[unit].fps, fps)):
        assert scale.of(si) == pytest.approx(number)
        assert scale.si(number) == pytest.approx(si)


# Two more rows: what the rig measures, and what follows from the path; the fields are those of others.
NEW = (
    {
        "name": "block_height",
        "type": "Double",
        "unit": "m",
        "meaning": "height of the block above the floor",
        "source": "rig",
        "opcua": "BlockHeight",
        "dwis": "Measurement",
        "modbus": "80",
        "wits": "0899 BLKH 1",
        "reads": "0199",
        "page": "rig.block_position",
        "series": "block_height_m 2",
    },
    {
        "name": "survey_walk",
        "type": "Double",
        "unit": "rad/m",
        "meaning": "walk rate above the last accepted survey",
        "source": "survey",
        "opcua": "WalkRate",
        "dwis": "ComputedData",
        "page": "path.walk_rate",
        "field": "turn_rate",
        "list": "walk_deg_per_30m 4",
        "title": "Walk",
        "las": "WALK",
    },
)
# The table is read when it is first imported: a fresh interpreter takes that of another folder.
SCRIPT = """
import json, sys
import mwd_surface
mwd_surface.__path__.insert(0, sys.argv[1])
import example_rig, example_surveys
from mwd_surface.exports import csv_tables, export_las, survey_table, time_series
from mwd_surface.page.state_json import StateJson
from mwd_surface.rig.blackboard.client import manifest
from mwd_surface.rig.modbus import map as registers
from mwd_surface.rig.opcua.address_space import variable_values
from mwd_surface.rig.wits.records import RECORD_1, RecordWriter, Wits0Format

values, listed = example_rig.values(), survey_table.survey_table(example_surveys.surveys(), 1)
sections = StateJson().snapshot(example_rig.live().at(example_rig.NOW))["sections"]
print(json.dumps({
    "page": [sections["rig"]["block_position"]["value"], sections["path"]["walk_rate"]],
    "turn": sections["path"]["turn_rate"],
    "opcua": [variable_values(values)[name].value for name in ("BlockHeight", "WalkRate", "TurnRate")],
    "dwis": [v["VariableID"] for v in manifest()["ProvidedVariables"]],
    "modbus": registers.FLOATS[80],
    "wits": dict(RecordWriter(Wits0Format()).formation(values))[899],
    "reads": RECORD_1[199].name,
    "csv": csv_tables.definitive_csv(listed),
    "las": export_las.las(listed),
    "series": time_series.COLUMNS,
}))
"""


@pytest.mark.slow
def test_a_new_row_appears_on_page_and_in_every_protocol_and_file(tmp_path):
    table = shutil.copytree(FILE.parent, tmp_path / "signals") / FILE.name
    with FILE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), restval="")
        writer.writeheader()
        writer.writerows([*rows, *NEW])
    words = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    here = Path(__file__).resolve().parents[1]
    done = subprocess.run(words, cwd=here, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    got = json.loads(done.stdout)
    assert got["page"] == [12.0, got["turn"]]
    assert got["opcua"][0] == 12.0
    assert got["opcua"][1] == got["opcua"][2] != 0.0
    assert {"BlockHeight", "WalkRate"} <= set(got["dwis"])
    assert got["modbus"][0] == "block_height"
    assert (got["wits"], got["reads"]) == ("12.0", "block_height")
    names = next(line for line in got["csv"].splitlines() if not line.startswith("#")).split(",")
    assert "walk_deg_per_30m" in names
    assert re.search(r"^WALK\s*\.DEG/30M\s*:\s*Walk", got["las"], re.MULTILINE)
    assert "block_height_m" in got["series"]

"""What the page is told: last good values with their age, never a zero or a NaN that nobody measured."""

import dataclasses
import json
import math

import numpy as np
import pytest
from example_live import attitude, rig
from example_stations import listed, survey
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import settings, wire
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings
from mwd_surface.surveys.plan import Offset, plan_of
from mwd_surface.surveys.well import Well


def sections(state, now=0.0):
    return state.snapshot(now)["sections"]


def leaves(table):
    if isinstance(table, dict):
        for value in table.values():
            yield from leaves(value)
    elif isinstance(table, (list, tuple)):
        for value in table:
            yield from leaves(value)
    else:
        yield table


def test_before_anything_arrived_every_value_is_no_data_and_none_is_zero():
    snapshot = LiveState().snapshot(100.0)
    cells = [
        c for s in ("attitude", "drilling", "rig") for c in snapshot["sections"][s].values() if isinstance(c, dict)
    ]
    assert len(cells) > 15
    assert all((c["state"], c["value"], c["age"]) == ("no data", None, None) for c in cells)
    assert snapshot["sections"]["toolface"]["angle"]["state"] == "no data"
    assert snapshot["sections"]["recorder"]["fresh"] == "no data"
    json.dumps(snapshot, allow_nan=False)


@given(
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308]),
    st.sampled_from([math.nan, math.inf, 0.01, -1.0]),
)
def test_whatever_the_messages_hold_json_stays_finite(value, sigma):
    state = LiveState()
    state.on_attitude(attitude(inclination=value, azimuth=value, toolface=value, sigma=sigma), 0.0)
    g = wire.GRAVITY.empty(1)
    g["non_gravity"], g["rotary_speed"], g["sigma"] = value, value, sigma
    state.on_gravity(g, 0.0)
    t = wire.TEMPERATURE.empty(1)
    t["temperature"], t["variance"] = value, sigma
    state.on_temperature(t, 0.0)
    m = wire.MAG.empty(1)
    m["magnetic_field"] = min(value, 1e3) if math.isfinite(value) else value
    state.on_magnetic_field(m, 0.0)
    i = wire.INTERFERENCE.empty(1)
    for name in ("axial", "cross_axial", "total_residual", "dip_residual"):
        i[name] = value if not math.isfinite(value) else 1.0
    i["sigma_axial"], i["sigma_cross_axial"] = sigma, sigma
    state.on_interference(i, 0.0)
    state.on_rig_state(rig(bit_depth=value, hookload=value), 0.0)
    state.on_survey_progress(True, 0.0, value, value)
    state.on_recorder({"state": 1, "duration": value}, 0.0)
    text = json.dumps(state.snapshot(2.0), allow_nan=False)
    assert all(math.isfinite(v) for v in leaves(json.loads(text)) if isinstance(v, float))


def test_plain_records_are_taken_as_well_as_objects():
    found = listed(survey(1))
    state = LiveState()
    state.on_records([settings.to_mapping(r) for r in found.records], 0.0)
    assert sections(state)["surveys"]["rows"][0]["measured_depth"] == 100.0


def test_without_a_field_from_the_node_the_header_shows_that_of_the_last_survey():
    state = LiveState()
    state.on_records(listed(survey(1), survey(2, declination=0.02, convergence=0.01)).records, 0.0)
    well = sections(state)["well"]
    assert (well["field_declination"], well["field_convergence"]) == (0.02, 0.01)
    assert well["field_source"] == "as of survey 2"
    state.on_well(Well(), 0.0, {"declination": 0.5, "source": "IFR"})
    state.on_records(listed(survey(1)).records, 0.0)
    assert sections(state)["well"]["field_source"] == "IFR"


def test_a_plan_is_thinned_to_its_bound_and_keeps_its_end():
    state = LiveState(LiveSettings(max_rows=50))
    md = np.arange(0.0, 3000.0, 10.0)
    state.on_plan(plan_of(md, np.full(300, 0.5), np.zeros(300), name="C"), 0.0)
    got = sections(state)["plan"]
    assert len(got["north"]) <= 51
    assert got["north"][-1] == pytest.approx(math.sin(0.5) * 2990.0)
    state.on_plan(None, 0.0)
    assert sections(state)["plan"]["north"] == []


def test_the_offset_is_unknown_until_told():
    state = LiveState()
    assert sections(state)["offset"]["known"] is False
    state.on_offset(Offset(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.5), 0.0, dogleg_to_target=0.001)
    assert sections(state)["offset"]["up"] == 3.0


def test_findings_are_sorted_worst_first_whatever_shape_they_have():
    @dataclasses.dataclass
    class Finding:
        name: str
        level: bytes
        message: str
        remedy: str = ""

    state = LiveState()
    state.on_diagnostics([Finding("a", b"\x00", "fine"), {"name": "b", "level": 2, "message": "broken"}], 0.0)
    assert [(r["name"], r["level"]) for r in sections(state)["findings"]["rows"]] == [("b", "error"), ("a", "ok")]


def test_alarms_events_and_the_recorder_get_through():
    book, state = AlarmBook(), LiveState()
    book.raise_alarm("x.y", Severity.CRITICAL, "bad", "do", 5)
    state.on_alarms(book.alarms(), book.events(), 0.0)
    state.on_recorder({"state": 1, "path": "bags/a", "messages": 5, "dropped": 0, "duration": 2.0}, 0.0)
    got = sections(state, 1.0)
    assert got["alarms"]["rows"][0]["severity_word"] == "critical"
    assert (got["recorder"]["state"], got["recorder"]["fresh"], got["recorder"]["age"]) == ("recording", "live", 1.0)
    assert sections(state, 5.0)["recorder"]["fresh"] == "stale"


def test_revisions_change_exactly_with_what_people_see():
    state = LiveState()
    state.on_attitude(attitude(), 0.0)
    first = state.snapshot(0.0)["revisions"]
    again = state.snapshot(0.2)["revisions"]
    assert {k for k in first if first[k] != again[k]} == set()
    state.on_records(listed(survey(1)).records, 0.2)
    told = state.snapshot(0.3)["revisions"]
    assert {k for k in first if again[k] != told[k]} == {"surveys", "quality", "well"}
    # Growing old without any message is news as well.
    old = state.snapshot(5.0)["revisions"]
    assert {"attitude", "toolface", "links"} <= {k for k in first if told[k] != old[k]}


def test_a_well_with_a_reference_field_shows_its_corrections_and_one_without_shows_none():
    state = LiveState()
    assert sections(state)["well"]["field_declination"] is None
    state.on_well(Well(name="A"), 0.0, {"declination": 0.1, "convergence": 0.02, "source": "WMM2025"})
    well = sections(state)["well"]
    assert (well["name"], well["field_declination"], well["field_total"]) == ("A", 0.1, None)

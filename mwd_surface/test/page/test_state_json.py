# SPDX-License-Identifier: Apache-2.0
"""The JSON of the page: last good values with their age, never a zero or a NaN that was not measured."""

import json
import math

import example_rig
import numpy as np
import pytest
from example_live import ShownState, attitude, recorder, rig
from example_stations import listed, survey
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import wire
from mwd_surface.clearance.clearance import Clearance, ClearanceRule
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import AlarmState, DiagnosticLevel, NodeDiagnostic, ReferenceFieldState, SurveyProgress
from mwd_surface.page.state_json import StateJson, plain
from mwd_surface.signals.table import SIGNALS
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Offset, plan_of


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
    snapshot = ShownState().snapshot(100.0)
    cells = [
        c for s in ("attitude", "drilling", "rig") for c in snapshot["sections"][s].values() if isinstance(c, dict)
    ]
    assert len(cells) > 15
    assert all((c["state"], c["value"], c["age"]) == ("no data", None, None) for c in cells)
    assert snapshot["sections"]["toolface"]["angle"]["state"] == "no data"
    assert snapshot["sections"]["recorder"] is None
    json.dumps(snapshot, allow_nan=False)


@given(
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308]),
    st.sampled_from([math.nan, math.inf, 0.01, -1.0]),
)
def test_whatever_the_messages_hold_json_stays_finite(value, sigma):
    state = ShownState()
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
    state.show(0.0, survey_progress=SurveyProgress(True, "averaging", value, value))
    state.on_recorder(recorder(duration=value), 0.0)
    text = json.dumps(state.snapshot(2.0), allow_nan=False)
    assert all(math.isfinite(v) for v in leaves(json.loads(text)) if isinstance(v, float))


def test_without_a_field_from_the_node_the_header_shows_that_of_the_last_survey():
    state = ShownState()
    state.show(0.0, surveys=listed(survey(1), survey(2, declination=0.02, convergence=0.01)))
    well = sections(state)["well"]
    assert (well["field"]["declination"], well["field"]["convergence"]) == (0.02, 0.01)
    assert well["field"]["source"] == "as of survey 2"
    state.show(0.0, well=Well(), reference_given=ReferenceFieldState(declination=0.5, source="IFR"))
    state.show(0.0, surveys=listed(survey(1)))
    assert sections(state)["well"]["field"]["source"] == "IFR"


def test_a_plan_is_thinned_to_its_bound_and_keeps_its_end():
    state = ShownState(LiveSettings(max_rows=50))
    md = np.arange(0.0, 3000.0, 10.0)
    state.show(0.0, plan=plan_of(md, np.full(300, 0.5), np.zeros(300), name="C"))
    got = sections(state)["plan"]
    assert len(got["north"]) <= 51
    assert got["north"][-1] == pytest.approx(math.sin(0.5) * 2990.0)
    state.show(0.0, plan=None)
    assert sections(state)["plan"]["north"] == []


def test_offset_wells_stand_at_their_least_factor():
    state = ShownState()
    assert sections(state)["clearance"]["rows"] == []
    md, away = np.array([0.0, 30.0, 60.0]), np.zeros(3)
    distance, allowed = np.array([20.0, 9.0, 30.0]), np.full(3, 10.0)
    near = Clearance("A-3", md, md, distance, allowed, distance / allowed, away, away, ClearanceRule())
    state.show(0.0, clearance=(near,))
    (row,) = sections(state)["clearance"]["rows"]
    assert (row["name"], row["measured_depth"], row["distance"], row["level"]) == ("A-3", 30.0, 9.0, "stop")


def test_the_offset_is_unknown_until_it_is_given():
    state = ShownState()
    assert sections(state)["offset"] is None
    state.show(0.0, offset=Offset(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.5, dogleg_to_target=0.001))
    assert sections(state)["offset"]["up"] == 3.0


def test_the_level_of_a_diagnostic_is_a_word():
    state = ShownState()
    state.show(0.0, diagnostics=tuple(NodeDiagnostic(level.name, level, "told") for level in DiagnosticLevel))
    assert [row["level"] for row in sections(state)["diagnostics"]["rows"]] == ["ok", "warning", "error", "stale"]


def test_alarms_events_and_the_recorder_get_through():
    log, state = AlarmLog(lambda: 5), ShownState()
    log.raise_alarm("x.y", Severity.CRITICAL, "bad", "do")
    state.show(0.0, alarms=AlarmState(log.alarms()), events=log.events())
    state.on_recorder(recorder(), 0.0)
    got = sections(state, 1.0)
    assert got["alarms"]["rows"][0]["severity_word"] == got["events"]["rows"][0]["severity_word"] == "critical"
    assert (got["recorder"]["state"], got["streams"]["recorder"]["state"]) == ("recording", "live")
    assert sections(state, 5.0)["streams"]["recorder"]["state"] == "stale"


def test_revisions_change_exactly_with_what_people_see():
    state = ShownState()
    state.on_attitude(attitude(), 0.0)
    first = state.snapshot(0.0)["revisions"]
    again = state.snapshot(0.2)["revisions"]
    assert {k for k in first if first[k] != again[k]} == set()
    state.show(0.2, surveys=listed(survey(1)))
    changed = state.snapshot(0.3)["revisions"]
    assert {k for k in first if again[k] != changed[k]} == {"surveys", "quality", "well"}
    # A value that becomes stale without any message changes the revision as well.
    old = state.snapshot(5.0)["revisions"]
    assert {"attitude", "toolface", "streams"} <= {k for k in first if changed[k] != old[k]}


def test_a_well_with_a_reference_field_shows_its_corrections_and_one_without_shows_none():
    state = ShownState()
    assert sections(state)["well"]["field"]["declination"] is None
    field = ReferenceFieldState(declination=0.1, convergence=0.02, source="WMM2025")
    state.show(0.0, well=Well(name="A"), reference_given=field)
    well = sections(state)["well"]
    assert (well["name"], well["field"]["declination"], well["field"]["total"]) == ("A", 0.1, None)


def test_the_rows_of_the_survey_table_follow_the_north_of_the_well():
    state = ShownState()
    state.show(0.0, surveys=listed(survey(1, declination=0.02, convergence=0.01)))
    state.show(0.0, well=Well(north_reference="true"))
    true = sections(state)["surveys"]["rows"][0]
    state.show(1.0, well=Well(north_reference="grid"))
    grid = sections(state)["surveys"]["rows"][0]
    assert (true["azimuth_north"], grid["azimuth_north"]) == ("true", "grid")


def test_every_place_of_the_signal_table_is_in_the_json_under_the_name_of_its_field():
    shown = StateJson().snapshot(example_rig.live().at(example_rig.NOW))["sections"]
    shown["offset"] = plain(Offset(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.5))
    for signal in SIGNALS:
        for section, _, name in (place.partition(".") for place in signal.page):
            table = shown[section]["rows"][0] if section == "surveys" else shown[section]
            assert name in table, (signal.name, section)
            if section not in ("surveys", "path"):
                assert name == signal.field

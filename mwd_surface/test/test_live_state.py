"""What the page is told: last good values with their age, never a zero or a NaN that nobody measured."""

import dataclasses
import json
import math

import numpy as np
import pytest
from example_stations import listed, survey
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.status import Status
from mwd_sensors import settings, wire
from mwd_surface.page.alarms import AlarmBook, Severity
from mwd_surface.page.live_state import LiveSettings, LiveState
from mwd_surface.page.toolface import MAGNETIC, ToolfaceReading
from mwd_surface.surveys.plan import Offset, plan_of
from mwd_surface.surveys.well import Well


def attitude(inclination=0.8, azimuth=1.0, toolface=0.5, sigma=0.01, status=0, north=3, n=1, **more):
    samples = wire.ATTITUDE.empty(n)
    samples["stamp_ns"] = 5
    samples["inclination"], samples["azimuth"], samples["gravity_toolface"] = inclination, azimuth, toolface
    for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
        samples["sigma_" + name] = sigma
    samples["status"], samples["north"] = status, north
    for name, value in more.items():
        samples[name] = value
    return samples


def rig(valid=2047, **values):
    samples = wire.RIG_STATE.empty(1)
    samples["valid"] = valid
    for name, value in values.items():
        samples[name] = value
    return samples


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


def test_a_value_carries_sigma_unit_and_age_and_goes_stale_after_two_periods():
    state = LiveState(LiveSettings(estimator_period=0.5))
    state.on_attitude(attitude(inclination=0.8, sigma=0.01), 10.0)
    cell = sections(state, 10.9)["attitude"]["inclination"]
    assert (cell["value"], cell["sigma"], cell["unit"], cell["state"]) == (0.8, 0.01, "rad", "live")
    assert cell["age"] == pytest.approx(0.9)
    stale = sections(state, 11.1)["attitude"]["inclination"]
    assert (stale["state"], stale["value"]) == ("stale", 0.8)


def test_an_angle_without_sigma_keeps_the_last_good_one_stale_and_says_why():
    state = LiveState()
    state.on_attitude(attitude(azimuth=1.5), 0.0)
    state.on_attitude(attitude(azimuth=0.0, sigma_azimuth=-1.0, status=int(Status.NEAR_VERTICAL)), 0.1)
    cell = sections(state, 0.1)["attitude"]["azimuth"]
    assert (cell["value"], cell["state"]) == (1.5, "stale")
    assert "vertical" in cell["reason"]
    assert sections(state, 0.1)["attitude"]["inclination"]["state"] == "live"


def test_an_angle_that_was_never_known_is_no_data_with_the_reason():
    state = LiveState()
    state.on_attitude(attitude(sigma_azimuth=-1.0, status=int(Status.NO_MAG)), 0.0)
    cell = sections(state)["attitude"]["azimuth"]
    assert (cell["value"], cell["state"], cell["reason"]) == (None, "no data", "no usable magnetometer")


def test_an_angle_whose_sigma_is_half_a_turn_is_not_shown_as_a_number():
    state = LiveState()
    state.on_attitude(attitude(sigma_azimuth=math.pi), 0.0)
    cell = sections(state)["attitude"]["azimuth"]
    assert (cell["value"], cell["reason"]) == (None, "sigma 180 deg")


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


def test_rig_values_count_only_while_their_bit_vouches_for_them():
    state = LiveState()
    state.on_rig_state(rig(valid=1 | 64, bit_depth=0.0, rotary_speed=12.0, hookload=5.0), 0.0)
    got = sections(state)["rig"]
    assert (got["bit_depth"]["value"], got["bit_depth"]["state"]) == (0.0, "live")
    assert got["rig_rotary_speed"]["value"] == 12.0
    assert got["hookload"]["value"] is None
    assert got["in_slips"] is None
    state.on_rig_state(rig(in_slips=True), 0.1)
    assert sections(state)["rig"]["in_slips"] is True


def test_interference_that_is_not_observable_is_no_data_and_not_zero():
    state = LiveState()
    i = wire.INTERFERENCE.empty(1)
    i["sigma_axial"], i["sigma_cross_axial"] = -1.0, -1.0
    state.on_interference(i, 0.0)
    cell = sections(state)["drilling"]["axial_interference"]
    assert (cell["value"], cell["state"], cell["reason"]) == (None, "no data", "not observable yet")
    i["axial"], i["sigma_axial"] = 6e-7, 1e-7
    state.on_interference(i, 0.0)
    assert sections(state)["drilling"]["axial_interference"]["sigma"] == 1e-7


def test_the_dial_keeps_the_last_readings_at_their_spacing_with_their_mode():
    state = LiveState(LiveSettings(readings=3, reading_spacing=1.0))
    for k in range(60):
        state.on_attitude(attitude(toolface=0.01 * k), k * 0.1)
    toolface = sections(state, 5.9)["toolface"]
    assert [r["at"] for r in toolface["readings"]] == pytest.approx([3.0, 4.0, 5.0])
    assert {r["mode"] for r in toolface["readings"]} == {"gravity"}
    assert toolface["angle"]["value"] == pytest.approx(0.59)
    assert state.toolface_reading.angle == pytest.approx(0.59)


def test_a_toolface_from_another_source_is_shown_with_its_own_mode():
    state = LiveState()
    state.on_toolface(ToolfaceReading(1, MAGNETIC, 2.0, 0.1), 0.0)
    toolface = sections(state)["toolface"]
    assert (toolface["mode"], toolface["angle"]["value"]) == ("magnetic", 2.0)


def test_the_advisory_knows_inside_and_outside_across_north_and_says_nothing_when_stale():
    state = LiveState()
    state.on_attitude(attitude(toolface=math.radians(355.0)), 0.0)
    state.on_advisory(math.radians(5.0), math.radians(15.0), 0.0)
    assert sections(state, 0.0)["toolface"]["advisory"]["inside"] is True
    state.on_advisory(math.radians(30.0), math.radians(15.0), 0.0)
    assert sections(state, 0.0)["toolface"]["advisory"]["inside"] is False
    assert sections(state, 9.0)["toolface"]["advisory"]["inside"] is None
    state.on_advisory(None, 0.1, 0.0)
    assert sections(state)["toolface"]["advisory"] is None


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


def test_the_offset_and_the_telemetry_are_unknown_until_told():
    state = LiveState()
    assert sections(state)["offset"]["known"] is False
    assert sections(state)["telemetry"]["known"] is False
    state.on_offset(Offset(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.5), 0.0, dogleg_to_target=0.001)
    state.on_telemetry(90, 10, 0.0, confidence=0.8)
    assert sections(state)["offset"]["up"] == 3.0
    assert sections(state)["telemetry"]["share"] == 0.9


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


def test_links_give_the_rate_of_whole_seconds_and_refuse_unknown_streams():
    state = LiveState()
    for k in range(60):
        state.on_stream("sonde", 10, 100.0 + k * 0.1, lost=1)
    link = sections(state, 106.0)["links"]["sonde"]
    assert link["rate"] == pytest.approx(100.0)
    assert (link["count"], link["lost"], link["state"]) == (600, 60, "live")
    assert sections(state, 120.0)["links"]["sonde"]["rate"] == 0.0
    assert sections(state, 120.0)["links"]["rig"]["state"] == "no data"
    with pytest.raises(ValueError, match="'sonda' is not one of sonde"):
        state.on_stream("sonda", 1, 0.0)


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


def test_the_history_is_bounded_and_has_no_value_for_a_silent_second():
    state = LiveState(LiveSettings(history_seconds=30.0))
    g = wire.GRAVITY.empty(1)
    g["sigma"], g["non_gravity"] = 0.01, 5.0
    for k in range(100):
        if k != 90:
            state.on_gravity(g, k + 0.5)
        state.snapshot(k + 0.9)
    history = sections(state, 100.0)["history"]
    column = history["columns"].index("vibration")
    assert len(history["rows"]) == 30
    assert [row[column] for row in history["rows"]].count(None) == 1


def test_a_clock_that_steps_back_gives_no_negative_age():
    state = LiveState()
    state.on_attitude(attitude(), 100.0)
    assert sections(state, 99.0)["attitude"]["inclination"]["age"] == 0.0


def test_a_well_with_a_reference_field_shows_its_corrections_and_one_without_shows_none():
    state = LiveState()
    assert sections(state)["well"]["field_declination"] is None
    state.on_well(Well(name="A"), 0.0, {"declination": 0.1, "convergence": 0.02, "source": "WMM2025"})
    well = sections(state)["well"]
    assert (well["name"], well["field_declination"], well["field_total"]) == ("A", 0.1, None)

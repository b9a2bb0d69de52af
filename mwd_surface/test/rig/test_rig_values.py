# SPDX-License-Identifier: Apache-2.0
"""The table for rig control: every value with age, sigma and whether it may be acted upon; never a NaN."""

import math

import numpy as np
import pytest
from example_rig import NOW, NOW_NS, VALID, attitude, live, rig_state, values
from example_surveys import START, S, survey, surveys

from mwd_estimation.core.status import Status
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.toolface import GRAVITY, MAGNETIC
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.rig.values import Condition, nothing_yet, rig_values, silenced
from mwd_surface.signals.table import BY_NAME, FROM_CONTROL, LOG, OF_SURVEY, PLAN, TO_RIG
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_list import SurveyList

TOOL = ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface", "rotary_speed", "temperature")


def test_every_quantity_is_there_and_good_when_everything_came():
    table = values()
    names = {signal.name for signal in TO_RIG}
    assert set(table.values) == names
    good = {name: v for name, v in table.values.items() if v.condition == Condition.GOOD}
    # The example has no plan and no logs, and its set-point is not a turn.
    assert names - set(good) == {signal.name for signal in TO_RIG if signal.source in (PLAN, LOG)} | {"set_turn"}
    assert all(v.age is not None and v.age >= 0.0 and v.stamp_ns > 0 for v in good.values())
    assert table.values["inclination"].value == pytest.approx(math.radians(40.12))
    assert table.values["gravity_toolface"].value == pytest.approx(math.radians(123.456))
    assert table.values["magnetic_toolface"].value == pytest.approx(math.radians(201.5))
    assert table.values["bit_depth"].value == 650.25
    assert (table.mode, table.heartbeat, table.sonde_link, table.recording) == (GRAVITY, int(NOW), True, True)
    assert (table.circulating, table.in_slips) == (True, False)
    assert table.toolface is table.values["gravity_toolface"]


def test_before_anything_came_everything_waits_with_a_reason():
    table = rig_values(LiveState().at(1.0), (), now_ns=NOW_NS)
    assert {v.condition for v in table.values.values()} == {Condition.WAITING}
    assert all(v.reason and v.value == 0.0 and v.stamp_ns == 0 for v in table.values.values())
    assert table.survey is None
    assert not nothing_yet().active


def test_silence_makes_values_stale_and_keeps_the_last_one():
    table = values(later=2.5)
    v = table.values["bit_depth"]
    assert (v.condition, v.value) == (Condition.STALE, 650.25)
    assert v.age == pytest.approx(3.5)
    assert NOW_NS - v.stamp_ns == pytest.approx(S, abs=1000)


@pytest.mark.parametrize("flow", [0.0, 1e-6, 1e-3, 2e-3, 0.03])
def test_the_rig_and_the_page_agree_on_whether_mud_flows(flow):
    """The offset of a flow meter was circulation for OPC UA and WITS, and "pumps off" on the page."""
    sample = rig_state(flow_rate=flow)
    assert values(rig=sample).circulating is live(rig=sample).at(NOW).rig.pumps_on


def test_facts_of_the_rig_end_with_its_data():
    """A rig that was in slips at its last sample was in slips, and its activity a connection, for ever."""
    slips = rig_state(in_slips=True)
    assert values(rig=slips).in_slips is True
    old = values(rig=slips, later=100.0)
    assert (old.in_slips, old.circulating) == (None, None)


@pytest.mark.fault_case(57)
def test_a_silent_sonde_is_no_link_and_an_accepted_survey_does_not_age_away():
    table = values(later=100.0)
    assert not table.sonde_link
    assert all(table.values[name].condition == Condition.NO_LINK for name in TOOL)
    assert all(table.values[signal.name].condition == Condition.GOOD for signal in OF_SURVEY)


def test_a_sensor_fault_marks_every_value_of_the_tool():
    table = values(sample=attitude(Status.SENSOR_FAULT))
    assert all(table.values[name].condition == Condition.FAULT for name in TOOL)
    assert table.values["bit_depth"].condition == Condition.GOOD


@pytest.mark.parametrize(
    ("status", "name"),
    [
        (Status.ROTATING, "gravity_toolface"),
        (Status.MAG_DISTURBED, "azimuth"),
        (Status.CORRECTION_REFUSED, "azimuth"),
        (Status.UNCORRECTED, "azimuth"),
        (Status.ALIASED, "inclination"),
    ],
)
def test_what_the_estimator_doubts_is_doubtful(status, name):
    v = values(sample=attitude(status)).values[name]
    assert v.condition == Condition.DOUBTFUL
    assert v.condition.usable
    assert v.reason


def test_an_inactive_node_says_so_of_everything():
    table = values(active=False)
    assert {v.condition for v in table.values.values()} == {Condition.INACTIVE}
    assert not table.active


def test_a_toolface_that_is_not_defined_keeps_its_last_value_as_stale():
    first = values()
    steep = attitude(
        Status.NEAR_VERTICAL,
        inclination=0.01,
        sigma_gravity_toolface=math.nan,
        gravity_toolface=0.0,
        stamp_ns=NOW_NS + 5 * S,
    )
    state = live(sample=steep).at(NOW)
    table = rig_values(state, (), now_ns=NOW_NS + 5 * S, previous=first)
    assert table.mode == MAGNETIC
    old = table.values["gravity_toolface"]
    assert (old.condition, old.value) == (Condition.STALE, first.values["gravity_toolface"].value)
    assert old.age == pytest.approx(5.1)
    assert "not defined" in old.reason
    assert table.toolface.condition == Condition.GOOD


def test_a_survey_by_a_persons_word_is_an_override_and_an_uncorrected_azimuth_is_doubtful():
    vertical = (Leg(tie_on=TieOn.given(0.0, 0.0, 0.0)),)
    whole = SurveyList(legs=vertical).add(survey(1, 30.0, 75.0, verdict=1, north=2), 300.0, 0.0)
    whole = whole.accept(1, "Bo", "gyro agrees", START + S)
    table = values(whole)
    assert {table.values[signal.name].condition for signal in OF_SURVEY} == {Condition.OVERRIDE}
    raw = survey(1, 30.0, 75.0, north=2, azimuth_method="raw", status=int(Status.UNCORRECTED))
    table = values(SurveyList().add(raw, 300.0, 0.0))
    assert table.values["survey_azimuth"].condition == Condition.DOUBTFUL
    assert table.values["survey_inclination"].condition == Condition.GOOD


def test_silenced_values_may_not_be_acted_upon_and_the_heartbeat_stands():
    table = silenced(values(), 4.0, "the surface node is silent")
    assert not any(v.condition.usable for v in table.values.values())
    assert table.heartbeat == int(NOW)
    assert table.values["bit_depth"].age == pytest.approx(5.0)
    assert not table.sonde_link


def test_nothing_in_the_table_is_ever_a_nan():
    bad = attitude(inclination=math.nan, gravity_toolface=math.inf, sigma_magnetic_toolface=math.nan)
    rig = rig_state(bit_depth=math.nan, hole_depth=-math.inf, valid=VALID)
    table = values(sample=bad, rig=rig)
    assert np.all(np.isfinite([v.value for v in table.values.values()]))
    assert table.values["bit_depth"].condition == Condition.WAITING


def test_the_same_arguments_give_the_same_table():
    whole = surveys()
    state = live(whole).at(NOW)
    accepted = accepted_surveys(whole)
    assert rig_values(state, accepted, now_ns=NOW_NS) == rig_values(state, accepted, now_ns=NOW_NS)


@pytest.mark.parametrize("later", [0.0, 30.0])
def test_the_stamp_of_a_measurement_does_not_change_while_nothing_new_comes(later):
    whole = surveys()
    state, accepted = live(whole), accepted_surveys(whole)
    before = None
    for k in range(5):
        # The clock of the well advances in steps, the clock of the node does not.
        seconds = later + 0.25 * k
        now_ns = NOW_NS + round((seconds + 0.05 * math.sin(7.0 * k)) * S)
        table = rig_values(state.at(NOW + seconds), accepted, now_ns=now_ns, previous=before)
        stamps = {n: v.stamp_ns for n, v in table.values.items() if BY_NAME[n] not in FROM_CONTROL}
        if before is not None:
            assert [n for n, stamp_ns in stamps.items() if stamp_ns != before.values[n].stamp_ns] == []
        before = table

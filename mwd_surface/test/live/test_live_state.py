# SPDX-License-Identifier: Apache-2.0
"""Single values of the page: the last good one with sigma and age, a reason where withheld, never an invented zero."""

import dataclasses
import math

import example_rig
import pytest
from example_live import attitude, rig
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.control.status import ControlStatus
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.toolface import GRAVITY, MAGNETIC, ToolfaceReading
from mwd_surface.live.well_state import AlarmState
from mwd_surface.trajectory.advice import Advice, AdviceMode
from page_states import exact


@pytest.mark.fault_case(96)
def test_a_value_carries_sigma_unit_and_age_and_goes_stale_after_two_periods():
    state = LiveState(LiveSettings(estimator_period=0.5))
    state.on_attitude(attitude(inclination=0.8, sigma=0.01), 10.0)
    cell = state.at(10.9).attitude.inclination
    assert (cell.value, cell.sigma, cell.unit, cell.state) == (0.8, 0.01, "rad", "live")
    assert cell.age == pytest.approx(0.9)
    stale = state.at(11.1).attitude.inclination
    assert (stale.state, stale.value) == ("stale", 0.8)


def test_an_angle_without_sigma_keeps_the_last_good_one_stale_and_says_why():
    state = LiveState()
    state.on_attitude(attitude(azimuth=1.5), 0.0)
    state.on_attitude(attitude(azimuth=0.0, sigma_azimuth=math.nan, status=int(Status.NEAR_VERTICAL)), 0.1)
    cell = state.at(0.1).attitude.azimuth
    assert (cell.value, cell.state) == (1.5, "stale")
    assert "vertical" in cell.reason
    assert state.at(0.1).attitude.inclination.state == "live"


def test_an_angle_that_was_never_known_is_no_data_with_the_reason():
    state = LiveState()
    state.on_attitude(attitude(sigma_azimuth=math.nan, status=int(Status.NO_MAG)), 0.0)
    cell = state.at(0.0).attitude.azimuth
    assert (cell.value, cell.state, cell.reason) == (None, "no data", "no magnetometer")


def test_an_angle_whose_sigma_is_half_a_turn_is_not_shown_as_a_number():
    state = LiveState()
    state.on_attitude(attitude(sigma_azimuth=math.pi), 0.0)
    cell = state.at(0.0).attitude.azimuth
    assert (cell.value, cell.reason) == (None, "sigma 180 deg")


def test_rig_values_count_only_while_their_bit_vouches_for_them():
    state = LiveState()
    state.on_rig_state(rig(valid=1 | 64, bit_depth=0.0, rotary_speed=12.0, hookload=5.0), 0.0)
    got = state.rig(0.0)
    assert (got.bit_depth.value, got.bit_depth.state) == (0.0, "live")
    assert got.rotary_speed.value == 12.0
    assert got.hookload.value is None
    assert got.in_slips is None
    state.on_rig_state(rig(in_slips=True), 0.1)
    assert state.rig(0.0).in_slips is True


def test_interference_that_is_not_observable_is_no_data_and_not_zero():
    state = LiveState()
    i = wire.INTERFERENCE.empty(1)
    i["axial"] = i["cross_axial"] = i["sigma_axial"] = i["sigma_cross_axial"] = math.nan
    state.on_interference(i, 0.0)
    cell = state.at(0.0).drilling.axial_interference
    assert (cell.value, cell.state, cell.reason) == (None, "no data", "not observable yet")
    i["axial"], i["sigma_axial"] = 6e-7, 1e-7
    state.on_interference(i, 0.0)
    assert state.at(0.0).drilling.axial_interference.sigma == 1e-7


def test_the_dial_keeps_the_last_readings_at_their_spacing_with_their_mode():
    state = LiveState()
    for k in range(160):
        state.on_attitude(attitude(toolface=0.01 * k), k * 0.1)
    toolface = state.at(15.9).toolface
    assert [r.at for r in toolface.readings] == pytest.approx(range(4, 16))
    assert {r.mode for r in toolface.readings} == {GRAVITY}
    assert toolface.angle.value == pytest.approx(1.59)
    assert state.toolface_reading.angle == pytest.approx(1.59)


def test_a_toolface_from_another_source_is_shown_with_its_own_mode():
    state = LiveState()
    state.on_toolface(ToolfaceReading(1, MAGNETIC, 2.0, 0.1), 0.0)
    toolface = state.at(0.0).toolface
    assert (toolface.mode, toolface.angle.value) == (MAGNETIC, 2.0)


def test_the_advisory_knows_inside_and_outside_across_north_and_says_nothing_when_stale():
    state = LiveState()
    state.on_attitude(attitude(toolface=math.radians(355.0)), 0.0)
    slide = Advice(AdviceMode.SLIDE, toolface=math.radians(5.0), limit=math.radians(15.0))
    state.show(0.0, advice=slide)
    assert state.at(0.0).toolface.advisory.inside is True
    state.show(0.0, advice=dataclasses.replace(slide, toolface=math.radians(30.0)))
    assert state.at(0.0).toolface.advisory.inside is False
    assert state.at(9.0).toolface.advisory.inside is None
    state.show(0.0, advice=Advice(AdviceMode.ROTATE))
    assert state.at(0.0).toolface.advisory is None


def test_the_history_is_bounded_and_has_no_value_for_a_silent_second():
    state = LiveState(LiveSettings(history_seconds=30.0))
    g = wire.GRAVITY.empty(1)
    g["sigma"], g["non_gravity"] = 0.01, 5.0
    for k in range(100):
        if k != 90:
            state.on_gravity(g, k + 0.5)
        state.at(k + 0.9)
    history = state.at(100.0).history
    column = history.columns.index("vibration")
    assert len(history.rows) == 30
    assert [row[column] for row in history.rows].count(None) == 1


def test_the_worst_of_a_block_is_charted_and_its_last_is_shown():
    state = LiveState()
    g = wire.GRAVITY.empty(3)
    g["sigma"], g["non_gravity"], g["rotary_speed"] = [0.01, math.nan, 0.01], [3.0, 99.0, 1.0], [1.0, 9.0, 2.0]
    state.on_gravity(g, 0.0)
    drilling = state.at(0.0).drilling
    # The second does not know its gravity, so what is left over means nothing.
    assert drilling.vibration.value == 3.0
    assert drilling.rotary_speed.value == 2.0


def test_a_tool_that_does_not_turn_has_no_stick_slip():
    state = LiveState()
    d = wire.DYNAMICS.empty(1)
    d["stick_slip_index"], d["shocks"] = math.nan, 4
    state.on_dynamics(d, 0.0)
    drilling = state.at(0.0).drilling
    assert (drilling.stick_slip.value, drilling.stick_slip.reason) == (None, "not turning")
    assert drilling.shocks.value == 4.0


def test_depth_tracks_grow_only_while_hole_is_made():
    state = LiveState(LiveSettings(log_step=1.0))
    state.on_attitude(attitude(inclination=0.1), 0.0)
    state.on_log_depth(100.2)
    state.on_attitude(attitude(inclination=0.2), 1.0)
    state.on_log_depth(101.2)
    state.on_attitude(attitude(inclination=0.3), 2.0)
    state.on_log_depth(None)
    state.on_attitude(attitude(inclination=0.9), 3.0)
    log = state.at(4.0).depth_log
    column = log.columns.index("inclination")
    assert {row[column] for row in log.rows} <= {0.2, 0.3}
    state.on_log_depth(math.nan)
    state.on_log_depth(-5.0)
    assert len(log.rows) == len(state.at(5.0).depth_log.rows)


@given(st.lists(st.sampled_from([int(Status.SENSOR_FAULT), int(Status.REJECTED), 0]), min_size=1, max_size=5))
def test_the_doubt_of_a_block_is_that_of_its_worst_sample(statuses):
    state = LiveState()
    samples = attitude(n=len(statuses))
    samples["status"] = statuses
    state.on_attitude(samples, 10.5)
    history = state.at(12.0).history
    column = history.columns.index("doubt")
    shown = max(row[column] for row in history.rows if row[column] is not None)
    assert shown == (2.0 if int(Status.SENSOR_FAULT) in statuses else 1.0 if any(statuses) else 0.0)


@pytest.mark.fault_case(23)
@pytest.mark.parametrize("celsius", [300.0, -80.0])
def test_a_temperature_that_no_tool_has_is_withheld_with_the_reason(celsius):
    streams = LiveState()
    heat = wire.TEMPERATURE.empty(1)
    heat["temperature"] = celsius
    streams.on_temperature(heat, 1.0)
    shown = streams.at(1.0).drilling.temperature
    assert shown.value is None
    assert "not plausible in a tool" in shown.reason


def test_a_part_that_the_state_does_not_have_is_refused():
    with pytest.raises(TypeError, match="contrl"):
        LiveState().show(0.0, contrl=ControlStatus())


def test_a_state_that_was_taken_does_not_change_with_what_comes_later():
    live = example_rig.live()
    taken = live.at(example_rig.NOW)
    before = exact(taken)
    for k in range(1, 40):
        live.on_attitude(attitude(inclination=0.01 * k), example_rig.NOW + k)
        live.on_rig_state(rig(bit_depth=float(k)), example_rig.NOW + k)
        live.on_log_depth(1000.0 + k)
        live.show(example_rig.NOW + k, control=ControlStatus(sequence=k), alarms=AlarmState(epoch=float(k)))
        live.at(example_rig.NOW + k)
    assert exact(taken) == before


@given(st.permutations(range(5)))
def test_the_state_depends_on_what_was_set_and_not_on_the_order_of_its_parts(order):
    parts = (
        {"control": ControlStatus(sequence=3)},
        {"inputs": InputTable(depth_source="rig")},
        {"quill": 1.0},
        {"advice": Advice(AdviceMode.SLIDE, toolface=1.0, limit=0.2)},
        {"alarms": AlarmState(epoch=5.0)},
    )
    states = []
    for places in (range(5), order):
        live = LiveState()
        live.on_attitude(attitude(), 1.0)
        for k in places:
            live.show(1.0, **parts[k])
        states.append(exact(live.at(1.5)))
    assert states[0] == states[1]

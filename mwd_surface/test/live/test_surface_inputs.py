# SPDX-License-Identifier: Apache-2.0
"""Clocks and ages of the inputs, and which source of depth is in force."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.live.inputs import BLOCK, DISAGREEMENT, HAND, DepthSources, InputClock, InputState, Role, StampClock
from mwd_surface.live.source_selection import SourceRules, SourceSelection

S = 1_000_000_000


@given(offset=st.floats(-1e5, 1e5), delays=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=50))
def test_the_offset_is_that_of_the_message_with_the_shortest_way_and_the_rest_is_age(offset, delays):
    clock, host = InputClock(), 1_700_000_000 * S
    for k, delay in enumerate(delays):
        made = host + k * S
        clock.note(made + round(offset * S), made + round(delay * S), k + delay)
    now = len(delays) - 1 + delays[-1]
    state = clock.state("sonde", StampClock.TOOL, host + round(now * S), now)
    assert state.clock_offset == pytest.approx(offset - min(delays), abs=1e-6)
    assert state.data_age == pytest.approx(delays[-1] - min(delays), abs=1e-6)
    assert 0.0 <= state.offset_age <= now + 1e-9


def test_an_old_shortest_way_is_forgotten_so_that_a_clock_that_was_set_counts():
    clock = InputClock()
    for k in range(200):
        clock.note((k + (5 if k < 100 else 0)) * S, k * S, float(k))
    assert clock.state("sonde", StampClock.TOOL, 199 * S, 199.0).clock_offset == 0.0


def test_data_that_the_surface_stamps_itself_have_no_offset_and_their_true_age():
    clock = InputClock()
    clock.note(100 * S, 100 * S, 0.0)
    state = clock.state("rig_wits", StampClock.HOST, 103 * S, 3.0)
    assert (state.clock_offset, state.data_age) == (0.0, 3.0)
    assert InputClock().state("sonde", StampClock.TOOL, 0, 0.0) == InputState("sonde", StampClock.TOOL)


class Rig:
    """Sources that speak once a second."""

    def __init__(self, **rules):
        self.selection = SourceSelection(SourceRules(**rules))
        self.sources = DepthSources(self.selection)
        self.used = []

    def speak(self, now, **depths):
        """Depths by the frame of their source."""
        frames = [f"well_1/{name}" for name in depths]
        if frames:
            self.used.append(self.selection.choose(frames, now).rpartition("/")[2])
        for name, depth in depths.items():
            self.sources.take(f"well_1/{name}", depth, now)

    def table(self, now):
        states = {name: InputState(name, StampClock.RIG) for name in ("rig_floor", "rig_wits", "rig_opcua")}
        return self.sources.table(states, now)


def test_the_better_source_takes_over_after_it_has_settled_and_gives_way_when_silent():
    rig = Rig()
    for now in range(60):
        floor = {"rig_floor": 1000.0} if 5 <= now < 30 or now >= 40 else {}
        rig.speak(now, rig_wits=1000.5, **floor)
    assert rig.used[:15] == ["rig_wits"] * 15
    assert rig.used[15:35] == ["rig_floor"] * 20
    assert rig.used[35:50] == ["rig_wits"] * 15
    assert set(rig.used[50:]) == {"rig_floor"}


@given(st.lists(st.sets(st.sampled_from(["rig_floor", "rig_wits", "rig_opcua", "x"])), max_size=200))
def test_a_source_that_speaks_without_pause_is_left_only_for_a_better_one(spoken):
    rig = Rig(settle=3.0)
    before, since = None, {}
    for now, frames in enumerate(spoken):
        since = {name: since.get(name, now) for name in frames}
        if not frames:
            continue
        rig.speak(now, **dict.fromkeys(sorted(frames), 1000.0))
        used = rig.used[-1]
        if before in since and used != before:
            assert rig.selection.rank(used) < rig.selection.rank(before)
        before = used


def test_the_difference_of_live_sources_is_told_and_a_silent_one_is_not_compared():
    rig = Rig()
    rig.speak(0.0, rig_floor=1000.0, rig_wits=1008.0, rig_opcua=999.0)
    table = rig.table(1.0)
    assert (table.depth_source, table.depth_age, table.depth_difference) == ("rig_floor", 1.0, 8.0)
    assert [row.name for row in table.inputs] == ["rig_floor", "rig_opcua", "rig_wits"]
    assert [row.role for row in table.inputs] == [Role.IN_FORCE, Role.STANDBY, Role.STANDBY]
    assert [row.priority for row in table.inputs] == [1, 2, 3]
    rig.speak(10.0, rig_floor=1001.0)
    table = rig.table(10.0)
    assert math.isnan(table.depth_difference)
    assert {row.role for row in table.inputs[1:]} == {Role.SILENT}


def test_a_depth_by_hand_goes_before_a_source_that_contradicts_it_for_its_time():
    rig = Rig(hand_hold=100.0)
    rig.speak(0.0, rig_floor=1000.0)
    rig.sources.set_by_hand(1020.0, 1.0)
    for now in range(2, 101):
        rig.speak(float(now), rig_floor=1000.0)
        assert rig.sources.by_hand(now) == 1020.0
    assert (rig.table(100.0).depth_source, rig.table(100.0).depth_difference) == (HAND, 20.0)
    rig.speak(102.0, rig_floor=1000.0)
    assert rig.sources.by_hand(102.0) is None
    assert rig.table(102.0).depth_source == "rig_floor"


def test_a_source_that_agrees_with_the_hand_is_used_at_once():
    rig = Rig()
    rig.sources.set_by_hand(1020.0, 0.0)
    rig.speak(1.0, rig_floor=1020.0 + 0.9 * DISAGREEMENT)
    assert rig.sources.by_hand(1.0) is None


def test_without_any_source_the_hand_holds_for_ever():
    rig = Rig(hand_hold=1.0)
    rig.sources.set_by_hand(1020.0, 0.0)
    table = rig.table(1e6)
    assert (table.depth_source, table.depth_age) == (HAND, 1e6)


def test_the_block_carries_on_what_a_source_or_a_person_gave_last():
    rig = Rig()
    rig.speak(0.0, rig_floor=1000.0)
    rig.sources.take_block(1003.0, 8.0)
    table = rig.table(9.0)
    assert (table.depth_source, table.depth_age, table.named(BLOCK).bit_depth) == (BLOCK, 1.0, 1003.0)
    assert "rig_floor" in table.named(BLOCK).reason
    rig.sources.set_by_hand(1020.0, 9.0)
    rig.sources.take_block(1020.5, 10.0)
    table = rig.table(10.0)
    assert (table.depth_source, table.named(BLOCK).bit_depth) == (BLOCK, 1020.5)
    assert (table.named(HAND).role, table.named(BLOCK).role) == (Role.STANDBY, Role.IN_FORCE)
    # A block that is read no more leaves the depth by hand, a source that speaks its own depth.
    assert rig.table(20.0).depth_source == HAND
    rig.speak(20.0, rig_floor=1020.0)
    rig.sources.take_block(None, 20.0)
    assert rig.table(20.0).depth_source == "rig_floor"

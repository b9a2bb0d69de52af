# SPDX-License-Identifier: Apache-2.0
"""Which depth surveys are paired with, and which is shown, while a person's contradicts the rig's."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.input_monitor import InputMonitor
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.source_selection import SourceRules, SourceSelection
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext

BIT, BLOCK, SLIPS = 1, 4, 1024


@pytest.fixture
def monitor():
    """An open monitor that has heard the rig floor say 1000 m."""
    clock, selection = WellClock(10**18), SourceSelection(SourceRules())
    monitor = InputMonitor(WellContext(clock, LiveState(), AlarmLog(lambda: clock.now_ns)), selection, link=False)
    selection.choose(["rig_floor"], clock.now)
    monitor.on_rig_input("rig_floor", rig([1000.0]))
    return monitor


def rig(depths, valid=BIT, blocks=0.0):
    samples = wire.RIG_STATE.empty(len(depths))
    samples["stamp_ns"] = (1 + np.arange(len(depths))) * wire.NANOSECONDS
    samples["bit_depth"], samples["block_position"], samples["valid"] = depths, blocks, valid
    return samples


def test_a_depth_by_hand_that_contradicts_the_rig_is_shown_and_surveys_get_none_of_the_rigs(monitor):
    monitor.on_depth_by_hand(1020.0)
    samples = rig([1000.0, 1000.1])
    paired, shown = monitor.in_force(samples)
    assert not np.any(paired["valid"] & BIT)
    assert list(shown["bit_depth"]) == [1020.0, 1020.0]
    assert np.all(shown["valid"] & BIT)
    assert np.all(samples["valid"] & BIT)


def test_a_depth_by_hand_from_before_a_restart_shuts_the_rig_out_no_longer_than_its_age_allows(monitor):
    monitor.on_depth_by_hand(1020.0, age=601.0)
    paired, shown = monitor.in_force(rig([1000.0]))
    assert list(paired["bit_depth"]) == list(shown["bit_depth"]) == [1000.0]
    monitor.on_depth_by_hand(1020.0, age=30.0)
    assert list(monitor.in_force(rig([1000.0]))[1]["bit_depth"]) == [1020.0]


def test_the_depth_of_the_rig_is_known_while_a_depth_by_hand_shuts_it_out(monitor):
    monitor.on_depth_by_hand(1020.0)
    assert monitor.depth_of_rig() == 1000.0
    monitor.on_rig_input("rig_floor", rig([1001.0]))
    assert monitor.depth_of_rig() == 1001.0
    # Another source than the one in force, and one that has been silent, do not count.
    monitor.on_rig_input("rig_wits", rig([900.0]))
    assert monitor.depth_of_rig() == 1001.0
    monitor._clock.now_ns += 10 * 10**9
    assert monitor.depth_of_rig() is None


def test_block_and_slips_carry_a_depth_by_hand_on(monitor):
    monitor.on_depth_by_hand(1020.0)
    paired, shown = monitor.in_force(rig([1000.0, 1000.5], BIT | BLOCK | SLIPS, [9.0, 8.5]))
    assert list(paired["bit_depth"]) == list(shown["bit_depth"]) == [1020.0, 1020.5]
    assert np.all(paired["valid"] & BIT)


def test_without_a_hand_the_rig_has_its_own_depth(monitor):
    samples = rig([1000.0], BIT | BLOCK | SLIPS)
    assert [one is samples for one in monitor.in_force(samples)] == [True, True]

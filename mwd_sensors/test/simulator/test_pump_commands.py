# SPDX-License-Identifier: Apache-2.0
"""Pumps that obey: they ramp to what is asked, return by themselves, and stay off where the schedule has them off."""

import numpy as np
import pytest

from mwd_sensors.simulator.schedule import ProfileBuilder
from mwd_sensors.simulator.sonde import CommandedFlow

FULL = 0.03


def pumps():
    lane = ProfileBuilder(FULL)
    lane.hold(100.0)
    lane.to_value(0.0, 10.0)
    lane.hold(50.0)
    return CommandedFlow(lane.build(), FULL, 10.0)


def at(flow, *times):
    return flow(np.array(times))[0]


def test_without_commands_the_flow_is_the_schedule_s():
    assert at(pumps(), 0.0, 50.0, 105.0, 130.0) == pytest.approx([FULL, FULL, 0.5 * FULL, 0.0])


def test_a_command_is_reached_on_the_ramp_and_given_back_when_it_is_not_renewed():
    flow = pumps()
    flow.ask(20.0, 0.8 * FULL, 5.0)
    assert at(flow, 20.0, 21.0, 22.0, 25.0, 26.0, 27.0, 40.0) / FULL == pytest.approx(
        [1.0, 0.9, 0.8, 0.8, 0.9, 1.0, 1.0]
    )
    assert at(flow, 130.0)[0] == 0.0


def test_a_renewed_command_goes_on_from_where_the_flow_is():
    flow = pumps()
    for k in range(50):
        flow.ask(20.0 + 0.2 * k, 0.8 * FULL, 1.0)
    time = np.arange(19.0, 40.0, 0.05)
    share = flow(time)[0] / FULL
    assert np.abs(np.diff(share)).max() <= 0.05 / 10.0 + 1e-9
    assert at(flow, 25.0, 29.8)[0] / FULL == pytest.approx(0.8)
    flow.release(26.0)
    assert at(flow, 27.0, 28.0) / FULL == pytest.approx([0.9, 1.0])


def test_more_than_the_drilling_flow_is_refused():
    with pytest.raises(ValueError, match="at most"):
        pumps().ask(1.0, 1.1 * FULL, 1.0)

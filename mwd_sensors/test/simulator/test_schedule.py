# SPDX-License-Identifier: Apache-2.0
"""Schedule: depths, hook, pumps and slips are consistent; still means still."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mwd_sensors.simulator.schedule import ROTATING, SLIDING, STILL, TRIPPING, Rig, SchedulePhase, timeline
from mwd_sensors.simulator.vibration import ENVELOPES

RIG = Rig(ramp_s=2.0, pump_ramp_s=1.0, pick_up_m=0.5, stand_m=9.0)
PHASES = (
    SchedulePhase("still", 5.0, pumps=False),
    SchedulePhase("drill", 20.0, rpm=120.0, rop_m_h=1620.0),
    SchedulePhase("connection", 15.0),
    SchedulePhase("slide", 20.0, rop_m_h=900.0, toolface_deg=-30.0),
    SchedulePhase("still", 6.0, pumps=False),
)


def laid(phases=PHASES, rig=RIG, whirl=()):
    return timeline(phases, rig, 100.0, whirl, np.random.default_rng(1), math.radians(10.0))


def test_the_still_intervals_are_still_and_at_least_as_long_as_asked():
    line = laid()
    assert len(line.still) == 3
    for (start, end), at_least in zip(line.still, (5.0, 15.0, 6.0), strict=True):
        assert end - start >= at_least
        t = np.linspace(start + 1e-6, end - 1e-6, 500)
        for profile in (line.bit, line.angle):
            assert np.ptp(profile(t)[0]) == 0.0
            assert np.abs(profile(t)[1:]).max() == 0.0
        drilling = line.envelopes[3](t)
        assert np.abs(drilling).max() == 0.0


def test_all_depths_are_consistent():
    line = laid()
    t = np.arange(0.0, line.seconds, 0.01)
    bit, hole, block = line.bit(t)[0], line.hole(t)[0], line.block(t)[0]
    assert np.all(np.diff(hole) >= 0.0)
    assert np.all(bit <= hole + 0.05)
    assert bit[0] == 100.0
    # 20 s of which half of the ramp each way are lost or gained.
    assert bit[-1] == pytest.approx(100.0 + 0.45 * 20.0 + 0.25 * 20.0, abs=0.1)
    # The block falls as the string goes down and rises a stand in the slips.
    in_slips = line.slips(t)[0] > 0.5
    assert np.ptp(bit[in_slips]) == 0.0
    assert block[in_slips][-1] - block[in_slips][0] == pytest.approx(9.0)
    outside = ~in_slips[:-1] & ~in_slips[1:]
    assert np.abs((np.diff(bit) + np.diff(block))[outside]).max() < 0.02


def test_the_hook_and_the_pumps_follow():
    line = laid()
    t = np.arange(0.0, line.seconds, 0.01)
    slips, hook, flow = line.slips(t)[0] > 0.5, line.hookload(t)[0], line.flow(t)[0]
    assert hook[slips][-1] == pytest.approx(60e3)
    assert hook.max() == pytest.approx(450e3)
    assert flow[slips].max() == 0.0
    assert flow.max() == pytest.approx(1.2 / 60.0)
    assert line.weight(t)[0].max() == pytest.approx(60e3)


def test_rotation_reaches_its_speed_and_a_slide_its_toolface():
    line = laid()
    drilling = line.angle(np.linspace(8.0, 24.0, 100))
    assert np.degrees(drilling[1]) / 6.0 == pytest.approx(120.0)
    start = line.seconds - 10.0
    toolface = np.degrees(line.angle(np.array([start]))[0]) % 360.0
    assert toolface == pytest.approx(330.0)


def test_activities_are_named():
    line = laid()
    activity = np.round(line.activity(np.arange(0.0, line.seconds, 0.01))[0]).astype(int)
    order = activity[np.flatnonzero(np.diff(activity, prepend=-1))]
    assert list(order) == [STILL, ROTATING, TRIPPING, STILL, TRIPPING, SLIDING, STILL]


def test_a_running_start_is_at_speed_at_once():
    line = laid((SchedulePhase("drill", 10.0, rpm=155.0, rop_m_h=0.0),), Rig(running_start=True))
    t = np.array([0.0, 5.0])
    assert np.degrees(line.angle(t)[1]) / 6.0 == pytest.approx([155.0, 155.0])
    assert line.envelopes[3](t)[0] == pytest.approx([1.0, 1.0])
    assert line.active("drilling") == [(0.0, 10.0)]
    assert line.still == []


def test_a_move_shakes_by_its_own_envelope_and_is_no_slide():
    line = laid(
        (
            SchedulePhase("still", 5.0),
            SchedulePhase("move", 20.0, rop_m_h=3600.0, vibration=0.6),
            SchedulePhase("still", 5.0),
        )
    )
    moving = line.envelopes[ENVELOPES.index("moving")](np.arange(0.0, line.seconds, 0.1))[0]
    assert (moving[0], moving.max(), moving[-1]) == pytest.approx((0.0, 0.6, 0.0))
    assert line.active("moving") == [(8.0, 24.0)]
    assert line.active("sliding") == []


def test_whirl_comes_in_bursts_while_rotating_only():
    line = laid(
        (SchedulePhase("drill", 60.0, rpm=120.0), SchedulePhase("still", 20.0)), RIG, (((2.0, 4.0), (1.0, 2.0)),)
    )
    t = np.arange(0.0, line.seconds, 0.01)
    burst = line.envelopes[-1](t)[0]
    assert burst.max() == 1.0
    assert burst[t > 60.0].max() == 0.0
    assert 0.3 < np.mean(burst[t < 60.0]) < 0.8


def test_phases_repeat_and_too_short_ones_are_refused():
    twice = laid((SchedulePhase("drill", 10.0, repeat=2),))
    assert twice.seconds == 20.0
    with pytest.raises(ValueError, match="shorter than the rig's ramp"):
        laid((SchedulePhase("drill", 1.0),))

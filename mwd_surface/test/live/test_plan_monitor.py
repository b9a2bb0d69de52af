# SPDX-License-Identifier: Apache-2.0
"""The plan of the settings: a straight design that is possible is used; any other is an alarm, never an error."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.angle_convention import CONVENTIONS
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.settings import PlanSettings
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan

NUMBER = st.integers(-180, 180).map(float) | st.floats(-180.0, 180.0)


@given(st.none() | st.floats(0.0, 360.0), st.none() | NUMBER, st.floats(1.0, 5000.0), st.sampled_from(CONVENTIONS))
def test_every_design_that_the_settings_can_describe_is_a_plan_or_a_reason(azimuth, angle, length, convention):
    well = Well(convention=convention)
    settings = PlanSettings(opening_azimuth_deg=azimuth, opening_angle_deg=angle, length_m=length)
    found = PlanMonitor.read(settings, well)
    if azimuth is None and angle is None:
        assert found is None
    elif azimuth is None or angle is None:
        missing = "azimuth" if azimuth is None else "angle"
        assert isinstance(found, ListFileError)
        assert f"needs plan.opening_{missing}_deg" in str(found)
    elif (0.0 <= angle <= 180.0) if convention == "inclination" else abs(angle) <= 90.0:
        assert isinstance(found, Plan)
        assert math.degrees(well.angles.shown(float(found.inclination[0]))) == pytest.approx(angle, abs=1e-9)
    else:
        assert isinstance(found, ListFileError)
        assert "plan.opening_angle_deg" in str(found)
        assert convention in str(found)


def test_a_wrong_angle_is_an_alarm_until_it_is_corrected_and_the_later_settings_apply():
    clock = WellClock(10**18)
    log = AlarmLog(lambda: clock.now_ns)
    monitor = PlanMonitor(WellContext(clock, LiveState(), log))
    well = Well(convention="inclination")
    for angle, possible in ((92.0, True), (-2.0, False), (95.0, True)):
        settings = PlanSettings(opening_azimuth_deg=40.0, opening_angle_deg=angle)
        monitor.use(PlanMonitor.read(settings, well))
        assert (monitor.plan is not None) == possible
        assert [alarm.id for alarm in log.alarms()] == ([] if possible else ["plan.file"])

# SPDX-License-Identifier: Apache-2.0
"""The downlink as a controller of the rig: one lease, on the word of the person who granted the command."""

import pytest

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import ControlJudgement, ControlRequest, Sender
from mwd_surface.downlink.rig_control import RigClock, RigControl


@pytest.fixture
def authority():
    return ControlAuthority(ControlSettings(enabled=True))


def test_a_rig_that_takes_no_set_points_says_how_it_would():
    assert "control.enabled" in RigControl(ControlAuthority(ControlSettings())).why_not(0.0)


def test_the_person_who_grants_the_command_grants_the_control_it_needs(authority):
    rig = RigControl(authority)
    assert rig.why_not(0.0) == ""
    assert rig.take("Bo", 0.0) == ""
    assert rig.ask(True, 9.0, 0.1) == ""
    assert [point.mode for point in authority.update(0.2)][:1] == [Mode.ROTATE]
    assert authority.status(0.2).owner == "downlink"
    assert "Bo" in " ".join(authority.drain_events())
    rig.release(0.3, "sent")
    assert not rig.has
    assert authority.status(0.4).owner == ""
    assert Mode.RELEASE in {point.mode for point in authority.update(0.5)}


def test_a_flow_is_asked_of_the_pumps(authority):
    rig = RigControl(authority)
    rig.take("Bo", 0.0)
    assert rig.ask(False, 0.03, 0.1) == ""
    assert authority.status(0.2).flow_rate == pytest.approx(0.03)
    assert "flow_rate" in rig.ask(False, 1.0, 0.3)


def test_control_that_is_taken_away_is_noticed(authority):
    rig = RigControl(authority)
    rig.take("Bo", 0.0)
    authority.judge(ControlJudgement.ABORT, "Cy", 0.1, "stop")
    assert "taken away" in rig.why_not(0.2)
    assert "not in force" in rig.ask(True, 9.0, 0.2)


def test_a_controller_of_higher_priority_is_waited_for():
    authority = ControlAuthority(ControlSettings(enabled=True, grant="automatic"))
    authority.request(ControlRequest(Sender("test", "driller's panel"), "driller's panel", priority=200), 0.0)
    rig = RigControl(authority)
    assert "driller's panel has control" in rig.why_not(0.1)
    assert "driller's panel" in rig.take("Bo", 0.1)


def test_the_clock_is_that_of_the_rig_and_goes_on_where_it_is_silent():
    clock = RigClock()
    assert clock.silent(0.0)
    assert clock.now(5.0, 77.0) == 77.0
    assert clock.take(1000.0, 5.0) == 1000.0
    assert clock.now(6.0, 0.0) == 1000.0
    assert not clock.silent(6.0)
    assert clock.now(9.0, 0.0) == 1004.0
    assert clock.take(1002.0, 9.1) == 1004.0
    assert clock.take(10.0, 9.2) == 10.0

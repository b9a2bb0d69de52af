# SPDX-License-Identifier: Apache-2.0
"""The control authority: one owner at a time, limits, and a declared end for every dead controller or MWD."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from mwd_sensors.core.unknown import or_none
from mwd_surface.control.authority import RIG_TIMEOUT, ControlAuthority
from mwd_surface.control.set_point import LeaseLimits, Mode, SetPoint, ramped
from mwd_surface.control.settings import REACTIONS, ControlSettings
from mwd_surface.control.status import (
    Achieved,
    ControlJudgement,
    ControlRequest,
    ControlState,
    Permission,
    Reaction,
    Sender,
)

AUTOMATIC = ControlSettings(enabled=True, grant="automatic")
BY_A_PERSON = ControlSettings(enabled=True, grant="operator")


def asks(name, interface="graph", **request):
    """A request of a controller, which is known by its name."""
    return ControlRequest(Sender(interface, name), name, **request)


def command(authority, point, now, name="controller", interface="graph"):
    """A controller sends a set-point."""
    return authority.command(point, now, Sender(interface, name))


def release(authority, lease, now, name="controller"):
    """A controller gives its lease back."""
    return authority.release(lease, now, Sender("graph", name))


def owned(settings=AUTOMATIC, **request):
    """An authority whose lease `controller` has since time 0, and its number."""
    authority = ControlAuthority(settings)
    decision = authority.request(asks("controller", **request), 0.0)
    if decision.permission == Permission.PENDING:
        authority.judge(ControlJudgement.GRANT, "toolpusher", 0.0, number=decision.lease)
    return authority, decision.lease


def passes(authority, begin, end, step=0.1):
    """Commands to the rig between two times, each with its time."""
    count = round((end - begin) / step)
    return [(begin + k * step, point) for k in range(1, count + 1) for point in authority.update(begin + k * step)]


# Requests.


@pytest.mark.parametrize("other", [{"interface": "OPC UA"}, {"name": "another"}])
def test_nobody_but_the_sender_of_its_request_uses_a_lease_or_the_name(other):
    authority, lease = owned()
    turn = SetPoint(Mode.ROTATE, lease, 1, rotary_speed=5.0)
    for point in (turn, SetPoint(Mode.HOLD, lease, 0), SetPoint(Mode.RELEASE, lease, 9)):
        taken, why = command(authority, point, 0.1, **other)
        assert not taken
        assert "belongs to controller" in why
    thief = Sender(other.get("interface", "graph"), other.get("name", "controller"))
    assert not authority.release(lease, 0.1, thief)[0]
    for priority in (0, 255):
        posing = authority.request(ControlRequest(thief, "controller", priority=priority), 0.2)
        assert (posing.permission, posing.lease) == (Permission.DENIED, 0)
        assert "the name of another controller" in posing.message
    # Who poses does not keep the lease alive either.
    assert authority.status(0.3).heartbeat_age == pytest.approx(0.3)
    assert authority.status(0.3).refusal == ""
    assert command(authority, turn, 0.4) == (True, "")


def test_an_owner_asks_under_no_second_name():
    authority, lease = owned()
    decision = authority.request(ControlRequest(Sender("graph", "controller"), "stronger", priority=9), 0.1)
    assert (decision.permission, authority.status(0.1).lease) == (Permission.DENIED, lease)


def test_a_request_that_waits_is_withdrawn_by_its_sender_alone():
    authority = ControlAuthority(BY_A_PERSON)
    waits = authority.request(asks("controller"), 0.0).lease
    assert not release(authority, waits, 0.1, "another")[0]
    assert (
        authority.request(ControlRequest(Sender("graph", "another"), "controller"), 0.2).permission == Permission.DENIED
    )
    assert release(authority, waits, 0.3) == (True, "withdrawn")


MORE = (
    {"priority": 2},
    {"duration": 21.0},
    {"duration": 0.0},
    {"limits": LeaseLimits(speed=1.1, turn=0.5)},
    {"limits": LeaseLimits(speed=1.0)},
    {"limits": LeaseLimits(speed=1.0, turn=0.5, left_speed=0.1)},
)


@pytest.mark.parametrize("settings", [AUTOMATIC, BY_A_PERSON])
@pytest.mark.parametrize("more", MORE)
def test_a_renewal_prolongs_what_was_granted_and_gives_nothing_more(settings, more):
    settings = dataclasses.replace(settings, left_speed_rpm=60.0)
    granted = {"priority": 1, "duration": 20.0, "limits": LeaseLimits(speed=1.0, turn=0.5)}
    authority, lease = owned(settings, **granted)
    before = authority.status(1.0)
    decision = authority.request(asks("controller", **(granted | more)), 1.0)
    assert (decision.permission, decision.lease) == (Permission.DENIED, 0)
    assert "more than the lease grants" in decision.message
    assert authority.status(1.0) == before
    assert not command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.1), 1.0)[0]
    renewed = authority.request(asks("controller", **granted), 1.0)
    assert (renewed.permission, renewed.lease) == (Permission.GRANTED, lease)
    after = authority.status(1.0)
    assert (after.limits, after.priority, after.remaining) == (before.limits, 1, 20.0)


def test_a_lease_ends_after_its_time_which_a_renewal_prolongs_but_never_shortens_and_never_revives():
    authority, lease = owned(duration=1.0)
    assert authority.request(asks("controller", duration=0.5), 0.1).permission == Permission.GRANTED
    assert authority.status(0.1).remaining == pytest.approx(0.9)
    assert authority.request(asks("controller", duration=1.0), 0.9).lease == lease
    authority.update(1.8)
    assert authority.status(1.8).lease == lease
    # Nothing has let the time pass meanwhile; the lease is over all the same.
    again = authority.request(asks("controller", duration=1.0), 2.0)
    assert again.lease > lease
    assert not command(authority, SetPoint(Mode.HOLD, lease, 1), 2.1)[0]
    authority.update(3.0)
    assert authority.status(3.0).state == ControlState.IDLE
    assert "is over" in authority.status(3.0).reason


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
def test_a_clock_that_jumps_ends_a_lease_before_anything_is_obeyed(step):
    authority, lease = owned()
    authority.request(asks("controller"), 0.5)
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=5.0), 1.0)
    taken, why = command(authority, SetPoint(Mode.ROTATE, lease, 2, rotary_speed=5.0), 1.0 + step)
    assert (taken, why) == (False, f"lease {lease} is not in force: nobody has control")
    assert [point.mode for point in authority.update(1.1 + step)] == [Mode.RELEASE]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (asks(""), "controller: must not be empty"),
        (asks("a\nb"), "controller: has more than one line"),
        (asks("x" * 101), "controller: at most 100"),
        (asks("x", priority=256), "priority: must be within"),
        (asks("x", duration=math.nan), "duration: must be finite"),
        (asks("x", limits=LeaseLimits(speed=-1.0)), "speed_limit: must be finite"),
        (asks("where control is switched off"), "control.enabled"),
    ],
)
def test_a_request_that_cannot_be_is_denied_by_name(request_, words):
    settings = ControlSettings() if words == "control.enabled" else AUTOMATIC
    decision = ControlAuthority(settings).request(request_, 0.0)
    assert (decision.permission, decision.lease) == (Permission.DENIED, 0)
    assert words in decision.message


def test_a_request_waits_for_a_person_and_lapses():
    authority = ControlAuthority(BY_A_PERSON)
    decision = authority.request(asks("controller"), 0.0)
    assert (decision.permission, decision.message) == (Permission.PENDING, "waits for a person to grant it")
    assert authority.request(asks("controller"), 1.0) == decision
    assert authority.judge(ControlJudgement.GRANT, "  ", 2.0, number=decision.lease)[0] is False
    authority.update(BY_A_PERSON.pending_s + 0.1)
    assert authority.status(121.0).state == ControlState.IDLE
    assert authority.judge(ControlJudgement.GRANT, "toolpusher", 122.0, number=1) == (False, "no request waits")


def test_nobody_grants_a_request_that_came_in_the_place_of_the_one_that_was_seen():
    authority = ControlAuthority(BY_A_PERSON)
    seen = authority.request(asks("holds the toolface", priority=1), 0.0).lease
    other = authority.request(asks("rotates", priority=2), 0.1).lease
    missing = "number: must be the number of the waiting request"
    for number, words in ((seen, f"request {seen} is no longer waiting"), (0, missing)):
        done, why = authority.judge(ControlJudgement.GRANT, "toolpusher", 0.2, number=number)
        assert (done, why) == (False, f"{words}; request {other} of rotates waits")
    assert not authority.judge(ControlJudgement.DENY, "toolpusher", 0.2, number=seen)[0]
    assert authority.status(0.3).pending == other
    assert authority.judge(ControlJudgement.GRANT, "toolpusher", 0.3, number=other) == (True, "rotates has control")


def test_a_person_grants_denies_and_takes_back_and_the_log_has_the_name():
    authority, lease = owned(BY_A_PERSON)
    assert authority.status(0.0).owner == "controller"
    assert authority.judge(ControlJudgement.ABORT, "driller", 1.0, "pick up")[0]
    assert authority.status(1.0).state == ControlState.IDLE
    assert not command(authority, SetPoint(Mode.HOLD, lease, 1), 1.0)[0]
    authority.request(asks("other"), 2.0)
    assert authority.judge(ControlJudgement.DENY, "driller", 3.0)[0]
    log = " | ".join(authority.drain_events())
    assert "granted by toolpusher" in log
    assert "driller took control back: pick up" in log
    assert "driller denied control to other" in log


def test_the_same_or_a_lower_priority_is_denied_and_a_higher_one_takes_over():
    authority, first = owned(priority=10)
    denied = authority.request(asks("equal", priority=10), 1.0)
    assert (denied.permission, denied.lease) == (Permission.DENIED, 0)
    assert "controller has control" in denied.message
    higher = authority.request(asks("higher", priority=11), 1.0)
    assert higher.permission == Permission.GRANTED
    assert higher.lease > first
    taken, why = command(authority, SetPoint(Mode.HOLD, first, 1), 1.1)
    assert (taken, why) == (False, f"lease {first} is not in force: higher has control")


def test_a_request_that_waits_gets_the_lease_when_the_owner_leaves():
    authority, first = owned()
    waits = authority.request(asks("second", wait=True), 1.0)
    assert waits.permission == Permission.PENDING
    assert release(authority, first, 1.5)[0]
    authority.update(1.6)
    assert (authority.status(1.6).owner, authority.status(1.6).lease) == ("second", waits.lease)


# Set-points.


@pytest.mark.parametrize(
    "point",
    [
        SetPoint(Mode.ROTATE, 1, 1, rotary_speed=20.0),
        SetPoint(Mode.ROTATE, 1, 1, rotary_speed=math.inf),
        SetPoint(Mode.ORIENT, 1, 1, turn=-20.0),
        SetPoint(Mode.PUMP, 1, 1, flow_rate=-0.01),
        SetPoint(Mode.PUMP, 1, 1, flow_rate=0.1),
        SetPoint(9, 1, 1),
        SetPoint(Mode.HOLD, 1, 1, valid_for=0.0),
    ],
)
def test_a_set_point_beyond_the_limits_changes_nothing(point):
    authority, _ = owned()
    command(authority, SetPoint(Mode.ORIENT, 1, 4, turn=1.0), 0.0)
    before = authority.status(0.0)
    assert command(authority, point, 0.0)[0] is False
    after = authority.status(0.0)
    assert after.refusal
    assert dataclasses.replace(after, refusal="") == before


def test_the_rig_hears_a_turn_once_while_heartbeats_keep_it_valid():
    authority, lease = owned()
    command(authority, SetPoint(Mode.ORIENT, lease, 1, turn=0.5, valid_for=1.0), 0.0)
    heard = []
    for k in range(1, 101):
        command(authority, SetPoint(Mode.HOLD, lease, 0), k * 0.1)
        heard += authority.update(k * 0.1)
    assert len(heard) > 4
    assert {(point.mode, point.sequence) for point in heard} == {(Mode.ORIENT, heard[0].sequence)}
    command(authority, SetPoint(Mode.ORIENT, lease, 2, turn=0.5), 10.0)
    assert authority.update(10.1)[0].sequence > heard[-1].sequence


@pytest.mark.parametrize("sequence", [1, 4, 5])
@pytest.mark.parametrize("mode", [Mode.ORIENT, Mode.ROTATE, Mode.PUMP, Mode.HOLD])
def test_a_repeated_or_older_number_is_refused_and_never_sent_to_the_rig(mode, sequence):
    authority, lease = owned()
    point = SetPoint(mode, lease, 5, valid_for=1.5)
    command(authority, point, 0.0)
    passes(authority, 0.0, 1.0)
    before = authority.status(1.0)
    taken, why = command(authority, dataclasses.replace(point, sequence=sequence), 1.0)
    assert not taken
    assert "is not above 5" in why
    # It does not keep anything valid either.
    assert dataclasses.replace(authority.status(1.0), refusal="") == before
    sent = passes(authority, 1.0, 1.8)
    assert all(point.mode in (mode, Mode.HOLD, Mode.RELEASE) for _, point in sent)
    assert not any(at > 1.5 and point.mode == mode != Mode.HOLD for at, point in sent)


def test_numbers_that_no_message_can_have_are_refused_and_after_the_largest_a_lease_is_given_back():
    authority, lease = owned()
    for sequence in (-1, 2**32, 2**64):
        assert not command(authority, SetPoint(Mode.HOLD, lease, sequence), 0.1)[0]
    assert command(authority, SetPoint(Mode.HOLD, lease, 2**32 - 1), 0.1)[0]
    assert not command(authority, SetPoint(Mode.HOLD, lease, 1), 0.2)[0]
    assert release(authority, lease, 0.3)[0]


@pytest.mark.parametrize("mode", [Mode.ROTATE, Mode.ORIENT])
def test_nobody_turns_left_who_has_not_asked_for_it_by_number(mode):
    left = SetPoint(mode, 1, 1, rotary_speed=-1.0 if mode == Mode.ROTATE else 0.0, turn=-1.0)
    if mode == Mode.ROTATE:
        left = dataclasses.replace(left, turn=0.0)
    wish = LeaseLimits(left_speed=1.0, left_turn=1.0)
    rig_allows = dataclasses.replace(AUTOMATIC, left_speed_rpm=60.0, left_turn_deg=90.0)
    for rig, limits, may in (
        (AUTOMATIC, LeaseLimits(), False),
        (AUTOMATIC, wish, False),
        (rig_allows, LeaseLimits(), False),
        (rig_allows, wish, True),
    ):
        authority, _ = owned(rig, limits=limits)
        assert command(authority, left, 0.0)[0] == may
        sent = passes(authority, 0.0, 1.0)
        assert any(min(point.rotary_speed, point.turn) < 0.0 for _, point in sent) == may


@pytest.mark.parametrize(
    ("driller", "first"),
    [
        (6.0, 5.9),
        # A string that turns left is not taken over on a ramp to the left.
        (-6.0, 0.1),
    ],
)
def test_the_ramp_begins_at_the_speed_the_driller_had_and_never_on_the_left(driller, first):
    authority, lease = owned(limits=LeaseLimits(speed_rate=1.0))
    authority.on_rig(Achieved(speed=driller), 0.0)
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=4.0), 0.0)
    sent = [point.rotary_speed for _, point in passes(authority, 0.0, 1.0)]
    assert sent[0] == pytest.approx(first)
    assert min(sent) >= 0.0
    assert authority.status(0.1).achieved.speed == driller


def test_a_speed_is_reached_on_its_ramp_and_acknowledged():
    authority, lease = owned(limits=LeaseLimits(speed_rate=1.0))
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0), 0.0)
    sent = passes(authority, 0.0, 1.5)
    speeds = [point.rotary_speed for _, point in sent]
    assert max(abs(b - a) for a, b in itertools.pairwise([0.0, *speeds])) < 0.1 + 1e-9
    assert speeds[-1] == 1.0
    assert authority.status(1.5).acknowledged == 0
    authority.on_acknowledge(lease, sent[-1][1].sequence, True, "")
    assert authority.status(1.5).acknowledged == 1
    command(authority, SetPoint(Mode.ORIENT, lease, 2, turn=1.0), 1.5)
    authority.on_acknowledge(lease, authority.update(1.6)[0].sequence, False, "in slips")
    assert authority.status(1.6).refusal == "the rig refuses: in slips"
    assert authority.status(1.6).acknowledged == 1


@pytest.mark.parametrize("stall", [0.3, 1.0, 10.0, 1e9])
def test_a_surface_that_stood_still_goes_on_with_the_ramp_and_does_not_jump(stall):
    authority, lease = owned(AUTOMATIC, limits=LeaseLimits(speed_rate=1.0))
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=9.0, valid_for=2e9), 0.0)
    before = passes(authority, 0.0, 2.0)[-1][1].rotary_speed
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=9.0, valid_for=2e9), 2.0 + stall)
    for point in authority.update(2.0 + stall):
        assert point.rotary_speed <= before + 0.2 + 1e-9


def test_a_set_point_lapses_and_the_lease_stays():
    authority, lease = owned()
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0, valid_for=0.5), 0.0)
    command(authority, SetPoint(Mode.PUMP, lease, 2, flow_rate=0.02, valid_for=0.5), 0.0)
    passes(authority, 0.0, 0.6)
    status = authority.status(0.6)
    assert (status.mode, or_none(status.flow_rate), status.state) == (Mode.HOLD, None, ControlState.GRANTED)


def test_a_new_owner_takes_over_what_it_could_have_asked_for_and_no_more():
    for limit, mode in ((5.0, Mode.ROTATE), (1.0, Mode.RELEASE)):
        authority, lease = owned()
        command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=3.0), 0.0)
        authority.request(asks("higher", priority=1, limits=LeaseLimits(speed=limit)), 0.1)
        assert authority.status(0.1).mode == mode


def test_a_ramp_that_is_still_beyond_the_limits_of_a_new_owner_is_not_passed_on():
    authority, lease = owned()
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=10.0), 0.0)
    for k in range(1, 100):
        command(authority, SetPoint(Mode.HOLD, lease, 0), k * 0.1)
        authority.update(k * 0.1)
    command(authority, SetPoint(Mode.ROTATE, lease, 2, rotary_speed=1.0), 9.9)
    authority.request(asks("higher", priority=1, limits=LeaseLimits(speed=5.0)), 10.0)
    assert [point.mode for _, point in passes(authority, 10.0, 11.0)] == [Mode.RELEASE]


def test_a_lease_that_is_renewed_in_a_turn_makes_the_turn_once():
    authority, lease = owned()
    command(authority, SetPoint(Mode.ORIENT, lease, 1, turn=0.5), 0.0)
    first = authority.update(0.1)[0].sequence
    authority.request(asks("controller"), 0.2)
    assert {point.sequence for _, point in passes(authority, 0.3, 2.0)} == {first}


# Faults.


def moving(how, settings):
    """An authority whose owner slides or rotates, its lease and the mode of the set-point."""
    authority, lease = owned(settings)
    mode, values = (Mode.ROTATE, {"rotary_speed": 2.0}) if how == "rotating" else (Mode.ORIENT, {"turn": 1.0})
    command(authority, SetPoint(mode, lease, 1, valid_for=60.0, **values), 0.0)
    return authority, lease, mode


@pytest.mark.parametrize("reaction", REACTIONS)
@pytest.mark.parametrize("how", ["sliding", "rotating"])
def test_a_dead_controller_ends_in_the_declared_reaction(how, reaction):
    settings = dataclasses.replace(AUTOMATIC, **{f"controller_lost_{how}": reaction})
    authority, _, mode = moving(how, settings)
    end = settings.heartbeat_s + 3.0
    at, point = passes(authority, 0.0, end)[-1]
    status = authority.status(end)
    assert status.lease == 0
    assert "controller is silent" in status.reason
    assert point.mode == {"release": Mode.RELEASE, "hold": Mode.HOLD, "keep": mode}[reaction]
    if reaction == "release":
        assert status.state == ControlState.IDLE
    else:
        assert at > end - RIG_TIMEOUT
        assert status.state == ControlState.FAULT
        assert authority.judge(ControlJudgement.ABORT, "driller", 6.0)[0]
        assert authority.update(6.1)[0].mode == Mode.RELEASE
        assert authority.status(6.1).state == ControlState.IDLE


@pytest.mark.parametrize(
    "refused",
    [
        SetPoint(Mode.ROTATE, 1, 2, rotary_speed=math.nan),
        SetPoint(Mode.ROTATE, 1, 2, rotary_speed=1e9),
        SetPoint(Mode.ROTATE, 1, 1),
        SetPoint(9, 1, 2),
    ],
)
def test_a_refused_set_point_is_no_heartbeat(refused):
    authority, lease = owned()
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0, valid_for=60.0), 0.0)
    for k in range(1, 30):
        assert not command(authority, refused, k * 0.1)[0]
        authority.update(k * 0.1)
    assert "controller is silent" in authority.status(3.0).reason


@pytest.mark.parametrize("operator", ["driller", ""])
@pytest.mark.parametrize("state", ["idle", "pending", "granted", "commanded", "held", "kept", "with one that waits"])
def test_abort_gives_the_rig_to_the_driller_in_every_state_and_nobody_follows_by_itself(state, operator):
    settings = dataclasses.replace(AUTOMATIC, controller_lost_rotating="keep" if state == "kept" else "hold")
    settings = dataclasses.replace(settings, grant="operator" if state == "pending" else "automatic")
    authority = ControlAuthority(settings)
    if state != "idle":
        lease = authority.request(asks("controller"), 0.0).lease
    if state in ("commanded", "held", "kept"):
        command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0), 0.0)
    if state == "with one that waits":
        authority.request(asks("second", wait=True), 0.0)
    now = 3.0 if state in ("held", "kept") else 0.1
    authority.update(now)
    assert authority.judge(ControlJudgement.ABORT, operator, now)[0]
    sent = passes(authority, now, now + 2.0)
    assert {point.mode for _, point in sent} <= {Mode.RELEASE}
    status = authority.status(now + 2.0)
    assert (status.state, status.mode, status.owner, status.pending) == (ControlState.IDLE, Mode.RELEASE, "", 0)


@pytest.mark.parametrize("reaction", REACTIONS)
@pytest.mark.parametrize("how", ["sliding", "rotating"])
def test_a_dead_mwd_ends_in_the_declared_reaction_and_the_owner_stays(how, reaction):
    authority, lease, mode = moving(how, dataclasses.replace(AUTOMATIC, **{f"mwd_lost_{how}": reaction}))
    authority.on_mwd(alive=False)
    status = authority.status(0.1)
    expected = {"keep": mode, "hold": Mode.HOLD, "release": Mode.RELEASE}[reaction]
    assert (status.mode, status.owner) == (expected, "controller")
    assert status.state == (ControlState.GRANTED if reaction == "keep" else ControlState.FAULT)
    assert command(authority, SetPoint(mode, lease, 2), 0.2)[0] == (reaction == "keep")
    assert command(authority, SetPoint(Mode.HOLD, lease, 3), 0.2)[0]
    authority.on_mwd(alive=True)
    assert authority.status(0.3).state == ControlState.GRANTED
    assert command(authority, SetPoint(mode, lease, 4), 0.3)[0]


def test_a_torque_that_lasts_above_its_limit_ends_control_with_the_string_held():
    authority, lease = owned(limits=LeaseLimits(torque=5000.0))
    command(authority, SetPoint(Mode.ROTATE, lease, 1, rotary_speed=2.0, valid_for=60.0), 0.0)
    authority.on_rig(Achieved(2.0, 6000.0), 0.0)
    authority.on_rig(Achieved(2.0, 4000.0), 0.5)
    authority.on_rig(Achieved(2.0, -6000.0), 0.6)
    authority.update(1.5)
    assert authority.status(1.5).owner == "controller"
    authority.update(1.7)
    assert authority.status(1.7).mode == Mode.HOLD
    assert "torque above 5000 N m" in authority.status(1.7).reason


@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(0.01, 10), st.floats(0, 5))
def test_a_ramp_never_leaves_its_rate_and_never_passes_its_end(speed, wanted, rate, elapsed):
    after = ramped(speed, wanted, rate, elapsed)
    assert abs(after - speed) <= rate * elapsed + 1e-9 or after == wanted
    assert min(speed, wanted) - 1e-9 <= after <= max(speed, wanted) + 1e-9


NAMES = ("a", "b", "c")
RIG = ControlSettings(enabled=True, left_speed_rpm=30.0, left_turn_deg=90.0, longest_s=30.0, pending_s=20.0)
SITE = LeaseLimits.of_settings(RIG)
ANY_NUMBER = st.one_of(
    st.sampled_from([0.0, 0.01, 0.4]),
    st.sampled_from([0.9, 3.0, 10.0]),
    st.floats(-20.0, 20.0),
    st.floats(-0.05, 0.05),
    st.sampled_from([0.0, math.nan, math.inf, -math.inf, 1e300]),
)
ANY_LIMITS = st.builds(
    LeaseLimits,
    speed=st.sampled_from([0.0, 1.0, 5.0]),
    turn=st.sampled_from([0.0, 2.0]),
    flow=st.sampled_from([0.0, 0.02]),
    left_speed=st.sampled_from([0.0, 0.5, 100.0]),
    left_turn=st.sampled_from([0.0, 1.0]),
)
# Step of the number, mode, speed, turn and flow, time, and whether only what the mode needs is set.
ANY_POINT = st.tuples(
    st.sampled_from([1, 1, 1, 0, -1, -2, 2**32]),
    st.sampled_from([Mode.ROTATE, Mode.ROTATE, *Mode, 9]),
    st.tuples(ANY_NUMBER, ANY_NUMBER, ANY_NUMBER),
    st.sampled_from([5.0, 5.0, 0.5, 0.0, -1.0, math.nan, 1e300]),
    st.sampled_from([True, True, True, False]),
)
HOW = ("sliding", "rotating")


@dataclasses.dataclass
class Contract:
    """What a controller was granted, as the test keeps it: by whom, until when, how far, and what it sent last."""

    name: str
    limits: LeaseLimits
    priority: int
    duration: float
    ends: float
    heard: float
    last: int = 0


class AnyController(RuleBasedStateMachine):
    """Controllers, persons, the rig, the MWD and the clock do anything, in any order."""

    @initialize(
        grant=st.sampled_from(["automatic", "operator"]),
        reactions=st.tuples(*[st.sampled_from(REACTIONS)] * 4),
        limits=ANY_LIMITS,
    )
    def begin(self, grant, reactions, limits):
        names = [f"{what}_lost_{how}" for what in ("controller", "mwd") for how in HOW]
        self.settings = dataclasses.replace(RIG, grant=grant, **dict(zip(names, reactions, strict=True)))
        self.authority = ControlAuthority(self.settings)
        self.now = 0.0
        self.granted, self.asked, self.newest = {}, {}, 0
        self.speed, self.mwd = None, True
        self.asks("a", 0, wait=False, duration=0.0, limits=limits)
        if grant == "operator":
            self.decides(ControlJudgement.GRANT, 0)

    def status(self):
        return self.authority.status(self.now)

    def lasts(self, wished):
        return min(wished, self.settings.longest_s) if wished > 0.0 else self.settings.longest_s

    def grant(self, number, at):
        name, request = self.asked[number]
        lasts = self.lasts(request.duration)
        self.granted[number] = Contract(name, request.limits.within(SITE), request.priority, lasts, at + lasts, at)

    def in_force(self):
        return self.granted.get(self.status().lease)

    @rule(
        name=st.sampled_from(NAMES),
        priority=st.integers(0, 2),
        wait=st.booleans(),
        duration=st.sampled_from([0.0, 1.0, 10.0, 1e9, math.inf]),
        limits=ANY_LIMITS,
    )
    def asks(self, name, priority, wait, duration, limits):
        self.authority.update(self.now)
        before, contract = self.status(), self.in_force()
        request = asks(name, priority=priority, wait=wait, duration=duration, limits=limits)
        decision = self.authority.request(request, self.now)
        after = self.status()
        if contract is not None and contract.name == name:
            # Prolonged, or nothing.
            assert (after.lease, after.limits, after.priority) == (before.lease, before.limits, before.priority)
            assert after.remaining >= before.remaining
            assert (after.mode, after.turn, or_none(after.flow_rate)) == (
                before.mode,
                before.turn,
                or_none(before.flow_rate),
            )
            if decision.permission == Permission.GRANTED:
                lasts = self.lasts(duration)
                assert (priority <= contract.priority, lasts <= contract.duration) == (True, True)
                contract.ends, contract.heard = max(contract.ends, self.now + lasts), self.now
            return
        if decision.lease and decision.lease not in self.asked:
            assert decision.lease > max(self.asked, default=0)
            self.asked[decision.lease] = name, request
        if decision.permission == Permission.GRANTED:
            assert self.settings.grant == "automatic"
            assert not before.owner or before.priority < priority
            self.grant(decision.lease, self.now)

    @rule(name=st.sampled_from(NAMES), owner=st.sampled_from(NAMES), priority=st.integers(0, 255))
    def asks_under_the_name_of_another(self, name, owner, priority):
        self.authority.update(self.now)
        before = self.status()
        thief = ControlRequest(Sender("graph", f"{name} as {owner}"), owner, priority=priority)
        if owner in (before.owner, before.pending_controller):
            assert self.authority.request(thief, self.now).permission == Permission.DENIED

    @rule(
        name=st.sampled_from(["the owner", "the owner", *NAMES]),
        lease=st.sampled_from(["in force", "in force", "own", "first", "none"]),
        points=st.lists(ANY_POINT, min_size=1, max_size=4),
    )
    def commands(self, name, lease, points):
        for step, mode, values, valid_for, alone in points:
            self.send(name, lease, step, mode, values, valid_for=valid_for, alone=alone)

    def send(self, name, lease, step, mode, values, *, valid_for, alone):
        name = self.status().owner or "a" if name == "the owner" else name
        number = {"own": max((n for n, (who, _) in self.asked.items() if who == name), default=0)}
        number |= {"in force": self.status().lease, "first": min(self.asked, default=0), "none": 0}
        speed, turn, flow = values
        if alone:
            wanted = {Mode.ROTATE: speed, Mode.ORIENT: turn, Mode.PUMP: flow}
            speed, turn, flow = (wanted[m] if m == mode else 0.0 for m in (Mode.ROTATE, Mode.ORIENT, Mode.PUMP))
        contract = self.granted.get(number[lease])
        sequence = (0 if contract is None else contract.last) + step
        point = SetPoint(mode, number[lease], max(sequence, 0), speed, turn, flow, valid_for)
        self.authority.update(self.now)
        before = self.status()
        taken, why = command(self.authority, point, self.now, name)
        assert taken == (not why)
        after = self.status()
        if not taken:
            # Nothing that the rig or the lease depends on has changed.
            assert dataclasses.replace(after, refusal="") == dataclasses.replace(before, refusal="")
            return
        assert (contract.name, number[lease]) == (name, before.lease)
        assert self.now < contract.ends
        contract.heard = self.now
        if point.sequence:
            assert point.sequence > contract.last
            assert all(map(math.isfinite, (speed, turn, flow, valid_for)))
            contract.last = point.sequence

    @rule(name=st.sampled_from(NAMES), lease=st.integers(0, 5))
    def releases(self, name, lease):
        before = self.status()
        done, _ = release(self.authority, lease, self.now, name)
        if done:
            assert name in (before.owner, before.pending_controller)

    @rule(judgement=st.sampled_from([ControlJudgement.GRANT, ControlJudgement.DENY]), number=st.integers(0, 5))
    def decides(self, judgement, number):
        self.authority.update(self.now)
        before = self.status()
        done, _ = self.authority.judge(judgement, "driller", self.now, number=number or before.pending)
        assert not (done and number and judgement == ControlJudgement.GRANT and number != before.pending)
        if done and judgement == ControlJudgement.GRANT:
            self.grant(before.pending, self.now)

    @rule(operator=st.sampled_from(["", "driller"]))
    def aborts(self, operator):
        assert self.authority.judge(ControlJudgement.ABORT, operator, self.now)[0]
        status = self.status()
        assert (status.state, status.owner, status.pending, status.mode) == (ControlState.IDLE, "", 0, Mode.RELEASE)
        assert {point.mode for point in self.authority.update(self.now)} <= {Mode.RELEASE}
        self.speed = None

    @rule(alive=st.booleans())
    def mwd_lives_or_dies(self, alive):
        self.authority.update(self.now)
        before = self.status()
        self.authority.on_mwd(alive)
        if self.mwd and not alive and before.owner and before.mode != Mode.RELEASE:
            reaction = before.reactions[f"mwd_lost_{HOW[before.mode == Mode.ROTATE]}"]
            expected = {Reaction.HOLD: Mode.HOLD, Reaction.RELEASE: Mode.RELEASE}.get(reaction, before.mode)
            assert self.status().mode == expected
        self.mwd = alive

    @rule(speed=st.floats(-10.0, 10.0), torque=st.floats(-40000.0, 40000.0))
    def rig_does(self, speed, torque):
        self.authority.on_rig(Achieved(speed, torque), self.now)

    @rule(jump=st.sampled_from([-1e6, -5.0, 3.0, 25.0, 1e6]))
    def clock_jumps(self, jump):
        contract, before = self.in_force(), self.status()
        self.now += jump
        if jump < -1.0 and contract is not None:
            # How long the owner was silent is not known: it has to ask again.
            self.authority.update(self.now)
            assert self.status().lease != before.lease
        self.speed = None

    @rule(steps=st.integers(1, 30))
    def time_passes(self, steps):
        for _ in range(steps):
            self.now += 0.1
            before, contract = self.status(), self.in_force()
            sent = self.authority.update(self.now)
            after = self.status()
            if after.lease and after.lease not in self.granted:
                self.grant(after.lease, self.now)
            over = contract is not None and self.now > contract.ends + 1e-6
            silent = contract is not None and self.now - contract.heard > self.settings.heartbeat_s + 1e-6
            if over or silent:
                assert after.lease != before.lease
                self.check_end(before, after, silent=silent, sent=sent)
            for point in sent:
                self.check_sent(point)

    def check_end(self, before, after, *, silent, sent):
        if after.owner or "torque" in after.reason:
            return
        how = HOW[before.mode == Mode.ROTATE]
        reaction = before.reactions[f"controller_lost_{how}"] if silent else Reaction.RELEASE
        kept = reaction == Reaction.KEEP and before.mode != Mode.RELEASE
        expected = {Reaction.HOLD: Mode.HOLD, Reaction.RELEASE: Mode.RELEASE}.get(reaction, before.mode)
        assert after.mode in (Mode.RELEASE, expected)
        assert or_none(after.flow_rate) is None
        # No set-point of an ended lease is in force, unless a person has declared that it goes on.
        assert kept or {point.mode for point in sent} <= {Mode.HOLD, Mode.RELEASE}

    def check_sent(self, point):
        assert point.lease >= self.newest
        self.newest = point.lease
        limits = self.granted[point.lease].limits
        slack = 1.0 + 1e-5
        assert -limits.left_speed * slack <= point.rotary_speed <= limits.speed * slack
        assert -limits.left_turn * slack <= point.turn <= limits.turn * slack
        assert 0.0 <= point.flow_rate <= limits.flow * slack
        assert 0.0 < point.valid_for <= RIG_TIMEOUT
        if point.mode == Mode.ROTATE:
            if self.speed is not None:
                allowed = SITE.speed_rate * (self.now - self.speed[0])
                assert abs(point.rotary_speed - self.speed[1]) <= allowed + 1e-6
            self.speed = self.now, point.rotary_speed
        elif point.mode != Mode.PUMP:
            self.speed = None

    @invariant()
    def the_state_is_one_that_can_be(self):
        if not hasattr(self, "authority"):
            return
        status = self.status()
        assert bool(status.owner) == bool(status.lease)
        assert bool(status.pending) == bool(status.pending_controller)
        if status.state == ControlState.IDLE:
            assert (status.mode, or_none(status.flow_rate), status.owner) == (Mode.RELEASE, None, "")
        if status.state == ControlState.GRANTED:
            assert status.owner
        if status.owner and self.settings.grant == "operator":
            assert status.lease in self.granted


TestAnyController = pytest.mark.slow(AnyController.TestCase)
TestAnyController.settings = settings(max_examples=60, stateful_step_count=30)

# SPDX-License-Identifier: Apache-2.0
"""The control authority: one owner at a time, limits, and a declared end for every dead controller or MWD."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.rig_commands import RIG_TIMEOUT
from mwd_surface.control.set_point import LeaseLimits, Mode, SetPoint, ramped
from mwd_surface.control.settings import REACTIONS, ControlSettings
from mwd_surface.control.status import Achieved, ControlState, Judgement, Permission, Reaction, Request

AUTOMATIC = ControlSettings(enabled=True, grant="automatic")
BY_A_PERSON = ControlSettings(enabled=True, grant="operator")


def owned(settings=AUTOMATIC, **request):
    """An authority whose lease `controller` has since time 0, and its number."""
    authority = ControlAuthority(settings)
    decision = authority.request(Request("controller", **request), 0.0)
    if decision.permission == Permission.PENDING:
        authority.judge(Judgement.GRANT, "toolpusher", 0.0, number=decision.lease)
    return authority, decision.lease


def passes(authority, begin, end, step=0.1):
    """Commands to the rig between two times, each with its time."""
    count = round((end - begin) / step)
    return [(begin + k * step, point) for k in range(1, count + 1) for point in authority.update(begin + k * step)]


# Requests.


@pytest.mark.parametrize("face", ["Modbus", "graph"])
def test_a_lease_is_commanded_and_renewed_by_the_interface_it_was_asked_for_alone(face):
    authority = ControlAuthority(AUTOMATIC)
    lease = authority.request(Request("controller", face="OPC UA"), 0.0).lease
    taken, why = authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=5.0), 0.1, face)
    assert (taken, why) == (False, f"lease {lease} is commanded by OPC UA, where it was asked for")
    taken, _ = authority.command(SetPoint(Mode.HOLD, lease, 0), 0.1, face)
    assert not taken
    posing = authority.request(Request("controller", face=face), 0.2)
    assert (posing.permission, posing.lease) == (Permission.DENIED, 0)
    # Who poses does not keep the lease alive either.
    assert authority.status(0.3).heartbeat_age == pytest.approx(0.3)
    assert authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=5.0), 0.4, "OPC UA") == (True, "")
    assert authority.request(Request("controller", face="OPC UA"), 0.5).lease == lease


def test_control_that_is_switched_off_is_denied_with_the_remedy():
    decision = ControlAuthority(ControlSettings()).request(Request("controller"), 0.0)
    assert decision.permission == Permission.DENIED
    assert "control.enabled" in decision.message


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (Request(""), "controller: must not be empty"),
        (Request("a\nb"), "controller: has control characters"),
        (Request("x" * 101), "controller: at most 100"),
        (Request("x", priority=256), "priority: must be within"),
        (Request("x", duration=math.nan), "duration: must be finite"),
        (Request("x", limits=LeaseLimits(speed=-1.0)), "speed_limit: must be finite"),
    ],
)
def test_a_request_that_cannot_be_is_denied_by_name(request_, words):
    decision = ControlAuthority(AUTOMATIC).request(request_, 0.0)
    assert (decision.permission, decision.lease) == (Permission.DENIED, 0)
    assert words in decision.message


def test_a_request_waits_for_a_person_and_lapses():
    authority = ControlAuthority(BY_A_PERSON)
    decision = authority.request(Request("controller"), 0.0)
    assert (decision.permission, decision.message) == (Permission.PENDING, "waits for a person to grant it")
    assert authority.request(Request("controller"), 1.0) == decision
    assert authority.judge(Judgement.GRANT, "  ", 2.0, number=decision.lease)[0] is False
    authority.update(BY_A_PERSON.pending_s + 0.1)
    assert authority.status(121.0).state == ControlState.IDLE
    assert authority.judge(Judgement.GRANT, "toolpusher", 122.0, number=1) == (False, "no request waits")


def test_nobody_grants_a_request_that_came_in_the_place_of_the_one_that_was_seen():
    authority = ControlAuthority(BY_A_PERSON)
    seen = authority.request(Request("holds the toolface", priority=1), 0.0).lease
    other = authority.request(Request("rotates", priority=2), 0.1).lease
    for number, words in ((seen, f"request {seen} waits no more"), (0, "number: must be that of the request")):
        done, why = authority.judge(Judgement.GRANT, "toolpusher", 0.2, number=number)
        assert (done, why) == (False, f"{words}; request {other} of rotates waits")
    assert not authority.judge(Judgement.DENY, "toolpusher", 0.2, number=seen)[0]
    assert authority.status(0.3).pending == other
    assert authority.judge(Judgement.GRANT, "toolpusher", 0.3, number=other) == (True, "rotates has control")


def test_a_person_grants_denies_and_takes_back_and_the_log_has_the_name():
    authority, lease = owned(BY_A_PERSON)
    assert authority.status(0.0).owner == "controller"
    assert authority.judge(Judgement.ABORT, "driller", 1.0, "pick up")[0]
    assert authority.status(1.0).state == ControlState.IDLE
    assert not authority.command(SetPoint(Mode.HOLD, lease, 1), 1.0)[0]
    authority.request(Request("other"), 2.0)
    assert authority.judge(Judgement.DENY, "driller", 3.0)[0]
    log = " | ".join(authority.take_events())
    assert "granted by toolpusher" in log
    assert "driller took control back: pick up" in log
    assert "driller denied control to other" in log


def test_the_same_or_a_lower_priority_is_denied_and_a_higher_one_takes_over():
    authority, first = owned(priority=10)
    denied = authority.request(Request("equal", priority=10), 1.0)
    assert (denied.permission, denied.lease) == (Permission.DENIED, 0)
    assert "controller has control" in denied.message
    higher = authority.request(Request("higher", priority=11), 1.0)
    assert higher.permission == Permission.GRANTED
    assert higher.lease > first
    taken, why = authority.command(SetPoint(Mode.HOLD, first, 1), 1.1)
    assert (taken, why) == (False, f"lease {first} is not in force: higher has control")


def test_a_request_that_waits_gets_the_lease_when_the_owner_leaves():
    authority, first = owned()
    waits = authority.request(Request("second", wait=True), 1.0)
    assert waits.permission == Permission.PENDING
    assert authority.release(first, 1.5)[0]
    authority.update(1.6)
    assert (authority.status(1.6).owner, authority.status(1.6).lease) == ("second", waits.lease)


def test_a_lease_ends_after_its_time_unless_it_is_renewed():
    authority, lease = owned(duration=1.0)
    assert authority.request(Request("controller", duration=3.0), 0.9).lease == lease
    authority.command(SetPoint(Mode.HOLD, lease, 1), 2.5)
    authority.update(3.8)
    assert authority.status(3.8).lease == lease
    authority.update(4.0)
    assert authority.status(4.0).state == ControlState.IDLE
    assert "is over" in authority.status(4.0).reason


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
    authority.command(SetPoint(Mode.ORIENT, 1, 4, turn=1.0), 0.0)
    before = authority.status(0.0)
    assert authority.command(point, 0.0)[0] is False
    after = authority.status(0.0)
    assert after.refusal
    assert dataclasses.replace(after, refusal="") == before


def test_the_rig_hears_a_turn_once_however_often_it_is_repeated():
    authority, lease = owned()
    authority.command(SetPoint(Mode.ORIENT, lease, 1, turn=0.5), 0.0)
    heard = []
    for k in range(1, 31):
        authority.command(SetPoint(Mode.ORIENT, lease, 1, turn=0.5), k * 0.1)
        heard += authority.update(k * 0.1)
    assert len(heard) > 4
    assert len({point.sequence for point in heard}) == 1
    authority.command(SetPoint(Mode.ORIENT, lease, 2, turn=0.5), 3.0)
    assert authority.update(3.1)[0].sequence > heard[-1].sequence


def test_a_speed_is_reached_on_its_ramp_and_acknowledged():
    authority, lease = owned(limits=LeaseLimits(speed_rate=1.0))
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0), 0.0)
    sent = passes(authority, 0.0, 1.5)
    speeds = [point.rotary_speed for _, point in sent]
    assert max(abs(b - a) for a, b in itertools.pairwise([0.0, *speeds])) < 0.1 + 1e-9
    assert speeds[-1] == 1.0
    assert authority.status(1.5).acknowledged == 0
    authority.on_acknowledge(lease, sent[-1][1].sequence, True, "")
    assert authority.status(1.5).acknowledged == 1
    authority.command(SetPoint(Mode.ORIENT, lease, 2, turn=1.0), 1.5)
    authority.on_acknowledge(lease, authority.update(1.6)[0].sequence, False, "in slips")
    assert authority.status(1.6).refusal == "the rig refuses: in slips"
    assert authority.status(1.6).acknowledged == 1


@pytest.mark.parametrize("stall", [0.3, 1.0, 10.0, 1e9])
def test_a_surface_that_stood_still_goes_on_with_the_ramp_and_does_not_jump(stall):
    authority, lease = owned(AUTOMATIC, limits=LeaseLimits(speed_rate=1.0))
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=9.0, valid_for=2e9), 0.0)
    before = passes(authority, 0.0, 2.0)[-1][1].rotary_speed
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=9.0, valid_for=2e9), 2.0 + stall)
    for point in authority.update(2.0 + stall):
        assert point.rotary_speed <= before + 0.2 + 1e-9


def test_the_ramp_begins_at_the_speed_the_driller_had():
    authority, lease = owned(limits=LeaseLimits(speed_rate=1.0))
    authority.on_rig(Achieved(speed=6.0), 0.0)
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=4.0), 0.0)
    assert authority.update(0.1)[0].rotary_speed == pytest.approx(5.9)


def test_a_set_point_lapses_and_the_lease_stays():
    authority, lease = owned()
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=1.0, valid_for=0.5), 0.0)
    authority.command(SetPoint(Mode.PUMP, lease, 2, flow_rate=0.02, valid_for=0.5), 0.0)
    passes(authority, 0.0, 0.6)
    status = authority.status(0.6)
    assert (status.mode, status.flow_rate, status.state) == (Mode.HOLD, None, ControlState.GRANTED)


def test_a_new_owner_takes_over_what_it_could_have_asked_for_and_no_more():
    for limit, mode in ((5.0, Mode.ROTATE), (1.0, Mode.RELEASE)):
        authority, lease = owned()
        authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=3.0), 0.0)
        authority.request(Request("higher", priority=1, limits=LeaseLimits(speed=limit)), 0.1)
        assert authority.status(0.1).mode == mode


def test_another_set_point_under_the_same_number_is_refused():
    authority, lease = owned()
    authority.command(SetPoint(Mode.ORIENT, lease, 1, turn=0.5), 0.0)
    taken, why = authority.command(SetPoint(Mode.ORIENT, lease, 1, turn=0.6), 0.1)
    assert (taken, why) == (False, "sequence: 1 was another set-point; a new one needs a new number")


def test_a_lease_that_is_renewed_in_a_turn_makes_the_turn_once():
    authority, lease = owned()
    turn = SetPoint(Mode.ORIENT, lease, 1, turn=0.5)
    authority.command(turn, 0.0)
    first = authority.update(0.1)[0].sequence
    authority.request(Request("controller"), 0.2)
    authority.command(turn, 0.3)
    assert {point.sequence for _, point in passes(authority, 0.3, 2.0)} == {first}


# Faults.


@pytest.mark.parametrize("reaction", REACTIONS)
@pytest.mark.parametrize("how", ["sliding", "rotating"])
def test_a_dead_controller_ends_in_the_declared_reaction(how, reaction):
    settings = dataclasses.replace(AUTOMATIC, **{f"controller_lost_{how}": reaction})
    authority, lease = owned(settings)
    mode = Mode.ROTATE if how == "rotating" else Mode.ORIENT
    values = {"rotary_speed": 2.0} if how == "rotating" else {"turn": 1.0}
    authority.command(SetPoint(mode, lease, 1, valid_for=60.0, **values), 0.0)
    sent = passes(authority, 0.0, settings.heartbeat_s + 3.0)
    status = authority.status(settings.heartbeat_s + 3.0)
    assert status.lease == 0
    assert "controller is silent" in status.reason
    if reaction == "release":
        assert sent[-1][1].mode == Mode.RELEASE
        assert status.state == ControlState.IDLE
    else:
        assert sent[-1][1].mode == (Mode.HOLD if reaction == "hold" else mode)
        assert sent[-1][0] > settings.heartbeat_s + 3.0 - RIG_TIMEOUT
        assert status.state == ControlState.FAULT
        assert authority.judge(Judgement.ABORT, "driller", 6.0)[0]
        assert authority.update(6.1)[0].mode == Mode.RELEASE
        assert authority.status(6.1).state == ControlState.IDLE


def test_a_heartbeat_alone_keeps_the_lease():
    authority, lease = owned()
    for k in range(100):
        authority.command(SetPoint(Mode.HOLD, lease, 0), k * 0.5)
        authority.update(k * 0.5)
    assert authority.status(49.5).lease == lease


@pytest.mark.parametrize("reaction", REACTIONS)
@pytest.mark.parametrize("how", ["sliding", "rotating"])
def test_a_dead_mwd_ends_in_the_declared_reaction_and_the_owner_stays(how, reaction):
    settings = dataclasses.replace(AUTOMATIC, **{f"mwd_lost_{how}": reaction})
    authority, lease = owned(settings)
    mode = Mode.ROTATE if how == "rotating" else Mode.ORIENT
    authority.command(SetPoint(mode, lease, 1, valid_for=60.0), 0.0)
    authority.on_mwd(alive=False)
    status = authority.status(0.1)
    expected = {"keep": mode, "hold": Mode.HOLD, "release": Mode.RELEASE}[reaction]
    assert (status.mode, status.owner) == (expected, "controller")
    assert status.state == (ControlState.GRANTED if reaction == "keep" else ControlState.FAULT)
    assert authority.command(SetPoint(mode, lease, 2), 0.2)[0] == (reaction == "keep")
    assert authority.command(SetPoint(Mode.HOLD, lease, 3), 0.2)[0]
    authority.on_mwd(alive=True)
    assert authority.status(0.3).state == ControlState.GRANTED
    assert authority.command(SetPoint(mode, lease, 4), 0.3)[0]


def test_a_torque_that_lasts_above_its_limit_ends_control_with_the_string_held():
    authority, lease = owned(limits=LeaseLimits(torque=5000.0))
    authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=2.0, valid_for=60.0), 0.0)
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
SITE = LeaseLimits.of_settings(AUTOMATIC)


class AnyController(RuleBasedStateMachine):
    """Controllers, persons, the rig and the MWD do anything, in any order, while time passes."""

    @initialize(
        grant=st.sampled_from(["automatic", "operator"]),
        reactions=st.tuples(*[st.sampled_from(REACTIONS)] * 4),
    )
    def begin(self, grant, reactions):
        names = [f"{what}_lost_{how}" for what in ("controller", "mwd") for how in ("sliding", "rotating")]
        self.settings = ControlSettings(enabled=True, grant=grant, **dict(zip(names, reactions, strict=True)))
        self.authority = ControlAuthority(self.settings)
        self.now, self.mwd = 0.0, True
        self.leases, self.newest = {}, 0
        self.speed, self.heard = None, {}

    @rule(
        name=st.sampled_from(NAMES),
        priority=st.integers(0, 2),
        wait=st.booleans(),
        speed=st.sampled_from([0.0, 1.0, 5.0]),
    )
    def asks(self, name, priority, wait, speed):
        request = Request(name, priority=priority, wait=wait, limits=LeaseLimits(speed=speed))
        before = self.authority.status(self.now)
        decision = self.authority.request(request, self.now)
        if decision.lease:
            self.leases[name] = decision.lease
        if decision.permission == Permission.GRANTED:
            self.heard[name] = self.now
            assert not before.owner or before.owner == name or before.priority < priority

    @rule(
        name=st.sampled_from(NAMES),
        sequence=st.integers(1, 3),
        mode=st.sampled_from(list(Mode)),
        value=st.floats(-20.0, 20.0),
        valid_for=st.floats(0.1, 5.0),
    )
    def commands(self, name, sequence, mode, value, valid_for):
        point = SetPoint(mode, self.leases.get(name, 0), sequence, value, value, value / 200.0, valid_for)
        owner = self.authority.status(self.now).owner
        taken, why = self.authority.command(point, self.now)
        assert taken == (not why)
        assert owner == name or not taken
        if owner and self.leases.get(name) == self.authority.status(self.now).lease:
            # Of one that is refused for its value it is known that its sender lives.
            self.heard[name] = self.now

    @rule(name=st.sampled_from(NAMES))
    def releases(self, name):
        self.authority.release(self.leases.get(name, 0), self.now)

    @rule(judgement=st.sampled_from(list(Judgement)), number=st.integers(0, 5))
    def decides(self, judgement, number):
        before = self.authority.status(self.now)
        done, _ = self.authority.judge(judgement, "driller", self.now, number=number or before.pending)
        assert not (done and number and judgement == Judgement.GRANT and number != before.pending)
        if done and judgement == Judgement.GRANT:
            self.heard[before.pending_controller] = self.now

    @rule(alive=st.booleans())
    def mwd_lives_or_dies(self, alive):
        before = self.authority.status(self.now)
        self.authority.on_mwd(alive)
        if self.mwd and not alive and before.owner and before.mode != Mode.RELEASE:
            reaction = before.reactions[f"mwd_lost_{'rotating' if before.mode == Mode.ROTATE else 'sliding'}"]
            expected = {Reaction.HOLD: Mode.HOLD, Reaction.RELEASE: Mode.RELEASE}.get(reaction, before.mode)
            assert self.authority.status(self.now).mode == expected
        self.mwd = alive

    @rule(speed=st.floats(-10.0, 10.0), torque=st.floats(-40000.0, 40000.0))
    def rig_does(self, speed, torque):
        self.authority.on_rig(Achieved(speed, torque), self.now)

    @rule(steps=st.integers(1, 30))
    def time_passes(self, steps):
        for _ in range(steps):
            self.now += 0.1
            before = self.authority.status(self.now)
            sent = self.authority.update(self.now)
            after = self.authority.status(self.now)
            if after.owner and after.lease != before.lease:
                self.heard[after.owner] = self.now
            if before.owner and self.now - self.heard[before.owner] > self.settings.heartbeat_s + 1e-6:
                assert after.owner != before.owner
                if not after.owner:
                    self.check_reaction(before, after)
            for point in sent:
                self.check_sent(point)

    def check_reaction(self, before, after):
        reaction = before.reactions[f"controller_lost_{'rotating' if before.mode == Mode.ROTATE else 'sliding'}"]
        expected = {Reaction.HOLD: Mode.HOLD, Reaction.RELEASE: Mode.RELEASE}.get(reaction, before.mode)
        assert after.mode == (Mode.RELEASE if before.mode == Mode.RELEASE else expected)
        assert after.flow_rate is None

    def check_sent(self, point):
        assert point.lease >= self.newest
        self.newest = point.lease
        limits = self.authority.status(self.now).limits
        if point.mode == Mode.ROTATE:
            assert abs(point.rotary_speed) <= limits.speed + 1e-9
            if self.speed is not None:
                assert abs(point.rotary_speed - self.speed[1]) <= SITE.speed_rate * (self.now - self.speed[0]) + 1e-6
            self.speed = self.now, point.rotary_speed
        elif point.mode != Mode.PUMP:
            self.speed = None
        assert abs(point.turn) <= limits.turn + 1e-9
        assert point.flow_rate <= limits.flow + 1e-9
        assert 0.0 < point.valid_for <= RIG_TIMEOUT

    @invariant()
    def the_state_is_one_that_can_be(self):
        if not hasattr(self, "authority"):
            return
        status = self.authority.status(self.now)
        assert bool(status.owner) == bool(status.lease)
        assert bool(status.pending) == bool(status.pending_controller)
        if status.state == ControlState.IDLE:
            assert (status.mode, status.flow_rate, status.owner) == (Mode.RELEASE, None, "")
        if status.state == ControlState.GRANTED:
            assert status.owner


TestAnyController = pytest.mark.slow(AnyController.TestCase)
TestAnyController.settings = settings(max_examples=60, stateful_step_count=30)

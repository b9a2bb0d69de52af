# SPDX-License-Identifier: Apache-2.0
"""The downlink's machine: every transition, every interlock with its sentence, nothing moves without a grant."""

import contextlib
import dataclasses
import math

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from mwd_sensors.core.units import LPM, RPM
from mwd_sensors.telemetry.downlink import COUNTERS, FLOW, Downlink, DownlinkFrame
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.downlink.machine import ENDED, NEXT, PERMISSION_S, DownlinkState, InterlockReadings, Machine
from mwd_surface.downlink.memory import Kept
from mwd_surface.downlink.settings import DownlinkSettings

TOOL = ToolConfiguration(
    pulse_width_s=0.8,
    downlink=Downlink(),
    survey_sequences=("Inc:12:P Azm:12:P DLnk:10:P",),
    toolface_sequences=("aTFA:6:P",),
)
SETTINGS = DownlinkSettings()
DRILLING = InterlockReadings(
    rig_age_s=0.1,
    flow=2000.0 * LPM,
    rotary_speed=110.0 * RPM,
    pressure=2.0e7,
    in_slips=False,
    link_locked=True,
    link_age_s=0.5,
)
STEP = 0.5


class Rig:
    """A rig that does what the machine asks, and a clock."""

    def __init__(self, machine, readings=DRILLING):
        self.machine, self.readings, self.now = machine, readings, 100.0
        self.asked = []
        if machine.echo.heard is None:
            # A tool that received no command yet.
            machine.on_echo(0, self.now)

    def play(self, seconds, **changes):
        for _ in range(math.ceil(seconds / STEP)):
            self.now += STEP
            asked = self.machine.set_point
            self.asked.append(asked)
            seen = self.readings
            if asked is not None:
                field = "flow" if self.machine.downlink.medium == FLOW else "rotary_speed"
                seen = seen._replace(**{field: asked})
                seen = seen._replace(pressure=2.0e7 * (seen.flow / DRILLING.flow) ** 1.75)
            self.machine.update(self.now, seen._replace(**changes))
        return self.machine.state

    def send(self):
        """Play a command until the tool's answer is waited for."""
        duration_s = self.machine.downlink.symbol_s + self.machine.programme.duration_s
        assert self.play(2.0 + duration_s) == DownlinkState.SENT
        return self

    def start(self):
        machine = self.machine
        machine.draft("pulse_width", 0.5, "Ann", self.now)
        machine.submit("Ann", self.now)
        machine.decide(True, "Bo", self.now, machine.number)
        return self


def test_a_downlink_runs_from_draft_to_the_tool_s_answer():
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    machine = rig.machine
    assert rig.play(1.0) == DownlinkState.ARMED
    assert rig.play(machine.downlink.symbol_s) == DownlinkState.RUNNING
    assert rig.play(machine.programme.duration_s + 1.0) == DownlinkState.SENT
    asked = [one for one in rig.asked if one is not None]
    assert min(asked) == pytest.approx(0.6 * 110.0 * RPM)
    assert max(asked) == asked[0] == asked[-1] == pytest.approx(110.0 * RPM)
    assert machine.set_point is None
    assert machine.expected.pulse_width_s == 0.5
    machine.on_echo(DownlinkFrame(7, 1, 1).echo, rig.now)
    assert machine.state == DownlinkState.SENT
    machine.on_echo(machine.request.frame.echo, rig.now)
    assert machine.state == DownlinkState.CONFIRMED
    assert machine.in_force.pulse_width == 1
    way = ["DRAFT", "PENDING", "GRANTED", "ARMED", "RUNNING", "SENT", "CONFIRMED"]
    assert [one.after for one in machine.transitions] == [DownlinkState[name] for name in way]
    assert [one.by for one in machine.transitions[:3]] == ["Ann", "Ann", "Bo"]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_surface_that_dies_while_it_sends_gives_the_next_command_another_number(share):
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    machine = rig.machine
    rig.play(1.0 + machine.downlink.symbol_s + share * machine.programme.duration_s)
    assert machine.state == DownlinkState.RUNNING
    # What was kept at the last transition is what a surface that starts again reads.
    again = Rig(Kept.of(machine).machine(TOOL, SETTINGS)).start().send()
    assert again.machine.request.frame.counter != machine.request.frame.counter
    again.machine.on_echo(machine.request.frame.echo, again.now)
    assert again.machine.state == DownlinkState.SENT


def test_without_an_answer_it_ends_unconfirmed_and_a_late_answer_still_counts():
    rig = Rig(Machine(TOOL, SETTINGS)).start().send()
    machine = rig.machine
    assert rig.play(machine.answer_s + 1.0) == DownlinkState.UNCONFIRMED
    assert "did not answer" in machine.reason
    assert machine.in_force.pulse_width == -1
    machine.on_echo(machine.request.frame.echo, rig.now)
    assert machine.state == DownlinkState.CONFIRMED


def test_a_tool_without_an_echo_word_is_told_so():
    mute = dataclasses.replace(TOOL, survey_sequences=("Inc:12:P",))
    rig = Rig(Machine(mute, SETTINGS)).start().send()
    rig.play(rig.machine.answer_s + 1.0)
    assert "add DLnk" in rig.machine.reason


def test_pending_and_granted_lapse_after_two_minutes_and_denied_ends():
    machine = Machine(TOOL, SETTINGS)
    rig = Rig(machine)
    machine.draft("survey_now", 0.0, "Ann", rig.now)
    machine.submit("Ann", rig.now)
    assert rig.play(PERMISSION_S + 1.0) == DownlinkState.LAPSED
    rig.start()
    assert rig.play(PERMISSION_S - 5.0, in_slips=True) == DownlinkState.GRANTED
    assert rig.play(10.0, in_slips=True) == DownlinkState.LAPSED
    machine.draft("survey_now", 0.0, "Ann", rig.now)
    machine.submit("Ann", rig.now)
    machine.decide(False, "Bo", rig.now)
    assert machine.state == DownlinkState.DENIED
    assert set(rig.asked) == {None}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rig_age_s": 3.0}, "no data from the rig"),
        ({"in_slips": True}, "slips"),
        ({"in_slips": None}, "slips"),
        ({"pressure": 3.3e7}, "pressure is above"),
        ({"pressure": None}, "unknown"),
        ({"survey_running": True}, "survey"),
        ({"link_locked": False}, "link is not locked"),
        ({"link_age_s": 60.0}, "link is not locked"),
        ({"no_control": "another controller has the top drive"}, "another controller"),
        ({"rotary_speed": None}, "rotary speed is unknown"),
        ({"rotary_speed": 200.0 * RPM}, "above the limit of 180"),
        ({"rotary_speed": 45.0 * RPM}, "would go down to 27"),
    ],
)
def test_every_interlock_keeps_it_from_starting_with_its_reason(changes, words):
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    assert rig.play(60.0, **changes) == DownlinkState.GRANTED
    assert any(words in text for text in rig.machine.blocked_by)
    assert set(rig.asked) == {None}
    assert rig.play(30.0) == DownlinkState.RUNNING


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rig_age_s": 3.0}, "no data from the rig"),
        ({"in_slips": True}, "slips"),
        ({"pressure": 3.0e7}, "stalls"),
        ({"pressure": 3.3e7}, "pressure"),
        ({"survey_running": True}, "survey"),
        ({"no_control": "the lease was taken away"}, "lease"),
        ({"rotary_speed": 110.0 * RPM}, "operator input"),
        ({"rotary_speed": 0.0}, "go down"),
        ({"flow": 1700.0 * LPM, "pressure": 1.5e7}, "operator input"),
    ],
)
def test_a_limit_or_an_operator_s_input_ends_it_and_asks_nothing_more(changes, words):
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    rig.play(60.0)
    assert rig.machine.set_point is not None
    assert rig.play(3.0, **changes) == DownlinkState.ABORTED
    assert words in rig.machine.reason
    assert rig.machine.set_point is None


def test_a_link_that_is_lost_while_symbols_are_sent_does_not_end_it():
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    rig.play(60.0)
    assert rig.play(20.0, link_locked=False) == DownlinkState.RUNNING


def test_a_surface_that_did_not_watch_ends_it():
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    rig.play(60.0)
    rig.now += 5.0
    rig.play(STEP)
    assert rig.machine.state == DownlinkState.ABORTED
    assert "did not check" in rig.machine.reason


def test_an_interlock_that_breaks_before_the_first_symbol_waits_again():
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    assert rig.play(10.0) == DownlinkState.ARMED
    assert rig.play(1.0, in_slips=True) == DownlinkState.GRANTED
    assert rig.play(10.0) == DownlinkState.ARMED
    assert rig.play(10.0, rotary_speed=100.0 * RPM) == DownlinkState.ARMED, "an unsteady rotary speed is waited out"
    assert rig.play(20.0) == DownlinkState.RUNNING


def test_abort_acts_at_once_in_every_state_under_way():
    for seconds, state in (
        (0.0, DownlinkState.GRANTED),
        (5.0, DownlinkState.ARMED),
        (60.0, DownlinkState.RUNNING),
        (250.0, DownlinkState.SENT),
    ):
        rig = Rig(Machine(TOOL, SETTINGS)).start()
        assert rig.play(seconds) == state
        rig.machine.abort("seen enough", "Cy", rig.now)
        assert (rig.machine.state, rig.machine.set_point, rig.machine.decided_by) == (DownlinkState.ABORTED, None, "Cy")
        assert ("may obey" in rig.machine.reason) == (state == DownlinkState.SENT)
    machine = Machine(TOOL, SETTINGS)
    machine.draft("survey_now", 0.0, "Ann", 0.0)
    machine.abort("withdrawn", "Ann", 1.0)
    assert machine.state == DownlinkState.ABORTED


def test_a_request_that_replaced_the_one_that_was_seen_is_not_granted():
    machine = Machine(TOOL, SETTINGS, number=6)
    machine.draft("survey_now", 0.0, "Ann", 0.0)
    seen = machine.number
    machine.draft("mute", 0.0, "Ann", 0.0)
    assert (seen, machine.number) == (7, 8)
    with pytest.raises(ValueError, match="request 7 was replaced; the present request is 8: silent"):
        machine.submit("Ann", 0.0, seen)
    assert "request 8 waits for permission" in machine.submit("Ann", 0.0, 8)
    for number, words in ((seen, "request 7 was replaced"), (0, "number: must be the number of the present request")):
        with pytest.raises(ValueError, match=words):
            machine.decide(True, "Bo", 0.0, number)
    with pytest.raises(ValueError, match="request 7 was replaced"):
        machine.decide(False, "Bo", 0.0, seen)
    assert machine.state == DownlinkState.PENDING
    machine.decide(True, "Bo", 0.0, 8)
    assert machine.state == DownlinkState.GRANTED


def test_one_at_a_time_and_what_is_missing_is_refused_in_words():
    machine = Machine(TOOL, SETTINGS)
    for call, words in (
        (lambda: machine.submit("Ann", 0.0), "no draft"),
        (lambda: machine.decide(True, "Ann", 0.0), "waits for permission"),
        (lambda: machine.abort("", "Ann", 0.0), "no downlink"),
        (lambda: machine.draft("survey_now", 0.0, " ", 0.0), "operator_name"),
        (lambda: machine.draft("pulse_width", 0.4, "Ann", 0.0), "can be"),
    ):
        with pytest.raises(ValueError, match=words):
            call()
    machine.draft("survey_now", 0.0, "Ann", 0.0)
    machine.draft("mute", 0.0, "Ann", 0.0)
    machine.submit("Ann", 0.0)
    with pytest.raises(ValueError, match="operator_name"):
        machine.decide(True, "", 0.0, machine.number)
    with pytest.raises(ValueError, match="only one can run"):
        machine.draft("survey_now", 0.0, "Ann", 0.0)


def test_a_flow_command_follows_the_flow():
    tool = dataclasses.replace(TOOL, downlink=Downlink(medium=FLOW, ramp_s=8.0, hold_s=8.0, depth=0.2, least=0.01))
    rig = Rig(Machine(tool, SETTINGS), DRILLING._replace(rotary_speed=0.0)).start()
    assert rig.play(rig.machine.programme.duration_s + 20.0) == DownlinkState.SENT
    asked = [one for one in rig.asked if one is not None]
    assert min(asked) == pytest.approx(0.8 * 2000.0 * LPM)


class Anybody(RuleBasedStateMachine):
    """Anybody does anything at any time, and the rig whatever it likes."""

    def __init__(self):
        super().__init__()
        self.machine, self.now, self.grants = Machine(TOOL, SETTINGS), 0.0, set()

    def attempt(self, call):
        with contextlib.suppress(ValueError):
            call()

    @rule(name=st.sampled_from(["pulse_width", "survey_now", "toolface_rate"]), value=st.sampled_from([0.3, 0.5, 2.0]))
    def draft(self, name, value):
        self.attempt(lambda: self.machine.draft(name, value, "Ann", self.now))

    @rule()
    def submit(self):
        self.attempt(lambda: self.machine.submit("Ann", self.now))

    @rule(granted=st.booleans(), by=st.sampled_from(["", "Bo"]), behind=st.integers(0, 2), named=st.booleans())
    def decide(self, granted, by, behind, named):
        number = max(self.machine.number - behind, 0) if named else 0

        def call():
            self.machine.decide(granted, by, self.now, number)
            assert number == self.machine.number or not (granted or number)
            if granted:
                self.grants.add(self.machine.number)

        self.attempt(call)

    @rule()
    def abort(self):
        self.attempt(lambda: self.machine.abort("stop", "Cy", self.now))

    @rule(seconds=st.sampled_from([0.5, 20.0, 60.0, 400.0]), slips=st.booleans(), silent=st.booleans())
    def wait(self, seconds, slips, silent):
        rig = Rig(self.machine)
        rig.now = self.now
        changes = {"in_slips": True} if slips else {}
        rig.play(seconds, **changes, **({"rig_age_s": 9.0} if silent else {}))
        self.now = rig.now

    @precondition(lambda self: self.machine.request is not None)
    @rule(right=st.booleans())
    def echo(self, right):
        self.machine.on_echo(self.machine.request.frame.echo if right else 0, self.now)

    @invariant()
    def nothing_moves_without_a_grant(self):
        machine = self.machine
        assert (machine.set_point is not None) == (machine.state == DownlinkState.RUNNING)
        if machine.state in (DownlinkState.GRANTED, DownlinkState.ARMED, DownlinkState.RUNNING, DownlinkState.SENT):
            assert machine.number in self.grants
        for one in machine.transitions:
            assert one.after in NEXT[one.before]
            assert one.reason
            assert one.by or one.after not in (DownlinkState.DRAFT, DownlinkState.PENDING, DownlinkState.DENIED)


TestAnybody = pytest.mark.slow(Anybody.TestCase)


def test_every_state_can_be_left_and_only_the_ends_begin_anew():
    assert set(NEXT) == set(DownlinkState)
    assert all(DownlinkState.DRAFT in NEXT[state] for state in ENDED)


def sent(machine, now=100.0):
    rig = Rig(machine)
    rig.now = now
    return rig.start().send()


def test_the_eighth_attempt_is_not_confirmed_by_the_answer_to_the_first():
    machine = Machine(TOOL, SETTINGS)
    rig = sent(machine)
    first = machine.request.frame.echo
    machine.on_echo(first, rig.now)
    assert machine.state == DownlinkState.CONFIRMED
    for _ in range(COUNTERS + 1):
        # The tool receives none of these and goes on repeating the first.
        rig = sent(machine, rig.now)
        machine.on_echo(first, rig.now)
        assert machine.state == DownlinkState.SENT
        assert rig.play(machine.answer_s + 1.0) == DownlinkState.UNCONFIRMED
        machine.on_echo(first, rig.now)
        assert machine.state == DownlinkState.UNCONFIRMED


@pytest.mark.parametrize("heard_before", [False, True])
def test_after_a_lost_memory_the_echo_in_force_confirms_nothing(heard_before):
    before = sent(Machine(TOOL, SETTINGS)).machine.request.frame.echo
    machine = Machine(TOOL, SETTINGS)
    machine.echo.heard = before if heard_before else None
    rig = Rig.__new__(Rig)
    rig.machine, rig.readings, rig.now, rig.asked = machine, DRILLING, 100.0, []
    rig.start().send()
    machine.on_echo(before, rig.now)
    assert machine.state == (DownlinkState.SENT if heard_before else DownlinkState.UNCONFIRMED)
    if not heard_before:
        assert "again to be certain" in machine.reason
        # The tool runs by that command all the same, and the next attempt is certain.
        assert machine.in_force.pulse_width == 1
        rig = sent(machine, rig.now)
        machine.on_echo(before, rig.now)
        assert machine.state == DownlinkState.SENT
        machine.on_echo(machine.request.frame.echo, rig.now)
        assert machine.state == DownlinkState.CONFIRMED


@pytest.mark.parametrize("name", ["flow", "rotary_speed", "pressure"])
@pytest.mark.parametrize("value", [1e200, -1e308, math.inf, math.nan, 5e-324])
def test_a_reading_that_no_rig_has_is_not_known_and_raises_nothing(name, value):
    rig = Rig(Machine(TOOL, SETTINGS)).start()
    rig.play(2.0 + rig.machine.downlink.symbol_s)
    assert rig.machine.state == DownlinkState.RUNNING
    rig.play(3.0, **{name: value})
    assert rig.machine.set_point is None or math.isfinite(rig.machine.set_point)

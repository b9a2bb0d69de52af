# SPDX-License-Identifier: Apache-2.0
"""
State machine of one downlink from its draft to the tool's answer; no command is sent unless a named person grants it.

The machine reads no clock and does not command the rig: every call takes `now`, s, of one steady clock, and the caller
commands the rig with `set_point`. Each change of state is a `Transition` for journal and recording.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from typing import Any, NamedTuple

from mwd_sensors.core.units import LPM, RPM
from mwd_sensors.telemetry import tool_commands
from mwd_sensors.telemetry.downlink import (
    ECHO_WORD,
    ROTATION,
    Downlink,
    DownlinkFrame,
    DownlinkProgramme,
    amplitude,
    programme,
)
from mwd_sensors.telemetry.tool_commands import ToolSettings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.downlink.tool_echo import ToolEcho

# Interlocks.

_BAR = 1e5
_RIG_SILENT_S = 2.0  # largest age of the rig's data, s
_LINK_SILENT_S = 10.0  # largest age of the state of the link, s
_USUAL_S = 60.0  # time over which the median gives the usual pressure, s
# Exponent of the flow in the pressure loss of turbulent pipe flow (Blasius); pressure / flow^1.75 depends little on the
# flow.
_POWER = 1.75


class InterlockReadings(NamedTuple):
    """Present readings at the surface; None means unknown."""

    rig_age_s: float = math.inf  #: age of the rig's data
    #: `flow`, `rotary_speed`, `pressure`: flow, m^3/s; speed of the top drive, rad/s; standpipe pressure, Pa.
    flow: float | None = None
    rotary_speed: float | None = None
    pressure: float | None = None
    in_slips: bool | None = None
    link_locked: bool = False  #: whether words arrive over the link
    link_age_s: float = math.inf  #: age of the state of the link
    survey_running: bool = False
    no_control: str = ""  #: reason why the rig does not accept set-points; empty if it accepts them


# Readings of this size or larger are impossible on any rig: m^3/s, rad/s, Pa.
_MOST = {"flow": 1.0, "rotary_speed": 100.0, "pressure": 1e9}


def possible(readings: InterlockReadings) -> InterlockReadings:
    """Return the readings with impossible values replaced by None."""
    known: dict[str, Any] = {name: getattr(readings, name) for name in _MOST}
    for name, value in known.items():
        if value is not None and not abs(value) < _MOST[name]:
            known[name] = None
    return readings._replace(**known)


class StallWatch:
    """
    Detector of a stall of the mud motor: a rise of the pressure above its usual value at the same flow.

    share : smallest rise that counts as a stall, as a share of the usual value.
    stalled : whether the last reading shows a stall.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._ratios: deque[tuple[float, float]] = deque()
        self.stalled = False

    def take(self, now: float, flow: float | None, pressure: float | None, least_flow: float) -> None:
        """
        Add a reading of flow, m^3/s, and pressure, Pa; now: steady time, s.

        If a reading is unknown or the flow is below least_flow, m^3/s, the earlier readings that give the usual
        pressure are cleared.
        """
        if flow is None or pressure is None or flow < least_flow:
            self._ratios.clear()
            self.stalled = False
            return
        ratio = pressure / flow**_POWER
        while self._ratios and self._ratios[0][0] < now - _USUAL_S:
            self._ratios.popleft()
        usual = sorted(one for _, one in self._ratios)
        self.stalled = len(usual) >= 10 and ratio > (1.0 + self._share) * usual[len(usual) // 2]
        if not self.stalled:
            self._ratios.append((now, ratio))


def medium_value(readings: InterlockReadings, downlink: Downlink) -> float | None:
    """Return the reading of the quantity that the downlink changes (speed or flow); None if unknown."""
    return readings.rotary_speed if downlink.medium == ROTATION else readings.flow


def words(value: float, downlink: Downlink) -> str:
    """Return a value of the quantity that the downlink changes as text, in r/min or l/min."""
    return f"{value / RPM:.0f} r/min" if downlink.medium == ROTATION else f"{value / LPM:.0f} l/min"


def blocked(
    readings: InterlockReadings, downlink: Downlink, settings: DownlinkSettings, *, stalled: bool, running: bool
) -> tuple[str, ...]:
    """
    Return the messages of the interlocks that fail.

    running: whether symbols are being sent. If so, the lock of the uplink is not checked, because the symbols may
    disturb the uplink, and only the present flow or speed is compared with its limits, not the lowest set-point.
    """
    rules = (
        (bool(readings.no_control), readings.no_control),
        (readings.rig_age_s > _RIG_SILENT_S, "no data from the rig for 2 s"),
        (
            readings.in_slips is None or readings.in_slips,
            "the string is in slips, or the rig does not report the slips",
        ),
        (stalled, "the motor stalls: the pressure is far above its usual value at this flow"),
        (
            readings.pressure is None or readings.pressure > settings.pressure_high_bar * _BAR,
            f"the standpipe pressure is above {settings.pressure_high_bar:g} bar, or unknown",
        ),
        (readings.survey_running, "a survey is being taken"),
        (
            not running and not (readings.link_locked and readings.link_age_s < _LINK_SILENT_S),
            "the link is not locked: the tool's answer would not be received",
        ),
    )
    found = [text for fails, text in rules if fails]
    return (*found, *_outside(readings, downlink, settings, running=running))


def _outside(
    readings: InterlockReadings, downlink: Downlink, settings: DownlinkSettings, *, running: bool
) -> list[str]:
    """Return messages for limits of flow or speed that are exceeded, or would be exceeded during the downlink."""
    value = medium_value(readings, downlink)
    medium = "rotary speed" if downlink.medium == ROTATION else "flow"
    if value is None:
        return [f"the {medium} is unknown"]
    limits = {
        True: (settings.speed_low_rpm * RPM, settings.speed_high_rpm * RPM),
        False: (settings.flow_low_lpm * LPM, settings.flow_high_lpm * LPM),
    }
    low, high = limits[downlink.medium == ROTATION]
    # While symbols are sent, allow a reading slightly below the lowest set-point.
    lowest = value * (1.0 + settings.tolerance) if running else value * amplitude(0, downlink)
    found = []
    if value > high:
        found.append(f"{medium} {words(value, downlink)} is above the limit of {words(high, downlink)}")
    if lowest < low:
        found.append(
            f"{medium} would go down to {words(lowest, downlink)}; the lowest allowed is {words(low, downlink)}"
        )
    if not running and value < downlink.least_value:
        least = words(downlink.least_value, downlink)
        found.append(f"{medium} {words(value, downlink)} is too low: the tool accepts commands only at {least} or more")
    return found


# State machine.

PERMISSION_S = 120.0  # time after which an unused permission lapses, s
# Delay of an answer due to receiver and depth, in addition to the time to send two sequences, s.
_LATE_S = 120.0
_STEADY = 0.04  # largest change of flow or rotary speed before the first symbol, as a share of the value
# Lower limits, m^3/s and rad/s, of the value from which the allowed deviation of the quantity that the command does not
# change (flow or speed) is computed. A share of a value near 0 would not allow for noise.
_LEAST_FLOW, _LEAST_SPEED = 0.01, 3.0
_LOST_S = 2.0  # longest time between two updates, s; after a longer time the rig counts as not monitored


class DownlinkState(enum.IntEnum):
    """State of a downlink, as in mwd_msgs/DownlinkState."""

    IDLE = 0
    DRAFT = 1
    PENDING = 2
    GRANTED = 3
    ARMED = 4
    RUNNING = 5
    SENT = 6
    CONFIRMED = 7
    UNCONFIRMED = 8
    DENIED = 9
    LAPSED = 10
    ABORTED = 11


ENDED = frozenset(
    {
        DownlinkState.CONFIRMED,
        DownlinkState.UNCONFIRMED,
        DownlinkState.DENIED,
        DownlinkState.LAPSED,
        DownlinkState.ABORTED,
    }
)
#: Set of the states that may follow each state.
NEXT: dict[DownlinkState, frozenset[DownlinkState]] = {
    DownlinkState.IDLE: frozenset({DownlinkState.DRAFT}),
    DownlinkState.DRAFT: frozenset({DownlinkState.DRAFT, DownlinkState.PENDING, DownlinkState.ABORTED}),
    DownlinkState.PENDING: frozenset(
        {DownlinkState.GRANTED, DownlinkState.DENIED, DownlinkState.LAPSED, DownlinkState.ABORTED}
    ),
    DownlinkState.GRANTED: frozenset({DownlinkState.ARMED, DownlinkState.LAPSED, DownlinkState.ABORTED}),
    DownlinkState.ARMED: frozenset(
        {DownlinkState.GRANTED, DownlinkState.RUNNING, DownlinkState.LAPSED, DownlinkState.ABORTED}
    ),
    DownlinkState.RUNNING: frozenset({DownlinkState.SENT, DownlinkState.ABORTED}),
    DownlinkState.SENT: frozenset({DownlinkState.CONFIRMED, DownlinkState.UNCONFIRMED, DownlinkState.ABORTED}),
    # An answer after the waiting time still confirms the command.
    DownlinkState.UNCONFIRMED: frozenset({DownlinkState.DRAFT, DownlinkState.CONFIRMED}),
    **dict.fromkeys(ENDED - {DownlinkState.UNCONFIRMED}, frozenset({DownlinkState.DRAFT})),
}


class Transition(NamedTuple):
    """Change of state: number of the request, both states, reason, person (empty: the machine), steady time, s."""

    number: int
    before: DownlinkState
    after: DownlinkState
    reason: str
    by: str
    now: float


class DownlinkRequest(NamedTuple):
    """A requested command, with the name and value that the person gave."""

    frame: DownlinkFrame
    name: str
    value: float
    by: str


class Machine:
    """
    Downlinks of one well, one at a time.

    Parameters
    ----------
    tool : ToolConfiguration
        Tool configuration as delivered.
    counter : int
        Counter of the last command that was sent; 0: no command was sent.
    number : int
        Number of the last request; 0: no request was made. Numbers continue after a restart, so that no number is used
        for two requests.
    echo : ToolEcho, optional
        Echoes that the tool may send; by default all codes are possible.

    Raises
    ------
    ValueError
        The tool does not accept commands.
    """

    def __init__(
        self,
        tool: ToolConfiguration,
        settings: DownlinkSettings,
        in_force: ToolSettings | None = None,
        counter: int = 0,
        number: int = 0,
        echo: ToolEcho | None = None,
    ) -> None:
        self.downlink = tool_commands.downlink_of(tool)
        self.tool, self.settings = tool, settings
        self.in_force, self.counter = in_force or ToolSettings(), counter
        self.echo = echo or ToolEcho()
        self._proves = False
        self.state, self.number = DownlinkState.IDLE, number
        self.reason = self.decided_by = ""
        self.request: DownlinkRequest | None = None
        self.blocked_by: tuple[str, ...] = ()
        self.base: float | None = None
        self.set_point: float | None = None
        self.programme: DownlinkProgramme | None = None
        self.transitions: list[Transition] = []
        self._since = self._started = -math.inf
        self._people_s: float | None = None
        self._waited = 0.0
        self._updated: float | None = None
        self._steady: deque[tuple[float, float]] = deque()
        self._stall = StallWatch(settings.stall_share)
        self._deviation: DeviationWatch | None = None

    # Actions of people.

    def draft(self, name: str, value: float, by: str, now: float) -> str:
        """
        Compose a command; return a description of its programme (the sequence of symbols).

        Raises
        ------
        ValueError
            Another downlink is under way, no person is named, or the tool has no such command or value.
        """
        if self.state not in ENDED | {DownlinkState.IDLE, DownlinkState.DRAFT}:
            raise ValueError(f"a downlink is {self.state.name.lower()} already, and only one can run: abort it first")
        if not by.strip():
            raise ValueError("operator_name: must not be empty: the journal records who asked")
        number, argument = tool_commands.command(self.tool, name, value)
        frame, _ = self.echo.numbered(DownlinkFrame(1, number, argument), self.counter)
        # Raise here if the command is not valid in combination with the earlier commands.
        tool_commands.applied(self.tool, self.in_force.after(frame))
        self.request, self.programme = DownlinkRequest(frame, name, value, by.strip()), programme(frame, self.downlink)
        self.number += 1
        self.decided_by, self.base, self.blocked_by = "", None, ()
        text = (
            f"{self.about}: {len(self.programme.symbols)} symbols of {self.downlink.medium}, down to "
            f"{100.0 * self.programme.lowest:.0f} %, {self.programme.duration_s:.0f} s"
        )
        self._go(DownlinkState.DRAFT, text, self.request.by, now)
        return text

    def submit(self, by: str, now: float, number: int = 0) -> str:
        """
        Ask for permission to send the draft; return the reason of the new state as text.

        number: number of the draft; 0 stands for the present draft, whatever its number is.

        Raises
        ------
        ValueError
            There is no draft, or the draft has another number.
        """
        self._require(DownlinkState.DRAFT, "there is no draft to submit")
        self._require_number(number or self.number)
        return self._go(DownlinkState.PENDING, f"{self.about}: request {self.number} waits for permission", by, now)

    def decide(self, granted: bool, by: str, now: float, number: int = 0) -> str:
        """
        Grant or deny the request; return the reason of the new state as text.

        number: number of the request, as the page showed it to the person. To deny a request, 0 may stand for the
        present one. To grant it, the number is required, so that nobody grants a request that has replaced the one on
        the page.

        Raises
        ------
        ValueError
            No request waits for permission, the request has another number, or no person is named.
        """
        self._require(DownlinkState.PENDING, "no downlink waits for permission")
        self._require_number(number if granted else number or self.number)
        if not by.strip():
            raise ValueError("operator_name: must not be empty: permission is given by a named person")
        self.decided_by = by.strip()
        if granted:
            text = "granted: the command starts as soon as all interlocks allow it"
            return self._go(DownlinkState.GRANTED, text, self.decided_by, now)
        return self._go(DownlinkState.DENIED, "denied", self.decided_by, now)

    def abort(self, reason: str, by: str, now: float) -> str:
        """
        End the downlink under way, at any time; return the reason as text.

        The rig returns to the driller's settings.

        Raises
        ------
        ValueError
            No downlink is under way.
        """
        if DownlinkState.ABORTED not in NEXT[self.state]:
            raise ValueError("no downlink is under way")
        self.decided_by = by.strip() or self.decided_by
        sent = ": the command had been sent, the tool may obey it" if self.state == DownlinkState.SENT else ""
        return self._go(DownlinkState.ABORTED, reason + sent, self.decided_by, now)

    # Updates from time, rig and tool.

    def update(self, now: float, readings: InterlockReadings, people_s: float | None = None) -> None:
        """
        Process the readings of the rig; call this method at least once per second.

        people_s: time on the clock by which the permission lapses; by default `now`. Give it if `now` is the time of
        a rig that is simulated faster than real time.
        """
        readings = possible(readings)
        people_s = now if people_s is None else people_s
        self._waited += 0.0 if self._people_s is None else people_s - self._people_s
        self._people_s = people_s
        lost = self._updated is not None and now - self._updated > _LOST_S
        self._updated = now
        self._stall.take(now, readings.flow, readings.pressure, 1e-3)
        if self.state == DownlinkState.PENDING and self._waited > PERMISSION_S:
            self._go(DownlinkState.LAPSED, f"nobody decided within {PERMISSION_S:.0f} s", "", now)
        elif self.state in (DownlinkState.GRANTED, DownlinkState.ARMED):
            self._before(now, readings)
        elif self.state == DownlinkState.RUNNING:
            self._while_running(now, readings, lost=lost)
        elif self.state == DownlinkState.SENT and now - self._since > self.answer_s:
            self._go(DownlinkState.UNCONFIRMED, self._unanswered(), "", now)

    def on_echo(self, code: int, now: float) -> None:
        """
        Process an accepted telemetry word in which the tool repeats the last command that it received (the echo).

        The echo confirms the present command only if the tool could not have sent this echo before that command.
        """
        request = self.request
        self.echo.hear(code, now, self.answer_s)
        if (
            request is None
            or self.state not in (DownlinkState.SENT, DownlinkState.UNCONFIRMED)
            or code != request.frame.echo
        ):
            return
        # The echo shows the last command that the tool obeyed, whenever the tool received it: update the settings.
        self.in_force = self.in_force.after(request.frame)
        if self._proves:
            text = f"{self.about}: the tool confirms counter {request.frame.counter}"
            self._go(DownlinkState.CONFIRMED, text, "", now)
        elif self.state == DownlinkState.SENT:
            text = (
                f"{self.about}: the tool repeats this command, or an earlier command with the same code whose answer "
                "is not known; send the command again to be certain"
            )
            self._go(DownlinkState.UNCONFIRMED, text, "", now)

    @property
    def about(self) -> str:
        """Description of the command; empty if there is no command."""
        return "" if self.request is None else tool_commands.about(self.tool, self.request.frame)

    @property
    def expected(self) -> ToolConfiguration | None:
        """Tool configuration that will hold after the command, while its answer is awaited; else None."""
        if self.request is None or self.state != DownlinkState.SENT:
            return None
        return tool_commands.applied(self.tool, self.in_force.after(self.request.frame))

    @property
    def answer_s(self) -> float:
        """
        Longest time from the last symbol to the answer, s.

        The time is enough to send the longest sequence twice, by the slower of two configurations, plus one symbol and
        the delay of receiver and depth. The configurations are the present one, and the commanded one while its answer
        is awaited, else the configuration of the tool as delivered.
        """
        slowest = 0.0
        for tool in (tool_commands.applied(self.tool, self.in_force), self.expected or self.tool):
            words_s = [tool.seconds(items) for items in (*tool.surveys, *tool.toolfaces)]
            slowest = max(slowest, tool.head_s + max(words_s))
        return 2.0 * slowest + self.downlink.symbol_s + _LATE_S

    def elapsed(self, now: float) -> float:
        """Return the time since the start of the first symbol, s: 0 before it, at most the programme's duration."""
        if self.programme is None or self.state not in (DownlinkState.RUNNING, DownlinkState.SENT):
            return 0.0
        return min(max(now - self._started, 0.0), self.programme.duration_s)

    def _before(self, now: float, readings: InterlockReadings) -> None:
        """
        Wait for the interlocks, then for a steady flow or speed, and start the command.

        The tool uses the steady value as the reference level. If waiting takes longer than `PERMISSION_S`, the
        permission lapses.
        """
        if self._waited > PERMISSION_S:
            self._go(DownlinkState.LAPSED, f"the permission has lapsed after {PERMISSION_S:.0f} s", "", now)
            return
        self.blocked_by = blocked(readings, self.downlink, self.settings, stalled=self._stall.stalled, running=False)
        value = medium_value(readings, self.downlink)
        if self.blocked_by or value is None:
            self._steady.clear()
            if self.state == DownlinkState.ARMED:
                self._go(DownlinkState.GRANTED, self.blocked_by[0], "", now)
            return
        if self.state == DownlinkState.GRANTED:
            text = "all interlocks allow the command: waiting for a steady flow or rotary speed"
            self._go(DownlinkState.ARMED, text, "", now)
        self._steady.append((now, value))
        values = [one for _, one in self._steady]
        if max(values) - min(values) > _STEADY * max(values):
            self._steady = deque([(now, value)])
        elif now - self._steady[0][0] >= self.downlink.symbol_s:
            self.base = sum(values) / len(values)
            self._deviation = self._watch(self.base, readings)
            self._started = now
            self.set_point = self.base
            self._number_request(now)
            self._go(DownlinkState.RUNNING, f"{self.about}: from {words(self.base, self.downlink)}", "", now)

    def _number_request(self, now: float) -> None:
        """
        Give the command its final counter when it starts, because an echo may have been received since the draft.

        The counter is stored with the transition that follows: after a crash of the surface, no other command may get
        the counter with which the tool may answer this command.
        """
        if self.request is None:
            return
        frame, self._proves = self.echo.numbered(self.request.frame, self.counter)
        self.request, self.programme = self.request._replace(frame=frame), programme(frame, self.downlink)
        self.counter = frame.counter
        self.echo.send(frame.echo, now + self.programme.duration_s + self.answer_s)

    def _watch(self, base: float, readings: InterlockReadings) -> DeviationWatch:
        turns, share = self.downlink.medium == ROTATION, self.settings.tolerance
        other, least = (readings.flow, _LEAST_FLOW) if turns else (readings.rotary_speed, _LEAST_SPEED)
        margin = share * max(abs(other or 0.0), least)
        return DeviationWatch(base, other, (share * base, margin), self.downlink.ramp_s)

    def _while_running(self, now: float, readings: InterlockReadings, *, lost: bool) -> None:
        if self.programme is None or self.base is None or self._deviation is None:
            return
        downlink = self.downlink
        self.blocked_by = blocked(readings, downlink, self.settings, stalled=self._stall.stalled, running=True)
        value = medium_value(readings, downlink)
        asked = self.base * self.programme.at(now - self._started)
        other = readings.flow if downlink.medium == ROTATION else readings.rotary_speed
        if lost:
            self.abort(f"the surface did not check the rig for {_LOST_S:.0f} s", "", now)
        elif self.blocked_by:
            self.abort(self.blocked_by[0], "", now)
        elif self._deviation.take(now, asked, value, other):
            self.abort("operator input: flow or rotation differs from the set-point", "", now)
        elif now - self._started >= self.programme.duration_s:
            self._go(DownlinkState.SENT, f"{self.about}: sent, waiting for the tool's answer", "", now)
        else:
            self.set_point = asked

    def _unanswered(self) -> str:
        tool = tool_commands.applied(self.tool, self.in_force)
        items = [item for sequence in (*tool.surveys, *tool.toolfaces) for item in sequence]
        if not any(item.name.lower() == ECHO_WORD.lower() for item in items):
            return f"sent; the tool cannot answer: add {ECHO_WORD} to a sequence of its tool.yaml"
        return f"sent, but the tool did not answer within {self.answer_s:.0f} s: send it again"

    def _require(self, state: DownlinkState, text: str) -> None:
        if self.state != state:
            raise ValueError(text)

    def _require_number(self, number: int) -> None:
        if number != self.number:
            which = f"request {number} was replaced" if number else "number: must be the number of the present request"
            raise ValueError(f"{which}; the present request is {self.number}: {self.about}")

    def _go(self, after: DownlinkState, reason: str, by: str, now: float) -> str:
        if after not in NEXT[self.state]:
            raise ValueError(f"state: {after.name} cannot follow {self.state.name}")
        self.transitions.append(Transition(self.number, self.state, after, reason, by, now))
        self.state, self.reason, self._since = after, reason, now
        if after == DownlinkState.PENDING or (after == DownlinkState.GRANTED and by):
            self._waited = 0.0
        if after not in (DownlinkState.GRANTED, DownlinkState.ARMED, DownlinkState.RUNNING):
            self.blocked_by = ()
        if after != DownlinkState.RUNNING:
            self.set_point = None
        if after in (DownlinkState.GRANTED, DownlinkState.ARMED):
            self._steady.clear()
        return reason


# Detector of operator input: flow or rotation that differs from the downlink's set-point.


_HELD_S = 2.0  # time for which a deviation must last, s


class DeviationWatch:
    """
    Comparison of the rig's readings with the set-points; speeds in rad/s, flows in m^3/s.

    Parameters
    ----------
    base : float
        Rotary speed or flow during drilling, from which the downlink starts.
    other : float or None
        Initial value of the quantity that the downlink does not change; None: unknown, this quantity is not compared.
    margins : (float, float)
        Allowed deviation of the changed and of the unchanged quantity.
    lag_s : float
        Longest delay with which the rig follows a set-point.
    """

    def __init__(self, base: float, other: float | None, margins: tuple[float, float], lag_s: float) -> None:
        self._other, self._lag = other, lag_s
        self._margin, self._other_margin = margins
        self._asked: deque[tuple[float, float]] = deque([(-lag_s, base)])
        self._off_since: float | None = None

    def take(self, now: float, asked: float, value: float | None, other: float | None) -> bool:
        """
        Add set-point and readings at a steady time, s; return whether a reading has been outside its margin for 2 s.

        asked, value: set-point and reading of the quantity that the downlink changes. other: reading of the quantity
        that the downlink does not change.
        """
        self._asked.append((now, asked))
        # Keep the last set-point that is older than the delay: the rig may still follow that set-point.
        while len(self._asked) > 1 and self._asked[1][0] < now - self._lag:
            self._asked.popleft()
        recent = [one for _, one in self._asked]
        off = value is not None and not min(recent) - self._margin <= value <= max(recent) + self._margin
        if self._other is not None and other is not None:
            off = off or abs(other - self._other) > self._other_margin
        if not off:
            self._off_since = None
            return False
        self._off_since = now if self._off_since is None else self._off_since
        return now - self._off_since >= _HELD_S

# SPDX-License-Identifier: Apache-2.0
"""Messages in a recording from the surface node itself: alarms, events, list, inputs, advice, and states."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.unknown import or_none
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.recorder.status import RecorderState, RecorderStatus
from mwd_surface.control.set_point import LeaseLimits, Mode
from mwd_surface.control.status import Achieved, ControlState, ControlStatus, Reaction
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import HAND, Clock, InputState, InputTable, Role
from mwd_surface.live.survey_book import SurveyBook, outcome
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.message_conversion import advice_of, list_of

# Topics of the surface node itself that tell what the page shows.
SAID = frozenset(
    {
        "alarms",
        "events",
        "surveys",
        "inputs",
        "steering/advice",
        "recorder",
        "control/state",
        "downlink/state",
    }
)
_MOST_EVENTS = 1000
_AGAIN_NS = 1_500_000_000  # two lists of inputs that place a depth by hand closer than this mean the same one


class SaidByTheSurface:
    """
    Show the messages that a surface node published while it was recorded.

    Parameters
    ----------
    context : WellContext
    book : SurveyBook
        Takes the survey list, and the depth that a person had set.
    on_outcome : callable
        Called with the outcome of a survey, in words, once the list shows it.
    on_depth_by_hand : callable
        Called with the depth that a person had set, m.
    topics : collection of str
        Those of `SAID` that come as messages.

    Attributes
    ----------
    handlers : dict
        From topic to the function that takes its messages.
    shown_ns : int
        When the page showed the message that comes next, ns since the epoch.
    alarms, lists, advises, tells_inputs : bool
        Whether alarms, the survey list, the advice on steering, and the inputs come as messages.
    """

    def __init__(
        self,
        context: WellContext,
        book: SurveyBook,
        on_outcome: Callable[[str], None],
        on_depth_by_hand: Callable[[float], None],
        topics: Collection[str] = (),
    ) -> None:
        self._clock, self._live, self._book = context.clock, context.live, book
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        self.shown_ns = self._clock.now_ns
        self._alarms: tuple[tuple[Alarm, ...], int, tuple[str, ...]] | None = None
        self._by_hand_ns: int | None = None
        self._on_outcome, self._on_depth_by_hand = on_outcome, on_depth_by_hand
        self._awaited: Survey | None = None
        every: dict[str, Callable[[Any], None]] = {
            "alarms": self._on_alarms,
            "events": self._on_event,
            "surveys": self._on_list,
            "inputs": self._on_inputs,
            "steering/advice": lambda message: self._live.on_advice(advice_of(message), self._now),
            "recorder": lambda message: self._live.on_recorder(recorder_status_of(message), self._now),
            "control/state": lambda message: self._live.on_control(control_status_of(message), self._now),
            "downlink/state": lambda message: self._live.on_downlink(downlink_status_of(message), self._now),
        }
        self.handlers = {topic: take for topic, take in every.items() if topic in topics}
        self.alarms, self.lists = "alarms" in topics, "surveys" in topics
        self.advises, self.tells_inputs = "steering/advice" in topics, "inputs" in topics

    def on_survey(self, survey: Survey) -> None:
        """Wait for the list that shows whether this survey was accepted."""
        self._awaited = survey
        self._tell_outcome()

    def _tell_outcome(self) -> None:
        survey = self._awaited
        if survey is None:
            return
        for record in self._book.surveys.records:
            if record.survey.uuid == survey.uuid:
                self._awaited = None
                self._on_outcome(outcome(survey, record))
                return

    def _on_alarms(self, message: Any) -> None:
        stamp_ns = stamp_of(message.header.stamp)
        # A graph with simulated time stamps its alarms with that time.
        now_ns = stamp_ns if abs(stamp_ns - self.shown_ns) > NANOSECONDS else self.shown_ns
        missing = tuple(str(one) for one in message.not_evaluated)
        self._alarms = tuple(alarm_of(one) for one in message.alarms), now_ns - self.shown_ns, missing
        self._show_alarms()

    def _show_alarms(self) -> None:
        if self._alarms is not None:
            alarms, ahead_ns, missing = self._alarms
            now_ns = self.shown_ns + ahead_ns
            self._live.on_alarms(alarms, tuple(reversed(self._events)), self._now, now_ns, missing)

    @property
    def _now(self) -> float:
        return self._clock.seconds(self.shown_ns)

    def _on_event(self, message: Any) -> None:
        stamp_ns, severity = stamp_of(message.header.stamp), int(message.severity)
        self._events.append(Event(stamp_ns, str(message.kind), str(message.source), str(message.text), severity))
        self._show_alarms()

    def _on_list(self, message: Any) -> None:
        here = self._book.surveys
        self._book.on_list(list_of(message, here.well, here.rules))
        self._tell_outcome()

    def _on_inputs(self, message: Any) -> None:
        table = input_table_of(message)
        self._live.on_inputs(table, self._now)
        hand = table.named(HAND)
        if hand is None or hand.bit_depth is None or hand.data_age is None:
            return
        set_ns = stamp_of(message.header.stamp) - round(hand.data_age * NANOSECONDS)
        # A depth is told at the moment at which it is set; a recording that begins later has its age.
        known = self._by_hand_ns is not None and abs(set_ns - self._by_hand_ns) <= _AGAIN_NS
        if hand.data_age == 0.0 or not known:
            self._on_depth_by_hand(hand.bit_depth)
            self._book.depth.set_by_hand(set_ns, hand.bit_depth)
        self._by_hand_ns = set_ns


def alarm_of(message: Any) -> Alarm:
    """Return the Alarm of a mwd_msgs/Alarm."""
    fields = ("id", "severity", "text", "remedy", "active", "acknowledged", "acknowledged_by", "count")
    values = {name: getattr(message, name) for name in fields}
    return Alarm(raised_ns=stamp_of(message.raised), last_ns=stamp_of(message.last), **values)


def input_table_of(message: Any) -> InputTable:
    """Return the InputTable of a mwd_msgs/InputList."""
    rows = tuple(
        InputState(
            name=str(row.name),
            clock=Clock(row.clock),
            clock_offset=or_none(row.clock_offset),
            offset_age=or_none(row.offset_age),
            data_age=or_none(row.data_age),
            role=Role(row.role),
            priority=int(row.priority),
            bit_depth=or_none(row.bit_depth),
            reason=str(row.reason),
        )
        for row in message.inputs
    )
    return InputTable(rows, str(message.depth_source), or_none(message.depth_age), or_none(message.depth_difference))


def recorder_status_of(message: Any) -> RecorderStatus:
    """Return the RecorderStatus of a mwd_msgs/RecorderStatus; what only the recorder itself knows is 0."""
    return RecorderStatus(
        state=RecorderState(message.state),
        reason=str(message.reason),
        path=Path(message.path) if message.path else None,
        messages=int(message.messages),
        bytes=int(message.bytes),
        dropped=int(message.dropped),
        queued_messages=0,
        queued_bytes=0,
        queue_limit=0,
        free_bytes=float(message.free_bytes),
        duration_s=float(message.duration),
        files=0,
        unsaved_s=0.0,
        recovered=(),
    )


def control_status_of(message: Any) -> ControlStatus:
    """Return the ControlStatus of a mwd_msgs/ControlState."""
    same = (
        *("enabled", "lease", "owner", "role", "priority", "pending", "pending_controller", "pending_reason"),
        *("reason", "rotary_speed", "turn", "sequence", "acknowledged", "refusal", "mwd_alive"),
    )
    reactions = ("controller_lost_sliding", "controller_lost_rotating", "mwd_lost_sliding", "mwd_lost_rotating")
    limits = (f"{name}_limit" for name in ("speed", "speed_rate", "torque", "turn", "flow"))
    return ControlStatus(
        **{name: getattr(message, name) for name in same},
        state=ControlState(message.state),
        heartbeat_age=or_none(message.heartbeat_age),
        remaining=or_none(message.remaining),
        limits=LeaseLimits(*(float(getattr(message, name)) for name in limits)),
        mode=Mode(message.mode),
        flow_rate=or_none(message.flow_rate),
        achieved=Achieved(
            or_none(message.achieved_speed), or_none(message.achieved_torque), or_none(message.achieved_flow)
        ),
        reactions={name: Reaction(getattr(message, name)) for name in reactions},
    )


def downlink_status_of(message: Any) -> DownlinkStatus:
    """Return the DownlinkStatus of a mwd_msgs/DownlinkState; what the tool takes is not part of the message."""
    same = (
        *("number", "state", "command", "value", "argument", "counter", "about", "requested_by", "decided_by"),
        *("reason", "symbol", "symbols", "duration", "remaining"),
    )
    return DownlinkStatus(
        **{name: getattr(message, name) for name in same},
        medium=("flow", "rotation")[int(message.medium)],
        blocked_by=tuple(str(one) for one in message.blocked_by),
        base=or_none(message.base),
        set_point=or_none(message.set_point),
        in_force=tuple(int(one) for one in message.in_force),
    )

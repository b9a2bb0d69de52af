# SPDX-License-Identifier: Apache-2.0
"""Display of recorded messages of the surface node: alarms, events, survey list, inputs, advice, and states."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection
from typing import Any

from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.control.status import ControlStatus
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import HAND, InputTable
from mwd_surface.live.survey_book import SurveyBook, outcome
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import AlarmState
from mwd_surface.surveys.message_conversion import list_of
from mwd_surface.trajectory.advice import Advice

# Topics of the surface node itself whose content the page shows.
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
# Two lists of inputs have the same depth by hand if the times at which it was set differ by less than this, ns.
_AGAIN_NS = 1_500_000_000


class SaidByTheSurface:
    """
    Display of the messages that a surface node published while it was recorded.

    Parameters
    ----------
    book : SurveyBook
        Receives the survey list, and the depth that a person had set.
    on_outcome : callable
        Called with the outcome of a survey, in words, once the list shows it.
    on_depth_by_hand : callable
        Called with the depth that a person had set, m, and its age, s.
    topics : collection of str
        Topics of `SAID` that are in the recording.
    """

    def __init__(
        self,
        context: WellContext,
        book: SurveyBook,
        on_outcome: Callable[[str], None],
        on_depth_by_hand: Callable[[float, float], None],
        topics: Collection[str] = (),
    ) -> None:
        self._clock, self._live, self._book = context.clock, context.live, book
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        #: Time at which the page showed the next message, ns since the epoch; set by the caller.
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
            "steering/advice": lambda message: self._live.show(self._now, advice=Advice.from_message(message)),
            "recorder": lambda message: self._live.on_recorder(RecorderStatus.from_message(message), self._now),
            "control/state": lambda message: self._live.show(self._now, control=ControlStatus.from_message(message)),
            "downlink/state": lambda message: self._live.show(self._now, downlink=DownlinkStatus.from_message(message)),
        }
        #: Topic -> function that processes its messages.
        self.handlers = {topic: take for topic, take in every.items() if topic in topics}
        #: `alarms`, `lists`, `advises`, `tells_inputs`: whether alarms, the survey list, the advice on steering, and
        #: the inputs come as messages.
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
        # If the nodes use simulated time, their alarms have stamps in simulated time.
        now_ns = stamp_ns if abs(stamp_ns - self.shown_ns) > NANOSECONDS else self.shown_ns
        missing = tuple(str(one) for one in message.not_evaluated)
        self._alarms = tuple(map(Alarm.from_message, message.alarms)), now_ns - self.shown_ns, missing
        self._show_alarms()

    def _show_alarms(self) -> None:
        if self._alarms is not None:
            alarms, ahead_ns, missing = self._alarms
            shown = AlarmState(alarms, missing, (self.shown_ns + ahead_ns) / NANOSECONDS - self._now)
            self._live.show(self._now, alarms=shown, events=tuple(reversed(self._events)))

    @property
    def _now(self) -> float:
        return self._clock.seconds(self.shown_ns)

    def _on_event(self, message: Any) -> None:
        self._events.append(Event.from_message(message))
        self._show_alarms()

    def _on_list(self, message: Any) -> None:
        here = self._book.surveys
        self._book.on_list(list_of(message, here.well, here.rules))
        self._tell_outcome()

    def _on_inputs(self, message: Any) -> None:
        table = InputTable.from_message(message)
        self._live.show(self._now, inputs=table)
        hand = table.named(HAND)
        if hand is None or math.isnan(hand.bit_depth + hand.data_age):
            return
        set_ns = stamp_of(message.header.stamp) - round(hand.data_age * NANOSECONDS)
        # A depth is published with age 0 when it is set; a recording that begins later has the depth with a larger age.
        known = self._by_hand_ns is not None and abs(set_ns - self._by_hand_ns) <= _AGAIN_NS
        if hand.data_age == 0.0 or not known:
            self._on_depth_by_hand(hand.bit_depth, hand.data_age)
            self._book.set_depth_by_hand(set_ns, hand.bit_depth)
        self._by_hand_ns = set_ns

# SPDX-License-Identifier: Apache-2.0
"""
Live state of one well from its messages, in the order of their arrival.

The surface node passes the messages of its subscriptions, the viewer of a recording the recorded messages. Both get the
same state, because there is no other input. Messages are processed in cells of 50 ms that begin at whole seconds of the
time of arrival, and updates of once a second are at whole seconds, so that the state at a time does not depend on the
time at which the messages were passed.

The surface node itself publishes some topics: alarms, events, survey list, inputs, advice, and the states of recorder,
rig control and downlink. If a recording has such a topic, its messages are shown; otherwise the content is computed
here, as the node would have done.
"""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Callable, Collection, Iterable
from typing import Any

from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.message_record import UnknownNumberError
from mwd_sensors.core.wire import NANOSECONDS, RIG_VALID
from mwd_surface.live.diagnostics_monitor import DiagnosticsMonitor
from mwd_surface.live.input_monitor import InputMonitor
from mwd_surface.live.link_monitor import LinkMonitor
from mwd_surface.live.log_monitor import LogMonitor
from mwd_surface.live.plan_monitor import ClearanceMonitor, PlanMonitor
from mwd_surface.live.said import SaidByTheSurface
from mwd_surface.live.settings import LiveSettings, WellSettings
from mwd_surface.live.source_selection import SourceSelection
from mwd_surface.live.stream_decoder import RIG, StreamDecoder
from mwd_surface.live.supervision import SupervisionMonitor, not_evaluated
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.toolface import MAGNETIC
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import AlarmState, WellState
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.advice import Advice, AdviceBasis, AdvisorySettings, advise
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import DrilledStretch, SlideRules, SlideSheet, yields

CELL_NS = 50_000_000
_LINK_PERIOD = 2.0  # longest usual time between attitudes over a link, s
# Topics of the tool, and the topics that replace them if the tool is received over a telemetry link.
OVER_LINK = {"attitude": "link/attitude", "survey": "link/survey", "log": "link/log"}
_FROM_TOOL = ("gravity", "dynamics", "interference", "imu/temperature", "imu/mag", "imu/data_raw", "survey/revised")

Message = tuple[int, str, bytes]
# Sort key of messages: time of arrival, then topic, so that the result does not depend on the order of the calls.
_ARRIVED = operator.itemgetter(0, 1)


def live_settings(settings: WellSettings) -> LiveSettings:
    """Return the settings of the live state; over a link `estimator_period` is at least `_LINK_PERIOD`."""
    live = settings.live
    if settings.link.source == "direct":
        return live
    return dataclasses.replace(live, estimator_period=max(live.estimator_period, _LINK_PERIOD))


class LiveWell:
    """
    Live state of one well from its messages.

    Parameters
    ----------
    context : WellContext
        Shared objects of the well; the clock is at the time of the start.
    decode : callable
        `decode(topic, data)` returns a serialised message as an object with the fields of its type.
    full_name : str
        Full name of the surface node, with the namespace of the well.
    said : collection of str
        Topics of the surface node that come as messages; the content of its other topics is computed here.
    """

    def __init__(
        self,
        context: WellContext,
        settings: WellSettings,
        decode: Callable[[str, bytes], Any],
        *,
        book: SurveyBook,
        plan: PlanMonitor,
        full_name: str = "/surface",
        stretches: Iterable[DrilledStretch] = (),
        said: Collection[str] = (),
    ) -> None:
        self.context, self.settings, self.book, self.plan = context, settings, book, plan
        self.live, self.alarm_log, self.clock = context.live, context.alarm_log, context.clock
        #: Inclination, rad, below which the estimator gives the magnetic toolface; None while it is not known.
        self.vertical_limit: float | None = None
        self._outlet, self._decode = context.outlet, decode
        over_link = settings.link.source != "direct"
        self.live.show(self.clock.now, over_link=over_link)
        rig_sources = SourceSelection(settings.rig_sources)
        self.inputs = InputMonitor(context, rig_sources, link=over_link)
        self.live.moment = self.inputs.measured_at
        self.slides = SlideRecorder(context, settings.slides, stretches)
        self.decoder = StreamDecoder(
            context,
            rig_sources,
            on_attitude=self.slides.on_attitude,
            on_rig_state=self._on_rig_state,
            on_sonde=self._on_sonde,
            on_rig_input=self.inputs.on_rig_input,
        )
        self.diagnostics = DiagnosticsMonitor(context, full_name, settings.link.source)
        self._supervision = SupervisionMonitor(context)
        self._link = LinkMonitor(context, settings.link.source, on_gauge=self.inputs.on_gauge)
        self.logs = LogMonitor(context, book, settings.link.source)
        self._clearance = ClearanceMonitor(context, plan)
        self._advice = AdviceMonitor(context)
        self._said = SaidByTheSurface(context, book, self.diagnostics.survey_ended, self._use_depth_by_hand, said)
        self._shown_alarms: tuple[int, tuple[str, ...]] = (-1, ())
        self._waiting: list[Message] = []
        self._in_cell = False
        self._handlers = self._handlers_of(over_link=over_link)
        #: Topics whose messages are used, relative to the well.
        self.topics = frozenset({*self._handlers, *self._supervision.topics})

    def _handlers_of(self, *, over_link: bool) -> dict[str, Callable[[bytes], None]]:
        """Return the function that processes the serialised messages of each topic."""

        def decoded(topic: str, take: Callable[[Any], None]) -> Callable[[bytes], None]:
            return lambda data: take(self._decode(topic, data))

        handlers: dict[str, Callable[[bytes], None]] = {
            topic: buffer.append for topic, buffer in self.decoder.buffers.items()
        }
        of_messages: dict[str, Callable[[Any], None]] = {
            "survey": self._on_survey,
            "survey/revised": self._on_revision,
            "log": self.logs.on_sample,
            "/diagnostics": self.diagnostics.on_diagnostics,
            "heartbeat": self._supervision.on_heartbeat,
            "rig/quill": self.slides.on_quill,
            "link/word": self._link.on_word,
            "link/frame": self._link.on_frame,
            "link/quality": self._link.on_quality,
            "rig/strokes": self._link.on_strokes,
            **self._said.handlers,
        }
        if over_link:
            handlers = {OVER_LINK.get(topic, topic): take for topic, take in handlers.items()}
            of_messages = {OVER_LINK.get(topic, topic): take for topic, take in of_messages.items()}
        handlers |= {topic: decoded(topic, take) for topic, take in of_messages.items()}
        handlers["rig/standpipe"] = self._link.on_pressure
        if over_link:
            handlers = {topic: take for topic, take in handlers.items() if topic not in _FROM_TOOL}
        return handlers

    def begin(self, now_ns: int) -> None:
        """
        Continue at a later time, ns, before which no message arrived.

        The updates of the whole seconds in between are skipped.
        """
        self.clock.now_ns = max(self.clock.now_ns, now_ns - now_ns % CELL_NS)

    # Messages, and depths by hand.

    def on_depth_by_hand(self, bit_depth: float, age: float) -> None:
        """Accept a bit depth, m, that a person set `age` seconds ago; publish and show the inputs at once."""
        self._use_depth_by_hand(bit_depth, age)
        self.inputs.update(self.clock.now)

    def _use_depth_by_hand(self, bit_depth: float, age: float) -> None:
        self.inputs.on_depth_by_hand(bit_depth, age)
        self.slides.on_depth_by_hand()

    def put(self, topic: str, data: bytes, arrived_ns: int) -> None:
        """Add a message that waits to be processed: topic relative to the well, bytes, and time of arrival, ns."""
        self._waiting.append((arrived_ns, topic, data))

    @property
    def next_arrival_ns(self) -> int:
        """
        Earliest time of arrival, ns, with which a message can still be processed.

        Messages that the surface node itself publishes now get this time. While a cell is processed, this is the end of
        that cell; between two cells, the first instant of the next cell.
        """
        return self.clock.now_ns + (0 if self._in_cell else 1)

    def advance(self, until_ns: int) -> None:
        """Process the messages that arrived up to a time, ns, in whole cells; later messages wait."""
        self._in_cell = True
        try:
            self._advance(until_ns - until_ns % CELL_NS)
        finally:
            self._in_cell = False

    def _advance(self, last: int) -> None:
        self._waiting.sort(key=_ARRIVED)
        waiting, self._waiting, taken = self._waiting, [], 0
        while self.clock.now_ns < last:
            end = self._next_end(waiting[taken][0] if taken < len(waiting) else last, last)
            self.clock.now_ns = end
            while taken < len(waiting) and waiting[taken][0] <= end:
                arrived_ns, topic, data = waiting[taken]
                # The page shows a message of the surface from the start of the time cell in which it was published.
                self._said.shown_ns = arrived_ns - arrived_ns % CELL_NS
                self._dispatch(topic, data)
                taken += 1
            self.decoder.decode_all(self.clock.now)
            if end % NANOSECONDS == 0:
                self._update_once_a_second()
        self._waiting = waiting[taken:] + self._waiting

    def _next_end(self, arrival_ns: int, last: int) -> int:
        """Return the end of the next cell with a message, ns, at most the next whole second; skip empty cells."""
        now = self.clock.now_ns
        following = now - now % CELL_NS + CELL_NS
        of_arrival = -(-arrival_ns // CELL_NS) * CELL_NS
        second = now - now % NANOSECONDS + NANOSECONDS
        return max(following, min(of_arrival, second, last))

    def _dispatch(self, topic: str, data: bytes) -> None:
        self._supervision.message_received(topic)
        handler = self._handlers.get(topic)
        if handler is not None:
            try:
                handler(data)
            except UnknownNumberError:
                # Skip this message only, so that later messages of the queue are still handled.
                self.decoder.unreadable += 1

    def _on_sonde(self, samples: Samples) -> None:
        self._supervision.on_sonde(samples)
        if not self.live.parts.over_link:
            self.inputs.on_sonde(samples)
        self.book.on_sonde(samples)

    def _on_rig_state(self, samples: Samples) -> Samples:
        paired, shown = self.inputs.in_force(samples)
        bit_depth = self.book.on_rig_state(paired)
        self.logs.on_rig_state(samples, bit_depth)
        self.slides.on_rig_state(paired, bit_depth, self.book.surveys.well.sensor_offset)
        self._outlet.on_rig_state(samples)
        return shown

    def _on_survey(self, message: Any) -> None:
        # The depth of a survey comes from the rig data received before it.
        self.decoder.decode(RIG, self.clock.now)
        survey = Survey.from_message(message)
        if self._said.lists:
            self._said.on_survey(survey)
        else:
            self.diagnostics.survey_ended(self.book.on_survey(survey))

    def _on_revision(self, message: Any) -> None:
        if not self._said.lists:
            self.book.on_revision(Survey.from_message(message))

    # Updates at whole seconds.

    def _update_once_a_second(self) -> None:
        now, book = self.clock.now, self.book
        self.live.on_vertical_limit(self.vertical_limit)
        self.diagnostics.update(now)
        self.inputs.update(now, shown=not self._said.tells_inputs)
        depths = self.inputs.table.depth_difference
        self._supervision.over_at, self._supervision.over_by = self.diagnostics.over_at, self.diagnostics.over_by
        self._supervision.update(now, book.depth.clock_difference, depths, self._outlet.readings())
        self._link.update()
        self.decoder.update(now)
        book.update_projection()
        self.logs.update(now)
        self._clearance.update(book.surveys, book.bit_depth)
        self.slides.update(now, book.surveys)
        if not self._said.advises:
            plan, stretches = self.plan.plan, self.slides.stretches()
            self._advice.update(now, self.settings.advisory, plan, book.surveys, book.bit_depth, stretches)
        if not self._said.alarms:
            self._show_alarms(now)

    def _show_alarms(self, now: float) -> None:
        log, missing = self.alarm_log, self.not_evaluated()
        if (log.version, missing) != self._shown_alarms:
            self._shown_alarms = (log.version, missing)
            stamp_ns = log.now_ns()
            self._outlet.on_alarms(log, missing, stamp_ns)
            alarms = AlarmState(log.alarms(), missing, stamp_ns / NANOSECONDS - now)
            self.live.show(now, alarms=alarms, events=log.events())

    def not_evaluated(self) -> tuple[str, ...]:
        """Return the kinds of alarms that could not be evaluated so far, because their inputs have not arrived."""
        return not_evaluated(
            self._supervision.heard, self._supervision.judged, over_link=self.settings.link.source != "direct"
        )

    def state(self) -> WellState:
        """Return the state at the end of the last cell that was processed."""
        return self.live.at(self.clock.now)


# Advice on steering: computed from plan, path and slide sheet, sent to rig systems, shown on the page.


class AdviceMonitor:
    """Monitor of the advice on steering of one well: computes, publishes and shows the advice when it changes."""

    def __init__(self, context: WellContext) -> None:
        self._live, self._outlet, self._clock = context.live, context.outlet, context.clock
        self._advice: Advice | None = None

    def update(
        self,
        now: float,
        settings: AdvisorySettings,
        plan: Plan | None,
        surveys: SurveyList,
        bit_depth: float | None,
        stretches: tuple[DrilledStretch, ...],
    ) -> None:
        """Publish and show the advice if it has changed; called once a second. now: steady time, s."""
        path = surveys.definitive(bit_depth=bit_depth)
        reading = self._live.toolface_reading
        magnetic = reading is not None and reading.mode == MAGNETIC
        advice = advise(
            settings, plan, path, yields(stretches, surveys.definitive()), _last_survey(surveys, magnetic=magnetic)
        )
        if advice == self._advice:
            return
        self._advice = advice
        # The message and the page get the same stamp, so that a viewer of the recording shows the same.
        advice = dataclasses.replace(advice, stamp_ns=self._clock.now_ns)
        self._live.show(now, advice=advice)
        self._outlet.on_advice(advice)


def _last_survey(surveys: SurveyList, *, magnetic: bool) -> AdviceBasis:
    last = max((r for r in surveys.records if r.in_use), key=lambda r: r.survey.stamp_ns, default=None)
    if last is None:
        return AdviceBasis(magnetic=magnetic)
    survey = last.survey
    return AdviceBasis(survey.sequence, survey.stamp_ns, survey.sigma_inclination, survey.sigma_azimuth, magnetic)


# Slide sheet of a well: intervals of sliding and rotating drilling with their toolface, and the quill's angle.


_ON_BOTTOM = 0.5  # largest distance of a drilling bit from the end of the hole, m
_ROTATING_SPEED = 10.0  # assumed rotary speed if only the attitude's status shows that the tool rotates, rad/s
_DEPTHS = RIG_VALID["bit_depth"] | RIG_VALID["hole_depth"]


class SlideRecorder:
    """
    Recorder of the slide sheet of one well.

    Parameters
    ----------
    earlier : iterable of DrilledStretch
        Intervals from earlier runs of the surface, oldest first.
    """

    def __init__(self, context: WellContext, rules: SlideRules, earlier: Iterable[DrilledStretch] = ()) -> None:
        self._clock, self._live, self._outlet = context.clock, context.live, context.outlet
        self._sheet = SlideSheet(rules, tuple(earlier))
        self._rotating = False
        self._shown: tuple[Any, ...] = ()

    def stretches(self) -> tuple[DrilledStretch, ...]:
        """Return the intervals recorded so far."""
        return self._sheet.stretches

    def on_attitude(self, samples: Samples) -> None:
        """Accept attitudes, `wire.ATTITUDE`, and keep from the last one whether the tool rotates."""
        self._rotating = bool(int(samples[-1]["status"]) & Status.ROTATING)

    def on_rig_state(self, samples: Samples, bit_depth: float | None, sensor_to_bit: float) -> None:
        """
        Accept rig data, `wire.RIG_STATE`; only the last sample is used.

        bit_depth: accepted bit depth, m; None without a bit depth, or if the last reading was not accepted.
        sensor_to_bit: distance along the hole from the sensor to the bit, m. Without bit depth or valid depths of bit
        and hole, and with the bit more than `_ON_BOTTOM` above the bottom of the hole, nothing is recorded.
        """
        last = samples[-1]
        valid = int(last["valid"])
        # Without a rotary speed of the rig, the status of the attitude shows whether the string rotates.
        speed = _ROTATING_SPEED if self._rotating else 0.0
        if valid & RIG_VALID["rotary_speed"]:
            speed = float(last["rotary_speed"])
        if bit_depth is None or valid & _DEPTHS != _DEPTHS or float(last["hole_depth"]) - bit_depth > _ON_BOTTOM:
            self._live.on_log_depth(None)
            return
        self._live.on_log_depth(bit_depth - sensor_to_bit)
        reading = self._live.toolface_reading
        known = reading is not None and math.isfinite(reading.angle)
        stretch = self._sheet.update(
            int(last["stamp_ns"]),
            bit_depth,
            speed,
            reading.angle if reading is not None and known else None,
            magnetic=reading is not None and reading.mode == MAGNETIC,
        )
        self._keep(stretch)

    def on_depth_by_hand(self) -> None:
        """Forget the last depth: the step to a depth set by a person is not drilled hole."""
        self._sheet.forget_depth()

    def finish(self) -> None:
        """End the current interval; the slide sheet continues after this interval when the surface is started again."""
        self._keep(self._sheet.finish())

    def _keep(self, stretch: DrilledStretch | None) -> None:
        if stretch is not None:
            self._outlet.on_stretch(stretch)

    def on_quill(self, message: Any) -> None:
        """Show the angle of the quill: the first joint of a sensor_msgs/JointState."""
        if len(message.position) and math.isfinite(message.position[0]):
            self._live.show(self._clock.now, quill=float(message.position[0]) % math.tau)

    def update(self, now: float, surveys: SurveyList) -> None:
        """
        Show the slide sheet and the yields between stations if they have changed; called once a second.

        now: steady time, s.
        """
        stretches = self._sheet.stretches
        state = (len(stretches), stretches[-1:], surveys.changed_ns, len(surveys.records))
        if state == self._shown:
            return
        self._shown = state
        self._live.show(now, stretches=tuple(stretches), yields=tuple(yields(stretches, surveys.definitive())))

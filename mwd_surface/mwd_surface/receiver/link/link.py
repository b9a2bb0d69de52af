# SPDX-License-Identifier: Apache-2.0
"""
Link at the surface: takes pressure, voltage or bytes; gives words, received surveys, attitude and the link's state.

Times are in s on the clock of the samples; `stamp_ns` turns them into stamps. The output does not depend on how the
samples are cut into blocks. `LinkSurveys` merges the surveys of all links into one list.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import deque
from collections.abc import Callable

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.units import LPM
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.switch import FLOW_HOLD_S, Switch
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import OFF, SURVEY_S, FlowSpans
from mwd_surface.receiver.link import other_width
from mwd_surface.receiver.link.link_attitude import AgeRules, LinkAttitude
from mwd_surface.receiver.link.link_survey import SETTLE_S, HeardSurvey, SurveyTime
from mwd_surface.receiver.link.other_width import OtherWidth
from mwd_surface.receiver.link.receivers import receiver_of
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.resampling import LARGEST
from mwd_surface.receiver.sampled_receiver import SampledReceiver
from mwd_surface.receiver.words import FrameReport, ReceivedWord, Reception, believed, item_of, no_words

NO_INPUT, NO_FLOW, SEARCHING, LOCKED, DOUBTFUL = range(5)
# Eb/N0 at which 19 of 20 words of 13 bits with parity are right (docs/benchmarks.md, limits of the code).
NEEDED_DB = 6.0
# Eb/N0 that is needed with a carrier, whose blocks have an error-correcting code (docs/benchmarks.md, link).
_NEEDED_DB = {"psk": 3.5}
_GOODPUT_S = 300.0  # time over which the rate of usable bits (goodput) is averaged, s
_JUDGED_WORDS = 40  # largest number of final words from which the state and the quality are judged
_NO_INPUT = {
    "mud": "no pressure arrives: look at the gauge and its cable",
    "earth": "no voltage arrives: look at the antenna and its cable",
    "coil": "no voltage arrives: look at the receiver of the sonde's field and its cable",
    "serial": "no bytes arrive: look at the line, its port and the power of the probe",
}


@dataclasses.dataclass(frozen=True)
class Quality:
    """State of a link; fields as in mwd_msgs/LinkQuality."""

    state: int
    reason: str
    needed_db: float = NEEDED_DB  #: Eb/N0 below which most words fail
    ebn0_db: float = math.nan
    clock_error: float = math.nan
    word_error: float = math.nan
    goodput: float = math.nan
    frame: int = 0
    words_done: int = 0
    words_expected: int = 0
    toolface_age: float = math.nan
    survey_age: float = math.nan
    inclination_age: float = math.nan
    azimuth_age: float = math.nan
    mode: str = ""


@dataclasses.dataclass
class LinkOutput:
    """Words, surveys and passes of sequences that a block of samples completed, in order of time."""

    words: list[ReceivedWord] = dataclasses.field(default_factory=list)
    frames: list[FrameReport] = dataclasses.field(default_factory=list)
    surveys: list[HeardSurvey] = dataclasses.field(default_factory=list)
    #: Each new state of the link with its begin, s; filled only by `LinkFeed`.
    states: list[tuple[float, Quality]] = dataclasses.field(default_factory=list)

    def add(self, more: LinkOutput) -> None:
        """Append the output of later samples."""
        self.words += more.words
        self.frames += more.frames
        self.surveys += more.surveys
        self.states += more.states


class Link:
    """
    One telemetry link with its receiver, flow detection, attitude and quality.

    Parameters
    ----------
    name : str
        mud_pulse, em, coil or serial.
    stamp_ns : callable
        Converts a time on the clock of the samples, s, to a stamp, ns.
    """

    def __init__(
        self,
        tool: ToolConfiguration,
        name: str,
        rules: AgeRules,
        stamp_ns: Callable[[float], int],
    ) -> None:
        self._tool, self.name = tool, name
        self._rules, self._stamp_ns = rules, stamp_ns
        self.flow = FlowSpans()
        self._tool_flow = ToolFlow(tool, self.flow)
        self._receiver = receiver_of(tool, self.flow)
        self._needed_db = _NEEDED_DB.get(tool.code, NEEDED_DB)
        self.attitude = LinkAttitude(rules)
        self._survey_words: dict[int, list[ReceivedWord]] = {}
        self._last_survey: SurveyTime | None = None
        self._last_frame: FrameReport | None = None
        self._last_word: ReceivedWord | None = None
        self._final: deque[ReceivedWord] = deque(maxlen=_JUDGED_WORDS)
        self._good: deque[tuple[float, int]] = deque()
        self._other = OtherWidth(tool) if tool.code == "mary" else None
        self.now_s = -math.inf

    @property
    def tool(self) -> ToolConfiguration:
        """Tool configuration with which the link reads."""
        return self._tool

    def successor(self, tool: ToolConfiguration) -> Link:
        """
        Return a link with another tool configuration that continues the flow, attitude and time of this link.

        If both configurations send pulses, the doubt learned from parities continues too.
        """
        after = Link(tool, self.name, self._rules, self._stamp_ns)
        after._tool_flow, after.attitude = copy.deepcopy(self._tool_flow), copy.deepcopy(self.attitude)
        after.flow = after._tool_flow.spans
        after.now_s, after._last_survey = self.now_s, self._last_survey
        if isinstance(self._receiver, PulseReceiver) and tool.code == "mary":
            after._receiver = self._receiver.successor(tool, after.flow)
        else:
            after._receiver = receiver_of(tool, after.flow)
        return after

    def push(self, time_s: Array, pressure_pa: Array) -> LinkOutput:
        """
        Add samples, shape (n,); return the output that they complete.

        time_s: rising times; pressure_pa: Pa, V for a link through the ground, or bytes of a serial line. Values
        that no gauge can measure count as missing samples.
        """
        time, value = np.asarray(time_s, dtype=float), np.asarray(pressure_pa, dtype=float)
        # Values that no gauge can measure become missing samples, here and once for all stages.
        value = np.where(np.abs(value) < LARGEST, value, np.nan)
        out = LinkOutput()
        # Cut by seconds, so that the search for another pulse width does not depend on how the samples arrive.
        seconds = np.flatnonzero(np.diff(np.floor(time))) + 1
        for part in np.split(np.arange(len(time)), seconds) if len(time) else ():
            out.add(self._push(time[part], value[part]))
        return out

    def _push(self, time: Array, value: Array) -> LinkOutput:
        """Add samples that lie within one second; return the output that they complete, as `push`."""
        if self._other is not None:
            self._other.push(time, value, self.flow.on_since(self.now_s), self._expected_s)
        if self._tool.medium == "mud":
            self.flow.push(time, value)
        self.now_s = max(self.now_s, float(time[-1]))
        out = self._use_words(self._receiver.push(time, value))
        if self._other is not None:
            _, last, final = self._heard()
            if any(word.usable for word in (last, *final) if word is not None):
                self._other.end()
        return out

    def take_strokes(self, pump: int, time_s: Array) -> None:
        """Add the counted strokes of a pump, shape (n,), s; a serial line ignores them."""
        if isinstance(self._receiver, SampledReceiver):
            self._receiver.strokes(pump, time_s)

    def take_flow(self, at_s: float, flow_rate: float | None) -> None:
        """Add the flow that the rig reports at a time, s; flow_rate: m^3/s, None if the rig reports no flow."""
        self._tool_flow.take(at_s, flow_rate)

    def finish(self) -> LinkOutput:
        """Return the output that is left when no more samples come."""
        return self._use_words(self._receiver.finish())

    def quality(self, *, silent: bool = False) -> Quality:
        """
        Return the state of the link at the newest sample.

        silent: whether the samples have stopped arriving.
        """
        state, reason = self._state(silent)
        frame, word, final = self._heard()
        mode = word.kind if word is not None and state in (LOCKED, DOUBTFUL) else ""
        sequence = self._tool.sequence(mode, 0) if mode else ()
        done = word.index + 1 if word is not None and mode else 0
        signal = not self._wired and state in (LOCKED, DOUBTFUL)
        return Quality(
            state=state,
            reason=reason,
            needed_db=self._needed_db,
            ebn0_db=frame.ebn0_db if frame is not None and signal else math.nan,
            clock_error=frame.clock_error if frame is not None and signal else math.nan,
            word_error=float(np.mean([1.0 - one.confidence for one in final])) if final else math.nan,
            goodput=sum(bits for _, bits in self._good) / _GOODPUT_S if self._good else math.nan,
            frame=word.frame if word is not None else 0,
            words_done=done,
            words_expected=len(sequence),
            toolface_age=self.attitude.toolface_age(self.now_s),
            survey_age=self._last_survey_age(),
            inclination_age=self.attitude.angle_age("inclination", self.now_s),
            azimuth_age=self.attitude.angle_age("azimuth", self.now_s),
            mode=mode,
        )

    @property
    def _wired(self) -> bool:
        """Whether the tool is on a wire, so that it sends with and without flow."""
        return self._tool.medium == "serial"

    def _last_survey_age(self) -> float:
        if self._last_survey is None:
            return math.nan
        return max((self._stamp_ns(self.now_s) - self._last_survey.stamp_ns) * 1e-9, 0.0)

    def _use_words(self, got: Reception) -> LinkOutput:
        out = LinkOutput(words=sorted([*got.provisional, *got.words], key=lambda one: (one.end_s, one.revision)))
        out.frames = got.frames
        for word in out.words:
            self.attitude.take(word)
            if word.usable:
                self._tool_flow.take_word(word.start_s)
            self._last_word = word if self._last_word is None or word.end_s > self._last_word.end_s else self._last_word
        for word in got.words:
            self._final.append(word)
            self._good.append((word.end_s, item_of(word, self._tool).bits if word.usable else 0))
            if word.kind == "survey":
                self._survey_words.setdefault(word.frame, []).append(word)
        while self._good and self._good[0][0] < self.now_s - _GOODPUT_S:
            self._good.popleft()
        for frame in got.frames:
            self._last_frame = frame
            if frame.kind == "survey":
                out.surveys += self._survey_of(self._survey_words.pop(frame.frame, []))
        return out

    def _survey_of(self, words: list[ReceivedWord]) -> list[HeardSurvey]:
        """Return a list with the survey in the words of one pass of a sequence; empty if no word is usable."""
        values = believed(words)
        if not values:
            return []
        self._last_survey = self._taken(words[0].start_s)
        return [HeardSurvey(self.name, self._last_survey, values)]

    def _taken(self, sent_s: float) -> SurveyTime:
        """
        Return the time of a survey whose words began at `sent_s`, s: in the last span without flow before `sent_s`.

        If this span is unknown, the time is the latest possible one. A tool on a wire takes a survey directly before
        `sent_s`.
        """
        if self._wired:
            # A tool on a wire sends a survey directly after taking it.
            return SurveyTime(self._stamp_ns(sent_s - 0.5 * SURVEY_S), 0.5 * SURVEY_S)
        span = self.flow.before(sent_s)
        if span is None:
            return SurveyTime(self._stamp_ns(sent_s - self._tool.transmit_delay_s), math.inf)
        half = 0.5 * (span.end_s - span.start_s)
        return SurveyTime(self._stamp_ns(span.start_s + min(half, SETTLE_S)), half)

    def _state(self, silent: bool) -> tuple[int, str]:
        if silent or math.isinf(self.now_s):
            return NO_INPUT, _NO_INPUT[self._tool.medium]
        frame, word, final = self._heard()
        if reason := self._tool_flow.silence(self.now_s):
            return NO_FLOW, reason
        if self._other is not None and self._other.found_s is not None:
            return DOUBTFUL, other_width.sentence(self._tool, self._other.found_s)
        on_since = self._tool_flow.on_since(self.now_s)
        longest = self._longest_s
        if word is not None and self.now_s - word.end_s < 4.0 * longest:
            return self._locked()
        if final and not self._tool.toolfaces:
            return self._survey_received([one for one in final if one.frame == final[-1].frame])
        if self._receiver.last_sync_s > on_since and self.now_s - self._receiver.last_sync_s < 4.0 * longest:
            return LOCKED, "sync found, the first words follow"
        return SEARCHING, self._nothing_found(on_since, frame)

    def _survey_received(self, words: list[ReceivedWord]) -> tuple[int, str]:
        """Return state and reason after the survey with these words, for a tool that sends only surveys."""
        count = max(len(words), min(len(items) for items in self._tool.surveys))
        good = sum(one.usable for one in words)
        if good == count:
            return LOCKED, "the survey was received, and the tool sends nothing more until the next flow-on"
        return (LOCKED if good * 2 > count else DOUBTFUL), (
            f"{good} of the {count} words of the survey were received, and the tool sends nothing more until the next"
            " flow-on"
        )

    def _nothing_found(self, on_since: float, frame: FrameReport | None) -> str:
        """Return why no sync or word is found although the tool may send; on_since: flow-on, s, -inf if not seen."""
        if math.isinf(on_since) and self._other is not None:
            command = " or a command" if self._tool.downlink is not None else ""
            turns = " or a change of rotation" if self._tool.header_bits else ""
            return f"the sync comes after flow-on{command}{turns}, and none was seen yet: wait for the next one"
        if self.now_s - on_since < self._expected_s:
            return f"waiting for the sync, {self._tool.transmit_delay_s:g} s after flow-on"
        reason = frame.reason if frame is not None else ""
        reason = reason or self._receiver.why_nothing().removeprefix(no_words(""))
        return "; ".join(filter(None, (reason, self._tool_flow.contradiction(self.now_s))))

    def _heard(self) -> tuple[FrameReport | None, ReceivedWord | None, list[ReceivedWord]]:
        """
        Return the last pass of a sequence, the last word and the final words, if they ended after flow-on, else None.

        The final words are a list, which may be empty. Older words do not describe the present.
        """
        since = self.flow.on_since(self.now_s)
        frame, word = self._last_frame, self._last_word
        return (
            frame if frame is not None and frame.end_s > since else None,
            word if word is not None and word.end_s > since else None,
            [one for one in self._final if one.end_s > since],
        )

    def _locked(self) -> tuple[int, str]:
        frame, _, final = self._heard()
        erased = [one for one in final if not one.usable]
        if len(final) >= 5 and len(erased) > 0.5 * len(final):
            return DOUBTFUL, "more than half of the words are uncertain: too much noise, or another tool configuration"
        if frame is not None and frame.ebn0_db < self._needed_db:
            return LOCKED, f"the signal is {self._needed_db - frame.ebn0_db:.1f} dB too weak for most words"
        return LOCKED, ""

    @property
    def _longest_s(self) -> float:
        """Longest time from one decoded word to the next, s."""
        items = [item for items in (*self._tool.surveys, *self._tool.toolfaces) for item in items]
        # Words are decoded in groups, after the response of the channel has passed.
        return max(4.0 * max(self._tool.seconds((item,)) for item in items), 1.0)

    @property
    def _expected_s(self) -> float:
        """Time after flow-on by which the first words should have come, s."""
        return self._tool.transmit_delay_s + self._tool.head_s + 2.0 * self._longest_s


# Decision whether the tool is silent because of the flow, from the pressure, the rig's flow and the received words.


# Greatest age of a reported flow that is used, s; rigs report the flow every second or every few seconds.
_FRESH_S = 5.0
# Lowest ratio of flow to the tool's threshold at which the pressure can still show running pumps. The pumps count as on
# from OFF times the pressure while the tool sends, and friction varies with flow**1.75 (turbulent, Blasius).
_LEAST_SHARE = OFF ** (1.0 / 1.75)
_OFF = "the pumps are off, or their flow is below the tool's threshold: the tool is silent"


class ToolFlow:
    """
    Flow relative to the threshold of the tool.

    Parameters
    ----------
    spans : FlowSpans
        Spans without flow; for a link through the earth this class adds them from the rig's flow.
    """

    def __init__(self, tool: ToolConfiguration, spans: FlowSpans) -> None:
        self._tool, self.spans = tool, spans
        self._switch: Switch | None = None
        # Time of the last flow that the rig reported, and time at which the flow reached its present side of the
        # threshold, s; -inf if unknown.
        self._at_s = self._since_s = -math.inf
        # Newest flow on the accepted side of the threshold, m^3/s; and whether the newest reported flow is on the other
        # side, but not yet for long enough to be accepted.
        self._rate, self._changing = 0.0, False
        self._word_s = -math.inf

    def take(self, at_s: float, rate: float | None) -> None:
        """
        Add the flow that the rig reports at a time, s; rate: m^3/s, None or NaN if the rig reports no flow.

        For a link through the earth a change of side also begins or ends a span without flow.
        """
        if rate is None or not math.isfinite(rate):
            self._at_s = -math.inf
            return
        above = rate > self._tool.flow_threshold
        if self._switch is None:
            self._switch = Switch(round(FLOW_HOLD_S * NANOSECONDS), on=above)
            self._since_s, changed = -math.inf if above else at_s, True
        else:
            changed = self._switch.update(round(at_s * NANOSECONDS), above)
            self._since_s = self._switch.since_ns / NANOSECONDS if changed else self._since_s
        self._at_s, self._changing = at_s, above != self._switch.on
        self._rate = self._rate if self._changing else rate
        if changed and self._tool.medium in ("earth", "coil"):
            self.spans.switch(self._since_s, above)

    def take_word(self, start_s: float) -> None:
        """Record that a usable word began at a time, s."""
        self._word_s = max(self._word_s, start_s)

    def on_since(self, now_s: float) -> float:
        """Return the earliest time since which the tool may have enough flow, s; -inf if the flow-on was not seen."""
        return max(self.spans.on_since(now_s), self._since_s if self._above(now_s) else -math.inf)

    def silence(self, now_s: float) -> str:
        """
        Return why the tool sends nothing now; empty if it may send.

        It may send if it is on a wire, if pressure and the rig's flow do not show that the flow is low, or if a usable
        word began after they showed this.
        """
        if self._tool.medium == "serial":
            return ""
        above, pumping = self._above(now_s), self._pumping(now_s)
        low = above is False and not self.contradiction(now_s)
        off_s = self.spans.spans[-1].start_s if pumping is False else -math.inf
        if not (low or pumping is False) or self._word_s > max(off_s, self._since_s if low else -math.inf):
            return ""
        if pumping is False:
            return self.contradiction(now_s) or _OFF
        return (
            f"the flow of {self._rate / LPM:.0f} l/min is below the tool's threshold of"
            f" {self._tool.flow_threshold_lpm:g} l/min: the tool is silent"
        )

    def contradiction(self, now_s: float) -> str:
        """Return how pressure and the rig's flow contradict each other now; empty if they agree or one is unknown."""
        above, pumping = self._above(now_s), self._pumping(now_s)
        reported = f"the rig reports a flow of {self._rate / LPM:.0f} l/min"
        if above is False and pumping and self._rate < _LEAST_SHARE * self._tool.flow_threshold:
            return f"{reported} although the pressure is that of running pumps: look at the flow meter"
        if above and pumping is False and not self._changing:
            return f"{reported} although there is no pressure of running pumps: look at the gauge and its valve"
        return ""

    def _above(self, now_s: float) -> bool | None:
        """Return whether the rig's flow is above the threshold; None if there is no recent flow."""
        return self._switch.on if self._switch is not None and now_s - self._at_s < _FRESH_S else None

    def _pumping(self, now_s: float) -> bool | None:
        """Return whether the pumps are on by the pressure; None if unknown."""
        return self.spans.flowing(now_s) if self._tool.medium == "mud" else None

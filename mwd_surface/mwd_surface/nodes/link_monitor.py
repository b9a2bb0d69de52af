# SPDX-License-Identifier: Apache-2.0
"""The link of the well for page and rig: words, passes and quality as they arrive."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Callable

from mwd_msgs import msg
from rclpy.serialization import deserialize_message

from mwd_sensors.core import gauge_burst
from mwd_surface.live.alarms import Severity
from mwd_surface.live.link_state import (
    DOUBTFUL,
    NO_INPUT,
    LinkCollector,
    LinkFrameState,
    LinkStatus,
    LinkWordState,
    best_link,
)
from mwd_surface.live.pressure_picture import PressureHistory
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.message_conversion import stamp_of

_STROKES = 30  # over which the rate of a pump is taken
_FIELDS = (
    *("link", "state", "reason", "has_signal", "ebn0_db", "margin_db", "clock_error", "word_error", "goodput"),
    *("mode", "words_done", "words_expected", "toolface_age", "survey_age"),
)


class LinkMonitor:
    """
    Takes the messages of the links in use and shows the state of the one that is best, and of the others beside it.

    Parameters
    ----------
    context : SurfaceContext
    source : str
        `link.source`: one link, or best of all.
    on_gauge : callable
        Called with the stamp, ns, of the newest sample of a link's gauge.

    Attributes
    ----------
    handlers : dict
        From topic to the function that is called with each serialised message.
    """

    def __init__(self, context: SurfaceContext, source: str, *, on_gauge: Callable[[int], None]) -> None:
        self._on_gauge = on_gauge
        self._live, self._alarm_log, self._source = context.live, context.alarm_log, source
        self._collectors: dict[str, LinkCollector] = {}
        self._qualities: dict[str, LinkStatus] = {}
        self._shown = ""
        self._pressure = PressureHistory()
        self._strokes: dict[int, deque[int]] = {}
        self.handlers: dict[str, Callable[[bytes], None]] = {
            "link/word": self._on_word,
            "link/frame": self._on_frame,
            "link/quality": self._on_quality,
            "rig/standpipe": self._on_pressure,
            "rig/strokes": self._on_strokes,
        }

    def _collector(self, link: str) -> LinkCollector | None:
        """What collects the words of a link; None where it is not one that is in use."""
        return self._collectors.setdefault(link, LinkCollector()) if self._source in (link, "best") else None

    def _on_word(self, data: bytes) -> None:
        word = deserialize_message(data, msg.LinkWord)
        collector = self._collector(word.link)
        if collector is None:
            return
        collector.on_word(
            LinkWordState(
                name=word.name,
                value=word.value,
                sigma=word.sigma,
                unit=word.unit,
                confidence=word.confidence,
                status=word.status,
                kind=word.kind,
                frame=word.frame,
                place=word.place,
                revision=word.revision,
                start_ns=stamp_of(word.start),
                end_ns=stamp_of(word.header.stamp),
                pulses=tuple(word.pulses.tolist()),
                alternatives=tuple(zip(word.alternatives.tolist(), word.alternative_odds.tolist(), strict=True)),
            )
        )
        self._show()

    def _on_frame(self, data: bytes) -> None:
        frame = deserialize_message(data, msg.LinkFrame)
        collector = self._collector(frame.link)
        if collector is None:
            return
        collector.on_frame(
            LinkFrameState(
                kind=frame.kind,
                frame=frame.frame,
                words=frame.words,
                believed=frame.believed,
                ebn0_db=frame.ebn0_db,
                start_ns=stamp_of(frame.start),
                end_ns=stamp_of(frame.header.stamp),
                reason=frame.reason,
            )
        )
        self._show()

    def _on_quality(self, data: bytes) -> None:
        quality = deserialize_message(data, msg.LinkQuality)
        if self._collector(quality.link) is None:
            return
        self._qualities[quality.link] = LinkStatus(
            **{name: getattr(quality, name) for name in _FIELDS},
            stamp_ns=stamp_of(quality.header.stamp),
            at=time.monotonic(),
            pump_lines=self._stroke_rates(),
            picture=self._pressure.picture(),
        )
        causes = {}
        for link, one in self._qualities.items():
            # Before the first samples nothing is wrong yet: the rig may be about to start.
            if one.state == DOUBTFUL or (one.state == NO_INPUT and one.stamp_ns):
                only = len(self._qualities) == 1
                severity = Severity.CRITICAL if one.state == NO_INPUT and only else Severity.WARNING
                name = "link.state" if only else f"link.state.{link}"
                causes[name] = (severity, f"no data over {link.replace('_', ' ')}: {one.reason}", "")
        self._alarm_log.set_alarms("link.", causes)
        if newest := stamp_of(quality.header.stamp):
            self._on_gauge(newest)
        self._show()

    def _on_pressure(self, data: bytes) -> None:
        try:
            self._pressure.push(*gauge_burst.decode(data))
        except ValueError as error:
            self._alarm_log.log_event("link", f"pressure not shown: {error}", Severity.WARNING)

    def _on_strokes(self, data: bytes) -> None:
        message = deserialize_message(data, msg.StrokeBurst)
        for pump, at in zip(message.pump, message.stamp, strict=True):
            self._strokes.setdefault(int(pump), deque(maxlen=_STROKES)).append(stamp_of(at))

    def _stroke_rates(self) -> tuple[float, ...]:
        """Strokes a second of each pump over its last strokes."""
        spans = [(len(times) - 1, times[-1] - times[0]) for _, times in sorted(self._strokes.items()) if len(times) > 2]
        return tuple(count / span * 1e9 for count, span in spans if span > 0)

    def _show(self) -> None:
        if self._qualities:
            self._shown = best_link(self._qualities, self._shown)
            by_name = {name: self._collectors[name].status(one) for name, one in sorted(self._qualities.items())}
            shown = by_name.pop(self._shown)
            self._live.on_link(dataclasses.replace(shown, others=tuple(by_name.values())), time.monotonic())

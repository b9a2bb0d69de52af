"""The link of the well for page and rig: words, passes and quality as they arrive."""

from __future__ import annotations

import time
from collections.abc import Callable

from mwd_msgs import msg
from rclpy.serialization import deserialize_message

from mwd_surface.live.alarms import Severity
from mwd_surface.live.link_state import (
    DOUBTFUL,
    NO_INPUT,
    LinkCollector,
    LinkFrameState,
    LinkStatus,
    LinkWordState,
)
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.message_conversion import stamp_of

_FIELDS = (
    *("link", "state", "reason", "has_signal", "ebn0_db", "margin_db", "clock_error", "word_error", "goodput"),
    *("mode", "words_done", "words_expected", "toolface_age", "survey_age"),
)


class LinkMonitor:
    """
    Takes the messages of a link and shows its state.

    Attributes
    ----------
    handlers : dict
        From topic to the function that is called with each serialised message.
    """

    def __init__(self, context: SurfaceContext) -> None:
        self._live, self._alarm_log = context.live, context.alarm_log
        self._collector = LinkCollector()
        self._quality: LinkStatus | None = None
        self.handlers: dict[str, Callable[[bytes], None]] = {
            "link/word": self._on_word,
            "link/frame": self._on_frame,
            "link/quality": self._on_quality,
        }

    def _on_word(self, data: bytes) -> None:
        word = deserialize_message(data, msg.LinkWord)
        self._collector.on_word(
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
        self._collector.on_frame(
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
        self._quality = LinkStatus(
            **{name: getattr(quality, name) for name in _FIELDS},
            stamp_ns=stamp_of(quality.header.stamp),
            at=time.monotonic(),
            pump_lines=tuple(quality.pump_lines.tolist()),
        )
        causes = {}
        if quality.state in (NO_INPUT, DOUBTFUL):
            severity = Severity.CRITICAL if quality.state == NO_INPUT else Severity.WARNING
            causes["link.state"] = (severity, f"no data over {quality.link.replace('_', ' ')}: {quality.reason}", "")
        self._alarm_log.set_alarms("link.", causes)
        self._show()

    def _show(self) -> None:
        if self._quality is not None:
            self._live.on_link(self._collector.status(self._quality), time.monotonic())

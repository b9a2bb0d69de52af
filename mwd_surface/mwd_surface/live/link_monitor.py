# SPDX-License-Identifier: Apache-2.0
"""Telemetry links of the well: collect words, frames and quality, and show the best link on the page."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from typing import Any

from mwd_sensors.core import gauge_burst
from mwd_sensors.core.message_record import stamp_of
from mwd_surface.live.alarms import Severity
from mwd_surface.live.link_state import (
    DOUBTFUL,
    NO_INPUT,
    LinkCollector,
    LinkFrameState,
    LinkStatus,
    LinkWordState,
    PressureHistory,
    PressurePicture,
    best_link,
)
from mwd_surface.live.well_context import WellContext

_STROKES = 30  # number of strokes over which the rate of a pump is computed
_SLOWEST_NS = 6_000_000_000  # longest time between two strokes, ns; after a longer time the pump counts as stopped


class LinkMonitor:
    """
    Monitor of the links in use: shows the state of the best link, and of the other links.

    Parameters
    ----------
    source : str
        Setting `link.source`: the name of one link, or "best" for the best of all links.
    on_gauge : callable
        Called with the stamp, ns, of the newest sample of a link's gauge.
    """

    def __init__(self, context: WellContext, source: str, *, on_gauge: Callable[[int], None]) -> None:
        self._on_gauge = on_gauge
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log
        self._source = source
        self._collectors: dict[str, LinkCollector] = {}
        self._qualities: dict[str, LinkStatus] = {}
        self._shown = ""
        self._pressure = PressureHistory()
        self._strokes: dict[int, deque[int]] = {}
        self._picture: PressurePicture | None = None

    def _collector(self, link: str) -> LinkCollector | None:
        """Return the collector of the words of a link; None if the link is not in use."""
        return self._collectors.setdefault(link, LinkCollector()) if self._source in (link, "best") else None

    def on_word(self, word: Any) -> None:
        """Accept a word of a link, mwd_msgs/LinkWord."""
        collector = self._collector(word.link)
        if collector is None:
            return
        collector.on_word(LinkWordState.from_message(word))
        self._show()

    def on_frame(self, frame: Any) -> None:
        """Add a received frame (mwd_msgs/LinkFrame): one pass of a sequence, in which all its words are sent once."""
        collector = self._collector(frame.link)
        if collector is None:
            return
        collector.on_frame(LinkFrameState.from_message(frame))
        self._show()

    def on_quality(self, quality: Any) -> None:
        """
        Accept the state of a link, mwd_msgs/LinkQuality, and set the alarms of doubtful links and links without input.

        A link without input raises no alarm before its first samples, nor after the end of a simulation.
        """
        if self._collector(quality.link) is None:
            return
        status = LinkStatus.from_message(quality)
        strokes = self._stroke_rates(status.stamp_ns)
        self._qualities[quality.link] = dataclasses.replace(status, at=self._clock.now, strokes=strokes)
        causes = {}
        for link, one in self._qualities.items():
            # No alarm before the first samples, because the rig may not have started yet, nor after the end of a
            # simulation.
            missed = one.state == NO_INPUT and one.stamp_ns and not self._live.parts.over
            if one.state == DOUBTFUL or missed:
                only = len(self._qualities) == 1
                severity = Severity.CRITICAL if one.state == NO_INPUT and only else Severity.WARNING
                name = "link.state" if only else f"link.state.{link}"
                causes[name] = (severity, f"no data over {link.replace('_', ' ')}: {one.reason}", "")
        self._alarm_log.set_alarms("link.", causes)
        if status.stamp_ns:
            self._on_gauge(status.stamp_ns)
        self._show()

    def on_pressure(self, data: bytes) -> None:
        """Accept a serialised burst of the gauge, mwd_msgs/PressureBurst."""
        try:
            self._pressure.push(*gauge_burst.decode(data))
        except ValueError as error:
            self._alarm_log.log_event("link", f"pressure not shown: {error}", Severity.WARNING)

    def on_strokes(self, message: Any) -> None:
        """Accept strokes of the pumps, mwd_msgs/StrokeBurst."""
        for pump, at in zip(message.pump, message.stamp, strict=True):
            times = self._strokes.setdefault(int(pump), deque(maxlen=_STROKES))
            if times and not 0 < stamp_of(at) - times[-1] <= _SLOWEST_NS:
                # The pump stopped: count its rate from the restart.
                times.clear()
            times.append(stamp_of(at))

    def update(self) -> None:
        """Compute and show a new picture of the pressure; called once a second."""
        if self._qualities:
            self._picture = self._pressure.picture()
            self._show()

    def _stroke_rates(self, stamp_ns: int) -> tuple[float, ...]:
        """Return the stroke rates of the pumps that run at a time, ns, over their last strokes, Hz."""
        newest = max((times[-1] for times in self._strokes.values()), default=0)
        spans = [
            (len(times) - 1, times[-1] - times[0])
            for _, times in sorted(self._strokes.items())
            if len(times) > 2 and max(newest, stamp_ns) - times[-1] <= _SLOWEST_NS
        ]
        return tuple(count / span * 1e9 for count, span in spans if span > 0)

    def _show(self) -> None:
        if self._qualities:
            self._shown = best_link(self._qualities, self._shown)
            by_name = {name: self._collectors[name].status(one) for name, one in sorted(self._qualities.items())}
            shown = by_name.pop(self._shown)
            picture = self._picture
            self._live.on_link(
                dataclasses.replace(shown, others=tuple(by_name.values()), picture=picture), self._clock.now
            )

# SPDX-License-Identifier: Apache-2.0
"""
Whether the tool is silent because of the flow: one decision, from the pressure, the rig's flow and the words.

The pressure says whether the pumps are on, the rig's flow on which side of the tool's threshold it is. Where they
contradict each other the pressure decides, and words that arrive refute both.
"""

from __future__ import annotations

import math

from mwd_sensors.core.units import LPM
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.switch import FLOW_HOLD_S, Switch
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import OFF, FlowSpans

# A flow older than this says nothing of now, s; rigs report it every second or few.
_FRESH_S = 5.0
# Least share of the tool's threshold at which the pressure can show running pumps: it then is at least the share OFF
# of the pressure while the tool sends, and friction grows with the flow to this power (turbulent, Blasius).
_LEAST_SHARE = OFF ** (1.0 / 1.75)
_OFF = "the pumps are off, or their flow is below the tool's threshold: the tool is silent"


class ToolFlow:
    """
    The flow as the tool takes it.

    Parameters
    ----------
    tool : ToolConfiguration
        As in the tool.
    spans : FlowSpans
        Spans without flow; those of a link through the earth are entered here, from the rig's flow.
    """

    def __init__(self, tool: ToolConfiguration, spans: FlowSpans) -> None:
        self._tool, self.spans = tool, spans
        self._switch: Switch | None = None
        # When the rig last reported a flow, and since when it is on this side of the threshold, s; -inf: not known.
        self._at_s = self._since_s = -math.inf
        # Newest flow on the side of the threshold that counts, m^3/s, and whether one on the other side came since.
        self._rate, self._changing = 0.0, False
        self._word_s = -math.inf

    def take(self, at_s: float, rate: float | None) -> None:
        """Take the flow that the rig reports at a time, s: m^3/s; None: it reports none."""
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
        if changed and self._tool.medium == "earth":
            self.spans.switch(self._since_s, above)

    def take_word(self, start_s: float) -> None:
        """Take that a usable word began on air at a time, s."""
        self._word_s = max(self._word_s, start_s)

    def on_since(self, now_s: float) -> float:
        """Since when the tool may have its flow, s, as of now; -inf: its begin was not seen."""
        return max(self.spans.on_since(now_s), self._since_s if self._above(now_s) else -math.inf)

    def silence(self, now_s: float) -> str:
        """Why the tool sends nothing now, in a sentence; empty: it may send, as a tool on a wire always does."""
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
        """How pressure and rig's flow contradict each other now, in a sentence; empty: they do not."""
        above, pumping = self._above(now_s), self._pumping(now_s)
        reported = f"the rig reports a flow of {self._rate / LPM:.0f} l/min"
        if above is False and pumping and self._rate < _LEAST_SHARE * self._tool.flow_threshold:
            return f"{reported} although the pressure is that of running pumps: look at the flow meter"
        if above and pumping is False and not self._changing:
            return f"{reported} although there is no pressure of running pumps: look at the gauge and its valve"
        return ""

    def _above(self, now_s: float) -> bool | None:
        """Whether the rig's flow is above the threshold; None: it is not known, or no more."""
        return self._switch.on if self._switch is not None and now_s - self._at_s < _FRESH_S else None

    def _pumping(self, now_s: float) -> bool | None:
        """Whether the pumps are on by the pressure; None: it is not known."""
        return self.spans.flowing(now_s) if self._tool.medium == "mud" else None

# SPDX-License-Identifier: Apache-2.0
"""
Decision whether the tool is silent because of the flow, from the pressure, the rig's flow and the received words.

The pressure shows whether the pumps are on; the rig's flow shows on which side of the tool's threshold it is. Where the
two contradict each other, the pressure decides. A received word overrules both.
"""

from __future__ import annotations

import math

from mwd_sensors.core.units import LPM
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.switch import FLOW_HOLD_S, Switch
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import OFF, FlowSpans

# A reported flow older than this is not used, s; rigs report it every second or every few seconds.
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
    tool : ToolConfiguration
        Tool configuration, the same as in the tool.
    spans : FlowSpans
        Spans without flow; for a link through the earth this class adds them from the rig's flow.
    """

    def __init__(self, tool: ToolConfiguration, spans: FlowSpans) -> None:
        self._tool, self.spans = tool, spans
        self._switch: Switch | None = None
        # Time of the rig's last flow, and since when the flow has been on this side of the threshold, s; -inf if
        # unknown.
        self._at_s = self._since_s = -math.inf
        # Newest flow on the side of the threshold that counts, m^3/s, and whether a flow on the other side has come
        # since.
        self._rate, self._changing = 0.0, False
        self._word_s = -math.inf

    def take(self, at_s: float, rate: float | None) -> None:
        """Add the flow that the rig reports at a time, s, in m^3/s; None if it reports none."""
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
        """Record that a usable word began at a time, s."""
        self._word_s = max(self._word_s, start_s)

    def on_since(self, now_s: float) -> float:
        """Return the earliest time since which the tool may have enough flow, s; -inf if the flow-on was not seen."""
        return max(self.spans.on_since(now_s), self._since_s if self._above(now_s) else -math.inf)

    def silence(self, now_s: float) -> str:
        """Return why the tool sends nothing now; empty if it may send, as a tool on a wire always may."""
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
        """Return how pressure and the rig's flow contradict each other now; empty if they agree."""
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

# SPDX-License-Identifier: Apache-2.0
"""What can be set about the tool's transmission, beside its tool configuration."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry.switch import FLOW_HOLD_S


@dataclasses.dataclass(frozen=True)
class Transmit:
    """When the tool transmits. What it sends, and how, stands in its tool configuration (tool.yaml)."""

    tool_file: str = setting(
        "",
        "Tool configuration (tool.yaml) by which the tool transmits; empty: it does not. The receiver at the surface "
        "needs the same file.",
    )
    second_tool_file: str = setting(
        "",
        "Tool configuration of a second link, such as EM beside mud pulses: the tool sends over both at once; empty: "
        "none.",
        expert=True,
    )
    flow_hold_s: float = setting(
        FLOW_HOLD_S,
        "Time for which the flow has to stay above or below the threshold of the tool configuration. Raising it "
        "ignores longer interruptions and delays each transmission by as much.",
        unit="s",
        low=0.0,
        high=60.0,
        expert=True,
    )
    rotation_switching_s: float = setting(
        0.0,
        "Begin anew when rotation begins (survey, then the second toolface sequence) and when it ends (first toolface "
        "sequence): time for which the string has to turn, or to stand, before that; 0: no switching. Raising it "
        "survives longer stick phases; 10 s is usual. Needs header_bits in the tool configuration, so that the surface "
        "knows which sequence comes.",
        unit="s",
        low=0.0,
        high=300.0,
        expert=True,
    )

    def __post_init__(self) -> None:
        """Refuse a time shorter than half a second, which a jerk of the string would exceed."""
        if 0.0 < self.rotation_switching_s < 0.5:
            raise ValueError(
                f"rotation_switching_s: {self.rotation_switching_s:g} s is below the shortest time, 0.5 s; 0: no "
                "switching"
            )

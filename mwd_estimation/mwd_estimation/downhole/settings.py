# SPDX-License-Identifier: Apache-2.0
"""Settings of the tool's transmission that are not part of its tool configuration."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry.switch import FLOW_HOLD_S


@dataclasses.dataclass(frozen=True)
class Transmit:
    """Settings of the times at which the tool transmits; tool.yaml, its configuration, states words and modulation."""

    tool_file: str = setting(
        "",
        "Tool configuration (tool.yaml) that says what the tool transmits; empty: the tool does not transmit. The "
        "receiver at the surface needs the same file.",
    )
    second_tool_file: str = setting(
        "",
        "Tool configuration of a second link, such as EM in addition to mud pulses, over which the tool transmits at "
        "the same time; empty: no second link.",
        expert=True,
    )
    flow_hold_s: float = setting(
        FLOW_HOLD_S,
        "Time for which the flow must stay above or below the threshold of the tool configuration before it counts as "
        "on or off. A larger value ignores longer interruptions, but delays each transmission by the same time.",
        low=0.0,
        high=60.0,
        expert=True,
    )
    rotation_switching_s: float = setting(
        0.0,
        "Time for which the string must turn, or stand still, before the transmission restarts with another sequence: "
        "survey and second toolface sequence when rotation begins, first toolface sequence when it ends; 0: never "
        "switch. A larger value tolerates longer stick phases; 10 s is usual. Needs header_bits in the tool "
        "configuration, so that the surface knows which sequence follows.",
        low=0.0,
        high=300.0,
        expert=True,
    )

    def __post_init__(self) -> None:
        """Raise ValueError for a time between 0 and 0.5 s, because single jerks of the string last that long."""
        if 0.0 < self.rotation_switching_s < 0.5:
            raise ValueError(
                f"rotation_switching_s: {self.rotation_switching_s:g} s is below the shortest time, 0.5 s; 0: no "
                "switching"
            )

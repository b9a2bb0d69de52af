# SPDX-License-Identifier: Apache-2.0
"""Settings of the downlink at the surface: tool file and limits."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class DownlinkSettings:
    """Limits within which the surface may change flow and rotation to send a command to the tool."""

    tool_file: str = setting(
        "",
        "Tool configuration (tool.yaml) whose section `downlink` says how the tool accepts commands. Tool and "
        "receiver need the same file. Empty: no downlink.",
    )
    speed_low_rpm: float = setting(
        30.0, "Lowest rotary speed that may be commanded. Many strings stick below it.", low=0.0, high=600.0
    )
    speed_high_rpm: float = setting(180.0, "Highest rotary speed at which a command may run.", low=1.0, high=600.0)
    flow_low_lpm: float = setting(
        800.0,
        "Lowest flow that may be commanded. Keep it above the tool's flow threshold and the flow that cleans the hole.",
        low=0.0,
        high=20000.0,
    )
    flow_high_lpm: float = setting(6000.0, "Highest flow at which a command may run.", low=1.0, high=20000.0)
    pressure_high_bar: float = setting(320.0, "Standpipe pressure above which no command runs.", low=1.0, high=2000.0)
    stall_share: float = setting(
        0.25,
        "Rise of the pressure above its usual value at the same flow, as a share, that counts as a motor stall. "
        "Raise it where the differential pressure varies much; a stall is then noticed later.",
        low=0.02,
        high=2.0,
        expert=True,
    )
    tolerance: float = setting(
        0.08,
        "Deviation of flow or rotation from the set-point, as a share of the value before the command, that counts "
        "as operator input after 2 s. Raise it where the rig's gauges are inaccurate.",
        low=0.01,
        high=0.5,
        expert=True,
    )

# SPDX-License-Identifier: Apache-2.0
"""Settings of the control authority: permission to control the rig, limits, and the reactions to faults."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

REACTIONS = ("keep", "hold", "release")


@dataclasses.dataclass(frozen=True)
class ControlSettings:
    """Settings for control of top drive and pumps by controllers: permission, limits, reactions to faults."""

    enabled: bool = setting(
        False, "Let controllers take control of top drive and pumps. If false, every request is denied."
    )
    grant: str = setting(
        "operator",
        "Who grants control. operator: a person grants each request, on the page or by the service judge_control. "
        "automatic: the first request is granted, and a request of higher priority takes over. Use automatic only "
        "if every controller is trusted.",
        choices=("operator", "automatic"),
    )
    heartbeat_s: float = setting(
        2.0,
        "Time without a command after which the controller that has control counts as dead. Raising it lets the string "
        "turn longer without a working controller; lowering it ends the control of slow clients.",
        low=0.2,
        high=30.0,
    )
    pending_s: float = setting(
        120.0,
        "Time after which a request that nobody has granted expires. Raising it gives the operator more time.",
        low=1.0,
        high=3600.0,
    )
    longest_s: float = setting(
        3600.0,
        "Longest time for which control is granted; the controller extends it by a new request. Lowering it ends "
        "forgotten control sooner.",
        low=1.0,
        high=86400.0,
    )
    speed_rpm: float = setting(120.0, "Highest speed that may be commanded to the top drive.", low=0.1, high=600.0)
    speed_rate_rpm_s: float = setting(
        10.0,
        "Largest rate of change of the commanded speed. Raising it can excite stick-slip.",
        unit="r/min/s",
        low=0.1,
        high=1000.0,
    )
    torque_nm: float = setting(
        30000.0,
        "Measured torque above which control ends and the string is held. Set it below the string's make-up torque.",
        low=100.0,
        high=2e5,
    )
    turn_deg: float = setting(720.0, "Largest turn in one command.", low=1.0, high=36000.0)
    left_speed_rpm: float = setting(
        0.0,
        "Highest counter-clockwise speed, looking downhole, that may be commanded. Left-hand rotation can unscrew "
        "the string; with 0 it is refused.",
        low=0.0,
        high=600.0,
    )
    left_turn_deg: float = setting(
        0.0,
        "Largest counter-clockwise turn in one command; with 0 such turns are refused. A controller that rocks the "
        "string, or corrects a toolface to the left, needs a value above 0.",
        low=0.0,
        high=36000.0,
    )
    flow_lpm: float = setting(
        4000.0, "Highest flow that may be commanded to the pumps.", unit="L/min", low=1.0, high=20000.0
    )
    controller_lost_sliding: str = setting(
        "hold",
        "Reaction to a dead controller while sliding. hold: stop turning and hold the string; release: return to "
        "the driller's settings; keep: keep the last set-point until a person ends it.",
        choices=REACTIONS,
    )
    controller_lost_rotating: str = setting(
        "release",
        "Reaction to a dead controller while rotating: hold, release or keep, as for sliding.",
        choices=REACTIONS,
    )
    mwd_lost_sliding: str = setting(
        "hold",
        "Reaction while sliding if attitude and toolface stop arriving: hold, release or keep, as for "
        "controller_lost_sliding. Except with keep, ORIENT set-points are refused until attitude and toolface arrive "
        "again.",
        choices=REACTIONS,
    )
    mwd_lost_rotating: str = setting(
        "keep",
        "Reaction while rotating if attitude and toolface stop arriving: keep, hold or release. Rotating needs no "
        "toolface.",
        choices=REACTIONS,
    )

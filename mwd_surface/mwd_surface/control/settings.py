# SPDX-License-Identifier: Apache-2.0
"""Settings of the control authority: who may have control, within what limits, and the reactions to faults."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

REACTIONS = ("keep", "hold", "release")


@dataclasses.dataclass(frozen=True)
class ControlSettings:
    """Who may command top drive and pumps, and how far."""

    enabled: bool = setting(
        False, "Let controllers take control of top drive and pumps; false: every request is denied", fixed=True
    )
    grant: str = setting(
        "operator",
        "Who grants control. operator: a person, for each request, on the page or by judge_control; automatic: the "
        "first who asks, and a higher priority takes over. Use automatic only where every controller is trusted",
        choices=("operator", "automatic"),
        fixed=True,
    )
    heartbeat_s: float = setting(
        2.0,
        "Time without a command of the owner after which it counts as dead. Higher values let the string turn longer "
        "without anybody in control; lower ones end leases of slow clients",
        unit="s",
        low=0.2,
        high=30.0,
        fixed=True,
    )
    pending_s: float = setting(
        120.0, "Time after which a request that waits lapses", unit="s", low=1.0, high=3600.0, fixed=True
    )
    longest_s: float = setting(
        3600.0,
        "Longest lease; the owner renews it by asking again. Shorter ones end a forgotten lease sooner",
        unit="s",
        low=1.0,
        high=86400.0,
        fixed=True,
    )
    speed_rpm: float = setting(
        120.0, "Highest speed of the top drive that may be asked", unit="r/min", low=0.1, high=600.0, fixed=True
    )
    speed_rate_rpm_s: float = setting(
        10.0,
        "Largest change of the asked speed; a larger one excites stick-slip",
        unit="r/min/s",
        low=0.1,
        high=1000.0,
        fixed=True,
    )
    torque_nm: float = setting(
        30000.0,
        "Measured torque above which control ends and the string is held: below the make-up torque of the string",
        unit="N m",
        low=100.0,
        high=2e5,
        fixed=True,
    )
    turn_deg: float = setting(720.0, "Largest turn at once", unit="deg", low=1.0, high=36000.0, fixed=True)
    left_speed_rpm: float = setting(
        0.0,
        "Highest speed to the left, counter-clockwise looking down-hole, that may be asked. Left-hand rotation can "
        "unscrew the string: 0 refuses it",
        unit="r/min",
        low=0.0,
        high=600.0,
        fixed=True,
    )
    left_turn_deg: float = setting(
        0.0,
        "Largest turn to the left at once; 0 refuses it. A controller that rocks the string or brings a toolface back "
        "needs some",
        unit="deg",
        low=0.0,
        high=36000.0,
        fixed=True,
    )
    flow_lpm: float = setting(
        4000.0, "Highest flow that may be asked of the pumps", unit="L/min", low=1.0, high=20000.0, fixed=True
    )
    controller_lost_sliding: str = setting(
        "hold",
        "Reaction to a dead controller while sliding. hold: stop turning and keep the string; release: back to what "
        "the driller has set; keep: the last set-point goes on until a person ends it",
        choices=REACTIONS,
        fixed=True,
    )
    controller_lost_rotating: str = setting(
        "release", "Reaction to a dead controller while rotating; as above", choices=REACTIONS, fixed=True
    )
    mwd_lost_sliding: str = setting(
        "hold",
        "Reaction to a dead MWD while sliding; unless it is keep, no set-point that slides is taken until it is back",
        choices=REACTIONS,
        fixed=True,
    )
    mwd_lost_rotating: str = setting(
        "keep", "Reaction to a dead MWD while rotating, which needs no toolface", choices=REACTIONS, fixed=True
    )

# SPDX-License-Identifier: Apache-2.0
"""Tables of rig control and steering advice for the page, in words."""

from __future__ import annotations

from typing import Any

from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import ControlState, ControlStatus
from mwd_surface.page.plain import number
from mwd_surface.signals.table import page_fields
from mwd_surface.trajectory.advice import Advice

_ASKED = {
    Mode.HOLD: "hold the string",
    Mode.ROTATE: "rotate",
    Mode.ORIENT: "turn by an angle",
    Mode.RELEASE: "the driller's",
}
_STATES = {
    ControlState.IDLE: "driller",
    ControlState.PENDING: "asked for",
    ControlState.GRANTED: "controller",
    ControlState.FAULT: "fault",
}


def control_table(status: ControlStatus) -> dict[str, Any]:
    """Return the owner of control, the commanded values and the achieved ones; None where unknown."""
    achieved = status.achieved
    return {
        "enabled": status.enabled,
        "state": _STATES[status.state],
        "owner": status.owner,
        "role": status.role,
        "pending": status.pending_controller,
        "pending_number": status.pending,
        "pending_reason": status.pending_reason,
        "reason": status.reason,
        "refusal": status.refusal,
        "asked": _ASKED[status.mode],
        "speed": number(status.asked_speed),
        "turn": number(status.asked_turn),
        "flow": number(status.flow_rate),
        "acknowledged": status.sequence > 0 and status.acknowledged == status.sequence,
        "achieved_speed": number(achieved.speed),
        "achieved_torque": number(achieved.torque),
        "achieved_flow": number(achieved.flow),
        "mwd_alive": status.mwd_alive,
        "reactions": {name: reaction.name.lower() for name, reaction in status.reactions.items()},
    }


def advice_table(advice: Advice) -> dict[str, Any]:
    """Return the advice; None where unknown."""
    return {
        "mode": advice.mode.name.lower(),
        "magnetic": advice.magnetic,
        "source": advice.source,
        "reason": advice.reason,
        "survey": advice.survey,
        **{name: number(getattr(advice, signal.field)) for name, signal in page_fields("advice").items()},
    }

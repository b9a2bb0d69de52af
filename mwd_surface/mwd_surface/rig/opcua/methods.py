# SPDX-License-Identifier: Apache-2.0
"""Methods of the OPC UA object of a well: decisions on surveys, and control of top drive and pumps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import SetPoint
from mwd_surface.control.status import Request, Sender
from mwd_surface.rig.interface import OnCommand

_INTERFACE = "OPC UA"
Argument = tuple[str, str, str]
"""Name, type and description of an argument."""

_DONE: tuple[Argument, ...] = (("success", "Boolean", "whether it was done"), ("message", "String", "or why not"))
_DECISION: tuple[Argument, ...] = (
    ("sequence", "UInt32", "number of the survey"),
    ("operator_name", "String", "who decides"),
    ("reason", "String", "why"),
)


@dataclasses.dataclass(frozen=True)
class Method:
    """A method: arguments, results, and the function that runs it with an identity from `Access`, in any thread."""

    name: str
    inputs: tuple[Argument, ...]
    call: Callable[[dict[str, Any], str], Sequence[Any]]
    outputs: tuple[Argument, ...] = _DONE


def survey_methods(on_command: OnCommand) -> list[Method]:
    """Return the survey methods, run by a node; on_command: `on_command(name, arguments) -> (ok, message)`."""
    table = {
        "take_survey": (("duration", "Double", "s to average over; 0: as configured"),),
        "accept_survey": _DECISION,
        "reject_survey": _DECISION,
    }

    def asking(name: str) -> Callable[[dict[str, Any], str], Sequence[Any]]:
        return lambda arguments, _identity: on_command(name, arguments)

    return [Method(name, inputs, asking(name)) for name, inputs in table.items()]


def control_methods(authority: ControlAuthority, clock: Callable[[], float]) -> list[Method]:
    """Return the control methods; clock: steady time, s, the same clock as the authority's."""

    def request(given: dict[str, Any], identity: str) -> Sequence[Any]:
        decision = authority.request(Request(Sender(_INTERFACE, identity), **given), clock())
        return decision.message, int(decision.permission), decision.lease

    def command(given: dict[str, Any], identity: str) -> Sequence[Any]:
        return authority.command(SetPoint(**given), clock(), Sender(_INTERFACE, identity))

    def release(given: dict[str, Any], identity: str) -> Sequence[Any]:
        return authority.release(given["lease"], clock(), Sender(_INTERFACE, identity), given["reason"])

    lease = ("lease", "UInt32", "number of the lease")
    return [
        Method(
            "request_control",
            (
                ("controller", "String", "name of the controller"),
                ("role", "String", "purpose of the controller, in a word or two"),
                ("priority", "Byte", "0 to 255; a higher priority than the owner's takes over"),
                ("wait", "Boolean", "wait while another has control"),
                ("duration", "Double", "s; 0: the longest duration allowed"),
            ),
            request,
            (
                ("message", "String", "why it was refused, or what it waits for"),
                ("permission", "Byte", "0 denied, 1 pending, 2 granted"),
                ("lease", "UInt32", "number of the lease, or of the pending request; 0: denied"),
            ),
        ),
        Method(
            "set_point",
            (
                lease,
                ("sequence", "UInt32", "increases with each set-point; 0: heartbeat only"),
                ("mode", "Byte", "0 hold, 1 rotate, 2 orient, 3 pump, 4 release"),
                ("rotary_speed", "Double", "rotate: rad/s"),
                ("turn", "Double", "orient: rad from the present position of the top drive"),
                ("flow_rate", "Double", "pump: m^3/s"),
                ("valid_for", "Double", "s, above 0; the string is held after this time"),
            ),
            command,
        ),
        Method("release_control", (lease, ("reason", "String", "why")), release),
    ]

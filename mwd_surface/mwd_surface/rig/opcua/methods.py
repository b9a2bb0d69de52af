# SPDX-License-Identifier: Apache-2.0
"""Methods of the OPC UA object of a well: decisions about surveys, and control of top drive and pumps."""

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

_DONE: tuple[Argument, ...] = (("success", "Boolean", "it was done"), ("message", "String", "or why not"))
_DECISION: tuple[Argument, ...] = (
    ("sequence", "UInt32", "number of the survey"),
    ("operator_name", "String", "who decides"),
    ("reason", "String", "why"),
)


@dataclasses.dataclass(frozen=True)
class Method:
    """A method: its arguments, its results, and what carries it out for an identity of `Access`, in any thread."""

    name: str
    inputs: tuple[Argument, ...]
    call: Callable[[dict[str, Any], str], Sequence[Any]]
    outputs: tuple[Argument, ...] = _DONE


def survey_methods(on_command: OnCommand) -> list[Method]:
    """Return the methods that a node carries out; on_command: `on_command(name, arguments) -> (ok, message)`."""
    table = {
        "take_survey": (("duration", "Double", "s to average over; 0: as configured"),),
        "accept_survey": _DECISION,
        "reject_survey": _DECISION,
    }

    def asking(name: str) -> Callable[[dict[str, Any], str], Sequence[Any]]:
        return lambda arguments, _identity: on_command(name, arguments)

    return [Method(name, inputs, asking(name)) for name, inputs in table.items()]


def control_methods(authority: ControlAuthority, clock: Callable[[], float]) -> list[Method]:
    """Return the methods of control; clock: steady seconds, that of the authority."""

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
                ("role", "String", "what it does, in a word or two"),
                ("priority", "Byte", "0 to 255; a higher one than the owner's takes over"),
                ("wait", "Boolean", "wait while another has control"),
                ("duration", "Double", "s; 0: the longest allowed here"),
            ),
            request,
            (
                ("message", "String", "why not, or what it waits for"),
                ("permission", "Byte", "0 denied, 1 pending, 2 granted"),
                ("lease", "UInt32", "number of the lease, or of the pending request; 0: denied"),
            ),
        ),
        Method(
            "set_point",
            (
                lease,
                ("sequence", "UInt32", "grows with each set-point; 0 is a heartbeat alone"),
                ("mode", "Byte", "0 hold, 1 rotate, 2 orient, 3 pump, 4 release"),
                ("rotary_speed", "Double", "rotate: rad/s"),
                ("turn", "Double", "orient: rad from where the top drive stands"),
                ("flow_rate", "Double", "pump: m^3/s"),
                ("valid_for", "Double", "s, above 0; then the string is held"),
            ),
            command,
        ),
        Method("release_control", (lease, ("reason", "String", "why")), release),
    ]

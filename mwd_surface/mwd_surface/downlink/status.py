# SPDX-License-Identifier: Apache-2.0
"""State of the downlink as shown by page, message and rig interfaces."""

from __future__ import annotations

import dataclasses

from mwd_sensors.telemetry import tool_commands
from mwd_surface.downlink.machine import Machine


@dataclasses.dataclass(frozen=True)
class DownlinkStatus:
    """
    State of a downlink; fields as in mwd_msgs/DownlinkState.

    Attributes
    ----------
    medium : str
        rotation or flow.
    base, set_point : float or None
        rad/s or m^3/s; None if nothing is commanded to the rig.
    choices : tuple of (str, tuple of float)
        Commands that the tool accepts, each with its possible values.
    """

    number: int
    state: int
    medium: str
    command: str
    value: float
    argument: int
    counter: int
    about: str
    requested_by: str
    decided_by: str
    reason: str
    blocked_by: tuple[str, ...]
    symbol: int
    symbols: int
    duration: float
    remaining: float
    base: float | None
    set_point: float | None
    in_force: tuple[int, ...]
    choices: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @classmethod
    def of(cls, machine: Machine, now: float) -> DownlinkStatus:
        """Return the state of a machine at a steady time, s."""
        request, ordered = machine.request, machine.programme
        elapsed = machine.elapsed(now)
        return cls(
            number=machine.number,
            state=int(machine.state),
            medium=machine.downlink.medium,
            command="" if request is None else request.name,
            value=0.0 if request is None else request.value,
            argument=0 if request is None else request.frame.argument,
            counter=0 if request is None else request.frame.counter,
            about=machine.about,
            requested_by="" if request is None else request.by,
            decided_by=machine.decided_by,
            reason=machine.reason,
            blocked_by=machine.blocked_by,
            symbol=0 if ordered is None or elapsed == 0.0 else ordered.number_at(elapsed),
            symbols=0 if ordered is None else len(ordered.symbols),
            duration=0.0 if ordered is None else ordered.duration_s,
            remaining=0.0 if ordered is None else ordered.duration_s - elapsed,
            base=machine.base if machine.set_point is not None else None,
            set_point=machine.set_point,
            in_force=tuple(int(one) for one in machine.in_force),
            choices=tuple(tool_commands.choices(machine.tool).items()),
        )

# SPDX-License-Identifier: Apache-2.0
"""State of the downlink as shown by page, message and rig interfaces."""

from __future__ import annotations

import dataclasses
import enum
from typing import ClassVar

from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.unknown import or_nan
from mwd_sensors.telemetry import tool_commands
from mwd_surface.downlink.machine import DownlinkState, Machine


class Medium(enum.IntEnum):
    """Quantity that carries a downlink, as in mwd_msgs/DownlinkState."""

    FLOW = 0
    ROTATION = 1


@dataclasses.dataclass(frozen=True, eq=False)
class DownlinkStatus(MessageRecord):
    """State of a downlink; the fields that are sent are those of mwd_msgs/DownlinkState."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/DownlinkState"
    NOT_SENT: ClassVar[frozenset[str]] = frozenset({"choices"})

    number: int
    state: DownlinkState
    medium: Medium
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
    #: `base`, `set_point`: flow or rotary speed before the downlink, and commanded value, m^3/s or rad/s; NaN if
    #: nothing is commanded to the rig.
    base: float
    set_point: float
    in_force: tuple[int, ...]
    #: Commands that the tool accepts, each with its possible values.
    choices: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @classmethod
    def of(cls, machine: Machine, now: float) -> DownlinkStatus:
        """Return the state of a machine at a steady time, s."""
        request, ordered = machine.request, machine.programme
        elapsed = machine.elapsed(now)
        return cls(
            number=machine.number,
            state=machine.state,
            medium=Medium[machine.downlink.medium.upper()],
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
            base=or_nan(machine.base if machine.set_point is not None else None),
            set_point=or_nan(machine.set_point),
            in_force=tuple(int(one) for one in machine.in_force),
            choices=tuple(tool_commands.choices(machine.tool).items()),
        )

# SPDX-License-Identifier: Apache-2.0
"""Value that the rig interfaces send: its number, and whether the number may be used for control."""

from __future__ import annotations

import dataclasses
import enum


class Condition(enum.Enum):
    """Usability of a value, from best to worst; the value of each member is its text for users."""

    GOOD = "good"
    OVERRIDE = "override"
    DOUBTFUL = "doubtful"
    STALE = "stale"
    WAITING = "waiting"
    FAULT = "fault"
    NO_LINK = "no link"
    INACTIVE = "inactive"

    @property
    def usable(self) -> bool:
        """Whether the number is a current value that may be used."""
        return self in (Condition.GOOD, Condition.OVERRIDE, Condition.DOUBTFUL)


@dataclasses.dataclass(frozen=True)
class RigValue:
    """
    One value for the rig, with its condition.

    stamp_ns: time of the measurement, ns since the epoch, 0 if nothing was measured. age: s, None if nothing was
    measured. sigma: 1 sigma in the unit of the value, or None. If `condition` is not usable, `value` is the last known
    number, or 0.
    """

    value: float = 0.0
    condition: Condition = Condition.WAITING
    stamp_ns: int = 0
    age: float | None = None
    sigma: float | None = None
    reason: str = ""

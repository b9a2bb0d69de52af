# SPDX-License-Identifier: Apache-2.0
"""A value sent by the rig interfaces: its number, and whether it may be used for control."""

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
        """Whether the number is a current value."""
        return self in (Condition.GOOD, Condition.OVERRIDE, Condition.DOUBTFUL)


@dataclasses.dataclass(frozen=True)
class RigValue:
    """
    One value for the rig, with its condition.

    stamp_ns: time of the measurement, 0 if there was none; age: s, None if there was none; sigma: 1 sigma or None. If
    `condition` is not usable, `value` is the last known one, or 0.
    """

    value: float = 0.0
    condition: Condition = Condition.WAITING
    stamp_ns: int = 0
    age: float | None = None
    sigma: float | None = None
    reason: str = ""

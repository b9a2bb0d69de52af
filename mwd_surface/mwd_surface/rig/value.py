# SPDX-License-Identifier: Apache-2.0
"""One value that the rig interfaces send: its number, and whether it may be acted upon."""

from __future__ import annotations

import dataclasses
import enum


class Condition(enum.Enum):
    """Whether a value may be acted upon, from best to worst; the words people read."""

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
        """True where the number is a current one."""
        return self in (Condition.GOOD, Condition.OVERRIDE, Condition.DOUBTFUL)


@dataclasses.dataclass(frozen=True)
class RigValue:
    """
    One value. stamp_ns: of the measurement, 0 where there never was one; age, s, None then; sigma: 1 sigma or None.

    Where `condition` is not usable `value` is the last one known, or 0.
    """

    value: float = 0.0
    condition: Condition = Condition.WAITING
    stamp_ns: int = 0
    age: float | None = None
    sigma: float | None = None
    reason: str = ""

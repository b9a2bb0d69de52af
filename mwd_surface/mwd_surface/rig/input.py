# SPDX-License-Identifier: Apache-2.0
"""
Checks of rig data: placeholders and impossible values are dropped, and jumps of depth need confirmation.

Readings come in SI with the field names of RigState. A sample has a bit for each value that may be used. A depth that
jumps is not used until later readings agree, because surveys take their depth from the rig.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.surveys.depth import DepthJumpRules, DepthRules, DepthTrack

# Possible range of each value on a rig, SI.
PLAUSIBLE: dict[str, tuple[float, float]] = {
    "block_position": (-20.0, 80.0),
    "hookload": (0.0, 2e7),
    "weight_on_bit": (-1e6, 2e6),
    "torque": (-2e5, 2e5),
    "rotary_speed": (-60.0, 60.0),
    "flow_rate": (0.0, 0.5),
    "pressure": (-1e6, 1.5e8),
    "rate_of_penetration": (0.0, 0.5),
}
_DEPTHS = ("bit_depth", "hole_depth")
_SET_BACK_NS = 60 * NANOSECONDS  # step back of the stamps above which the clock counts as set back


@dataclasses.dataclass(frozen=True)
class RigInputSettings(DepthJumpRules):
    """Rules for the acceptance of rig data."""

    accept: bool = setting(False, "Accept rig data that peers send. If false, they are ignored.")
    slips_hookload: float = setting(
        0.0, "Hookload below which the string is in slips. 0: not known, so slips are not reported.", unit="N", low=0.0
    )
    max_rate: float = setting(
        20.0,
        "Largest number of readings accepted per second; further readings are dropped. Raising it costs computing "
        "time.",
        unit="Hz",
        low=0.1,
        high=100.0,
    )


@dataclasses.dataclass
class RigInputCounts:
    """Counts of rig data."""

    taken: int = 0  #: samples returned
    refused: int = 0  #: impossible values, and depths of a bit below the bottom of the hole
    #: Depth readings that were not accepted because they jump or have an earlier stamp, and are not confirmed.
    held: int = 0
    #: Sets of readings dropped because their stamp is earlier than the last sample, or too soon after it.
    hurried: int = 0


class RigInput:
    """Checker of rig data: makes a sample from the accepted readings, and stores the last accepted depths."""

    def __init__(self, settings: RigInputSettings | None = None) -> None:
        self.settings = settings or RigInputSettings()
        self.counts = RigInputCounts()
        jumps = {field.name: getattr(self.settings, field.name) for field in dataclasses.fields(DepthJumpRules)}
        rules = DepthRules(**jumps, history=10)
        self._tracks = {name: DepthTrack(rules) for name in _DEPTHS}
        self._last_ns: int | None = None
        # Number of consecutive readings whose stamps show a clock that was set back.
        self._earlier = 0

    def take(self, readings: Mapping[str, float], stamp_ns: int) -> Samples | None:
        """
        Return one sample, `wire.RIG_STATE`, shape (1,), from simultaneous readings; None if no reading is accepted.

        readings: SI values by field name of RigState. Readings with a stamp before the last sample, or too soon after
        it, are counted and dropped. `confirm` stamps in a row that are earlier by more than a minute show a clock that
        was set back; the last of them is accepted. Fewer such stamps are from a second clock. If the bit is deeper than
        the hole by more than `slack`, both depths are dropped.
        """
        later_ns = NANOSECONDS if self._last_ns is None else stamp_ns - self._last_ns
        self._earlier = self._earlier + 1 if later_ns <= -_SET_BACK_NS else 0
        if -_SET_BACK_NS < later_ns < NANOSECONDS / self.settings.max_rate:
            self.counts.hurried += 1
            return None
        good = {name: value for name, value in readings.items() if self._is_accepted(name, value, stamp_ns)}
        if 0 < self._earlier < self.settings.confirm:
            self.counts.hurried += 1
            return None
        if good:
            self._last_ns = stamp_ns
        if (
            "bit_depth" in good
            and "hole_depth" in good
            and good["bit_depth"] > good["hole_depth"] + self.settings.slack
        ):
            # The bit cannot be below the bottom of the hole, and it is unknown which of the two depths is wrong.
            self.counts.refused += 2
            del good["bit_depth"], good["hole_depth"]
        if not good:
            return None
        sample = wire.RIG_STATE.empty(1)
        sample["stamp_ns"] = stamp_ns
        for name in wire.RIG_VALID.keys() - {"in_slips"}:
            sample[name] = math.nan
        valid = 0
        for name, value in good.items():
            sample[name] = value
            valid |= wire.RIG_VALID[name]
        if self.settings.slips_hookload > 0.0 and "hookload" in good:
            sample["in_slips"] = good["hookload"] < self.settings.slips_hookload
            valid |= wire.RIG_VALID["in_slips"]
        sample["valid"] = valid
        self.counts.taken += 1
        return sample

    def _is_accepted(self, name: str, value: float, stamp_ns: int) -> bool:
        if name in self._tracks:
            track = self._tracks[name]
            nonsense = track.refused_null
            accepted = track.update(stamp_ns, value)
            self.counts.refused += track.refused_null - nonsense
            self.counts.held += not accepted and track.refused_null == nonsense
            return accepted
        low, high = PLAUSIBLE.get(name, (math.inf, -math.inf))
        if not (math.isfinite(value) and low <= value <= high):
            self.counts.refused += 1
            return False
        return True

# SPDX-License-Identifier: Apache-2.0
"""Selection of one of several sources of a topic: the source of the highest priority that is not silent."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from mwd_sensors.core.settings import setting

# Frame names of rig data from the rig interfaces of the surface; other ROS publishers use other frame names.
OPCUA, WITS, MODBUS = "rig_opcua", "rig_wits", "rig_modbus"


@dataclasses.dataclass(frozen=True)
class SourceRules:
    """Arbitration of several sources of rig data."""

    priority: list[str] = setting(
        ["rig_floor", OPCUA, WITS, MODBUS],
        "Sources of rig data, the preferred one first. A source is named by the frame of its messages without "
        "prefix: rig_floor is a ROS publisher, the others are the rig interfaces. A source that is not in the list "
        "is used only while none of these sends, and an alarm names it.",
    )
    silent_after: float = setting(
        5.0,
        "Time without data after which the next source of the list is used. Raise it for a source that sends less "
        "often; the change of source is then later.",
        unit="s",
        low=0.5,
        high=600.0,
    )
    settle: float = setting(
        10.0,
        "Time for which a preferred source must send, without a gap of silent_after, before it is used again. Raise it "
        "for a source that comes and goes.",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    hand_hold: float = setting(
        600.0,
        "Time for which a depth set by hand is used although a source contradicts it. A source that agrees is used "
        "at once. Raise it where the rig's depth is known to be wrong.",
        unit="s",
        low=0.0,
        high=86400.0,
    )


# Rules for a topic whose sources have no order of priority: the first source stays in force.
EQUAL = SourceRules(priority=[])


class SourceSelection:
    """
    Arbitration of the sources of one topic, which are distinguished by the frame name of their messages.

    The source in force stays in force while it sends, so that two sources of one priority never alternate. Another
    source replaces it after `rules.silent_after` of silence, or if the other source has a higher priority and has sent
    for `rules.settle`.
    """

    def __init__(self, rules: SourceRules = EQUAL) -> None:
        self.rules = rules
        self.source: str | None = None  #: frame name of the source in force; None before the first message
        self._heard: dict[str, float] = {}
        self._since: dict[str, float] = {}

    def choose(self, sources: Iterable[str], now: float) -> str:
        """
        Accept the sources that have sent, in order, and return the source in force; now: steady time, s.

        Raises
        ------
        ValueError
            `sources` is empty.
        """
        spoken = list(dict.fromkeys(sources))
        if not spoken:
            raise ValueError("sources: none")
        self._heard = {name: at for name, at in self._heard.items() if now - at <= self.rules.silent_after}
        self._since = {name: self._since.get(name, now) for name in [*self._heard, *spoken]}
        self._heard |= dict.fromkeys(spoken, now)
        # Among sources of equal rank, `min` returns the first one, which has sent first.
        best = min(self._heard, key=self.rank)
        settled = now - self._since[best] >= self.rules.settle and self.rank(best) < self.rank(self.source or best)
        if self.source not in self._heard or settled:
            self.source = best
        return self.source

    def rank(self, source: str) -> int:
        """Return the rank of a source in the order of priority, from 0; a source that is not named is last."""
        name, priority = short_name(source), self.rules.priority
        return priority.index(name) if name in priority else len(priority)

    def others(self, now: float) -> list[str]:
        """Return the sources that send at `now`, except the source in force."""
        silent = self.rules.silent_after
        return sorted(name for name, at in self._heard.items() if name != self.source and now - at <= silent)

    def uninvited(self, now: float) -> list[str]:
        """Return the sources of `others` that are not named in `rules.priority`."""
        return [name for name in self.others(now) if self.rank(name) == len(self.rules.priority)]


def short_name(frame: str) -> str:
    """Return the name of a frame without the prefix of its well."""
    return frame.rpartition("/")[2]

# SPDX-License-Identifier: Apache-2.0
"""Which of several sources of one topic is used: the first, until it has been silent for a while."""

from __future__ import annotations

from collections.abc import Iterable

SILENT_S = 5.0  # a source that says nothing for so long gives way to another


class SourceSelection:
    """
    Arbitration of the sources of one topic, told apart by the frame they stamp their messages with.

    The source in force stays in force while it speaks, so that two of them never alternate; after `SILENT_S` of
    silence another takes its place.

    Attributes
    ----------
    source : str or None
        The source in force; None before the first message.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        self._heard: dict[str, float] = {}

    def choose(self, sources: Iterable[str], now: float) -> str:
        """
        Take note of the sources that have spoken, in their order, and return the one in force; now: steady time, s.

        Raises
        ------
        ValueError
            There is none.
        """
        spoken = list(dict.fromkeys(sources))
        if not spoken:
            raise ValueError("sources: none")
        self._heard = {name: at for name, at in self._heard.items() if now - at <= SILENT_S}
        self._heard |= dict.fromkeys(spoken, now)
        if self.source not in self._heard:
            self.source = spoken[0]
        return self.source

    def others(self, now: float) -> list[str]:
        """Return the sources that speak at `now` besides the one in force."""
        return sorted(name for name, at in self._heard.items() if name != self.source and now - at <= SILENT_S)

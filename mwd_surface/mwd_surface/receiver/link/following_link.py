# SPDX-License-Identifier: Apache-2.0
"""
A link that follows the tool to another configuration, to which a downlink leads.

While the tool's answer is waited for, the pressure goes to two links: one reads as before, the other as the tool will
send. The first that believes the word by which the tool repeats the command shows that the tool has obeyed; then the
other one goes on, with the words it has kept.
"""

from __future__ import annotations

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.downlink import ECHO_WORD
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link import Link, LinkOutput
from mwd_surface.receiver.words import ReceivedWord


class FollowingLink:
    """
    A link whose tool takes commands.

    Parameters
    ----------
    link : Link
        By the tool configuration in force.

    Attributes
    ----------
    link : Link
        In force.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._next: Link | None = None
        self._echo = 0
        self._kept = LinkOutput()

    @property
    def expects(self) -> int | None:
        """Answer that is waited for; None: none is."""
        return None if self._next is None else self._echo

    def expect(self, tool: ToolConfiguration, echo: int) -> None:
        """Listen beside as the tool will send once it has obeyed; echo: the code by which it says so."""
        self._next, self._echo = self.link.successor(tool), echo
        self._kept = LinkOutput()

    def go_on_as(self, tool: ToolConfiguration) -> None:
        """Wait for no answer any more: the tool runs by this configuration."""
        self._next = None
        if tool != self.link.tool:
            self.link = self.link.successor(tool)

    def push(self, time_s: Array, pressure_pa: Array) -> LinkOutput:
        """Take samples, as `Link.push`."""
        out = self.link.push(time_s, pressure_pa)
        if self._next is None:
            return out
        beside = self._next.push(time_s, pressure_pa)
        self._kept.add(beside)
        if not any(self._answers(word) for word in (*out.words, *beside.words)):
            return out
        self.link, self._next = self._next, None
        return self._kept

    def take_strokes(self, pump: int, time_s: Array) -> None:
        """Take strokes of a counter, as `Link.take_strokes`."""
        for link in (self.link, self._next):
            if link is not None:
                link.take_strokes(pump, time_s)

    def finish(self) -> LinkOutput:
        """Give what is left when no more pressure comes."""
        return self.link.finish()

    def _answers(self, word: ReceivedWord) -> bool:
        return word.usable and word.name.lower() == ECHO_WORD.lower() and word.raw == self._echo

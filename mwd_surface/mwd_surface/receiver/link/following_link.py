# SPDX-License-Identifier: Apache-2.0
"""
Link that follows the tool to the configuration a downlink command selects.

While the surface waits for the tool's answer, the pressure goes to two links: one reads with the old configuration, the
other with the new one. The tool has obeyed as soon as either link believes the word that repeats the command; then the
new link replaces the old one, including the words it has collected.
"""

from __future__ import annotations

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.downlink import ECHO_WORD
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link import Link, LinkOutput
from mwd_surface.receiver.words import ReceivedWord


class FollowingLink:
    """
    Link to a tool that takes downlink commands.

    Parameters
    ----------
    link : Link
        Link with the tool configuration in force.

    Attributes
    ----------
    link : Link
        Link in force.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._next: Link | None = None
        self._echo = 0
        self._kept = LinkOutput()

    @property
    def expects(self) -> int | None:
        """Code of the answer that is waited for, or None."""
        return None if self._next is None else self._echo

    def expect(self, tool: ToolConfiguration, echo: int) -> None:
        """Also read with the configuration that a command selects; echo: the code by which the tool confirms it."""
        self._next, self._echo = self.link.successor(tool), echo
        self._kept = LinkOutput()

    def go_on_as(self, tool: ToolConfiguration) -> None:
        """Stop waiting for an answer and read with this configuration, which the tool now uses."""
        self._next = None
        if tool != self.link.tool:
            self.link = self.link.successor(tool)

    def push(self, time_s: Array, pressure_pa: Array) -> LinkOutput:
        """Add samples, as `Link.push`."""
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
        """Add the strokes of a pump's counter, as `Link.take_strokes`."""
        for link in (self.link, self._next):
            if link is not None:
                link.take_strokes(pump, time_s)

    def finish(self) -> LinkOutput:
        """Return the output that is left when no more pressure comes."""
        return self.link.finish()

    def _answers(self, word: ReceivedWord) -> bool:
        return word.usable and word.name.lower() == ECHO_WORD.lower() and word.raw == self._echo

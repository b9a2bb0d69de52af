# SPDX-License-Identifier: Apache-2.0
"""The commands that a tool has received by downlink, and the tool configuration to which they lead."""

from __future__ import annotations

from collections import deque

from mwd_estimation.downhole.downlink_decoder import DownlinkDecoder, Received
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.telemetry import tool_commands
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


class Commands:
    """
    Commands of one tool.

    Parameters
    ----------
    tool : ToolConfiguration
        As delivered; without a downlink it takes no commands.

    Attributes
    ----------
    settings : ToolSettings
        In force.
    echo : int
        Code of the last command for the word that repeats it; 0: none yet.
    """

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool, self._downlink = tool, tool.downlink
        self._decoder = None if tool.downlink is None else DownlinkDecoder(tool.downlink)
        self._received: deque[Received] = deque()
        self.settings, self.echo = tool_commands.ToolSettings(), 0

    def listen(self, medium: str, stamps: Stamps, signal: Array) -> None:
        """Take samples of the flow, m^3/s, or of the rotation, rad/s; both of shape (n,), stamps in ns."""
        if self._decoder is not None and self._downlink is not None and self._downlink.medium == medium:
            self._received.extend(self._decoder.push(stamps, signal))

    def obey(self, now: int) -> bool:
        """Take over the commands known at a time, ns, however the samples were cut; returns whether there were any."""
        before = self.echo
        while self._decoder is not None and self._received:
            if now < self._received[0].stamp_ns + self._decoder.delay_ns:
                break
            frame = self._received.popleft().frame
            settings = self.settings.after(frame)
            try:
                tool_commands.applied(self._tool, settings)
            except ValueError:
                # The surface asks for what this tool does not have; a missing echo says that nothing changed.
                continue
            self.settings, self.echo = settings, frame.echo
        return self.echo != before

    def speak(self) -> None:
        """Flow is on again: be no longer mute."""
        self.settings = self.settings._replace(mute=False)

    def tool(self) -> ToolConfiguration:
        """Tool configuration in force."""
        return self._tool if self._downlink is None else tool_commands.applied(self._tool, self.settings)

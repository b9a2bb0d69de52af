# SPDX-License-Identifier: Apache-2.0
"""Commands that a tool has received by downlink, and the tool configuration that results from them."""

from __future__ import annotations

from collections import deque

from mwd_estimation.downhole.downlink_decoder import DownlinkDecoder, Received
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.telemetry import tool_commands
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


class Commands:
    """
    Commands received by one tool.

    Parameters
    ----------
    tool : ToolConfiguration
        Configuration as delivered; if it has no downlink, the tool accepts no commands.

    Attributes
    ----------
    settings : ToolSettings
        Settings in force.
    echo : int
        Code of the last command, for the word that repeats it; 0 before the first command.
    """

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool, self._downlink = tool, tool.downlink
        self._decoder = None if tool.downlink is None else DownlinkDecoder(tool.downlink)
        self._received: deque[Received] = deque()
        self.settings, self.echo = tool_commands.ToolSettings(), 0

    def listen(self, medium: str, stamps: Stamps, signal: Array) -> None:
        """Add samples of the flow, m^3/s, or the rotation, rad/s, depending on `medium`; shape (n,), stamps in ns."""
        if self._decoder is not None and self._downlink is not None and self._downlink.medium == medium:
            self._received.extend(self._decoder.push(stamps, signal))

    def obey(self, now: int) -> bool:
        """Apply the commands decoded by a time, ns, and return whether there were any."""
        before = self.echo
        while self._decoder is not None and self._received:
            if now < self._received[0].stamp_ns + self._decoder.delay_ns:
                break
            frame = self._received.popleft().frame
            settings = self.settings.after(frame)
            try:
                tool_commands.applied(self._tool, settings)
            except ValueError:
                # The tool cannot do what the command asks for. It does not echo it, so the surface sees that nothing
                # changed.
                continue
            self.settings, self.echo = settings, frame.echo
        return self.echo != before

    def speak(self) -> None:
        """End the muting, because the flow has been switched on again."""
        self.settings = self.settings._replace(mute=False)

    def tool(self) -> ToolConfiguration:
        """Return the tool configuration in force."""
        return self._tool if self._downlink is None else tool_commands.applied(self._tool, self.settings)

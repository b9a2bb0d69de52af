# SPDX-License-Identifier: Apache-2.0
"""Persistent memory of the downlink: settings of the tool, counters, requests and the tool's echo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_json, read_text
from mwd_sensors.core.output_files import write_whole
from mwd_sensors.telemetry.tool_commands import ToolSettings, applied
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.downlink.machine import Machine
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.downlink.tool_echo import ToolEcho


class Kept(NamedTuple):
    """Stored downlink data of one well."""

    in_force: ToolSettings = ToolSettings()  #: settings with which the tool runs now
    #: `counter`, `number`: counter of the last command that was sent, and number of the last request; 0: none yet.
    counter: int = 0
    number: int = 0
    heard: int | None = None  #: code of the last echo received from the tool; None: no echo was received
    sent: tuple[int, ...] = ()  #: echo codes of the commands sent since that echo

    @classmethod
    def of(cls, machine: Machine) -> Kept:
        """Return the data of a downlink state machine that must survive a restart."""
        return cls(machine.in_force, machine.counter, machine.number, machine.echo.heard, machine.echo.sent)

    def machine(self, tool: ToolConfiguration, settings: DownlinkSettings) -> Machine:
        """
        Return a downlink state machine that continues from the stored data.

        Raises
        ------
        ValueError
            The tool does not accept commands.
        """
        return Machine(tool, settings, self.in_force, self.counter, self.number, ToolEcho(self.heard, self.sent))


class Memory:
    """Downlink file of one well."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._written: Kept | None = None

    def read(self, tool: ToolConfiguration) -> Kept:
        """
        Read the stored data; return defaults if there is no file.

        If `tool` does not support the stored settings (the file is that of another tool), they are replaced by the
        settings of `tool` as delivered.

        Raises
        ------
        ValueError
            The file cannot be read or parsed; the message says what to do.
        """
        try:
            kept = _kept(read_text(self._file, budgets.JSON))
        except FileNotFoundError:
            return Kept()
        except (OSError, ValueError, TypeError, KeyError) as error:
            why = without_contents(self._file, error)
            raise ValueError(f"{why}; delete it if the tool runs with the settings of its tool.yaml") from error
        try:
            applied(tool, kept.in_force)
        except ValueError:
            return kept._replace(in_force=ToolSettings())
        return kept

    def write(self, kept: Kept) -> None:
        """
        Write the data if they have changed.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        if kept == self._written:
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._file, json.dumps(kept._asdict() | {"in_force": kept.in_force._asdict()}) + "\n")
        self._written = kept


def _kept(text: str) -> Kept:
    """Parse the content of a file; raise ValueError, TypeError or KeyError if it is not valid."""
    given = load_json(text)
    kept = Kept(
        ToolSettings(**given["in_force"]), given["counter"], given["number"], given["heard"], tuple(given["sent"])
    )
    numbers = (kept.counter, kept.number, *kept.sent, *(() if kept.heard is None else (kept.heard,)))
    if [type(value) for value in kept.in_force] != [type(value) for value in ToolSettings()] or any(
        type(number) is not int for number in numbers
    ):
        raise TypeError("a value has the wrong type")
    return kept

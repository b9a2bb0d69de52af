# SPDX-License-Identifier: Apache-2.0
"""What the surface must not forget of the downlink: settings of the tool, counter sent last, number of requests."""

from __future__ import annotations

import json
from pathlib import Path

from mwd_sensors.core.input_files import load_json, read_text
from mwd_sensors.core.output_files import write_whole
from mwd_sensors.telemetry.tool_commands import ToolSettings, applied
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

_MOST_CHARACTERS = 10_000


class Memory:
    """
    The file of one well.

    Parameters
    ----------
    file : Path
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._written: tuple[ToolSettings, int, int] | None = None

    def read(self, tool: ToolConfiguration) -> tuple[ToolSettings, int, int]:
        """
        Settings in force, counter and number of the last request.

        The settings are those of a tool as delivered where there is no file, or one of another tool.

        Raises
        ------
        ValueError
            The file cannot be understood; the message says what to do.
        """
        try:
            settings, counter, number = _kept(read_text(self._file, _MOST_CHARACTERS))
        except FileNotFoundError:
            return ToolSettings(), 0, 0
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ValueError(f"{self._file}: {error}; delete it if the tool runs by its tool.yaml") from error
        try:
            applied(tool, settings)
        except ValueError:
            return ToolSettings(), counter, number
        return settings, counter, number

    def write(self, in_force: ToolSettings, counter: int, number: int) -> None:
        """
        Keep the settings, the counter and the number of the last request where they have changed.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        if (in_force, counter, number) == self._written:
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(
            self._file, json.dumps({"in_force": in_force._asdict(), "counter": counter, "number": number}) + "\n"
        )
        self._written = (in_force, counter, number)


def _kept(text: str) -> tuple[ToolSettings, int, int]:
    """What a file holds; ValueError, TypeError or KeyError where it is none."""
    given = load_json(text)
    settings, counter, number = ToolSettings(**given["in_force"]), given["counter"], given.get("number", 0)
    if [type(value) for value in (*settings, counter, number)] != [type(value) for value in (*ToolSettings(), 0, 0)]:
        raise TypeError("a value is of another type")
    return settings, counter, number

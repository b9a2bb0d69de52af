# SPDX-License-Identifier: Apache-2.0
"""
Apply downlink commands to a tool configuration; tool and surface compute the same result.

A tool starts with its tool.yaml. Each command replaces one setting until the next command or power-up.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

from mwd_sensors.telemetry import meanings, sequences
from mwd_sensors.telemetry.downlink import ARGUMENTS, COMMANDS, Downlink, DownlinkFrame
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

_SEQUENCE, _PULSE_WIDTH, _CARRIER, _TOOLFACE_RATE, _SURVEY_NOW, _MUTE = range(len(COMMANDS))


class ToolSettings(NamedTuple):
    """Settings that downlink commands change."""

    sequence: int = 0  #: index, from 0, of the survey sequence and of the toolface sequence that the tool sends
    #: `pulse_width`, `carrier`: index in the tables of the downlink; -1 keeps the value of the tool configuration.
    pulse_width: int = -1
    carrier: int = -1
    toolface_rate: int = 1  #: number of times that each toolface word of a sequence is measured and sent in a row
    mute: bool = False  #: True if the tool is silent from the end of the next survey to the next flow-on or command

    def after(self, frame: DownlinkFrame) -> ToolSettings:
        """Return the settings after a command; every command except `mute` ends the silence of an earlier `mute`."""
        changes: dict[int, dict[str, Any]] = {
            _SEQUENCE: {"sequence": frame.argument},
            _PULSE_WIDTH: {"pulse_width": frame.argument},
            _CARRIER: {"carrier": frame.argument},
            _TOOLFACE_RATE: {"toolface_rate": frame.argument},
            _MUTE: {"mute": True},
        }
        return self._replace(mute=False)._replace(**changes.get(frame.command, {}))


def downlink_of(tool: ToolConfiguration) -> Downlink:
    """
    Return the downlink settings of a tool.

    Raises
    ------
    ValueError
        The tool accepts no commands.
    """
    if tool.downlink is None:
        raise ValueError(
            "downlink: this tool accepts no commands; describe its downlink in `downlink` of its tool.yaml"
        )
    return tool.downlink


def applied(tool: ToolConfiguration, settings: ToolSettings) -> ToolConfiguration:
    """
    Return the tool configuration in force after commands.

    If the transmission does not identify its sequence, the selected sequence is put first, because a receiver then
    expects the first sequence.

    Raises
    ------
    ValueError
        The tool does not support the settings: a number is above its sequences or tables, or a sequence becomes too
        long.
    """
    downlink = downlink_of(tool)
    changes: dict[str, Any] = {}
    if settings.pulse_width >= 0:
        changes["pulse_width_s"] = _chosen(downlink.pulse_widths_s, settings.pulse_width, "pulse_widths_s")
    if settings.carrier >= 0:
        frequency = _chosen(downlink.carriers_hz, settings.carrier, "carriers_hz")
        changes["carrier"] = dataclasses.replace(tool.carrier, frequency_hz=frequency)
    surveys, toolfaces = tool.surveys, tool.toolfaces
    if settings.sequence >= max(len(surveys), len(toolfaces)):
        count = max(len(surveys), len(toolfaces))
        raise ValueError(f"sequence: the tool has the numbers 0 to {count - 1}, got {settings.sequence}")
    if settings.toolface_rate < 1:
        raise ValueError(f"toolface_rate: must be from 1 to {ARGUMENTS - 1} times, got {settings.toolface_rate}")
    if not tool.names_sequences:
        surveys, toolfaces = _first(surveys, settings.sequence), _first(toolfaces, settings.sequence)
    toolfaces = tuple(_repeated(items, settings.toolface_rate) for items in toolfaces)
    changes["survey_sequences"] = tuple(map(sequences.written, surveys))
    changes["toolface_sequences"] = tuple(map(sequences.written, toolfaces))
    return dataclasses.replace(tool, **changes)


def command(tool: ToolConfiguration, name: str, value: float) -> tuple[int, int]:
    """
    Return the index in `COMMANDS` and the argument of a command, from the name and the value that a user gave.

    Parameters
    ----------
    name : str
        One of `COMMANDS`.
    value : float
        Number of the sequence, pulse width in s, carrier in Hz, or number of repeats; ignored for survey_now and mute.

    Raises
    ------
    ValueError
        The command does not exist, or the tool does not support the value.
    """
    downlink = downlink_of(tool)
    if name not in COMMANDS:
        raise ValueError(f"command: {name!r} is unknown; choose one of {', '.join(COMMANDS)}")
    number, argument = COMMANDS.index(name), 0
    if number == _PULSE_WIDTH:
        if tool.code != "mary":
            raise ValueError(f"command: this tool sends {tool.code}, which has no pulse width")
        argument = _place(downlink.pulse_widths_s, value, "pulse_width", "s")
    elif number == _CARRIER:
        if tool.code != "psk":
            raise ValueError(f"command: this tool sends {tool.code}, which has no carrier")
        argument = _place(downlink.carriers_hz, value, "carrier", "Hz")
    elif number in (_SEQUENCE, _TOOLFACE_RATE):
        if value != round(value) or not 0 <= value < ARGUMENTS:
            raise ValueError(f"value: {name} takes a whole number from 0 to {ARGUMENTS - 1}, got {value:g}")
        argument = round(value)
    applied(tool, ToolSettings().after(DownlinkFrame(1, number, argument)))
    return number, argument


def choices(tool: ToolConfiguration) -> dict[str, tuple[float, ...]]:
    """
    Return the commands of a tool by name, with the values that a user can choose (s, Hz, or numbers).

    survey_now and mute have no values. Other commands that offer no choice are left out, such as `sequence` for a tool
    with one sequence.

    Raises
    ------
    ValueError
        The tool accepts no commands.
    """
    downlink = downlink_of(tool)
    count = max(len(tool.surveys), len(tool.toolfaces))
    found: dict[str, tuple[float, ...]] = {
        "pulse_width": downlink.pulse_widths_s if tool.code == "mary" else (),
        "carrier": downlink.carriers_hz if tool.code == "psk" else (),
        "sequence": tuple(map(float, range(count))) if count > 1 else (),
        "toolface_rate": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0),
    }
    return {**{name: values for name, values in found.items() if values}, "survey_now": (), "mute": ()}


def about(tool: ToolConfiguration, frame: DownlinkFrame) -> str:
    """
    Return the effect of a command in words.

    Raises
    ------
    ValueError
        The tool accepts no commands, or its tables do not have the argument.
    """
    downlink = downlink_of(tool)
    name = COMMANDS[frame.command]
    if frame.command == _PULSE_WIDTH:
        return f"pulse width {_chosen(downlink.pulse_widths_s, frame.argument, name):g} s"
    if frame.command == _CARRIER:
        return f"carrier {_chosen(downlink.carriers_hz, frame.argument, name):g} Hz"
    return {
        "sequence": f"sequence {frame.argument}",
        "toolface_rate": f"each toolface {frame.argument} times",
        "survey_now": "send a survey now",
        "mute": "silent after the next survey until the next flow-on or command",
    }[name]


def _chosen(table: tuple[float, ...], place: int, name: str) -> float:
    if place >= len(table):
        raise ValueError(f"{name}: the tool has {len(table)} values, numbered from 0; got number {place}")
    return table[place]


def _place(table: tuple[float, ...], value: float, name: str, unit: str) -> int:
    for place, one in enumerate(table):
        if abs(one - value) <= 1e-6 * abs(one):
            return place
    if not table:
        raise ValueError(f"value: the {name} of this tool cannot be changed by a command")
    choices = ", ".join(f"{one:g}" for one in table)
    raise ValueError(f"value: the {name} of this tool can be {choices} {unit}, got {value:g}")


def _first(given: tuple[tuple[SequenceItem, ...], ...], number: int) -> tuple[tuple[SequenceItem, ...], ...]:
    if not given:
        return given
    number = min(number, len(given) - 1)
    return (given[number], *given[:number], *given[number + 1 :])


def _repeated(items: tuple[SequenceItem, ...], times: int) -> tuple[SequenceItem, ...]:
    return tuple(
        item for item in items for _ in range(times if meanings.meaning_of(item.name) in meanings.TOOLFACES else 1)
    )

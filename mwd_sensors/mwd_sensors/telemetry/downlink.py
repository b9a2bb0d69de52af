# SPDX-License-Identifier: Apache-2.0
"""
Downlink: commands from the surface to the tool by changes of flow or rotation.

A command has 18 bits: counter, command, argument and a check. The 18 bits are sent as symbols (D-WIS ADCS: ramp, hold,
amplitude) of two bits each, with four levels from the drilling value (flow or rotary speed while drilling) down to
`depth` below it. One symbol at the lowest level and one at the drilling value precede the data, so that the tool can
measure both ends of the scale; the drilling value ends the command. A hold lasts two periods of the string's torsional
oscillation, so that stick-slip does not change the mean of the hold.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import NamedTuple

from mwd_sensors.core.settings import setting

COMMANDS = ("sequence", "pulse_width", "carrier", "toolface_rate", "survey_now", "mute")
ROTATION, FLOW = "rotation", "flow"
LEVELS = 4
_ARGUMENT_BITS, _COMMAND_BITS, _CHECK_BITS = 4, 3, 8
ARGUMENTS = 1 << _ARGUMENT_BITS
COUNTERS = 8
#: Word of the uplink that repeats the last received command (`DownlinkFrame.echo`); 0 means that none was received.
ECHO_WORD = "DLnk"

_DATA_SYMBOLS = 9
# Default of `Downlink.least`, the lowest drilling value with commands: rotary speed, rad/s, and flow, m^3/s.
_LEAST = {ROTATION: 4.0, FLOW: 0.01}
# Gray code: neighbouring levels differ in one bit, so that the most likely symbol error is one bit error.
_GRAY = (0b00, 0b01, 0b11, 0b10)
# A command is: drilling value, lowest level, drilling value, 9 symbols of data, drilling value.
HEAD, TAIL = (LEVELS - 1, 0, LEVELS - 1), (LEVELS - 1,)


@dataclasses.dataclass(frozen=True)
class Downlink:
    """Settings of the downlink; surface and tool must have the same settings."""

    medium: str = setting(
        ROTATION, "Quantity that is changed: rotation of the string or flow.", choices=(ROTATION, FLOW)
    )
    ramp_s: float = setting(
        5.6,
        "Time to change from one level to the next. Raise it for slow pumps or a soft top drive; each symbol takes "
        "longer.",
        low=0.5,
        high=120.0,
    )
    hold_s: float = setting(
        11.2,
        "Time for which a level is held; for rotation, two torsional periods of the string (2 x 5.6 s at 3 km). "
        "Raising it makes weaker changes detectable; each symbol takes longer.",
        low=1.0,
        high=240.0,
    )
    depth: float = setting(
        0.4,
        "Largest reduction of rotary speed or flow in a command, as a share of the value while drilling; 0.4 is "
        "suitable for rotation, 0.2 for flow. Raise it if commands are missed; the rig then changes more, and flow "
        "must stay above the tool's threshold.",
        low=0.02,
        high=0.9,
    )
    least: float = setting(
        0.0,
        "Lowest rotary speed (rad/s) or flow (m^3/s) while drilling at which commands are sent and accepted. 0 means "
        "4 rad/s or 0.01 m^3/s. Raise it if noise at a low value looks like commands.",
        unit="rad/s or m^3/s",
        low=0.0,
        high=100.0,
    )
    pulse_widths_s: tuple[float, ...] = setting(
        (0.3, 0.5, 0.8, 1.0, 1.5), "Pulse widths that a command can select.", low=0.02, high=20.0
    )
    carriers_hz: tuple[float, ...] = setting((), "Carriers that a command can select.", low=0.1, high=200.0)

    def __post_init__(self) -> None:
        """Raise ValueError if a table has more entries than an argument can number."""
        for name in ("pulse_widths_s", "carriers_hz"):
            if len(getattr(self, name)) > ARGUMENTS:
                raise ValueError(f"{name}: at most {ARGUMENTS} values can be selected, got {len(getattr(self, name))}")

    @property
    def least_value(self) -> float:
        """Lowest rotary speed, rad/s, or flow, m^3/s, during drilling at which commands are sent and accepted."""
        return self.least or _LEAST[self.medium]

    @property
    def symbol_s(self) -> float:
        """Duration of a symbol, s."""
        return self.ramp_s + self.hold_s

    @property
    def table_check(self) -> int:
        """Start value of the CRC, computed from the tables: a tool with other tables rejects the command."""
        text = " ".join(f"{value:g}" for value in (*self.pulse_widths_s, -1.0, *self.carriers_hz))
        return _crc8(int.from_bytes(text.encode(), "big"), 8 * len(text), 0xFF)


class DownlinkFrame(NamedTuple):
    """One command: counter 1 to 7 (0 means no command), index of the command in `COMMANDS`, argument 0 to 15."""

    counter: int
    command: int
    argument: int

    @property
    def echo(self) -> int:
        """Code of the word with which the tool repeats the command."""
        return (self.counter << _COMMAND_BITS | self.command) << _ARGUMENT_BITS | self.argument


def frame_of(echo: int) -> DownlinkFrame | None:
    """Return the command that an echo repeats; None if the tool has received no command, or the code is not valid."""
    argument, rest = echo % ARGUMENTS, echo >> _ARGUMENT_BITS
    command, counter = rest % (1 << _COMMAND_BITS), rest >> _COMMAND_BITS
    if not 0 < counter < COUNTERS or command >= len(COMMANDS):
        return None
    return DownlinkFrame(counter, command, argument)


def next_counter(counter: int) -> int:
    """Return the counter of the next command, 1 to 7; after 7 comes 1."""
    return counter % (COUNTERS - 1) + 1


class Symbol(NamedTuple):
    """One symbol (D-WIS): duration of its ramp, s, of its hold, s, and amplitude as a share of the drilling value."""

    ramp_s: float
    hold_s: float
    amplitude: float


def levels(frame: DownlinkFrame, downlink: Downlink) -> tuple[int, ...]:
    """
    Return the levels of the symbols of a command in order: 0 is the lowest level, 3 the drilling value.

    Raises
    ------
    ValueError
        The counter, command or argument has no code.
    """
    if frame_of(frame.echo) != frame or not 0 <= frame.argument < ARGUMENTS:
        raise ValueError(f"frame: counter 1 to 7, command 0 to 5 and argument 0 to 15 are sent, got {tuple(frame)}")
    check = _crc8(frame.echo, _DATA_SYMBOLS * 2 - _CHECK_BITS, downlink.table_check)
    bits = frame.echo << _CHECK_BITS | check
    data = [_GRAY.index(bits >> 2 * k & 3) for k in reversed(range(_DATA_SYMBOLS))]
    return (*HEAD[1:], *data, *TAIL)


def decode(data: tuple[int, ...], downlink: Downlink) -> DownlinkFrame | None:
    """
    Return the command that the levels of the 9 data symbols encode; None if CRC, counter or command are not valid.

    data: level of each data symbol, as in `levels`.
    """
    bits = 0
    for level in data:
        bits = bits << 2 | _GRAY[level]
    echo, check = bits >> _CHECK_BITS, bits & 0xFF
    if _crc8(echo, _DATA_SYMBOLS * 2 - _CHECK_BITS, downlink.table_check) != check:
        return None
    return frame_of(echo)


@dataclasses.dataclass(frozen=True)
class DownlinkProgramme:
    """Set-points of a command as a function of time."""

    symbols: tuple[Symbol, ...]

    @property
    def duration_s(self) -> float:
        """Duration from the first ramp to the end of the last hold, s."""
        return sum(one.ramp_s + one.hold_s for one in self.symbols)

    @property
    def lowest(self) -> float:
        """Lowest set-point as a share of the drilling value."""
        return min(one.amplitude for one in self.symbols)

    def at(self, time_s: float) -> float:
        """Return the set-point, share of the drilling value, at a time after the start, s; linear on the ramps."""
        before = 1.0
        for symbol in self.symbols:
            if time_s < symbol.ramp_s:
                return before + (symbol.amplitude - before) * max(time_s, 0.0) / symbol.ramp_s
            time_s -= symbol.ramp_s + symbol.hold_s
            before = symbol.amplitude
            if time_s < 0.0:
                break
        return before

    def number_at(self, time_s: float) -> int:
        """Return the number of the symbol being sent, from 1; 0 before the start."""
        if time_s < 0.0:
            return 0
        ends = itertools.accumulate(one.ramp_s + one.hold_s for one in self.symbols)
        return min(sum(end <= time_s for end in ends) + 1, len(self.symbols))


def amplitude(level: float, downlink: Downlink) -> float:
    """Return the amplitude of a level as a share of the drilling value."""
    return 1.0 - downlink.depth * (LEVELS - 1 - level) / (LEVELS - 1)


def programme(frame: DownlinkFrame, downlink: Downlink) -> DownlinkProgramme:
    """Return the set-points that send a command. Raises ValueError as `levels` does."""
    return DownlinkProgramme(
        tuple(Symbol(downlink.ramp_s, downlink.hold_s, amplitude(level, downlink)) for level in levels(frame, downlink))
    )


def _crc8(value: int, bits: int, start: int) -> int:
    """Return the CRC-8 with polynomial 0x2F (AUTOSAR CRC8H2F); it detects three wrong bits in up to 119 bits."""
    register = start
    for k in reversed(range(bits)):
        feedback = register >> 7 & 1 ^ value >> k & 1
        register = (register << 1 & 0xFF) ^ (0x2F if feedback else 0)
    return register

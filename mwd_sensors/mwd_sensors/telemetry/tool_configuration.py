# SPDX-License-Identifier: Apache-2.0
"""
Tool configuration (tool.yaml): everything that the surface needs to decode the transmission of a tool.

All differences between MWD kits are settings here. Transmission times follow from these settings.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.foreign_text import contents_hidden
from mwd_sensors.core.input_files import load_yaml, read_text
from mwd_sensors.core.settings import setting
from mwd_sensors.core.units import LPM
from mwd_sensors.telemetry import (
    checksum,
    log_channels,
    meanings,
    pulse_position,
    sequences,
    serial_frames,
)
from mwd_sensors.telemetry.carrier import MOST_SEQUENCES, Carrier, Coil, blocks_of
from mwd_sensors.telemetry.downlink import Downlink
from mwd_sensors.telemetry.log_channels import LogChannel
from mwd_sensors.telemetry.pulse_position import PULSE_TU, Pulses
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.serial_frames import SerialLine
from mwd_sensors.telemetry.tool_limits import ToolLimits
from mwd_sensors.telemetry.words import COMMON, Word

_SURVEY = "Inc:12:P Azm:12:P DipA:12:P Temp:8:P Grav:12:P MagF:12:P BatV:8:P"
_TOOLFACE = "3{2{aTFA:6:P} Gama:8:P aTFA:6:P Gama:8:P} RINC:11:P RAZM:11:P"


@dataclasses.dataclass(frozen=True)
class Sync:
    """Pulse pattern that marks the start of a transmission."""

    # All distances between two of these pulses differ by more than 1 TU, so a shifted copy of the sync and the sync
    # have at most one pulse in common.
    edges_tu: tuple[int, ...] = setting(
        (0, 5, 14, 21, 32), "Times of the leading edges of the pulses, from the start of the sync.", unit="TU", low=0
    )
    length_tu: int = setting(40, "Time from the start of the sync to the first packet.", unit="TU", low=1)

    def __post_init__(self) -> None:
        """
        Check the pulses.

        Raises ValueError if there are fewer than three edges (noise would look like a sync), edges are out of order or
        overlap, or the length is too short.
        """
        if len(self.edges_tu) < 3:
            raise ValueError(f"edges_tu: a sync needs three pulses or more, got {len(self.edges_tu)}")
        if any(b - a < PULSE_TU for a, b in itertools.pairwise(self.edges_tu)):
            raise ValueError(f"edges_tu: must rise by {PULSE_TU} TU or more, the width of a pulse: {self.edges_tu}")
        if self.length_tu < self.edges_tu[-1] + PULSE_TU:
            raise ValueError(f"length_tu: {self.length_tu} ends before the last pulse of the sync does")


@dataclasses.dataclass(frozen=True)
class ToolConfiguration:
    """Configuration of a tool's transmission."""

    code: str = setting(
        "mary",
        "Code of the words: pulses (mary), phases of a carrier (psk) or a serial line (serial).",
        choices=("mary", "psk", "serial"),
    )
    pulse_width_s: float = setting(0.8, "Duration of a pulse; 1 TU is half of it.", low=0.02, high=20.0)
    sync: Sync = setting(Sync, "Pulse pattern that starts a transmission.")
    carrier: Carrier = setting(Carrier, "Carrier and its blocks, for the code psk.")
    coil: Coil = setting(Coil, "Coil of a sonde, for a carrier with the medium coil.")
    serial: SerialLine = setting(SerialLine, "Line and frames, for the code serial.")
    header_bits: int = setting(
        0,
        "Number of bits after the sync that give the number of the sequence, from 0. With 0 bits the tool always "
        "sends the first sequence.",
        low=0,
        high=6,
    )
    parity: str = setting("even", "Parity of words marked P; the parity bit comes last.", choices=("even", "odd"))
    missing_code: bool = setting(
        False,
        "Whether the highest code of each word means that the tool has no measurement; the other codes then share the "
        "range. Without it the tool sends 0 for a missing measurement, as many kits do, and the surface reads a value.",
    )
    flow_threshold_lpm: float = setting(
        600.0,
        "Flow above which the tool considers the pumps on. Raise it if some flow remains during connections. Below "
        "this flow the tool is silent, unless it is on a wire.",
        low=1.0,
        high=20000.0,
    )
    transmit_delay_s: float = setting(45.0, "Time from flow-on to the sync.", low=0.0, high=3600.0)
    downlink: Downlink | None = setting(None, "Downlink for commands from the surface; none if the tool accepts none.")
    words: dict[str, Word] = setting({}, "Ranges of words by name; they replace the ranges that kits commonly use.")
    channels: dict[str, LogChannel] = setting(
        {},
        "Log channels by name: what the tool measures against depth, and the words that carry it. Without any, the "
        "usual ones: gamma, inclination, temperature, lateral vibration, battery and self-tests.",
    )
    health: ToolLimits = setting(
        ToolLimits, "Limits and parts of the tool: battery, temperature, vibration, calibration."
    )
    survey_sequences: tuple[str, ...] = setting(
        (_SURVEY,), "Sequences of survey words; one of them is sent once after each flow-on."
    )
    toolface_sequences: tuple[str, ...] = setting(
        (_TOOLFACE,),
        "Sequences of toolface words; one of them is sent repeatedly after the survey. Leave it empty, {}, for a tool "
        "that sends surveys only.",
    )

    def __post_init__(self) -> None:
        """
        Check the sequences.

        Raises ValueError if the code cannot send a sequence, or a sequence cannot be read; the survey is missing; the
        header has one bit, or too few bits to number the sequences; or the unit of a word is not a unit of its
        quantity.
        """
        for name, word in self.words.items():
            try:
                meanings.check_unit(name, word.unit)
            except ValueError as error:
                raise ValueError(f"words.{name}.{error}") from error
        log_channels.check(self.channels, self.table)
        for name in ("survey_sequences", "toolface_sequences"):
            texts = getattr(self, name)
            if not texts and name == "survey_sequences":
                raise ValueError(f"{name}: at least one is needed")
            # Without a header only the first sequence is sent; the others may stay in the file unused.
            if self.header_bits and len(texts) > 2**self.header_bits:
                raise ValueError(f"{name}: {self.header_bits} header bits cannot number {len(texts)} sequences")
            for k, text in enumerate(texts):
                try:
                    sequences.parse(text, self.table)
                except ValueError as error:
                    raise ValueError(f"{name}[{k}]: {error}") from error
            self._check_code(name)
        if self.header_bits == 1:
            raise ValueError("header_bits: no packet has 1 bit; use 2 or more, or 0")

    def _check_code(self, name: str) -> None:
        """Raise ValueError if the code cannot send the sequences of the setting `name`."""
        parsed = self.surveys if name == "survey_sequences" else self.toolfaces
        if self.code != "mary" and len(parsed) > MOST_SEQUENCES:
            raise ValueError(f"{name}: {self.code} can number {MOST_SEQUENCES} sequences, got {len(parsed)}")
        for k, items in enumerate(parsed):
            try:
                if self.code == "psk":
                    blocks_of(items, self.carrier.block_bits)
                elif self.code == "serial":
                    serial_frames.check(items)
            except ValueError as error:
                raise ValueError(f"{name}[{k}]: {error}") from error

    @functools.cached_property
    def table(self) -> Mapping[str, Word]:
        """All words by name; the tool's own words replace common ones."""
        words = {**COMMON, **self.words}
        return (
            {name: dataclasses.replace(word, reserved=True) for name, word in words.items()}
            if self.missing_code
            else words
        )

    @functools.cached_property
    def logged(self) -> Mapping[str, LogChannel]:
        """Log channels by name: the configured channels, or the usual ones if none are configured."""
        return self.channels or log_channels.usual(self.table)

    @functools.cached_property
    def table_check(self) -> int:
        """Start value of the checks, computed from the words: with other words at the surface every check fails."""
        rows = [
            f"{item.name}:{item.bits}:{item.parity}:{self.table[item.name].low:g}:{self.table[item.name].high:g}"
            f"{':missing' if self.table[item.name].reserved else ''}"
            for items in (*self.surveys, *self.toolfaces)
            for item in items
        ]
        return checksum.crc16(" ".join(rows).encode())

    @property
    def tu_s(self) -> float:
        """Time unit of pulses (1 TU), half a pulse width, s."""
        return self.pulse_width_s / PULSE_TU

    @property
    def flow_threshold(self) -> float:
        """Flow above which the tool considers the pumps on, m^3/s."""
        return self.flow_threshold_lpm * LPM

    @property
    def medium(self) -> str:
        """Medium of the transmission: mud, earth, coil or serial."""
        return {"psk": self.carrier.medium, "serial": "serial"}.get(self.code, "mud")

    @property
    def link(self) -> str:
        """Name of the link: mud_pulse, em, coil or serial."""
        return {"mud": "mud_pulse", "earth": "em"}.get(self.medium, self.medium)

    @property
    def names_sequences(self) -> bool:
        """Whether the transmission identifies its sequence, by a header or in the blocks or frames."""
        return self.header_bits > 0 or self.code != "mary"

    @property
    def symbol_s(self) -> float:
        """Duration of a symbol of a carrier or of a bit on a line, s; NaN for pulses."""
        return {"psk": 1.0 / self.carrier.symbol_rate_hz, "serial": 1.0 / self.serial.baud}.get(self.code, math.nan)

    @property
    def shortest_s(self) -> float:
        """Time unit of pulses, s; for a carrier, 1.6 divided by the highest frequency of its band, s."""
        if self.code == "psk":
            return 1.6 / (self.carrier.frequency_hz + 2.0 * self.carrier.symbol_rate_hz)
        return self.tu_s

    @functools.cached_property
    def surveys(self) -> tuple[tuple[SequenceItem, ...], ...]:
        """Survey sequences, parsed."""
        return tuple(sequences.parse(text, self.table) for text in self.survey_sequences)

    @functools.cached_property
    def toolfaces(self) -> tuple[tuple[SequenceItem, ...], ...]:
        """Toolface sequences, parsed."""
        return tuple(sequences.parse(text, self.table) for text in self.toolface_sequences)

    def sequence(self, kind: str, number: int) -> tuple[SequenceItem, ...]:
        """Return the sequence of a kind and number, the last one for a higher number; empty if the tool sends none."""
        sequences = self.surveys if kind == "survey" else self.toolfaces
        return sequences[min(number, len(sequences) - 1)] if sequences else ()

    def parity_bit(self, code: int) -> int:
        """Return the parity bit of a word's value."""
        return code.bit_count() & 1 ^ (self.parity == "odd")

    def length_tu(self, items: tuple[SequenceItem, ...]) -> int:
        """Return the duration of a sequence without its sync and header, TU."""
        return sum(pulse_position.encode(0, item.length).length for item in items)

    def seconds(self, items: tuple[SequenceItem, ...]) -> float:
        """Return the time to send a sequence once, s; for pulses, sync and header are not included."""
        if self.code == "psk":
            return len(blocks_of(items, self.carrier.block_bits)) * self.carrier.block_s
        if self.code == "serial":
            on_line = serial_frames.frame_bytes(items) * serial_frames.BITS_PER_BYTE / self.serial.baud
            return max(on_line, self.serial.period_s)
        return self.length_tu(items) * self.tu_s

    @property
    def head_s(self) -> float:
        """Duration of sync and header, s; 0 if each block or frame identifies itself."""
        return (self.sync.length_tu + self.header_tu) * self.tu_s if self.code == "mary" else 0.0

    def sent(self, items: tuple[SequenceItem, ...], codes: tuple[int | None, ...]) -> tuple[int, ...]:
        """Return the transmitted codes, with parity bits where words have one; None means a missing measurement."""
        return tuple(
            self._sent(item, self.table[item.name].missing(item.bits) or 0 if code is None else code)
            for item, code in zip(items, codes, strict=True)
        )

    def _sent(self, item: SequenceItem, code: int) -> int:
        return code << 1 | self.parity_bit(code) if item.parity else code

    @property
    def header_tu(self) -> int:
        """Duration of the header, TU."""
        return pulse_position.encode(0, self.header_bits).length if self.header_bits else 0


def encode(
    tool: ToolConfiguration, items: tuple[SequenceItem, ...], codes: tuple[int | None, ...], number: int | None = None
) -> Pulses:
    """
    Return the pulses of a sequence that is sent once.

    Parameters
    ----------
    codes : tuple of int
        Value of each word without parity; None for a missing measurement.
    number : int, optional
        Number of the sequence, if sync and header come first; None to leave out sync and header.

    Returns
    -------
    Pulses
        Leading edges and length, TU.

    Raises
    ------
    ValueError
        The numbers of codes and words differ.
    """
    edges: list[int] = []
    at = 0
    if number is not None:
        edges += tool.sync.edges_tu
        at = tool.sync.length_tu
        if tool.header_bits:
            head = pulse_position.encode(number, tool.header_bits)
            edges += [at + edge for edge in head.edges]
            at += head.length
    for item, sent in zip(items, tool.sent(items, codes), strict=True):
        one = pulse_position.encode(sent, item.length)
        edges += [at + edge for edge in one.edges]
        at += one.length
    return Pulses(tuple(edges), at)


def from_mapping(given: Mapping[str, Any]) -> ToolConfiguration:
    """
    Return the configuration from the content of a YAML file; sequences may be a list or a table with names.

    Raises
    ------
    SettingsError
        A key is unknown (similar ones are suggested) or a value is not allowed.
    """
    if not isinstance(given, Mapping):
        raise settings.SettingsError(f"tool: expected a table of settings, got {given!r}")
    plain = dict(given)
    for name in ("survey_sequences", "toolface_sequences"):
        if isinstance(plain.get(name), Mapping):
            plain[name] = list(plain[name].values())
        elif isinstance(plain.get(name), str):
            plain[name] = [plain[name]]
        elif name in plain and plain[name] is None:
            plain[name] = []
    return settings.from_mapping(ToolConfiguration, plain)


def read(path: Path) -> ToolConfiguration:
    """
    Read a tool configuration.

    Raises
    ------
    ValueError
        The file is not YAML or describes an impossible tool; the message names file and key.
    OSError
        The file cannot be read.
    """
    try:
        given = load_yaml(read_text(path, budgets.YAML))
    except yaml.YAMLError as error:
        raise ValueError(f"{path}: not YAML: {error}") from error
    if given is None:
        # Without this check, a file that was copied incompletely would be the default tool.
        raise ValueError(f"{path} has no settings; `mwd tool new` writes an example of a tool configuration")
    try:
        return from_mapping(given)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_several(paths: Iterable[Path]) -> tuple[ToolConfiguration, ...]:
    """
    Read the configurations of the links of one tool for a node; errors do not quote the files.

    Raises
    ------
    ValueError
        A file cannot be used, or two files describe the same link.
    """
    tools: dict[str, ToolConfiguration] = {}
    for path in paths:
        with contents_hidden(path, "`mwd tool check`"):
            tool = read(path)
        if tool.link in tools:
            raise ValueError(f"{path}: two tools on the link {tool.link}; give each link one tool configuration")
        tools[tool.link] = tool
    return tuple(tools.values())


def starting(code: str) -> ToolConfiguration:
    """
    Return the default configuration for a code, with the usual sequences of MWD kits, as a template for users.

    Raises
    ------
    SettingsError
        The code does not exist.
    """
    plain = from_mapping({"code": code})
    if code == "mary":
        return plain
    # The check of the whole block or frame makes parity bits unnecessary.
    surveys, toolfaces = (
        tuple(sequences.written(tuple(item._replace(parity=False) for item in items)) for items in kind)
        for kind in (plain.surveys, plain.toolfaces)
    )
    return dataclasses.replace(plain, survey_sequences=surveys, toolface_sequences=toolfaces)


def text(tool: ToolConfiguration) -> str:
    """Return the YAML of a configuration, which `read` reads back."""
    return str(yaml.safe_dump(settings.to_mapping(tool), sort_keys=False, allow_unicode=True, width=110))

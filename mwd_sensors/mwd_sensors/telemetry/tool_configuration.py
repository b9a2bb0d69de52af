# SPDX-License-Identifier: Apache-2.0
"""
The tool configuration (tool.yaml): all that the surface has to know of a tool to read what it sends.

Kits differ in nothing that is not named here. Times on air follow from it.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.foreign_text import contents_hidden
from mwd_sensors.core.input_files import load_yaml, read_text
from mwd_sensors.core.settings import setting
from mwd_sensors.core.units import LPM
from mwd_sensors.telemetry import checksum, combinatorial, meanings, pulse_position, sequences, serial_frames
from mwd_sensors.telemetry.carrier import MOST_SEQUENCES, Carrier, blocks_of
from mwd_sensors.telemetry.downlink import Downlink
from mwd_sensors.telemetry.pulse_position import PULSE_TU, Pulses
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.serial_frames import SerialLine
from mwd_sensors.telemetry.words import COMMON, Word

PULSE_CODES = {"mary": pulse_position.encode, "combinatorial": combinatorial.encode}
_SURVEY = "Inc:12:P Azm:12:P DipA:12:P Temp:8:P Grav:12:P MagF:12:P BatV:8:P"
_TOOLFACE = "3{2{aTFA:6:P} Gama:8:P aTFA:6:P Gama:8:P} RINC:11:P RAZM:11:P"


@dataclasses.dataclass(frozen=True)
class Sync:
    """Pulses that mark the start of a transmission."""

    edges_tu: tuple[int, ...] = setting((0, 5, 15, 20, 30), "Leading edges after its start.", unit="TU", low=0)
    length_tu: int = setting(40, "From its start to the first packet.", unit="TU", low=1)

    def __post_init__(self) -> None:
        """
        Check the pulses.

        Raises
        ------
        ValueError
            Fewer than three edges (noise would look like it), edges out of order or overlapping, or too short a length.
        """
        if len(self.edges_tu) < 3:
            raise ValueError(f"edges_tu: a sync needs three pulses or more, got {len(self.edges_tu)}")
        if any(b - a < PULSE_TU for a, b in itertools.pairwise(self.edges_tu)):
            raise ValueError(f"edges_tu: must rise by {PULSE_TU} TU or more, the width of a pulse: {self.edges_tu}")
        if self.length_tu < self.edges_tu[-1] + PULSE_TU:
            raise ValueError(f"length_tu: {self.length_tu} ends before the last pulse of the sync does")


@dataclasses.dataclass(frozen=True)
class ToolConfiguration:
    """What a tool sends, and how."""

    code: str = setting(
        "mary",
        "How words are sent: pulses (mary, combinatorial), phases of a carrier (psk) or a serial line (serial).",
        choices=(*PULSE_CODES, "psk", "serial"),
    )
    pulse_width_s: float = setting(0.8, "Time a pulse lasts; 1 TU is half of it.", unit="s", low=0.02, high=20.0)
    sync: Sync = setting(Sync, "Start of a transmission.")
    carrier: Carrier = setting(Carrier, "Carrier and its blocks, of the code psk.")
    serial: SerialLine = setting(SerialLine, "Line and frames, of the code serial.")
    header_bits: int = setting(
        0, "Bits behind the sync with the number of the sequence, from 0; 0: always the first.", low=0, high=6
    )
    parity: str = setting("even", "Parity of words marked P; its bit comes last.", choices=("even", "odd"))
    missing_code: bool = setting(
        False,
        "Whether the highest code of each word says that the tool has no measurement, and the other codes share the "
        "range. Without it the tool sends 0, as many kits do, and the surface takes that for a value.",
    )
    flow_threshold_lpm: float = setting(
        600.0,
        "Flow above which the tool takes the pumps for on. Raise it where the flow between connections stays high; a "
        "tool without a wire is silent below it.",
        unit="l/min",
        low=1.0,
        high=20000.0,
    )
    transmit_delay_s: float = setting(45.0, "From flow-on to the sync.", unit="s", low=0.0, high=3600.0)
    downlink: Downlink | None = setting(None, "How the tool takes commands from the surface; none: it takes none.")
    words: dict[str, Word] = setting({}, "Ranges of the words, by name; they replace those that kits commonly use.")
    survey_sequences: tuple[str, ...] = setting((_SURVEY,), "Sent once after each flow-on.")
    toolface_sequences: tuple[str, ...] = setting((_TOOLFACE,), "Sent behind the survey again and again.")

    def __post_init__(self) -> None:
        """
        Check the sequences.

        Raises
        ------
        ValueError
            A sequence that cannot be read, none at all, or more of a kind than the header can number; a word in a unit
            that does not fit what its name means.
        """
        for name, word in self.words.items():
            try:
                meanings.check_unit(name, word.unit)
            except ValueError as error:
                raise ValueError(f"words.{name}.{error}") from error
        for name in ("survey_sequences", "toolface_sequences"):
            texts = getattr(self, name)
            if not texts:
                raise ValueError(f"{name}: at least one is needed")
            # Without a header the first is sent always; the others may stand there unused.
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
        """Refuse sequences that the code cannot send; name: of the setting that holds them."""
        parsed = self.surveys if name == "survey_sequences" else self.toolfaces
        if self.code not in PULSE_CODES and len(parsed) > MOST_SEQUENCES:
            raise ValueError(f"{name}: {self.code} can number {MOST_SEQUENCES} sequences, got {len(parsed)}")
        for k, items in enumerate(parsed):
            try:
                if self.code == "psk":
                    blocks_of(items, self.carrier.block_bits)
                elif self.code == "combinatorial":
                    combinatorial.check(items)
                elif self.code == "serial":
                    serial_frames.check(items)
            except ValueError as error:
                raise ValueError(f"{name}[{k}]: {error}") from error

    @functools.cached_property
    def table(self) -> Mapping[str, Word]:
        """All words by name, the tool's own before the common ones."""
        words = {**COMMON, **self.words}
        return (
            {name: dataclasses.replace(word, reserved=True) for name, word in words.items()}
            if self.missing_code
            else words
        )

    @functools.cached_property
    def table_check(self) -> int:
        """Start of the checks of blocks and frames: with another table of words at the surface no check holds."""
        rows = [
            f"{item.name}:{item.bits}:{item.parity}:{self.table[item.name].low:g}:{self.table[item.name].high:g}"
            f"{':missing' if self.table[item.name].reserved else ''}"
            for items in (*self.surveys, *self.toolfaces)
            for item in items
        ]
        return checksum.crc16(" ".join(rows).encode())

    @property
    def tu_s(self) -> float:
        """Time unit, s."""
        return self.pulse_width_s / PULSE_TU

    @property
    def flow_threshold(self) -> float:
        """Flow above which the tool takes the pumps for on, m^3/s."""
        return self.flow_threshold_lpm * LPM

    @property
    def medium(self) -> str:
        """What carries the words: mud, earth or serial."""
        return {"psk": self.carrier.medium, "serial": "serial"}.get(self.code, "mud")

    @property
    def link(self) -> str:
        """Name of the link: mud_pulse, em or serial."""
        return {"mud": "mud_pulse", "earth": "em", "serial": "serial"}[self.medium]

    @property
    def names_sequences(self) -> bool:
        """Whether the surface can tell one sequence from another: by a header, or by what blocks and frames carry."""
        return self.header_bits > 0 or self.code not in PULSE_CODES

    @property
    def symbol_s(self) -> float:
        """Time of a symbol of a carrier or of a bit on a line, s; 0 for pulses."""
        return {"psk": 1.0 / self.carrier.symbol_rate_hz, "serial": 1.0 / self.serial.baud}.get(self.code, 0.0)

    @property
    def shortest_s(self) -> float:
        """Time unit of pulses, or what it would be of a carrier, s: the signal ends at 1.6 over it, Hz."""
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

    def parity_bit(self, code: int) -> int:
        """Bit that follows a word's value."""
        return code.bit_count() & 1 ^ (self.parity == "odd")

    def pulses(self, code: int, bits: int) -> Pulses:
        """Pulses of a whole number of so many bits, parity included."""
        return PULSE_CODES[self.code](code, bits)

    def length_tu(self, items: tuple[SequenceItem, ...]) -> int:
        """Time on air of a sequence without its sync and header, TU."""
        return sum(self.pulses(0, item.length).length for item in items)

    def seconds(self, items: tuple[SequenceItem, ...]) -> float:
        """Time on air of one pass of a sequence, s; of pulses without sync and header, which may be left out."""
        if self.code == "psk":
            return len(blocks_of(items, self.carrier.block_bits)) * self.carrier.block_s
        if self.code == "serial":
            on_line = serial_frames.frame_bytes(items) * serial_frames.BITS_PER_BYTE / self.serial.baud
            return max(on_line, self.serial.period_s)
        return self.length_tu(items) * self.tu_s

    @property
    def head_s(self) -> float:
        """Time on air of sync and header, s; 0 where each block or frame names itself."""
        return (self.sync.length_tu + self.header_tu) * self.tu_s if self.code in PULSE_CODES else 0.0

    def sent(self, items: tuple[SequenceItem, ...], codes: tuple[int | None, ...]) -> tuple[int, ...]:
        """Codes as they are sent: with the parity bit last where a word has one; None: the tool has no measurement."""
        return tuple(
            self._sent(item, max(self.table[item.name].missing(item.bits), 0) if code is None else code)
            for item, code in zip(items, codes, strict=True)
        )

    def _sent(self, item: SequenceItem, code: int) -> int:
        return code << 1 | self.parity_bit(code) if item.parity else code

    @property
    def header_tu(self) -> int:
        """Time on air of the header, TU."""
        return self.pulses(0, self.header_bits).length if self.header_bits else 0


def encode(
    tool: ToolConfiguration, items: tuple[SequenceItem, ...], codes: tuple[int | None, ...], number: int | None = None
) -> Pulses:
    """
    Pulses of one pass of a sequence.

    Parameters
    ----------
    tool : ToolConfiguration
    items : tuple of SequenceItem
    codes : tuple of int
        Value of each word, without parity; None: no measurement.
    number : int, optional
        Of the sequence: sync and header come first. None: the pass follows another one without.

    Returns
    -------
    Pulses
        Leading edges and length, TU.

    Raises
    ------
    ValueError
        The codes are not as many as the words.
    """
    edges: list[int] = []
    at = 0
    if number is not None:
        edges += tool.sync.edges_tu
        at = tool.sync.length_tu
        if tool.header_bits:
            head = tool.pulses(number, tool.header_bits)
            edges += [at + edge for edge in head.edges]
            at += head.length
    for item, sent in zip(items, tool.sent(items, codes), strict=True):
        one = tool.pulses(sent, item.length)
        edges += [at + edge for edge in one.edges]
        at += one.length
    return Pulses(tuple(edges), at)


def from_mapping(given: Mapping[str, Any]) -> ToolConfiguration:
    """
    Build a configuration from the content of a YAML file; sequences may be a list or a table of names.

    Raises
    ------
    SettingsError
        An unknown key, with its near misses, or a value that is not allowed.
    """
    if not isinstance(given, Mapping):
        raise settings.SettingsError(f"tool: expected a table of settings, got {given!r}")
    plain = dict(given)
    for name in ("survey_sequences", "toolface_sequences"):
        if isinstance(plain.get(name), Mapping):
            plain[name] = list(plain[name].values())
        elif isinstance(plain.get(name), str):
            plain[name] = [plain[name]]
    return settings.from_mapping(ToolConfiguration, plain)


def read(path: Path) -> ToolConfiguration:
    """
    Read a tool configuration.

    Raises
    ------
    ValueError
        The file is no YAML, or says what no tool can do; the message names file and key.
    OSError
        The file cannot be read.
    """
    try:
        given = load_yaml(read_text(path, budgets.YAML)) or {}
    except yaml.YAMLError as error:
        raise ValueError(f"{path}: no YAML: {error}") from error
    try:
        return from_mapping(given)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_several(paths: Iterable[Path]) -> tuple[ToolConfiguration, ...]:
    """
    Read the configurations of the links of one tool, for a node: errors quote nothing of the files.

    Raises
    ------
    ValueError
        A file cannot be used, or two of them are of one link.
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
    Configuration of a code to begin with: sequences as kits have them.

    Raises
    ------
    SettingsError
        There is no such code.
    """
    plain = from_mapping({"code": code, "missing_code": True})
    if code in PULSE_CODES:
        return plain
    # A check of the whole block or frame makes the parity of each word needless.
    surveys, toolfaces = (
        tuple(sequences.written(tuple(item._replace(parity=False) for item in items)) for items in kind)
        for kind in (plain.surveys, plain.toolfaces)
    )
    return dataclasses.replace(plain, survey_sequences=surveys, toolface_sequences=toolfaces)


def text(tool: ToolConfiguration) -> str:
    """YAML of a configuration; `read` gives it back."""
    return str(yaml.safe_dump(settings.to_mapping(tool), sort_keys=False, allow_unicode=True, width=110))

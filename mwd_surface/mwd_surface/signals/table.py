# SPDX-License-Identifier: Apache-2.0
"""
Signal table, `table.csv`: every quantity once, with its name on the page and in each protocol and file.

The table defines WITS items, Modbus registers, OPC UA variables, the D-WIS manifest, columns of surveys in CSV,
Parquet, LAS, WITSML and on paper, columns of attitude and recordings in CSV and Parquet, live quantities of the page,
and the documentation page of signals. The D-WIS nouns are those of the DDHub vocabulary (definition sets
DrillingDataSemantics, PhysicalLocation and Uncertainty). The vocabulary has no noun for a toolface, gravity or a
magnetic field; the rows of these quantities name only the kind of data.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.signals.units import DEG_PER_H, METRIC, UNITS, UnitScale

ESTIMATOR, RIG, BIT, PLAN, SURVEY, POSITION = "estimator", "rig", "bit", "plan", "survey", "position"  # sources
CONTROL, ADVICE, INPUT, SURFACE, LOG = "control", "advice", "input", "surface", "log"
TYPES = ("Double", "UInt32", "Int64", "Boolean", "String")
# Signals whose value is the vertical angle of the hole, not a difference of two such angles.
INCLINATIONS = frozenset(("survey_inclination", "inclination", "projected_inclination"))
_ON_PAPER = 2  # decimals in printed reports


class SignalSource(NamedTuple):
    """Source of signals: topic or table, rate, and the rule for valid values."""

    brings: str
    rate: str
    validity: str
    tool: bool = False  #: whether the source is downhole


SOURCES: dict[str, SignalSource] = {
    ESTIMATOR: SignalSource(
        "attitude, gravity, link/attitude",
        "each block of samples, or each word of a link",
        "its sigma is not negative; stale after two `live.estimator_period`",
        tool=True,
    ),
    "dynamics": SignalSource(
        "dynamics", "each summary", "finite, an index not negative; stale after two `live.dynamics_period`", tool=True
    ),
    "temperature": SignalSource(
        "temperature", "each message", "-60 to 250 degC; stale after two `live.temperature_period`", tool=True
    ),
    "magnetometer": SignalSource(
        "imu/mag", "each block of samples", "the magnetometer is in use; two `live.magnetometer_period`", tool=True
    ),
    "interference": SignalSource(
        "interference", "each estimate", "its sigma is not negative; two `live.interference_period`", tool=True
    ),
    RIG: SignalSource("rig/state", "each message", "its bit of `valid`; stale after two `live.rig_period`"),
    SURVEY: SignalSource("the survey list", "each accepted survey", "accepted, automatically or by a person"),
    POSITION: SignalSource("the survey list", "each accepted survey", "error model and reference field are known"),
    BIT: SignalSource("the path projected to the bit", "each depth and survey", "there is a survey"),
    PLAN: SignalSource("the path against the plan", "each depth and survey", "there are a survey and a plan"),
    CONTROL: SignalSource("the control authority", "each change", "an owner asks for it"),
    ADVICE: SignalSource("steering/advice", "each change", "there is advice"),
    LOG: SignalSource("log, link/log", "each sample of the channel", "the sample has a depth; stale after two minutes"),
    INPUT: SignalSource("clocks and depths of the inputs", "1 Hz", "there is such an input"),
    SURFACE: SignalSource("the surface itself", "each change", "the node is active"),
}


class Wits(NamedTuple):
    """WITS item: code, short name (empty for a spare item), and number of decimals."""

    code: int
    name: str
    decimals: int


class FileColumn(NamedTuple):
    """Column of a file: name, which ends with the unit, and number of decimals."""

    key: str
    decimals: int


class Shown(NamedTuple):
    """Column of the page's survey table: its order, and the narrowest screen with it (0 any, 1 tablet, 2 wide)."""

    place: int
    width: int


class Listed(NamedTuple):
    """
    Column in the tables of surveys: name and decimals in CSV files.

    A column of the printed survey also has a title, LAS mnemonic, WITSML tag, and decimals on paper.
    """

    key: str
    decimals: int
    title: str = ""
    las: str = ""
    witsml: str = ""
    shown: int = _ON_PAPER


class Display(NamedTuple):
    """Display of numbers for a well: metric or field units, and the convention of the vertical angle."""

    units: str = METRIC
    angles: AngleConvention = AngleConvention.INCLINATION


AS_STORED = Display()  #: display in the project's own files


@dataclasses.dataclass(frozen=True)
class Signal:
    """One quantity of the signal table."""

    name: str  #: name within this package
    unit: str  #: SI unit, one of `units.UNITS`; rad for angles, 1 for a ratio; empty if the signal is not a number
    meaning: str  #: description in words
    source: str  #: source of the signal, one of `SOURCES`
    type: str = "Double"  #: data type, one of `TYPES`
    circle: bool = False  #: whether the values wrap around a full circle
    sigma: bool = False  #: whether the signal has a 1 sigma, with a separate column in files of samples
    doubts: tuple[str, ...] = ()  #: status bits of the estimator that make the signal doubtful
    field: str = ""  #: attribute of the source's record that holds the value
    page: tuple[str, ...] = ()  #: places in the state of the page, `section.field`
    shown: Shown | None = None  #: column in the survey table of the page, with the title of `listed`
    opcua: str = ""  #: OPC UA variable; empty if the signal is not sent to a rig by any protocol
    dwis: tuple[str, ...] = ()  #: D-WIS nouns that classify the signal
    modbus: int | None = None  #: address of the first register of the signal
    wits: Wits | None = None  #: WITS item with which the signal is sent, in record 7, 8 or 9
    reads: int | None = None  #: item of WITS record 1 from which the signal is received
    #: Attribute of `survey_csv.Line` with the value of a survey of the list, as a dotted path; empty if the value is
    #: computed from the whole path.
    record: str = ""
    #: Column in the tables of surveys; a column with a LAS mnemonic is in every export of the definitive survey.
    listed: Listed | None = None
    #: `series`, `attitude`: columns in the rows of a recording, one per second, and in attitude.csv and
    #: attitude.parquet.
    series: FileColumn | None = None
    attitude: FileColumn | None = None

    def __post_init__(self) -> None:
        """
        Check the signal.

        Raise ValueError for a unit without conversions, for an unknown source or type, or for a signal sent to a rig
        without an OPC UA name.
        """
        if (self.unit or self.type == "Double") and self.unit not in UNITS:
            raise ValueError(
                f"signal {self.name}: unit {self.unit!r} is not one of {', '.join(UNITS)}: add it to UNITS"
            )
        for value, known, what in ((self.source, SOURCES, "source"), (self.type, TYPES, "type")):
            if value not in known:
                raise ValueError(f"signal {self.name}: {what} {value!r} is not one of {', '.join(known)}")
        if not self.opcua and (self.dwis or self.modbus is not None or self.wits is not None):
            raise ValueError(f"signal {self.name}: a signal sent to a rig needs an OPC UA name")

    @property
    def people(self) -> UnitScale:
        """Symbol of the metric unit of this signal in files and on paper."""
        return UNITS[self.unit].people

    @property
    def listed_scale(self) -> UnitScale:
        """Unit in the tables of surveys: the metric unit of files, or deg/h for the rate of a gyro at rest."""
        return DEG_PER_H if self.listed and self.listed.key.endswith("_degph") else self.people

    @property
    def is_inclination(self) -> bool:
        """Whether the signal is the vertical angle of the hole, which is shown as a dip for some wells."""
        return self.name in INCLINATIONS

    def for_people(self, value: float, display: Display) -> float:
        """Return an SI value in the display units; a vertical angle of the hole in the display convention."""
        scale = self.listed_scale
        if scale is self.people:
            scale = UNITS[self.unit].shown_in(display.units)
        return scale.of(display.angles.shown(value) if self.is_inclination else value)

    def column_for_people(self, listed: Listed, display: Display) -> Listed:
        """Return the column `listed` of this signal with the name for the display units and the angle convention."""
        if self.is_inclination and display.angles.points:
            las = display.angles.value.upper()
            return listed._replace(key=display.angles.column, title=display.angles.heading, las=las)
        return listed._replace(key=UNITS[self.unit].key_in(listed.key, display.units)) if self.unit else listed

    @property
    def wrap(self) -> float:
        """Angle at which the numbers wrap, deg; 0 if they do not wrap."""
        return 360.0 if self.circle else 0.0


# The table.

FILE = Path(__file__).with_name("table.csv")


def read_signals(path: Path = FILE) -> tuple[Signal, ...]:
    """
    Return the signals of a table, in its order.

    Raises
    ------
    ValueError
        A row is not a valid signal; the message names the signal.
    """
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(_signal(row) for row in csv.DictReader(file, strict=True))


def page_fields(section: str) -> dict[str, Signal]:
    """Return the signals of a section of the page, by their names in this section."""
    places = ((place.partition("."), signal) for signal in SIGNALS for place in signal.page)
    return {name: signal for (part, _, name), signal in places if part == section}


def _signal(row: Mapping[str, str]) -> Signal:
    page = tuple(row["page"].split())
    try:
        code, _, wits = row["wits"].partition(" ")
        name, _, decimals = wits.partition(" ")
        return Signal(
            name=row["name"],
            unit=row["unit"],
            meaning=row["meaning"],
            source=row["source"],
            type=row["type"],
            circle=_flag(row["circle"]),
            sigma=_flag(row["sigma"]),
            doubts=tuple(row["doubts"].split()),
            field=row["field"] or (page[0].rpartition(".")[2] if page else ""),
            page=page,
            shown=Shown(*map(int, row["shown"].split())) if row["shown"] else None,
            opcua=row["opcua"],
            dwis=tuple(row["dwis"].split()),
            modbus=int(row["modbus"]) if row["modbus"] else None,
            wits=Wits(int(code), name.replace("-", ""), int(decimals)) if code else None,
            reads=int(row["reads"]) if row["reads"] else None,
            record=row["record"],
            listed=Listed(*_column(row["list"]), row["title"], row["las"], row["witsml"]) if row["list"] else None,
            series=_column(row["series"]) if row["series"] else None,
            attitude=_column(row["attitude"]) if row["attitude"] else None,
        )
    except (AttributeError, ValueError) as error:
        raise ValueError(f"{FILE.name}, signal {row['name']}: {error}") from error


def _column(text: str) -> FileColumn:
    key, _, decimals = text.partition(" ")
    return FileColumn(key, int(decimals or 0))


def _flag(text: str) -> bool:
    if text not in ("", "yes"):
        raise ValueError(f"expected yes or nothing, got {text!r}")
    return bool(text)


SIGNALS = read_signals()
BY_NAME = {signal.name: signal for signal in SIGNALS}
# Signals that are sent to a rig (all of them by OPC UA), and signals about the surface node itself.
TO_RIG = tuple(signal for signal in SIGNALS if signal.opcua and signal.source != SURFACE)
FACTS = tuple(signal for signal in SIGNALS if signal.source == SURFACE)
OF_SURVEY = tuple(signal for signal in TO_RIG if signal.source == SURVEY)
FROM_TOOL = tuple(signal for signal in TO_RIG if SOURCES[signal.source].tool)
FROM_PLAN = tuple(signal for signal in TO_RIG if signal.source == PLAN)
FROM_CONTROL = tuple(signal for signal in TO_RIG if signal.source == CONTROL)
FROM_LOG = tuple(signal for signal in TO_RIG if signal.source == LOG)
FROM_ADVICE = tuple(signal for signal in TO_RIG if signal.source == ADVICE)
# Signal and column, in order, for tables of surveys; for each export of the definitive survey; and for time series of
# recordings.
SURVEY_TABLE = tuple((signal, signal.listed) for signal in SIGNALS if signal.listed is not None)
LISTED = tuple((signal, listed) for signal, listed in SURVEY_TABLE if listed.las)
SERIES = tuple((signal, signal.series) for signal in SIGNALS if signal.series is not None)
ATTITUDE = tuple((signal, signal.attitude) for signal in SIGNALS if signal.attitude is not None)

# SPDX-License-Identifier: Apache-2.0
"""A quantity of the surface: what it is, where it comes from, and its name in each protocol, file and page."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mwd_surface.signals.units import UNITS, Scale

ESTIMATOR, RIG, BIT, PLAN, SURVEY, POSITION = "estimator", "rig", "bit", "plan", "survey", "position"  # sources
CONTROL, ADVICE, INPUT, SURFACE = "control", "advice", "input", "surface"
TYPES = ("Double", "UInt32", "Boolean", "String")
_ON_PAPER = 2  # decimals


class Source(NamedTuple):
    """What brings signals: topic or table, how often, and which of its values are valid. tool: it is down-hole."""

    brings: str
    rate: str
    validity: str
    tool: bool = False


SOURCES: dict[str, Source] = {
    ESTIMATOR: Source(
        "attitude, gravity, link/attitude",
        "each block of samples, or each word of a link",
        "its sigma is not negative; stale after two `live.estimator_period`",
        tool=True,
    ),
    "dynamics": Source(
        "dynamics", "each summary", "finite, an index not negative; stale after two `live.dynamics_period`", tool=True
    ),
    "temperature": Source(
        "temperature", "each message", "-60 to 250 degC; stale after two `live.temperature_period`", tool=True
    ),
    "magnetometer": Source(
        "imu/mag", "each block of samples", "the magnetometer is in use; two `live.magnetometer_period`", tool=True
    ),
    "interference": Source(
        "interference", "each estimate", "its sigma is not negative; two `live.interference_period`", tool=True
    ),
    RIG: Source("rig/state", "each message", "its bit of `valid`; stale after two `live.rig_period`"),
    SURVEY: Source("the survey list", "each accepted survey", "accepted, or in use on a person's word"),
    POSITION: Source("the survey list", "each accepted survey", "error model and reference are known"),
    BIT: Source("the path projected to the bit", "each depth and survey", "there is a survey"),
    PLAN: Source("the path against the plan", "each depth and survey", "there are a survey and a plan"),
    CONTROL: Source("the authority on control", "each change", "an owner asks for it"),
    ADVICE: Source("steering/advice", "each change", "there is advice"),
    INPUT: Source("clocks and depths of the inputs", "1 Hz", "there is such an input"),
    SURFACE: Source("the surface itself", "each change", "the node is active"),
}


class Wits(NamedTuple):
    """Item of WITS: its code, its short name (empty: a spare item, which has none), and decimals."""

    code: int
    name: str
    decimals: int


class Column(NamedTuple):
    """Column of a file: its name, which ends with the unit, and decimals."""

    key: str
    decimals: int


class Listed(NamedTuple):
    """Column of the definitive survey: name in CSV, decimals there and on paper, title, LAS mnemonic, WITSML tag."""

    key: str
    decimals: int
    title: str
    las: str
    witsml: str = ""
    shown: int = _ON_PAPER


@dataclasses.dataclass(frozen=True)
class Signal:
    """
    One quantity.

    Attributes
    ----------
    name : str
        In our own values.
    unit : str
        SI, one of `units.UNITS`; angles in rad, 1 for a ratio; empty for what is no number.
    meaning : str
        In words.
    source : str
        What brings it: one of `SOURCES`.
    type : str
        One of `TYPES`.
    circle : bool
        Its values go round a full circle.
    sigma : bool
        It comes with its 1 sigma, which has a column of its own in files of samples.
    doubts : tuple of str
        Status bits of the estimator that make it doubtful.
    field : str
        Attribute that holds it in the record of its source.
    page : tuple of str
        Where it stands in the state of the page, `section.field`.
    opcua : str
        Variable; empty: it does not go to a rig, by no protocol.
    dwis : tuple of str
        Nouns that classify it.
    modbus : int, optional
        Address of its first register.
    wits : Wits, optional
        Item sent, of the survey, tool or rig record.
    reads : int, optional
        Item of WITS record 1 that brings it.
    listed : Listed, optional
        In the definitive survey.
    series, attitude : Column, optional
        In the rows of a recording, one a second, and in attitude.csv and attitude.parquet.
    """

    name: str
    unit: str
    meaning: str
    source: str
    type: str = "Double"
    circle: bool = False
    sigma: bool = False
    doubts: tuple[str, ...] = ()
    field: str = ""
    page: tuple[str, ...] = ()
    opcua: str = ""
    dwis: tuple[str, ...] = ()
    modbus: int | None = None
    wits: Wits | None = None
    reads: int | None = None
    listed: Listed | None = None
    series: Column | None = None
    attitude: Column | None = None

    def __post_init__(self) -> None:
        """Refuse what no protocol can convert, and a source that there is not."""
        if (self.unit or self.type == "Double") and self.unit not in UNITS:
            raise ValueError(
                f"signal {self.name}: unit {self.unit!r} is not one of {', '.join(UNITS)}: add it to UNITS"
            )
        for value, known, what in ((self.source, SOURCES, "source"), (self.type, TYPES, "type")):
            if value not in known:
                raise ValueError(f"signal {self.name}: {what} {value!r} is not one of {', '.join(known)}")
        if not self.opcua and (self.dwis or self.modbus is not None or self.wits is not None):
            raise ValueError(f"signal {self.name}: what goes to a rig needs a name for OPC UA")

    @property
    def people(self) -> Scale:
        """Unit of people, in files and on paper."""
        return UNITS[self.unit].people

    @property
    def wrap(self) -> float:
        """Degrees at which its numbers turn over; 0: they do not."""
        return 360.0 if self.circle else 0.0

# SPDX-License-Identifier: Apache-2.0
"""A quantity that goes to a rig: what it is, and its name in each protocol."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mwd_surface.rig.units import UNITS

TOOL, RIG, BIT, PLAN, SURVEY = "tool", "rig", "bit", "plan", "survey"  # sources
CONTROL, ADVICE, INPUT = "control", "advice", "input"


class Wits(NamedTuple):
    """Item of WITS: its code, its short name (empty: a spare item, which has none), and decimals."""

    code: int
    name: str
    decimals: int


@dataclasses.dataclass(frozen=True)
class Signal:
    """
    One quantity.

    Attributes
    ----------
    name : str
        In our own values.
    unit : str
        SI, one of `units.UNITS`; angles in rad, 1 for a ratio.
    meaning : str
        In words.
    source : str
        TOOL, RIG, BIT (the path projected to it), PLAN (against it), SURVEY (the last accepted one), CONTROL (what the
        owner of the lease asks of the rig), ADVICE (how to drill the next interval) or INPUT (of the surface: clocks
        and the source of depth).
    opcua : str
        Variable.
    dwis : tuple of str
        Nouns that classify it.
    modbus : int, optional
        Address of its first register.
    wits : Wits, optional
        Item, of the survey, tool or rig record.
    circle : bool
        Its values go round a full circle.
    """

    name: str
    unit: str
    meaning: str
    source: str
    opcua: str
    dwis: tuple[str, ...]
    modbus: int | None = None
    wits: Wits | None = None
    circle: bool = False

    def __post_init__(self) -> None:
        """Refuse a unit that no protocol can convert."""
        if self.unit not in UNITS:
            raise ValueError(
                f"signal {self.name}: unit {self.unit!r} is not one of {', '.join(UNITS)}: add it to UNITS"
            )

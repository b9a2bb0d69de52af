# SPDX-License-Identifier: Apache-2.0
"""
Values of the state of a well as JSON data: a record becomes a table of its fields, an unknown number becomes null.

A new field of a record therefore reaches the page without code here.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import ControlState
from mwd_surface.live.inputs import Role
from mwd_surface.live.link_state import LinkHealth

# Members of enumerations that the page shows by a word other than their name.
_WORDS: Mapping[type[enum.Enum], Mapping[Any, str]] = {
    North: {North.UNKNOWN: ""},
    RecorderState: {RecorderState.PAUSED_DISK_FULL: "paused: disk full"},
    Mode: {
        Mode.HOLD: "hold the string",
        Mode.ORIENT: "turn by an angle",
        Mode.RELEASE: "the driller's",
    },
    ControlState: {
        ControlState.IDLE: "driller",
        ControlState.PENDING: "asked for",
        ControlState.GRANTED: "controller",
    },
    LinkHealth: {LinkHealth.NO_INPUT: "no pressure"},
    Role: {Role.NO_DEPTH: "", Role.STANDBY: "stands by"},
}


def number(value: Any) -> float | None:
    """Return a number rounded to ten digits; None if it is None, NaN or infinite."""
    if value is None:
        return None
    value = float(value)
    return float(f"{value:.10g}") if math.isfinite(value) else None


def numbers(values: Iterable[Any]) -> list[float | None]:
    """Return each value rounded to ten digits; None for a value that is None, NaN or infinite."""
    return [number(v) for v in values]


def plain(value: Any) -> Any:
    """
    Return a value as JSON data.

    Numbers are rounded to ten digits; NaN and infinity become None. A record becomes a table of its fields and
    properties, a member of an enumeration its word, a set of status bits the list of their words.
    """
    if isinstance(value, enum.Enum):
        return word(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return number(value)
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    return {name: plain(getattr(value, name)) for name in _names(type(value))}


def word(member: enum.Enum) -> str | list[str]:
    """Return the page's word for a member of an enumeration, or a list of words for a set of status bits."""
    if isinstance(member, str):
        return str(member)
    if isinstance(member, enum.Flag):
        return [str(bit.name).lower() for bit in member]
    return _WORDS.get(type(member), {}).get(member, str(member.name).lower().replace("_", " "))


def _names_of(record: type) -> tuple[str, ...]:
    """
    Return the names of the fields and properties of a record.

    Raises TypeError if the type is not a record, so that there is no JSON for it.
    """
    members = [name for base in record.__mro__ for name, one in vars(base).items() if isinstance(one, property)]
    return (*(field.name for field in dataclasses.fields(record)), *members)


_names: Callable[[type], tuple[str, ...]] = functools.cache(_names_of)

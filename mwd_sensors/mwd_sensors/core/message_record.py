# SPDX-License-Identifier: Apache-2.0
"""
Conversion between records and ROS messages of equal field names, so that a new field needs no conversion code.

No ROS code is imported: a message is any object with the fields of its definition, and the caller passes the function
that makes messages (`mwd_sensors.ros.messages.make` in a node, `Definitions.make` for a file).
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import typing
from collections.abc import Callable
from typing import Any, ClassVar

from mwd_sensors.core.wire import NANOSECONDS

#: Function that makes a message from its full name, such as "mwd_msgs/msg/Survey", and its fields.
Make = Callable[[str, dict[str, Any]], Any]
TIME, HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_hints: Callable[[Any], dict[str, Any]] = functools.cache(typing.get_type_hints)


class UnknownNumberError(ValueError):
    """A number in a message is not in its enumeration; messages of another version may have such numbers."""


class MessageRecord:
    """
    Base class of dataclasses that have the fields of a message.

    A field `x_ns`, ns since 1970, is the time `x` in the message; `stamp_ns` and `frame_id` are in the message's
    header. A tuple is an array in the message, and a member of an enumeration is its number. Two records are equal if
    each field is equal; NaN equals NaN.
    """

    MESSAGE: ClassVar[str]  #: full name of the message
    NOT_SENT: ClassVar[frozenset[str]] = frozenset()  #: fields that the message does not have

    @classmethod
    def sent(cls) -> tuple[str, ...]:
        """Return the names of the fields that the message has."""
        return tuple(_sent(cls))

    @classmethod
    def from_message(cls, message: Any) -> typing.Self:
        """
        Return the record with the values of a message.

        Raises
        ------
        UnknownNumberError
            A field has a number that is not in its enumeration.
        """
        values: dict[str, Any] = {}
        for name, (in_header, theirs, kind) in _sent(cls).items():
            value = getattr(message.header if in_header else message, theirs)
            if name.endswith("_ns"):
                values[name] = stamp_of(value)
            elif kind is None or kind is float:
                values[name] = _plain(value)
            elif issubclass(kind, enum.IntEnum):
                try:
                    values[name] = kind(value)
                except ValueError as error:
                    raise UnknownNumberError(f"{cls.MESSAGE}: {theirs} {value} is unknown") from error
            elif issubclass(type(value), (list, tuple)):
                values[name] = tuple(map(kind.from_message, value))
            else:
                values[name] = kind.from_message(value)
        return cls(**values)

    def to_message(self, make: Make) -> Any:
        """Return a message with the values of this record; make creates the messages."""
        fields: dict[str, Any] = {}
        header: dict[str, Any] = {}
        for name, (in_header, theirs, kind) in _sent(type(self)).items():
            value = getattr(self, name)
            if name.endswith("_ns"):
                value = time_message(value, make)
            elif kind is None:
                value = list(value) if isinstance(value, tuple) else value
            elif kind is float:
                # An integer in a field of floats would be sent as another number: ROS does not convert it.
                value = [float(one) for one in value] if isinstance(value, tuple) else float(value)
            elif issubclass(kind, enum.IntEnum):
                value = int(value)
            elif isinstance(value, tuple):
                value = [one.to_message(make) for one in value]
            else:
                value = value.to_message(make)
            (header if in_header else fields)[theirs] = value
        if header:
            fields["header"] = make(HEADER, header)
        return make(self.MESSAGE, fields)

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        names = [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        return all(_same(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]


def stamp_of(time: Any) -> int:
    """Return a builtin_interfaces/Time as ns since 1970."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def time_message(stamp_ns: int, make: Make) -> Any:
    """Return a time, ns since 1970, as builtin_interfaces/Time."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    return make(TIME, {"sec": seconds, "nanosec": nanoseconds})


def _sent_fields(record: type[MessageRecord]) -> dict[str, tuple[bool, str, Any]]:
    """
    Return the fields of a record that the message has, by name in the record.

    Values: whether the field is in the message's header; its name in the message; the type of its values if they must
    be converted, else None.
    """
    found: dict[str, tuple[bool, str, Any]] = {}
    for field in dataclasses.fields(record):  # type: ignore[arg-type]
        if field.name in record.NOT_SENT:
            continue
        hint = _hints(record)[field.name]
        parts = [hint, *typing.get_args(hint)]
        types = (one for one in parts if isinstance(one, type))
        nested = next((one for one in types if issubclass(one, (MessageRecord, enum.IntEnum, float))), None)
        in_header = field.name in ("stamp_ns", "frame_id")
        found[field.name] = in_header, field.name.removesuffix("_ns"), nested
    return found


# Cached, because evaluating the annotations takes longer than converting a message.
_sent: Callable[[Any], dict[str, tuple[bool, str, Any]]] = functools.cache(_sent_fields)


def _plain(value: Any) -> Any:
    """Return a scalar unchanged, and an array of the message as a tuple of Python numbers or texts."""
    if isinstance(value, (str, bool, int, float)):
        return value
    items = value.tolist() if hasattr(value, "tolist") else value
    return tuple(items) if isinstance(items, (list, tuple)) else items


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other or (one != one and other != other))

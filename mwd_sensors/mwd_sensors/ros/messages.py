# SPDX-License-Identifier: Apache-2.0
"""Create messages by the name of their type, and messages whose numbers are NaN until they are set."""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any


@functools.cache
def message_type(name: str) -> Any:
    """Return the class of a message type, such as "mwd_msgs/msg/Survey"."""
    package, kind, short = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), short)


def make(name: str, fields: dict[str, Any]) -> Any:
    """Return a message of the type `name`, such as "mwd_msgs/msg/Survey", with the given fields."""
    return message_type(name)(**fields)


def unknown(message_type: Any, **fields: Any) -> Any:
    """Return a message of a class with the given fields; every other float64 field is NaN, which ROS would set to 0."""
    numbers = (name for name, kind in message_type.get_fields_and_field_types().items() if kind == "double")
    return message_type(**{**dict.fromkeys(numbers, math.nan), **fields})

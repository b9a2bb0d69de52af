# SPDX-License-Identifier: Apache-2.0
"""Messages whose numbers are unknown until they are set."""

from __future__ import annotations

import math
from typing import Any


def unknown(message_type: Any, **fields: Any) -> Any:
    """Return a message with the given fields; every other float64 field is NaN, which ROS would set to 0."""
    numbers = (name for name, kind in message_type.get_fields_and_field_types().items() if kind == "double")
    return message_type(**{**dict.fromkeys(numbers, math.nan), **fields})

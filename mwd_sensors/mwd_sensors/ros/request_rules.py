# SPDX-License-Identifier: Apache-2.0
"""Rules for the content of a request, checked before the callback of the request is called."""

from __future__ import annotations

import math
from typing import Any

from mwd_sensors.core.foreign_text import unprintable

_LONGEST = 500  # largest number of characters of one text; the reason for a decision needs no more than a sentence


# Fields of JudgeSurvey and SetReferenceField that may be NaN, which keeps the present value.
_MAY_BE_NAN = {"measured_depth", "gravity"}


def refusal(request: Any) -> str:
    """
    Return in one sentence why a request of a service or an action is refused; empty if it is accepted.

    Every text must have at most 500 characters that can be printed and written to a file. Every number must be finite,
    except for the fields in `_MAY_BE_NAN`. A request is any object with rosidl's ``get_fields_and_field_types``; nested
    messages are not checked.
    """
    for name in request.get_fields_and_field_types():
        value = getattr(request, name)
        if name in _MAY_BE_NAN and math.isnan(value):
            continue
        if isinstance(value, float) and not math.isfinite(value):
            return f"{name}: must be a finite number, got {value}"
        if isinstance(value, str):
            if len(value) > _LONGEST:
                return f"{name}: at most {_LONGEST} characters, got {len(value)}"
            if fault := unprintable(value):
                return f"{name}: {fault}"
    return ""

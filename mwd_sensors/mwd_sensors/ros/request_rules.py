# SPDX-License-Identifier: Apache-2.0
"""What a request may hold, whoever sends it: checked once at the edge, before any callback sees it."""

from __future__ import annotations

import math
from typing import Any

from mwd_sensors.core.settings import unprintable

_LONGEST = 500  # characters of one text; a reason for a decision is a sentence


# JudgeSurvey and SetReferenceField: NaN keeps what there is.
_MAY_BE_NAN = {"measured_depth", "gravity"}


def refusal(request: Any) -> str:
    """
    Why a request of a service or an action is refused, in one sentence; empty where it is not.

    Every text has at most 500 characters that can be printed and written to a file; every number is finite, but for
    those of `_MAY_BE_NAN`. A request
    is anything with rosidl's ``get_fields_and_field_types``; fields that are messages themselves are not looked into.
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

# SPDX-License-Identifier: Apache-2.0
"""The two forms of an unknown number: NaN in arrays, records and messages, None where a value is optional."""

from __future__ import annotations

import math


def or_none(value: float) -> float | None:
    """Return the number, or None where it is not known."""
    return None if math.isnan(value) else float(value)


def or_nan(value: float | None) -> float:
    """Return the number, or NaN where there is none."""
    return math.nan if value is None else float(value)

# SPDX-License-Identifier: Apache-2.0
"""The two forms of an unknown number: NaN in arrays, records and messages, None where a value is optional."""

from __future__ import annotations

import math


def or_none(value: float) -> float | None:
    """Return a number, or None for NaN."""
    return None if math.isnan(value) else float(value)


def or_nan(value: float | None) -> float:
    """Return a number, or NaN for None."""
    return math.nan if value is None else float(value)

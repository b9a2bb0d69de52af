# SPDX-License-Identifier: Apache-2.0
"""Numbers for the page: finite, rounded to the digits people can use, or None."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any


def number(value: Any) -> float | None:
    """Return a finite number rounded to ten digits, or None."""
    if value is None:
        return None
    value = float(value)
    return float(f"{value:.10g}") if math.isfinite(value) else None


def numbers(values: Iterable[Any]) -> list[float | None]:
    """Return `number` of each value."""
    return [number(v) for v in values]

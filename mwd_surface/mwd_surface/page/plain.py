# SPDX-License-Identifier: Apache-2.0
"""Numbers as a page can take them: finite, with as many digits as people can use, or None."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any


def number(value: Any) -> float | None:
    """A finite number with what a double of people's interest needs, or None."""
    if value is None:
        return None
    value = float(value)
    return float(f"{value:.10g}") if math.isfinite(value) else None


def numbers(values: Iterable[Any]) -> list[float | None]:
    """Each of some values."""
    return [number(v) for v in values]

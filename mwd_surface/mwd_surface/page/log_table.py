# SPDX-License-Identifier: Apache-2.0
"""Table of the log channels over depth, for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.logs.depth_log import Curve
from mwd_surface.page.plain import number

_GAPS = 3  # number of deepest gaps that the page lists
_HELD = 40  # largest number of depth steps for which the value of a sector is held


def log_table(curves: Sequence[Curve]) -> dict[str, Any]:
    """
    Return the dict {"channels": tables}, with one table for each curve that has depth steps.

    rows: depth, m, value, sigma, time of measurement, s, and quality, bits of LogSample; sectors: values of each row,
    from the high side clockwise; held: result of `held_steps`; gaps: top and bottom of the deepest gaps, m; gap_count:
    number of all gaps. Values are in the unit of the channel.
    """
    return {"channels": [_channel(curve) for curve in curves if len(curve.depth)]}


def _channel(curve: Curve) -> dict[str, Any]:
    columns = (curve.depth, curve.value, curve.sigma, curve.seconds, curve.quality)
    return {
        "name": curve.channel,
        "unit": curve.unit,
        "step": number(float(np.diff(curve.depth[:2]).sum())),
        "rows": [[_short(value) for value in row] for row in zip(*columns, strict=True)],
        "sectors": [[_short(value) for value in row] for row in curve.sectors],
        "held": held_steps(curve.sectors),
        "gaps": [[_short(edge) for edge in gap] for gap in curve.gaps[-_GAPS:]],
        "gap_count": len(curve.gaps),
    }


def held_steps(sectors: Array) -> list[int]:
    """
    Return, for each sector, the largest number of depth steps for which the image holds a value of the sector.

    Over a link the sectors arrive in turn, so a sector has values only at some depths. The image shows each value,
    marked as held, until the next value of the sector. A distance between two values above 1.5 times the median
    distance, or above `_HELD` steps, is a gap.

    Parameters
    ----------
    sectors : ndarray, shape (n, k)
        Values by direction, NaN where there is none.
    """
    found = []
    for column in np.isfinite(sectors).T:
        apart = np.diff(np.flatnonzero(column))
        found.append(min(_HELD, int(1.5 * np.median(apart))) if len(apart) else 0)
    return found


def _short(value: float) -> float | None:
    return number(float(f"{value:.7g}"))

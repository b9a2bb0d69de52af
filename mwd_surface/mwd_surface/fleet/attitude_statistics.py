# SPDX-License-Identifier: Apache-2.0
"""Statistics of a fleet's attitudes: one row for every ten seconds instead of millions of samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples

BIN_NS = 10_000_000_000  # length of an interval, ns
# Status bits whose share of the samples is a column of the rows.
FLAGS = (
    Status.STILL,
    Status.ROTATING,
    Status.SLIDING,
    Status.CLIPPED,
    Status.GAP,
    Status.REJECTED,
    Status.MAG_DISTURBED,
    Status.SENSOR_FAULT,
)
_SUMS = ("samples", "inclination", "sigma_inclination", "known", "sin", "cos", "sigma_azimuth", "azimuth_known")
_MOTION = ("rotary_speed", "non_gravity_squared")
_NAMES = (*_SUMS, *_MOTION, *(flag.name or "" for flag in FLAGS))
#: Columns of a row that are shares of the samples, by status bit.
SHARES = {flag: f"share_{(flag.name or '').lower()}" for flag in FLAGS}


class AttitudeStatistics:
    """Sums over intervals of ten seconds of sample time; the rows do not depend on order or length of the blocks."""

    def __init__(self) -> None:
        self._sums: dict[int, NDArray[np.float64]] = {}
        self._range: dict[int, tuple[float, float]] = {}

    def add(self, attitude: Samples, gravity: Samples) -> None:
        """Add samples of `wire.ATTITUDE` and `wire.GRAVITY`, shape (n,) each; row k of both has the same time."""
        if not len(attitude):
            return
        bins, place = np.unique(np.ascontiguousarray(attitude["stamp_ns"]) // BIN_NS, return_inverse=True)
        known = np.isfinite(attitude["sigma_inclination"])
        azimuth_known = np.isfinite(attitude["sigma_azimuth"])
        status = np.ascontiguousarray(attitude["status"])
        columns = {
            "samples": np.ones(len(attitude)),
            "inclination": np.where(known, attitude["inclination"], 0.0),
            "sigma_inclination": np.where(known, attitude["sigma_inclination"], 0.0),
            "known": known,
            "sin": np.where(azimuth_known, np.sin(attitude["azimuth"]), 0.0),
            "cos": np.where(azimuth_known, np.cos(attitude["azimuth"]), 0.0),
            "sigma_azimuth": np.where(azimuth_known, attitude["sigma_azimuth"], 0.0),
            "azimuth_known": azimuth_known,
            "rotary_speed": np.nan_to_num(gravity["rotary_speed"]),
            "non_gravity_squared": np.square(np.nan_to_num(gravity["non_gravity"])),
            **{flag.name: (status & int(flag)) != 0 for flag in FLAGS},
        }
        sums = np.stack([np.bincount(place, columns[name], len(bins)) for name in _NAMES], axis=1)
        lowest, highest = np.full(len(bins), math.inf), np.full(len(bins), -math.inf)
        np.minimum.at(lowest, place[known], attitude["inclination"][known])
        np.maximum.at(highest, place[known], attitude["inclination"][known])
        for k, index in enumerate(bins.tolist()):
            before = self._sums.get(index)
            self._sums[index] = sums[k] if before is None else before + sums[k]
            low, high = self._range.get(index, (math.inf, -math.inf))
            self._range[index] = min(low, float(lowest[k])), max(high, float(highest[k]))

    def rows(self) -> list[dict[str, Any]]:
        """Return one row for each interval with samples, in order of time, in deg, r/min, m/s^2; None if unknown."""
        return [self._row(index) for index in sorted(self._sums)]

    def _row(self, index: int) -> dict[str, Any]:
        of = dict(zip(_NAMES, self._sums[index].tolist(), strict=True))
        samples, known, azimuth_known = of["samples"], of["known"], of["azimuth_known"]
        lowest, highest = self._range[index]

        def mean_deg(name: str, count: float) -> float | None:
            return math.degrees(of[name] / count) if count else None

        return {
            "start_ns": index * BIN_NS,
            "samples": int(samples),
            "inclination_deg": mean_deg("inclination", known),
            "inclination_lowest_deg": math.degrees(lowest) if known else None,
            "inclination_highest_deg": math.degrees(highest) if known else None,
            "sigma_inclination_deg": mean_deg("sigma_inclination", known),
            "azimuth_deg": math.degrees(math.atan2(of["sin"], of["cos"])) % 360.0 if azimuth_known else None,
            "sigma_azimuth_deg": mean_deg("sigma_azimuth", azimuth_known),
            "rotary_speed_rpm": of["rotary_speed"] / samples * 60.0 / math.tau,
            "non_gravity_mps2": math.sqrt(of["non_gravity_squared"] / samples),
            **{name: of[flag.name or ""] / samples for flag, name in SHARES.items()},
        }

# SPDX-License-Identifier: Apache-2.0
"""Bins of time of the streams beside the conventional unit: magnetometer, precision unit, temperature."""

from __future__ import annotations

from mwd_estimation.core.time_bins import Bin, Binner
from mwd_estimation.survey.static_survey import BIN_NS, BinSet
from mwd_sensors.core.arrays import Array, Stamps


class SideStreams:
    """Closed bins of each stream, kept until the conventional unit's bin of the same time asks for them."""

    def __init__(self) -> None:
        self._binners = {"mag": Binner(3, BIN_NS), "precision": Binner(6, BIN_NS), "temperature": Binner(1, BIN_NS)}
        self._closed: dict[str, dict[int, Bin]] = {name: {} for name in self._binners}

    def add(self, name: str, stamps: Stamps, values: Array) -> None:
        """Take samples of a stream, shapes (n,), ns, and (n, channels)."""
        self._keep(name, self._binners[name].add(stamps, values))

    def beside(self, imu: Bin) -> BinSet:
        """Return the bins of all streams in the time of one of the conventional unit; each bin is asked for once."""
        found: dict[str, Bin | None] = {}
        for name, bins in self._closed.items():
            self._keep(name, self._binners[name].flush((imu.index + 1) * BIN_NS))
            found[name] = bins.pop(imu.index, None)
            # A stream's bins close in order.
            while bins and next(iter(bins)) < imu.index:
                del bins[next(iter(bins))]
        return BinSet(imu, found["mag"], found["precision"], found["temperature"])

    def _keep(self, name: str, closed: list[Bin]) -> None:
        for one in closed:
            self._closed[name][one.index] = one

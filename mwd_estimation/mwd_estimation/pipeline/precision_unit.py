# SPDX-License-Identifier: Apache-2.0
"""The precision unit: its samples in bins, its health, and the north that its gyros find at a station."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, SensorFault
from mwd_estimation.core.time_bins import Bin
from mwd_estimation.core.track import AT_RANGE
from mwd_estimation.gyrocompass.station import GyroStation
from mwd_estimation.health.unit_comparison import PrecisionHealth
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled


@dataclasses.dataclass(frozen=True)
class PrecisionBin:
    """Samples and health of the unit in one bin of time."""

    samples: UnitSamples  #: samples of the unit; NaN while it is faulty
    changes: list[SensorFault]  #: faults found, narrowed down or cleared
    fault: Reason | None  #: reason why the unit is not used in this bin; None if it is used


class PrecisionUnitStage:
    """The precision unit of one tool."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settle_ns = settings.survey.settle_s * 1e9
        self._health = PrecisionHealth(derivation.precision_gyro_bias(settings))
        self._gyro_range = derivation.health_params(settings).gyro_range
        self.station = GyroStation(derivation.gyrocompass_params(settings))
        self._stamps = np.zeros(0, dtype=np.int64)
        self._values = np.zeros((0, 6))
        self._clipped = np.zeros(0, dtype=np.uint8)
        self._doubted = np.zeros(0, dtype=np.bool_)
        self._at = 0

    @property
    def faults(self) -> list[SensorFault]:
        """Present faults of the unit."""
        return self._health.faults

    @property
    def rates(self) -> tuple[Stamps, Array]:
        """Stamps, ns, and rates, rad/s, shape (n, 3), of the kept samples; NaN where a gyro clipped or is doubtful."""
        unknown = (self._clipped & ~np.uint8(clip_flags.ACCEL) != 0) | self._doubted
        rates = self._values[:, :3]
        return self._stamps, np.where(unknown[:, None], np.nan, rates) if unknown.any() else rates

    def take(self, stamps: Stamps, values: Array, clipped: NDArray[np.uint8]) -> None:
        """
        Accept samples and their clip flags, with shapes and units as in `UnitSamples`.

        The samples are kept until the bin of their time is closed.
        """
        self._stamps = np.concatenate([self._stamps[self._at :], stamps])
        self._values = np.concatenate([self._values[self._at :], values])
        self._clipped = np.concatenate([self._clipped[self._at :], clipped])
        self._doubted = np.concatenate([self._doubted[self._at :], np.zeros(len(stamps), dtype=np.bool_)])
        self._at = 0

    def take_refused(self, refused: Samples) -> None:
        """Accept the refused readings that may be in another unit of measurement, dtype of `input_gate.REFUSED`."""
        self._health.take_refused(refused)

    def compare(self, stamps: Stamps, values: Array, suspect: NDArray[np.uint8]) -> None:
        """
        Accept samples of the conventional unit of the same time, for comparison.

        values: rates, rad/s, and forces, m/s^2, shape (n, 6); suspect, shape (n,): bits of doubtful sensors, whose
        samples are not compared.
        """
        unsure = suspect & (GYRO | ACCEL) != 0
        if unsure.any():
            values = np.where(unsure[:, None], np.nan, values)
        # Do not compare forces while the x gyro clips: the difference of the centripetal forces is then unknown.
        fast = np.abs(values[:, 0]) >= AT_RANGE * self._gyro_range
        if fast.any():
            values = values.copy()
            values[fast, 3:] = np.nan
        self._health.beside(stamps, values)

    def close(self, imu: Bin, still_bins: int) -> PrecisionBin:
        """
        Close one bin and return its samples and health.

        If the unit is faulty, the rates and accelerations of its samples become NaN; otherwise the samples are used for
        the north seek at the station.

        imu : bin of the conventional unit.
        still_bins : number of bins for which the tool has been still.
        """
        end_ns = (imu.index + 1) * BIN_NS
        # Pass samples by bins, not by blocks, so that the seek gets the same samples however the stream is cut.
        first, self._at = self._at, first_not_before(self._stamps, self._at, end_ns)
        part = slice(first, self._at)
        samples = UnitSamples(self._stamps[part], self._values[part], self._clipped[part])
        changes = self._health.judge(end_ns, still_bins > 0, samples[:2])
        fault = None
        if self._health.active:
            faulty = any(one.unusable for one in self.faults)
            refusal = self._health.refusal
            self.station.refuse(refusal, faulty)
            if self._health.suspect:
                # Do not propagate the azimuth with this unit until it is known which of the two units is wrong.
                self._doubted[part] = True
            if faulty:
                fault = refusal
                samples.values[:] = math.nan
        if fault is None:
            settled = still_bins * BIN_NS > self._settle_ns
            self.station.add(imu, BIN_NS * 1e-9, settled, still_bins > 0, samples)
        return PrecisionBin(samples, changes, fault)


@compiled
def first_not_before(stamps: Stamps, start: int, end_ns: int) -> int:
    """Return the index of the first stamp, from index `start` on, that is not before `end_ns`, ns."""
    while start < len(stamps) and stamps[start] < end_ns:
        start += 1
    return start

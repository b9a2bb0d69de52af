# SPDX-License-Identifier: Apache-2.0
"""
Apply a calibration to a stream of samples, at the temperature of each sample (method of S0, docs/references.md).

Each sample is corrected with the newest temperature that was measured before it, so that live and replay give the same
bits however the stream is cut. Before the first temperature the reference temperature of the calibration is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.calibration.triad_calibration import Calibration, TriadCalibration
from mwd_sensors.core.arrays import Array, Samples

# Number of newest temperatures that are kept for samples that arrive late.
_KEPT = 4096


class Compensation:
    """Correction of the samples of one unit."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self.without_temperature = 0  #: number of IMU samples that were corrected before any temperature was known
        self._stamps: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._celsius: Array = np.empty(0)

    def push_temperature(self, samples: Samples) -> None:
        """Accept samples of the layout `wire.TEMPERATURE`; ignore values that are not finite."""
        good = samples[np.isfinite(samples["temperature"])]
        stamps = np.concatenate([self._stamps, good["stamp_ns"]])
        order = np.argsort(stamps, kind="stable")[-_KEPT:]
        self._stamps = stamps[order]
        self._celsius = np.concatenate([self._celsius, good["temperature"]])[order]

    def imu(self, samples: Samples) -> Samples:
        """Return samples of the layout `wire.IMU` with corrected gyros and accelerometers."""
        out = samples.copy()
        # Use temperatures from strictly before the sample, as in `_corrected`.
        self.without_temperature += int(np.sum(np.searchsorted(self._stamps, samples["stamp_ns"], side="left") == 0))
        out["angular_velocity"] = self._corrected(self.calibration.gyro, samples, "angular_velocity")
        out["linear_acceleration"] = self._corrected(self.calibration.accelerometer, samples, "linear_acceleration")
        return out

    def mag(self, samples: Samples) -> Samples:
        """Return corrected samples of the layout `wire.MAG`; unchanged if the calibration has no magnetometer."""
        if self.calibration.magnetometer is None:
            return samples
        out = samples.copy()
        out["magnetic_field"] = self._corrected(self.calibration.magnetometer, samples, "magnetic_field")
        return out

    def _corrected(self, triad: TriadCalibration, samples: Samples, field: str) -> Array:
        # Use temperatures from strictly before the sample: the order of two messages with equal stamps is random.
        index = np.searchsorted(self._stamps, samples["stamp_ns"], side="left") - 1
        celsius = np.full(len(samples), triad.reference_c)
        celsius[index >= 0] = self._celsius[index[index >= 0]]
        return triad(samples[field], celsius)

# SPDX-License-Identifier: Apache-2.0
"""Compile the estimator's kernels before the first message arrives."""

from __future__ import annotations

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire

_SAMPLES = 160  # three bins of half a second at 100 Hz: enough to reach every kernel


def warm_up(settings: EstimatorSettings) -> None:
    """Compile every kernel on artificial samples, so that the first real one is not delayed."""
    imu, mag, heat = wire.IMU.empty(_SAMPLES), wire.MAG.empty(_SAMPLES), wire.TEMPERATURE.empty(_SAMPLES)
    imu["stamp_ns"] = mag["stamp_ns"] = heat["stamp_ns"] = 10**18 + np.arange(_SAMPLES) * 10**7
    imu["linear_acceleration"] = (-7.0, 0.0, 7.0)
    mag["magnetic_field"] = (2e-5, 1e-5, 4e-5)
    pipeline = Pipeline(settings, Reference(total=5e-5, dip=1.0, source="warm-up"))
    pipeline.push_mag(mag)
    pipeline.push_precision(imu)
    pipeline.push_temperature(heat)
    pipeline.push_imu(imu)
    forces, rates = imu["linear_acceleration"], imu["angular_velocity"]
    north_seek.run(SeekParams(), north_seek.initial(), imu["stamp_ns"], rates, forces)

# SPDX-License-Identifier: Apache-2.0
"""Compile the estimator's kernels before the first message arrives."""

from __future__ import annotations

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.repeated_samples import RepeatedSamples
from mwd_estimation.gyrocompass import north_seek, seek_filter
from mwd_estimation.gyrocompass.seek_state import SeekParams
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.posterior.field_model import nominal_sigmas
from mwd_estimation.survey.posterior.hypotheses import Priors
from mwd_estimation.survey.posterior.run_filter import RunFilter
from mwd_estimation.survey.survey_settings import SHORTEST_S
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.core.settings import changed

_RATE = 100.0  # sample rate, Hz
# Durations of the parts, s: constant samples, so that a fault is found; a turning tool; a tool at rest, long enough for
# the shortest survey.
_CONSTANT_S, _TURNING_S, _STILL_S = 5.0, 2.0, 6.0
# 1 sigma of the samples, m/s^2, rad/s, T.
_NOISE = {"linear_acceleration": 5e-3, "angular_velocity": 1e-3, "magnetic_field": 5e-8}


def warm_up(settings: EstimatorSettings) -> None:
    """Process an artificial survey that calls every kernel, so that compilation does not delay the first sample."""
    quick = changed(settings, {"survey.automatic": True, "survey.settle_s": 0.0, "survey.duration_s": SHORTEST_S})
    imu, mag, heat = _samples()
    RepeatedSamples().take(imu["stamp_ns"], imu)
    pipeline = Pipeline(quick, Reference(total=5e-5, dip=1.0, declination=0.0, source="warm-up"))
    # Push two blocks without magnetic samples in between, so that the kernel that closes an open bin is called.
    cut_ns = imu["stamp_ns"][0] + round((_CONSTANT_S + _TURNING_S) * 1e9)
    for later in (False, True):
        ahrs, field, celsius = (one[(one["stamp_ns"] >= cut_ns) == later] for one in (imu, mag, heat))
        pipeline.push_mag(field)
        pipeline.push_precision(ahrs)
        pipeline.push_temperature(celsius)
        pipeline.push_imu(ahrs)
    pipeline.finish()
    forces, rates = imu["linear_acceleration"], imu["angular_velocity"]
    north_seek.run(SeekParams(), north_seek.initial(), imu["stamp_ns"], rates, forces)
    seek_filter.frame(forces[-1])  # compile a function that only the solution of a rotating tool calls
    # Compile a function that only the revision of a survey with both earlier and later surveys calls.
    filters = RunFilter(Priors(), nominal_sigmas(SensorErrors(), None, magnetic=False))
    filters.between(filters)


def _samples() -> tuple[Samples, Samples, Samples]:
    """Return samples of IMU, magnetometer and thermometer: first constant, then of a turning and of a resting tool."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, _CONSTANT_S + _TURNING_S + _STILL_S, 1.0 / _RATE)
    imu, mag, heat = (kind.empty(len(time_s)) for kind in (wire.IMU, wire.MAG, wire.TEMPERATURE))
    imu["stamp_ns"] = mag["stamp_ns"] = heat["stamp_ns"] = 10**18 + np.round(time_s * 1e9).astype(np.int64)
    turned_s = np.clip(time_s - _CONSTANT_S, 0.0, _TURNING_S)
    imu["angular_velocity"][:, 0] = np.where((turned_s > 0.0) & (turned_s < _TURNING_S), 2.0 * np.pi, 0.0)
    mat_tn = np.swapaxes(mat_nt(0.8, 1.9, 2.0 * np.pi * turned_s), 1, 2)
    imu["linear_acceleration"] = mat_tn @ [0.0, 0.0, -STANDARD_GRAVITY]
    mag["magnetic_field"] = mat_tn @ [5e-5 * np.cos(1.0), 0.0, 5e-5 * np.sin(1.0)]
    works = time_s >= _CONSTANT_S
    for samples, name in ((imu, "linear_acceleration"), (imu, "angular_velocity"), (mag, "magnetic_field")):
        samples[name][works] += rng.normal(0.0, _NOISE[name], (int(works.sum()), 3))
    return imu, mag[(turned_s == 0.0) | (turned_s == _TURNING_S)], heat

# SPDX-License-Identifier: Apache-2.0
"""Combine the settings of the tool with the noise that the covariances of its samples state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from mwd_estimation.attitude import time_alignment_state
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.input_covariance import StatedNoise

# Smallest ratio of the stated noise of a gyro to the noise in the settings at which the stated noise is used. A data
# sheet states the noise density; a driver states the noise of a sample after the filter of the sensor. The density
# computed from such a sample is about twice the real density (filter of first order, 255 Hz, read at 100 Hz).
_LARGER = 3.0
# Accelerometer noise density that the bounded filter assumes, m/s^2/sqrt(Hz); a smaller stated noise changes nothing.
_ACCEL_NOISE = BoundedParams().accel_noise


def with_noise(settings: EstimatorSettings, stated: Mapping[str, StatedNoise]) -> tuple[EstimatorSettings, list[str]]:
    """
    Return settings with the noise that covariances state, where it is larger than the noise in the settings.

    Parameters
    ----------
    stated : mapping
        Noise of each vector of the messages, by field name, from `input_covariance.NoiseWatch`.

    Returns
    -------
    settings : EstimatorSettings
        The given settings, with larger gyro noise and larger biases of accelerometer and magnetometer where needed.
    notes : list of str
        One sentence for each vector whose stated noise is used; empty if the settings stay the same.
    """
    tool, notes = settings.tool, []
    gyro, accel, mag = (
        stated.get(vector, StatedNoise()) for vector in ("angular_velocity", "linear_acceleration", "magnetic_field")
    )
    gyro_noise, mag_bias = tool.gyro.noise_deg_sqrt_h, tool.magnetometer.bias_nt
    accel_bias = tool.accelerometer.bias_ug
    taken = "more than the settings of the tool; the sigmas are widened accordingly"
    # Averaging time of the continuous attitude, s, which is shorter than the averaging time of a station.
    seconds = max(2.0 * time_alignment_state.TimeAlignmentParams().smoothing_s, accel.period_s, mag.period_s)
    density = math.degrees(gyro.density) * 60.0
    if density > _LARGER * gyro_noise:
        gyro_noise = density
        notes.append(f"the covariance of angular_velocity states {density:.2g} deg/sqrt(h), {taken}")
    if accel.density > _ACCEL_NOISE:
        accel_bias = math.hypot(accel_bias, accel.density / STANDARD_GRAVITY / math.sqrt(seconds) * 1e6)
        notes.append(f"the covariance of linear_acceleration states {accel.sigma:.2g} m/s^2 per sample, {taken}")
    if mag.sigma * 1e9 > mag_bias:
        mag_bias = math.hypot(mag_bias, mag.density * 1e9 / math.sqrt(seconds))
        notes.append(f"the covariance of magnetic_field states {mag.sigma * 1e9:.0f} nT per sample, {taken}")
    if not notes:
        return settings, notes
    tool = dataclasses.replace(
        tool,
        gyro=dataclasses.replace(tool.gyro, noise_deg_sqrt_h=gyro_noise),
        accelerometer=dataclasses.replace(tool.accelerometer, bias_ug=min(accel_bias, 1e5)),
        magnetometer=dataclasses.replace(tool.magnetometer, bias_nt=min(mag_bias, 1e4)),
    )
    return dataclasses.replace(settings, tool=tool), notes

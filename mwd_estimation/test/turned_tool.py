# SPDX-License-Identifier: Apache-2.0
"""A tool that turns about its axis by a given speed, sampled at 100 Hz: stamps, toolface and axial rate."""

import numpy as np

from mwd_sensors.core.frames import wrap_pi

STEP = 0.01
START = 1_700_000_000 * 10**9
# Steps of the integration of the speed per sample.
_FINE = 20


def turned(speed, seconds):
    """Stamps, ns, and toolface, rad, of a tool that turns as `speed(t)`, rad/s, says, from toolface 0 on."""
    n = round(seconds / STEP)
    t = np.arange(n * _FINE) * STEP / _FINE
    angle = np.concatenate([[0.0], np.cumsum(speed(t + 0.5 * STEP / _FINE)) * STEP / _FINE])[::_FINE][:n]
    return START + np.round(np.arange(n) * STEP * 1e9).astype(np.int64), angle


def noisy_rates(angle, rng):
    """Rates, rad/s, shape (n, 3), with noise; those of the axis are the means over the sample that ends there."""
    gyro = 1e-3 * rng.normal(size=(len(angle), 3))
    gyro[1:, 0] += np.diff(angle) / STEP
    return gyro


def toolface_error(track, angle):
    """Error of the gravity toolface of a track, rad, by the true toolface."""
    return wrap_pi(np.arctan2(-track.g_t[:, 1], -track.g_t[:, 2]) - angle)

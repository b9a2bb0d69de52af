# SPDX-License-Identifier: Apache-2.0
"""
The precision unit as a gyrocompass: its error figures and when north is sought with it, as parameters.

One function makes the parameters of a seek of them, one finds the gyros' white noise from the samples of a tool at
rest.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR

# Selectable methods: all states of `north_seek`, or the fifteen of S1 (`static_ekf`).
SEEK, S1 = "seek", "s1"

# White noise where neither the parameters nor the tool show it (a tactical MEMS gyro), and the least that is credible,
# deg/sqrt(h).
_TACTICAL_NOISE, _LEAST_NOISE = 0.05, 0.001
# Samples averaged for the noise that counts, and by how much single ones may exceed it before they count no longer.
_AVERAGED, _SHAKEN = 10, 1.5
# A tactical MEMS unit as its data sheet describes it; its noise is measured.
TACTICAL = SeekParams(
    gyro_noise_deg_rth=0.0,
    gyro_bias_deg_h=5.0,
    gyro_x_bias_deg_h=5.0,
    bias_scale="at_most",
    accel_bias_ug=200.0,
    gyro_walk_deg_h_rth=0.3,
    gyro_ramp_deg_h2=3.0,
    scale_x_ppm=500.0,
    leak_urad=300.0,
    g_sensitivity_deg_h_g=0.5,
    gyro_range_dps=100.0,
)


@dataclasses.dataclass(frozen=True)
class GyroParams:
    """The precision unit, and when north is sought with it at a station; the figures are a tactical MEMS unit's."""

    #: Figures of the unit, and what an azimuth must reach. White noise of 0: computed from the samples of the tool at
    #: rest. Latitude and gravity are those of the place, and are set by `seek_params`.
    unit: SeekParams = TACTICAL
    #: Method of a station. seek estimates the biases from rests and half turns; s1 is the filter of S1, for a tool that
    #: never moves and a gyro whose bias is small.
    method: str = SEEK
    longest_turn_s: float = 30.0  #: a turn between two rests that takes longer ends the seek, s


def seek_params(
    gyro: GyroParams, latitude_deg: float, gravity: float | None, noise_deg_rth: float | None = None
) -> SeekParams:
    """
    Parameters of a seek in which all three gyros are the precision unit's.

    Parameters
    ----------
    gyro : GyroParams
    latitude_deg : float
    gravity : float or None
        Local gravity, m/s^2; None: standard gravity.
    noise_deg_rth : float or None
        White noise as the tool at rest shows it, deg/sqrt(h), for `gyro` that leaves it open.
    """
    noise = gyro.unit.gyro_noise_deg_rth or noise_deg_rth or _TACTICAL_NOISE
    return dataclasses.replace(
        gyro.unit,
        latitude_deg=latitude_deg,
        gravity=gyro.unit.gravity if gravity is None else gravity,
        gyro_noise_deg_rth=noise,
        gyro_x_noise_deg_rth=noise,
    )


def white_noise(stamp_ns: Stamps, gyro_t: Array) -> float | None:
    """
    White noise of the y and z gyros of a tool at rest, deg/sqrt(h); None where there are too few samples.

    stamp_ns, shape (n,); gyro_t, shape (n, 3), rad/s. From neighbours' differences, which know no bias and no Earth
    rate. Pumps shake single samples and leave tenths of a second alone: where both disagree, the latter count.
    """
    usable = np.isfinite(gyro_t).all(axis=1)
    stamps, rates = stamp_ns[usable], gyro_t[usable, 1:]
    if len(stamps) < 5 * _AVERAGED:
        return None
    step = float(np.median(np.diff(stamps))) * 1e-9
    if not step > 0.0:
        return None

    def density(values: Array, seconds: float) -> float:
        return math.sqrt(0.5 * float(np.mean(np.diff(values, axis=0) ** 2)) * seconds)

    whole = len(rates) // _AVERAGED
    means = rates[: whole * _AVERAGED].reshape(whole, _AVERAGED, 2).mean(axis=1)
    single, averaged = density(rates, step), density(means, _AVERAGED * step)
    found = averaged if single > _SHAKEN * averaged else single
    return max(found / DEG_PER_ROOT_HOUR, _LEAST_NOISE)

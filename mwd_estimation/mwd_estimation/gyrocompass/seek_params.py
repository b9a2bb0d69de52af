# SPDX-License-Identifier: Apache-2.0
"""
Parameters of a north seek, in the units of measurement of data sheets and in SI for the compiled filters.

One function measures the gyros' white noise from samples of a tool at rest.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.gyrocompass.seek_state import KernelParams
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY

# Selectable methods: seek, the filter `north_seek`; s1, the filter `static_ekf` of paper S1 with 15 states.
SEEK, S1 = "seek", "s1"
# White noise if neither the parameters nor the tool give it (a tactical MEMS gyro), and smallest credible white noise,
# deg/sqrt(h).
TACTICAL_NOISE_DEG_RTH, _LEAST_NOISE = 0.05, 0.001
# Number of samples in an average for the noise; and largest ratio of the noise from single samples to the noise from
# averages at which single samples are used.
_AVERAGED, _SHAKEN = 10, 1.5
# Ratio of measured to stated noise above which the measured noise is used: three sigmas of the measured noise.
_NOISIER = 1.25
# Share of the range above which a gyro counts as clipped.
_CLIPS_FROM = 0.98
# Smallest 1 sigma of a bias, deg/h, and of its ramp, deg/h per hour, so that the Gaussians are not degenerate; and
# time, h, for which the stated drift is added to the stated bias.
LEAST_BIAS, _LEAST_RAMP, _DRIFTED_H = 1e-6, 1e-9, 1.0
# Start sigma of the biases in a seek, as a multiple of the stated sigma: four times the largest credible sigma, because
# `gyro_errors` replaces this prior by the prior of the run. A larger sigma would let bias and scale of the x gyro,
# which are not separable in steady rotation, grow without limit.
_UNKNOWN = 16.0
# Assumed ratios of the real to the stated sigma of the g-sensitivity, from a unit as stated to the worst unit. A seek
# starts with the largest ratio; `gyro_errors` replaces this prior by the prior of the run. `_LEAST_G`: smallest stated
# sigma of the g-sensitivity, deg/h/g, so that the Gaussians are not degenerate.
G_SCALES, _LEAST_G = (1.0, 2.0, 4.0), 1e-6


@dataclasses.dataclass(frozen=True)
class SeekParams:
    """Settings of a north seek. Noise and calibration figures are 1 sigma; y and z belong to the precision unit."""

    #: Method at a station. seek estimates the biases from intervals at rest and half turns. s1 is the filter of S1, for
    #: a tool that never moves and a gyro with a small bias.
    method: str = SEEK
    latitude_deg: float = 34.0  #: geodetic latitude, north positive, deg; NaN: unknown, so that no seek is possible
    #: Height above the ellipsoid, m. A measured gravity that does not fit latitude and height shows that the latitude
    #: is wrong.
    height_m: float = 0.0
    #: Motion of the tool during the seek. auto accepts any motion; every other mode refuses a different motion.
    mode: str = "auto"
    shortest: float = 30.0  #: shortest seek that gives an azimuth, s
    gyro_noise_deg_rth: float = 0.05  #: white noise of y and z, deg/sqrt(h)
    gyro_x_noise_deg_rth: float = 0.42  #: white noise of x, deg/sqrt(h)
    accel_noise_ug_rthz: float = 30.0  #: white noise of the accelerometers, ug/sqrt(Hz)
    #: Stated bias of y and z, and of x, 1 sigma, deg/h. The run estimates how good this unit is.
    gyro_bias_deg_h: float = 1.0
    gyro_x_bias_deg_h: float = 36.0
    accel_bias_ug: float = 100.0  #: sigma of the accelerometer bias, ug
    accel_scale_ppm: float = 300.0  #: sigma of the accelerometer scale, ppm
    gyro_walk_deg_h_rth: float = 0.02  #: random walk of the gyro bias in one hour, deg/h
    gyro_ramp_deg_h2: float = 0.0  #: sigma of the ramp of the gyro bias, for example while warming up, deg/h per hour
    scale_x_ppm: float = 5000.0  #: sigma of the scale of the x gyro, ppm
    leak_urad: float = 500.0  #: sigma of the share of the x rate that y and z read after calibration, urad
    #: Sigma of each element of the g-sensitivity of y and z after calibration, deg/h/g.
    g_sensitivity_deg_h_g: float = 0.0
    #: Calibrated g-sensitivity: along, across, stretch, shear, deg/h/g.
    g_calibration_deg_h_g: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    lag_ms: float = 0.0  #: delay of the y and z gyros relative to the x gyro, ms
    lag_sigma_ms: float = 0.05  #: sigma of `lag_ms`, ms
    lead_ms: float = 0.0  #: time by which the accelerometer precedes the x gyro, ms
    lead_sigma_ms: float = 3.0  #: sigma of `lead_ms`, ms; this error becomes observable when the rotation starts
    longest_turn_s: float = 30.0  #: longest rotation between two intervals at rest, s; a longer one ends the seek
    gyro_range_dps: float = 400.0  #: rate at which y and z clip, deg/s

    @property
    def bias_sigma_deg_h(self) -> tuple[float, float, float]:
        """1 sigma of the stated biases of x, y, z, deg/h, including the drift of one hour."""
        drift = math.hypot(self.gyro_walk_deg_h_rth * math.sqrt(_DRIFTED_H), self.gyro_ramp_deg_h2 * _DRIFTED_H)
        x, across = (
            math.hypot(max(bias, LEAST_BIAS), drift) for bias in (self.gyro_x_bias_deg_h, self.gyro_bias_deg_h)
        )
        return x, across, across


# Data-sheet figures of a tactical MEMS unit; its noise is measured.
TACTICAL = SeekParams(
    gyro_noise_deg_rth=0.0,
    gyro_bias_deg_h=5.0,
    gyro_x_bias_deg_h=5.0,
    accel_bias_ug=200.0,
    gyro_walk_deg_h_rth=0.3,
    gyro_ramp_deg_h2=3.0,
    scale_x_ppm=500.0,
    leak_urad=300.0,
    g_sensitivity_deg_h_g=0.5,
    gyro_range_dps=100.0,
)


def with_noise(unit: SeekParams, noise_deg_rth: float | None = None) -> SeekParams:
    """
    Return the parameters of a seek that uses all three gyros of the precision unit.

    Parameters
    ----------
    unit : SeekParams
        Figures of the precision unit. If its white noise is 0, or clearly smaller than the measured noise, the measured
        noise is used; if both are 0 or None, `TACTICAL_NOISE_DEG_RTH`.
    noise_deg_rth : float or None
        White noise measured at rest, deg/sqrt(h).
    """
    measured = noise_deg_rth or 0.0
    stated = unit.gyro_noise_deg_rth or measured or TACTICAL_NOISE_DEG_RTH
    # The stated noise is for all units of a type; use the noise of this unit if it is clearly larger.
    noise = measured if measured > _NOISIER * stated else stated
    return dataclasses.replace(unit, gyro_noise_deg_rth=noise, gyro_x_noise_deg_rth=noise)


def kernel_params(params: SeekParams) -> KernelParams:
    """Return the parameters in SI."""
    latitude = math.radians(params.latitude_deg)
    horizontal = EARTH_RATE * math.cos(latitude)
    # Along, across, stretch and shear are half sums of two matrix elements, each of this sigma.
    element = G_SCALES[-1] * max(params.g_sensitivity_deg_h_g, _LEAST_G) * math.sqrt(0.5)
    start_x, start_y, start_z = (_UNKNOWN * sigma * DEG_PER_HOUR for sigma in params.bias_sigma_deg_h)
    along, across, stretch, shear = np.array(params.g_calibration_deg_h_g) * DEG_PER_HOUR / STANDARD_GRAVITY
    return KernelParams(
        horizontal=horizontal,
        down=-EARTH_RATE * math.sin(latitude),
        gravity=earth.gravity(latitude, params.height_m),
        coarse_seconds=0.5 * params.shortest,
        gyro_noise=params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR,
        gyro_x_noise=params.gyro_x_noise_deg_rth * DEG_PER_ROOT_HOUR,
        accel_noise=params.accel_noise_ug_rthz * MICRO_G,
        gyro_bias=params.gyro_bias_deg_h * DEG_PER_HOUR,
        start_bias=(start_x, start_y, start_z),
        accel_bias=params.accel_bias_ug * MICRO_G,
        accel_scale=params.accel_scale_ppm * 1e-6,
        bias_walk=params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0,
        bias_ramp=max(params.gyro_ramp_deg_h2, _LEAST_RAMP) * DEG_PER_HOUR / 3600.0,
        scale_x=params.scale_x_ppm * 1e-6,
        leak=params.leak_urad * 1e-6,
        g_sensitivity=element * DEG_PER_HOUR / STANDARD_GRAVITY,
        g_calibration=(float(along), float(across), float(stretch), float(shear)),
        lag=params.lag_ms * 1e-3,
        lag_sigma=params.lag_sigma_ms * 1e-3,
        lead=params.lead_ms * 1e-3,
        lead_sigma=params.lead_sigma_ms * 1e-3,
        gyro_range=_CLIPS_FROM * math.radians(params.gyro_range_dps),
    )


def white_noise(stamp_ns: Stamps, gyro_t: Array, *, turning: bool = False) -> float | None:
    """
    Return the white noise of the y and z gyros, deg/sqrt(h), or None for too few samples.

    stamp_ns, shape (n,), ns; gyro_t, shape (n, 3), rad/s. The noise is computed from differences of neighbouring
    samples, which contain neither bias nor Earth rate; in a turning tool from second differences, which contain no
    steady rotation either. Pumps shake single samples, but not averages over tenths of a second; if the noise from
    single samples is clearly larger, the averages are used.
    """
    usable = np.isfinite(gyro_t).all(axis=1)
    stamps, rates = stamp_ns[usable], gyro_t[usable, 1:]
    if len(stamps) < 5 * _AVERAGED:
        return None
    step = float(np.median(np.diff(stamps))) * 1e-9
    if not step > 0.0:
        return None

    order, gain = (2, 6.0) if turning else (1, 2.0)

    def density(values: Array, seconds: float) -> float:
        return math.sqrt(float(np.mean(np.diff(values, order, axis=0) ** 2)) / gain * seconds)

    whole = len(rates) // _AVERAGED
    means = rates[: whole * _AVERAGED].reshape(whole, _AVERAGED, 2).mean(axis=1)
    single, averaged = density(rates, step), density(means, _AVERAGED * step)
    found = averaged if single > _SHAKEN * averaged else single
    return max(found / DEG_PER_ROOT_HOUR, _LEAST_NOISE)

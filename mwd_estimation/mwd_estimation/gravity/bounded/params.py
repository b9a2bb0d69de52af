"""Settings of the bounded gravity filter, for people (`Params`) and for its kernels (`KernelParams`)."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the bounded filter: first the place and the tool, then the expert settings of the method."""

    gravity: float = setting(
        STANDARD_GRAVITY,
        "Magnitude of local gravity. An error of 0.01 costs nothing in attitude; a state absorbs it.",
        unit="m/s^2",
        low=9.0,
        high=10.5,
    )
    gyro_range: float = setting(
        34.9,
        "Rate at which the gyro clips. Raising it above the sensor's range integrates clipped rates.",
        unit="rad/s",
        low=0.1,
        high=200.0,
    )
    accel_range: float = setting(
        156.9,
        "Force at which the accelerometer clips. Raising it above the sensor's range hides velocity lost in shocks.",
        unit="m/s^2",
        low=10.0,
        high=4000.0,
    )
    coning: float = setting(
        0.0,
        "Share of the 1/12 coning term: 1 for mean rates, 0 where the sensor strapdown-integrates.",
        low=0.0,
        high=1.0,
    )
    sampled: bool = setting(
        False, "Rates are point samples instead of means over the sampling interval: integrate them by the trapezoid."
    )
    bias_sigma: float = setting(
        0.005,
        "Gyro bias at switch-on, 1 sigma. Raising it lets the bias settle faster and the start be less certain.",
        unit="rad/s",
        low=1e-6,
        high=0.2,
    )
    scale_sigma: float = setting(
        0.0015,
        "Scale error of the x gyro at switch-on, 1 sigma. Raising it widens the start where the speed varies.",
        low=1e-6,
        high=0.2,
    )
    lever_sigma: float = setting(
        0.03,
        "Distance of the sensor from the point of the tool that moves least, 1 sigma. Raising it lets a sensor far off"
        " the axis settle faster.",
        unit="m",
        low=1e-4,
        high=5.0,
    )
    calibration_sigma: float = setting(
        0.00017,
        "Tilt that calibration errors of the accelerometers leave: a floor of sigma. 0.003 for a sensor as it leaves"
        " the factory.",
        unit="rad",
        low=0.0,
        high=0.5,
    )
    misalignment_sigma: float = setting(
        0.0003,
        "Angle between the axes of gyros and accelerometers that calibration leaves: a floor of the sigma of"
        " inclination while the tool rotates.",
        unit="rad",
        low=0.0,
        high=0.5,
    )
    gyro_noise: float = setting(
        0.00071,
        "Gyro white noise with reserve. Raising it follows the accelerometer faster and lets more vibration through.",
        unit="rad/s/sqrt(Hz)",
        low=1e-7,
        high=0.1,
    )
    rate_noise: float = setting(
        0.0012,
        "Gyro noise for each rate across the tool axis (scale and misalignment, which are no states). Raise it for"
        " uncalibrated gyros.",
        low=0.0,
        high=0.1,
    )
    bias_walk: float = setting(
        0.00013,
        "Random walk of the gyro bias with reserve. Raising it follows a warming gyro faster and is noisier.",
        unit="rad/s/sqrt(s)",
        low=0.0,
        high=0.01,
    )
    accel_noise: float = setting(
        0.014,
        "Accelerometer white noise with reserve. Raising it smooths more.",
        unit="m/s^2/sqrt(Hz)",
        low=1e-5,
        high=1.0,
    )
    displacement: float = setting(
        0.0038,
        "Least displacement of the tool by vibration, 1 sigma. Raising it smooths a quiet tool more.",
        unit="m",
        low=1e-5,
        high=1.0,
    )
    walk: float = setting(
        0.001,
        "Least random walk of the point that the tool vibrates about. Raising it smooths a quiet tool more.",
        unit="m/sqrt(s)",
        low=1e-6,
        high=10.0,
    )
    axial_speed: float = setting(
        0.5,
        "Usual speed along the hole, 1 sigma; in a curve it is an acceleration. Raising it widens sigma while"
        " drilling a curve. Raise it for wireline speeds.",
        unit="m/s",
        low=0.0,
        high=10.0,
    )
    max_bridged_gap_s: float = setting(
        10.0,
        "Longest data gap over which the attitude is continued with a wider sigma; a longer one starts it anew."
        " Raising it keeps the attitude of a tool that does not turn.",
        unit="s",
        low=0.0,
        high=600.0,
    )


class KernelParams(NamedTuple):
    """The settings as compiled kernels take them; names, units and meaning as in `Params`."""

    gravity: float
    gyro_range: float
    accel_range: float
    coning: float
    sampled: bool
    bias_sigma: float
    scale_sigma: float
    lever_sigma: float
    calibration_sigma: float
    misalignment_sigma: float
    gyro_noise: float
    rate_noise: float
    bias_walk: float
    accel_noise: float
    displacement: float
    walk: float
    axial_speed: float
    max_bridged_gap_s: float


def kernel_params(params: Params) -> KernelParams:
    """Return the settings for the kernels."""
    return KernelParams(*(getattr(params, name) for name in KernelParams._fields))

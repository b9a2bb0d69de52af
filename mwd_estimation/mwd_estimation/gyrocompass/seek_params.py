"""Parameters of a north seek, in the units of data sheets, and the same in SI for the compiled filter."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.gyrocompass.seek_state import KernelParams
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

# Least noise of a direction, rad; share of its range from which a gyro counts as clipped; rate about the axis below
# which the tool rests, rad/s.
_DIRECTION_FLOOR, _CLIPS_FROM, _STILL_RATE = 1e-6, 0.98, 0.05
MODES = ("auto", "still", "two_position", "rotating", "continuous")


@dataclasses.dataclass(frozen=True)
class SeekParams:
    """Settings of a north seek. Noise and calibration figures are one sigma; y and z belong to the precision unit."""

    latitude_deg: float = setting(34.0, "Geodetic latitude, north positive.", unit="deg", low=-90.0, high=90.0)
    gravity: float = setting(
        STANDARD_GRAVITY, "Magnitude of local gravity; S1's filter uses it.", unit="m/s^2", low=9.0, high=10.5
    )
    mode: str = setting(
        "auto",
        "What the tool does while north is sought. auto judges by the motion; the others refuse another motion.",
        choices=MODES,
    )
    shortest: float = setting(30.0, "Shortest seek that gives an azimuth.", unit="s", low=1.0, high=3600.0)
    worst_sigma_deg: float = setting(20.0, "An azimuth with a larger sigma is refused.", unit="deg", low=0.1, high=90)
    gyro_noise_deg_rth: float = setting(0.05, "White noise of y and z.", unit="deg/sqrt(h)", low=1e-5, high=10.0)
    gyro_x_noise_deg_rth: float = setting(0.42, "White noise of x.", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    accel_noise_ug_rthz: float = setting(
        30.0, "White noise of the accelerometers.", unit="ug/sqrt(Hz)", low=0.01, high=1e4
    )
    gyro_bias_deg_h: float = setting(1.0, "Sigma of the bias of y and z.", unit="deg/h", low=0.0, high=1e5)
    bias_scale: str = setting(
        "stated",
        "stated: the bias figures are sigmas. at_most: sigmas are those or less, as the fit to the latitude shows.",
        choices=("stated", "at_most"),
    )
    gyro_x_bias_deg_h: float = setting(36.0, "Sigma of the bias of x.", unit="deg/h", low=0.0, high=1e5)
    accel_bias_ug: float = setting(100.0, "Sigma of the accelerometer bias.", unit="ug", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(
        0.02, "Random walk of the gyro bias in an hour.", unit="deg/h", low=0.0, high=1e4
    )
    scale_x_ppm: float = setting(5000.0, "Sigma of the scale of the x gyro.", unit="ppm", low=0.0, high=1e5)
    leak_urad: float = setting(
        500.0, "Sigma of the x rate that y and z measure after calibration.", unit="urad", low=0.0, high=1e5
    )
    g_sensitivity_deg_h_g: float = setting(
        0.0,
        "Sigma of each element of the g-sensitivity of y and z after calibration.",
        unit="deg/h/g",
        low=0.0,
        high=1e3,
    )
    g_calibration_deg_h_g: tuple[float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0), "Calibrated g-sensitivity: along, across, stretch, shear.", unit="deg/h/g"
    )
    g_locked_deg_h_g: float | None = setting(
        None,
        "Sigma of along and across after calibration, where it is smaller than that of the elements.",
        unit="deg/h/g",
        low=0.0,
        high=1e3,
    )
    expected_azimuth_deg: float | None = setting(
        None,
        "Azimuth that chooses between several that fit equally; it does not move the result.",
        unit="deg",
        low=-360.0,
        high=720.0,
    )
    lag_ms: float = setting(0.0, "Delay of the y and z gyros behind the x gyro.", unit="ms", low=-50.0, high=50.0)
    lag_sigma_ms: float = setting(0.05, "Sigma of that delay.", unit="ms", low=0.0, high=50.0)
    lead_ms: float = setting(
        0.0, "Time by which the accelerometer is ahead of the x gyro.", unit="ms", low=-50.0, high=50.0
    )
    lead_sigma_ms: float = setting(3.0, "Sigma of that time; a spin-up shows it.", unit="ms", low=0.0, high=50.0)
    sigma_velocity: float = setting(0.005, "Sigma of the tool's velocity.", unit="m/s", low=1e-6, high=10.0)
    axis_walk_deg_rth: float = setting(
        0.0005,
        "Random walk of the direction of the hole axis. Large values make a filter that integrates for hours.",
        unit="deg/sqrt(h)",
        low=0.0,
        high=1e3,
    )
    block_seconds: float = setting(0.1, "Time between two Kalman steps.", unit="s", low=0.01, high=1.0)
    level_seconds: float = setting(
        2.0, "Duration of the mean force that starts the filter.", unit="s", low=0.1, high=60.0
    )
    gap: float = setting(1.0, "A longer data gap begins the seek anew.", unit="s", low=0.01, high=60.0)
    gyro_range_dps: float = setting(400.0, "Rate at which y and z clip.", unit="deg/s", low=1.0, high=5000.0)


def kernel_params(params: SeekParams) -> KernelParams:
    """Parameters in SI."""
    latitude = math.radians(params.latitude_deg)
    horizontal = EARTH_RATE * math.cos(latitude)
    expected = (0.0, 0.0)
    if params.expected_azimuth_deg is not None:
        azimuth = math.radians(params.expected_azimuth_deg)
        expected = horizontal * math.cos(azimuth), -horizontal * math.sin(azimuth)
    # Four elements of one sigma: along, across, stretch and shear are half sums of two.
    element = params.g_sensitivity_deg_h_g * math.sqrt(0.5)
    locked = element if params.g_locked_deg_h_g is None else params.g_locked_deg_h_g
    along, across, stretch, shear = np.array(params.g_calibration_deg_h_g) * DEG_PER_HOUR / STANDARD_GRAVITY
    return KernelParams(
        gap_ns=round(params.gap * 1e9),
        horizontal=horizontal,
        down=-EARTH_RATE * math.sin(latitude),
        level_seconds=params.level_seconds,
        block_seconds=params.block_seconds,
        gyro_noise=params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR,
        gyro_x_noise=params.gyro_x_noise_deg_rth * DEG_PER_ROOT_HOUR,
        accel_noise=params.accel_noise_ug_rthz * MICRO_G,
        gyro_bias=params.gyro_bias_deg_h * DEG_PER_HOUR,
        gyro_x_bias=params.gyro_x_bias_deg_h * DEG_PER_HOUR,
        accel_bias=params.accel_bias_ug * MICRO_G,
        bias_walk=params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0,
        scale_x=params.scale_x_ppm * 1e-6,
        leak=params.leak_urad * 1e-6,
        g_sensitivity=element * DEG_PER_HOUR / STANDARD_GRAVITY,
        g_locked=locked * DEG_PER_HOUR / STANDARD_GRAVITY,
        g_calibration=(float(along), float(across), float(stretch), float(shear)),
        lag=params.lag_ms * 1e-3,
        lag_sigma=params.lag_sigma_ms * 1e-3,
        lead=params.lead_ms * 1e-3,
        lead_sigma=params.lead_sigma_ms * 1e-3,
        velocity=params.sigma_velocity,
        axis_walk=params.axis_walk_deg_rth * DEG_PER_ROOT_HOUR,
        direction_floor=_DIRECTION_FLOOR,
        gyro_range=_CLIPS_FROM * math.radians(params.gyro_range_dps),
        still_rate=_STILL_RATE,
        expected=expected,
    )

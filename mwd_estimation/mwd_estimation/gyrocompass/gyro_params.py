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


@dataclasses.dataclass(frozen=True)
class GyroParams:
    """
    The precision unit, one sigma each, and when north is sought with it; the figures are a tactical MEMS unit's.

    Attributes
    ----------
    method : str
        Method of a station. seek estimates the biases from rests and half turns; s1 is the filter of S1, for a tool
        that never moves and a gyro whose bias is small.
    noise_deg_rth : float
        White noise of y and z, deg/sqrt(h). 0: computed from the samples of the tool at rest.
    bias_deg_h : float
        Sigma of the gyro bias, deg/h. Raising it widens the azimuth's sigma until a second position shows the bias.
    bias_scale : str
        stated: bias_deg_h is the sigma. at_most: the sigma is that or less, as the fit to the latitude shows; use it
        where the bound of a data sheet is all that is known.
    walk_deg_h_rth : float
        Random walk of the bias in an hour, deg/h. Raising it forgets sooner what earlier seeks
        showed.
    ramp_per_h : float
        Sigma of the ramp of the bias where the tool warms up or cools, as a share of bias_deg_h in an hour. Raising it
        widens the sigma of the stations after one in two positions.
    scale_x_ppm : float
        Sigma of the scale of the x gyro, ppm.
    leak_urad : float
        Sigma of the x rate that y and z measure (misalignment), urad.
    g_sensitivity_deg_h_g : float
        Sigma of each element of the g-sensitivity of y and z, deg/h/g.
    g_calibration_deg_h_g : tuple[float, float, float, float]
        Calibrated g-sensitivity: along, across, stretch, shear (`north_seek.calibrated`), deg/h/g.
    range_dps : float
        Rate at which y and z clip, deg/s.
    accel_noise_ug_rthz : float
        White noise of the accelerometers, ug/sqrt(Hz).
    accel_bias_ug : float
        Sigma of the accelerometer bias, ug; it turns the azimuth by bias / g tan(latitude).
    shortest_s : float
        Shortest seek that gives an azimuth, s.
    worst_sigma_deg : float
        An azimuth with a larger sigma is refused, deg.
    enough_sigma_deg : float
        An automatic survey waits for a gyro azimuth no longer once its sigma is this small, deg.
    longest_turn_s : float
        A turn between two rests that takes longer ends the seek, s.
    max_shake : float
        Standard deviation of the axial force above which a turn ends the seek, m/s^2.
    max_axis_step : float
        Change of the axial force above which the hole axis lies elsewhere and the seek ends, m/s^2.
    """

    method: str = SEEK
    noise_deg_rth: float = 0.0
    bias_deg_h: float = 5.0
    bias_scale: str = "at_most"
    walk_deg_h_rth: float = 0.3
    ramp_per_h: float = 0.6
    scale_x_ppm: float = 500.0
    leak_urad: float = 300.0
    g_sensitivity_deg_h_g: float = 0.5
    g_calibration_deg_h_g: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    range_dps: float = 100.0
    accel_noise_ug_rthz: float = 30.0
    accel_bias_ug: float = 200.0
    shortest_s: float = 30.0
    worst_sigma_deg: float = 20.0
    enough_sigma_deg: float = 0.7
    longest_turn_s: float = 30.0
    max_shake: float = 0.25
    max_axis_step: float = 0.03


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
    noise = gyro.noise_deg_rth or noise_deg_rth or _TACTICAL_NOISE
    params = SeekParams(
        latitude_deg=latitude_deg,
        shortest=gyro.shortest_s,
        worst_sigma_deg=gyro.worst_sigma_deg,
        gyro_noise_deg_rth=noise,
        gyro_x_noise_deg_rth=noise,
        accel_noise_ug_rthz=gyro.accel_noise_ug_rthz,
        gyro_bias_deg_h=gyro.bias_deg_h,
        gyro_x_bias_deg_h=gyro.bias_deg_h,
        bias_scale=gyro.bias_scale,
        accel_bias_ug=gyro.accel_bias_ug,
        gyro_walk_deg_h_rth=gyro.walk_deg_h_rth,
        gyro_ramp_deg_h2=gyro.ramp_per_h * gyro.bias_deg_h,
        scale_x_ppm=gyro.scale_x_ppm,
        leak_urad=gyro.leak_urad,
        g_sensitivity_deg_h_g=gyro.g_sensitivity_deg_h_g,
        g_calibration_deg_h_g=gyro.g_calibration_deg_h_g,
        gyro_range_dps=gyro.range_dps,
    )
    return params if gravity is None else dataclasses.replace(params, gravity=gravity)


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

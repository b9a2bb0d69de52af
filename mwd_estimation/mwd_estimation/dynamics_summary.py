"""
Drilling dynamics in a driller's numbers, from one window of IMU samples and the gravity followed through it.

Rotary speed and stick-slip severity as used in the field (SSI = (max - min) / (2 mean) of the down-hole rotary speed),
vibration as the root mean square of the non-gravity acceleration along and across the axis, peaks, and shocks counted
as separate excursions beyond a threshold. Of strapdown-integrated samples these are averages over the sample interval:
what shook faster than half the rate is not in them.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.track import STANDARD_GRAVITY
from mwd_sensors.settings import setting

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the summary."""

    shock_threshold: float = setting(
        25.0 * STANDARD_GRAVITY, "non-gravity acceleration that counts as a shock", unit="m/s^2", low=1.0, high=1e4
    )
    shock_separation: float = setting(0.01, "excursions closer than this are one shock", unit="s", low=0.0, high=1.0)
    speed_smoothing: float = setting(0.05, "mean over which rotary speed is read", unit="s", low=0.0, high=1.0)
    least_speed: float = setting(
        0.5, "slower than this there is no stick-slip to name", unit="rad/s", low=0.0, high=10.0
    )
    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)


@dataclasses.dataclass(frozen=True)
class Summary:
    """
    One window in numbers; NaN where the window does not show a quantity.

    Attributes
    ----------
    duration : float
        Time between the first and the last sample, s.
    samples : int
        Samples used; those not finite are left out.
    rotary_speed, rotary_speed_least, rotary_speed_most : float
        Mean, least and largest of the smoothed rate about the tool axis, rad/s.
    stick_slip_index : float
        (most - least) / (2 mean) of the rotary speed: 0 steady, 1 just stops, above 1 turns back; NaN if not turning.
    stick_share : float
        Share of the time at less than a tenth of the mean speed; NaN when not rotating.
    axial_rms, lateral_rms : float
        Root mean square of the non-gravity acceleration along the axis and across it (both axes together), m/s^2.
    axial_peak, lateral_peak : float
        Largest magnitudes, m/s^2.
    shocks : int
        Separate excursions of the whole non-gravity acceleration beyond the threshold.
    shock_peak : float
        Largest whole non-gravity acceleration, m/s^2.
    """

    duration: float
    samples: int
    rotary_speed: float
    rotary_speed_least: float
    rotary_speed_most: float
    stick_slip_index: float
    stick_share: float
    axial_rms: float
    lateral_rms: float
    axial_peak: float
    lateral_peak: float
    shocks: int
    shock_peak: float


def summary(params: Params, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike, g_t: ArrayLike) -> Summary:
    """
    Dynamics of one window.

    Parameters
    ----------
    params : Params
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, in tool axes.
    g_t : array_like, shape (n, 3)
        Unit vector down in tool axes, as a gravity method gives it.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.asarray(stamp_ns, dtype=np.int64)
    gyro, accel, g = (np.asarray(block, dtype=float) for block in (gyro_t, accel_t, g_t))
    for name, block in (("gyro_t", gyro), ("accel_t", accel), ("g_t", g)):
        if block.shape != (*stamps.shape, 3) or stamps.ndim != 1:
            raise ValueError(f"{name}: expected shape ({stamps.size}, 3) beside stamps (n,), got {block.shape}")
    good = np.isfinite(gyro).all(axis=1) & np.isfinite(accel).all(axis=1) & np.isfinite(g).all(axis=1)
    stamps, gyro, accel, g = stamps[good], gyro[good], accel[good], g[good]
    if len(stamps) < 2:
        nan = math.nan
        return Summary(0.0, len(stamps), nan, nan, nan, nan, nan, nan, nan, nan, nan, 0, nan)
    seconds = 1e-9 * (stamps - stamps[0])
    speed = _mean_over(seconds, gyro[:, 0], params.speed_smoothing)
    mean, least, most = float(speed.mean()), float(speed.min()), float(speed.max())
    turns = abs(mean) >= params.least_speed
    # Force is acceleration less gravity (f = a - g down), so that what is not gravity is f + g.
    shake = accel + params.gravity * g
    lateral, whole = np.hypot(shake[:, 1], shake[:, 2]), np.linalg.norm(shake, axis=1)
    return Summary(
        duration=float(seconds[-1]),
        samples=len(stamps),
        rotary_speed=mean,
        rotary_speed_least=least,
        rotary_speed_most=most,
        stick_slip_index=(most - least) / (2.0 * abs(mean)) if turns else math.nan,
        stick_share=float(np.mean(speed * np.sign(mean) < 0.1 * abs(mean))) if turns else math.nan,
        axial_rms=float(np.sqrt(np.mean(shake[:, 0] ** 2))),
        lateral_rms=float(np.sqrt(np.mean(lateral**2))),
        axial_peak=float(np.abs(shake[:, 0]).max()),
        lateral_peak=float(lateral.max()),
        shocks=shock_count(seconds, whole, params.shock_threshold, params.shock_separation),
        shock_peak=float(whole.max()),
    )


def shock_count(seconds: Array, whole: Array, threshold: float, separation: float) -> int:
    """Excursions of `whole`, m/s^2, beyond the threshold; those at most `separation` seconds apart are one."""
    above = seconds[whole >= threshold]
    if len(above) == 0:
        return 0
    # A tick of slack: samples exactly the separation apart differ by rounding only.
    typical = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    return 1 + int(np.count_nonzero(np.diff(above) > max(separation, typical) + 1e-6))


def _mean_over(seconds: Array, values: Array, width: float) -> Array:
    """Running mean over about `width` seconds; the ends use what there is."""
    period = float(np.median(np.diff(seconds)))
    half = int(0.5 * width / period) if period > 0.0 else 0
    if half == 0:
        return values
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.asarray((total[last] - total[first]) / (last - first))

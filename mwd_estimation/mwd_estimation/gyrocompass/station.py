"""
Gyro azimuth of a station: north sought while the tool keeps still, and while it is turned to a second position there.

The seek runs on the precision unit's own samples, bin by bin, from the moment the string has settled. A quiet turn
about the axis goes into it, because the second position is what shows the gyro's bias; shaking, a turn that takes too
long or an axis that lies elsewhere end it. What it found of the instrument goes into the seek of the next station.
Whether what it found of north may be used, `north_seek.solution` says.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.time_bins import Bin
from mwd_estimation.gyrocompass import methods as north_methods
from mwd_estimation.gyrocompass import seek as north_seek
from mwd_estimation.gyrocompass.seek import Solution
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR
from mwd_sensors.core.settings import setting

_ACCEL_X = 3
# White noise where neither the settings nor the tool tell, deg/sqrt(h), and the least that is believed.
_TACTICAL_NOISE, _LEAST_NOISE = 0.05, 0.001
# Samples averaged for the noise that counts, and how much more single ones may show before they are not believed.
_AVERAGED, _SHAKEN = 10, 1.5
# Waiting helps while the noise alone makes this share of sigma: it also hides how well a bias fits the latitude.
_BY_NOISE = 0.1
# How often the seek is asked what it waits for: an answer costs as much as thousands of samples.
_ASK_AGAIN_S = 2.5
# Bins at rest that are looked at for it.
_REST_BINS = 8


@dataclasses.dataclass(frozen=True)
class GyroSettings:
    """The precision unit, one sigma each, and when north is sought with it; the figures are a tactical MEMS unit's."""

    method: str = setting(
        north_methods.SEEK,
        "seek: still or in two positions, biases learnt; s1: the paper's filter, still and with a small bias only",
        choices=(north_methods.SEEK, north_methods.S1),
    )
    latitude_source: str = setting(
        "reference",
        "Latitude: of the reference's place where it is a model's; as set below; or unknown, and no gyro azimuth",
        choices=("reference", "fixed", "unknown"),
    )
    latitude_deg: float = setting(0.0, "Latitude where fixed, north positive", unit="deg", low=-90.0, high=90.0)
    noise_deg_rth: float = setting(
        0.0, "White noise; 0: as the tool at rest shows it", unit="deg/sqrt(h)", low=0.0, high=10.0
    )
    bias_deg_h: float = setting(5.0, "Bias not known to better than", unit="deg/h", low=0.0, high=1e5)
    bias_scale: str = setting(
        "at_most",
        "stated: the bias is drawn with that sigma; at_most: with that or less, as the fit to the latitude shows",
        choices=("stated", "at_most"),
    )
    walk_deg_h_rth: float = setting(0.3, "Random walk of the bias, warming up too", unit="deg/h", low=0.0, high=1e4)
    scale_x_ppm: float = setting(500.0, "Scale of the x gyro not known to better than", unit="ppm", low=0.0, high=1e5)
    leak_urad: float = setting(300.0, "x rate that y and z feel", unit="urad", low=0.0, high=1e5)
    g_sensitivity_deg_h_g: float = setting(
        0.5, "g-sensitivity of y and z, each to each", unit="deg/h/g", low=0.0, high=1e3
    )
    g_calibration_deg_h_g: tuple[float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0), "Calibrated g-sensitivity: along, across, stretch, shear", unit="deg/h/g"
    )
    range_dps: float = setting(100.0, "y and z clip at", unit="deg/s", low=1.0, high=5000.0)
    accel_noise_ug_rthz: float = setting(30.0, "Accelerometer white noise", unit="ug/sqrt(Hz)", low=0.01, high=1e4)
    accel_bias_ug: float = setting(200.0, "Accelerometer bias", unit="ug", low=0.0, high=1e5)
    shortest_s: float = setting(30.0, "No azimuth before", unit="s", low=1.0, high=3600.0)
    worst_sigma_deg: float = setting(20.0, "An azimuth less certain is refused", unit="deg", low=0.1, high=90.0)
    enough_sigma_deg: float = setting(
        0.7, "An azimuth as certain as this is not waited for any longer", unit="deg", low=0.01, high=90.0
    )
    longest_turn_s: float = setting(30.0, "A longer turn ends the seek", unit="s", low=0.0, high=600.0)
    max_shake: float = setting(
        0.25, "Standard deviation of the axial force above which a turn is no quiet one", unit="m/s^2", low=1e-3
    )
    max_axis_step: float = setting(
        0.03, "Change of the axial force above which the axis lies elsewhere", unit="m/s^2", low=1e-4, high=10.0
    )


def params_of(
    settings: GyroSettings, latitude_deg: float, gravity: float | None, noise_deg_rth: float | None = None
) -> north_seek.Params:
    """
    Settings of the seek; all three gyros are the precision unit's.

    noise_deg_rth: as the tool shows it, deg/sqrt(h), for settings that leave it open.
    """
    noise = settings.noise_deg_rth or noise_deg_rth or _TACTICAL_NOISE
    params = north_seek.Params(
        latitude_deg=latitude_deg,
        shortest=settings.shortest_s,
        worst_sigma_deg=settings.worst_sigma_deg,
        gyro_noise_deg_rth=noise,
        gyro_x_noise_deg_rth=noise,
        accel_noise_ug_rthz=settings.accel_noise_ug_rthz,
        gyro_bias_deg_h=settings.bias_deg_h,
        gyro_x_bias_deg_h=settings.bias_deg_h,
        bias_scale=settings.bias_scale,
        accel_bias_ug=settings.accel_bias_ug,
        gyro_walk_deg_h_rth=settings.walk_deg_h_rth,
        scale_x_ppm=settings.scale_x_ppm,
        leak_urad=settings.leak_urad,
        g_sensitivity_deg_h_g=settings.g_sensitivity_deg_h_g,
        g_calibration_deg_h_g=settings.g_calibration_deg_h_g,
        gyro_range_dps=settings.range_dps,
    )
    return params if gravity is None else dataclasses.replace(params, gravity=gravity)


def white_noise(stamp_ns: Stamps, gyro_t: Array) -> float | None:
    """
    White noise of the y and z gyros of a tool at rest, deg/sqrt(h); None where there are too few samples to tell.

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


class GyroStation:
    """
    The seek of one tool, in order of its bins.

    Parameters
    ----------
    settings : GyroSettings
    latitude_deg : float or None
        None: unknown, and nothing is sought.
    gravity : float or None
        Local, m/s^2.
    """

    def __init__(self, settings: GyroSettings, latitude_deg: float | None, gravity: float | None) -> None:
        self.settings = settings
        self.params = None if latitude_deg is None else params_of(settings, latitude_deg, gravity)
        self.heard = False
        self._refusal = ""
        self._gravity = gravity
        self._seek: north_methods.Seeker | None = None
        self._axis = math.nan
        self._turned_s = 0.0
        # The seek as it was in the last still bin, and the last sample heard: what is carried on.
        self._found: tuple[north_seek.State, int] | None = None
        self._last_ns: int | None = None
        self._rest: list[tuple[Stamps, Array]] = []
        # Time of the seek, s, at which it was asked what it waits for, and its answer.
        self._waited = (-math.inf, "")

    def refuse(self, reason: str, forget: bool) -> None:
        """
        Give no azimuth from now on, with this reason; empty: as before.

        forget : what the unit has told so far was wrong already, and what it tells meanwhile is not to be added.
        """
        self._refusal = reason
        if forget:
            self._seek = self._found = None
            self._rest = []

    def add(self, imu: Bin, bin_s: float, settled: bool, still: bool, samples: tuple[Stamps, Array]) -> None:
        """
        Take one bin.

        Parameters
        ----------
        imu : Bin
            Rates and forces of the conventional unit.
        bin_s : float
            Its length, s.
        settled, still : bool
            Whether the string has settled, and whether the tool keeps still in this bin.
        samples : tuple of ndarray, shapes (n,) and (n, 6)
            Stamps, ns, and rates, rad/s, and forces, m/s^2, of the precision unit in this bin.
        """
        stamps, values = samples
        self.heard = self.heard or len(stamps) > 0
        if self.params is None:
            return
        if len(stamps):
            if self._last_ns is not None and stamps[0] - self._last_ns > self.params.gap * 1e9:
                # Switched off meanwhile, for all that is known: another bias, another everything.
                self._seek = self._found = None
            self._last_ns = int(stamps[-1])
        if self._seek is not None and not self._goes_on(self._seek, imu, bin_s, still):
            self._seek = None
        if self._seek is None:
            # What the tool shows while the string settles tells its noise.
            self._rest = [*self._rest, (stamps, values)][-_REST_BINS:] if still else []
            if still and settled:
                self._seek = self._begun(self.params, int(stamps[0]) if len(stamps) else None)
                self._axis, self._turned_s = float(imu.mean[_ACCEL_X]), 0.0
        if self._seek is not None and len(stamps):
            self._seek.run(stamps, values)
            if still and isinstance(self._seek, north_methods.BestSeek) and self._seek.elapsed >= self.params.shortest:
                self._found = self._seek.state.copy(), int(stamps[-1])

    def _begun(self, params: north_seek.Params, first_ns: int | None) -> north_methods.Seeker:
        self._waited = (-math.inf, "")
        noise = white_noise(
            np.concatenate([stamps for stamps, _ in self._rest]),
            np.concatenate([values[:, :3] for _, values in self._rest]),
        )
        self.params = params_of(self.settings, params.latitude_deg, self._gravity, noise)
        if self.settings.method == north_methods.S1:
            return north_methods.S1Seek(self.params)
        if self._found is None or first_ns is None:
            return north_methods.BestSeek(self.params)
        state, last_ns = self._found
        return north_methods.BestSeek(self.params, (state, (first_ns - last_ns) * 1e-9))

    def _goes_on(self, seek: north_methods.Seeker, imu: Bin, bin_s: float, still: bool) -> bool:
        if still:
            return not seek.moved and abs(imu.mean[_ACCEL_X] - self._axis) <= self.settings.max_axis_step
        self._turned_s += bin_s
        shake = math.sqrt(imu.scatter[_ACCEL_X, _ACCEL_X] / max(imu.count - 1, 1))
        away = abs(imu.mean[_ACCEL_X] - self._axis)
        quiet = shake <= self.settings.max_shake and away <= self.settings.max_shake
        return seek.turns and quiet and self._turned_s <= self.settings.longest_turn_s

    def solution(self) -> Solution | str | None:
        """What was found so far, or in words why nothing is sought; None where there is no precision unit."""
        if not self.heard:
            return None
        if self._refusal:
            return self._refusal
        if self.params is None:
            return "the latitude is not known: set gyro.latitude_source, or a reference by place"
        if self._seek is None:
            return "the tool has not kept still"
        return self._seek.solution()

    def pending(self) -> str:
        """
        What the gyro still waits for while the tool keeps still, in words; empty where waiting brings nothing more.

        An automatic survey that is taken before then has no gyro azimuth, or one that gets better by waiting.
        """
        if not self.heard or self.params is None or self._seek is None or self._refusal:
            return ""
        if abs(self.params.latitude_deg) > 85.0:
            return ""
        elapsed = self._seek.elapsed
        if elapsed < self.params.shortest:
            return f"gyro azimuth: too short, {elapsed:.0f} s of {self.params.shortest:.0f} s"
        if elapsed >= self._waited[0] + _ASK_AGAIN_S:
            self._waited = elapsed, self._still_better(self._seek.solution())
        return self._waited[1]

    def _still_better(self, found: Solution) -> str:
        enough = math.radians(self.settings.enough_sigma_deg)
        if math.isfinite(found.sigma) and found.sigma > enough and found.limit > _BY_NOISE * found.sigma:
            return f"gyro azimuth good to {math.degrees(found.sigma):.1f} deg after {found.elapsed:.0f} s"
        return ""

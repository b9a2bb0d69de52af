# SPDX-License-Identifier: Apache-2.0
"""
Parameters, error order and records of the compiled north-seeking filter, in SI.

`mwd_estimation.gyrocompass.seek_filter` changes the records.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mwd_estimation.core import track
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of


class SeekErrors(NamedTuple):
    """
    Index of the first entry of each quantity in the error state (true minus estimate), and SIZE, the number of entries.

    ATTITUDE is about the axes of the level frame, rad. Each other quantity has as many entries as in `SeekState`, in
    the same units: VELOCITY along the two horizontal axes of the level frame, EARTH_RATE along all three axes, LEAK for
    the y and z gyros.
    """

    ATTITUDE: int = 0
    VELOCITY: int = 3
    EARTH_RATE: int = 5
    GYRO_BIAS: int = 8
    SCALE_X: int = 11
    LEAK: int = 12
    G_SENSITIVITY: int = 14
    LAG: int = 18
    FORCE_BIAS: int = 19
    AXIS: int = 22
    ROLL: int = 24
    WOBBLE: int = 25
    LEAD: int = 33
    BIAS_RAMP: int = 34
    SIZE: int = 37


Error = SeekErrors()


class SeekPhase(enum.IntEnum):
    """Phase of a seek: averaging the force, measuring the scatter of the hole axis, seeking."""

    LEVELLING = 0
    SETTLING = 1
    SEEKING = 2


class KernelParams(NamedTuple):
    """Parameters of `SeekParams` in SI; errors are 1 sigma unless the comment says "not a sigma"."""

    horizontal: float  #: horizontal Earth rate, rad/s
    down: float  #: vertical Earth rate, rad/s
    gravity: float  #: normal gravity of the place, m/s^2; not a sigma
    coarse_seconds: float  #: duration of the mean that starts S1's filter, s
    gyro_noise: float  #: white noise of the y and z gyros, rad/s/sqrt(Hz)
    gyro_x_noise: float  #: white noise of the x gyro, rad/s/sqrt(Hz)
    accel_noise: float  #: white noise of the accelerometers, m/s^2/sqrt(Hz)
    gyro_bias: float  #: bias of the y and z gyros, rad/s
    start_bias: tuple[float, float, float]  #: bias of x, y, z at the start of a seek, rad/s
    accel_bias: float  #: bias of the accelerometers, m/s^2
    accel_scale: float  #: scale error of the accelerometers, as a share
    bias_walk: float  #: random walk of the gyro biases, rad/s/sqrt(s)
    bias_ramp: float  #: steady drift of the gyro biases, rad/s^2
    scale_x: float  #: scale error of the x gyro, as a share
    leak: float  #: share of the x rate that y and z read
    g_sensitivity: float  #: g-sensitivity that calibration leaves: along, across, stretch and shear, rad/s per m/s^2
    #: g-sensitivity found by calibration, in the order and unit of `g_sensitivity`; not a sigma.
    g_calibration: tuple[float, float, float, float]
    lag: float  #: delay of the y and z gyros relative to the x gyro, s; not a sigma
    lag_sigma: float  #: 1 sigma of `lag`, s
    lead: float  #: time by which the accelerometer precedes the x gyro, s; not a sigma
    lead_sigma: float  #: 1 sigma of `lead`, s
    gyro_range: float  #: rate above which a sample counts as clipped, rad/s


class SeekSums:
    """Integrals over one block, from which `seek_filter.transition` is computed."""

    #: `time`, `turn`: duration, s, and rotation about the tool axis, rad.
    time: float
    turn: float
    #: `lost_turn`, `lost_velocity`: variance that clipped samples add to attitude, rad^2, and velocity, (m/s)^2.
    lost_turn: float
    lost_velocity: float
    mat: Annotated[Array, 3, 3]  #: integral of the rotation matrix from tool to level axes, s
    force: Annotated[Array, 3]  #: integral of the specific force in the level frame, m/s
    #: `bias`, `leak`, `g_sensitivity`, `scale`, `lag`, `lead`: integrals of the columns by which each of these errors
    #: changes the attitude (lead: the velocity).
    bias: Annotated[Array, 3, 2]
    scale: Annotated[Array, 3]
    leak: Annotated[Array, 3, 2]
    g_sensitivity: Annotated[Array, 3, 4]
    lag: Annotated[Array, 3]
    lead: Annotated[Array, 2]


class SeekState:
    """State of the filter of a north seek (`seek_filter`)."""

    clock: track.TrackClock  #: clock for `mwd_estimation.core.track.admit`
    mat: Annotated[Array, 3, 3]  #: rotation matrix from tool to level axes
    #: `velocity`, `earth_rate`: shapes (2,) and (3,); horizontal velocity, m/s, and Earth rate, rad/s, in the level
    #: frame, whose third axis points down.
    velocity: Annotated[Array, 2]
    earth_rate: Annotated[Array, 3]
    #: `gyro_bias`, `scale_x`, `leak`, `g_sensitivity`, `lag`, `force_bias`, `lead`, `bias_ramp`: errors of the
    #: instrument, in the units of `KernelParams`.
    gyro_bias: Annotated[Array, 3]
    scale_x: float
    leak: Annotated[Array, 2]
    g_sensitivity: Annotated[Array, 4]
    lag: float
    force_bias: Annotated[Array, 3]
    #: `axis`, `roll`, `wobble`: shape (2,), float, shape (8,); hole axis and roll relative to their references, and
    #: motion of the axis once and twice per turn, rad.
    axis: Annotated[Array, 2]
    roll: float
    wobble: Annotated[Array, 8]
    lead: float
    bias_ramp: Annotated[Array, 3]
    P: Annotated[Array, 37, 37]  #: covariance of the error, in the order of `Error`
    sums: SeekSums  #: sums of the current block
    #: `phase`, `settled`, `seen`: value of `SeekPhase`; number of blocks while settling, and number of blocks while
    #: seeking.
    phase: int
    settled: int
    seen: int
    #: `level_time`, `elapsed`, `still_time`, `turn_time`: time of levelling; time of seeking in total, at rest,
    #: rotating; s.
    level_time: float
    elapsed: float
    still_time: float
    turn_time: float
    #: `down_force`, `down_axes`: integrals while seeking of the measured downward force, m/s, and of the downward
    #: components of the tool axes, shape (3,), s.
    down_force: float
    down_axes: Annotated[Array, 3]
    #: `axis_reference`, `roll_reference`: shape (3,); reference directions of hole axis and tool z in the level frame,
    #: for `axis` and `roll`.
    axis_reference: Annotated[Array, 3]
    roll_reference: Annotated[Array, 3]
    #: `last_axis`, `axis_difference2`: shapes (3,) and (2,); axis of the previous block, and sum of the squared changes
    #: of the axis from block to block while settling (to the high side and to the right side), rad^2.
    last_axis: Annotated[Array, 3]
    axis_difference2: Annotated[Array, 2]
    #: shape (3,); variance of high side and right side of the axis, and of roll, from block to block, rad^2.
    scatter: Annotated[Array, 3]
    first_scatter: Annotated[Array, 2]  #: scatter of the axis when the seek began, rad^2
    #: `still_run`, `positions`, `refused_blocks`, `moved`: number of blocks at rest in a row; of intervals at rest with
    #: a reference roll; of blocks in a row whose axis was ignored; and of detected moves of the axis.
    still_run: int
    positions: int
    refused_blocks: int
    moved: int
    #: `samples`, `clipped`: number of samples, and number of samples in which a gyro clipped.
    samples: int
    clipped: int

    if TYPE_CHECKING:

        def copy(self) -> SeekState:
            """Return an independent copy, as the method `copy` of a numpy record does."""
            ...


class SeekWork:
    """Scratch space of a block."""

    half: Annotated[Array, 3, 3]  #: rotation matrix from tool to level axes in the middle of a sample
    #: `down`, `forward`, `level`: vectors and matrix used for levelling.
    down: Annotated[Array, 3]
    forward: Annotated[Array, 3]
    level: Annotated[Array, 3, 3]
    #: `phi`, `rows`: shape (5, 37); rows of the transition that are not identity, and of its product with P.
    phi: Annotated[Array, 5, 37]
    rows: Annotated[Array, 5, 37]
    #: `error`, `h`, `ph`: shape (37,); error found so far in a block; row of a measurement, and its product with P.
    error: Annotated[Array, 37]
    h: Annotated[Array, 37]
    ph: Annotated[Array, 37]


STATE, WORK = dtype_of(SeekState), dtype_of(SeekWork)


def estimate(s: SeekState) -> Array:
    """Return the estimate in the order of `Error`, shape (37,); the entries of the attitude, a matrix, are zero."""
    instrument = (s.gyro_bias, s.scale_x, s.leak, s.g_sensitivity, s.lag, s.force_bias)
    return np.hstack(
        [np.zeros(3), s.velocity, s.earth_rate, *instrument, s.axis, s.roll, s.wobble, s.lead, s.bias_ramp]
    )


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
    # Each of along, across, stretch and shear is half the sum of two matrix elements, each with the stated sigma.
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


def white_noise(stamp_ns: Stamps, gyro_t: Array) -> float | None:
    """
    Return the white noise of the y and z gyros, deg/sqrt(h), or None for too few samples.

    stamp_ns, shape (n,), ns; gyro_t, shape (n, 3), rad/s. The noise is computed from second differences of neighbouring
    samples, which contain neither bias nor Earth rate nor a steady rotation. Pumps shake single samples, but not
    averages over tenths of a second; if the noise from single samples is clearly larger, the averages are used.
    """
    usable = np.isfinite(gyro_t).all(axis=1)
    stamps, rates = stamp_ns[usable], gyro_t[usable, 1:]
    if len(stamps) < 5 * _AVERAGED:
        return None
    step = float(np.median(np.diff(stamps))) * 1e-9
    if not step > 0.0:
        return None

    def density(values: Array, seconds: float) -> float:
        # The variance of a second difference of white noise is six times that of the noise.
        return math.sqrt(float(np.mean(np.diff(values, 2, axis=0) ** 2)) / 6.0 * seconds)

    whole = len(rates) // _AVERAGED
    means = rates[: whole * _AVERAGED].reshape(whole, _AVERAGED, 2).mean(axis=1)
    single, averaged = density(rates, step), density(means, _AVERAGED * step)
    found = averaged if single > _SHAKEN * averaged else single
    return max(found / DEG_PER_ROOT_HOUR, _LEAST_NOISE)

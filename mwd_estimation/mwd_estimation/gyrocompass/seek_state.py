# SPDX-License-Identifier: Apache-2.0
"""
Parameters, error order and records of the compiled north-seeking filter, in SI.

`mwd_estimation.gyrocompass.seek_filter` changes the records.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mwd_estimation.core import track
from mwd_sensors.core.arrays import Array
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
    """Parameters of `seek_params.SeekParams` in SI; errors are 1 sigma unless marked as a value (not a sigma)."""

    horizontal: float  #: horizontal Earth rate, rad/s
    down: float  #: vertical Earth rate, rad/s
    gravity: float  #: normal gravity of the place, m/s^2, a value
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
    #: Calibrated g-sensitivity, in the order and unit of `g_sensitivity`, a value.
    g_calibration: tuple[float, float, float, float]
    lag: float  #: delay of the y and z gyros relative to the x gyro, s, a value
    lag_sigma: float  #: 1 sigma of `lag`, s
    lead: float  #: time by which the accelerometer precedes the x gyro, s, a value
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
            """Return an independent copy, like every numpy record."""
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

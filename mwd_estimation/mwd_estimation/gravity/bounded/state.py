# SPDX-License-Identifier: Apache-2.0
"""
State of the bounded filter: the record that its kernels change, and the places of the errors in its covariance.

`Log` traces it for the smoother: a record for each update of the covariance.
"""

from __future__ import annotations

import copy
import dataclasses
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded.params import Params
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# Errors, true minus estimate: tilt about the level x and y axes; velocity and displacement in level axes (x, y, down);
# gyro bias in tool axes; scale of the x gyro; share of the x rate that the y and z gyros read; lever arm along y and z;
# vertical force; and while the x gyro clips the rate it misses and the slope of that rate.
TILT, VEL, POS, BIAS, SCALE, ASKEW, LEVER, DOWN, MISSING, SLOPE = 0, 2, 5, 8, 11, 12, 14, 16, 17, 18
STEADY, ERRORS = 17, 19  # number of errors that are always carried, and while the x gyro clips
DOWN_SIGMA = 0.05  # m/s^2, gravity's magnitude as the sensor shows it: the Earth's spread and a raw sensor's scale


class Sums:
    """Integrals over the samples since the last update."""

    time: float
    """s"""
    bias: Annotated[Array, 2, 3]
    """Level rows of C, s."""
    scale: Annotated[Array, 2]
    """Level components of the x rate, rad."""
    askew: Annotated[Array, 2, 2]
    """Level rows of C, y and z, times the x rate, rad."""
    force: Annotated[Array, 3]
    """Specific force in level axes, m/s."""
    velocity: Annotated[Array, 3]
    """Acceleration in level axes, m/s."""
    position: Annotated[Array, 3]
    """Integral of that, m."""
    turn: float
    """Variance that errors in proportion to the rates add to the tilt, rad^2."""
    jump: float
    """Variance that missing samples add to the velocity, (m/s)^2."""


class Motion:
    """What is followed of the motion since the last start."""

    force: Annotated[Array, 3]
    """Mean specific force of some seconds, level axes, m/s^2."""
    force_time: float
    """Time since that mean began, at a start or behind a data gap, s."""
    slow_acceleration: Annotated[Array, 3]
    """Low-passed acceleration, which the first high-pass takes out, m/s^2."""
    velocity: Annotated[Array, 3]
    """Behind two high-passes, m/s."""
    position: Annotated[Array, 3]
    """Displacement behind three high-passes, m."""
    arm: Annotated[Array, 3, 3]
    """Lever arm in level axes behind the same high-passes: what each of them takes out, m."""
    along: float
    """Mean square displacement along the hole, m^2."""
    across: float
    """Across it."""
    white: float
    """Part of them that white force explains, m^2."""
    folded_aside: float
    """Mean square displacement across the hole over a longer time, m^2."""
    folded: float
    """What white force would leave over that time, from differences of neighbours, m^2."""
    rough: float
    """Density of the force, were it white, from differences of neighbours, (m/s^2)^2 s."""


class Scale:
    """Covariance scale in one direction: corrections of the tilt against the variance expected of them."""

    low: Annotated[Array, 3, 2]
    """Corrections over their expected sigma, low-passed once, twice and three times by the filter's own time."""
    power: float
    """Their power by equation (8), 1 expected: the scale."""


class Innovations:
    """Innovations since the last start."""

    along: Scale
    """Along the hole: of inclination."""
    across: Scale
    """Across the hole: of toolface."""
    usual: float
    """Usual square of one innovation."""


class Clipping:
    """The x gyro beyond its range."""

    sign: float
    """Of the clipped rate; 0: not clipped."""
    time: float
    """s"""
    seen: bool
    """Whether it was so since the last start."""
    tilt: float
    """Variance of the tilt that changes inclination, set aside, rad^2."""
    slope: float
    """Low-passed slope of the x rate before, rad/s^2."""
    curve: float
    """Low-passed change of that, rad/s^3."""
    kept: Annotated[Array, MISSING - BIAS, MISSING - BIAS]
    """Covariance of the sensors' errors, set aside."""


class Record:
    """All that the kernels change."""

    q: Annotated[Array, 4]
    """Quaternion tool to level (x, y, z, w); the heading is arbitrary."""
    C: Annotated[Array, 3, 3]
    """The same as a matrix."""
    vel: Annotated[Array, 3]
    """Velocity of the sensor, level axes (x, y, down), m/s."""
    pos: Annotated[Array, 3]
    """Displacement of the sensor, m."""
    bias: Annotated[Array, 3]
    """Gyro bias, tool axes, rad/s."""
    scale: float
    """Scale error of the x gyro."""
    askew: Annotated[Array, 2]
    """Share of the x rate that the y and z gyros read."""
    lever: Annotated[Array, 2]
    """Sensor from the point that stays, y and z, m. Along the axis nothing shows it: a tool swings too little."""
    down: float
    """Error of the vertical force: gravity's magnitude and the accelerometers' scale, m/s^2."""
    missing: float
    """Rate that a clipping x gyro misses, rad/s."""
    slope: float
    """Slope of that, rad/s^2."""
    P: Annotated[Array, ERRORS, ERRORS]
    """Covariance of the errors."""
    correction: Annotated[Array, ERRORS]
    """Errors that the last update found."""
    work: Annotated[Array, ERRORS]
    """Covariance of the errors with the last measurement."""
    innovation: float
    """Last measurement less what was expected of it, m."""
    spread: float
    """Variance of that, m^2."""
    sums: Sums
    motion: Motion
    innovations: Innovations
    clipping: Clipping
    started: bool
    """Whether there is an attitude."""
    epoch: int
    """Number of starts and bridged gaps: no smoothing from one to the other."""
    age: float
    """Time since the start began, s."""
    settled: float
    """Time since the first attitude, s."""
    mean: Annotated[Array, 3]
    """Integral of the force in level axes while starting, m/s."""
    mean_power: float
    """Integral of its square."""
    kept_down: float
    """Cosine of the inclination that a new start of the roll keeps."""
    kept_tilt: float
    """Its variance, rad^2; 0: none is kept."""
    last_w: Annotated[Array, 3]
    """Rates of the last sample, rad/s."""
    last_f: Annotated[Array, 3]
    """Force of the last sample, m/s^2."""
    tick_w: Annotated[Array, 3]
    """Rates at the last update, rad/s."""
    period: float
    """Usual step of the stamps, s."""
    turning: float
    """Mean magnitude of the rate about the axis, rad/s."""
    slow_axis: Annotated[Array, 2]
    """Low-passed level direction of the tool axis."""
    rate_walk: Annotated[Array, 2]
    """Growth of the variance of the rates along and across the axis, (rad/s)^2/s."""
    power: float
    """Usual square of the acceleration, (m/s^2)^2."""
    since_shock: float
    """s"""
    shocks: float
    """Shocks of the last seconds, counted down exponentially."""
    g_t: Annotated[Array, 3]
    """Gravity that is published, unit vector down, tool axes."""
    sigma_inclination: float
    """Published, rad."""
    sigma_toolface: float
    """Published, rad."""


RECORD = dtype_of(Record)


@dataclasses.dataclass
class State:
    """All that changes: clock and motion common to all methods, and the record of the filter, shape (1,)."""

    clock: Any
    motion: Any
    record: Any

    def copy(self) -> State:
        """Return an independent copy."""
        return copy.deepcopy(self)


@compiled
def forget(p: Params, s: Record) -> None:
    """Set errors of the sensors to what is known of them at switch-on, and of all else nothing."""
    for j in range(ERRORS):
        for m in range(ERRORS):
            s.P[j, m] = 0.0
    for j in range(3):
        s.bias[j] = 0.0
        s.P[BIAS + j, BIAS + j] = p.bias_sigma**2
    for j in range(2):
        s.askew[j] = s.lever[j] = 0.0
        s.P[ASKEW + j, ASKEW + j] = p.misalignment_sigma**2
        s.P[LEVER + j, LEVER + j] = p.lever_sigma**2
    s.scale = s.down = 0.0
    s.P[SCALE, SCALE] = p.scale_sigma**2
    s.P[DOWN, DOWN] = DOWN_SIGMA**2


def initial(params: Params) -> State:
    """State before the first sample."""
    record = np.zeros(1, dtype=RECORD)
    s = record[0]
    s.g_t[:] = np.nan
    s.q[3] = 1.0
    s.C[:] = np.eye(3)
    forget(params, s)
    return State(np.zeros(1, track.CLOCK), np.zeros(1, track.MOTION), record)


class Update:
    """One update of the covariance."""

    sample: int
    """Sample of the block at which it was made."""
    epoch: int
    """Number of the start it belongs to; -1 while the x gyro clips."""
    sums: Sums
    measured: Annotated[Array, 3, STEADY]
    """Rows of the measurement matrix H, one for each tool axis."""
    gain: Annotated[Array, 3, STEADY]
    """Their gains."""
    innovation: Annotated[Array, 3]
    """Their innovations, m."""
    spread: Annotated[Array, 3]
    """Variances of the innovations, m^2."""
    correction: Annotated[Array, 2]
    """Tilt put into the attitude, rad."""
    tilt: Annotated[Array, 2, STEADY]
    """Covariance of the tilt with all errors after the measurements."""
    factors: Annotated[Array, 2]
    """Of the covariance, along the hole and across it."""
    floors: Annotated[Array, 2]
    """Variances to be added, rad^2."""


UPDATE = dtype_of(Update)


class Log(NamedTuple):
    """Trace of a block."""

    entries: NDArray[np.int64]  #: int64, shape (1,); updates written
    updates: Any  #: structured ndarray of `Update`, shape (m,); room for them; none: no trace is kept
    north_t: Array  #: shape (n, 3); first level axis in tool axes, sample by sample

    @classmethod
    def room(cls, samples: int) -> Log:
        """Room for a block of so many samples, each of which may end in an update."""
        return cls(np.zeros(1, dtype=np.int64), np.zeros(samples, dtype=UPDATE), np.zeros((samples, 3)))

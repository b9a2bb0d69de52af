# SPDX-License-Identifier: Apache-2.0
"""
State of the bounded filter: the record that its kernels change, and the order of the errors in its covariance.

`Log` is the trace for the smoother: one record for each update of the covariance.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import MutableSequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import track
from mwd_estimation.core.ring import Ring
from mwd_estimation.gravity.bounded.params import BoundedParams, as_record
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# First index of each error (true minus estimate): tilt about level x and y, rad; velocity and displacement in level
# axes (x, y, down); gyro bias in tool axes; scale of the x gyro; share of the x rate that the y and z gyros read; lever
# arm along y and z; vertical force; and, while the x gyro clips, the missing part of its rate, and the slope of this
# part.
TILT, VEL, POS, BIAS, SCALE, ASKEW, LEVER, DOWN, MISSING, SLOPE = 0, 2, 5, 8, 11, 12, 14, 16, 17, 18
# Number of errors of the accelerometers: for each axis, the bias and a row of the matrix of scale and misalignment.
ACCEL = 12
STEADY, ERRORS = 17, 19  # number of errors in use at all times, and number of all errors (while the x gyro clips)
TURNS = 2048  # number of samples whose rotation is kept: 0.4 s at 5 kHz, longer than a magnetic sample waits
RECENT = 100  # number of updates kept: 3 s, within which a step of the gyro bias becomes visible
STATED = 7.0  # logarithm of the odds that samples are integrated if the settings state so: 1100 to 1
# 1 sigma of the difference of measured from local gravity, m/s^2: spread on Earth, scale of an uncalibrated sensor.
DOWN_SIGMA = 0.05


class UpdateSums:
    """Integrals over the samples since the last update."""

    time: float  #: duration, s
    bias: Annotated[Array, 2, 3]  #: integral of the level rows of C, s
    scale: Annotated[Array, 2]  #: integral of the level components of the x rate, rad
    askew: Annotated[Array, 2, 2]  #: integral of the level rows of C (columns y and z) times the x rate, rad
    force: Annotated[Array, 3]  #: integral of the specific force in level axes, m/s
    velocity: Annotated[Array, 3]  #: integral of the acceleration in level axes, m/s
    position: Annotated[Array, 3]  #: integral of `velocity`, m
    turn: float  #: variance added to the tilt by errors proportional to the rates, rad^2
    jump: float  #: variance added to the velocity by missing samples, (m/s)^2


class MotionAverages:
    """Averages of the motion since the last start."""

    force: Annotated[Array, 3]  #: mean specific force over some seconds, level axes, m/s^2
    force_time: float  #: time since the average of `force` began, at a start or after a data gap, s
    lost_time: float  #: time for which `force` has contradicted the attitude without a break, s
    slow_acceleration: Annotated[Array, 3]  #: low-passed acceleration, which the first high-pass removes, m/s^2
    velocity: Annotated[Array, 3]  #: velocity after two high-passes, m/s
    position: Annotated[Array, 3]  #: displacement after three high-passes, m
    #: Low-passed part of the lever arm in level axes that each of the three high-passes removes, m.
    arm: Annotated[Array, 3, 3]
    along: float  #: mean square displacement along the hole, m^2
    across: float  #: mean square displacement across the hole, m^2
    white: float  #: part of `along` and of `across` that white force explains, m^2
    folded_aside: float  #: mean square displacement across the hole over a longer time, m^2
    #: Mean square displacement that white force of density `rough` causes, averaged like `folded_aside`, m^2.
    folded: float
    #: Spectral density of the force, assumed white, from differences of neighbouring samples, (m/s^2)^2 s.
    rough: float
    swing: Annotated[Array, 3]  #: sum of the x rates of point samples after one, two and three high-passes, rad
    #: Mean square of the last element of `swing`: of the part of the roll that aliasing may have caused, rad^2.
    ripple: float
    #: Low-passed part of the rates of point samples that each of three high-passes removes, rad/s.
    quick: Annotated[Array, 3, 3]
    fast: Annotated[Array, 3]  #: mean square of the fast part of the rates of point samples, (rad/s)^2
    slow: Annotated[Array, 3, 2]  #: rates of point samples, low-passed over a short and over a long time, rad/s
    fast_force: float  #: mean square of the fast part of the force in point samples, (m/s^2)^2
    #: Acceleration in point samples, low-passed over a short and over a long time, level axes, m/s^2.
    slow_force: Annotated[Array, 3, 2]
    rocked: Annotated[Array, 2, 2]  #: covariance of the tilt (level x, y) from aliased rocking, rad^2


class CovarianceScale:
    """Covariance scale in one direction: tilt corrections compared with their expected variance."""

    #: Corrections over their expected sigma, low-passed one to three times with the filter's own time constant.
    low: Annotated[Array, 3, 2]
    power: float  #: power of the corrections by equation (8); it is the scale, and its expected value is 1
    moved: Annotated[Array, 2]  #: sum of the corrections about level x and y, with the memory of the filter, rad
    expected: float  #: variance of `moved` in the direction of the scale if the covariance is right, rad^2
    event: float  #: variance of the tilt by which recent corrections exceed chance, equation (20), rad^2


class Innovations:
    """Statistics of the innovations since the last start."""

    along: CovarianceScale  #: scale along the hole, for inclination
    across: CovarianceScale  #: scale across the hole, for toolface
    usual: float  #: running mean of the squared innovation over its variance
    slow: Annotated[Array, 3]  #: low-passed ratio of innovation to sigma, for each tool axis
    #: Spectral density of the innovations at low frequencies, for each tool axis; 1 if they have the expected size.
    density: Annotated[Array, 3]


class Clipping:
    """State while the x gyro is at the end of its range."""

    sign: float  #: sign of the clipped rate; 0 if it is not clipped
    time: float  #: duration of clipping, s
    seen: bool  #: whether a rotation about the axis was lost since the last start, by clipping or by missing samples
    tilt: float  #: variance of the tilt that changes inclination, set aside during clipping, rad^2
    slope: float  #: low-passed slope of the x rate before clipping, rad/s^2
    curve: float  #: low-passed rate of change of `slope`, rad/s^3
    scale: float  #: scale of the variance of the roll from the last innovations during clipping; 0 without clipping
    lost: bool  #: whether the roll was lost during this clipping; then its sigma is pi
    #: Covariance of the sensor errors, set aside during clipping.
    kept: Annotated[Array, MISSING - BIAS, MISSING - BIAS]


class Turn:
    """Rotation about the axis at one sample."""

    stamp_ns: int  #: stamp of the sample, ns
    turn: float  #: value of `BoundedRecord.turn` at the sample, rad


class AccelerometerErrors:
    """Influence of the errors of the accelerometers on the level frame (`accelerometer_errors`)."""

    #: Change of the mean force along level x and y per unit of each of the ACCEL errors; m/s^2 (1 for biases).
    influence: Annotated[Array, 2, ACCEL]
    age: float  #: time over which the influence was averaged, s


class TurnRing(Ring):
    """Ring buffer of the rotation about the axis at the last samples."""

    rows: Annotated[MutableSequence[Turn], TURNS]


class Field:
    """State of the estimate of the roll from the magnetic field."""

    turns: TurnRing  #: rotation about the axis at the last samples
    stamp_ns: int  #: stamp of the newest magnetic sample that may be used, ns
    b_t: Annotated[Array, 3]  #: field of the newest magnetic sample that may be used, in tool axes, T
    last_ns: int  #: stamp of the last magnetic sample that was compared with the roll, ns
    since_ns: int  #: stamp from which the rotation about the axis is known without a break, ns
    used: int  #: number of magnetic samples of the last block that were used
    angle: float  #: angle from the field to gravity across the axis, rad
    variance: float  #: variance of `angle`, rad^2; 0 if the angle is unknown
    strength: float  #: mean strength of the field across the axis, T


class Meaning:
    """Kind of the samples: values at an instant, means or integrals over the interval (`sample_meaning`)."""

    sampled: bool  #: whether rates are values at an instant; they are integrated by the trapezoid
    coning: float  #: share of the coning term, see `BoundedParams.coning`
    #: Present errors of the state if the samples are points while integrated samples are assumed.
    effect: Annotated[Array, STEADY, 1]
    odds: float  #: natural logarithm of the odds of points against integrated samples
    changed: bool  #: whether the data have changed the kind of the samples stated in the settings


class Update:
    """Trace of one update of the covariance, for the smoother and for the search for a jump (`jumps`)."""

    sample: int  #: index of the sample at which the update was made
    epoch: int  #: epoch of the update (`BoundedRecord.epoch`); -1 while the x gyro clips
    sums: UpdateSums  #: sums over the interval that ends with the update
    measured: Annotated[Array, 3, STEADY]  #: rows of the measurement matrix H, one for each tool axis
    gain: Annotated[Array, 3, STEADY]  #: gains of the three measurements
    innovation: Annotated[Array, 3]  #: innovations of the three measurements, m
    spread: Annotated[Array, 3]  #: variances of the innovations, m^2
    #: Variances of the innovations times their density (`Innovations.density`), m^2; scratch space of `jumps`.
    evidence: Annotated[Array, 3]
    correction: Annotated[Array, 2]  #: tilt applied to the attitude, rad
    tilt: Annotated[Array, 2, STEADY]  #: covariance of the tilt with all errors after the measurements
    factors: Annotated[Array, 2]  #: factors on the tilt variance, along and across the hole
    floors: Annotated[Array, 2]  #: variances that are added to the tilt, along and across the hole, rad^2


class LaterInformation:
    """Information of later measurements about the errors at an earlier time (`information`)."""

    #: Information matrix, and the information vector in the last column.
    matrix: Annotated[Array, STEADY, STEADY + 1]
    #: `transposed`, `row`: scratch space.
    transposed: Annotated[Array, STEADY, STEADY + 1]
    row: Annotated[Array, STEADY + 1]


class JumpSize:
    """Estimate of the size of a jump in prior sigmas, in up to three directions (`jumps`)."""

    known: Annotated[Array, 3, 3]  #: information matrix of the size, with the prior
    vector: Annotated[Array, 3]  #: information vector of the size
    estimate: Annotated[Array, 3]  #: estimated size
    covariance: Annotated[Array, 3, 3]  #: covariance of the estimate


class RecentUpdates(Ring):
    """Ring buffer of the last updates."""

    rows: Annotated[MutableSequence[Update], RECENT]


class BoundedRecord:
    """State of the bounded filter, which the kernels change."""

    q: Annotated[Array, 4]  #: quaternion from tool to level axes (x, y, z, w); the heading is arbitrary
    C: Annotated[Array, 3, 3]  #: rotation matrix from tool to level axes
    vel: Annotated[Array, 3]  #: velocity of the sensor, level axes (x, y, down), m/s
    pos: Annotated[Array, 3]  #: displacement of the sensor, level axes, m
    bias: Annotated[Array, 3]  #: gyro bias, tool axes, rad/s
    scale: float  #: scale error of the x gyro
    askew: Annotated[Array, 2]  #: share of the x rate that the y and z gyros read
    #: Position of the sensor relative to the point that moves least, y and z, m. The axial part is not observable.
    lever: Annotated[Array, 2]
    #: Error of the vertical force, from the magnitude of gravity and the scale of the accelerometers, m/s^2.
    down: float
    missing: float  #: part of the x rate that a clipping gyro does not measure, rad/s
    slope: float  #: slope of the missing rate, rad/s^2
    P: Annotated[Array, ERRORS, ERRORS]  #: covariance of the errors
    correction: Annotated[Array, ERRORS]  #: errors found by the last update
    #: Covariances of the errors with the measurements along the three tool axes, H P; scratch space of an update.
    work: Annotated[Array, 3, ERRORS]
    #: Share of an innovation along an earlier tool axis that adds to the displacement along a later axis; on the
    #: diagonal the inverses of the variances of the innovations.
    share: Annotated[Array, 3, 3]
    white: Annotated[Array, 3]  #: innovations of the last three measurements over their sigmas
    latest: Update  #: trace of the latest update
    sums: UpdateSums
    motion: MotionAverages
    innovations: Innovations
    clipping: Clipping
    field: Field
    meaning: Meaning
    accelerometer: AccelerometerErrors
    recent: RecentUpdates
    later: LaterInformation  #: scratch space of `jumps`
    jump: JumpSize  #: scratch space of `jumps`
    #: Sum over the tool axes of the squared low-passed innovation over its usual square; about 3 without a jump.
    surprise: float
    #: Covariance of the tilt (level x, y) from jumps that are possible but not certain (`jumps`), rad^2.
    doubt: Annotated[Array, 2, 2]
    #: Variance of each gyro bias after its steps were found, in addition to the variance at switch-on, (rad/s)^2.
    stepped: Annotated[Array, 3]
    gyro_step: float  #: time since a step of the gyro bias that the last update has revealed, s; 0 if there was none
    turn: float  #: rotation about the axis since the first sample, rad
    started: bool  #: whether the filter has an attitude
    epoch: int  #: number of starts and bridged gaps; the smoother does not smooth across a change of this number
    age: float  #: time since the start of averaging, s
    settled: float  #: time since the first attitude, s
    mean: Annotated[Array, 3]  #: integral of the force in level axes during a start, m/s
    mean_power: float  #: integral of the squared force during a start, (m/s^2)^2 s
    kept_down: float  #: cosine of the inclination that a restart of the roll keeps
    kept_tilt: float  #: variance of the kept inclination, rad^2; 0 if no inclination is kept
    last_w: Annotated[Array, 3]  #: rates of the last sample, rad/s
    last_f: Annotated[Array, 3]  #: force of the last sample, m/s^2
    tick_w: Annotated[Array, 3]  #: rates at the last update, rad/s
    period: float  #: usual step between stamps, s
    turning: float  #: mean magnitude of the rate about the axis, rad/s
    #: Low-passed horizontal components (level x, y) of the unit vector along the tool axis.
    slow_axis: Annotated[Array, 2]
    rate_walk: Annotated[Array, 2]  #: growth rate of the variance of the rates along and across the axis, (rad/s)^2/s
    power: float  #: usual square of the acceleration, (m/s^2)^2
    since_shock: float  #: time since the last shock, s
    shock_time: float  #: duration of the present shock, s; 0 if there is none
    shocks: float  #: number of recent shocks, decaying exponentially
    g_t: Annotated[Array, 3]  #: published gravity, unit vector down, tool axes
    sigma_inclination: float  #: published sigma of inclination, rad
    sigma_toolface: float  #: published sigma of toolface, rad


RECORD, UPDATE, INFORMATION = dtype_of(BoundedRecord), dtype_of(Update), dtype_of(LaterInformation)


@dataclasses.dataclass
class BoundedState:
    """State of the method: clock and motion common to all methods, and the record of the filter, shape (1,)."""

    clock: Any
    motion: Any
    record: Any

    @property
    def samples_are(self) -> str:
        """Kind of the samples ("points") that the filter detected if the settings state another; otherwise empty."""
        return "points" if self.record[0]["meaning"]["changed"] else ""

    def keep_meaning(self, other: BoundedState) -> None:
        """Copy the kind of the samples (points or integrated), and its odds, from another state."""
        meaning = self.record[0]["meaning"]
        for name in ("sampled", "coning", "odds", "changed"):
            meaning[name] = other.record[0]["meaning"][name]

    @property
    def field_used(self) -> int:
        """Number of magnetic samples of the last block that were used."""
        return int(self.record["field"]["used"][0])

    def copy(self) -> BoundedState:
        """Return an independent copy of the state."""
        return copy.deepcopy(self)


@compiled
def forget(p: BoundedParams, s: BoundedRecord) -> None:
    """Reset the sensor errors to their values and sigmas at switch-on; set all other elements of P to 0."""
    for j in range(ERRORS):
        for m in range(ERRORS):
            s.P[j, m] = 0.0
    for j in range(3):
        s.bias[j] = s.stepped[j] = 0.0
        s.P[BIAS + j, BIAS + j] = p.bias_sigma**2
    for j in range(2):
        s.askew[j] = s.lever[j] = 0.0
        s.P[ASKEW + j, ASKEW + j] = p.misalignment_sigma**2
        s.P[LEVER + j, LEVER + j] = p.lever_sigma**2
    s.scale = s.down = 0.0
    s.P[SCALE, SCALE] = p.scale_sigma**2
    s.P[DOWN, DOWN] = DOWN_SIGMA**2


@compiled
def forget_innovations(s: BoundedRecord) -> None:
    """Discard the last innovations and corrections, because the state was just corrected for the jump in them."""
    s.innovations.slow[:] = 0.0
    s.surprise = 0.0
    s.doubt[:] = 0.0
    s.recent.length = 0
    for found in (s.innovations.along, s.innovations.across):
        found.moved[:] = 0.0
        found.expected = 0.0


@compiled
def forget_density(s: BoundedRecord) -> None:
    """Reset the statistics of the innovations and `Meaning.effect`, because new errors were just added to P."""
    forget_innovations(s)
    s.innovations.density[:] = 1.0
    s.meaning.effect[:] = 0.0


def initial(params: BoundedParams) -> BoundedState:
    """Return the state before the first sample."""
    record = np.zeros(1, dtype=RECORD)
    _begin(as_record(params), record)
    return BoundedState(np.zeros(1, track.CLOCK), np.zeros(1, track.MOTION), record)


@compiled
def _begin(settings: Samples, records: Samples) -> None:
    """Set the values before the first sample that are not 0."""
    p: BoundedParams = settings[0]
    s: BoundedRecord = records[0]
    s.q[3] = 1.0
    for j in range(3):
        s.g_t[j], s.C[j, j] = math.nan, 1.0
    forget(p, s)
    s.meaning.sampled, s.meaning.coning, s.meaning.odds = p.sampled, p.coning, -STATED


class Log(NamedTuple):
    """Trace of the m updates of the covariance in a block of n samples, for the smoother."""

    entries: NDArray[np.int64]  #: int64, shape (1,); number of updates written
    updates: Any  #: structured ndarray of `Update`, shape (m,); if this array is empty, no trace is written
    north_t: Array  #: shape (n, 3); first level axis in tool axes at each sample

    @classmethod
    def room(cls, samples: int) -> Log:
        """Return an empty log for a block of this many samples, each of which may end in an update."""
        return cls(np.zeros(1, dtype=np.int64), np.zeros(samples, dtype=UPDATE), np.zeros((samples, 3)))

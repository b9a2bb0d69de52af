# SPDX-License-Identifier: Apache-2.0
"""
Attitude of every IMU sample from gravity and magnetic samples that are paired by time.

A magnetic sample is paired with gravity at the time at which it was measured, not at its arrival: the sample is used a
fixed `mag_lag_ns` after the stamp of its message, with gravity interpolated at its time. The result therefore does not
depend on the order in which two topics arrive, live and replayed results have the same bits, and a rotating tool loses
no accuracy. The azimuth of the hole axis hardly changes in that time. The magnetic toolface changes, so it is
propagated by the x gyro.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core import ring
from mwd_estimation.core.magnetic_geometry import raw_azimuth_sample
from mwd_estimation.core.ring import Ring
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

RING = 1024  # number of gravity samples kept for pairing: 0.2 s at 5 kHz


class TimeAlignmentParams(NamedTuple):
    """Settings of the time alignment."""

    mag_lag_ns: int = 20_000_000  #: delay after which a magnetic sample is paired with gravity, ns
    mag_timeout_ns: int = 2_000_000_000  #: age of the last magnetic sample above which the azimuth is NaN, ns
    #: Interval, ns, in which one magnetic sample is selected to update the interference filter and the azimuth.
    interval_ns: int = 200_000_000
    smoothing_s: float = 1.0  #: time constant of the smoothing of azimuth and magnetic toolface, s
    #: `vertical_enter`, `vertical_leave`: angle of the axis from the vertical below which azimuth and high side become
    #: undefined, and above which they are defined again, rad.
    vertical_enter: float = math.radians(3.0)
    vertical_leave: float = math.radians(4.0)
    latency_s: float = 0.0  #: age of a measurement at its stamp, s; the x gyro propagates both toolfaces over this time


class FieldModel(NamedTuple):
    """Interference, north and their sigmas for the evaluation of magnetic samples; they change only at surveys."""

    interference: tuple[float, float, float]  #: interference, which is subtracted from the field, tool axes, T
    #: `sigma_axial`, `sigma_cross`: 1 sigma of the remaining interference along and across the axis, T.
    sigma_axial: float
    sigma_cross: float
    north_correction: float = 0.0  #: added to the magnetic azimuth to give the named north, rad
    sigma_north: float = 0.0  #: 1 sigma of the north correction, rad


class GravityRing(Ring):
    """Ring buffer of the last samples with known gravity."""

    rows: Annotated[MutableSequence[Sample], RING]


class TimeAlignmentState:
    """State of the time alignment."""

    recent: GravityRing  #: last samples with known gravity
    last_ns: int  #: stamp of the last sample with known gravity, ns
    turn: float  #: rotation about the tool axis since the start, rad
    near_vertical: bool  #: whether the hole is near vertical, with hysteresis
    #: `have_mag`, `mag_ns`: whether a magnetic sample has been used, and the stamp of the last one used, ns.
    have_mag: bool
    mag_ns: int
    restart: bool  #: whether the next magnetic sample replaces the smoothed values
    last_interval: int  #: index of the interval in which a magnetic sample was last selected
    #: `azimuth_vector`, `toolface_vector`: smoothed cosine and sine of azimuth, and of magnetic toolface minus
    #: rotation.
    azimuth_vector: Annotated[Array, 2]
    toolface_vector: Annotated[Array, 2]
    #: `azimuth`, `toolface`: angles of `azimuth_vector` and `toolface_vector`, rad.
    azimuth: float
    toolface: float
    tilt: float  #: smoothed 1 sigma of the direction down, rad
    #: `total`, `dip`, `horizontal`, `vertical`: strength, T, dip, rad, horizontal and vertical field, T, of the last
    #: magnetic sample.
    total: float
    dip: float
    horizontal: float
    vertical: float


class AttitudeRow:
    """
    Attitude of a sample.

    Angles and sigmas are in rad; `azimuth` and `magnetic_toolface` are NaN with a sigma of pi if unknown. `total`, T,
    and `dip`, rad, belong to the last magnetic sample used, however old this sample is; they are NaN before the first
    magnetic sample. `status` has the bits NO_MAG and NEAR_VERTICAL of `Status`.
    """

    inclination: float
    azimuth: float
    gravity_toolface: float
    magnetic_toolface: float
    sigma_azimuth: float
    sigma_magnetic_toolface: float
    total: float
    dip: float
    status: np.uint32


class Pair:
    """A selected magnetic sample with gravity at its own stamp."""

    place: int  #: index of the IMU sample at which the magnetic sample was used, in the samples given to the kernel
    stamp_ns: int  #: stamp of the magnetic sample, ns
    #: `g_t`, `b_t`: unit vector down, and the measured field, T.
    g_t: Annotated[Array, 3]
    b_t: Annotated[Array, 3]
    sigma_tilt: float  #: 1 sigma of the direction down, rad
    #: `azimuth`, `sigma`: azimuth from the north of the field model, rad, and 1 sigma, rad.
    azimuth: float
    sigma: float


class MagBlock(NamedTuple):
    """
    Waiting magnetic samples in the order of their arrival.

    stamp_ns, sent_ns, shape (m,): times at which they were measured, and stamps of their messages, ns; b_t, shape
    (m, 3): field, T.
    """

    stamp_ns: Stamps
    b_t: Array
    sent_ns: Stamps


STATE, ATTITUDE_ROW, PAIR = dtype_of(TimeAlignmentState), dtype_of(AttitudeRow), dtype_of(Pair)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    state = np.zeros(1, dtype=STATE)
    state["last_interval"] = -1
    return state


_MAX_GAP = 0.5  # shortest data gap, s; the rotation is not integrated over a gap between samples
_NO_MAG, _NEAR_VERTICAL = int(Status.NO_MAG), int(Status.NEAR_VERTICAL)


def last_totals(state: Samples) -> tuple[float, float] | None:
    """Return total field, T, and dip, rad, of the last magnetic sample used, or None before the first."""
    s = state[0]
    return (float(s.total), float(s.dip)) if s.have_mag else None


def restart_smoothing(state: Samples) -> None:
    """Let the next magnetic sample replace the smoothed azimuth and toolface, because the field model has changed."""
    state["restart"] = True


def run(
    p: TimeAlignmentParams, state: Samples, model: FieldModel, samples: Samples, mag: MagBlock
) -> tuple[Samples, Samples, int]:
    """
    Compute the attitude of a block of samples.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State from `initial`, changed in place; the result does not depend on the cut into blocks.
    samples : ndarray of dtype `sample.SAMPLE`, shape (n,)
        Samples; `turn` is filled where gravity is known.

    Returns
    -------
    rows : ndarray of dtype ATTITUDE_ROW, shape (n,)
        Attitude of each sample.
    pairs : ndarray of dtype PAIR
        Selected magnetic samples, one for each interval of `interval_ns`.
    used : int
        Number of waiting magnetic samples used; the caller passes the remaining ones again with the next block.
    """
    rows = np.zeros(len(samples), dtype=ATTITUDE_ROW)
    pairs = np.zeros(len(mag.stamp_ns), dtype=PAIR)
    used, handed_on = _run(p, state, model, samples, mag, rows, pairs)
    return rows, pairs[:handed_on].copy(), used


@compiled
def _wrap(angle: float) -> float:
    if 0.0 <= angle < 2.0 * math.pi:
        return angle
    # The angle is usually one turn too low; adding a turn is exact and cheaper than `%`.
    angle = angle + 2.0 * math.pi if -2.0 * math.pi < angle < 0.0 else angle % (2.0 * math.pi)
    return 0.0 if angle >= 2.0 * math.pi else angle


@compiled
def _turn_at(s: TimeAlignmentState, at: int) -> float:
    """Return the rotation about the axis at a time, ns, in rad."""
    earlier, later, share = ring.around(s.recent, at)
    turn: float = (1.0 - share) * s.recent.rows[earlier].turn + share * s.recent.rows[later].turn
    return turn


@compiled
def _gravity_at(s: TimeAlignmentState, at: int, down: Array) -> tuple[float, float]:
    """
    Interpolate gravity at a time.

    at: time, ns; down, shape (3,): filled with the vector down, tool axes, not normalised. Returns the length of this
    vector, and the rotation about the tool axis at the time, rad.
    """
    earlier, later, share = ring.around(s.recent, at)
    first, second = s.recent.rows[earlier], s.recent.rows[later]
    turn = (1.0 - share) * first.turn + share * second.turn
    # Rotate both neighbours to the time before averaging them, because the string may turn fast.
    c_0, s_0 = math.cos(turn - first.turn), math.sin(turn - first.turn)
    c_1, s_1 = math.cos(turn - second.turn), math.sin(turn - second.turn)
    d_x = (1.0 - share) * first.down[0] + share * second.down[0]
    d_y = (1.0 - share) * (c_0 * first.down[1] + s_0 * first.down[2])
    d_y += share * (c_1 * second.down[1] + s_1 * second.down[2])
    d_z = (1.0 - share) * (c_0 * first.down[2] - s_0 * first.down[1])
    d_z += share * (c_1 * second.down[2] - s_1 * second.down[1])
    down[0], down[1], down[2] = d_x, d_y, d_z
    return math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z), turn


@compiled
def _take_mag(p: TimeAlignmentParams, s: TimeAlignmentState, model: FieldModel, at: int, pair: Pair) -> bool:
    """
    Pair one magnetic sample with gravity at its stamp, and update the smoothed azimuth and magnetic toolface.

    at: stamp, ns. `pair` contains the field and the sigma of the tilt; its vector down and azimuth are filled. Returns
    whether the sample is used; if field or gravity is zero or not finite, the state stays unchanged.
    """
    size, turn = _gravity_at(s, at, pair.g_t)
    off_x, off_y, off_z = model.interference
    b_x, b_y, b_z = pair.b_t[0] - off_x, pair.b_t[1] - off_y, pair.b_t[2] - off_z
    total = math.sqrt(b_x * b_x + b_y * b_y + b_z * b_z)
    if not (math.isfinite(total) and total > 0.0 and size > 0.0):
        return False
    for i in range(3):
        pair.g_t[i] /= size
    d_x, d_y, d_z = pair.g_t[0], pair.g_t[1], pair.g_t[2]
    pair.azimuth = raw_azimuth_sample(-d_x, -d_y, -d_z, b_x, b_y, b_z) + model.north_correction
    # Direction of the scribe line in the horizontal plane, from north and east = down x north.
    along = b_x * d_x + b_y * d_y + b_z * d_z
    north_x, north_y, north_z = b_x - along * d_x, b_y - along * d_y, b_z - along * d_z
    toolface = math.atan2(d_x * north_y - d_y * north_x, north_z) + model.north_correction
    toolface -= (1.0 if d_x > 0.0 else -1.0) * turn
    _smooth(p, s, at, pair, toolface)
    s.total, s.vertical = total, along
    s.horizontal = math.sqrt(max(total * total - along * along, 0.0))
    s.dip = math.atan2(along, s.horizontal)
    return True


@compiled
def _smooth(p: TimeAlignmentParams, s: TimeAlignmentState, at: int, pair: Pair, toolface: float) -> None:
    """
    Update the smoothed azimuth, toolface and tilt sigma with a pair.

    at: stamp, ns; toolface: magnetic toolface minus the rotation about the axis, rad.
    """
    gap = (at - s.mag_ns) * 1e-9
    whole = not s.have_mag or s.restart or p.smoothing_s <= 0.0 or gap <= 0.0 or gap > 10.0 * p.smoothing_s
    keep = 0.0 if whole else math.exp(-gap / p.smoothing_s)
    s.azimuth_vector[0] = keep * s.azimuth_vector[0] + (1.0 - keep) * math.cos(pair.azimuth)
    s.azimuth_vector[1] = keep * s.azimuth_vector[1] + (1.0 - keep) * math.sin(pair.azimuth)
    s.toolface_vector[0] = keep * s.toolface_vector[0] + (1.0 - keep) * math.cos(toolface)
    s.toolface_vector[1] = keep * s.toolface_vector[1] + (1.0 - keep) * math.sin(toolface)
    s.azimuth = _wrap(math.atan2(s.azimuth_vector[1], s.azimuth_vector[0]))
    s.toolface = math.atan2(s.toolface_vector[1], s.toolface_vector[0])
    s.tilt = keep * s.tilt + (1.0 - keep) * pair.sigma_tilt
    s.mag_ns, s.have_mag, s.restart = at, True, False


@compiled
def _sigma_azimuth(
    model: FieldModel, s: TimeAlignmentState, axial: float, sine: float, cosine: float, tilt: float
) -> float:
    """
    Return 1 sigma of a magnetic azimuth, rad, from interference, tilt (in the vertical field) and north correction.

    axial: horizontal component of the axial interference across magnetic north, 1 sigma, T; sine, cosine: sine and
    cosine of the inclination; tilt: 1 sigma of the direction down, rad.
    """
    if s.horizontal <= 0.0 or sine <= 0.0:
        return math.pi
    field = axial * axial + model.sigma_cross * model.sigma_cross
    turned = _turned(s, tilt) + tilt * tilt * (cosine * cosine / (sine * sine) + tilt * tilt)
    if turned >= 1.0:
        return math.pi
    variance = field / (s.horizontal * s.horizontal) + turned / (1.0 - turned)
    return min(math.sqrt(variance + model.sigma_north * model.sigma_north), math.pi)


@compiled
def _turned(s: TimeAlignmentState, tilt: float) -> float:
    """
    Return the variance, rad^2, of the rotation of the horizontal field that a tilt, rad, causes.

    The tilt also changes the measured vertical field, so that even a horizontal field is rotated, to second order. The
    callers use v / (1 - v) for a result v, because the tilt also changes the horizontal field, by which the rotation is
    divided.
    """
    slope = s.vertical / s.horizontal
    return tilt * tilt * (slope * slope + tilt * tilt)


@compiled
def _sigma_magnetic_toolface(model: FieldModel, s: TimeAlignmentState, tilt: float) -> float:
    """
    Return 1 sigma of the magnetic toolface, rad; tilt: 1 sigma of the direction down, rad.

    It contains the terms of `_sigma_azimuth` without axial interference and without the tilt term that grows towards
    the vertical.
    """
    turned = _turned(s, tilt) if s.horizontal > 0.0 else 1.0
    if turned >= 1.0:
        return math.pi
    field = model.sigma_cross / s.horizontal
    return min(math.sqrt(field * field + turned / (1.0 - turned) + model.sigma_north * model.sigma_north), math.pi)


@compiled
def _keep(s: TimeAlignmentState, sample: Sample) -> None:
    """Store a sample with known gravity if its stamp advances, and integrate the rotation about the axis."""
    step = (sample.stamp_ns - s.last_ns) * 1e-9
    if s.recent.length > 0 and step <= 0.0:
        return
    if s.recent.length > 0 and step < _MAX_GAP and math.isfinite(sample.rate_x):
        s.turn += sample.rate_x * step
    sample.turn, s.last_ns = s.turn, sample.stamp_ns
    s.recent.rows[ring.next_place(s.recent)] = sample


@compiled
def _hand_on(s: TimeAlignmentState, model: FieldModel, at: int, pair: Pair) -> None:
    """Set the last values of a pair of magnetic sample and gravity: its stamp `at`, ns, and 1 sigma of its azimuth."""
    cosine = pair.g_t[0]
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    axial = model.sigma_axial * sine * math.sin(pair.azimuth - model.north_correction)
    pair.stamp_ns = at
    pair.sigma = _sigma_azimuth(model, s, axial, sine, cosine, pair.sigma_tilt)


@compiled
def _follow_vertical(p: TimeAlignmentParams, s: TimeAlignmentState, inclination: float) -> None:
    from_vertical = min(inclination, math.pi - inclination)
    if not s.near_vertical and from_vertical < p.vertical_enter:
        s.near_vertical = True
    elif s.near_vertical and from_vertical > p.vertical_leave:
        s.near_vertical = False


@compiled
def _write(
    p: TimeAlignmentParams,
    s: TimeAlignmentState,
    model: FieldModel,
    sample: Sample,
    across_axis: float,
    row: AttitudeRow,
) -> None:
    """
    Write the attitude of one sample into its row.

    across_axis: 1 sigma of the axial interference, as its component across magnetic north in a horizontal hole, T.
    """
    row.total, row.dip = (s.total, s.dip) if s.have_mag else (math.nan, math.nan)
    row.azimuth = row.magnetic_toolface = math.nan
    row.sigma_azimuth = row.sigma_magnetic_toolface = math.pi
    d_x, d_y, d_z = sample.down[0], sample.down[1], sample.down[2]
    across = math.sqrt(d_y * d_y + d_z * d_z)
    size = math.sqrt(across * across + d_x * d_x)
    if not (math.isfinite(size) and size > 0.0):
        row.inclination = row.gravity_toolface = math.nan
        row.status = np.uint32(_NO_MAG)
        return
    row.inclination = math.atan2(across, d_x)
    _follow_vertical(p, s, row.inclination)
    status = _NEAR_VERTICAL if s.near_vertical else 0
    turned = sample.rate_x * p.latency_s
    if p.latency_s > 0.0 and math.isfinite(turned):
        # Present attitude of the tool: the measured attitude, rotated about the axis by the rate over the latency.
        cosine, sine = math.cos(turned), math.sin(turned)
        d_y, d_z = cosine * d_y + sine * d_z, cosine * d_z - sine * d_y
    else:
        turned = 0.0
    row.gravity_toolface = _wrap(math.atan2(-d_y, -d_z))
    if s.have_mag and sample.stamp_ns - s.mag_ns <= p.mag_timeout_ns:
        row.azimuth = s.azimuth
        if s.near_vertical:
            # For a stamp earlier than the latest one, interpolate the rotation at the stamp.
            late = sample.stamp_ns < s.last_ns and math.isfinite(sample.rate_x)
            turn = _turn_at(s, sample.stamp_ns) if late else s.turn
            row.magnetic_toolface = _wrap(s.toolface + (1.0 if d_x > 0.0 else -1.0) * (turn + turned))
        else:
            row.magnetic_toolface = _wrap(s.azimuth + math.atan2(-d_y / across, -d_z / across * d_x))
        sine, cosine = across / size, d_x / size
        # The smoothed azimuth still contains errors of earlier gravity, which may be less certain than the present one.
        tilt = max(sample.sigma_down, s.tilt)
        row.sigma_azimuth = _sigma_azimuth(model, s, across_axis * sine, sine, cosine, tilt)
        row.sigma_magnetic_toolface = _sigma_magnetic_toolface(model, s, tilt)
    else:
        status |= _NO_MAG
    row.status = np.uint32(status)


@compiled
def _run(
    p: TimeAlignmentParams,
    state: Samples,
    model: FieldModel,
    samples: Samples,
    mag: MagBlock,
    rows: Samples,
    pairs: Samples,
) -> tuple[int, int]:
    """Fill `rows` and `pairs`; return the numbers of magnetic samples used and of pairs; arguments as in `run`."""
    s: TimeAlignmentState = state[0]
    used, handed_on = 0, 0
    across_axis = model.sigma_axial * math.sin(s.azimuth - model.north_correction)
    for i in range(len(samples)):
        sample = samples[i]
        if math.isfinite(sample.down[0] + sample.down[1] + sample.down[2]):
            _keep(s, sample)
        while used < len(mag.stamp_ns) and mag.sent_ns[used] <= sample.sent_ns - p.mag_lag_ns:
            at = mag.stamp_ns[used]
            if at > sample.stamp_ns:
                break
            if s.recent.length > 0 and (not s.have_mag or at > s.mag_ns):
                pair = pairs[handed_on]
                for c in range(3):
                    pair.b_t[c] = mag.b_t[used, c]
                pair.sigma_tilt = sample.sigma_down if math.isfinite(sample.sigma_down) else math.pi
                taken = _take_mag(p, s, model, at, pair)
                across_axis = model.sigma_axial * math.sin(s.azimuth - model.north_correction)
                if taken and at // p.interval_ns != s.last_interval:
                    s.last_interval = at // p.interval_ns
                    pair.place = i
                    _hand_on(s, model, at, pair)
                    handed_on += 1
            used += 1
        _write(p, s, model, sample, across_axis, rows[i])
    return used, handed_on

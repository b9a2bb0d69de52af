# SPDX-License-Identifier: Apache-2.0
"""
Velocity-bounded error-state Kalman filter for gravity, which assumes that a sonde in its hole stays in place.

Rates propagate the attitude, forces propagate velocity and position in a level frame of arbitrary heading. A tilt (or a
sensor error that acts like tilt) integrates to a position that grows without limit; the position from vibration, even
strong vibration, stays limited.
Every sample propagates the nominal values (`mechanisation`). Once per `TICK` the covariance is propagated and the
position is measured as zero (`noise`, `measurement`, `scale`). Theory and limits:
``docs/methods/bounded_gravity_filter.md``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import clip_flags, ring, track
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded import (
    accelerometer_errors,
    alignment,
    clipping,
    field_roll,
    gaps,
    jumps,
    measurement,
    mechanisation,
    noise,
    sample_meaning,
    scale,
)
from mwd_estimation.gravity.bounded.field_roll import MagneticSamples
from mwd_estimation.gravity.bounded.params import BoundedParams, as_record
from mwd_estimation.gravity.bounded.state import (
    ERRORS,
    STEADY,
    TILT,
    BoundedRecord,
    BoundedState,
    Field,
    Log,
    forget,
    initial,
)
from mwd_sensors.core.arrays import Array, Samples, Stamps, Vector
from mwd_sensors.core.compiled import compiled

__all__ = ["BoundedParams", "BoundedState", "Log", "initial", "run", "run_logged"]

TICK = 0.03  # time between updates of the covariance, s
CLIPPED_TICK = 0.015  # time between updates while the x gyro clips, s: the tool turns by more than a radian in TICK
_GAP, _INITIALISING = int(Status.GAP), int(Status.INITIALISING)
_CLIPPED, _NEAR_VERTICAL, _ALIASED = int(Status.CLIPPED), int(Status.NEAR_VERTICAL), int(Status.ALIASED)
_ACCEL_FLAG, _AXIAL_FLAG, _CROSS_FLAG = clip_flags.ACCEL, clip_flags.AXIAL_GYRO, clip_flags.CROSS_GYRO
_NEAR_VERTICAL_SINE2 = math.sin(track.NEAR_VERTICAL_BELOW) ** 2

_Samples = tuple[Stamps, Array, Array, NDArray[np.uint8]]


def run(
    params: BoundedParams,
    state: BoundedState,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    accel_t: ArrayLike,
    clipped: ArrayLike | None = None,
    mag: MagneticSamples | None = None,
) -> Track:
    """
    Return gravity of each sample of a block.

    Parameters
    ----------
    state : BoundedState
        State of the filter, changed in place; the result does not depend on how the samples are cut into blocks.
    stamp_ns : array_like of int64, shape (n,)
        Times of the samples.
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, in tool axes.
    clipped : array_like of uint8, shape (n,), optional
        Clip flags that the unit reports for each sample, bits of `core.clip_flags`.
    mag : MagneticSamples, optional
        Magnetic samples that have not been used. The call uses the first `BoundedState.field_used` of them; pass the
        remaining ones again with the next block.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    return _follow(params, state, (stamps, gyro, accel, clip_flags.given(clipped, len(stamps))), mag, Log.room(0))


def run_logged(
    params: BoundedParams,
    state: BoundedState,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    accel_t: ArrayLike,
    clipped: ArrayLike | None = None,
) -> tuple[Track, Log]:
    """Return gravity of a block as `run` does without a field, and the log of the block for a smoother."""
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    log = Log.room(len(stamps))
    return _follow(params, state, (stamps, gyro, accel, clip_flags.given(clipped, len(stamps))), None, log), log


def _follow(
    params: BoundedParams, state: BoundedState, samples: _Samples, mag: MagneticSamples | None, log: Log
) -> Track:
    out = Track.empty(len(samples[0]))
    _run(as_record(params), state.clock, state.motion, state.record, samples, mag or MagneticSamples.none(), out, log)
    return out


@compiled
def _run(
    settings: Samples,
    clocks: Samples,
    motions: Samples,
    records: Samples,
    samples: _Samples,
    mag: MagneticSamples,
    out: Track,
    log: Log,
) -> None:
    p: BoundedParams = settings[0]
    clock: track.TrackClock = clocks[0]
    motion: track.TrackMotion = motions[0]
    s: BoundedRecord = records[0]
    stamps, gyro, accel, flags = samples
    s.field.used = 0
    for i in range(len(stamps)):
        w, f = (gyro[i, 0], gyro[i, 1], gyro[i, 2]), (accel[i, 0], accel[i, 1], accel[i, 2])
        backward = clock.backward_count
        verdict, dt, bits = track.take(clock, stamps[i], w, f, gaps.GAP_NS, p.gyro_range, p.accel_range)
        if verdict != track.REJECTED:
            if verdict == track.NEXT and gaps.stands_out(s, dt):
                verdict, bits = track.AFTER_GAP, bits | _GAP
            if verdict != track.NEXT:
                _resume(p, s, verdict, dt, gyro[i], i, log)
                dt = 0.0
                field_roll.begin_anew(s.field, stamps[i])
            elif backward >= gaps.BACKWARD:
                # The clock was set back: the tool went on turning while these samples were rejected.
                _miss(p, s, backward * s.period, w[0])
                field_roll.begin_anew(s.field, stamps[i])
            non_gravity = _take(p, s, dt, w, f, flags[i], stamps[i])
            field_roll.follow_turn(s, stamps[i])
            _take_mag(s.field, mag, mag.due_ns[i] if len(mag.due_ns) > 0 else stamps[i], stamps[i])
            tick = TICK if s.clipping.sign == 0.0 else CLIPPED_TICK
            if s.started and s.sums.time >= tick - 1e-6:
                _update(p, s, s.last_w, i, log)
                if s.started and field_roll.follow(p, s, stamps[i]):
                    scale.publish(p, s)
            bits |= track.follow_motion(motion, dt, w, non_gravity)
            if flags[i] != 0:
                bits |= _CLIPPED
        out.status[i] = bits | _publish(s)
        for j in range(3):
            out.g_t[i, j] = s.g_t[j]
        out.sigma_inclination[i], out.sigma_toolface[i] = s.sigma_inclination, s.sigma_toolface
        out.gyro_step[i], s.gyro_step = s.gyro_step, 0.0
        out.non_gravity[i] = motion.peak_force
        out.rotary_speed[i] = motion.rotary_speed
        if len(log.updates) > 0:
            for j in range(3):
                log.north_t[i, j] = s.C[0, j]


@compiled
def _take_mag(f: Field, mag: MagneticSamples, stamp_ns: int, time_ns: int) -> None:
    """
    Store the newest magnetic sample that is due at a sample of the conventional unit.

    stamp_ns, time_ns: stamp of this sample, and time at which it was measured, ns.
    """
    while f.used < len(mag.stamp_ns) and mag.sent_ns[f.used] <= stamp_ns - mag.lag_ns:
        if mag.stamp_ns[f.used] > time_ns:
            break
        f.stamp_ns = mag.stamp_ns[f.used]
        for j in range(3):
            f.b_t[j] = mag.b_t[f.used, j]
        f.used += 1


@compiled
def _publish(s: BoundedRecord) -> int:
    """
    Write the output of a sample into the record; return the status bits of the filter.

    With an attitude, the output is the direction of gravity; before the first attitude, it is the two sigmas.
    """
    if s.started:
        for j in range(3):
            s.g_t[j] = s.C[2, j]
        bits = _ALIASED if noise.aliased(s) else 0
        return bits | _NEAR_VERTICAL if s.C[0, 0] ** 2 + s.C[1, 0] ** 2 < _NEAR_VERTICAL_SINE2 else bits
    s.sigma_inclination = s.sigma_toolface = math.pi
    if s.age > 0.0:
        s.sigma_inclination = alignment.direction(s)
    return _INITIALISING


@compiled
def _resume(p: BoundedParams, s: BoundedRecord, verdict: int, dt: float, w: Array, i: int, log: Log) -> None:
    """
    Bridge a data gap of dt, s; restart at the first sample, without an attitude, or if the gap is too long.

    If only the roll is lost in the gap, only the roll restarts. verdict: as in `track.admit`; w: rates at the end of
    the gap, rad/s; i: index of the sample.
    """
    known = s.started and s.clipping.sign == 0.0
    if verdict == track.FIRST or not known or not 0.0 < dt < p.max_bridged_gap_s:
        alignment.begin(s)
        return
    if s.sums.time > 0.0:
        _update(p, s, s.last_w, i, log)
    roll_known = gaps.bridge(p, s, dt, w) or s.field.variance > 0.0
    if roll_known and measurement.sound(s):
        scale.publish(p, s)
    else:
        alignment.begin_roll(s)


@compiled
def _miss(p: BoundedParams, s: BoundedRecord, lapse: float, rate: float) -> None:
    """Continue after samples were rejected for `lapse`, s, while the tool turned about its axis at `rate`, rad/s."""
    if s.started:
        variance = (lapse * rate) ** 2
        gaps.widen_roll(s, variance)
        alignment.forget_motion(s)
        alignment.unknown_motion(s, s.power / p.gravity**2)
        mechanisation.clear_sums(s.sums)
        s.epoch += 1
        if variance > clipping.LOST_ROLL and not s.field.variance > 0.0:
            alignment.begin_roll(s)


@compiled
def _take(p: BoundedParams, s: BoundedRecord, dt: float, w: Vector, f: Vector, flags: int, stamp_ns: int) -> float:
    """Process one accepted sample; flags: bits of `clip_flags`. Returns the size of the non-gravity force, m/s^2."""
    power = mechanisation.mechanise(p, s, dt, w, f)
    if s.started:
        clipping.follow_shocks(p, s, dt, f, power, flags & _ACCEL_FLAG != 0)
        noise.follow_rates(p, s, dt, w, f, flags & _CROSS_FLAG != 0)
        before = s.clipping.sign
        lost = clipping.follow_rate(p, s, dt, w[0], flags & _AXIAL_FLAG != 0)
        if before != 0.0 and s.clipping.sign == 0.0:
            if lost and not field_roll.at_hand(s.field, stamp_ns):
                alignment.begin_roll(s)
            field_roll.begin_anew(s.field, stamp_ns)
    else:
        power = (math.sqrt(f[0] ** 2 + f[1] ** 2 + f[2] ** 2) - p.gravity) ** 2
        s.since_shock += dt
        clips = flags & _AXIAL_FLAG != 0 or abs(w[0]) >= track.AT_RANGE * p.gyro_range
        if alignment.average(p, s, dt, f, clips):
            scale.publish(p, s)
            for j in range(3):
                s.tick_w[j] = w[j]
    for j in range(3):
        s.last_w[j], s.last_f[j] = w[j], f[j]
    return math.sqrt(power)


@compiled
def _update(p: BoundedParams, s: BoundedRecord, w: Array, i: int, log: Log) -> None:
    """Propagate the covariance, add noise, measure, correct, and clear the sums; w: latest rate, rad/s, shape (3,)."""
    size = STEADY if s.clipping.sign == 0.0 else ERRORS
    s.settled += s.sums.time
    if size == ERRORS:
        mechanisation.turn_heading(s)
    mechanisation.move(s)
    sample_meaning.propagate(s, w[0])
    noise.follow_motion(s, w)
    mechanisation.propagate(s, size)
    turn = noise.add_noise(p, s)
    _note_before(s, i)
    gate = clipping.jump_gate(s)
    tilt, aside = scale.tilts(s)
    measurement.update(s, size, p.displacement**2, gate)
    square = 0.0
    for axis in range(3):
        square += s.white[axis] ** 2 / 3.0
        jumps.follow_innovation(s, axis, s.white[axis])
    sample_meaning.compare(s)
    usual = s.innovations.usual
    s.innovations.usual += s.sums.time / scale.USUAL_TIME * (min(square, 9.0 * usual + 0.001) - usual)
    scale.follow_corrections(s, turn, tilt, aside)
    measurement.correct(s, size)
    clipping.follow_roll(s, square)
    accelerometer_errors.follow(p, s)
    s.recent.rows[ring.next_place(s.recent)] = s.latest
    for j in range(2):
        s.latest.correction[j] = s.correction[TILT + j]
    if size == STEADY and jumps.follow(p, s):
        for j in range(2):
            s.latest.correction[j] += s.correction[TILT + j]
    if size == STEADY:
        sample_meaning.follow(s)
    if len(log.updates) > 0:
        _note_after(p, s)
        log.updates[log.entries[0]] = s.latest
        log.entries[0] += 1
    lost = alignment.attitude_lost(p, s)
    mechanisation.clear_sums(s.sums)
    if not measurement.sound(s):
        forget(p, s)
        alignment.begin(s)
    elif lost:
        alignment.begin(s)
    else:
        scale.publish(p, s)


@compiled
def _note_before(s: BoundedRecord, i: int) -> None:
    entry = s.latest
    entry.sample = i
    entry.epoch = s.epoch if s.clipping.sign == 0.0 else -1
    entry.sums.time = s.sums.time
    for a in range(2):
        entry.sums.scale[a] = s.sums.scale[a]
        for j in range(2):
            entry.sums.askew[a, j] = s.sums.askew[a, j]
        for j in range(3):
            entry.sums.bias[a, j] = s.sums.bias[a, j]


@compiled
def _note_after(p: BoundedParams, s: BoundedRecord) -> None:
    entry = s.latest
    for j in range(2):
        for m in range(STEADY):
            entry.tilt[j, m] = s.P[TILT + j, m]
    entry.factors[0], entry.factors[1] = s.innovations.along.power, s.innovations.across.power
    entry.floors[0], entry.floors[1] = scale.floors(p, s)

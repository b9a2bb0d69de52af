# SPDX-License-Identifier: Apache-2.0
"""
Check half a second of samples of each sensor: stuck, at the end of its range, not finite, noise, dead.

`count` adds samples to the record of a channel (one axis of one sensor). `judge_bin` evaluates nine channels (gyro,
accelerometer, magnetometer) and records observations for `fault_debounce`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core.sensor_fault import GYRO, MAG, FaultCode
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, observe
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

BIN_NS = 500_000_000  # half a second, ns: the time that is evaluated at once
# Each sensor has two checks of its unit of measurement: by windows of motion, and by the readings that the gate
# refused. BY_GATE: index of the second check minus index of the first one.
BY_GATE = 1
# Smallest number of samples of an axis for evaluating half a second (a magnetometer may run at 10 Hz), and for using a
# standard deviation.
_SOME, FEW = 3, 10
# Powers of ten from T to the other units of measurement in which a field may be sent (mT, gauss, uT, mG, nT, as in
# `fault_messages.OTHER_UNITS`); and a usual field, T.
FIELD_POWERS = np.array([3.0, 4.0, 6.0, 7.0, 9.0])
_USUAL_FIELD = 5e-5


class AxisChannel:
    """One axis of one sensor: counts of the half second, and values kept from earlier half seconds."""

    #: `n`, `not_finite`, `repeats`, `at_limit`: number of finite samples, of samples that are not finite, of samples
    #: equal to the previous one, and of samples at the end of the range.
    n: int
    not_finite: int
    repeats: int
    at_limit: int
    #: `first`, `last`: first value of the half second, and last value received so far.
    first: float
    last: float
    #: `total`, `total2`, `steps`: sums of the differences from the first value, of their squares, and of the sizes of
    #: the steps between neighbours.
    total: float
    total2: float
    steps: float
    #: `mean`, `spread`: mean and standard deviation of the half second.
    mean: float
    spread: float
    least_step: float  #: smallest change from one sample to the next so far, an estimate of the resolution
    constant_bins: int  #: number of half seconds in a row without a change
    #: Score from -30 to 30: plus 1 for each half second at rest in which the axis varied, minus 3 for one in which it
    #: hardly varied.
    varied: int


CHANNEL = dtype_of(AxisChannel)


class SignalLimits(NamedTuple):
    """Limits of the checks of samples; their effects are listed in docs/methods/sensor_health_ablation.md."""

    gyro_turns: float = 0.1  #: smallest mean rate that counts as motion, rad/s: above the bias of an AHRS
    #: Smallest standard deviation of a force that counts as motion, m/s^2: ten times the noise of an accelerometer.
    shakes: float = 0.3
    #: If the standard deviation of one axis is above this multiple of its smallest step, the other axes should vary
    #: too.
    steps: float = 10.0
    varied_bins: int = 6  #: score of variation at rest (`AxisChannel.varied`) from which a constant axis is suspicious
    missing: float = 0.06  #: largest share of values that are not finite
    #: `clipped`, `saturated`: largest share of samples at the end of the range before the axis is CLIPPED or SATURATED.
    #: Shocks clip a smaller share than `clipped`, and a broken axis a larger share than `saturated`.
    clipped: float = 0.2
    saturated: float = 0.9
    #: Samples whose mean step is larger than this multiple of the standard deviation are white noise. The multiple is
    #: 1.13 for independent samples, 0.9 for a constant of which each sixth sample is wrong, and smaller for a motion
    #: of less than a radian between samples.
    white: float = 0.95
    #: Smallest standard deviation of a force that may be random numbers, in units of the range: uniform numbers have
    #: 0.58.
    noise_of_range: float = 0.36
    #: `field_noise`, `field_noise_still`: smallest standard deviation of a field that may be random numbers, T, in any
    #: motion and while the tool hardly turns between two samples. A turning tool sees at most the Earth's field change,
    #: `earth_field`, T. Interference of a tool at rest varies by less than 1e-5 T.
    field_noise: float = 1e-4
    field_noise_still: float = 1e-5
    earth_field: float = 7e-5
    #: `axial_rate_noise`, `cross_rate_noise`: smallest standard deviation of rates about and across the axis that may
    #: be random numbers, rad/s. Torsional vibration of a string, and bending of a tool by 50 g of lateral vibration,
    #: give less.
    axial_rate_noise: float = 10.0
    cross_rate_noise: float = 2.0
    #: Below this share of these limits, a NOISE fault ends after some half seconds. Between this share and the limits,
    #: samples may be smaller random numbers, or strong vibration seen by a sound sensor. Such half seconds count as one
    #: observation against the fault every `noise_patience_ns`, so a fault ends if no half second is above the limits
    #: for four times this time.
    noise_ends: float = 0.5
    noise_patience_ns: int = 5_000_000_000
    no_tesla: float = 3e-3  #: a stronger field must be in another unit, T; the check UNIT finds the unit
    #: `off_pace`, `in_pace`: share of intervals that are too long or too short for the sample rate; more than
    #: `off_pace` is a fault, less than `in_pace` is not.
    off_pace: float = 0.6
    in_pace: float = 0.2
    #: If a larger share of the intervals is too long, the rotation between the samples counts as unknown.
    lost: float = 0.75
    repeated: float = 0.3  #: largest share of samples that repeat the previous sample


def blank() -> Any:
    """Return empty statistics of the nine channels (x, y, z of gyro, accelerometer, magnetometer), dtype CHANNEL."""
    channels = np.zeros(9, dtype=CHANNEL)
    channels["last"], channels["least_step"] = math.nan, math.inf
    return channels


@compiled
def count(channel: Any, values: Array, k: int, start: int, stop: int, limit: float) -> None:
    """Add column k of rows start to stop - 1 to the counts of a channel; limit: end of the range, SI."""
    # One channel at a time and local names: the loop takes most of the time of the health checks.
    last, first, fresh = channel.last, channel.first, channel.n == 0
    total, total2, least, steps = channel.total, channel.total2, channel.least_step, channel.steps
    bad, same, clip = 0, 0, 0
    for i in range(start, stop):
        v = values[i, k]
        size = abs(v)
        if not math.isfinite(v):
            bad += 1
            continue
        if fresh:
            first, fresh = v, False
        away = abs(v - last)
        same += int(away == 0.0)
        if away > 0.0:
            least = min(least, away)
            steps += away
        last = v
        away = v - first
        total += away
        total2 += away * away
        clip += int(size >= limit)
    channel.last, channel.first, channel.least_step = last, first, least
    channel.total, channel.total2, channel.steps = total, total2, steps
    channel.n += stop - start - bad
    channel.not_finite += bad
    channel.repeats += same
    channel.at_limit += clip


@compiled
def summarise(channels: Any) -> None:
    """
    Compute mean and standard deviation of every channel, and count the half seconds in which its value was constant.

    Without samples both are 0. A half second with fewer than `_SOME` samples leaves the count unchanged.
    """
    for c in range(9):
        row = channels[c]
        row.mean = row.spread = 0.0
        if row.n > 0:
            off = row.total / row.n
            row.mean = row.first + off
            row.spread = math.sqrt(max(row.total2 / row.n - off * off, 0.0)) if row.n > 1 else 0.0
        if row.n >= _SOME:
            row.constant_bins = row.constant_bins + 1 if row.repeats >= row.n else 0


@compiled
def _motion(p: SignalLimits, channels: Any) -> tuple[bool, bool]:
    """Return two flags: whether the gyro shows that the tool moves, and whether the accelerometer shows it."""
    gyro, accel = False, False
    for c in range(6):
        row = channels[c]
        if row.constant_bins == 0:
            gyro = gyro or (c < 3 and abs(row.mean) > p.gyro_turns)
            accel = accel or (c >= 3 and row.spread > p.shakes)
    return gyro, accel


@compiled
def _field_noise(p: SignalLimits, channels: Any) -> float:
    """
    Return the smallest standard deviation of a field that may be random numbers in this half second, T.

    Neighbouring samples of a turning field differ by at most the rotation between them. If the gyros are silent,
    constant or at the end of their range, the rotation is unknown.
    """
    rate2, n = 0.0, int(channels[6].n)
    for c in range(3):
        row = channels[c]
        if row.n < FEW or row.at_limit > 0 or row.constant_bins > 0 or n < FEW:
            return p.field_noise
        rate2 += row.mean**2 + row.spread**2
    turn = math.sqrt(rate2) * 1e-9 * BIN_NS / n
    return min(p.field_noise, p.field_noise_still + turn * p.earth_field)


@compiled
def _judge_noise(p: SignalLimits, checks: Any, channels: Any, s: int, limits: tuple[float, float], began: int) -> bool:
    """
    Check whether sensor s sends random numbers; return True if it does.

    limits: smallest standard deviation of random numbers along x, and along y and z, SI; began: start of the half
    second, ns.
    """
    worst, size2, axes, white, limit = 0.0, 0.0, 0, False, limits[1]
    check = checks[FaultCode.NOISE.value, 3 * s]
    # The spread of random numbers varies: the fault must not end with a few half seconds of smaller ones.
    share, large = p.noise_ends if check.state == FAULT else 1.0, False
    for c in range(3):
        row, least = channels[3 * s + c], limits[min(c, 1)]
        size2 += row.mean**2 + row.spread**2
        if row.spread > share * least:
            axes |= 1 << c
            worst = max(worst, row.spread)
            white = white or (row.n >= FEW and row.steps > p.white * row.n * row.spread)
            large = large or row.spread > least
    if white and (s != 2 or size2 < p.no_tesla**2):
        # The clock may have been set back.
        if large or abs(began - check.seen_ns) > p.noise_patience_ns:
            observe(check, FOR if large else AGAINST, began, worst, limit)
            check.seen_which[0] = axes
        return True
    if channels[3 * s].n >= FEW:
        observe(check, AGAINST, began, 0.0, limit)
    return False


@compiled
def _judge_axis(
    p: SignalLimits, checks: Any, channels: Any, k: int, moves: bool, whole: bool, limit: float, began: int
) -> bool:
    """
    Record whether axis k (0 to 8) is stuck or at the end of its range; return True if the axis is doubtful.

    With fewer than `_SOME` samples nothing is recorded, and the result is False. moves: whether gyro or accelerometer
    detect motion; whole: whether all axes of the sensor repeat; limit: end of the range, SI; began: start of the half
    second, ns.
    """
    row, s, doubtful = channels[k], k // 3, False
    if row.n < _SOME:
        return False
    if not row.constant_bins:
        observe(checks[FaultCode.STUCK.value, k], AGAINST, began, 0.0, 0.0)
    elif not whole and abs(row.last) < limit:
        others, least = 0.0, math.inf
        for c in range(3 * s, 3 * s + 3):
            others = max(others, channels[c].spread)
            least = min(least, channels[c].least_step)
        if (moves and others >= p.steps * least) or row.varied >= p.varied_bins:
            observe(checks[FaultCode.STUCK.value, k], FOR, began, row.last, 0.0)
            doubtful = True
    if limit < math.inf:
        share = row.at_limit / row.n
        always = share > p.saturated
        # A gyro at the end of its range for half a second is not doubtful: the string turns fast.
        doubtful = doubtful or (always and s != 0)
        observe(checks[FaultCode.SATURATED.value, k], FOR if always else AGAINST, began, share, p.saturated)
        seen = NOTHING if always else (FOR if share > p.clipped else AGAINST)
        observe(checks[FaultCode.CLIPPED.value, k], seen, began, share, p.clipped)
    return doubtful


@compiled
def _judge_sensor(p: SignalLimits, checks: Any, channels: Any, s: int, moves: bool, began: int) -> tuple[bool, bool]:
    """
    Check whether sensor s sends values that are not finite or repeats its values.

    moves: whether another sensor detects motion. Return whether all axes repeat, and whether the sensor is doubtful.
    """
    n, bad, axes, constant, largest, varied = 0, 0, 0, True, 0.0, p.varied_bins
    for c in range(3):
        row = channels[3 * s + c]
        n += row.n
        bad += row.not_finite
        axes |= int(row.not_finite > 0) << c
        constant = constant and row.constant_bins > 0
        largest = max(largest, abs(row.last))
        varied = min(varied, row.varied)
    if n + bad == 0:
        return constant, False
    missing = bad > p.missing * (n + bad)
    check = checks[FaultCode.INVALID.value, 3 * s]
    seen = FOR if missing else AGAINST
    if checks[FaultCode.UNIT.value, 3 * s + BY_GATE].seen == FOR:
        seen = NOTHING
    observe(check, seen, began, bad / (n + bad), p.missing)
    check.seen_which[0] = axes if missing else 0
    dead = constant and (largest == 0.0 or moves or varied >= p.varied_bins)
    if dead:
        observe(checks[FaultCode.DEAD.value, 3 * s], FOR, began, largest, 0.0)
    elif not constant and n >= 3 * _SOME:
        observe(checks[FaultCode.DEAD.value, 3 * s], AGAINST, began, 0.0, 0.0)
    return constant, missing or dead


@compiled
def judge_refused(checks: Any, channels: Any, s: int, sizes: Array, expected: float, began: int) -> None:
    """
    Check whether readings that the gate refused are in another unit of measurement; call this before `judge_bin`.

    sizes, shape (k,): from `input_gate.sizes_of`; expected: expected total field, T, NaN if unknown, from which the
    unit of a magnetometer is found. At least three refused samples, and more than a quarter of all, are needed, so that
    a single absurd value has the same effect as a missing one.
    """
    n, k = 0, len(sizes)
    for c in range(3 * s, 3 * s + 3):
        n = max(n, channels[c].n + channels[c].not_finite)
    if n == 0:
        return
    check, unit = checks[FaultCode.UNIT.value, 3 * s + BY_GATE], 0
    if k >= _SOME and 4 * k > n:
        unit = 1
        if s == 2:
            power = math.log10(sizes[k // 2] / (expected if math.isfinite(expected) else _USUAL_FIELD))
            away = np.abs(power - FIELD_POWERS)
            unit = int(np.argmin(away)) + 1 if away.min() < 0.5 else 0
    # A gyro at rest reads small rates in any unit, which is not evidence for SI: require shaking forces. Their standard
    # deviations are from the previous half second.
    shown = s != 0 or max(channels[3].spread, channels[4].spread, channels[5].spread) > 0.3
    seen = FOR if unit else (AGAINST if shown or check.votes_for == 0 else NOTHING)
    observe(check, seen, began, sizes[k // 2] if k else 0.0, 0.0)
    check.seen_which[0] = unit


@compiled
def judge_bin(p: SignalLimits, checks: Any, channels: Any, limits: Array, began: int) -> int:
    """
    Check the half second that began at `began`, ns, after `summarise`, and clear the counts for the next one.

    limits, shape (3,): ends of the ranges, rad/s, m/s^2 and T, infinite if unknown. Returns the bits of the sensors
    that are doubtful in this half second.
    """
    gyro, accel = _motion(p, channels)
    field = _field_noise(p, channels)
    doubtful = MAG * int(_judge_noise(p, checks, channels, 2, (field, field), began))
    if limits[1] < math.inf:
        force = p.noise_of_range * limits[1]
        _judge_noise(p, checks, channels, 1, (force, force), began)
    if limits[0] < math.inf:
        rates = (p.axial_rate_noise, p.cross_rate_noise)
        noisy, check = _judge_noise(p, checks, channels, 0, rates, began), checks[FaultCode.NOISE.value, 0]
        # A single wrong sample makes one half second noisy; `core.rate_jumps` removes such a sample from the estimate.
        if noisy and (check.votes_for > 0 or check.state == FAULT):
            doubtful |= GYRO
    for s in range(3):
        # Motion that another sensor detects: the accelerometer for the gyro, the gyro for the other two sensors,
        # because a magnetometer does not react to vibration.
        moves = accel if s == 0 else gyro
        whole, doubt = _judge_sensor(p, checks, channels, s, moves, began)
        for k in range(3 * s, 3 * s + 3):
            doubt |= _judge_axis(p, checks, channels, k, gyro or accel, whole, limits[s], began)
        doubtful |= int(doubt) << s
    for c in range(9):
        row = channels[c]
        if not (gyro or accel or row.constant_bins) and row.n >= _SOME:
            # A healthy axis usually varies at rest, unless its resolution is coarser than its noise.
            varies = row.n - row.repeats >= 0.3 * row.n
            row.varied = min(row.varied + 1, 30) if varies else max(row.varied - 3, -30)
        row.n = row.not_finite = row.repeats = row.at_limit = 0
        row.total = row.total2 = row.steps = 0.0
    return doubtful

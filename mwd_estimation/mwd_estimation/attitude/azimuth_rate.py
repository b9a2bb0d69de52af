# SPDX-License-Identifier: Apache-2.0
"""
Integrals of the azimuth rate over bins of time, from the rates of two units, and the samples they are paired with.

    azimuth' = (w - w_ie) . (d - (d.x) x) / sin^2 I        d: unit vector down in tool axes, from any gravity method

The x rate drops out, except for its leakage into the cross-axis gyros: in step with a turn whose speed varies once a
turn that does not average out (2 % of 120 r/min and .2 mrad are 10 deg/h at 30 deg inclination). The sums of a bin hold
all that a filter needs to propagate an azimuth and its covariance through it, and to estimate that leakage.
"""

from __future__ import annotations

import math

from mwd_estimation.attitude.gyro_azimuth_state import (
    BINS,
    BinSums,
    Error,
    Params,
    PrecisionRates,
    State,
)
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core import ring
from mwd_estimation.core.track import GAP_NS
from mwd_sensors.core.compiled import compiled

# A bin is left to the other unit where an interval of the precision unit is longer than this share of the bin, or
# where its intervals cover less than this share of the bin's time.
_MAX_STEP, _MIN_COVERED = 0.5, 0.8


@compiled
def clear_sums(sums: BinSums, bin_index: int) -> None:
    """Begin the sums of a bin."""
    sums.bin, sums.vertical = bin_index, False
    sums.turn = sums.time = sums.earth = sums.noise = sums.tilt = sums.gap = sums.gyro_turn = 0.0
    sums.spin = sums.lag = 0.0
    for i in range(2):
        sums.across[i] = sums.leakage[i] = sums.rate[i] = 0.0


@compiled
def _add_rate(sums: BinSums, dt: float, share: float, dy: float, dz: float, wx: float, wy: float, wz: float) -> float:
    """Add a rate that held for dt, share = dt / across^2, to the sums of its unit; returns the turn of the axis."""
    turn = (wy * dy + wz * dz) * share
    y, z = dy * share, dz * share
    sums.turn += turn
    sums.across[0] += y
    sums.across[1] += z
    sums.noise += share
    sums.leakage[0] += wx * y
    sums.leakage[1] += wx * z
    sums.spin += wx * dt
    sums.rate[0] += wy * dt
    sums.rate[1] += wz * dt
    sums.lag += wx * (wy * dz - wz * dy) * share
    return turn


@compiled
def _spin(sample: Sample) -> float:
    """Rate about the axis, rad/s; 0 where the x gyro gives none: it counts only for its leakage into y and z."""
    return sample.gyro[0] if math.isfinite(sample.gyro[0]) else 0.0


@compiled
def add_sample(p: Params, s: State, sample: Sample, earth_north: float) -> None:
    """
    Take in a sample of the conventional unit: later than the last one, its y and z rates and vertical finite.

    earth_north: rate of the azimuth by the Earth's northward rotation per unit of `BinSums.earth`, rad/s.
    """
    stamp, wx, wy, wz = sample.stamp_ns, _spin(sample), sample.gyro[1], sample.gyro[2]
    dx, dy, dz = sample.down[0], sample.down[1], sample.down[2]
    across2 = dy * dy + dz * dz
    sums = s.sums[s.bins_opened % BINS]
    if across2 < p.vertical_sin2:
        sums.vertical = True
    elif s.recent.length > 0:
        dt = (stamp - s.last_ns) * 1e-9
        if stamp - s.last_ns <= GAP_NS:
            inverse = 1.0 / across2
            share = dt * inverse
            earth = dx * math.sqrt(across2) * share
            mistaken = (wy * dz - wz * dy) * inverse * sample.sigma_inclination
            turn = _add_rate(sums, dt, share, dy, dz, wx, wy, wz)
            sums.time += dt
            sums.earth += earth
            sums.tilt += mistaken * mistaken * dt
            x = s.x
            error_y = x[Error.BIAS] + x[Error.LEAKAGE] * wx
            error_z = x[Error.BIAS + 1] + x[Error.LEAKAGE + 1] * wx
            turn -= error_y * (dy * share) + error_z * (dz * share)
            s.gyro_turn += turn - (p.earth_down + x[Error.DRIFT]) * dt + earth_north * earth
        else:
            sums.gap += dt
    sums.gyro_turn = s.gyro_turn
    sample.gyro_turn, s.last_ns = s.gyro_turn, stamp
    s.recent.rows[ring.next_place(s.recent)] = sample


@compiled
def gyro_turn_at(s: State, at: int) -> float:
    """Turn of the axis by the conventional gyros at a time, rad; beyond the ends of the ring that of the end."""
    earlier, later, share = ring.around(s.recent, at)
    turn: float = (1.0 - share) * s.recent.rows[earlier].gyro_turn + share * s.recent.rows[later].gyro_turn
    return turn


@compiled
def precision_sums(p: Params, s: State, sums: BinSums, precision: PrecisionRates, start: int) -> tuple[bool, int]:
    """
    Fill `s.precision_sums` for the bin of `sums`, with gravity and x rate of the sample at or after each rate.

    A rate is the mean over the interval that ends at its stamp.

    Returns
    -------
    usable : bool
        Whether the unit covers the bin, within its range.
    next : int
        First rate of a later bin; `start` is the first of this one or of an earlier one.
    """
    stamps, rates, fine = precision.stamp_ns, precision.rate_t, s.precision_sums
    begin = sums.bin * p.bin_ns
    while start < len(stamps) and stamps[start] < begin:
        start += 1
    clear_sums(fine, sums.bin)
    fine.time, fine.earth, fine.tilt, fine.gap = sums.time, sums.earth, sums.tilt, sums.gap
    usable, covered = True, 0.0
    last, back = begin, 0
    while start < len(stamps) and stamps[start] < begin + p.bin_ns:
        stamp, wy, wz = stamps[start], rates[start, 1], rates[start, 2]
        start += 1
        dt = (stamp - last) * 1e-9
        if dt <= 0.0:
            continue
        last = stamp
        if not (abs(wy) < p.precision_range and abs(wz) < p.precision_range):
            usable = False
            continue
        if back == 0:
            back = ring.first_from(s.recent, stamp)
        while back > 1 and s.recent.rows[ring.place(s.recent, back)].stamp_ns < stamp:
            back -= 1
        if back == 0:
            usable = False
            break
        near = s.recent.rows[ring.place(s.recent, back)]
        dy, dz = near.down[1], near.down[2]
        across2 = dy * dy + dz * dz
        if across2 < p.vertical_sin2 or dt > _MAX_STEP * 1e-9 * p.bin_ns:
            usable = False
            continue
        _add_rate(fine, dt, dt / across2, dy, dz, _spin(near), wy, wz)
        covered += dt
    usable = usable and covered > _MIN_COVERED * sums.time and sums.time > 0.0
    if usable:
        # Where it covers the bin except for a sample or two, the missing part is taken in proportion.
        _scale(fine, sums.time / covered)
    return usable, start


@compiled
def _scale(sums: BinSums, factor: float) -> None:
    """Multiply the sums that depend on the unit."""
    sums.turn *= factor
    sums.noise *= factor
    sums.spin *= factor
    sums.lag *= factor
    for i in range(2):
        sums.across[i] *= factor
        sums.leakage[i] *= factor
        sums.rate[i] *= factor

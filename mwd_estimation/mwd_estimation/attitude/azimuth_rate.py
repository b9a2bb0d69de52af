# SPDX-License-Identifier: Apache-2.0
"""
Integrals of the azimuth rate over bins of time, from the gyros of the conventional and of the precision unit.

    azimuth' = (w - w_ie) . (d - (d.x) x) / sin^2 I        d: unit vector down, from any gravity method

Here w is the measured rate, w_ie the rotation of the Earth, x the tool axis, all in tool axes, and I the inclination.
The x rate drops out, except for its leakage into the cross-axis gyros. If the rotary speed varies in step with the
rotation, the leakage does not average out (a variation of 2 % of 120 r/min and a leakage of 0.2 mrad give 10 deg/h at
30 deg inclination). The sums of a bin contain everything that a filter needs to propagate an azimuth and its covariance
through the bin and to estimate the leakage.
"""

from __future__ import annotations

import math

from mwd_estimation.attitude.gyro_azimuth_filter import (
    BINS,
    BinSums,
    Error,
    GyroAzimuthParams,
    GyroAzimuthState,
    PrecisionRates,
)
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core import ring
from mwd_estimation.core.track import GAP_NS
from mwd_sensors.core.compiled import compiled

# A bin uses the gyros of the conventional unit instead of the precision unit if the precision unit has a gap longer
# than the share _MAX_STEP of the bin, or if its valid samples cover less than the share _MIN_COVERED of the bin.
_MAX_STEP, _MIN_COVERED = 0.5, 0.8


@compiled
def clear_sums(sums: BinSums, bin_index: int) -> None:
    """Clear the sums for a new bin."""
    sums.bin, sums.vertical = bin_index, False
    sums.turn = sums.time = sums.earth = sums.noise = sums.tilt = sums.gap = sums.gyro_turn = 0.0
    sums.spin = sums.lag = sums.gyro_step = 0.0
    for i in range(2):
        sums.across[i] = sums.leakage[i] = sums.rate[i] = 0.0


@compiled
def _add_rate(sums: BinSums, dt: float, share: float, dy: float, dz: float, wx: float, wy: float, wz: float) -> float:
    """
    Add a rate that lasted for dt to the sums of its unit; return the change of the azimuth in this time, rad.

    dt: s; dy, dz: y and z of the unit vector down; share: dt / (dy^2 + dz^2), s; wx, wy, wz: rate, rad/s.
    """
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
    """Return the rate about the axis, rad/s; 0 if the x gyro has no value, as only small error terms need this rate."""
    return sample.gyro[0] if math.isfinite(sample.gyro[0]) else 0.0


@compiled
def add_sample(p: GyroAzimuthParams, s: GyroAzimuthState, sample: Sample, earth_north: float) -> None:
    """
    Add a sample of the conventional unit to the open bin and to the ring of samples.

    The sample must be later than the last one, with finite y and z rates and a known vector down. Near the vertical it
    only marks the bin as vertical; after a step longer than GAP_NS it only adds the step to the gap. earth_north:
    northward component of the Earth's rotation times the cosine of the azimuth, rad/s.
    """
    stamp, wx, wy, wz = sample.stamp_ns, _spin(sample), sample.gyro[1], sample.gyro[2]
    dx, dy, dz = sample.down[0], sample.down[1], sample.down[2]
    across2 = dy * dy + dz * dz
    sums = s.sums[s.bins_opened % BINS]
    sums.gyro_step = max(sums.gyro_step, sample.gyro_step)
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
def gyro_turn_at(s: GyroAzimuthState, at: int) -> float:
    """
    Return the change of the azimuth since the start by the gyros (`gyro_turn`), rad, at a time, ns.

    The change is interpolated between the stored samples, and constant before and after them.
    """
    earlier, later, share = ring.around(s.recent, at)
    turn: float = (1.0 - share) * s.recent.rows[earlier].gyro_turn + share * s.recent.rows[later].gyro_turn
    return turn


@compiled
def precision_sums(
    p: GyroAzimuthParams, s: GyroAzimuthState, sums: BinSums, precision: PrecisionRates, start: int
) -> tuple[bool, int]:
    """
    Fill `s.precision_sums` with the sums of the precision unit over one bin; return whether these sums can be used.

    Each rate of the precision unit is combined with gravity and x rate of the first conventional sample at or after its
    stamp. A rate is the mean over the interval that ends at its stamp.

    Parameters
    ----------
    sums : BinSums
        Sums of the closed bin from the conventional unit.
    start : int
        Index in `precision` from which the rates of this bin are searched.

    Returns
    -------
    usable : bool
        Whether the rates cover the bin, stay within the range of the unit, and the hole is not near the vertical.
    next : int
        Index of the first rate of a later bin.
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
        # If samples are missing in the bin, scale the sums up to the full duration.
        _scale(fine, sums.time / covered)
    return usable, start


@compiled
def _scale(sums: BinSums, factor: float) -> None:
    """Multiply the sums that contain rates of the precision unit by a factor."""
    sums.turn *= factor
    sums.noise *= factor
    sums.spin *= factor
    sums.lag *= factor
    for i in range(2):
        sums.across[i] *= factor
        sums.leakage[i] *= factor
        sums.rate[i] *= factor

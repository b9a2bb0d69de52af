# SPDX-License-Identifier: Apache-2.0
"""
Azimuth while drilling: propagated by the gyros and corrected by the magnetic azimuth, with its own sigma.

The filter (`gyro_azimuth_filter`) estimates the azimuth of the hole axis; bias and leakage of the cross-axis gyros of
both units; the slowly changing error of the magnetic azimuth (interference), which does not average out while the tool
stays in place; and the constant error of the magnetic azimuth (declination), which never averages out. Only the
cross-axis rates are used, so the x gyro may clip, and a rotating tool averages the biases out. A magnetic azimuth
beyond the innovation gate is not used. If magnetic azimuths that pass the field check stay beyond the gate, the azimuth
is reset to them, and the reset is counted.

The azimuth rate is integrated sample by sample, from the gyros of the conventional and of the precision unit:

    azimuth' = (w - w_ie) . (d - (d.x) x) / sin^2 I        d: unit vector down, from any gravity method

Here w is the measured rate, w_ie the rotation of the Earth, x the tool axis, all in tool axes, and I the inclination.
The x rate drops out, except for its leakage into the cross-axis gyros. If the rotary speed varies in step with the
rotation, the leakage does not average out (a variation of 2 % of 120 r/min and a leakage of 0.2 mrad give 10 deg/h at
30 deg inclination). The sums of a bin contain everything that the filter needs to propagate an azimuth and its
covariance through the bin and to estimate the leakage.

The filter makes one step per closed bin of time, one bin late, when the other streams of that time have arrived. Every
sample gets the filter's azimuth propagated to its stamp by the conventional gyro. The azimuth of the last accepted
station is propagated without the magnetometer, for the continuity check at the next station. Derivation and limits:
``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.attitude import gyro_azimuth_filter as kalman_filter
from mwd_estimation.attitude.block import BinEvent
from mwd_estimation.attitude.gyro_azimuth_filter import (
    AZIMUTH_ROW,
    BINS,
    NO_BIN,
    PROPAGATED_AZIMUTH,
    AzimuthRow,
    BinSums,
    Error,
    GyroAzimuthParams,
    GyroAzimuthState,
    MagneticAzimuth,
    PrecisionRates,
    PropagatedAzimuth,
)
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core import ring
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import GAP_NS
from mwd_sensors.core.arrays import Samples
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


_AIDED = int(Status.GYRO_AIDED)


def run(
    p: GyroAzimuthParams,
    state: Samples,
    samples: Samples,
    steps: Samples,
    magnetic: Samples,
    precision: PrecisionRates,
) -> tuple[Samples, Samples, int]:
    """
    Propagate the azimuth through a block of samples.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State from `gyro_azimuth_filter.initial`, changed in place; the result does not depend on the cut into blocks.
    samples : ndarray of dtype `sample.SAMPLE`, shape (n,)
        Samples; `gyro_turn` is filled where gravity and rates are known.
    steps : ndarray of dtype BIN_EVENT, shape (m,)
        Bins that close within the block.
    magnetic : ndarray of dtype MAGNETIC_AZIMUTH, shape (k,)
        Magnetic azimuths in order of their stamps: all in the bins' time, and possibly later ones.
    precision : PrecisionRates
        Rates of the precision unit in order of their stamps: all in the bins' time, and possibly later ones.

    Returns
    -------
    rows : ndarray of dtype AZIMUTH_ROW, shape (n,)
        Azimuth of each sample.
    propagated : ndarray of dtype PROPAGATED_AZIMUTH, shape (m,)
        Propagated azimuths at each bin.
    used : int
        Number of magnetic azimuths used; the caller passes the remaining ones again with the next block.
    """
    rows = np.zeros(len(samples), dtype=AZIMUTH_ROW)
    propagated = np.full(len(steps), np.nan, dtype=PROPAGATED_AZIMUTH)
    # Make the array contiguous, so that numba compiles one layout only: a slice of columns is contiguous if it has one
    # row, and not contiguous if it has more.
    precision = PrecisionRates(precision.stamp_ns, np.ascontiguousarray(precision.rate_t))
    used: int = _run(p, state, samples, steps, magnetic, precision, rows, propagated)
    return rows, propagated, used


def propagated_azimuth(state: Samples) -> PropagatedAzimuth:
    """Return the azimuths propagated to the last processed bin; state: as in `run`."""
    propagated = np.full(1, np.nan, dtype=PROPAGATED_AZIMUTH)
    _write_propagated(state[0], propagated[0])
    return PropagatedAzimuth(*propagated[0].item())


@compiled
def _write_propagated(s: GyroAzimuthState, row: Any) -> None:
    if s.have_station:
        row.station_azimuth, row.station_constant_sigma = s.x[Error.STATION], s.station_constant_sigma
        row.station_sigma = math.sqrt(max(s.P[Error.STATION, Error.STATION], 0.0))
    if s.have_azimuth:
        row.azimuth, row.sigma = s.x[Error.AZIMUTH], kalman_filter.azimuth_sigma(s)


@compiled
def _find_sums(s: GyroAzimuthState, bin_index: int) -> int:
    """Return the index in `s.sums` of the sums of a bin, or 0 if it has none; the caller must compare `bin`."""
    found = 0
    for j in range(BINS):
        if s.sums[j].bin == bin_index:
            found = j
    return found


@compiled
def _step(
    p: GyroAzimuthParams, s: GyroAzimuthState, step: BinEvent, precision: PrecisionRates, precision_used: int
) -> tuple[bool, int]:
    """
    Propagate the azimuth through one closed bin.

    Return whether the bin can have an azimuth (it has samples and the hole is not vertical), and the index of the first
    precision rate after the bin.
    """
    sums = s.sums[_find_sums(s, step.bin)]
    if sums.bin != step.bin:
        return False, precision_used
    missing = step.bin - s.last_bin - 1
    if s.last_bin != NO_BIN and missing > 0:
        gap = missing * p.bin_ns * 1e-9
        sums.gap += gap
        s.since_seen_s += gap
        s.since_used_s += gap
    s.last_bin, s.bin_gyro_turn = step.bin, sums.gyro_turn
    usable, precision_used = precision_sums(p, s, sums, precision, precision_used)
    s.since_seen_s += sums.time
    s.since_used_s += sums.time
    if sums.vertical:
        # A vertical hole has no azimuth; the azimuth restarts where the hole leaves the vertical.
        s.have_azimuth = s.have_station = False
    elif s.have_azimuth:
        kalman_filter.estimate_leakage(p, s, sums, 0)
        if usable:
            kalman_filter.estimate_leakage(p, s, s.precision_sums, 1)
            kalman_filter.propagate(p, s, s.precision_sums, 1)
        else:
            kalman_filter.propagate(p, s, sums, 0)
        kalman_filter.open_bias(s, sums)
    return not sums.vertical, precision_used


@compiled
def _take_magnetic(p: GyroAzimuthParams, s: GyroAzimuthState, measured: MagneticAzimuth) -> None:
    """
    Update the filter with a magnetic azimuth, propagated to the end of the last bin.

    Azimuths and sigmas that are not finite are ignored.
    """
    sigma = measured.sigma_slow + measured.sigma_held + measured.sigma_noise + measured.sigma_constant
    if math.isfinite(measured.azimuth + sigma) and sigma > 0.0:
        since = s.bin_gyro_turn - gyro_turn_at(s, measured.stamp_ns)
        kalman_filter.magnetic(p, s, measured, measured.azimuth + since)


@compiled
def _correct(p: GyroAzimuthParams, s: GyroAzimuthState, step: BinEvent, propagated: Any, has_azimuth: bool) -> None:
    """
    Correct the azimuth by a north seek and begin to propagate a station's azimuth, at the end of a bin.

    `propagated` is filled with the azimuths before the station is applied. has_azimuth: first result of `_step`.
    """
    if has_azimuth and math.isfinite(step.seek_azimuth) and step.seek_sigma > 0.0:
        kalman_filter.seek(p, s, step.seek_azimuth, step.seek_sigma)
    _write_propagated(s, propagated)
    if has_azimuth and math.isfinite(step.station.azimuth) and step.station.sigma > 0.0:
        kalman_filter.station(s, step.station)


@compiled
def _write(p: GyroAzimuthParams, s: GyroAzimuthState, sigma: float, across2: float, row: AzimuthRow) -> None:
    """
    Write the azimuth of a sample: NaN if there is none, near the vertical, or if its sigma is above `max_sigma`.

    sigma: 1 sigma of this azimuth, rad; across2: squared sine of the inclination.
    """
    row.status = np.uint32(0)
    if not s.have_azimuth or not across2 >= p.vertical_sin2:
        row.azimuth, row.sigma = math.nan, math.inf
        return
    row.azimuth, row.sigma = math.nan, min(math.pi, sigma)
    if sigma > p.max_sigma:
        row.status = np.uint32(_AIDED)
        return
    tau = 2.0 * math.pi
    # Wrap to [0, 2 pi). The angle is usually within one turn of this range, where a comparison is cheaper than `%`.
    now = s.x[Error.AZIMUTH] + (s.gyro_turn - s.bin_gyro_turn)
    now = now - tau if now >= tau else (now + tau if now < 0.0 else now)
    row.azimuth = now if 0.0 <= now < tau else now % tau
    row.status = np.uint32(s.mag_status | (_AIDED if s.since_used_s > p.mag_timeout_s else 0))


@compiled
def _run(
    p: GyroAzimuthParams,
    state: Samples,
    samples: Samples,
    steps: Samples,
    magnetic: Samples,
    precision: PrecisionRates,
    rows: Samples,
    propagated: Samples,
) -> int:
    """Fill `rows` and `propagated`, and return the number of magnetic azimuths used; arguments as in `run`."""
    s: GyroAzimuthState = state[0]
    used, precision_used, step = 0, 0, 0
    sigma = kalman_filter.azimuth_sigma(s)
    earth_north = p.earth_north * math.cos(s.x[Error.AZIMUTH])
    end = (s.last_ns // p.bin_ns + 1) * p.bin_ns if s.recent.length > 0 else NO_BIN
    for i in range(len(samples)):
        while step < len(steps) and steps[step].place <= i:
            has_azimuth, precision_used = _step(p, s, steps[step], precision, precision_used)
            bin_end = (steps[step].bin + 1) * p.bin_ns
            while used < len(magnetic) and magnetic[used].stamp_ns < bin_end:
                if has_azimuth:
                    _take_magnetic(p, s, magnetic[used])
                used += 1
            _correct(p, s, steps[step], propagated[step], has_azimuth)
            sigma = kalman_filter.azimuth_sigma(s)
            earth_north = p.earth_north * math.cos(s.x[Error.AZIMUTH])
            step += 1
        sample = samples[i]
        stamp, down = sample.stamp_ns, sample.down
        across2 = down[1] * down[1] + down[2] * down[2]
        fresh = s.recent.length == 0 or stamp > s.last_ns
        if fresh and math.isfinite(sample.gyro[1] + sample.gyro[2] + down[0] + across2):
            if stamp >= end:
                # Compute the end once a bin: a division for each sample would cost more than its sums.
                end = (stamp // p.bin_ns + 1) * p.bin_ns
                s.bins_opened += 1
                clear_sums(s.sums[s.bins_opened % BINS], stamp // p.bin_ns)
            add_sample(p, s, sample, earth_north)
        _write(p, s, sigma, across2, rows[i])
    return used

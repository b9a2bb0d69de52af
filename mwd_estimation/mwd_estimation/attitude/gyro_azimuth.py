# SPDX-License-Identifier: Apache-2.0
"""
Azimuth while drilling: propagated by the gyros and corrected by the magnetic azimuth, with its own sigma.

The filter (`gyro_azimuth_filter`) estimates the azimuth of the hole axis; bias and leakage of the cross-axis gyros of
both units; the slowly changing error of the magnetic azimuth (interference), which does not average out while the tool
stays in place; and the constant error of the magnetic azimuth (declination), which never averages out. Only the
cross-axis rates are used, so the x gyro may clip, and a rotating tool averages the biases out. A magnetic azimuth
beyond the innovation gate is not used. If magnetic azimuths that pass the field check stay beyond the gate, the azimuth
is reset to them, and the reset is counted.

The azimuth rate (`azimuth_rate`) is integrated sample by sample. The filter makes one step per closed bin of time, one
bin late, when the other streams of that time have arrived. Every sample gets the filter's azimuth propagated to its
stamp by the conventional gyro. The azimuth of the last accepted station is propagated without the magnetometer, for the
continuity check at the next station. Derivation and limits: ``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.attitude import azimuth_rate
from mwd_estimation.attitude import gyro_azimuth_filter as kalman_filter
from mwd_estimation.attitude.block import BinEvent
from mwd_estimation.attitude.gyro_azimuth_filter import (
    AZIMUTH_ROW,
    BINS,
    NO_BIN,
    PROPAGATED_AZIMUTH,
    AzimuthRow,
    Error,
    GyroAzimuthParams,
    GyroAzimuthState,
    MagneticAzimuth,
    PrecisionRates,
    PropagatedAzimuth,
)
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled

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
    """Return the index in `s.sums` of the sums of a bin; if the bin has no sums, an index with another bin's sums."""
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
    usable, precision_used = azimuth_rate.precision_sums(p, s, sums, precision, precision_used)
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
        since = s.bin_gyro_turn - azimuth_rate.gyro_turn_at(s, measured.stamp_ns)
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
                azimuth_rate.clear_sums(s.sums[s.bins_opened % BINS], stamp // p.bin_ns)
            azimuth_rate.add_sample(p, s, sample, earth_north)
        _write(p, s, sigma, across2, rows[i])
    return used

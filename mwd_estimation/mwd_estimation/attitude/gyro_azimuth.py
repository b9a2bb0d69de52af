# SPDX-License-Identifier: Apache-2.0
"""
Azimuth while drilling: propagated by the gyros, corrected by the magnetic azimuth, with its own sigma throughout.

The filter (`gyro_azimuth_filter`) estimates the azimuth of the hole axis, the bias and leakage of the cross-axis gyros
of the conventional and of the precision unit, the slowly changing error of the magnetic azimuth (interference), which
does not average out while the tool stays where it is, and the constant one (declination), which never does. Only the
cross-axis rates enter, so that the x gyro may clip and a turning tool modulates the biases out. A magnetic azimuth
beyond the innovation gate is not used; where good ones stay beyond it, the azimuth is reset to them and says so.

The rate of the azimuth (`azimuth_rate`) is integrated sample by sample; the filter itself steps once per closed bin of
time, one bin late, when the other streams of that time are there. Every sample is given the azimuth of the filter
propagated to its own time by the conventional gyro. The azimuth of the last accepted station is propagated without the
magnetometer, for the continuity check at the next one. Derivation and limits: ``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.attitude import azimuth_rate
from mwd_estimation.attitude import gyro_azimuth_filter as kalman_filter
from mwd_estimation.attitude.block import BinEvent
from mwd_estimation.attitude.gyro_azimuth_state import (
    AZIMUTH_ROW,
    BINS,
    NO_BIN,
    PROPAGATED_AZIMUTH,
    AzimuthRow,
    Error,
    MagneticAzimuth,
    Params,
    PrecisionRates,
    PropagatedAzimuth,
    State,
)
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled

_AIDED = int(Status.GYRO_AIDED)


def run(
    p: Params,
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
    p : Params
    state : ndarray, shape (1,)
        From `gyro_azimuth_state.initial`; changed in place. Blocks of any length give the same numbers.
    samples : ndarray of dtype `sample.SAMPLE`, shape (n,)
        `gyro_turn` is filled where gravity and rates are known.
    steps : ndarray of dtype BIN_EVENT, shape (m,)
        The bins that close within the block.
    magnetic : ndarray of dtype MAGNETIC_AZIMUTH, shape (k,)
        In order of their stamps: all of the bins' time, and later ones.
    precision : PrecisionRates
        Likewise.

    Returns
    -------
    rows : ndarray of dtype AZIMUTH_ROW, shape (n,)
    propagated : ndarray of dtype PROPAGATED_AZIMUTH, shape (m,)
        At each bin.
    used : int
        Magnetic azimuths taken; the rest is to be given again with the next block.
    """
    rows = np.zeros(len(samples), dtype=AZIMUTH_ROW)
    propagated = np.full(len(steps), np.nan, dtype=PROPAGATED_AZIMUTH)
    # One layout, and so one compilation: of a few columns, a single row is contiguous and several are not.
    precision = PrecisionRates(precision.stamp_ns, np.ascontiguousarray(precision.rate_t))
    used: int = _run(p, state[0], samples, steps, magnetic, precision, rows, propagated)
    return rows, propagated, used


def propagated_azimuth(state: Samples) -> PropagatedAzimuth:
    """Azimuths propagated to the last bin taken in."""
    propagated = np.full(1, np.nan, dtype=PROPAGATED_AZIMUTH)
    _write_propagated(state[0], propagated[0])
    return PropagatedAzimuth(*propagated[0].item())


@compiled
def _write_propagated(s: State, row: Any) -> None:
    if s.have_station:
        row.station_azimuth, row.station_constant_sigma = s.x[Error.STATION], s.station_constant_sigma
        row.station_sigma = math.sqrt(max(s.P[Error.STATION, Error.STATION], 0.0))
    if s.have_azimuth:
        row.azimuth, row.sigma = s.x[Error.AZIMUTH], math.sqrt(max(s.P[Error.AZIMUTH, Error.AZIMUTH], 0.0))


@compiled
def _find_sums(s: State, bin_index: int) -> int:
    """Place of a bin's sums; one of another bin where it has none."""
    found = 0
    for j in range(BINS):
        if s.sums[j].bin == bin_index:
            found = j
    return found


@compiled
def _step(p: Params, s: State, step: BinEvent, precision: PrecisionRates, precision_used: int) -> tuple[bool, int]:
    """Propagate through one closed bin; whether it has an azimuth, and the first precision rate of a later bin."""
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
        # No azimuth here, and none to propagate: it begins anew where the hole leaves the vertical.
        s.have_azimuth = s.have_station = False
    elif s.have_azimuth:
        kalman_filter.estimate_leakage(p, s, sums, 0)
        if usable:
            kalman_filter.estimate_leakage(p, s, s.precision_sums, 1)
            kalman_filter.propagate(p, s, s.precision_sums, 1)
        else:
            kalman_filter.propagate(p, s, sums, 0)
    return not sums.vertical, precision_used


@compiled
def _take_magnetic(p: Params, s: State, measured: MagneticAzimuth) -> None:
    """Take in a magnetic azimuth of the last bin, propagated to the end of the bin."""
    sigma = measured.sigma_slow + measured.sigma_held + measured.sigma_noise + measured.sigma_constant
    if math.isfinite(measured.azimuth + sigma) and sigma > 0.0:
        since = s.bin_gyro_turn - azimuth_rate.gyro_turn_at(s, measured.stamp_ns)
        kalman_filter.magnetic(p, s, measured, measured.azimuth + since)


@compiled
def _correct(p: Params, s: State, step: BinEvent, propagated: Any, has_azimuth: bool) -> None:
    """Take in a north seek and a station at the end of a bin; `propagated` is what held before the station."""
    if has_azimuth and math.isfinite(step.seek_azimuth) and step.seek_sigma > 0.0:
        kalman_filter.seek(p, s, step.seek_azimuth, step.seek_sigma)
    _write_propagated(s, propagated)
    if has_azimuth and math.isfinite(step.station.azimuth) and step.station.sigma > 0.0:
        kalman_filter.station(s, step.station)


@compiled
def _write(p: Params, s: State, sigma: float, across2: float, row: AzimuthRow) -> None:
    """Azimuth of the sample taken in last; across2: squared sine of its inclination."""
    row.status = np.uint32(0)
    if not s.have_azimuth or not across2 >= p.vertical_sin2:
        row.azimuth, row.sigma = math.nan, math.inf
        return
    row.azimuth, row.sigma = math.nan, min(math.pi, sigma)
    if sigma > p.max_sigma:
        row.status = np.uint32(_AIDED)
        return
    tau = 2.0 * math.pi
    # Within a turn of the range as a rule; the remainder costs more.
    now = s.x[Error.AZIMUTH] + (s.gyro_turn - s.bin_gyro_turn)
    now = now - tau if now >= tau else (now + tau if now < 0.0 else now)
    row.azimuth = now if 0.0 <= now < tau else now % tau
    row.status = np.uint32(s.mag_status | (_AIDED if s.since_used_s > p.mag_timeout_s else 0))


@compiled
def _run(
    p: Params,
    s: State,
    samples: Samples,
    steps: Samples,
    magnetic: Samples,
    precision: PrecisionRates,
    rows: Samples,
    propagated: Samples,
) -> int:
    """Arguments as in `run`, the last two are filled; returns how many magnetic azimuths were taken."""
    used, precision_used, step = 0, 0, 0
    sigma = math.sqrt(max(s.P[Error.AZIMUTH, Error.AZIMUTH], 0.0))
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
            sigma = math.sqrt(max(s.P[Error.AZIMUTH, Error.AZIMUTH], 0.0))
            earth_north = p.earth_north * math.cos(s.x[Error.AZIMUTH])
            step += 1
        sample = samples[i]
        stamp, down = sample.stamp_ns, sample.down
        across2 = down[1] * down[1] + down[2] * down[2]
        fresh = s.recent.length == 0 or stamp > s.last_ns
        if fresh and math.isfinite(sample.gyro[1] + sample.gyro[2] + down[0] + across2):
            if stamp >= end:
                # A division for each sample would cost more than its sums.
                end = (stamp // p.bin_ns + 1) * p.bin_ns
                s.bins_opened += 1
                azimuth_rate.clear_sums(s.sums[s.bins_opened % BINS], stamp // p.bin_ns)
            azimuth_rate.add_sample(p, s, sample, earth_north)
        _write(p, s, sigma, across2, rows[i])
    return used

"""
Azimuth while drilling, without a stop: carried by the gyros, corrected by the magnetic azimuth, honest in between.

The filter (`carried_filter`) knows the azimuth of the hole axis, the bias and leakage of the cross-axis gyros of the
conventional and of the precision unit, the slowly changing error of the magnetic azimuth (interference), which does not
average out while the tool stays where it is, and the constant one (declination), which never does. Only the cross-axis
rates enter, so that the x gyro may clip and a turning tool modulates the biases out. A magnetic azimuth beyond the
innovation gate is not used; one that stays away with its field in order is taken up again, and says so.

What turns the axis (`axis_turn`) is summed sample by sample; the filter itself steps once per closed bin of time, one
bin late, when the other streams of that time are there. Every sample is given the filter's azimuth carried on to its
own time by the conventional gyro. Beside it the azimuth of the last accepted station is carried on without the
magnetometer, for the next one to be held against. Derivation and limits: ``docs/fusion.md``.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.attitude import azimuth_rate as ax
from mwd_estimation.attitude import gyro_azimuth_filter as cf
from mwd_estimation.core import samples as track
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.settings import setting

_NONE = np.iinfo(np.int64).min
_AIDED = int(Status.GYRO_AIDED)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings; noise and bias are one sigma and belong to the conventional unit's y and z gyros."""

    gyro_noise_deg_rth: float = setting(0.42, "White noise, y and z", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    gyro_bias_deg_h: float = setting(400.0, "Bias not known to better than", unit="deg/h", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(10.0, "Bias random walk per root hour", unit="deg/h", low=0.0, high=1e4)
    gyro_leak_urad: float = setting(1000.0, "x rate that y and z feel", unit="urad", low=0.0, high=1e5)
    gyro_g_sensitivity_deg_h_g: float = setting(
        3.6, "g-sensitivity of y and z, each to itself", unit="deg/h/g", low=0.0, high=1e4
    )
    gyro_lag_ms: float = setting(0.5, "Lag of y and z behind the gravity found", unit="ms", low=0.0, high=100.0)
    magnetic_share: float = setting(
        0.95, "Share of the magnetic sigma that stays where no reference tells its parts apart", low=0.0, high=0.999
    )
    magnetic_memory_s: float = setting(14400.0, "Time in which what stays changes", unit="s", low=1.0, high=1e6)
    magnetic_held_s: float = setting(
        10.0, "Time for which an error of the vertical stays in the magnetic azimuth", unit="s", low=0.0, high=3600.0
    )
    gate_sigmas: float = setting(4.0, "Innovation beyond which a magnetic azimuth is not used", low=1.0, high=20.0)
    patience_s: float = setting(
        60.0, "Good azimuths gated out for so long are taken up again", unit="s", low=1.0, high=1e5
    )
    mag_timeout_s: float = setting(
        2.0, "Age of the magnetic azimuth that counts as none", unit="s", low=0.05, high=600.0
    )
    vertical_below_deg: float = setting(3.0, "Inclination without an azimuth", unit="deg", low=0.5, high=20.0)
    gap_s: float = setting(0.5, "A longer silence is bridged with a wide sigma", unit="s", low=0.01, high=60.0)
    gap_rate_dps: float = setting(
        0.05, "Rate at which the axis may have turned meanwhile", unit="deg/s", low=0.0, high=90.0
    )
    tilt_memory_s: float = setting(
        5.0, "Time for which an error of the gravity direction stays the same", unit="s", low=0.01, high=3600.0
    )
    widest_deg: float = setting(45.0, "An azimuth less certain is not given", unit="deg", low=1.0, high=180.0)


@dataclasses.dataclass(frozen=True)
class Precision:
    """
    A precision unit's y and z gyros.

    Noise, deg/sqrt(h), bias, deg/h, its walk, deg/h per sqrt(h), range, deg/s, x rate that they feel, urad,
    g-sensitivity, deg/h/g, and lag behind the conventional unit, ms.
    """

    noise_deg_rth: float = 0.05
    bias_deg_h: float = 5.0
    walk_deg_h_rth: float = 0.5
    range_dps: float = 100.0
    leak_urad: float = 300.0
    g_sensitivity_deg_h_g: float = 0.5
    lag_ms: float = 2.0


@dataclasses.dataclass
class State:
    """All that changes: clock, states, their covariance, memory, sums of the last bins, the last samples."""

    clock: Stamps
    x: Array
    P: Array
    memory: Array
    sums: Array
    carried: Array
    ring_ns: Stamps
    ring: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Steps:
    """
    The bins that close within a block, and what was measured in their time.

    Attributes
    ----------
    place, bin : ndarray of int64, shape (m,)
        Sample of the block from which on a bin's step holds, rising, and the bin's index.
    seek_azimuth, seek_sigma : ndarray, shape (m,)
        Azimuth that owes nothing to the magnetometer (a north seek), rad from the named north; NaN where there is none.
    station : ndarray, shape (m, 4)
        Azimuth of an accepted station, its sigma, the part of that which every magnetic azimuth errs by, rad, and 1
        where a gyro found north there: from here on carried to the next one; NaN where there is none.
    mag_ns, mag_azimuth, mag_sigma : ndarray, shapes (p,), (p,) and (p, 4)
        Magnetic azimuths in order of their stamps, raw or corrected, from the named north; sigma of the part of their
        error that stays (the tool's own field), that stays for a while (the vertical's), of the noise, and of the part
        that never changes (the declination), rad. All of the bins' time, and later ones.
    mag_good, mag_afresh : ndarray of bool, shape (p,)
        Not good where the field fails its check: then never used. Afresh where what was said before is withdrawn: the
        azimuth begins anew.
    precision_ns, precision_t : ndarray, shapes (q,) and (q, 3)
        Rates of the precision unit, rad/s, likewise.
    """

    place: Stamps
    bin: Stamps
    seek_azimuth: Array
    seek_sigma: Array
    station: Array
    mag_ns: Stamps
    mag_azimuth: Array
    mag_sigma: Array
    mag_good: NDArray[np.bool_]
    mag_afresh: NDArray[np.bool_]
    precision_ns: Stamps
    precision_t: Array


@dataclasses.dataclass(frozen=True)
class Rows:
    """
    Azimuth of n samples.

    Attributes
    ----------
    azimuth : ndarray, shape (n,)
        Of the hole axis from the north of the azimuths fed in, rad in [0, 2 pi); NaN where there is none.
    sigma : ndarray, shape (n,)
        One sigma, rad, at most pi; infinite where none is carried, because none was ever known or the hole is vertical.
    status : ndarray of uint32, shape (n,)
        GYRO_AIDED: carried by the gyros alone. MAG_DISTURBED: the last magnetic azimuth was not used.
    anchor : ndarray, shape (m, 5)
        At each of the m bins, the azimuth that the last accepted station gave, carried on by the gyros alone; its sigma
        and the part of that which every magnetic azimuth errs by; and the azimuth of these rows and its sigma, rad; NaN
        where there is none.
    """

    azimuth: Array
    sigma: Array
    status: NDArray[np.uint32]
    anchor: Array


def initial() -> State:
    """State before the first sample."""
    memory = np.zeros(cf.MEMORY)
    memory[cf.LAST_BIN] = -math.inf
    sums = np.zeros((ax.BINS, ax.SUMS))
    sums[:, ax.S_BIN] = -math.inf
    return State(
        np.zeros(ax.CLOCK, dtype=np.int64),
        np.zeros(cf.STATES),
        np.zeros((cf.STATES, cf.STATES)),
        memory,
        sums,
        np.zeros(1),
        np.zeros(ax.RING, dtype=np.int64),
        np.zeros((ax.RING, ax.RING_ROW)),
    )


def anchor_of(state: State) -> Array:
    """What is carried on, shape (5,): as `Rows.anchor`, of the last bin taken in."""
    anchor = np.full(5, np.nan)
    _tell_anchor(state.x, state.P, state.memory, anchor)
    return anchor


def run(
    k: Array,
    bin_ns: int,
    gap_ns: int,
    state: State,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    g_t: ArrayLike,
    sigma_tilt: ArrayLike,
    steps: Steps,
) -> tuple[Rows, int]:
    """
    Carry the azimuth through a block of samples.

    Parameters
    ----------
    k : ndarray
        From `kernel_settings`.
    bin_ns, gap_ns : int
        Length of a bin; a longer silence is a gap.
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t : array_like, shape (n, 3)
        Angular rate of the conventional unit, rad/s, in tool axes; x counts only for what leaks of it into y and z.
    g_t, sigma_tilt : array_like, shapes (n, 3) and (n,)
        Unit vector down in tool axes from a gravity method, NaN before it has one, and its 1 sigma, rad.
    steps : Steps

    Returns
    -------
    rows : Rows
    used : int
        Magnetic azimuths taken; the rest is to be given again with the next block.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, down = track.samples(stamp_ns, gyro_t, g_t)
    n = len(stamps)
    tilt = np.ascontiguousarray(sigma_tilt, dtype=np.float64)
    if tilt.shape != (n,):
        raise ValueError(f"sigma_tilt: expected shape ({n},), got {tilt.shape}")
    rows = Rows(np.empty(n), np.empty(n), np.zeros(n, dtype=np.uint32), np.full((len(steps.place), 5), np.nan))
    # One layout, and so one compilation: of a few columns, a single row is contiguous and several are not.
    fine_t = np.ascontiguousarray(steps.precision_t)
    used = _run(
        k, bin_ns, gap_ns, state.clock, state.x, state.P, state.memory, state.sums, state.carried, state.ring_ns,
        state.ring, stamps, gyro, down, tilt, steps.place, steps.bin, steps.seek_azimuth, steps.seek_sigma,
        steps.station, steps.mag_ns, steps.mag_azimuth, steps.mag_sigma, steps.mag_good, steps.mag_afresh,
        steps.precision_ns, fine_t, rows.azimuth, rows.sigma, rows.status, rows.anchor,
    )  # fmt: skip
    return rows, used


def kernel_settings(
    params: Params, latitude_deg: float | None, precision: Precision | None = None, interval_s: float = 0.2
) -> Array:
    """
    Settings in SI, in the order of the K_ names, shape (SETTINGS,).

    latitude_deg: None where unknown; what the Earth's rotation does to the azimuth then counts as drift.
    interval_s: between magnetic azimuths.
    """
    k = np.zeros(cf.SETTINGS)
    unknown = 0.0 if latitude_deg is not None else EARTH_RATE
    if latitude_deg is not None:
        latitude = math.radians(latitude_deg)
        k[cf.K_NORTH], k[cf.K_DOWN] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    fine = precision or Precision()
    conventional = Precision(
        params.gyro_noise_deg_rth, params.gyro_bias_deg_h, params.gyro_walk_deg_h_rth, leak_urad=params.gyro_leak_urad,
        g_sensitivity_deg_h_g=params.gyro_g_sensitivity_deg_h_g, lag_ms=params.gyro_lag_ms,
    )  # fmt: skip
    for at, unit in enumerate((conventional, fine)):
        k[cf.K_NOISE + at] = unit.noise_deg_rth * DEG_PER_ROOT_HOUR
        k[cf.K_BIAS + at] = unit.bias_deg_h * DEG_PER_HOUR
        k[cf.K_WALK + at] = unit.walk_deg_h_rth * DEG_PER_HOUR / 60.0
        k[cf.K_LEAK + at], k[cf.K_LAG + at] = unit.leak_urad * 1e-6, unit.lag_ms * 1e-3
        # The mean of the sensitivities of y to y and of z to z is felt whatever the toolface, and the Earth's turn.
        k[cf.K_DRIFT + at] = math.hypot(unit.g_sensitivity_deg_h_g * DEG_PER_HOUR * math.sqrt(0.5), unknown)
    k[cf.K_RANGE] = 0.98 * math.radians(fine.range_dps)
    k[cf.K_OFTEN] = max(2.0 * params.magnetic_held_s / interval_s, 1.0)
    k[cf.K_TAU], k[cf.K_GATE] = params.magnetic_memory_s, params.gate_sigmas
    k[cf.K_PATIENCE], k[cf.K_TIMEOUT] = params.patience_s, params.mag_timeout_s
    k[cf.K_VERTICAL] = math.sin(math.radians(params.vertical_below_deg)) ** 2
    k[cf.K_GAP_RATE], k[cf.K_TILT_MEMORY] = math.radians(params.gap_rate_dps), params.tilt_memory_s
    k[cf.K_WIDEST] = math.radians(params.widest_deg)
    return k


@compiled
def _tell_anchor(x: Array, P: Array, m: Array, anchor: Array) -> None:
    if m[cf.ANCHORED] != 0.0:
        anchor[0], anchor[2] = x[cf.ANCHOR], m[cf.ANCHOR_LASTING]
        anchor[1] = math.sqrt(max(P[cf.ANCHOR, cf.ANCHOR], 0.0))
    if m[cf.HAVE] != 0.0:
        anchor[3], anchor[4] = x[cf.AZIMUTH], math.sqrt(max(P[cf.AZIMUTH, cf.AZIMUTH], 0.0))


@compiled
def _step(
    k: Array, bin_ns: int, clock: Stamps, x: Array, P: Array, m: Array, bins: Array, ring_ns: Stamps, ring: Array,
    index: int, seek_azimuth: float, seek_sigma: float, told: Array, anchor: Array, mag_ns: Stamps, mag_azimuth: Array,
    mag_sigma: Array, mag_good: NDArray[np.bool_], mag_afresh: NDArray[np.bool_], used: int,
    fine_ns: Stamps, fine_t: Array, fine_used: int, fine: Array,
) -> tuple[int, int]:  # fmt: skip
    """Take in one closed bin: its turn, the magnetic azimuths of its time, then a north seek and a station."""
    row = 0
    for j in range(ax.BINS):
        if bins[j, ax.S_BIN] == index:
            row = j
    sums = bins[row]
    end = (index + 1) * bin_ns
    there = sums[ax.S_BIN] == index
    if there:
        silent = index - m[cf.LAST_BIN] - 1.0
        if math.isfinite(silent) and silent > 0.0:
            sums[ax.S_GAP] += silent * bin_ns * 1e-9
            m[cf.SINCE_SEEN] += silent * bin_ns * 1e-9
            m[cf.SINCE_USED] += silent * bin_ns * 1e-9
        m[cf.LAST_BIN], m[cf.LAST_CARRIED] = index, sums[ax.S_CARRIED]
        usable, fine_used = ax.precision_sums(
            k[cf.K_RANGE], k[cf.K_VERTICAL], sums, fine, bin_ns, ring_ns, ring, clock, fine_ns, fine_t, fine_used
        )
        m[cf.SINCE_SEEN] += sums[ax.S_TIME]
        m[cf.SINCE_USED] += sums[ax.S_TIME]
        if sums[ax.S_VERTICAL] > 0.0:
            # No azimuth here, and none to carry: it begins anew where the hole leaves the vertical.
            m[cf.HAVE] = m[cf.ANCHORED] = 0.0
        elif m[cf.HAVE] != 0.0:
            cf.spun(k, x, P, sums, 0)
            if usable:
                cf.spun(k, x, P, fine, 1)
                cf.propagate(k, x, P, fine, 1)
            else:
                cf.propagate(k, x, P, sums, 0)
    while used < len(mag_ns) and mag_ns[used] < end:
        known = math.isfinite(mag_azimuth[used] + mag_sigma[used].sum()) and mag_sigma[used].sum() > 0.0
        if there and known and sums[ax.S_VERTICAL] == 0.0:
            since = sums[ax.S_CARRIED] - ax.carried_at(ring_ns, ring, clock[ax.HEAD], clock[ax.LENGTH], mag_ns[used])
            cf.magnetic(
                k, x, P, m, mag_azimuth[used] + since, mag_sigma[used], mag_good[used], mag_afresh[used]
            )  # fmt: skip
        used += 1
    if there and math.isfinite(seek_azimuth) and seek_sigma > 0.0 and sums[ax.S_VERTICAL] == 0.0:
        cf.seek(k, x, P, m, seek_azimuth, seek_sigma)
    _tell_anchor(x, P, m, anchor)
    if there and math.isfinite(told[0]) and told[1] > 0.0 and sums[ax.S_VERTICAL] == 0.0:
        cf.station(x, P, m, told[0], told[1], told[2], told[3] > 0.0)
    return used, fine_used


@compiled
def _run(
    k: Array, bin_ns: int, gap_ns: int, clock: Stamps, x: Array, P: Array, m: Array, bins: Array, carried: Array,
    ring_ns: Stamps, ring: Array, stamps: Stamps, gyro: Array, down: Array, tilt: Array, place: Stamps, bin_at: Stamps,
    seek_azimuth: Array, seek_sigma: Array, told: Array, mag_ns: Stamps, mag_azimuth: Array, mag_sigma: Array,
    mag_good: NDArray[np.bool_], mag_afresh: NDArray[np.bool_], fine_ns: Stamps, fine_t: Array,
    azimuth: Array, sigma: Array, status: NDArray[np.uint32], anchor: Array,
) -> int:  # fmt: skip
    fine = np.zeros(ax.SUMS)
    used, fine_used, step = 0, 0, 0
    tau = 2.0 * math.pi
    spread = math.sqrt(max(P[cf.AZIMUTH, cf.AZIMUTH], 0.0))
    start, since = x[cf.AZIMUTH], m[cf.LAST_CARRIED]
    earth_north = k[cf.K_NORTH] * math.cos(x[cf.AZIMUTH])
    open_bin = clock[ax.LAST_NS] // bin_ns if clock[ax.LENGTH] > 0 else _NONE
    end = (open_bin + 1) * bin_ns if clock[ax.LENGTH] > 0 else _NONE
    for i in range(len(stamps)):
        while step < len(place) and place[step] <= i:
            used, fine_used = _step(
                k, bin_ns, clock, x, P, m, bins, ring_ns, ring, bin_at[step], seek_azimuth[step], seek_sigma[step],
                told[step], anchor[step], mag_ns, mag_azimuth, mag_sigma, mag_good, mag_afresh, used,
                fine_ns, fine_t, fine_used, fine,
            )  # fmt: skip
            spread = math.sqrt(max(P[cf.AZIMUTH, cf.AZIMUTH], 0.0))
            start, since = x[cf.AZIMUTH], m[cf.LAST_CARRIED]
            earth_north = k[cf.K_NORTH] * math.cos(x[cf.AZIMUTH])
            step += 1
        stamp, wx, wy, wz = stamps[i], gyro[i, 0], gyro[i, 1], gyro[i, 2]
        dx, dy, dz = down[i, 0], down[i, 1], down[i, 2]
        across2 = dy * dy + dz * dz
        fresh = clock[ax.LENGTH] == 0 or stamp > clock[ax.LAST_NS]
        if fresh and math.isfinite(wy + wz + dx + across2):
            wx = wx if math.isfinite(wx) else 0.0
            if stamp >= end:
                open_bin = stamp // bin_ns
                end = (open_bin + 1) * bin_ns
                clock[ax.OPENED] += 1
                for j in range(ax.SUMS):
                    bins[clock[ax.OPENED] % ax.BINS, j] = 0.0
                bins[clock[ax.OPENED] % ax.BINS, ax.S_BIN] = open_bin
            sums = bins[clock[ax.OPENED] % ax.BINS]
            if across2 < k[cf.K_VERTICAL]:
                sums[ax.S_VERTICAL] = 1.0
            elif clock[ax.LENGTH] > 0:
                dt = (stamp - clock[ax.LAST_NS]) * 1e-9
                if stamp - clock[ax.LAST_NS] <= gap_ns:
                    inverse = 1.0 / across2
                    share = dt * inverse
                    turn, y, z = (wy * dy + wz * dz) * share, dy * share, dz * share
                    earth = dx * math.sqrt(across2) * share
                    mistaken = (wy * dz - wz * dy) * inverse * tilt[i]
                    sums[ax.S_TURN] += turn
                    sums[ax.S_Y] += y
                    sums[ax.S_Z] += z
                    sums[ax.S_TIME] += dt
                    sums[ax.S_EARTH] += earth
                    sums[ax.S_NOISE] += share
                    sums[ax.S_TILT] += mistaken * mistaken * dt
                    sums[ax.S_XY] += wx * y
                    sums[ax.S_XZ] += wx * z
                    sums[ax.S_SPIN] += wx * dt
                    sums[ax.S_RATE_Y] += wy * dt
                    sums[ax.S_RATE_Z] += wz * dt
                    sums[ax.S_LAG] += wx * (wy * dz - wz * dy) * share
                    turn -= (x[cf.BIAS] + x[cf.LEAK] * wx) * y + (x[cf.BIAS + 1] + x[cf.LEAK + 1] * wx) * z
                    carried[0] += turn - (k[cf.K_DOWN] + x[cf.DRIFT]) * dt + earth_north * earth
                else:
                    sums[ax.S_GAP] += dt
            sums[ax.S_CARRIED] = carried[0]
            head = clock[ax.HEAD]
            ring_ns[head] = stamp
            ring[head, 0], ring[head, 1], ring[head, 2] = dx, dy, dz
            ring[head, ax.R_CARRIED], ring[head, ax.R_SPIN] = carried[0], wx
            clock[ax.HEAD] = (head + 1) & (ax.RING - 1)
            clock[ax.LENGTH] = min(clock[ax.LENGTH] + 1, ax.RING)
            clock[ax.LAST_NS] = stamp
        if m[cf.HAVE] == 0.0 or not across2 >= k[cf.K_VERTICAL]:
            azimuth[i], sigma[i], status[i] = math.nan, math.inf, 0
        elif spread > k[cf.K_WIDEST]:
            azimuth[i], sigma[i], status[i] = math.nan, min(math.pi, spread), _AIDED
        else:
            # Within a turn of the range as a rule; the remainder costs more.
            now = start + (carried[0] - since)
            now = now - tau if now >= tau else (now + tau if now < 0.0 else now)
            azimuth[i] = now if 0.0 <= now < tau else now % tau
            sigma[i] = min(math.pi, spread)
            status[i] = int(m[cf.BITS]) | (_AIDED if m[cf.SINCE_USED] > k[cf.K_TIMEOUT] else 0)
    return used

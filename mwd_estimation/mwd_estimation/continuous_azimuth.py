"""
Azimuth while drilling, without a stop: carried by the gyros, corrected by the magnetic azimuth, honest in between.

Seven states: azimuth of the hole axis, bias of the two cross-axis gyros of the conventional and of the precision unit,
the slowly changing error of the magnetic azimuth (interference), which does not average out while the tool stays where
it is, and the constant one (declination), which never does. Only the cross-axis rates enter, so that the x gyro may
clip and a turning tool modulates the biases out. A magnetic azimuth beyond the innovation gate is not used; one that
stays away with its field in order is taken up again, and says so.

What turns the axis is summed sample by sample; the filter itself steps once per closed bin of time, one bin late, when
the other streams of that time are there. Every sample is given the filter's azimuth carried on to its own time by the
conventional gyro. Derivation and limits: ``docs/fusion.md``.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation import track
from mwd_estimation.north_ekf import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_estimation.status import Status
from mwd_estimation.track import Array, Stamps
from mwd_sensors.compiled import compiled
from mwd_sensors.settings import setting

# States: azimuth, rad; bias y and z of the conventional and of the precision gyros, rad/s; slow and constant magnetic
# error, each in units of its own sigma.
AZIMUTH, BIAS, PRECISION_BIAS, ERROR, CONSTANT, STATES = 0, 1, 3, 5, 6, 7
# Memory: a first azimuth exists; seconds since the last magnetic azimuth used, and since the last seen; seconds for
# which good ones have been gated out; last innovation ratio; counts of gated, failed and taken-up-again azimuths; bits
# of the last magnetic azimuth; last bin taken in, and the carried turn at its end; sigma of the last magnetic azimuth;
# whether the azimuth rests on a north seek and the gyros alone.
HAVE, SINCE_USED, SINCE_SEEN, REFUSING, RATIO, GATED, FAILED, TAKEN_UP, BITS, LAST_BIN = range(10)
LAST_CARRIED, LAST_SIGMA, SOUGHT, MEMORY = 10, 11, 12, 13
# Settings handed to the kernel; the gyros' noise, bias and walk stand twice, conventional then precision.
K_NORTH, K_DOWN, K_SHARE, K_TAU, K_GATE, K_PATIENCE, K_TIMEOUT, K_VERTICAL, K_GAP_RATE, K_TILT_MEMORY = range(10)
K_NOISE, K_BIAS, K_WALK, K_RANGE, K_WIDEST, SETTINGS = 10, 12, 14, 16, 17, 18
# Sums of a bin: its index; turn of the axis as the gyros say; integrals of d_y / across^2, d_z / across^2, time,
# d_x / across, 1 / across^2 and of the squared rate that a tilted vertical mistakes; seconds of gaps; carried turn at
# its end; whether the hole was vertical in it.
S_BIN, S_TURN, S_Y, S_Z, S_TIME, S_EARTH, S_NOISE, S_TILT, S_GAP, S_CARRIED, S_VERTICAL, SUMS = range(12)
_BINS = 4  # bins whose sums are kept: the open one, those that wait, and one to spare
_RING = 8192  # samples kept for pairing with other streams: 1.5 s at 5 kHz; a power of two
_LAST_NS, _HEAD, _LENGTH, _OPENED, _CLOCK = range(5)
_NONE = np.iinfo(np.int64).min

_DISTURBED, _AIDED = int(Status.MAG_DISTURBED), int(Status.GYRO_AIDED)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings; noise and bias are one sigma and belong to the conventional unit's y and z gyros."""

    gyro_noise_deg_rth: float = setting(0.42, "White noise, y and z", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    gyro_bias_deg_h: float = setting(100.0, "Bias not known to better than", unit="deg/h", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(10.0, "Bias random walk per root hour", unit="deg/h", low=0.0, high=1e4)
    magnetic_share: float = setting(
        0.95, "Share of the magnetic sigma that stays the same from sample to sample", low=0.0, high=0.999
    )
    magnetic_memory_s: float = setting(14400.0, "Time in which that share changes", unit="s", low=1.0, high=1e6)
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
    """Noise, deg/sqrt(h), bias, deg/h, its walk, deg/h per sqrt(h), and range, deg/s, of a precision unit's y, z."""

    noise_deg_rth: float = 0.05
    bias_deg_h: float = 5.0
    walk_deg_h_rth: float = 0.5
    range_dps: float = 100.0


@dataclasses.dataclass
class State:
    """All that changes: clock, seven states, their covariance, memory, sums of the last bins, the last samples."""

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
    mag_ns, mag_azimuth, mag_sigma, mag_constant : ndarray, shape (p,)
        Magnetic azimuths in order of their stamps, raw or corrected, from the named north; their sigma less the part
        that never changes (the declination's), and that part, rad. All of the bins' time, and later ones.
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
    mag_ns: Stamps
    mag_azimuth: Array
    mag_sigma: Array
    mag_constant: Array
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
    """

    azimuth: Array
    sigma: Array
    status: NDArray[np.uint32]


def initial() -> State:
    """State before the first sample."""
    memory = np.zeros(MEMORY)
    memory[LAST_BIN] = -math.inf
    sums = np.zeros((_BINS, SUMS))
    sums[:, S_BIN] = -math.inf
    return State(
        np.zeros(_CLOCK, dtype=np.int64),
        np.zeros(STATES),
        np.zeros((STATES, STATES)),
        memory,
        sums,
        np.zeros(1),
        np.zeros(_RING, dtype=np.int64),
        np.zeros((_RING, 4)),
    )


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
        Angular rate of the conventional unit, rad/s, in tool axes; x is not used.
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
    rows = Rows(np.empty(n), np.empty(n), np.zeros(n, dtype=np.uint32))
    used = _run(
        k, bin_ns, gap_ns, state.clock, state.x, state.P, state.memory, state.sums, state.carried, state.ring_ns,
        state.ring, stamps, gyro, down, tilt, steps.place, steps.bin, steps.seek_azimuth, steps.seek_sigma,
        steps.mag_ns, steps.mag_azimuth, steps.mag_sigma, steps.mag_constant, steps.mag_good, steps.mag_afresh,
        steps.precision_ns, steps.precision_t, rows.azimuth, rows.sigma, rows.status,
    )  # fmt: skip
    return rows, used


def kernel_settings(params: Params, latitude_deg: float | None, precision: Precision | None = None) -> Array:
    """
    Settings in SI, in the order of the K_ names, shape (SETTINGS,).

    latitude_deg: None where unknown; what the Earth's rotation does to the azimuth then counts as gyro bias.
    """
    k = np.zeros(SETTINGS)
    unknown = 0.0 if latitude_deg is not None else EARTH_RATE
    if latitude_deg is not None:
        latitude = math.radians(latitude_deg)
        k[K_NORTH], k[K_DOWN] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    fine = precision or Precision()
    for at, noise, bias, walk in (
        (0, params.gyro_noise_deg_rth, params.gyro_bias_deg_h, params.gyro_walk_deg_h_rth),
        (1, fine.noise_deg_rth, fine.bias_deg_h, fine.walk_deg_h_rth),
    ):
        k[K_NOISE + at] = noise * DEG_PER_ROOT_HOUR
        k[K_BIAS + at] = math.hypot(bias * DEG_PER_HOUR, unknown)
        k[K_WALK + at] = walk * DEG_PER_HOUR / 60.0
    k[K_RANGE] = 0.98 * math.radians(fine.range_dps)
    k[K_SHARE], k[K_TAU], k[K_GATE] = params.magnetic_share, params.magnetic_memory_s, params.gate_sigmas
    k[K_PATIENCE], k[K_TIMEOUT] = params.patience_s, params.mag_timeout_s
    k[K_VERTICAL] = math.sin(math.radians(params.vertical_below_deg)) ** 2
    k[K_GAP_RATE], k[K_TILT_MEMORY] = math.radians(params.gap_rate_dps), params.tilt_memory_s
    k[K_WIDEST] = math.radians(params.widest_deg)
    return k


@compiled
def _begin(k: Array, x: Array, P: Array, m: Array) -> None:
    for i in range(STATES):
        x[i] = 0.0
        for j in range(STATES):
            P[i, j] = 0.0
    for i in range(2):
        P[BIAS + i, BIAS + i] = k[K_BIAS] ** 2
        P[PRECISION_BIAS + i, PRECISION_BIAS + i] = k[K_BIAS + 1] ** 2
    P[ERROR, ERROR] = P[CONSTANT, CONSTANT] = 1.0
    m[HAVE] = 1.0


@compiled
def _correct(k: Array, x: Array, P: Array, m: Array, slow: float, lasting: float, azimuth: float, r2: float) -> bool:
    """
    Update by an azimuth = x[AZIMUTH] + slow x[ERROR] + lasting x[CONSTANT] + noise.

    False, with nothing changed, beyond the gate.
    """
    ph = np.zeros(STATES)
    for i in range(STATES):
        ph[i] = P[i, AZIMUTH] + slow * P[i, ERROR] + lasting * P[i, CONSTANT]
    s = ph[AZIMUTH] + slow * ph[ERROR] + lasting * ph[CONSTANT] + r2
    innovation = azimuth - x[AZIMUTH] - slow * x[ERROR] - lasting * x[CONSTANT]
    innovation = (innovation + math.pi) % (2.0 * math.pi) - math.pi
    m[RATIO] = abs(innovation) / math.sqrt(s)
    if m[RATIO] > k[K_GATE]:
        return False
    for i in range(STATES):
        x[i] += ph[i] / s * innovation
        for j in range(STATES):
            P[i, j] -= ph[i] * ph[j] / s
    x[AZIMUTH] %= 2.0 * math.pi
    return True


@compiled
def _fade(x: Array, P: Array, share: float) -> None:
    """Let all but a share of the slow magnetic error be another one."""
    x[ERROR] *= share
    for j in range(STATES):
        if j != ERROR:
            P[ERROR, j] *= share
            P[j, ERROR] = P[ERROR, j]
    P[ERROR, ERROR] = 1.0 + share * share * (P[ERROR, ERROR] - 1.0)


@compiled
def _propagate(k: Array, x: Array, P: Array, sums: Array, unit: int) -> None:
    """
    Through one bin; unit 0: conventional gyros, 1: precision gyros.

    azimuth += turn - bias . (Y, Z) - K_DOWN time + K_NORTH cos(azimuth) EARTH: of the rate about the vertical the part
    that moves the axis, (w - w_ie) . (d - (d.x) x) / sin^2(I), summed over the bin; the x rate drops out.
    """
    at = BIAS if unit == 0 else PRECISION_BIAS
    f_0 = 1.0 - k[K_NORTH] * math.sin(x[AZIMUTH]) * sums[S_EARTH]
    earth = -k[K_DOWN] * sums[S_TIME] + k[K_NORTH] * math.cos(x[AZIMUTH]) * sums[S_EARTH]
    x[AZIMUTH] += sums[S_TURN] - x[at] * sums[S_Y] - x[at + 1] * sums[S_Z] + earth
    x[AZIMUTH] %= 2.0 * math.pi
    row = np.zeros(STATES)
    for j in range(STATES):
        row[j] = f_0 * P[AZIMUTH, j] - sums[S_Y] * P[at, j] - sums[S_Z] * P[at + 1, j]
    own = f_0 * row[AZIMUTH] - sums[S_Y] * row[at] - sums[S_Z] * row[at + 1]
    for j in range(STATES):
        P[AZIMUTH, j] = P[j, AZIMUTH] = row[j]
    P[AZIMUTH, AZIMUTH] = own
    _fade(x, P, math.exp(-sums[S_TIME] / k[K_TAU]))
    # Gyro noise; the cross-axis rate that an error of the gravity direction mistakes for azimuth; silence.
    P[AZIMUTH, AZIMUTH] += k[K_NOISE + unit] ** 2 * sums[S_NOISE] + 2.0 * k[K_TILT_MEMORY] * sums[S_TILT]
    P[AZIMUTH, AZIMUTH] += (k[K_GAP_RATE] * sums[S_GAP]) ** 2
    for i in range(2):
        P[BIAS + i, BIAS + i] += k[K_WALK] ** 2 * sums[S_TIME]
        P[PRECISION_BIAS + i, PRECISION_BIAS + i] += k[K_WALK + 1] ** 2 * sums[S_TIME]


@compiled
def _magnetic(
    k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: float, lasting: float, good: bool, afresh: bool
) -> None:
    """Take in one magnetic azimuth."""
    slow, fast2 = sigma * k[K_SHARE], sigma * sigma * (1.0 - k[K_SHARE] ** 2)
    m[BITS] = _DISTURBED
    if afresh:
        m[HAVE] = 0.0
    if good and m[HAVE] != 0.0 and m[LAST_SIGMA] > 0.0:
        # Who learns errs less and less: of the error of before this share is left in it, in units of the sigma of now.
        _fade(x, P, min(sigma / m[LAST_SIGMA], m[LAST_SIGMA] / sigma))
    if good:
        m[LAST_SIGMA] = sigma
    if not good:
        m[FAILED] += 1.0
        m[REFUSING] = 0.0
    elif m[HAVE] == 0.0:
        _begin(k, x, P, m)
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        # azimuth read = azimuth + slow * error + lasting * constant + noise: the first estimate errs by minus these.
        P[AZIMUTH, AZIMUTH] = sigma * sigma + lasting * lasting
        P[AZIMUTH, ERROR] = P[ERROR, AZIMUTH] = -slow
        P[AZIMUTH, CONSTANT] = P[CONSTANT, AZIMUTH] = -lasting
        m[BITS] = 0.0
    elif _correct(k, x, P, m, slow, lasting, azimuth, fast2):
        m[BITS] = 0.0
    else:
        m[GATED] += 1.0
        # Between two samples at most the time-out counts, so that a drop-out is no evidence.
        m[REFUSING] += min(m[SINCE_SEEN], k[K_TIMEOUT])
        if m[REFUSING] > k[K_PATIENCE]:
            # Steadily elsewhere with its field in order: the carried azimuth is wrong by more than it said.
            m[TAKEN_UP] += 1.0
            innovation = azimuth - x[AZIMUTH] - slow * x[ERROR] - lasting * x[CONSTANT]
            innovation = (innovation + math.pi) % (2.0 * math.pi) - math.pi
            P[AZIMUTH, AZIMUTH] += innovation * innovation
            _correct(k, x, P, m, slow, lasting, azimuth, fast2)
            m[BITS] = 0.0
    m[SINCE_SEEN] = 0.0
    if m[BITS] == 0.0:
        m[SOUGHT] = 0.0
        m[REFUSING] = 0.0
        m[SINCE_USED] = 0.0


@compiled
def _seek(k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: float) -> None:
    """
    Take in an azimuth that owes nothing to the magnetometer; one beyond the gate is begun anew from.

    Seeks of one gyro err alike: where the azimuth rests on an earlier one, the better of both stands, not their mean.
    """
    if m[HAVE] == 0.0:
        _begin(k, x, P, m)
        P[AZIMUTH, AZIMUTH] = math.pi * math.pi
        x[AZIMUTH] = azimuth
    alone = m[SOUGHT] != 0.0
    m[SOUGHT] = 1.0
    away = (azimuth - x[AZIMUTH] + math.pi) % (2.0 * math.pi) - math.pi
    agrees = away * away <= k[K_GATE] ** 2 * (P[AZIMUTH, AZIMUTH] + sigma * sigma)
    if alone and agrees and sigma * sigma >= P[AZIMUTH, AZIMUTH]:
        return
    if alone or not _correct(k, x, P, m, 0.0, 0.0, azimuth, sigma * sigma):
        m[TAKEN_UP] += 0.0 if agrees else 1.0
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        for i in range(STATES):
            P[AZIMUTH, i] = P[i, AZIMUTH] = 0.0
        P[AZIMUTH, AZIMUTH] = sigma * sigma


@compiled
def _place_in_ring(ring_ns: Stamps, head: int, length: int, at: int) -> int:
    """How far back from the newest the first sample at or after a time lies, 1 the newest; 0 where none is."""
    low, high = 0, length
    while low < high:
        middle = (low + high + 1) // 2
        if ring_ns[(head - middle) % _RING] >= at:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def _carried_at(ring_ns: Stamps, ring: Array, head: int, length: int, at: int) -> float:
    """Carried turn of the axis at a time, rad; the ends hold."""
    back = _place_in_ring(ring_ns, head, length, at)
    if back == 0:
        return float(ring[(head - 1) % _RING, 3])
    later = (head - back) % _RING
    if back == length:
        return float(ring[later, 3])
    earlier = (head - back - 1) % _RING
    share = (at - ring_ns[earlier]) / (ring_ns[later] - ring_ns[earlier])
    return float((1.0 - share) * ring[earlier, 3] + share * ring[later, 3])


@compiled
def _fine(
    k: Array, sums: Array, fine: Array, bin_ns: int, ring_ns: Stamps, ring: Array, clock: Stamps, stamps: Stamps,
    rates: Array, start: int,
) -> tuple[bool, int]:  # fmt: skip
    """
    The same sums by the precision unit, with gravity of the sample at or after each; whether they may be used.

    A rate is the mean over the interval that ends at its stamp. Returns also the first sample of a later bin.
    """
    begin = int(sums[S_BIN]) * bin_ns
    while start < len(stamps) and stamps[start] < begin:
        start += 1
    for j in range(SUMS):
        fine[j] = sums[j]
    fine[S_TURN] = fine[S_Y] = fine[S_Z] = fine[S_NOISE] = 0.0
    usable, covered = True, 0.0
    head, length = clock[_HEAD], clock[_LENGTH]
    last, back = begin, 0
    while start < len(stamps) and stamps[start] < begin + bin_ns:
        stamp, wy, wz = stamps[start], rates[start, 1], rates[start, 2]
        start += 1
        dt = (stamp - last) * 1e-9
        if dt <= 0.0:
            continue
        last = stamp
        if not (abs(wy) < k[K_RANGE] and abs(wz) < k[K_RANGE]):
            usable = False
            continue
        if back == 0:
            back = _place_in_ring(ring_ns, head, length, stamp)
        while back > 1 and ring_ns[(head - back) % _RING] < stamp:
            back -= 1
        if back == 0:
            usable = False
            break
        at = (head - back) % _RING
        dy, dz = ring[at, 1], ring[at, 2]
        across2 = dy * dy + dz * dz
        if across2 < k[K_VERTICAL] or dt > 0.5e-9 * bin_ns:
            usable = False
            continue
        share = dt / across2
        fine[S_TURN] += (wy * dy + wz * dz) * share
        fine[S_Y] += dy * share
        fine[S_Z] += dz * share
        fine[S_NOISE] += share
        covered += dt
    # Where it covers the bin but for a sample or two, the little that is missing is taken in proportion.
    usable = usable and covered > 0.8 * sums[S_TIME] and sums[S_TIME] > 0.0
    if usable:
        whole = sums[S_TIME] / covered
        for j in (S_TURN, S_Y, S_Z, S_NOISE):
            fine[j] *= whole
    return usable, start


@compiled
def _step(
    k: Array, bin_ns: int, clock: Stamps, x: Array, P: Array, m: Array, bins: Array, ring_ns: Stamps, ring: Array,
    index: int, seek_azimuth: float, seek_sigma: float, mag_ns: Stamps, mag_azimuth: Array, mag_sigma: Array,
    mag_constant: Array, mag_good: NDArray[np.bool_], mag_afresh: NDArray[np.bool_], used: int, fine_ns: Stamps,
    fine_t: Array, fine_used: int, fine: Array,
) -> tuple[int, int]:  # fmt: skip
    """Take in one closed bin: its turn, then the magnetic azimuths of its time, then a north seek."""
    row = 0
    for j in range(_BINS):
        if bins[j, S_BIN] == index:
            row = j
    sums = bins[row]
    end = (index + 1) * bin_ns
    there = sums[S_BIN] == index
    if there:
        silent = index - m[LAST_BIN] - 1.0
        if math.isfinite(silent) and silent > 0.0:
            sums[S_GAP] += silent * bin_ns * 1e-9
            m[SINCE_SEEN] += silent * bin_ns * 1e-9
            m[SINCE_USED] += silent * bin_ns * 1e-9
        m[LAST_BIN], m[LAST_CARRIED] = index, sums[S_CARRIED]
        usable, fine_used = _fine(k, sums, fine, bin_ns, ring_ns, ring, clock, fine_ns, fine_t, fine_used)
        m[SINCE_SEEN] += sums[S_TIME]
        m[SINCE_USED] += sums[S_TIME]
        if sums[S_VERTICAL] > 0.0:
            # No azimuth here, and none to carry: it begins anew where the hole leaves the vertical.
            m[HAVE] = 0.0
        elif m[HAVE] != 0.0:
            if usable:
                _propagate(k, x, P, fine, 1)
            else:
                _propagate(k, x, P, sums, 0)
    while used < len(mag_ns) and mag_ns[used] < end:
        known = math.isfinite(mag_azimuth[used]) and math.isfinite(mag_sigma[used]) and mag_sigma[used] > 0.0
        if there and known and sums[S_VERTICAL] == 0.0:
            since = sums[S_CARRIED] - _carried_at(ring_ns, ring, clock[_HEAD], clock[_LENGTH], mag_ns[used])
            _magnetic(
                k, x, P, m, mag_azimuth[used] + since, mag_sigma[used], mag_constant[used], mag_good[used],
                mag_afresh[used],
            )  # fmt: skip
        used += 1
    if there and math.isfinite(seek_azimuth) and seek_sigma > 0.0 and sums[S_VERTICAL] == 0.0:
        _seek(k, x, P, m, seek_azimuth, seek_sigma)
    return used, fine_used


@compiled
def _run(
    k: Array, bin_ns: int, gap_ns: int, clock: Stamps, x: Array, P: Array, m: Array, bins: Array, carried: Array,
    ring_ns: Stamps, ring: Array, stamps: Stamps, gyro: Array, down: Array, tilt: Array, place: Stamps, bin_at: Stamps,
    seek_azimuth: Array, seek_sigma: Array, mag_ns: Stamps, mag_azimuth: Array, mag_sigma: Array, mag_constant: Array,
    mag_good: NDArray[np.bool_], mag_afresh: NDArray[np.bool_], fine_ns: Stamps, fine_t: Array, azimuth: Array,
    sigma: Array, status: NDArray[np.uint32],
) -> int:  # fmt: skip
    fine = np.zeros(SUMS)
    used, fine_used, step = 0, 0, 0
    tau = 2.0 * math.pi
    spread = math.sqrt(max(P[AZIMUTH, AZIMUTH], 0.0))
    start, since = x[AZIMUTH], m[LAST_CARRIED]
    earth_north = k[K_NORTH] * math.cos(x[AZIMUTH])
    open_bin = clock[_LAST_NS] // bin_ns if clock[_LENGTH] > 0 else _NONE
    end = (open_bin + 1) * bin_ns if clock[_LENGTH] > 0 else _NONE
    for i in range(len(stamps)):
        while step < len(place) and place[step] <= i:
            used, fine_used = _step(
                k, bin_ns, clock, x, P, m, bins, ring_ns, ring, bin_at[step], seek_azimuth[step], seek_sigma[step],
                mag_ns, mag_azimuth, mag_sigma, mag_constant, mag_good, mag_afresh, used, fine_ns, fine_t, fine_used,
                fine,
            )  # fmt: skip
            spread = math.sqrt(max(P[AZIMUTH, AZIMUTH], 0.0))
            start, since = x[AZIMUTH], m[LAST_CARRIED]
            earth_north = k[K_NORTH] * math.cos(x[AZIMUTH])
            step += 1
        stamp, wy, wz = stamps[i], gyro[i, 1], gyro[i, 2]
        dx, dy, dz = down[i, 0], down[i, 1], down[i, 2]
        across2 = dy * dy + dz * dz
        fresh = clock[_LENGTH] == 0 or stamp > clock[_LAST_NS]
        if fresh and math.isfinite(wy + wz + dx + across2):
            if stamp >= end:
                open_bin = stamp // bin_ns
                end = (open_bin + 1) * bin_ns
                clock[_OPENED] += 1
                for j in range(SUMS):
                    bins[clock[_OPENED] % _BINS, j] = 0.0
                bins[clock[_OPENED] % _BINS, S_BIN] = open_bin
            sums = bins[clock[_OPENED] % _BINS]
            if across2 < k[K_VERTICAL]:
                sums[S_VERTICAL] = 1.0
            elif clock[_LENGTH] > 0:
                dt = (stamp - clock[_LAST_NS]) * 1e-9
                if stamp - clock[_LAST_NS] <= gap_ns:
                    inverse = 1.0 / across2
                    share = dt * inverse
                    turn, y, z = (wy * dy + wz * dz) * share, dy * share, dz * share
                    earth = dx * math.sqrt(across2) * share
                    mistaken = (wy * dz - wz * dy) * inverse * tilt[i]
                    sums[S_TURN] += turn
                    sums[S_Y] += y
                    sums[S_Z] += z
                    sums[S_TIME] += dt
                    sums[S_EARTH] += earth
                    sums[S_NOISE] += share
                    sums[S_TILT] += mistaken * mistaken * dt
                    carried[0] += turn - x[BIAS] * y - x[BIAS + 1] * z - k[K_DOWN] * dt + earth_north * earth
                else:
                    sums[S_GAP] += dt
            sums[S_CARRIED] = carried[0]
            head = clock[_HEAD]
            ring_ns[head] = stamp
            ring[head, 0], ring[head, 1], ring[head, 2], ring[head, 3] = dx, dy, dz, carried[0]
            clock[_HEAD] = (head + 1) & (_RING - 1)
            clock[_LENGTH] = min(clock[_LENGTH] + 1, _RING)
            clock[_LAST_NS] = stamp
        if m[HAVE] == 0.0 or not across2 >= k[K_VERTICAL]:
            azimuth[i], sigma[i], status[i] = math.nan, math.inf, 0
        elif spread > k[K_WIDEST]:
            azimuth[i], sigma[i], status[i] = math.nan, min(math.pi, spread), _AIDED
        else:
            # Within a turn of the range as a rule; the remainder costs more.
            now = start + (carried[0] - since)
            now = now - tau if now >= tau else (now + tau if now < 0.0 else now)
            azimuth[i] = now if 0.0 <= now < tau else now % tau
            sigma[i] = min(math.pi, spread)
            status[i] = int(m[BITS]) | (_AIDED if m[SINCE_USED] > k[K_TIMEOUT] else 0)
    return used

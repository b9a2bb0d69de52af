"""
Azimuth while drilling, without a stop: carried by the gyros, corrected by the magnetic azimuth, honest in between.

Four states: azimuth of the hole axis, bias of the two cross-axis gyros, and the slowly changing error of the magnetic
azimuth (interference, declination), which never averages out while the tool stays where it is. Only the cross-axis
rates enter, so that the x gyro may clip and a turning tool modulates the biases out. A magnetic azimuth beyond the
innovation gate is not used; one that stays away with its total field and dip in order is taken up again, and says so.
Derivation and limits: ``docs/fusion.md``.
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

# States: azimuth, rad; gyro bias y and z, rad/s; magnetic error in units of its own sigma.
AZIMUTH, BIAS, ERROR, STATES = 0, 1, 3, 4
# Memory: a first azimuth exists; seconds since the last magnetic azimuth used, and since the last seen; seconds for
# which good ones have been gated out; last innovation ratio; counts of gated, failed and taken-up-again azimuths.
HAVE, SINCE_USED, SINCE_SEEN, REFUSING, RATIO, GATED, FAILED, TAKEN_UP, MEMORY = 0, 1, 2, 3, 4, 5, 6, 7, 8
K_NORTH, K_DOWN, K_NOISE, K_BIAS, K_WALK, K_SHARE, K_TAU, K_GATE, K_PATIENCE = 0, 1, 2, 3, 4, 5, 6, 7, 8
K_TIMEOUT, K_VERTICAL, K_GAP_RATE, K_TILT, SETTINGS = 9, 10, 11, 12, 13

_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_NO_MAG, _DISTURBED, _AIDED = int(Status.NO_MAG), int(Status.MAG_DISTURBED), int(Status.GYRO_AIDED)
_VERTICAL = int(Status.NEAR_VERTICAL)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings; noise and bias are one sigma and belong to the y and z gyros that are fed in."""

    latitude_deg: float = setting(34.0, "geodetic latitude, north positive", unit="deg", low=-90.0, high=90.0)
    gyro_noise_deg_rth: float = setting(0.42, "white noise, y and z", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    gyro_bias_deg_h: float = setting(36.0, "bias not known to better than", unit="deg/h", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(5.0, "bias random walk per root hour", unit="deg/h", low=0.0, high=1e4)
    magnetic_share: float = setting(
        0.9, "share of the magnetic sigma that stays the same from sample to sample", low=0.0, high=0.999
    )
    magnetic_memory: float = setting(1800.0, "time in which that share changes", unit="s", low=1.0, high=1e6)
    gate_sigmas: float = setting(4.0, "innovation beyond which a magnetic azimuth is not used", low=1.0, high=20.0)
    patience: float = setting(
        60.0, "good azimuths gated out for so long are taken up again", unit="s", low=1.0, high=1e5
    )
    mag_timeout: float = setting(2.0, "age of the magnetic azimuth that counts as none", unit="s", low=0.05, high=600.0)
    vertical_below_deg: float = setting(3.0, "inclination without an azimuth", unit="deg", low=0.5, high=20.0)
    gap: float = setting(0.5, "a longer silence is bridged with a wide sigma", unit="s", low=0.01, high=60.0)
    gap_rate_dps: float = setting(
        0.05, "rate at which the axis may have turned meanwhile", unit="deg/s", low=0.0, high=90
    )
    tilt_sigma_deg: float = setting(
        0.05, "error of the gravity direction that multiplies cross-axis rates", unit="deg", low=0.0, high=10.0
    )


@dataclasses.dataclass
class State:
    """All that changes: clock, four states, their covariance, memory."""

    clock: Stamps
    x: Array
    P: Array
    memory: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Rows:
    """
    Azimuth of n samples.

    Attributes
    ----------
    azimuth : ndarray, shape (n,)
        Of the hole axis from the north of the azimuths fed in, rad in [0, 2 pi); NaN where there is none yet.
    sigma : ndarray, shape (n,)
        One sigma, rad, at most pi.
    status : ndarray of uint32, shape (n,)
        INITIALISING | NO_MAG: waiting for a first azimuth. NO_MAG | GYRO_AIDED: carried by the gyros alone.
        MAG_DISTURBED: the magnetic azimuth of this sample was not used.
    """

    azimuth: Array
    sigma: Array
    status: NDArray[np.uint32]


def initial() -> State:
    """State before the first sample."""
    return State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64), np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros(MEMORY)
    )


def run(
    params: Params,
    state: State,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    g_t: ArrayLike,
    mag_azimuth: ArrayLike,
    mag_sigma: ArrayLike,
    mag_good: ArrayLike,
) -> Rows:
    """
    Carry the azimuth through a block of samples.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t : array_like, shape (n, 3)
        Angular rate, rad/s, in tool axes; x is not used.
    g_t : array_like, shape (n, 3)
        Unit vector down in tool axes from a gravity method; NaN before it has one.
    mag_azimuth, mag_sigma : array_like, shape (n,)
        Magnetic azimuth, raw or corrected, from the named north, and its whole sigma, rad; NaN between samples.
    mag_good : array_like of bool, shape (n,)
        False where total field or dip fail their check: then it is never used.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, down = track.samples(stamp_ns, gyro_t, g_t)
    n = len(stamps)
    mag = np.ascontiguousarray(mag_azimuth, dtype=np.float64)
    spread = np.ascontiguousarray(mag_sigma, dtype=np.float64)
    good = np.ascontiguousarray(mag_good, dtype=np.bool_)
    for name, column in (("mag_azimuth", mag), ("mag_sigma", spread), ("mag_good", good)):
        if column.shape != (n,):
            raise ValueError(f"{name}: expected shape ({n},), got {column.shape}")
    rows = Rows(np.empty(n), np.empty(n), np.zeros(n, dtype=np.uint32))
    _run(
        kernel_settings(params), round(params.gap * 1e9), state.clock, state.x, state.P, state.memory,
        stamps, gyro, down, mag, spread, good, rows.azimuth, rows.sigma, rows.status,
    )  # fmt: skip
    return rows


def update(params: Params, state: State, azimuth: float, sigma: float) -> bool:
    """
    Take in an azimuth that owes nothing to the magnetometer: a north seek, or a fused station without magnetic part.

    azimuth, sigma: from the same north as the magnetic ones, rad. Returns False, and changes nothing, where it lies
    beyond the gate: the caller raises the alarm and, if the station is accepted, calls `restart`.

    Raises
    ------
    ValueError
        An azimuth or sigma that is not finite, or a sigma that is not positive.
    """
    if not (math.isfinite(azimuth) and math.isfinite(sigma) and sigma > 0.0):
        raise ValueError(f"azimuth, sigma: expected finite numbers and a positive sigma, got {azimuth!r}, {sigma!r}")
    if state.memory[HAVE] == 0.0:
        restart(params, state, azimuth, sigma)
        return True
    h = np.array([1.0, 0.0, 0.0, 0.0])
    return bool(_correct(kernel_settings(params), state.x, state.P, state.memory, h, azimuth, sigma * sigma))


def restart(params: Params, state: State, azimuth: float, sigma: float) -> None:
    """Begin at this azimuth, rad, keeping what is known of the gyro biases and of the magnetic error."""
    k = kernel_settings(params)
    if state.memory[HAVE] == 0.0:
        _begin(k, state.x, state.P, state.memory)
    state.x[AZIMUTH] = azimuth
    state.P[AZIMUTH, :] = 0.0
    state.P[:, AZIMUTH] = 0.0
    state.P[AZIMUTH, AZIMUTH] = sigma * sigma


def kernel_settings(params: Params) -> Array:
    """Settings in SI, in the order of the K_ names, shape (SETTINGS,)."""
    k = np.zeros(SETTINGS)
    latitude = math.radians(params.latitude_deg)
    k[K_NORTH], k[K_DOWN] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    k[K_NOISE], k[K_BIAS] = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR, params.gyro_bias_deg_h * DEG_PER_HOUR
    k[K_WALK] = params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0
    k[K_SHARE], k[K_TAU], k[K_GATE] = params.magnetic_share, params.magnetic_memory, params.gate_sigmas
    k[K_PATIENCE], k[K_TIMEOUT] = params.patience, params.mag_timeout
    k[K_VERTICAL] = math.sin(math.radians(params.vertical_below_deg)) ** 2
    k[K_GAP_RATE], k[K_TILT] = math.radians(params.gap_rate_dps), math.radians(params.tilt_sigma_deg)
    return k


@compiled
def azimuth_rate(k: Array, x: Array, wy: float, wz: float, dx: float, dy: float, dz: float) -> float:
    """
    Rate of the azimuth of the tool axis, rad/s, from cross-axis rates, rad/s, and the unit vector down in tool axes.

    (w - w_ie) . (d - (d.x) x) / sin^2(I): the part of the rate about the vertical that moves the axis; the x rate
    drops out. The Earth's share is -We sin(lat) - We cos(lat) cos(azimuth) / tan(I).
    """
    across2 = dy * dy + dz * dz
    earth = k[K_DOWN] - k[K_NORTH] * math.cos(x[AZIMUTH]) * dx / math.sqrt(across2)
    return float(((wy - x[BIAS]) * dy + (wz - x[BIAS + 1]) * dz) / across2 - earth)


@compiled
def _begin(k: Array, x: Array, P: Array, m: Array) -> None:
    for i in range(STATES):
        x[i] = 0.0
        for j in range(STATES):
            P[i, j] = 0.0
    P[BIAS, BIAS] = k[K_BIAS] ** 2
    P[BIAS + 1, BIAS + 1] = k[K_BIAS] ** 2
    P[ERROR, ERROR] = 1.0
    m[HAVE] = 1.0


@compiled
def _correct(k: Array, x: Array, P: Array, m: Array, h: Array, azimuth: float, r2: float) -> bool:
    """Scalar update by an azimuth = h x + noise; False, with nothing changed, beyond the gate."""
    ph = np.zeros(STATES)
    s = r2
    predicted = 0.0
    for i in range(STATES):
        predicted += h[i] * x[i]
        for j in range(STATES):
            ph[i] += P[i, j] * h[j]
        s += h[i] * ph[i]
    innovation = (azimuth - predicted + math.pi) % (2.0 * math.pi) - math.pi
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
def _propagate(k: Array, x: Array, P: Array, dt: float, wy: float, wz: float, dx: float, dy: float, dz: float) -> None:
    across2 = dy * dy + dz * dz
    across = math.sqrt(across2)
    rate = azimuth_rate(k, x, wy, wz, dx, dy, dz)
    f0 = 1.0 - dt * k[K_NORTH] * math.sin(x[AZIMUTH]) * dx / across
    f1, f2 = -dt * dy / across2, -dt * dz / across2
    fade = math.exp(-dt / k[K_TAU])
    x[AZIMUTH] = (x[AZIMUTH] + rate * dt) % (2.0 * math.pi)
    x[ERROR] *= fade
    row = np.zeros(STATES)
    for j in range(STATES):
        row[j] = f0 * P[0, j] + f1 * P[1, j] + f2 * P[2, j]
    P[0, 0] = f0 * row[0] + f1 * row[1] + f2 * row[2]
    for j in range(1, STATES):
        P[0, j] = row[j]
        P[j, 0] = row[j]
    for j in range(3):
        P[ERROR, j] *= fade
        P[j, ERROR] = P[ERROR, j]
    P[ERROR, ERROR] = 1.0 + fade * fade * (P[ERROR, ERROR] - 1.0)
    # Gyro noise, and the cross-axis rate that an error of the gravity direction mistakes for azimuth.
    mistaken = k[K_TILT] * (wy * dz - wz * dy) / across2
    P[0, 0] += k[K_NOISE] ** 2 / across2 * dt + mistaken * mistaken * dt * min(dt, 1.0)
    P[1, 1] += k[K_WALK] ** 2 * dt
    P[2, 2] += k[K_WALK] ** 2 * dt


@compiled
def _magnetic(k: Array, x: Array, P: Array, m: Array, h: Array, azimuth: float, sigma: float, good: bool) -> int:
    """Take in one magnetic azimuth; returns the status bits it leaves."""
    slow, fast2 = sigma * k[K_SHARE], sigma * sigma * (1.0 - k[K_SHARE] ** 2)
    if not good:
        m[FAILED] += 1.0
        m[REFUSING] = 0.0
        return _DISTURBED
    h[0], h[1], h[2], h[3] = 1.0, 0.0, 0.0, slow
    if m[HAVE] == 0.0:
        _begin(k, x, P, m)
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        # azimuth read = azimuth + slow * error + noise, so the first estimate is wrong by minus the error.
        P[0, 0] = sigma * sigma
        P[0, ERROR] = -slow
        P[ERROR, 0] = -slow
    elif not _correct(k, x, P, m, h, azimuth, fast2):
        m[GATED] += 1.0
        # Between two samples at most the time-out counts, so that a drop-out is no evidence.
        m[REFUSING] += min(m[SINCE_SEEN], k[K_TIMEOUT])
        if m[REFUSING] <= k[K_PATIENCE]:
            return _DISTURBED
        # Steadily elsewhere, with total field and dip in order: the carried azimuth is wrong by more than it said.
        m[TAKEN_UP] += 1.0
        innovation = (azimuth - x[AZIMUTH] - slow * x[ERROR] + math.pi) % (2.0 * math.pi) - math.pi
        P[0, 0] += innovation * innovation
        _correct(k, x, P, m, h, azimuth, fast2)
    m[REFUSING] = 0.0
    m[SINCE_USED] = 0.0
    return 0


@compiled
def _run(
    k: Array,
    gap_ns: int,
    clock: Stamps,
    x: Array,
    P: Array,
    m: Array,
    stamps: Stamps,
    gyro: Array,
    down: Array,
    mag: Array,
    spread: Array,
    good: NDArray[np.bool_],
    azimuth: Array,
    sigma: Array,
    status: NDArray[np.uint32],
) -> None:
    h = np.zeros(STATES)
    for i in range(len(stamps)):
        dx, dy, dz = down[i, 0], down[i, 1], down[i, 2]
        last = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], 0.0, gyro[i, 1], gyro[i, 2], dx, dy, dz, gap_ns)
        bits = 0
        across2 = dy * dy + dz * dz
        if verdict == track.REJECTED:
            bits |= _REJECTED
        elif across2 < k[K_VERTICAL]:
            # No azimuth here, and none to carry: it begins anew where the hole leaves the vertical.
            bits |= _VERTICAL
            m[HAVE] = 0.0
        else:
            dt = (stamps[i] - last) * 1e-9 if verdict != track.FIRST else 0.0
            m[SINCE_USED] += max(dt, 0.0)
            m[SINCE_SEEN] += max(dt, 0.0)
            if m[HAVE] != 0.0:
                if verdict == track.NEXT:
                    _propagate(k, x, P, dt, gyro[i, 1], gyro[i, 2], dx, dy, dz)
                elif verdict == track.AFTER_GAP:
                    # A clock set back says nothing of how long it was: count it as one time-out.
                    silent = dt if dt > 0.0 else k[K_TIMEOUT]
                    P[0, 0] += (k[K_GAP_RATE] * silent) ** 2
                    bits |= _GAP
            if math.isfinite(mag[i]) and math.isfinite(spread[i]) and spread[i] > 0.0:
                bits |= _magnetic(k, x, P, m, h, mag[i], spread[i], good[i])
                m[SINCE_SEEN] = 0.0
        if m[HAVE] == 0.0:
            bits |= _INITIALISING | (_NO_MAG if bits & _VERTICAL == 0 else 0)
            azimuth[i], sigma[i] = math.nan, math.pi
        else:
            if m[SINCE_USED] > k[K_TIMEOUT]:
                bits |= _AIDED
                if m[SINCE_SEEN] > k[K_TIMEOUT]:
                    bits |= _NO_MAG
            azimuth[i] = x[AZIMUTH]
            sigma[i] = min(math.pi, math.sqrt(max(P[0, 0], 0.0)))
        status[i] = bits

"""
S1: true north from the Earth's rotation with a 15-state error-state Kalman filter and a tool that has not moved.

Position, velocity, attitude, gyro bias and accelerometer bias; strapdown mechanisation in north-east-down with the
Earth rate of a known latitude; the only measurement is z = [I6 0] x: position and velocity are still zero (S1 section
2.2). A coarse alignment on the mean rate and force starts it. Derivation, what is observable and limits:
``docs/north_seeking.md``; the estimator that does better with the same data: `mwd_estimation.gyrocompass.seek`.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import samples as track
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import hole_angles, wrap_tau
from mwd_sensors.core.settings import setting

# Geodetic latitude above which the Earth's rotation has no usable horizontal part.
MAX_LATITUDE_DEG = 85.0
STATES = 15
# Order of the error state (S1): what must be added to the estimate to give the truth.
POSITION, VELOCITY, ATTITUDE, GYRO_BIAS, ACCEL_BIAS = 0, 3, 6, 9, 12
# Layout of the nominal state: position, velocity, tool-to-NED matrix by rows, gyro bias, accelerometer bias, and the
# matrix of the coarse alignment. The tool keeps still, so every transition is taken at that first matrix: taken at
# the latest one, the unobservable mix of azimuth and east gyro bias would turn with each correction and sigma would
# shrink below the truth.
MATRIX, N_GYRO_BIAS, N_ACCEL_BIAS, FIRST_MATRIX, NOMINAL = 6, 15, 18, 21, 30
AT_REST = FIRST_MATRIX + 6  # its row down: the unit vector down in tool axes
# Layout of the coarse sums: rate, force, duration, largest test ratio since the start, and its slow mean.
SUM_RATE, SUM_FORCE, SUM_TIME, ALIGNED, RATIO, SUMS = 0, 3, 6, 7, 8, 9
# Layout of the settings handed to the kernel.
K_NORTH, K_DOWN, K_GRAVITY, K_COARSE, K_GYRO, K_ACCEL, K_GYRO_WALK, K_ACCEL_WALK = 0, 1, 2, 3, 4, 5, 6, 7
K_GYRO_BIAS, K_ACCEL_BIAS, K_POSITION, K_VELOCITY, K_MOVED, SETTINGS = 8, 9, 10, 11, 12, 13

_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_STILL, _NEAR_VERTICAL = int(Status.STILL), int(Status.NEAR_VERTICAL)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the S1 filter. Noise figures are one sigma and belong to the precision unit."""

    latitude_deg: float = setting(34.0, "geodetic latitude, north positive", unit="deg", low=-90.0, high=90.0)
    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    coarse_seconds: float = setting(20.0, "mean that starts the filter", unit="s", low=0.1, high=600.0)
    gyro_noise_deg_rth: float = setting(0.05, "gyro white noise", unit="deg/sqrt(h)", low=1e-5, high=10.0)
    accel_noise_ug_rthz: float = setting(30.0, "accelerometer white noise", unit="ug/sqrt(Hz)", low=0.01, high=1e4)
    gyro_bias_deg_h: float = setting(0.1, "what calibration leaves of the gyro bias", unit="deg/h", low=0.0, high=1e5)
    accel_bias_ug: float = setting(100.0, "what calibration leaves of the force bias", unit="ug", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(0.0, "bias random walk, per root hour", unit="deg/h", low=0.0, high=1e4)
    accel_walk_ug_rth: float = setting(0.0, "bias random walk, per root hour", unit="ug", low=0.0, high=1e5)
    sigma_position: float = setting(0.001, "the tool keeps its place within", unit="m", low=1e-6, high=10.0)
    sigma_velocity: float = setting(0.001, "the tool's velocity stays within", unit="m/s", low=1e-6, high=10.0)
    gap: float = setting(0.5, "a longer silence starts the filter anew", unit="s", low=0.01, high=60.0)
    moved_ratio: float = setting(5.0, "mean innovation ratio above which the tool has moved", low=1.0, high=1e3)


@dataclasses.dataclass
class State:
    """All that changes: common clock, coarse sums, nominal state and covariance of its error."""

    clock: Stamps
    sums: Array
    nominal: Array
    P: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class North:
    """
    Attitude from true north, sample by sample.

    Attributes
    ----------
    azimuth, inclination, toolface : ndarray, shape (n,)
        Rad; NaN until the coarse alignment is done.
    sigma_azimuth, sigma_inclination : ndarray, shape (n,)
        One sigma, rad, at most pi.
    ratio : ndarray, shape (n,)
        Mean normalised innovation squared of the zero-motion measurement; 1 when the tool keeps as still as stated.
    status : ndarray of uint32, shape (n,)
        Bits of `mwd_estimation.core.status.Status`; STILL is absent where `ratio` says that the tool has moved.
    """

    azimuth: Array
    inclination: Array
    toolface: Array
    sigma_azimuth: Array
    sigma_inclination: Array
    ratio: Array
    status: NDArray[np.uint32]


def initial(params: Params) -> State:
    """
    State before the first sample.

    Raises
    ------
    ValueError
        A latitude above 85 deg, where the Earth's rotation has no usable horizontal part.
    """
    if abs(params.latitude_deg) > MAX_LATITUDE_DEG:
        raise ValueError(
            f"latitude_deg: {params.latitude_deg:g} deg is too near the pole: the Earth's rotation points along the "
            f"vertical there and a gyro cannot find north above {MAX_LATITUDE_DEG:g} deg"
        )
    return State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64), np.zeros(SUMS), np.zeros(NOMINAL), np.zeros((STATES, STATES))
    )


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> North:
    """
    Seek north through a block of samples of a tool that keeps still.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, of the precision unit in tool axes.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    n = len(stamps)
    mats, sigma_a, sigma_i, ratio = np.empty((n, 3, 3)), np.empty(n), np.empty(n), np.empty(n)
    status = np.zeros(n, dtype=np.uint32)
    _run(
        kernel_settings(params), round(params.gap * 1e9), state.clock, state.sums, state.nominal, state.P,
        stamps, gyro, accel, mats, sigma_a, sigma_i, ratio, status,
    )  # fmt: skip
    inclination, azimuth, toolface = hole_angles(mats)
    unknown = (status & _INITIALISING) != 0
    for angle in (inclination, azimuth, toolface):
        angle[unknown] = np.nan
    return North(wrap_tau(azimuth), inclination, toolface, sigma_a, sigma_i, ratio, status)


def kernel_settings(params: Params) -> Array:
    """Settings in SI, in the order of the K_ names, shape (SETTINGS,)."""
    k = np.zeros(SETTINGS)
    latitude = math.radians(params.latitude_deg)
    k[K_NORTH], k[K_DOWN] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    k[K_GRAVITY], k[K_COARSE] = params.gravity, params.coarse_seconds
    k[K_GYRO] = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR
    k[K_ACCEL] = params.accel_noise_ug_rthz * MICRO_G
    k[K_GYRO_WALK] = params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0
    k[K_ACCEL_WALK] = params.accel_walk_ug_rth * MICRO_G / 60.0
    k[K_GYRO_BIAS], k[K_ACCEL_BIAS] = params.gyro_bias_deg_h * DEG_PER_HOUR, params.accel_bias_ug * MICRO_G
    k[K_POSITION], k[K_VELOCITY], k[K_MOVED] = params.sigma_position, params.sigma_velocity, params.moved_ratio
    return k


@compiled
def rotate_by(mat: Array, at: int, left: bool, vx: float, vy: float, vz: float) -> None:
    """Turn the matrix stored by rows in mat[at:at+9] by exp([v x]), from the left or from the right, in place."""
    angle2 = vx * vx + vy * vy + vz * vz
    angle = math.sqrt(angle2)
    if angle > 1e-4:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    else:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    e00, e01, e02 = 1.0 - b * (vy * vy + vz * vz), b * vx * vy - a * vz, b * vx * vz + a * vy
    e10, e11, e12 = b * vx * vy + a * vz, 1.0 - b * (vx * vx + vz * vz), b * vy * vz - a * vx
    e20, e21, e22 = b * vx * vz - a * vy, b * vy * vz + a * vx, 1.0 - b * (vx * vx + vy * vy)
    for i in range(3):
        if left:
            j0, j1, j2 = at + i, at + 3 + i, at + 6 + i
            m0, m1, m2 = mat[j0], mat[j1], mat[j2]
            mat[j0] = e00 * m0 + e01 * m1 + e02 * m2
            mat[j1] = e10 * m0 + e11 * m1 + e12 * m2
            mat[j2] = e20 * m0 + e21 * m1 + e22 * m2
        else:
            j0 = at + 3 * i
            m0, m1, m2 = mat[j0], mat[j0 + 1], mat[j0 + 2]
            mat[j0] = m0 * e00 + m1 * e10 + m2 * e20
            mat[j0 + 1] = m0 * e01 + m1 * e11 + m2 * e21
            mat[j0 + 2] = m0 * e02 + m1 * e12 + m2 * e22


@compiled
def propagate(x: Array, k: Array, dt: float, wx: float, wy: float, wz: float, fx: float, fy: float, fz: float) -> None:
    """Carry the nominal state through one sample of mean rate, rad/s, and force, m/s^2, in place."""
    ax, ay, az = fx - x[N_ACCEL_BIAS], fy - x[N_ACCEL_BIAS + 1], fz - x[N_ACCEL_BIAS + 2]
    north, down = k[K_NORTH], k[K_DOWN]
    vn, ve, vd = x[VELOCITY], x[VELOCITY + 1], x[VELOCITY + 2]
    for i in range(3):
        x[i] += x[VELOCITY + i] * dt
    # v' = C f + g - 2 w_ie x v; transport rate and gradient of gravity are nothing for a tool that keeps still.
    x[VELOCITY] += dt * (x[6] * ax + x[7] * ay + x[8] * az + 2.0 * down * ve)
    x[VELOCITY + 1] += dt * (x[9] * ax + x[10] * ay + x[11] * az - 2.0 * (down * vn - north * vd))
    x[VELOCITY + 2] += dt * (x[12] * ax + x[13] * ay + x[14] * az + k[K_GRAVITY] - 2.0 * north * ve)
    rotate_by(
        x, MATRIX, False, dt * (wx - x[N_GYRO_BIAS]), dt * (wy - x[N_GYRO_BIAS + 1]), dt * (wz - x[N_GYRO_BIAS + 2])
    )
    rotate_by(x, MATRIX, True, -dt * north, 0.0, -dt * down)


@compiled
def transition(x: Array, at: int, k: Array, dt: float, ax: float, ay: float, az: float, phi: Array) -> None:
    """
    Fill phi, shape (9, 15), with the moving rows of Phi = I + F T of the error state (S1); the bias rows are I.

    The tool-to-NED matrix is read from x[at:at + 9]: MATRIX or FIRST_MATRIX. ax, ay, az: force free of bias, m/s^2.
    """
    north, down = k[K_NORTH], k[K_DOWN]
    fn = x[at] * ax + x[at + 1] * ay + x[at + 2] * az
    fe = x[at + 3] * ax + x[at + 4] * ay + x[at + 5] * az
    fd = x[at + 6] * ax + x[at + 7] * ay + x[at + 8] * az
    for i in range(9):
        for j in range(STATES):
            phi[i, j] = 0.0
        phi[i, i] = 1.0
    for i in range(3):
        phi[i, VELOCITY + i] = dt
        for j in range(3):
            phi[VELOCITY + i, ACCEL_BIAS + j] = -dt * x[at + 3 * i + j]
            phi[ATTITUDE + i, GYRO_BIAS + j] = -dt * x[at + 3 * i + j]
    # -2 w_ie x v
    phi[3, 4], phi[4, 3], phi[4, 5], phi[5, 4] = 2.0 * dt * down, -2.0 * dt * down, 2.0 * dt * north, -2.0 * dt * north
    # attitude error x specific force
    phi[3, 7], phi[3, 8] = dt * fd, -dt * fe
    phi[4, 6], phi[4, 8] = -dt * fd, dt * fn
    phi[5, 6], phi[5, 7] = dt * fe, -dt * fn
    # -w_ie x attitude error
    phi[6, 7], phi[7, 6], phi[7, 8], phi[8, 7] = dt * down, -dt * down, dt * north, -dt * north


@compiled
def carry_covariance(P: Array, phi: Array, rows: Array) -> None:
    """
    P = Phi P Phi' in place, where all rows of Phi but the first ones are those of the unit matrix.

    P, shape (n, n); phi, shape (m, n), the first rows of Phi, mostly zero; rows, shape (m, n), is scratch.
    """
    moving, states = phi.shape
    for i in range(moving):
        for j in range(states):
            rows[i, j] = 0.0
        for m in range(states):
            c = phi[i, m]
            if c != 0.0:
                for j in range(states):
                    rows[i, j] += c * P[m, j]
    for i in range(moving):
        for j in range(moving, states):
            P[i, j] = rows[i, j]
            P[j, i] = rows[i, j]
        for j in range(i + 1):
            total = 0.0
            for m in range(states):
                c = phi[j, m]
                if c != 0.0:
                    total += rows[i, m] * c
            P[i, j] = total
            P[j, i] = total


@compiled
def _predict(P: Array, phi: Array, k: Array, dt: float, scratch: Array) -> None:
    carry_covariance(P, phi, scratch)
    for i in range(3):
        P[VELOCITY + i, VELOCITY + i] += k[K_ACCEL] ** 2 * dt
        P[ATTITUDE + i, ATTITUDE + i] += k[K_GYRO] ** 2 * dt
        P[GYRO_BIAS + i, GYRO_BIAS + i] += k[K_GYRO_WALK] ** 2 * dt
        P[ACCEL_BIAS + i, ACCEL_BIAS + i] += k[K_ACCEL_WALK] ** 2 * dt


@compiled
def _not_moved(x: Array, P: Array, k: Array, dx: Array, gain: Array) -> float:
    """Six scalar updates z = 0 - (position, velocity); corrects x and P, returns the mean squared innovation ratio."""
    for j in range(STATES):
        dx[j] = 0.0
    ratio = 0.0
    for m in range(6):
        r = k[K_POSITION] if m < 3 else k[K_VELOCITY]
        s = P[m, m] + r * r
        innovation = -x[m] - dx[m]
        ratio += innovation * innovation / s
        for j in range(STATES):
            gain[j] = P[j, m] / s
        for j in range(STATES):
            dx[j] += gain[j] * innovation
        for i in range(STATES):
            for j in range(i + 1):
                # gain * H P with the row as it was: gain[j] * s.
                P[i, j] -= gain[i] * gain[j] * s
        for i in range(STATES):
            for j in range(i):
                P[j, i] = P[i, j]
    for j in range(6):
        x[j] += dx[j]
    rotate_by(x, MATRIX, True, dx[ATTITUDE], dx[ATTITUDE + 1], dx[ATTITUDE + 2])
    for j in range(6):
        x[N_GYRO_BIAS + j] += dx[GYRO_BIAS + j]
    return ratio / 6.0


@compiled
def _align(sums: Array, x: Array, P: Array, k: Array) -> None:
    """
    Coarse alignment: down from the mean force, north from the horizontal part of the mean rate.

    The start covariance is the linear map of both biases and both noises, so that the azimuth error starts correlated
    with the bias that causes it and the data of the alignment are counted once.
    """
    t = sums[SUM_TIME]
    dx, dy, dz = -sums[SUM_FORCE], -sums[SUM_FORCE + 1], -sums[SUM_FORCE + 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    wx, wy, wz = sums[SUM_RATE] / t, sums[SUM_RATE + 1] / t, sums[SUM_RATE + 2] / t
    along = wx * dx + wy * dy + wz * dz
    nx, ny, nz = wx - along * dx, wy - along * dy, wz - along * dz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-12:
        # No horizontal rate at all (a dead gyro): any north will do, the innovations will tell.
        nx, ny, nz = (0.0, dz, -dy) if abs(dx) < 0.9 else (-dz, 0.0, dx)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    for i in range(NOMINAL):
        x[i] = 0.0
    x[6], x[7], x[8] = nx, ny, nz
    x[9], x[10], x[11] = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    x[12], x[13], x[14] = dx, dy, dz
    for i in range(9):
        x[FIRST_MATRIX + i] = x[MATRIX + i]
    g, north, down = k[K_GRAVITY], k[K_NORTH], k[K_DOWN]
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] = 0.0
    for i in range(3):
        P[GYRO_BIAS + i, GYRO_BIAS + i] = k[K_GYRO_BIAS] ** 2
        P[ACCEL_BIAS + i, ACCEL_BIAS + i] = k[K_ACCEL_BIAS] ** 2
    # Attitude error = sum over causes: rows of the map for accelerometer (north, east) and gyro (east) errors.
    noise_a, noise_g = k[K_ACCEL] ** 2 / t, k[K_GYRO] ** 2 / t
    for j in range(3):
        a_n, a_e, w_e = x[6 + j], x[9 + j], x[9 + j]
        tilt_n, tilt_e = a_e / g, -a_n / g
        turn_a, turn_g = tilt_n * down / north, w_e / north
        va, vg = k[K_ACCEL_BIAS] ** 2, k[K_GYRO_BIAS] ** 2
        cause = (tilt_n, tilt_e, turn_a)
        for r in range(3):
            P[ATTITUDE + r, ACCEL_BIAS + j] += cause[r] * va
            P[ACCEL_BIAS + j, ATTITUDE + r] += cause[r] * va
            for c in range(3):
                P[ATTITUDE + r, ATTITUDE + c] += cause[r] * cause[c] * (va + noise_a)
        P[8, GYRO_BIAS + j] += turn_g * vg
        P[GYRO_BIAS + j, 8] += turn_g * vg
        P[8, 8] += turn_g * turn_g * (vg + noise_g)
    for i in range(3):
        # At the moment of alignment the tool is where it is: the origin, at rest within its stated motion.
        P[i, i] = k[K_POSITION] ** 2
        P[VELOCITY + i, VELOCITY + i] = k[K_VELOCITY] ** 2


@compiled
def _run(
    k: Array,
    gap_ns: int,
    clock: Stamps,
    sums: Array,
    x: Array,
    P: Array,
    stamps: Stamps,
    gyro: Array,
    accel: Array,
    mats: Array,
    sigma_a: Array,
    sigma_i: Array,
    ratio: Array,
    status: NDArray[np.uint32],
) -> None:
    phi = np.zeros((9, STATES))
    scratch = np.zeros((9, STATES))
    dx = np.zeros(STATES)
    gain = np.zeros(STATES)
    for i in range(len(stamps)):
        wx, wy, wz = gyro[i, 0], gyro[i, 1], gyro[i, 2]
        fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
        last = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], wx, wy, wz, fx, fy, fz, gap_ns)
        bits = 0
        if verdict == track.REJECTED:
            bits |= _REJECTED
        elif verdict != track.NEXT:
            if verdict == track.AFTER_GAP:
                bits |= _GAP
            for j in range(SUMS):
                sums[j] = 0.0
        else:
            dt = (stamps[i] - last) * 1e-9
            if sums[ALIGNED] == 0.0:
                sums[SUM_TIME] += dt
                sums[0] += wx * dt
                sums[1] += wy * dt
                sums[2] += wz * dt
                sums[3] += fx * dt
                sums[4] += fy * dt
                sums[5] += fz * dt
                if sums[SUM_TIME] >= k[K_COARSE] - 1e-9:
                    _align(sums, x, P, k)
                    sums[ALIGNED] = 1.0
                    sums[RATIO] = 1.0
            else:
                # A tool at rest feels gravity; the measured force would smuggle its noise into the transition, where
                # it passes for motion that shows the azimuth.
                g = -k[K_GRAVITY]
                transition(x, FIRST_MATRIX, k, dt, g * x[AT_REST], g * x[AT_REST + 1], g * x[AT_REST + 2], phi)
                propagate(x, k, dt, wx, wy, wz, fx, fy, fz)
                _predict(P, phi, k, dt, scratch)
                share = min(1.0, dt)
                sums[RATIO] += share * (_not_moved(x, P, k, dx, gain) - sums[RATIO])
        if sums[ALIGNED] == 0.0:
            bits |= _INITIALISING
            for r in range(3):
                for c in range(3):
                    mats[i, r, c] = 1.0 if r == c else 0.0
            sigma_a[i], sigma_i[i], ratio[i] = math.pi, math.pi, 1.0
        else:
            for r in range(3):
                for c in range(3):
                    mats[i, r, c] = x[MATRIX + 3 * r + c]
            # The hole axis is the first column; an attitude error moves its azimuth by H P H'.
            an, ae, ad = x[6], x[9], x[12]
            across2 = an * an + ae * ae
            if across2 < math.sin(track.NEAR_VERTICAL_BELOW) ** 2:
                bits |= _NEAR_VERTICAL
            if across2 < 1e-12:
                sigma_a[i] = math.pi
                sigma_i[i] = math.sqrt(P[6, 6] + P[7, 7])
            else:
                h0, h1 = -an * ad / across2, -ae * ad / across2
                variance = h0 * h0 * P[6, 6] + h1 * h1 * P[7, 7] + P[8, 8]
                variance += 2.0 * (h0 * h1 * P[6, 7] + h0 * P[6, 8] + h1 * P[7, 8])
                sigma_a[i] = min(math.pi, math.sqrt(variance))
                across = math.sqrt(across2)
                t0, t1 = ae / across, -an / across
                sigma_i[i] = math.sqrt(t0 * t0 * P[6, 6] + t1 * t1 * P[7, 7] + 2.0 * t0 * t1 * P[6, 7])
            ratio[i] = sums[RATIO]
            if sums[RATIO] <= k[K_MOVED]:
                bits |= _STILL
        status[i] = bits

"""
North from the Earth's rotation with a tool that keeps still, is turned to other positions, or turns all the time.

One filter for all three: attitude is integrated in a level frame whose own heading need not be known, and the
horizontal Earth rate in that frame is a *linear* unknown, so that any first azimuth will do. What the tool cannot do is
the measurement: it gains no velocity (S1), and the hole axis it lies in does not turn. Cross-axis bias, x leakage,
g-sensitivity, x scale, gyro lag and once-per-turn wobble are states: what the motion shows is estimated, what it hides
stays in the sigma. Azimuth is read from the posterior on the circle |horizontal Earth rate| = We cos(latitude).
Derivation, what is observable when and limits: ``docs/north_seeking.md``.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation import track
from mwd_estimation.north_ekf import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, rotate_by
from mwd_estimation.track import Array, Stamps
from mwd_sensors.compiled import compiled
from mwd_sensors.frames import wrap_pi, wrap_tau
from mwd_sensors.settings import setting

MODES = ("auto", "still", "two_position", "rotating", "continuous")

# Order of the error state (truth minus estimate) and, from VEL on, of the linear part of the nominal state.
PHI, VEL, EARTH, BIAS, SCALE, LEAK, GSENS, LAG, FORCE = 0, 3, 5, 7, 10, 11, 13, 17, 18
AXIS, ROLL, WOBBLE, LEAD, STATES = 21, 23, 24, 32, 33
# Sums of one block: duration, integral of the tool-to-level matrix (rows), of its columns times what they answer for.
S_TIME, S_MAT, S_SCALE, S_LEAK, S_GSENS, S_LAG, S_FORCE, S_TURN, S_LEAD = 0, 1, 10, 13, 19, 31, 34, 37, 38
S_BIAS, SUMS = 40, 46
# Memory of the filter between blocks.
PHASE, LEVEL_TIME, H0, K0, SETTLED = 0, 1, 2, 5, 8
LAST_AXIS, DIFF2, SCATTER, SEEN, STILL_RUN = 9, 12, 14, 17, 18
ELAPSED, STILL_TIME, TURN_TIME, TURNED, POSITIONS, REFUSED_BLOCKS, MOVED = 19, 20, 21, 22, 23, 24, 25
SAMPLES, CLIPPED, REJECTED, GAPS, MEMORY = 26, 27, 28, 29, 30
LEVELLING, SETTLING, SEEKING = 0.0, 1.0, 2.0
# Settings handed to the kernel.
K_HORIZONTAL, K_VERTICAL, K_GRAVITY, K_LEVEL, K_BLOCK, K_N, K_NX, K_NA = 0, 1, 2, 3, 4, 5, 6, 7
K_B, K_BX, K_BA, K_WALK, K_SCALE, K_LEAK, K_G, K_LAG0, K_LAG = 8, 9, 10, 11, 12, 13, 14, 15, 16
K_VEL, K_AXIS_WALK, K_FLOOR, K_RANGE, K_STILL, K_G0, K_EXPECTED, K_LOCKED = 17, 18, 19, 20, 21, 22, 26, 28
K_LEAD0, K_LEAD, SETTINGS = 29, 30, 31
_SETTLE_BLOCKS = 10.0
_GATE = 25.0
# A tenth of a turn ends a block too: mean and two harmonics of the wobble need more than five looks per turn.
_BLOCK_TURN = 0.64


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of a north seek. Noise and calibration figures are one sigma; y and z belong to the precision unit."""

    latitude_deg: float = setting(34.0, "geodetic latitude, north positive", unit="deg", low=-90.0, high=90.0)
    gravity: float = setting(track.STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    mode: str = setting("auto", "what the tool does while it seeks", choices=MODES)
    shortest: float = setting(30.0, "no answer before", unit="s", low=1.0, high=3600.0)
    worst_sigma_deg: float = setting(20.0, "an azimuth less certain than this is refused", unit="deg", low=0.1, high=90)
    gyro_noise_deg_rth: float = setting(0.05, "white noise, y and z", unit="deg/sqrt(h)", low=1e-5, high=10.0)
    gyro_x_noise_deg_rth: float = setting(0.42, "white noise, x", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    accel_noise_ug_rthz: float = setting(30.0, "accelerometer white noise", unit="ug/sqrt(Hz)", low=0.01, high=1e4)
    gyro_bias_deg_h: float = setting(1.0, "bias not known to better than, y and z", unit="deg/h", low=0.0, high=1e5)
    gyro_x_bias_deg_h: float = setting(36.0, "bias not known to better than, x", unit="deg/h", low=0.0, high=1e5)
    accel_bias_ug: float = setting(100.0, "force bias not known to better than", unit="ug", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(0.02, "bias random walk per root hour", unit="deg/h", low=0.0, high=1e4)
    scale_x_ppm: float = setting(5000.0, "scale of the x gyro not known to better than", unit="ppm", low=0.0, high=1e5)
    leak_urad: float = setting(500.0, "x rate that y and z feel, uncalibrated rest", unit="urad", low=0.0, high=1e5)
    g_sensitivity_deg_h_g: float = setting(
        0.0, "g-sensitivity of y and z, uncalibrated rest", unit="deg/h/g", low=0.0, high=1e3
    )
    g_calibration_deg_h_g: tuple[float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0), "calibrated g-sensitivity: along, across, stretch, shear", unit="deg/h/g"
    )
    g_locked_deg_h_g: float | None = setting(
        None, "what calibration leaves of along and across, where less than the rest", unit="deg/h/g", low=0.0, high=1e3
    )
    expected_azimuth_deg: float | None = setting(
        None, "only chooses between azimuths that fit equally", unit="deg", low=-360.0, high=720.0
    )
    lag_ms: float = setting(0.0, "y and z gyros behind the x gyro", unit="ms", low=-50.0, high=50.0)
    lag_sigma_ms: float = setting(0.05, "that lag is known to", unit="ms", low=0.0, high=50.0)
    lead_ms: float = setting(0.0, "accelerometer ahead of the x gyro", unit="ms", low=-50.0, high=50.0)
    lead_sigma_ms: float = setting(3.0, "that lead is known to; a spin-up shows it", unit="ms", low=0.0, high=50.0)
    sigma_velocity: float = setting(0.005, "the tool's velocity stays within", unit="m/s", low=1e-6, high=10.0)
    axis_walk_deg_rth: float = setting(
        0.0005, "random turning of the hole axis itself", unit="deg/sqrt(h)", low=0.0, high=1e3
    )
    block_seconds: float = setting(0.1, "time between two updates", unit="s", low=0.01, high=1.0)
    level_seconds: float = setting(2.0, "mean force that starts the filter", unit="s", low=0.1, high=60.0)
    gap: float = setting(1.0, "a longer silence begins the seek anew", unit="s", low=0.01, high=60.0)
    gyro_range_dps: float = setting(400.0, "y and z gyros clip at", unit="deg/s", low=1.0, high=5000.0)


@dataclasses.dataclass
class State:
    """All that changes: clock, tool-to-level matrix, linear state, covariance, sums of the block, memory."""

    clock: Stamps
    mat: Array
    x: Array
    P: Array
    sums: Array
    memory: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Solution:
    """
    A north seek so far.

    Attributes
    ----------
    success : bool
    reason : str
        Why it was refused, in a driller's words; empty on success.
    method : str
        still, two_position, rotating or continuous: what the tool did.
    azimuth, sigma : float
        Of the hole axis from true north and its one sigma, rad; given also when refused, NaN before the filter runs.
    inclination : float
        Of the hole axis from the vertical, rad.
    toolface : float
        Azimuth of the scribe line seen from above, from true north, rad; what a near-vertical hole has instead.
    elapsed : float
        s of data used.
    limit : float
        Sigma of an ideal estimator with this gyro noise, time, latitude and geometry, rad.
    g_sensitivity_deg_h_g, sigma_g_deg_h_g : tuple of four floats
        Rate along the force across the tool, a quarter turn from it, and the stretch and shear between the two; the
        first two stand still in the hole like the Earth rate does, the last two turn and average out.
    bias_deg_h, sigma_bias_deg_h : tuple of three floats
    """

    success: bool
    reason: str
    method: str
    azimuth: float
    sigma: float
    inclination: float
    toolface: float
    elapsed: float
    limit: float
    g_sensitivity_deg_h_g: tuple[float, ...]
    sigma_g_deg_h_g: tuple[float, ...]
    bias_deg_h: tuple[float, ...]
    sigma_bias_deg_h: tuple[float, ...]


def initial() -> State:
    """State before the first sample."""
    return State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64),
        np.eye(3).ravel().copy(),
        np.zeros(STATES),
        np.zeros((STATES, STATES)),
        np.zeros(SUMS),
        np.zeros(MEMORY),
    )


def dual_unit(
    stamp_ns: ArrayLike, precision_t: ArrayLike, ahrs_stamp_ns: ArrayLike, ahrs_t: ArrayLike, x_range: float
) -> Array:
    """
    Rates of the precision unit with the x axis of the conventional unit, which does not clip while the string turns.

    stamp_ns, shape (n,) int64, and precision_t, shape (n, 3), rad/s: the unit whose stamps count. ahrs_stamp_ns, shape
    (m,), and ahrs_t, shape (m, 3). x_range: rate at which the precision x axis clips, rad/s; the precision x rate is
    kept in every sample well below it. Returns shape (n, 3). In `Params`, x is the unit that gives most of the samples.

    Raises
    ------
    ValueError
        No AHRS sample.
    """
    stamps, ahrs_stamps = np.asarray(stamp_ns, dtype=np.int64), np.asarray(ahrs_stamp_ns, dtype=np.int64)
    rates, ahrs = np.array(precision_t, dtype=float), np.asarray(ahrs_t, dtype=float)
    if ahrs_stamps.size == 0:
        raise ValueError("ahrs_stamp_ns: the conventional unit gave no sample to take the x rate from")
    # Seconds from a common start keep their digits in a float.
    start = ahrs_stamps[0]
    x = np.interp((stamps - start) * 1e-9, (ahrs_stamps - start) * 1e-9, ahrs[:, 0])
    fast = (np.abs(x) > 0.9 * x_range) | (np.abs(rates[:, 0]) > 0.9 * x_range)
    rates[fast, 0] = x[fast]
    return rates


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> None:
    """
    Take in a block of samples; ask `solution` for the azimuth at any time.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s (see `dual_unit`), and specific force (up at rest), m/s^2, in tool axes. Rates are means
        over the interval that ends at the stamp.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    _run(
        kernel_settings(params), round(params.gap * 1e9), state.clock, state.mat, state.x, state.P, state.sums,
        state.memory, stamps, gyro, accel,
    )  # fmt: skip


def kernel_settings(params: Params) -> Array:
    """Settings in SI, in the order of the K_ names, shape (SETTINGS,)."""
    k = np.zeros(SETTINGS)
    latitude = math.radians(params.latitude_deg)
    k[K_HORIZONTAL], k[K_VERTICAL] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    k[K_GRAVITY], k[K_LEVEL], k[K_BLOCK] = params.gravity, params.level_seconds, params.block_seconds
    k[K_N], k[K_NX] = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR, params.gyro_x_noise_deg_rth * DEG_PER_ROOT_HOUR
    k[K_NA] = params.accel_noise_ug_rthz * MICRO_G
    k[K_B], k[K_BX] = params.gyro_bias_deg_h * DEG_PER_HOUR, params.gyro_x_bias_deg_h * DEG_PER_HOUR
    k[K_BA], k[K_WALK] = params.accel_bias_ug * MICRO_G, params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0
    k[K_SCALE], k[K_LEAK] = params.scale_x_ppm * 1e-6, params.leak_urad * 1e-6
    k[K_G] = params.g_sensitivity_deg_h_g * DEG_PER_HOUR / track.STANDARD_GRAVITY
    locked = params.g_sensitivity_deg_h_g if params.g_locked_deg_h_g is None else params.g_locked_deg_h_g
    k[K_LOCKED] = locked * DEG_PER_HOUR / track.STANDARD_GRAVITY
    k[K_LAG0], k[K_LAG] = params.lag_ms * 1e-3, params.lag_sigma_ms * 1e-3
    k[K_LEAD0], k[K_LEAD] = params.lead_ms * 1e-3, params.lead_sigma_ms * 1e-3
    k[K_VEL], k[K_AXIS_WALK] = params.sigma_velocity, params.axis_walk_deg_rth * DEG_PER_ROOT_HOUR
    k[K_FLOOR], k[K_RANGE], k[K_STILL] = 1e-6, 0.98 * math.radians(params.gyro_range_dps), 0.05
    k[K_G0 : K_G0 + 4] = np.array(params.g_calibration_deg_h_g) * DEG_PER_HOUR / track.STANDARD_GRAVITY
    if params.expected_azimuth_deg is not None:
        expected = math.radians(params.expected_azimuth_deg)
        k[K_EXPECTED], k[K_EXPECTED + 1] = k[K_HORIZONTAL] * math.cos(expected), -k[K_HORIZONTAL] * math.sin(expected)
    return k


def solution(params: Params, state: State) -> Solution:
    """
    Azimuth so far, or why there is none; call it as often as progress is to be shown.

    Refused: no filter yet or too short, above 85 deg latitude, many clipped samples, a tool that turned or moved where
    keeping still was asked for, a hole so near horizontal east-west that turning about its axis shows no north, a gyro
    bias that nothing in the motion shows, a horizontal Earth rate that is not this latitude's, a gyro error far from
    what the settings state.
    """
    m, x, P = state.memory, state.x, state.P
    if m[PHASE] != SEEKING:
        return _none(params, f"too short: {m[LEVEL_TIME]:.0f} s of {params.shortest:.0f} s; the tool is being levelled")
    k = kernel_settings(params)
    method = _method(params, m)
    hole = m[H0 : H0 + 3].copy()
    hx, hy, hz, rx, ry = _frame(m)
    hole += x[AXIS] * np.array([hx, hy, hz]) + x[AXIS + 1] * np.array([rx, ry, 0.0])
    inclination = math.atan2(math.hypot(hole[0], hole[1]), hole[2])
    heading = math.atan2(hole[1], hole[0])
    across = max(math.hypot(hole[0], hole[1]), 1e-3)
    # Azimuth of the level frame's x axis from the circle, then a heading in that frame: of the mean axis of a tool that
    # turns, of the axis as it lies of a tool that rests.
    right = np.zeros(STATES)
    if method in ("still", "two_position"):
        ax, ay, az = state.mat[0], state.mat[3], state.mat[6]
        across2 = max(float(ax * ax + ay * ay), 1e-6)
        inclination, heading = math.atan2(math.hypot(ax, ay), az), math.atan2(ay, ax)
        right[:3] = -ax * az / across2, -ay * az / across2, 1.0
    else:
        right[AXIS + 1] = 1.0 / across
    expected = params.expected_azimuth_deg
    mean, sigma, misfit, several = _on_circle(
        x[EARTH : EARTH + 2],
        P,
        right,
        float(k[K_HORIZONTAL]),
        None if expected is None else math.radians(expected) - heading,
    )
    azimuth = float(wrap_tau(mean + heading))
    scribe = state.mat.reshape(3, 3)[:, 2]
    blind = math.sin(inclination) * math.sin(azimuth)
    factor = math.sqrt(max(1.0 - blind * blind, 1e-12)) if method != "still" else 1.0
    elapsed = float(m[ELAPSED])
    limit = k[K_N] / (k[K_HORIZONTAL] * max(factor, 1e-3) * math.sqrt(max(elapsed, 1e-3)))
    if method == "continuous":
        limit = max(limit, k[K_N] / math.sqrt(k[K_HORIZONTAL] * max(factor, 1e-3)))
    choices = tuple(float(wrap_tau(angle + heading)) for angle in several)
    reason = _refusal(params, state, method, azimuth, sigma, inclination, factor, misfit, choices)
    per_g = track.STANDARD_GRAVITY / DEG_PER_HOUR
    spread = np.sqrt(np.maximum(np.diag(P), 0.0))
    return Solution(
        not reason,
        reason,
        method,
        azimuth,
        sigma,
        inclination,
        float(wrap_tau(mean + math.atan2(scribe[1], scribe[0]))),
        elapsed,
        min(float(limit), math.pi),
        tuple(float(v) for v in x[GSENS : GSENS + 4] * per_g),
        tuple(float(v) for v in spread[GSENS : GSENS + 4] * per_g),
        tuple(float(v) for v in x[BIAS : BIAS + 3] / DEG_PER_HOUR),
        tuple(float(v) for v in spread[BIAS : BIAS + 3] / DEG_PER_HOUR),
    )


def calibrated(params: Params, state: State, azimuth: float, sigma: float) -> Params:
    """
    Settings with the g-sensitivity that a run at a known azimuth shows: a surface check of the turning tool.

    azimuth, sigma: of the hole axis from true north and its one sigma, rad.

    Raises
    ------
    ValueError
        The run has not got past levelling.
    """
    m = state.memory
    if m[PHASE] != SEEKING:
        raise ValueError("state: the calibration run is too short, it is still being levelled")
    k = kernel_settings(params)
    hx, hy, _, rx, ry = _frame(m)
    east = m[H0 + 1] + state.x[AXIS] * hy + state.x[AXIS + 1] * ry
    north = m[H0] + state.x[AXIS] * hx + state.x[AXIS + 1] * rx
    frame = azimuth - math.atan2(east, north)
    wanted = k[K_HORIZONTAL] * np.array([math.cos(frame), -math.sin(frame)])
    noise = np.eye(2) * (k[K_HORIZONTAL] * max(sigma, 1e-6)) ** 2
    P, at, g = state.P, slice(EARTH, EARTH + 2), slice(GSENS, GSENS + 4)
    gain = P[g, at] @ np.linalg.inv(P[at, at] + noise)
    per_g = track.STANDARD_GRAVITY / DEG_PER_HOUR
    values = (state.x[g] + gain @ (wanted - state.x[at])) * per_g
    rest = np.sqrt(np.maximum(np.diag(P[g, g] - gain @ P[at, g]), 0.0)) * per_g
    return dataclasses.replace(
        params,
        g_calibration_deg_h_g=(float(values[0]), float(values[1]), float(values[2]), float(values[3])),
        g_locked_deg_h_g=float(rest[:2].max()),
    )


def _none(params: Params, reason: str) -> Solution:
    nothing = (math.nan,) * 4
    if abs(params.latitude_deg) > 85.0:
        reason = _polar(params)
    return Solution(
        False, reason, params.mode, math.nan, math.nan, math.nan, math.nan, 0.0, math.nan,
        nothing, nothing, nothing[:3], nothing[:3],
    )  # fmt: skip


def _polar(params: Params) -> str:
    return (
        f"latitude {params.latitude_deg:.1f} deg is too near the pole: the Earth's rotation is vertical there and no "
        "gyro finds north above 85 deg"
    )


def _method(params: Params, m: Array) -> str:
    if params.mode == "continuous":
        return "continuous"
    if m[TURN_TIME] > m[STILL_TIME]:
        return "rotating"
    return "two_position" if m[POSITIONS] > 1.0 and m[TURN_TIME] > 0.0 else "still"


def _on_circle(
    earth: Array, P: Array, right: Array, horizontal: float, expected: float | None
) -> tuple[float, float, float, tuple[float, ...]]:
    """
    Mean and sigma of frame azimuth + right . x on the circle of the latitude's Earth rate.

    Returns mean, sigma, the squared misfit to the circle, and the several azimuths that fit where there are several.

    The prior of the Earth-rate state is isotropic about zero, hence constant on the circle (with an expected azimuth:
    three Earth rates wide, hence nearly so): restricting the filter's Gaussian to the circle is the posterior, however
    wide, with one mode or two.
    """
    S = P[EARTH : EARTH + 2, EARTH : EARTH + 2]
    inverse = np.linalg.inv(S)
    cross = right @ P[:, EARTH : EARTH + 2] @ inverse
    own = max(float(right @ P @ right) - float(cross @ S @ cross), 0.0)

    def cost(angle: Array) -> tuple[Array, Array]:
        d = horizontal * np.stack([np.cos(angle), -np.sin(angle)], axis=-1) - earth
        return np.einsum("ni,ij,nj->n", d, inverse, d), d @ cross

    modes = _modes(lambda angle: cost(angle)[0])
    widths = []
    for mode, _ in modes:
        tangent = horizontal * np.array([-math.sin(mode), -math.cos(mode)])
        widths.append(1.0 / math.sqrt(float(tangent @ inverse @ tangent)))
    least = min(chi2 for _, chi2 in modes)
    if len(modes) > 1 and expected is not None:
        # The driller's azimuth chooses the side, it does not move the answer.
        nearest = min(range(len(modes)), key=lambda i: abs(float(wrap_pi(modes[i][0] - expected))))
        modes, widths = [modes[nearest]], [widths[nearest]]
    if max(widths) < 0.05:
        grid = np.concatenate(
            [mode + np.linspace(-8.0, 8.0, 321) * w for (mode, _), w in zip(modes, widths, strict=True)]
        )
        spacing = np.repeat(widths, 321)
    elif len(modes) == 1 and expected is not None:
        grid = modes[0][0] + np.linspace(-0.5 * math.pi, 0.5 * math.pi, 721)
        spacing = np.ones(721)
    else:
        grid = np.linspace(-math.pi, math.pi, 1440, endpoint=False)
        spacing = np.ones(1440)
    chi2, shift = cost(grid)
    weight = np.exp(-0.5 * (chi2 - chi2.min())) * spacing
    weight /= weight.sum()
    total = grid + shift
    mean = math.atan2(float(weight @ np.sin(total)), float(weight @ np.cos(total)))
    variance = float(weight @ wrap_pi(total - mean) ** 2) + own
    others = tuple(mode for mode, _ in modes) if len(modes) > 1 else ()
    return mean, min(math.sqrt(variance), math.pi), least, others


def _modes(cost: Callable[[Array], Array]) -> list[tuple[float, float]]:
    """Every angle where the misfit is least nearby and within 25 of the best, with that misfit."""
    grid = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    values = cost(grid)
    low = (values <= np.roll(values, 1)) & (values < np.roll(values, -1))
    found = []
    for angle in grid[low]:
        step = math.radians(1.0)
        for _ in range(5):
            near = angle + np.linspace(-step, step, 41)
            angle = near[np.argmin(cost(near))]
            step /= 12.0
        found.append((float(angle), float(cost(np.array([angle]))[0])))
    best = min(chi2 for _, chi2 in found)
    return [(angle, chi2) for angle, chi2 in found if chi2 < best + 25.0]


def _refusal(
    params: Params,
    state: State,
    method: str,
    azimuth: float,
    sigma: float,
    inclination: float,
    factor: float,
    misfit: float,
    several: tuple[float, ...],
) -> str:
    m, elapsed = state.memory, float(state.memory[ELAPSED])
    if abs(params.latitude_deg) > 85.0:
        return _polar(params)
    if m[CLIPPED] > 0.001 * m[SAMPLES]:
        return (
            f"the y or z gyro clipped at {params.gyro_range_dps:.0f} deg/s in {m[CLIPPED]:.0f} of {m[SAMPLES]:.0f} "
            "samples: turn slower or stop the pumps"
        )
    if elapsed < params.shortest:
        return f"too short: {elapsed:.0f} s of {params.shortest:.0f} s"
    if params.mode == "still" and m[TURN_TIME] > 0.02 * elapsed:
        return f"the tool turned for {m[TURN_TIME]:.0f} s of {elapsed:.0f} s: a still shot needs the string at rest"
    if params.mode == "rotating" and m[TURN_TIME] < 0.5 * elapsed:
        return f"the tool turned for only {m[TURN_TIME]:.0f} s of {elapsed:.0f} s: keep the string turning"
    if params.mode == "two_position" and m[POSITIONS] < 2.0:
        return "the tool was not turned to a second position: turn it half a turn about its axis and wait again"
    shake = math.sqrt(max(m[SCATTER], m[SCATTER + 1], 0.0))
    if params.mode != "continuous" and m[MOVED] > 0.0:
        return f"the tool moved: the hole axis lay elsewhere {m[MOVED]:.0f} times; keep off bottom and in one place"
    if params.mode == "still" and shake > math.radians(0.05):
        return f"the tool shakes: its axis swings by {math.degrees(shake):.2f} deg; a still shot needs pumps off"
    if math.degrees(inclination) < 3.0 or math.degrees(inclination) > 177.0:
        return f"inclination {math.degrees(inclination):.1f} deg: a vertical hole has no azimuth; use the scribe line's"
    if factor < 0.17 and method in ("rotating", "two_position") and sigma > math.radians(params.worst_sigma_deg) / 4.0:
        off = math.degrees(math.asin(min(1.0, factor)))
        return (
            f"the hole lies within {max(off, 0.5):.0f} deg of horizontal east-west (azimuth about "
            f"{math.degrees(azimuth):.0f} deg): turning the tool about its axis does not show north there; take a "
            "still shot with a known gyro bias"
        )
    strange = _strange(params, state)
    if strange:
        return strange
    if several and sigma > math.radians(params.worst_sigma_deg) / 4.0:
        fits = " and ".join(f"{math.degrees(angle):.1f}" for angle in several)
        return (
            f"azimuths {fits} deg fit equally: turned about its axis, a tool this near the horizontal does not tell "
            "north from south of east-west; give the expected azimuth"
        )
    if misfit > 16.0:
        return (
            f"the horizontal Earth rate found does not fit latitude {params.latitude_deg:.1f} deg "
            f"({math.sqrt(misfit):.1f} sigma): the tool moved, or a gyro error is larger than stated"
        )
    if math.degrees(sigma) > params.worst_sigma_deg:
        noise = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR / math.sqrt(elapsed)
        if params.gyro_bias_deg_h * DEG_PER_HOUR > 2.0 * noise and method == "still":
            return (
                f"the gyro bias is known only to {params.gyro_bias_deg_h:.2g} deg/h, which leaves the azimuth "
                f"uncertain by {math.degrees(sigma):.0f} deg: turn the tool half a turn about its axis and wait again"
            )
        return f"not certain enough: {math.degrees(sigma):.0f} deg after {elapsed:.0f} s; wait longer"
    return ""


def _strange(params: Params, state: State) -> str:
    """What was found far from where the settings say it lies, in words; empty where all fits."""
    stated = (
        ("x gyro bias", BIAS, params.gyro_x_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("y gyro bias", BIAS + 1, params.gyro_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("z gyro bias", BIAS + 2, params.gyro_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("x gyro scale error", SCALE, params.scale_x_ppm * 1e-6, 1e-6, "ppm"),
        ("x rate in the y gyro", LEAK, params.leak_urad * 1e-6, 1e-6, "urad"),
        ("x rate in the z gyro", LEAK + 1, params.leak_urad * 1e-6, 1e-6, "urad"),
    )
    for name, at, sigma, unit, word in stated:
        if abs(state.x[at]) > 5.0 * sigma:
            return (
                f"{name} comes out at {state.x[at] / unit:.3g} {word}, stated within {sigma / unit:.3g}: check the unit"
            )
    return ""


@compiled
def sample(k: Array, mat: Array, half: Array, x: Array, s: Array, dt: float, w: Array, f: Array) -> None:
    """
    Carry attitude and velocity through one sample and add what the block's error model needs, in place.

    mat, half: tool-to-level matrix by rows, and room for the one in the middle of the sample. w, f: rate, rad/s, and
    force, m/s^2, as measured.
    """
    wx = (w[0] - x[BIAS]) / (1.0 + x[SCALE])
    wy = w[1] - x[BIAS + 1] - x[LEAK] * wx - (x[GSENS] + x[GSENS + 2]) * f[1] - (x[GSENS + 3] + x[GSENS + 1]) * f[2]
    wz = w[2] - x[BIAS + 2] - x[LEAK + 1] * wx - (x[GSENS + 3] - x[GSENS + 1]) * f[1] - (x[GSENS] - x[GSENS + 2]) * f[2]
    # A late gyro saw the level frame from an earlier roll: turn its answer on by what the tool rolled meanwhile.
    late = wx * x[LAG]
    c_late, s_late = math.cos(late), math.sin(late)
    wy, wz = c_late * wy + s_late * wz, c_late * wz - s_late * wy
    fx, gy, gz = f[0] - x[FORCE], f[1] - x[FORCE + 1], f[2] - x[FORCE + 2]
    # The force was felt when the tool had rolled on beyond what the x gyro has told yet.
    ahead = wx * x[LEAD]
    c, q = math.cos(ahead), math.sin(ahead)
    fy, fz = c * gy - q * gz, c * gz + q * gy
    en, ee, ed = x[EARTH], x[EARTH + 1], k[K_VERTICAL]
    rotate_by(mat, 0, True, -dt * en, -dt * ee, -dt * ed)
    rotate_by(mat, 0, False, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    for i in range(9):
        half[i] = mat[i]
    rotate_by(mat, 0, False, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    # Earth rate in tool axes, across the tool: what a lag turns.
    ey = half[1] * en + half[4] * ee + half[7] * ed
    ez = half[2] * en + half[5] * ee + half[8] * ed
    s[S_TIME] += dt
    for i in range(3):
        a, b, d = half[3 * i], half[3 * i + 1], half[3 * i + 2]
        s[S_MAT + 3 * i] += a * dt
        s[S_MAT + 3 * i + 1] += b * dt
        s[S_MAT + 3 * i + 2] += d * dt
        s[S_SCALE + i] += a * wx * dt
        s[S_LAG + i] += (d * ey - b * ez) * wx * dt
        s[S_FORCE + i] += (a * fx + b * fy + d * fz) * dt
        # What the y and z gyros say wrongly is turned on with what they say rightly.
        b, d = c_late * b - s_late * d, s_late * b + c_late * d
        s[S_BIAS + 2 * i] += b * dt
        s[S_BIAS + 2 * i + 1] += d * dt
        s[S_LEAK + 2 * i] += b * wx * dt
        s[S_LEAK + 2 * i + 1] += d * wx * dt
        s[S_GSENS + 4 * i] += (b * f[1] + d * f[2]) * dt
        s[S_GSENS + 4 * i + 1] += (b * f[2] - d * f[1]) * dt
        s[S_GSENS + 4 * i + 2] += (b * f[1] - d * f[2]) * dt
        s[S_GSENS + 4 * i + 3] += (b * f[2] + d * f[1]) * dt
    s[S_LEAD] += (half[2] * fy - half[1] * fz) * wx * dt
    s[S_LEAD + 1] += (half[5] * fy - half[4] * fz) * wx * dt
    x[VEL] += (half[0] * fx + half[1] * fy + half[2] * fz) * dt
    x[VEL + 1] += (half[3] * fx + half[4] * fy + half[5] * fz) * dt
    s[S_TURN] += wx * dt


@compiled
def transition(k: Array, x: Array, s: Array, phi: Array) -> None:
    """Fill phi, shape (5, STATES): attitude and velocity error after the block from the error state before it."""
    t = s[S_TIME]
    en, ee, ed = x[EARTH] * t, x[EARTH + 1] * t, k[K_VERTICAL] * t
    for i in range(5):
        for j in range(STATES):
            phi[i, j] = 0.0
    phi[0, 0], phi[1, 1], phi[2, 2], phi[3, 3], phi[4, 4] = 1.0, 1.0, 1.0, 1.0, 1.0
    phi[0, 1], phi[0, 2], phi[1, 0], phi[1, 2], phi[2, 0], phi[2, 1] = ed, -ee, -ed, en, ee, -en
    phi[0, EARTH], phi[1, EARTH + 1] = -t, -t
    for i in range(3):
        phi[i, BIAS] = -s[S_MAT + 3 * i]
        phi[i, BIAS + 1], phi[i, BIAS + 2] = -s[S_BIAS + 2 * i], -s[S_BIAS + 2 * i + 1]
        phi[i, SCALE] = -s[S_SCALE + i]
        phi[i, LEAK] = -s[S_LEAK + 2 * i]
        phi[i, LEAK + 1] = -s[S_LEAK + 2 * i + 1]
        for j in range(4):
            phi[i, GSENS + j] = -s[S_GSENS + 4 * i + j]
        phi[i, LAG] = -s[S_LAG + i]
    # Velocity: attitude error (mean of before and after) x force, less the force bias.
    fx, fy, fz = s[S_FORCE], s[S_FORCE + 1], s[S_FORCE + 2]
    for j in range(STATES):
        m0 = 0.5 * (phi[0, j] + (1.0 if j == 0 else 0.0))
        m1 = 0.5 * (phi[1, j] + (1.0 if j == 1 else 0.0))
        m2 = 0.5 * (phi[2, j] + (1.0 if j == 2 else 0.0))
        phi[3, j] += m1 * fz - m2 * fy
        phi[4, j] += m2 * fx - m0 * fz
    phi[3, LEAD] += s[S_LEAD]
    phi[4, LEAD] += s[S_LEAD + 1]
    for j in range(3):
        phi[3, FORCE + j] -= s[S_MAT + j]
        phi[4, FORCE + j] -= s[S_MAT + 3 + j]


@compiled
def _predict(k: Array, s: Array, phi: Array, P: Array, rows: Array) -> None:
    t = s[S_TIME]
    for i in range(5):
        for j in range(STATES):
            rows[i, j] = 0.0
        for m in range(STATES):
            c = phi[i, m]
            if c != 0.0:
                for j in range(STATES):
                    rows[i, j] += c * P[m, j]
    for i in range(5):
        for j in range(5, STATES):
            P[i, j] = rows[i, j]
            P[j, i] = rows[i, j]
        for j in range(i + 1):
            total = 0.0
            for m in range(STATES):
                c = phi[j, m]
                if c != 0.0:
                    total += rows[i, m] * c
            P[i, j] = total
            P[j, i] = total
    # White noise: y and z alike, x its own; only the axis direction matters.
    n2, extra = k[K_N] ** 2 * t, (k[K_NX] ** 2 - k[K_N] ** 2) / t
    for i in range(3):
        P[i, i] += n2
        for j in range(3):
            P[i, j] += extra * s[S_MAT + 3 * i] * s[S_MAT + 3 * j]
        P[BIAS + i, BIAS + i] += k[K_WALK] ** 2 * t
    P[VEL, VEL] += k[K_NA] ** 2 * t
    P[VEL + 1, VEL + 1] += k[K_NA] ** 2 * t
    P[AXIS, AXIS] += k[K_AXIS_WALK] ** 2 * t
    P[AXIS + 1, AXIS + 1] += k[K_AXIS_WALK] ** 2 * t


@compiled
def _scalar(P: Array, dx: Array, h: Array, gain: Array, y: float, r2: float) -> float:
    """One scalar update on the error not yet fed back, dx; returns the innovation y - h dx; r2 < 0: only look."""
    for i in range(STATES):
        gain[i] = 0.0
    for j in range(STATES):
        c = h[j]
        if c != 0.0:
            y -= c * dx[j]
            for i in range(STATES):
                gain[i] += P[i, j] * c
    spread = 0.0
    for j in range(STATES):
        spread += h[j] * gain[j]
    if r2 < 0.0:
        gain[0] = spread
        return y
    total = spread + r2
    for i in range(STATES):
        dx[i] += gain[i] / total * y
        for j in range(i + 1):
            P[i, j] -= gain[i] * gain[j] / total
            P[j, i] = P[i, j]
    return y


@compiled
def _direction(
    m: Array, r_at: int, k: Array, P: Array, dx: Array, h: Array, gain: Array, y: float, share: float
) -> bool:
    """Update by one angle that keeps still, with the scatter seen so far as its noise; False if it was gated out."""
    innovation = _scalar(P, dx, h, gain, y, -1.0)
    spread = gain[0]
    r2 = max(k[K_FLOOR] ** 2, m[SCATTER + r_at])
    ok = innovation * innovation < _GATE * (spread + r2)
    # What the prediction does not explain; never below zero, or a wide start would vouch for a noise that is not there.
    seen = max(min(innovation * innovation, _GATE * (spread + r2)) - spread, 0.0)
    m[SCATTER + r_at] += share * (seen - m[SCATTER + r_at])
    if ok:
        _scalar(P, dx, h, gain, y, r2)
    return bool(ok)


@compiled
def _frame(m: Array) -> tuple[float, float, float, float, float]:
    """High side (3) and right side (north, east) of the reference axis in the level frame."""
    hx, hy, hz = m[H0], m[H0 + 1], m[H0 + 2]
    across = math.sqrt(hx * hx + hy * hy)
    if across < 1e-6:
        return -math.copysign(1.0, hz), 0.0, 0.0, 0.0, 1.0
    rx, ry = -hy / across, hx / across
    return ry * hz, -rx * hz, rx * hy - ry * hx, rx, ry


@compiled
def _begin(k: Array, mat: Array, x: Array, P: Array, s: Array) -> None:
    """Level the frame on the mean force; its heading is that of the tool axis, and the start covariance follows."""
    dx, dy, dz = -s[S_FORCE], -s[S_FORCE + 1], -s[S_FORCE + 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    ax, ay, az = s[S_MAT], s[S_MAT + 3], s[S_MAT + 6]
    along = ax * dx + ay * dy + az * dz
    nx, ny, nz = ax - along * dx, ay - along * dy, az - along * dz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-3 * s[S_TIME]:
        nx, ny, nz = (0.0, dz, -dy) if abs(dx) < 0.9 else (-dz, 0.0, dx)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    ex, ey, ez = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    for j in range(3):
        p, q, r = mat[j], mat[3 + j], mat[6 + j]
        mat[j] = nx * p + ny * q + nz * r
        mat[3 + j] = ex * p + ey * q + ez * r
        mat[6 + j] = dx * p + dy * q + dz * r
    for i in range(STATES):
        x[i] = 0.0
        for j in range(STATES):
            P[i, j] = 0.0
    x[LAG] = k[K_LAG0]
    # The frame's x axis is the hole's heading: a linearisation point only, three Earth rates wide.
    x[EARTH], x[EARTH + 1] = k[K_EXPECTED], k[K_EXPECTED + 1]
    for j in range(4):
        x[GSENS + j] = k[K_G0 + j]
        P[GSENS + j, GSENS + j] = k[K_LOCKED] ** 2 if j < 2 else k[K_G] ** 2
    for j in range(8):
        P[WOBBLE + j, WOBBLE + j] = 0.02**2 if j % 4 < 2 else 0.01**2
    for j in range(2):
        P[PHI + j, PHI + j] = 0.03**2
        P[VEL + j, VEL + j] = 0.1**2 + k[K_VEL] ** 2
        # Wide and the same in every direction: on the circle where azimuth is read it favours none.
        P[EARTH + j, EARTH + j] = (3.0 * k[K_HORIZONTAL]) ** 2
        P[LEAK + j, LEAK + j] = k[K_LEAK] ** 2
        P[BIAS + 1 + j, BIAS + 1 + j] = k[K_B] ** 2
        P[AXIS + j, AXIS + j] = 0.05**2
    P[PHI + 2, PHI + 2] = 1e-18
    P[BIAS, BIAS] = k[K_BX] ** 2
    P[SCALE, SCALE] = k[K_SCALE] ** 2
    P[LAG, LAG] = k[K_LAG] ** 2
    x[LEAD] = k[K_LEAD0]
    P[LEAD, LEAD] = k[K_LEAD] ** 2
    for j in range(3):
        P[FORCE + j, FORCE + j] = k[K_BA] ** 2
    P[ROLL, ROLL] = 0.05**2


@compiled
def _settle(m: Array, ax: float, ay: float, az: float, seen: float) -> None:
    """First look at how much the axis scatters from block to block."""
    if seen > 1.0:
        hx, hy, hz, rx, ry = _frame(m)
        px, py, pz = ax - m[LAST_AXIS], ay - m[LAST_AXIS + 1], az - m[LAST_AXIS + 2]
        m[DIFF2] += (px * hx + py * hy + pz * hz) ** 2
        m[DIFF2 + 1] += (px * rx + py * ry) ** 2
    m[LAST_AXIS], m[LAST_AXIS + 1], m[LAST_AXIS + 2] = ax, ay, az


@compiled
def _measure(k: Array, mat: Array, x: Array, P: Array, s: Array, m: Array, dx: Array, h: Array, gain: Array) -> None:
    """No velocity gained, hole axis where it was, and, in a tool that does not turn, roll where it was."""
    t = s[S_TIME]
    for j in range(STATES):
        dx[j] = 0.0
    for i in range(2):
        for j in range(STATES):
            h[j] = 0.0
        h[VEL + i] = 1.0
        _scalar(P, dx, h, gain, -x[VEL + i], k[K_VEL] ** 2)
    ax, ay, az, zx, zy, zz = mat[0], mat[3], mat[6], mat[2], mat[5], mat[8]
    if m[PHASE] == SETTLING:
        m[SETTLED] += 1.0
        if m[SETTLED] == 1.0:
            m[H0], m[H0 + 1], m[H0 + 2] = ax, ay, az
        _settle(m, ax, ay, az, m[SETTLED])
        if m[SETTLED] > _SETTLE_BLOCKS:
            m[PHASE] = SEEKING
            for j in range(2):
                m[SCATTER + j] = 0.5 * m[DIFF2 + j] / _SETTLE_BLOCKS
            m[SCATTER + 2] = max(m[SCATTER], m[SCATTER + 1])
            m[H0], m[H0 + 1], m[H0 + 2] = ax, ay, az
    else:
        hx, hy, hz, rx, ry = _frame(m)
        up, side = zx * hx + zy * hy + zz * hz, zx * rx + zy * ry
        share = 1.0 / (10.0 + min(m[SEEN], 20.0))
        m[SEEN] += 1.0
        ok = True
        for i in range(2):
            ux, uy, uz = (hx, hy, hz) if i == 0 else (rx, ry, 0.0)
            for j in range(STATES):
                h[j] = 0.0
            # -(phi x a).u = -phi.(a x u)
            h[0], h[1], h[2] = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
            h[AXIS + i] = 1.0
            # Wobble of the axis once and twice per turn of the scribe line.
            h[WOBBLE + 4 * i] = up
            h[WOBBLE + 4 * i + 1] = side
            h[WOBBLE + 4 * i + 2] = up * up - side * side
            h[WOBBLE + 4 * i + 3] = 2.0 * up * side
            y = (ax - m[H0]) * ux + (ay - m[H0 + 1]) * uy + (az - m[H0 + 2]) * uz - x[AXIS + i]
            for j in range(WOBBLE + 4 * i, WOBBLE + 4 * i + 4):
                y -= h[j] * x[j]
            ok = _direction(m, i, k, P, dx, h, gain, y, share) and ok
        if ok:
            m[REFUSED_BLOCKS] = 0.0
        else:
            m[REFUSED_BLOCKS] += 1.0
            if m[REFUSED_BLOCKS] >= 5.0:
                # The axis lies elsewhere now: forget where it lay.
                m[REFUSED_BLOCKS] = 0.0
                m[MOVED] += 1.0
                for j in range(2):
                    P[AXIS + j, AXIS + j] += 0.05**2
        quiet = abs(s[S_TURN]) < k[K_STILL] * t
        if quiet and m[STILL_RUN] >= 2.0:
            if m[STILL_RUN] == 2.0:
                m[K0], m[K0 + 1], m[K0 + 2] = zx, zy, zz
                x[ROLL] = 0.0
                dx[ROLL] = 0.0
                for j in range(STATES):
                    P[ROLL, j] = 0.0
                    P[j, ROLL] = 0.0
                P[ROLL, ROLL] = 0.05**2
                m[POSITIONS] += 1.0
            else:
                ux = m[H0 + 1] * m[K0 + 2] - m[H0 + 2] * m[K0 + 1]
                uy = m[H0 + 2] * m[K0] - m[H0] * m[K0 + 2]
                uz = m[H0] * m[K0 + 1] - m[H0 + 1] * m[K0]
                for j in range(STATES):
                    h[j] = 0.0
                h[0], h[1], h[2] = uy * zz - uz * zy, uz * zx - ux * zz, ux * zy - uy * zx
                h[ROLL] = 1.0
                y = (zx - m[K0]) * ux + (zy - m[K0 + 1]) * uy + (zz - m[K0 + 2]) * uz - x[ROLL]
                if not _direction(m, 2, k, P, dx, h, gain, y, share):
                    m[STILL_RUN] = 0.0
        m[STILL_RUN] = m[STILL_RUN] + 1.0 if quiet else 0.0
        if quiet:
            m[STILL_TIME] += t
        else:
            m[TURN_TIME] += t
        m[TURNED] += s[S_TURN]
        m[ELAPSED] += t
    rotate_by(mat, 0, True, dx[0], dx[1], dx[2])
    for j in range(VEL, STATES):
        x[j] += dx[j]


@compiled
def _run(
    k: Array,
    gap_ns: int,
    clock: Stamps,
    mat: Array,
    x: Array,
    P: Array,
    s: Array,
    m: Array,
    stamps: Stamps,
    gyro: Array,
    accel: Array,
) -> None:
    half, dx, h, gain = np.zeros(9), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    phi, rows = np.zeros((5, STATES)), np.zeros((5, STATES))
    for i in range(len(stamps)):
        w, f = gyro[i], accel[i]
        last = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], w[0], w[1], w[2], f[0], f[1], f[2], gap_ns)
        m[SAMPLES] += 1.0
        if verdict == track.REJECTED:
            m[REJECTED] += 1.0
            continue
        if verdict == track.FIRST:
            continue
        if abs(w[1]) > k[K_RANGE] or abs(w[2]) > k[K_RANGE]:
            m[CLIPPED] += 1.0
        if verdict == track.AFTER_GAP:
            # What the tool did meanwhile is unknown: begin again.
            gaps = m[GAPS] + 1.0
            for j in range(MEMORY):
                m[j] = 0.0
            m[GAPS] = gaps
            for j in range(SUMS):
                s[j] = 0.0
            for j in range(9):
                mat[j] = 1.0 if j % 4 == 0 else 0.0
            for j in range(STATES):
                x[j] = 0.0
            continue
        dt = (stamps[i] - last) * 1e-9
        sample(k, mat, half, x, s, dt, w, f)
        if m[PHASE] == LEVELLING:
            m[LEVEL_TIME] += dt
            if m[LEVEL_TIME] < k[K_LEVEL] - 1e-9:
                continue
            _begin(k, mat, x, P, s)
            m[PHASE] = SETTLING
        elif s[S_TIME] >= k[K_BLOCK] - 1e-9 or abs(s[S_TURN]) > _BLOCK_TURN:
            transition(k, x, s, phi)
            _predict(k, s, phi, P, rows)
            _measure(k, mat, x, P, s, m, dx, h, gain)
        else:
            continue
        for j in range(SUMS):
            s[j] = 0.0

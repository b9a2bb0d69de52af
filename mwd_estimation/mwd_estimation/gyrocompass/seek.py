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

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import samples as track
from mwd_estimation.gyrocompass import azimuth_posterior
from mwd_estimation.gyrocompass import seek_filter as nf
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import wrap_tau
from mwd_sensors.core.settings import setting

MODES = ("auto", "still", "two_position", "rotating", "continuous")
# How the refusals begin that a second position, or more time there, lifts.
BIAS_UNKNOWN, TWO_FIT = "the gyro bias is known only to", "two azimuths fit equally"


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of a north seek. Noise and calibration figures are one sigma; y and z belong to the precision unit."""

    latitude_deg: float = setting(34.0, "geodetic latitude, north positive", unit="deg", low=-90.0, high=90.0)
    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    mode: str = setting("auto", "what the tool does while it seeks", choices=MODES)
    shortest: float = setting(30.0, "no answer before", unit="s", low=1.0, high=3600.0)
    worst_sigma_deg: float = setting(20.0, "an azimuth less certain than this is refused", unit="deg", low=0.1, high=90)
    gyro_noise_deg_rth: float = setting(0.05, "white noise, y and z", unit="deg/sqrt(h)", low=1e-5, high=10.0)
    gyro_x_noise_deg_rth: float = setting(0.42, "white noise, x", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    accel_noise_ug_rthz: float = setting(30.0, "accelerometer white noise", unit="ug/sqrt(Hz)", low=0.01, high=1e4)
    gyro_bias_deg_h: float = setting(1.0, "bias not known to better than, y and z", unit="deg/h", low=0.0, high=1e5)
    bias_scale: str = setting(
        "stated",
        "stated: those are one sigma; at_most: one sigma or less, as the fit to the latitude shows",
        choices=("stated", "at_most"),
    )
    gyro_x_bias_deg_h: float = setting(36.0, "bias not known to better than, x", unit="deg/h", low=0.0, high=1e5)
    accel_bias_ug: float = setting(100.0, "force bias not known to better than", unit="ug", low=0.0, high=1e5)
    gyro_walk_deg_h_rth: float = setting(0.02, "bias random walk per root hour", unit="deg/h", low=0.0, high=1e4)
    scale_x_ppm: float = setting(5000.0, "scale of the x gyro not known to better than", unit="ppm", low=0.0, high=1e5)
    leak_urad: float = setting(500.0, "x rate that y and z feel, uncalibrated rest", unit="urad", low=0.0, high=1e5)
    g_sensitivity_deg_h_g: float = setting(
        0.0, "g-sensitivity of y and z, each to each, uncalibrated rest", unit="deg/h/g", low=0.0, high=1e3
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
    choices : tuple of (float, float)
        Azimuths and sigmas, rad, of which only one can be right, where that is why it was refused.
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
    choices: tuple[tuple[float, float], ...] = ()


def initial() -> State:
    """State before the first sample."""
    return State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64),
        np.eye(3).ravel().copy(),
        np.zeros(nf.STATES),
        np.zeros((nf.STATES, nf.STATES)),
        np.zeros(nf.SUMS),
        np.zeros(nf.MEMORY),
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
    nf.advance(
        kernel_settings(params), round(params.gap * 1e9), state.clock, state.mat, state.x, state.P, state.sums,
        state.memory, stamps, gyro, accel,
    )  # fmt: skip


def kernel_settings(params: Params) -> Array:
    """Settings in SI, in the order of the K_ names, shape (nf.SETTINGS,)."""
    k = np.zeros(nf.SETTINGS)
    latitude = math.radians(params.latitude_deg)
    k[nf.K_HORIZONTAL], k[nf.K_VERTICAL] = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    k[nf.K_GRAVITY], k[nf.K_LEVEL], k[nf.K_BLOCK] = params.gravity, params.level_seconds, params.block_seconds
    k[nf.K_N], k[nf.K_NX] = (
        params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR,
        params.gyro_x_noise_deg_rth * DEG_PER_ROOT_HOUR,
    )
    k[nf.K_NA] = params.accel_noise_ug_rthz * MICRO_G
    k[nf.K_B], k[nf.K_BX] = params.gyro_bias_deg_h * DEG_PER_HOUR, params.gyro_x_bias_deg_h * DEG_PER_HOUR
    k[nf.K_BA], k[nf.K_WALK] = params.accel_bias_ug * MICRO_G, params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0
    k[nf.K_SCALE], k[nf.K_LEAK] = params.scale_x_ppm * 1e-6, params.leak_urad * 1e-6
    # Four elements of one sigma: along, across, stretch and shear are half sums of two.
    element = params.g_sensitivity_deg_h_g * math.sqrt(0.5)
    k[nf.K_G] = element * DEG_PER_HOUR / STANDARD_GRAVITY
    locked = element if params.g_locked_deg_h_g is None else params.g_locked_deg_h_g
    k[nf.K_LOCKED] = locked * DEG_PER_HOUR / STANDARD_GRAVITY
    k[nf.K_LAG0], k[nf.K_LAG] = params.lag_ms * 1e-3, params.lag_sigma_ms * 1e-3
    k[nf.K_LEAD0], k[nf.K_LEAD] = params.lead_ms * 1e-3, params.lead_sigma_ms * 1e-3
    k[nf.K_VEL], k[nf.K_AXIS_WALK] = params.sigma_velocity, params.axis_walk_deg_rth * DEG_PER_ROOT_HOUR
    k[nf.K_FLOOR], k[nf.K_RANGE], k[nf.K_STILL] = 1e-6, 0.98 * math.radians(params.gyro_range_dps), 0.05
    k[nf.K_G0 : nf.K_G0 + 4] = np.array(params.g_calibration_deg_h_g) * DEG_PER_HOUR / STANDARD_GRAVITY
    if params.expected_azimuth_deg is not None:
        expected = math.radians(params.expected_azimuth_deg)
        k[nf.K_EXPECTED], k[nf.K_EXPECTED + 1] = (
            k[nf.K_HORIZONTAL] * math.cos(expected),
            -k[nf.K_HORIZONTAL] * math.sin(expected),
        )
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
    if m[nf.PHASE] != nf.SEEKING:
        return _none(
            params, f"too short: {m[nf.LEVEL_TIME]:.0f} s of {params.shortest:.0f} s; the tool is being levelled"
        )
    k = kernel_settings(params)
    method = _method(params, m)
    hole = m[nf.H0 : nf.H0 + 3].copy()
    hx, hy, hz, rx, ry = nf.frame(m)
    hole += x[nf.AXIS] * np.array([hx, hy, hz]) + x[nf.AXIS + 1] * np.array([rx, ry, 0.0])
    inclination = math.atan2(math.hypot(hole[0], hole[1]), hole[2])
    heading = math.atan2(hole[1], hole[0])
    across = max(math.hypot(hole[0], hole[1]), 1e-3)
    # Azimuth of the level frame's x axis from the circle, then a heading in that frame: of the mean axis of a tool that
    # turns, of the axis as it lies of a tool that rests.
    right = np.zeros(nf.STATES)
    if method in ("still", "two_position"):
        ax, ay, az = state.mat[0], state.mat[3], state.mat[6]
        across2 = max(float(ax * ax + ay * ay), 1e-6)
        inclination, heading = math.atan2(math.hypot(ax, ay), az), math.atan2(ay, ax)
        right[:3] = -ax * az / across2, -ay * az / across2, 1.0
    else:
        right[nf.AXIS + 1] = 1.0 / across
    expected = params.expected_azimuth_deg
    parts = _parts(params, k, x, P, right)
    on_circle = azimuth_posterior.posterior(
        parts,
        float(k[nf.K_HORIZONTAL]),
        None if expected is None else math.radians(expected) - heading,
    )
    mean, sigma, misfit, several = on_circle.mean, on_circle.sigma, on_circle.misfit, on_circle.several
    azimuth = float(wrap_tau(mean + heading))
    scribe = state.mat.reshape(3, 3)[:, 2]
    blind = math.sin(inclination) * math.sin(azimuth)
    factor = math.sqrt(max(1.0 - blind * blind, 1e-12)) if method != "still" else 1.0
    elapsed = float(m[nf.ELAPSED])
    limit = k[nf.K_N] / (k[nf.K_HORIZONTAL] * max(factor, 1e-3) * math.sqrt(max(elapsed, 1e-3)))
    if method == "continuous":
        limit = max(limit, k[nf.K_N] / math.sqrt(k[nf.K_HORIZONTAL] * max(factor, 1e-3)))
    fitting = tuple(float(wrap_tau(angle + heading)) for angle in several)
    reason = _refusal(params, state, method, azimuth, sigma, inclination, factor, misfit, fitting)
    choices: tuple[tuple[float, float], ...] = ()
    if reason.startswith(TWO_FIT):
        each = [azimuth_posterior.posterior(parts, float(k[nf.K_HORIZONTAL]), angle) for angle in several]
        if all(one.sigma <= math.radians(params.worst_sigma_deg) for one in each):
            choices = tuple((float(wrap_tau(one.mean + heading)), one.sigma) for one in each)
    per_g = STANDARD_GRAVITY / DEG_PER_HOUR
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
        tuple(float(v) for v in x[nf.GSENS : nf.GSENS + 4] * per_g),
        tuple(float(v) for v in spread[nf.GSENS : nf.GSENS + 4] * per_g),
        tuple(float(v) for v in x[nf.BIAS : nf.BIAS + 3] / DEG_PER_HOUR),
        tuple(float(v) for v in spread[nf.BIAS : nf.BIAS + 3] / DEG_PER_HOUR),
        choices,
    )


def carried_on(params: Params, state: State, seconds: float) -> State:
    """
    State that begins a seek elsewhere with what this one has found of the instrument: biases, scale, sensitivities.

    seconds: between the last sample of this seek and the first of the next, s; the instrument must have stayed on. A
    seek that has not got past levelling gives what it began with.
    """
    begun = initial()
    m = state.memory
    if m[nf.PHASE] != nf.SEEKING and m[nf.CARRIED] == 0.0:
        return begun
    begun.x[:], begun.P[:] = state.x, state.P
    walk = kernel_settings(params)[nf.K_WALK] ** 2 * max(seconds, 0.0)
    for i in range(nf.BIAS, nf.BIAS + 3):
        begun.P[i, i] += walk
    begun.memory[nf.CARRIED] = 1.0
    return begun


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
    if m[nf.PHASE] != nf.SEEKING:
        raise ValueError("state: the calibration run is too short, it is still being levelled")
    k = kernel_settings(params)
    hx, hy, _, rx, ry = nf.frame(m)
    east = m[nf.H0 + 1] + state.x[nf.AXIS] * hy + state.x[nf.AXIS + 1] * ry
    north = m[nf.H0] + state.x[nf.AXIS] * hx + state.x[nf.AXIS + 1] * rx
    frame = azimuth - math.atan2(east, north)
    wanted = k[nf.K_HORIZONTAL] * np.array([math.cos(frame), -math.sin(frame)])
    noise = np.eye(2) * (k[nf.K_HORIZONTAL] * max(sigma, 1e-6)) ** 2
    P, at, g = state.P, slice(nf.EARTH, nf.EARTH + 2), slice(nf.GSENS, nf.GSENS + 4)
    gain = P[g, at] @ np.linalg.inv(P[at, at] + noise)
    per_g = STANDARD_GRAVITY / DEG_PER_HOUR
    values = (state.x[g] + gain @ (wanted - state.x[at])) * per_g
    rest = np.sqrt(np.maximum(np.diag(P[g, g] - gain @ P[at, g]), 0.0)) * per_g
    return dataclasses.replace(
        params,
        g_calibration_deg_h_g=(float(values[0]), float(values[1]), float(values[2]), float(values[3])),
        g_locked_deg_h_g=float(rest[:2].max()),
    )


# Shares of the stated bias that are tried where it is only an upper bound: even odds that it is the bound itself, or
# somewhere below, evenly in the logarithm down to a 300th.
_SHARES = 300.0 ** (-np.arange(12.0) / 11.0)
_BOUND = math.log(11.0)


def _parts(params: Params, k: Array, x: Array, P: Array, right: Array) -> list[azimuth_posterior.Part]:
    """
    The filter's Gaussian of the Earth rate for each scale that the gyro biases may have.

    The filter runs with the stated scale. Another one is the same posterior times the ratio of the two priors, which is
    Gaussian too: a measurement "the bias is zero", and the evidence for that scale. A gyro whose rates fit the latitude
    along north and down, two checks that cost nothing, so earns a smaller bias east, where it cannot be checked.
    """
    at, bias = slice(nf.EARTH, nf.EARTH + 2), slice(nf.BIAS, nf.BIAS + 3)
    stated = np.array([k[nf.K_BX], k[nf.K_B], k[nf.K_B]])
    if params.bias_scale == "stated" or not (stated > 0.0).all():
        return [azimuth_posterior.part(0.0, x[at], P, right, at)]
    parts = []
    for share in _SHARES:
        if share == 1.0:
            parts.append(azimuth_posterior.part(_BOUND, x[at], P, right, at))
            continue
        noise = np.diag(stated**2 * share**2 / (1.0 - share**2))
        S = P[bias, bias] + noise
        gain = np.linalg.solve(S, P[bias]).T
        log = -3.0 * math.log(share) - 0.5 * float(x[bias] @ np.linalg.solve(S, x[bias]))
        log += 0.5 * float(np.linalg.slogdet(noise)[1] - np.linalg.slogdet(S)[1])
        moved = x - gain @ x[bias]
        parts.append(azimuth_posterior.part(log, moved[at], P - gain @ P[bias], right, at, float(right @ (moved - x))))
    return parts


def _none(params: Params, reason: str) -> Solution:
    nothing = (math.nan,) * 4
    if abs(params.latitude_deg) > 85.0:
        reason = polar(params)
    return Solution(
        False, reason, params.mode, math.nan, math.nan, math.nan, math.nan, 0.0, math.nan,
        nothing, nothing, nothing[:3], nothing[:3],
    )  # fmt: skip


def polar(params: Params) -> str:
    """Why north is not sought near the pole."""
    return (
        f"latitude {params.latitude_deg:.1f} deg is too near the pole: the Earth's rotation is vertical there and no "
        "gyro finds north above 85 deg"
    )


def _method(params: Params, m: Array) -> str:
    if params.mode == "continuous":
        return "continuous"
    if m[nf.TURN_TIME] > m[nf.STILL_TIME]:
        return "rotating"
    return "two_position" if m[nf.POSITIONS] > 1.0 and m[nf.TURN_TIME] > 0.0 else "still"


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
    m, elapsed = state.memory, float(state.memory[nf.ELAPSED])
    if abs(params.latitude_deg) > 85.0:
        return polar(params)
    if m[nf.CLIPPED] > 0.001 * m[nf.SAMPLES]:
        return (
            f"the y or z gyro clipped at {params.gyro_range_dps:.0f} deg/s in {m[nf.CLIPPED]:.0f} of "
            f"{m[nf.SAMPLES]:.0f} samples: turn slower or stop the pumps"
        )
    if elapsed < params.shortest:
        return f"too short: {elapsed:.0f} s of {params.shortest:.0f} s"
    if params.mode == "still" and m[nf.TURN_TIME] > 0.02 * elapsed:
        return f"the tool turned for {m[nf.TURN_TIME]:.0f} s of {elapsed:.0f} s: a still shot needs the string at rest"
    if params.mode == "rotating" and m[nf.TURN_TIME] < 0.5 * elapsed:
        return f"the tool turned for only {m[nf.TURN_TIME]:.0f} s of {elapsed:.0f} s: keep the string turning"
    if params.mode == "two_position" and m[nf.POSITIONS] < 2.0:
        return "the tool was not turned to a second position: turn it half a turn about its axis and wait again"
    shake = math.sqrt(max(m[nf.SCATTER], m[nf.SCATTER + 1], 0.0))
    if params.mode != "continuous" and m[nf.MOVED] > 0.0:
        return f"the tool moved: the hole axis lay elsewhere {m[nf.MOVED]:.0f} times; keep off bottom and in one place"
    if params.mode == "still" and shake > math.radians(0.05):
        return f"the tool shakes: its axis swings by {math.degrees(shake):.2f} deg; a still shot needs pumps off"
    if math.degrees(inclination) < 3.0 or math.degrees(inclination) > 177.0:
        return f"inclination {math.degrees(inclination):.1f} deg: a vertical hole has no azimuth; use the scribe line's"
    if several:
        # The mean of two that fit is neither.
        factor = max(math.sqrt(max(1.0 - (math.sin(inclination) * math.sin(angle)) ** 2, 0.0)) for angle in several)
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
            f"{TWO_FIT}, {fits} deg: turned about its axis, a tool this near the horizontal does not tell north from "
            "south of east-west; give the expected azimuth, or seek longer"
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
                f"{BIAS_UNKNOWN} {params.gyro_bias_deg_h:.2g} deg/h, which leaves the azimuth "
                f"uncertain by {math.degrees(sigma):.0f} deg: turn the tool half a turn about its axis and wait again"
            )
        return f"not certain enough: {math.degrees(sigma):.0f} deg after {elapsed:.0f} s; wait longer"
    return ""


def _strange(params: Params, state: State) -> str:
    """What was found far from where the settings say it lies, in words; empty where all fits."""
    stated = (
        ("x gyro bias", nf.BIAS, params.gyro_x_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("y gyro bias", nf.BIAS + 1, params.gyro_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("z gyro bias", nf.BIAS + 2, params.gyro_bias_deg_h * DEG_PER_HOUR, DEG_PER_HOUR, "deg/h"),
        ("x gyro scale error", nf.SCALE, params.scale_x_ppm * 1e-6, 1e-6, "ppm"),
        ("x rate in the y gyro", nf.LEAK, params.leak_urad * 1e-6, 1e-6, "urad"),
        ("x rate in the z gyro", nf.LEAK + 1, params.leak_urad * 1e-6, 1e-6, "urad"),
    )
    for name, at, sigma, unit, word in stated:
        if abs(state.x[at]) > 5.0 * sigma:
            return (
                f"{name} comes out at {state.x[at] / unit:.3g} {word}, stated within {sigma / unit:.3g}: check the unit"
            )
    return ""

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
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.gyrocompass import azimuth_posterior
from mwd_estimation.gyrocompass import seek_filter as nf
from mwd_estimation.gyrocompass.seek_params import SeekParams, kernel_settings
from mwd_estimation.gyrocompass.seek_refusal import Fit, polar, refusal
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, STANDARD_GRAVITY
from mwd_sensors.core.frames import wrap_tau


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
    kept in every sample well below it. Returns shape (n, 3). The x figures of `SeekParams` belong to the unit that
    gives most of the samples.

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


def run(params: SeekParams, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> None:
    """
    Take in a block of samples; ask `solution` for the azimuth at any time.

    Parameters
    ----------
    params : SeekParams
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


def solution(params: SeekParams, state: State) -> Solution:
    """
    Azimuth so far, or why there is none; call it as often as progress is to be shown.

    The reasons to refuse it are those of `seek_refusal`.
    """
    m = state.memory
    if m[nf.PHASE] != nf.SEEKING:
        levelling = Reason(ReasonCode.SEEK_LEVELLING, float(m[nf.LEVEL_TIME]), params.shortest)
        return Solution(polar(params.latitude_deg) or levelling, params.mode)
    k = kernel_settings(params)
    horizontal = float(k[nf.K_HORIZONTAL])
    method = _method(params, m)
    inclination, heading, right = _hole_axis(state, method)
    parts = _parts(params, k, state.x, state.P, right)
    expected = params.expected_azimuth_deg
    circle = azimuth_posterior.posterior(
        parts, horizontal, None if expected is None else math.radians(expected) - heading
    )
    azimuth = float(wrap_tau(circle.mean + heading))
    blind = math.sin(inclination) * math.sin(azimuth)
    seen = math.sqrt(max(1.0 - blind * blind, 1e-12)) if method != "still" else 1.0
    fitting = tuple(float(wrap_tau(angle + heading)) for angle in circle.several)
    reason = refusal(params, m, state.x, Fit(method, azimuth, circle.sigma, inclination, seen, circle.misfit, fitting))
    choices: tuple[tuple[float, float], ...] = ()
    if reason is not None and reason.code is ReasonCode.TWO_AZIMUTHS_FIT_GYRO:
        each = [azimuth_posterior.posterior(parts, horizontal, angle) for angle in circle.several]
        if all(one.sigma <= math.radians(params.worst_sigma_deg) for one in each):
            choices = tuple((float(wrap_tau(one.mean + heading)), one.sigma) for one in each)
    per_g = STANDARD_GRAVITY / DEG_PER_HOUR
    spread = np.sqrt(np.maximum(np.diag(state.P), 0.0))
    scribe = state.mat.reshape(3, 3)[:, 2]
    return Solution(
        reason,
        method,
        azimuth,
        circle.sigma,
        inclination,
        float(wrap_tau(circle.mean + math.atan2(scribe[1], scribe[0]))),
        float(m[nf.ELAPSED]),
        _limit(k, method, seen, float(m[nf.ELAPSED])),
        tuple(float(v) for v in state.x[nf.GSENS : nf.GSENS + 4] * per_g),
        tuple(float(v) for v in spread[nf.GSENS : nf.GSENS + 4] * per_g),
        tuple(float(v) for v in state.x[nf.BIAS : nf.BIAS + 3] / DEG_PER_HOUR),
        tuple(float(v) for v in spread[nf.BIAS : nf.BIAS + 3] / DEG_PER_HOUR),
        choices,
    )


def _hole_axis(state: State, method: str) -> tuple[float, float, Array]:
    """
    Inclination and heading of the hole axis in the level frame, rad, and the heading's slope by the error state, (33,).

    Of the mean axis of a tool that turns, of the axis as it lies of a tool that rests.
    """
    m, x, right = state.memory, state.x, np.zeros(nf.STATES)
    if method in ("still", "two_position"):
        ax, ay, az = state.mat[0], state.mat[3], state.mat[6]
        across2 = max(float(ax * ax + ay * ay), 1e-6)
        right[:3] = -ax * az / across2, -ay * az / across2, 1.0
        return math.atan2(math.hypot(ax, ay), az), math.atan2(ay, ax), right
    hole = m[nf.H0 : nf.H0 + 3].copy()
    hx, hy, hz, rx, ry = nf.frame(m)
    hole += x[nf.AXIS] * np.array([hx, hy, hz]) + x[nf.AXIS + 1] * np.array([rx, ry, 0.0])
    across = math.hypot(hole[0], hole[1])
    right[nf.AXIS + 1] = 1.0 / max(across, 1e-3)
    return math.atan2(across, hole[2]), math.atan2(hole[1], hole[0]), right


def _limit(k: Array, method: str, seen: float, elapsed: float) -> float:
    """Sigma of an ideal estimator, rad: see `Solution.limit`; seen: share of the Earth rate that the method sees."""
    rate = k[nf.K_HORIZONTAL] * max(seen, 1e-3)
    limit = k[nf.K_N] / (rate * math.sqrt(max(elapsed, 1e-3)))
    if method == "continuous":
        # The noise that blurs north turns the integrated platform too: it settles, and gets no better.
        limit = max(limit, k[nf.K_N] / math.sqrt(rate))
    return min(float(limit), math.pi)


def carried_on(params: SeekParams, state: State, seconds: float) -> State:
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


def calibrated(params: SeekParams, state: State, azimuth: float, sigma: float) -> SeekParams:
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


def _parts(params: SeekParams, k: Array, x: Array, P: Array, right: Array) -> list[azimuth_posterior.Part]:
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


def _method(params: SeekParams, m: Array) -> str:
    if params.mode == "continuous":
        return "continuous"
    if m[nf.TURN_TIME] > m[nf.STILL_TIME]:
        return "rotating"
    return "two_position" if m[nf.POSITIONS] > 1.0 and m[nf.TURN_TIME] > 0.0 else "still"

# SPDX-License-Identifier: Apache-2.0
"""
North from the Earth's rotation, with a tool that is still, is turned to other positions, or rotates all the time.

One filter serves all three cases. The attitude is integrated in a level frame of unknown heading, and the Earth rate in
that frame is a *linear* unknown, so that the filter needs no first azimuth. The measurements are constraints on the
tool: it gains no velocity (S1), and the axis of the hole does not turn. Cross-axis bias, x leakage, g-sensitivity, x
scale, gyro lag and once-per-turn wobble are states: the motion makes some of them observable, the others contribute to
the sigma. The azimuth is taken from the posterior on the circle of Earth rates that are possible at the latitude; an
estimate far from the circle contradicts the latitude. Derivation, observability and limits:
``docs/methods/gyrocompass.md``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import clip_flags, track
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import LOCAL_GRAVITY
from mwd_estimation.gyrocompass import azimuth_posterior, gyro_errors
from mwd_estimation.gyrocompass.azimuth_posterior import OnCircle
from mwd_estimation.gyrocompass.gyro_errors import GyroErrors
from mwd_estimation.gyrocompass.seek_filter import advance, frame
from mwd_estimation.gyrocompass.seek_refusal import WORST_SIGMA, Fit, motion, polar, refusal
from mwd_estimation.gyrocompass.seek_state import (
    STATE,
    WORK,
    Error,
    KernelParams,
    SeekParams,
    SeekPhase,
    SeekState,
    estimate,
    kernel_params,
)
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import EARTH_RATE
from mwd_sensors.core.frames import wrap_pi, wrap_tau

_RAMPS, _G_SENSITIVITY = range(Error.BIAS_RAMP, Error.SIZE), range(Error.G_SENSITIVITY, Error.LAG)
# Number of sigmas from zero at which a gyro bias counts as found. Smaller biases are not compared with the stated bias:
# in steady rotation the x bias may be a scale error.
_FOUND = 3.0
# Errors of a latitude that is stated wrong, rad; the probability of all of them together, and that of a latitude with
# the wrong sign (guesses).
_WRONG_BY, _WRONG, _WRONG_SIGN = np.radians([off for off in range(-40, 41, 5) if off]), 0.05, 0.01
# Assumed ratios of the real to the stated errors of the accelerometers, and their probabilities (a guess): a unit
# without own calibration has errors of 3 mg. With the ratio 1 alone, 36 of 120 seeks at the right latitude are refused
# if the accelerometers are 2 mg off.
_ACCEL_SCALES, _SCALE_PROBABILITIES = np.array([1.0, 4.0, 16.0]), np.array([0.9, 0.07, 0.03])
# Another latitude is left out if its log odds, from the prior and from gravity, are below this.
_EXCLUDED = -15.0
# Smallest change of toolface or inclination after which a still seek gives new information, rad: half an arc of
# `gyro_errors`.
_ANOTHER_ATTITUDE = math.radians(15.0)


def initial() -> SeekState:
    """Return the state before the first sample, a record of dtype STATE."""
    state = cast(SeekState, np.zeros(1, STATE)[0])
    state.mat[:] = np.eye(3)
    return state


def dual_unit(
    stamp_ns: ArrayLike,
    precision_t: ArrayLike,
    ahrs_stamp_ns: ArrayLike,
    ahrs_t: ArrayLike,
    x_range: float,
    clipped: ArrayLike | None = None,
) -> Array:
    """
    Return rates of the precision unit, with the conventional unit's x rate where the precision x axis clips.

    stamp_ns, shape (n,), ns, and precision_t, shape (n, 3), rad/s: precision unit; the result has these stamps.
    ahrs_stamp_ns, shape (m,), ns, and ahrs_t, shape (m, 3), rad/s: conventional unit. x_range: rate at which the
    precision x axis clips, rad/s; clipped, shape (n,): clip flags of the precision unit (`clip_flags`). Samples without
    a flag, whose x rates from both units are below 0.9 times the range, keep the precision x rate. Returns shape (n,
    3), rad/s. The x figures of `SeekParams` must belong to the unit that gives most x rates.

    Raises
    ------
    ValueError
        If there is no sample of the conventional unit.
    """
    stamps, ahrs_stamps = np.asarray(stamp_ns, dtype=np.int64), np.asarray(ahrs_stamp_ns, dtype=np.int64)
    rates, ahrs = np.array(precision_t, dtype=float), np.asarray(ahrs_t, dtype=float)
    if ahrs_stamps.size == 0:
        raise ValueError("ahrs_stamp_ns: no sample of the conventional unit; its x rate is needed")
    # Seconds from a common start, so that a float keeps the digits.
    start = ahrs_stamps[0]
    x = np.interp((stamps - start) * 1e-9, (ahrs_stamps - start) * 1e-9, ahrs[:, 0])
    flagged = clip_flags.given(clipped, len(stamps)) & clip_flags.AXIAL_GYRO != 0
    fast = flagged | (np.abs(x) > 0.9 * x_range) | (np.abs(rates[:, 0]) > 0.9 * x_range)
    rates[fast, 0] = x[fast]
    return rates


def run(
    params: SeekParams,
    state: SeekState,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    accel_t: ArrayLike,
    clipped: ArrayLike | None = None,
) -> None:
    """
    Process a block of samples; call `solution` for the azimuth at any time.

    Parameters
    ----------
    state : SeekState
        State of the seek, changed in place; the result does not depend on how the samples are cut into blocks.
    stamp_ns : array_like of int64, shape (n,)
        Stamps.
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s (see `dual_unit`), and specific force (up at rest), m/s^2, in tool axes. Rates are means
        over the interval that ends at the stamp.
    clipped : array_like of uint8, shape (n,), optional
        Clip flags that the unit reports for each sample, bits of `core.clip_flags`.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    flags = clip_flags.given(clipped, len(stamps))
    advance(kernel_params(params), state, np.zeros(1, WORK)[0], stamps, gyro, accel, flags)


def solution(params: SeekParams, state: SeekState, errors: GyroErrors | None = None) -> Solution:
    """
    Return the azimuth so far, or the reason why it must not be used; this function may be called at any time.

    The reasons are those of `seek_refusal`. errors: gyro errors known at the start of the seek; None: those that the
    parameters state.
    """
    pole = polar(params.latitude_deg)
    if pole is not None:
        return Solution(pole, params.mode)
    if state.phase != SeekPhase.SEEKING:
        return Solution(Reason(ReasonCode.SEEK_LEVELLING, float(state.level_time), params.shortest), params.mode)
    p = kernel_params(params)
    method = _method(state)
    inclination, heading, right = _hole_axis(state, method)
    now = errors_now(params, state, errors)
    anywhere = gyro_errors.joined(now, _sought(p, state, right))
    latitudes, log_odds = _latitudes(params, p, state)
    circles = [_at_latitude(now, anywhere, latitude) for latitude in latitudes]
    north, circle, told = _north(latitudes, log_odds, circles), circles[0], latitudes[0]
    sigma_there, azimuth = _sigma(circle), float(wrap_tau(north.mean + heading))
    blind = math.sin(inclination) * math.sin(azimuth)
    seen = math.sqrt(max(1.0 - blind * blind, 1e-12)) if method != "still" else 1.0
    fitting = tuple(float(wrap_tau(angle + heading)) for angle in circle.several)
    found = gyro_errors.learnt(now, anywhere.at(p.down), p.horizontal)
    known = np.where(np.abs(found.bias) > _FOUND * found.bias_sigma, found.bias, 0.0)
    fit = Fit(
        method,
        azimuth,
        north.sigma,
        inclination,
        sigma_there,
        seen,
        circle.misfit,
        north.wrong,
        north.likeliest,
        fitting,
        known,
    )
    reason = refusal(params, state, fit)
    choices: tuple[tuple[float, float], ...] = ()
    if reason is not None and reason.code is ReasonCode.TWO_AZIMUTHS_FIT_GYRO:
        each = [_at_latitude(now, anywhere, told, angle) for angle in circle.several]
        added = math.sqrt(max(north.sigma**2 - sigma_there**2, 0.0))
        if all(one.sigma <= WORST_SIGMA for one in each):
            choices = tuple(
                (float(wrap_tau(one.mean + heading)), min(math.hypot(_sigma(one, circle.misfit), added), math.pi))
                for one in each
            )
    scribe = state.mat[:, 2]
    return Solution(
        reason,
        method,
        azimuth,
        north.sigma,
        inclination,
        float(wrap_tau(north.mean + math.atan2(scribe[1], scribe[0]))),
        float(state.elapsed),
        _limit(p, seen, float(state.elapsed)),
        choices,
    )


class _North(NamedTuple):
    """Azimuth of the level frame for a latitude that may be wrong."""

    #: `mean`, `sigma`: rad.
    mean: float
    sigma: float
    #: `wrong`, `likeliest`: probability that the latitude is wrong, and the most probable other latitude, rad.
    wrong: float
    likeliest: float


def _at_latitude(
    errors: GyroErrors, found: gyro_errors.Joined, latitude: float, expected: float | None = None
) -> OnCircle:
    """Return the azimuth at a latitude, rad; expected: see `azimuth_posterior.posterior`."""
    parts = gyro_errors.parts(errors, found.at(-EARTH_RATE * math.sin(latitude)))
    return azimuth_posterior.posterior(parts, EARTH_RATE * math.cos(latitude), expected)


def _sigma(circle: OnCircle, misfit: float | None = None) -> float:
    """
    Return 1 sigma of the azimuth, rad, increased if the Earth rate is more than 2 sigmas from the circle.

    misfit: squared distance of the Earth rate from the circle, in sigmas; None: `circle.misfit`.
    """
    # If the Earth rate differs from its value at the latitude by more than two sigmas, the gyro errors are larger than
    # stated. The error in north is then larger too.
    larger = max(math.sqrt(circle.misfit if misfit is None else misfit) - 1.0, 1.0)
    return min(larger * circle.sigma, math.pi)


def _latitudes(params: SeekParams, p: KernelParams, state: SeekState) -> tuple[list[float], Array]:
    """Return the possible latitudes, rad, the stated one first, and their log odds before the seek and by gravity."""
    told = math.radians(params.latitude_deg)
    latitudes = np.array([told, *(told + _WRONG_BY), -told])
    prior = np.full(len(latitudes), _WRONG / len(_WRONG_BY))
    prior[[0, -1]] = 1.0 - _WRONG - _WRONG_SIGN, _WRONG_SIGN
    gravity, sigma = _gravity(p, state)
    sigmas = np.hypot(_ACCEL_SCALES * sigma, LOCAL_GRAVITY)
    off = gravity - np.array([earth.gravity(latitude, params.height_m) for latitude in latitudes])
    likelihood = np.log(_SCALE_PROBABILITIES / sigmas) - 0.5 * (off[:, None] / sigmas) ** 2
    log = np.log(prior) + np.logaddexp.reduce(likelihood, axis=1)
    possible = log > log[0] + _EXCLUDED
    possible &= [polar(math.degrees(latitude)) is None for latitude in latitudes]
    return latitudes[possible].tolist(), log[possible]


def _north(latitudes: Sequence[float], log_odds: Array, circles: Sequence[OnCircle]) -> _North:
    """
    Return the azimuth averaged over the latitudes, weighted by their odds and the evidence of the Earth rate.

    latitudes, rad, and log_odds, shape (n,): see `_latitudes`; circles: azimuth at each latitude.
    """
    log = log_odds + [one.log_evidence for one in circles]
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    off = wrap_pi(np.array([one.mean for one in circles]) - circles[0].mean)
    mean = float(weight @ off)
    sigma = azimuth_posterior.sigma_of_mixture(weight, off - mean, [_sigma(one) for one in circles])
    likeliest = latitudes[1 + int(np.argmax(weight[1:]))]
    return _North(circles[0].mean + mean, sigma, float(weight[1:].sum()), likeliest)


def _gravity(p: KernelParams, state: SeekState) -> tuple[float, float]:
    """Return the measured gravity and 1 sigma of its error by the accelerometers, m/s^2."""
    seconds, at = max(float(state.elapsed), 1e-9), slice(Error.FORCE_BIAS, Error.AXIS)
    axes = state.down_axes / seconds
    variance = float(axes @ state.P[at, at] @ axes) + p.accel_noise**2 / seconds
    sigma = math.sqrt(variance + (p.accel_scale * p.gravity) ** 2)
    return float(axes @ state.force_bias) - state.down_force / seconds, sigma


def _hole_axis(state: SeekState, method: str) -> tuple[float, float, Array]:
    """
    Return inclination and heading of the hole axis in the level frame, rad, and the derivative of the heading.

    The derivative is with respect to the error state, shape (37,). The hole axis is the mean axis of a rotating tool,
    or the present axis of a resting tool.
    """
    right = np.zeros(Error.SIZE)
    if method in ("still", "two_position"):
        ax, ay, az = state.mat[:, 0]
        across2 = max(float(ax * ax + ay * ay), 1e-6)
        right[:3] = -ax * az / across2, -ay * az / across2, 1.0
        return math.atan2(math.hypot(ax, ay), az), math.atan2(ay, ax), right
    hx, hy, hz, rx, ry = frame(state.axis_reference)
    hole = state.axis_reference + (state.axis[0] * np.array([hx, hy, hz]) + state.axis[1] * np.array([rx, ry, 0.0]))
    across = math.hypot(hole[0], hole[1])
    right[Error.AXIS + 1] = 1.0 / max(across, 1e-3)
    return math.atan2(across, hole[2]), math.atan2(hole[1], hole[0]), right


def _limit(p: KernelParams, seen: float, elapsed: float) -> float:
    """
    Return 1 sigma of an ideal estimator, rad (`Solution.limit`).

    seen: share of the horizontal Earth rate that is measured, 0 to 1; elapsed: duration of the data, s.
    """
    rate = p.horizontal * max(seen, 1e-3)
    return min(p.gyro_noise / (rate * math.sqrt(max(elapsed, 1e-3))), math.pi)


def learnt(params: SeekParams, state: SeekState, errors: GyroErrors | None = None) -> GyroErrors:
    """
    Return the gyro errors known at the end of a seek for which `teaches` is true.

    errors: gyro errors known at the start of the seek; None: those that the parameters state.
    """
    now, p = errors_now(params, state, errors), kernel_params(params)
    joined = gyro_errors.joined(now, _sought(p, state, _hole_axis(state, _method(state))[2]))
    return gyro_errors.learnt(now, joined.at(p.down), p.horizontal)


def teaches(params: SeekParams, state: SeekState, before: SeekState | None) -> bool:
    """
    Return whether a seek gives new information about the gyro biases.

    before: state of the last seek that gave new information, or None.

    A seek that is still levelling, or is refused for its motion or near a pole, gives no information. A second still
    seek at the same inclination and toolface gives none either, because the same biases fit the same azimuths; the
    approximation by Gaussians of arcs would only add its errors again.
    """
    method = _method(state)
    if state.phase != SeekPhase.SEEKING or polar(params.latitude_deg) or motion(params, state, method):
        return False
    if before is None or method != "still":
        return True
    turned = abs(float(wrap_pi(_toolface(state) - _toolface(before))))
    tilted = abs(_inclination(state) - _inclination(before))
    return max(turned, tilted) > _ANOTHER_ATTITUDE


def _inclination(state: SeekState) -> float:
    return math.acos(min(max(float(state.mat[2, 0]), -1.0), 1.0))


def _toolface(state: SeekState) -> float:
    return math.atan2(float(state.mat[2, 1]), float(state.mat[2, 2]))


def _sought(p: KernelParams, state: SeekState, right: Array) -> gyro_errors.Sought:
    """
    Return the results of a seek: Earth rate, gyro errors and heading, with their covariance.

    The prior of the gyro errors is returned too: the start sigma of the biases and the stated ramp, both propagated
    over the duration of the seek, and the start sigma of the g-sensitivity. right, shape (37,): factors by which the
    error state adds to the heading.
    """
    north, east, down = range(Error.EARTH_RATE, Error.GYRO_BIAS)
    each = np.eye(Error.SIZE)
    instrument = [*range(Error.GYRO_BIAS, Error.SCALE_X), *_RAMPS, *_G_SENSITIVITY]
    rows = np.vstack([each[[north, east, *instrument]], right, each[down]])
    mean = rows @ estimate(state)
    mean[8:12] -= p.g_calibration
    # Only the error of the heading belongs to the error state; the heading itself (`_hole_axis`) is added later.
    mean[-2] = 0.0
    t = float(state.elapsed)
    drift = np.array([[1.0, t], [0.0, 1.0]])
    prior = np.zeros((10, 10))
    prior[range(6, 10), range(6, 10)] = p.g_sensitivity**2
    for i, start in enumerate(p.start_bias):
        one = drift @ np.diag([start**2, p.bias_ramp**2]) @ drift.T
        one[0, 0] += p.bias_walk**2 * t
        prior[np.ix_([i, 3 + i], [i, 3 + i])] = one
    return gyro_errors.Sought(mean, rows @ state.P @ rows.T, prior)


def errors_now(params: SeekParams, state: SeekState, errors: GyroErrors | None) -> GyroErrors:
    """Return the gyro errors known before a seek, propagated to its end."""
    begun = gyro_errors.stated(params) if errors is None else errors
    return gyro_errors.after(begun, params, float(state.level_time + state.elapsed))


def _method(state: SeekState) -> str:
    if state.turn_time > state.still_time:
        return "rotating"
    return "two_position" if state.positions > 1 and state.turn_time > 0.0 else "still"

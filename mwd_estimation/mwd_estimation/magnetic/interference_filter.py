"""
The tool's own magnetic field, learnt sample by sample: axial and cross-axial bias and scale, while drilling and at
stations.

Gravity's direction and the magnetometers give two numbers that do not depend on the unknown azimuth: the downward
field V and the horizontal field H. Held against the reference they are the measurement of an extended Kalman filter
whose state is

    x = (bias x, y, z,  scale x, y, z,  error of the reference H, error of the reference V)

Rotation turns V and H with the cross-axial biases, so those are seen within a turn or two; the axial bias is seen
against the reference and as the hole changes attitude. Near the horizontal east-west hole the axial bias moves H only
by its square: the second-order term is part of the innovation and of its variance, so that the filter does not
believe a slope that is not there. A gyro's azimuth, where there is one, is taken as a third measurement.

What is not white (the gravity filter's own error, the field's variation along the hole) is counted once in a
correlation time, however often it is sampled. A block of n samples gives the same bits as n blocks of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.settings import setting

SIZE = 8
# Where the states are among the errors that `multistation` estimates.
OF_STATIONS = [0, 1, 2, 3, 4, 5, 12, 13]
# What was learnt for less than this is not worth keeping once it is contradicted, s.
_YOUNG = 60.0
# Longest step over which the random walk is believed, s: a longer gap counts as this.
_MAX_STEP = 7200.0


@dataclass(frozen=True)
class Params:
    """Priors, noise and gates of the filter."""

    axial_nt: float = setting(2000.0, "Axial interference thought possible, 1 sigma", unit="nT", low=1.0, high=100000.0)
    cross_axial_nt: float = setting(
        200.0, "Cross-axial bias thought possible, 1 sigma", unit="nT", low=1.0, high=100000.0
    )
    scale: float = setting(0.0016, "Scale error of each magnetometer, 1 sigma", low=0.0, high=0.1)
    walk_nt: float = setting(20.0, "Drift of every bias in an hour, 1 sigma", unit="nT/sqrt(h)", low=0.0, high=10000.0)
    field_walk_nt: float = setting(
        30.0, "Change of the field along the hole in an hour, 1 sigma", unit="nT/sqrt(h)", low=0.0, high=10000.0
    )
    varying_nt: float = setting(
        30.0,
        "Error of a sample that lasts a correlation time, each of H and V, 1 sigma",
        unit="nT",
        low=0.1,
        high=10000.0,
    )
    correlation_s: float = setting(
        10.0, "Correlation time of errors that are not white", unit="s", low=0.0, high=3600.0
    )
    gate: float = setting(
        16.0, "Chi-square of two degrees of freedom beyond which a sample is taken for disturbed", low=4.0, high=1e6
    )
    patience_s: float = setting(
        900.0,
        "Disturbed for as long as it had learnt, but for so long at most, the filter starts again from its priors",
        unit="s",
        low=1.0,
        high=1e6,
    )
    least_patience_s: float = setting(10.0, "And for so long at least", unit="s", low=0.1, high=1e6)


@dataclass
class State:
    """
    All that changes; plain arrays, so that it can be saved and resumed.

    Attributes
    ----------
    x, covariance : ndarray, shape (8,), (8, 8)
        T and plain numbers, as in the module's head.
    start : ndarray, shape (8,)
    prior : ndarray, shape (8, 8)
        State and covariance to start from again.
    field : ndarray, shape (2,)
        Reference (H, V), T.
    stamp_ns : ndarray, shape (1,)
        Of the last sample; -1 before the first.
    disturbed_s, learnt_s : ndarray, shape (1,)
        How long samples have been refused without a break, and learnt from since the start.
    """

    x: Array
    covariance: Array
    start: Array
    prior: Array
    field: Array
    stamp_ns: NDArray[np.int64]
    disturbed_s: Array
    learnt_s: Array

    def copy(self) -> State:
        """An independent copy."""
        return State(**{name: np.array(value) for name, value in vars(self).items()})

    @property
    def axial(self) -> tuple[float, float]:
        """Axial interference and bias, T, and 1 sigma."""
        return float(self.x[0]), math.sqrt(float(self.covariance[0, 0]))

    @property
    def reduction(self) -> Array:
        """Sigma of (axial, y, z) over its prior, shape (3,): near one means the attitudes so far do not show it."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)[:3] / np.diagonal(self.prior)[:3]))


@dataclass(frozen=True)
class Interference:
    """
    Estimates after each sample; arrays of length n.

    Attributes
    ----------
    bias, sigma : ndarray, shape (n, 3)
        Axial, y and z bias, T, and 1 sigma.
    azimuth, sigma_azimuth : ndarray, shape (n,)
        Magnetic azimuth freed of bias and scale, rad in [0, 2 pi), 1 sigma, at most pi.
    sigma_own : ndarray, shape (n,)
        The part of that which the biases and scales left unknown make: it stays from sample to sample, less and less.
    ratio : ndarray, shape (n,)
        Innovation's chi-square over the gate; above one the sample was not learnt from.
    learnt : ndarray of bool, shape (n,)
        Whether the sample was taken in.
    restarted : ndarray of bool, shape (n,)
        Whether the filter forgot with this sample what it had learnt in a short time: that was from somewhere else.
    """

    bias: Array
    sigma: Array
    azimuth: Array
    sigma_azimuth: Array
    sigma_own: Array
    ratio: Array
    learnt: NDArray[np.bool_]
    restarted: NDArray[np.bool_]


def initial(
    params: Params,
    reference: Reference,
    errors: SensorErrors | None = None,
    axial: tuple[float, float] = (0.0, 0.0),
) -> State:
    """
    State before the first sample.

    Parameters
    ----------
    params : Params
    reference : Reference
    errors : SensorErrors, optional
        Sensor part of the priors, added in squares.
    axial : tuple of float
        Axial interference to start from and 1 sigma, T, where a station has shown one beyond what the prior thinks
        possible. The prior's sigma stays at least: samples are held against the same reference as the station was,
        whose error must not be averaged away.

    Raises
    ------
    ValueError
        The reference has no field.
    """
    bias = (0.0 if errors is None else errors.magnetometer_bias_nt) * 1e-9
    scale = params.scale if errors is None else errors.magnetometer_scale
    prior = np.zeros((SIZE, SIZE))
    along = max(math.hypot(params.axial_nt * 1e-9, bias), axial[1])
    cross = math.hypot(params.cross_axial_nt * 1e-9, bias)
    prior[range(6), range(6)] = np.array([along, cross, cross, scale, scale, scale]) ** 2
    prior[6:, 6:] = reference.covariance
    start = np.zeros(SIZE)
    start[0] = axial[0]
    return State(
        x=start.copy(),
        covariance=prior.copy(),
        start=start,
        prior=prior,
        field=np.array([reference.horizontal, reference.vertical]),
        stamp_ns=np.array([-1], dtype=np.int64),
        disturbed_s=np.zeros(1),
        learnt_s=np.zeros(1),
    )


def run(
    params: Params,
    state: State,
    stamp_ns: NDArray[np.int64],
    g_t: Array,
    b_t: Array,
    sigma_g: Array,
    sigma_b: Array,
    usable: NDArray[np.bool_] | None = None,
) -> Interference:
    """
    Take in samples and give the azimuth freed of what is known so far; `state` is changed in place.

    Parameters
    ----------
    params : Params
    state : State
    stamp_ns : ndarray of int64, shape (n,)
        Not falling; a sample at or before the last one is not learnt from.
    g_t, b_t : ndarray, shape (n, 3)
        Unit vector down and field, T, in tool axes at the same instants.
    sigma_g, sigma_b : ndarray, shape (n,)
        1 sigma of the direction down, rad, taken as lasting a correlation time, and white noise of each magnetometer
        axis, T.
    usable : ndarray of bool, shape (n,), optional
        False for samples not to learn from (clipped, shaken); their azimuth is given all the same.

    Returns
    -------
    Interference

    Raises
    ------
    ValueError
        Arrays of different length.
    """
    n = len(stamp_ns)
    usable = np.ones(n, dtype=np.bool_) if usable is None else np.ascontiguousarray(usable, dtype=np.bool_)
    shapes = {"g_t": (n, 3), "b_t": (n, 3), "sigma_g": (n,), "sigma_b": (n,), "usable": (n,)}
    given = {"g_t": g_t, "b_t": b_t, "sigma_g": sigma_g, "sigma_b": sigma_b, "usable": usable}
    for name, shape in shapes.items():
        if np.shape(given[name]) != shape:
            raise ValueError(f"{name}: expected shape {shape} beside {n} stamps, got {np.shape(given[name])}")
    bias, sigma = np.empty((n, 3)), np.empty((n, 3))
    azimuth, sigma_azimuth, sigma_own, ratio = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    learnt, restarted = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    constants = np.array(
        [
            params.walk_nt**2 * 1e-18 / 3600.0,
            params.field_walk_nt**2 * 1e-18 / 3600.0,
            params.varying_nt * 1e-9,
            params.correlation_s,
            params.gate,
            params.patience_s,
            params.least_patience_s,
        ]
    )
    _run(
        constants,
        state.x,
        state.covariance,
        state.start,
        state.prior,
        state.field,
        state.stamp_ns,
        state.disturbed_s,
        state.learnt_s,
        np.ascontiguousarray(stamp_ns, dtype=np.int64),
        np.ascontiguousarray(g_t, dtype=np.float64),
        np.ascontiguousarray(b_t, dtype=np.float64),
        np.ascontiguousarray(sigma_g, dtype=np.float64),
        np.ascontiguousarray(sigma_b, dtype=np.float64),
        usable,
        bias,
        sigma,
        azimuth,
        sigma_azimuth,
        sigma_own,
        ratio,
        learnt,
        restarted,
    )
    return Interference(bias, sigma, azimuth, sigma_azimuth, sigma_own, ratio, learnt, restarted)


def aid_azimuth(params: Params, state: State, g_t: Array, b_t: Array, azimuth: float, sigma: float) -> float:
    """
    Take in a magnetic azimuth known otherwise (a gyro's less the declination), at the field and gravity of that
    instant.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place unless the azimuth is refused.
    g_t, b_t : ndarray, shape (3,)
        Unit vector down and field, T.
    azimuth, sigma : float
        rad from magnetic north, and 1 sigma: of gyro and declination together.

    Returns
    -------
    float
        Chi-square of the innovation, one degree of freedom, over 10.83: above one it disagrees and was refused.
    """
    own, horizontal, row = _azimuth(state.x, state.field, np.array(g_t, dtype=float), np.array(b_t, dtype=float))
    innovation = math.remainder(azimuth - own, 2.0 * math.pi)
    gain = state.covariance @ row
    # Gravity and field of this instant err too: as the filter's own lasting error.
    variance = float(row @ gain) + sigma**2 + (params.varying_nt * 1e-9 / horizontal) ** 2
    ratio = innovation**2 / variance / 10.83
    if ratio <= 1.0:
        state.x += gain * (innovation / variance)
        state.covariance -= np.outer(gain, gain) / variance
    return float(ratio)


def _azimuth(x: Array, field: Array, g: Array, b: Array) -> tuple[float, float, Array]:
    """Magnetic azimuth of one sample, rad, its horizontal field, T, and the azimuth's slope by the state, (8,)."""
    north, east, clean, row = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(SIZE)
    _, horizontal = _directions(x, field, g, b, north, east, clean)
    # A field taken off towards east turns the north that is seen back west, and the azimuth up.
    row[:3], row[3:6] = east / horizontal, east * clean / horizontal
    return math.atan2(east[0], north[0]), horizontal, row


@compiled
def _directions(
    x: Array, field: Array, g: Array, b: Array, north: Array, east: Array, clean: Array
) -> tuple[float, float]:
    """
    Downward and horizontal field of one sample with the state's errors taken off, T.

    g, b, shape (3,), as in `run`. Fills `north`, `east` (unit vectors in tool axes) and `clean`: the field as
    expected there, T, free of the sample's noise.
    """
    vertical = 0.0
    for i in range(3):
        clean[i] = b[i] - x[i] - x[3 + i] * b[i]
        vertical += clean[i] * g[i]
    square = 0.0
    for i in range(3):
        north[i] = clean[i] - vertical * g[i]
        square += north[i] * north[i]
    horizontal = max(math.sqrt(square), 1e-9)
    for i in range(3):
        north[i] /= horizontal
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        east[i] = g[j] * north[m] - g[m] * north[j]
        clean[i] = (field[1] + x[7]) * g[i] + (field[0] + x[6]) * north[i]
    return vertical, horizontal


@compiled
def _slopes(g: Array, north: Array, clean: Array, row_v: Array, row_h: Array) -> None:
    """
    Slopes of the innovations of V and H by the state; fills `row_v` and `row_h`, shape (8,).

    Those by scale take the field as expected, not as read: the noise of the reading is in the innovation too, and the
    product of the two would pull at the scales.
    """
    for i in range(3):
        row_v[i], row_h[i] = -g[i], -north[i]
        row_v[3 + i], row_h[3 + i] = -g[i] * clean[i], -north[i] * clean[i]
    row_v[6], row_v[7], row_h[6], row_h[7] = 0.0, -1.0, -1.0, 0.0


@compiled
def _variance_along(direction: Array, clean: Array, cov: Array) -> float:
    """Variance that biases and scales leave in the field along a unit vector, T^2."""
    total = 0.0
    for i in range(6):
        d_i = direction[i] if i < 3 else direction[i - 3] * clean[i - 3]
        for j in range(6):
            d_j = direction[j] if j < 3 else direction[j - 3] * clean[j - 3]
            total += d_i * cov[i, j] * d_j
    return total


@compiled
def _run(
    constants: Array,
    x: Array,
    cov: Array,
    start: Array,
    prior: Array,
    field: Array,
    last: NDArray[np.int64],
    disturbed: Array,
    learning: Array,
    stamp_ns: NDArray[np.int64],
    g_t: Array,
    b_t: Array,
    sigma_g: Array,
    sigma_b: Array,
    usable: NDArray[np.bool_],
    bias: Array,
    sigma: Array,
    azimuth: Array,
    sigma_azimuth: Array,
    sigma_own: Array,
    ratio: Array,
    learnt: NDArray[np.bool_],
    restarted: NDArray[np.bool_],
) -> None:
    """Explicit loops over samples and states; arguments as in `run`, the last eight are filled."""
    walk, field_walk, varying, correlation, gate, patience, least_patience = constants
    row_v, row_h = np.zeros(8), np.zeros(8)
    gain_v, gain_h = np.zeros(8), np.zeros(8)
    clean, north, east = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(stamp_ns)):
        finite = True
        for i in range(3):
            finite = finite and math.isfinite(b_t[k, i]) and math.isfinite(g_t[k, i])
        if not finite:
            for i in range(3):
                bias[k, i], sigma[k, i] = x[i], math.sqrt(cov[i, i])
            azimuth[k], sigma_azimuth[k], sigma_own[k], ratio[k] = math.nan, math.pi, math.pi, 0.0
            continue
        first = last[0] < 0
        step = 0.0 if first else 1e-9 * (stamp_ns[k] - last[0])
        fresh = first or step > 0.0
        if step > 0.0:
            held = min(step, _MAX_STEP)
            for i in range(3):
                cov[i, i] += walk * held
            cov[6, 6] += field_walk * held
            cov[7, 7] += field_walk * held
        if fresh:
            last[0] = stamp_ns[k]

        vertical, horizontal = _directions(x, field, g_t[k], b_t[k], north, east, clean)
        _slopes(g_t[k], north, clean, row_v, row_h)
        # What errs along east (biases and scales left, noise, tilt) lifts H by its square over 2 H.
        sideways = _variance_along(east, clean, cov)
        white = sigma_b[k] * sigma_b[k]
        tilt = sigma_g[k] * sigma_g[k]
        curve = 0.5 * sideways / horizontal
        bend = 2.0 * curve * curve
        lifted = curve + 0.5 * (white + vertical * vertical * tilt) / horizontal
        off_v = vertical - field[1] - x[7]
        off_h = horizontal - field[0] - x[6] - lifted
        p_vv, p_vh, p_hh = 0.0, 0.0, 0.0
        for i in range(8):
            gain_v[i], gain_h[i] = 0.0, 0.0
            for j in range(8):
                gain_v[i] += cov[i, j] * row_v[j]
                gain_h[i] += cov[i, j] * row_h[j]
        for i in range(8):
            p_vv += row_v[i] * gain_v[i]
            p_vh += row_v[i] * gain_h[i]
            p_hh += row_h[i] * gain_h[i]
        # A tilt of the vertical towards north moves V by H and H by -V.
        r_vv = varying * varying + horizontal * horizontal * tilt
        r_hh = varying * varying + vertical * vertical * tilt
        r_vh = -vertical * horizontal * tilt
        s_vv, s_vh, s_hh = p_vv + white + r_vv, p_vh + r_vh, p_hh + white + r_hh + bend
        det = s_vv * s_hh - s_vh * s_vh
        chi = (s_hh * off_v * off_v - 2.0 * s_vh * off_v * off_h + s_vv * off_h * off_h) / det
        ratio[k] = chi / gate
        if usable[k] and fresh:
            if chi <= gate:
                # Errors that last are worth one sample in a correlation time.
                # (of an exponential correlation: two); what the bend of H hides is worth one in an hour.
                often, seldom = 1.0, 1.0
                if step > 0.0:
                    often = max(2.0 * correlation / step, 1.0)
                    seldom = max(3600.0 / step, 1.0)
                s_vv, s_vh = p_vv + white + r_vv * often, p_vh + r_vh * often
                s_hh = p_hh + white + r_hh * often + bend * seldom
                det = s_vv * s_hh - s_vh * s_vh
                w_v = (s_hh * off_v - s_vh * off_h) / det
                w_h = (s_vv * off_h - s_vh * off_v) / det
                for i in range(8):
                    x[i] -= gain_v[i] * w_v + gain_h[i] * w_h
                for i in range(8):
                    for j in range(i + 1):
                        cov[i, j] -= (
                            s_hh * gain_v[i] * gain_v[j]
                            - s_vh * (gain_v[i] * gain_h[j] + gain_h[i] * gain_v[j])
                            + s_vv * gain_h[i] * gain_h[j]
                        ) / det
                        cov[j, i] = cov[i, j]
                disturbed[0] = 0.0
                learning[0] += min(step, correlation)
                learnt[k] = True
            else:
                disturbed[0] += step
                if disturbed[0] > min(max(learning[0], least_patience), patience):
                    restarted[k] = 0.0 < learning[0] < _YOUNG
                    for i in range(8):
                        x[i] = start[i]
                        for j in range(8):
                            cov[i, j] = prior[i, j]
                    disturbed[0], learning[0] = 0.0, 0.0

        vertical, horizontal = _directions(x, field, g_t[k], b_t[k], north, east, clean)
        angle = math.atan2(east[0], north[0])
        azimuth[k] = angle + 2.0 * math.pi if angle < 0.0 else angle
        spread = _variance_along(east, clean, cov)
        # A tilt of the vertical turns the horizontal field by tan(dip), and the axis' own heading near vertical.
        upright = max(1.0 - g_t[k, 0] * g_t[k, 0], 1e-12)
        turn = (vertical * vertical / (horizontal * horizontal) + g_t[k, 0] * g_t[k, 0] / upright) * tilt
        sigma_own[k] = min(math.sqrt(max(spread, 0.0)) / horizontal, math.pi)
        sigma_azimuth[k] = min(math.sqrt((spread + white) / (horizontal * horizontal) + turn), math.pi)
        for i in range(3):
            bias[k, i], sigma[k, i] = x[i], math.sqrt(max(cov[i, i], 0.0))

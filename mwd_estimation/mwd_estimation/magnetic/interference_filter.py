# SPDX-License-Identifier: Apache-2.0
"""
Magnetic interference of the tool and its string, estimated sample by sample: bias and scale error of each axis.

The direction of gravity and the magnetometers give two numbers that do not depend on the unknown azimuth: the vertical
field V and the horizontal field H. Their differences from the reference are the measurements of an extended Kalman
filter. Its states are bias and scale error of x, y and z, and the errors of the reference H and V.

Near a horizontal east-west hole the axial bias changes H only by a term of second order. This term is part of the
innovation and of its variance. A gyro azimuth, if available, is a third measurement.

Errors that are not white (of the gravity filter, of the field along the hole) count once per correlation time at any
sample rate. A block of n samples gives the same bits as n blocks of one sample. Derivation:
``docs/methods/magnetic_interference.md``.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.core import chi_square
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of


class InterferenceErrors(NamedTuple):
    """
    Index of the first entry of each quantity in the error state; there are STATES entries.

    BIAS and SCALE (bias and scale error) have entries for x, y, z; HORIZONTAL and VERTICAL are errors of the reference.
    """

    BIAS: int = 0
    SCALE: int = 3
    HORIZONTAL: int = 6
    VERTICAL: int = 7


Error = InterferenceErrors()


STATES = 8


class InterferenceParams(NamedTuple):
    """Priors, noise and gates of the interference filter."""

    #: `axial`, `cross_axial`: prior 1 sigma of the axial interference and of the cross-axial bias, T.
    axial: float = 2000.0 * 1e-9
    cross_axial: float = 200.0 * 1e-9
    noise: float = 100e-9  #: white noise of each magnetometer axis in one sample, 1 sigma, T
    walk: float = 20.0**2 * 1e-18 / 3600.0  #: random walk of each bias, T^2/s (20 nT in an hour)
    field_walk: float = 30.0**2 * 1e-18 / 3600.0  #: random walk of the field along the hole, T^2/s
    varying: float = 30.0 * 1e-9  #: error of H and of V that lasts a correlation time, 1 sigma, T
    correlation_s: float = 10.0  #: correlation time of errors that are not white, s
    gate: float = 16.0  #: largest chi-square, with two degrees of freedom, of a sample that is used
    #: `max_reset_time_s`, `min_reset_time_s`: limits of the time of rejected samples after which the filter restarts
    #: from its priors. Between these limits it is the time of the samples accepted since the last restart. Lowering
    #: `min_reset_time_s` lets short disturbances restart the filter.
    max_reset_time_s: float = 900.0
    min_reset_time_s: float = 10.0


class InterferenceState:
    """State of the interference filter."""

    #: `x`, `P`: bias, T, and scale error of the three axes, errors of the reference H and V, T; and their covariance.
    x: Annotated[Array, STATES]
    P: Annotated[Array, STATES, STATES]
    #: `start`, `prior`: state and covariance used for a restart.
    start: Annotated[Array, STATES]
    prior: Annotated[Array, STATES, STATES]
    field: Annotated[Array, 2]  #: reference H and V, T
    last_ns: int  #: stamp of the last sample, ns; -1 before the first
    #: `disturbed_s`, `learnt_s`: time of the rejected samples since the last accepted one, and time of all accepted
    #: samples since the last restart.
    disturbed_s: float
    learnt_s: float


class InterferenceEstimate:
    """Estimates after a sample."""

    #: `bias`, `sigma`: axial, y and z bias, T, and 1 sigma.
    bias: Annotated[Array, 3]
    sigma: Annotated[Array, 3]
    #: `azimuth`, `sigma_azimuth`: magnetic azimuth without bias and scale, rad in [0, 2 pi), and 1 sigma, at most pi.
    azimuth: float
    sigma_azimuth: float
    #: 1 sigma of the azimuth from unknown biases and scale errors, rad, which are the same in successive samples.
    sigma_own: float
    ratio: float  #: chi-square of the innovation divided by the gate; above 1 the sample was not used
    #: True if the filter restarted with this sample and discarded a recent estimate, which came from a disturbed field.
    restarted: bool


class FieldSamples(NamedTuple):
    """Magnetic samples with gravity at the same instants, n of them."""

    stamp_ns: Stamps  #: stamps, ns, int64, shape (n,); a sample whose stamp does not advance does not change the state
    #: `g_t`, `b_t`: shape (n, 3); unit vector down and field, T, in tool axes.
    g_t: Array
    b_t: Array
    #: Shape (n,); 1 sigma of the direction down, rad; this error has the correlation time `correlation_s`.
    sigma_g: Array


class InterferenceInnovation:
    """Filter innovation of a sample: horizontal and vertical field minus reference, with terms for the azimuth."""

    #: `north`, `east`: unit vectors to magnetic north and east, in tool axes.
    north: Annotated[Array, 3]
    east: Annotated[Array, 3]
    clean: Annotated[Array, 3]  #: expected field, T, without the noise of the measurement
    #: `horizontal`, `vertical`: components of the measured field without bias and scale error, T.
    horizontal: float
    vertical: float
    #: `slope`, `gain`: derivatives of the innovations of V and H with respect to the state, and covariance of state and
    #: innovations.
    slope: Annotated[Array, 2, STATES]
    gain: Annotated[Array, 2, STATES]
    #: `off_v`, `off_h`: innovations of V and H, T.
    off_v: float
    off_h: float
    #: `p_vv`, `p_vh`, `p_hh`: covariance of the innovations from the covariance of the state, T^2.
    p_vv: float
    p_vh: float
    p_hh: float
    #: `r_vv`, `r_vh`, `r_hh`: covariance of the innovations from errors that last a correlation time, T^2.
    r_vv: float
    r_vh: float
    r_hh: float
    bend: float  #: variance of the second-order term of H, T^2


STATE, INTERFERENCE, INNOVATION = (
    dtype_of(InterferenceState),
    dtype_of(InterferenceEstimate),
    dtype_of(InterferenceInnovation),
)


# A restart that discards an estimate from less than this time of samples, s, is reported, so that the azimuth, which
# was computed with this estimate, is discarded too.
_YOUNG = 60.0
# Longest step for which the random walk is applied, s; a longer step counts as a step of this length.
_MAX_STEP = 7200.0
# Correlation time of the error of the second-order term of H, s.
_BEND_TIME = 3600.0
# Largest chi-square, with one degree of freedom, of an external azimuth that is used (probability 0.001).
_AZIMUTH_GATE = chi_square.limit(0.001, 1)


def initial(
    params: InterferenceParams,
    reference: Reference,
    errors: SensorErrors,
    axial: tuple[float, float] = (0.0, 0.0),
) -> Samples:
    """
    Return the state before the first sample.

    Parameters
    ----------
    errors : SensorErrors
        Sensor part of the priors: magnetometer bias (added in squares) and scale error.
    axial : tuple of float
        Initial axial interference and 1 sigma, T, if a station has found more than the prior allows. The prior sigma is
        used if it is larger, because the samples use the same reference as the station, and the error of the reference
        does not average out.

    Returns
    -------
    ndarray of dtype STATE, shape (1,)
        State; a run can continue from a copy.

    Raises
    ------
    ValueError
        If the reference has no field.
    """
    bias, scale = errors.magnetometer_bias_nt * 1e-9, errors.magnetometer_scale
    along = max(math.hypot(params.axial, bias), axial[1])
    cross = math.hypot(params.cross_axial, bias)
    state = np.zeros(1, dtype=STATE)
    s = state[0]
    s.prior[range(6), range(6)] = np.array([along, cross, cross, scale, scale, scale]) ** 2
    s.prior[Error.HORIZONTAL :, Error.HORIZONTAL :] = reference.covariance
    s.P[:] = s.prior
    s.start[Error.BIAS] = s.x[Error.BIAS] = axial[0]
    s.field[:] = reference.horizontal, reference.vertical
    s.last_ns = -1
    return state


def run(p: InterferenceParams, state: Samples, samples: FieldSamples) -> Samples:
    """
    Process samples; return for each sample the interference found so far and the azimuth without this interference.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State from `initial`, changed in place; the result does not depend on how the samples are cut into blocks.

    Returns
    -------
    ndarray of dtype INTERFERENCE, shape (n,)
    """
    rows = np.zeros(len(samples.stamp_ns), dtype=INTERFERENCE)
    # Make the arrays contiguous, so that numba compiles one layout only.
    samples = FieldSamples._make(np.ascontiguousarray(column) for column in samples)
    _run(p, state[0], samples, np.zeros(1, dtype=INNOVATION)[0], rows)
    return rows


def aid_azimuth(p: InterferenceParams, state: Samples, g_t: Array, b_t: Array, azimuth: float, sigma: float) -> float:
    """
    Update with a known magnetic azimuth (gyro azimuth minus declination), and with field and gravity of the same time.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State, changed in place unless the azimuth is rejected.
    g_t, b_t : ndarray, shape (3,)
        Unit vector down and field, T.
    azimuth, sigma : float
        Azimuth from magnetic north, rad, and 1 sigma of gyro and declination together.

    Returns
    -------
    float
        Chi-square of the innovation (one degree of freedom) divided by its gate; above 1 the azimuth was rejected.
    """
    s = state[0]
    own, horizontal, row = _azimuth(s, np.array(g_t, dtype=float), np.array(b_t, dtype=float))
    innovation = math.remainder(azimuth - own, 2.0 * math.pi)
    gain = s.P @ row
    # Gravity and field of this sample have errors too: add the correlated error `varying` of the settings.
    variance = float(row @ gain) + sigma**2 + (p.varying / horizontal) ** 2
    ratio = innovation**2 / variance / _AZIMUTH_GATE
    if ratio <= 1.0:
        s.x[:] += gain * (innovation / variance)
        s.P[:] -= np.outer(gain, gain) / variance
    return float(ratio)


def _azimuth(s: InterferenceState, g: Array, b: Array) -> tuple[float, float, Array]:
    """
    Return magnetic azimuth, rad, and horizontal field, T, of a sample, and the derivative of the azimuth.

    The derivative is with respect to the state, shape (8,). g, b, shape (3,): unit vector down, and field, T.
    """
    m = np.zeros(1, dtype=INNOVATION)[0]
    _directions(s, g, b, m)
    row = np.zeros(STATES)
    # Subtracting a field towards east turns the measured north towards west, which increases the azimuth.
    row[: Error.SCALE], row[Error.SCALE : Error.HORIZONTAL] = m.east / m.horizontal, m.east * m.clean / m.horizontal
    return math.atan2(m.east[0], m.north[0]), float(m.horizontal), row


@compiled
def _directions(s: InterferenceState, g: Array, b: Array, m: InterferenceInnovation) -> None:
    """
    Fill `north`, `east`, `clean`, `horizontal` and `vertical` of `m` for one sample, without bias and scale error.

    g, b, shape (3,): unit vector down and field, T, in tool axes.
    """
    vertical = 0.0
    for i in range(3):
        m.clean[i] = b[i] - s.x[Error.BIAS + i] - s.x[Error.SCALE + i] * b[i]
        vertical += m.clean[i] * g[i]
    square = 0.0
    for i in range(3):
        m.north[i] = m.clean[i] - vertical * g[i]
        square += m.north[i] * m.north[i]
    horizontal = max(math.sqrt(square), 1e-9)
    for i in range(3):
        m.north[i] /= horizontal
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        m.east[i] = g[j] * m.north[k] - g[k] * m.north[j]
        m.clean[i] = (s.field[1] + s.x[Error.VERTICAL]) * g[i] + (s.field[0] + s.x[Error.HORIZONTAL]) * m.north[i]
    m.vertical, m.horizontal = vertical, horizontal


@compiled
def _slopes(g: Array, m: InterferenceInnovation) -> None:
    """
    Fill the derivatives of the innovations of V and H with respect to the state; g: unit vector down, shape (3,).

    Derivatives with respect to the scale errors use the expected field and not the measured field: the noise of the
    measured field is also in the innovation, and the product of both would bias the scale errors.
    """
    for i in range(3):
        m.slope[0, Error.BIAS + i], m.slope[1, Error.BIAS + i] = -g[i], -m.north[i]
        m.slope[0, Error.SCALE + i], m.slope[1, Error.SCALE + i] = -g[i] * m.clean[i], -m.north[i] * m.clean[i]
    m.slope[0, Error.HORIZONTAL], m.slope[0, Error.VERTICAL] = 0.0, -1.0
    m.slope[1, Error.HORIZONTAL], m.slope[1, Error.VERTICAL] = -1.0, 0.0


@compiled
def _variance_east(s: InterferenceState, m: InterferenceInnovation) -> float:
    """Return the variance of the field towards east from biases and scale errors, T^2."""
    total = 0.0
    for i in range(6):
        d_i = m.east[i] if i < 3 else m.east[i - 3] * m.clean[i - 3]
        for j in range(6):
            d_j = m.east[j] if j < 3 else m.east[j - 3] * m.clean[j - 3]
            total += d_i * s.P[i, j] * d_j
    return total


@compiled
def _innovate(
    p: InterferenceParams, s: InterferenceState, samples: FieldSamples, k: int, m: InterferenceInnovation
) -> float:
    """Fill `m` with the innovation of sample k; return chi-square of the innovation divided by the gate."""
    g = samples.g_t[k]
    _directions(s, g, samples.b_t[k], m)
    _slopes(g, m)
    horizontal, vertical = m.horizontal, m.vertical
    white, tilt = p.noise * p.noise, samples.sigma_g[k] * samples.sigma_g[k]
    # A field error e towards east (remaining bias and scale error, noise, tilt) increases H by e^2 / (2 H).
    curve = 0.5 * _variance_east(s, m) / horizontal
    m.bend = 2.0 * curve * curve
    lifted = curve + 0.5 * (white + vertical * vertical * tilt) / horizontal
    m.off_v = vertical - s.field[1] - s.x[Error.VERTICAL]
    m.off_h = horizontal - s.field[0] - s.x[Error.HORIZONTAL] - lifted
    for i in range(STATES):
        m.gain[0, i] = m.gain[1, i] = 0.0
        for j in range(STATES):
            m.gain[0, i] += s.P[i, j] * m.slope[0, j]
            m.gain[1, i] += s.P[i, j] * m.slope[1, j]
    m.p_vv = m.p_vh = m.p_hh = 0.0
    for i in range(STATES):
        m.p_vv += m.slope[0, i] * m.gain[0, i]
        m.p_vh += m.slope[0, i] * m.gain[1, i]
        m.p_hh += m.slope[1, i] * m.gain[1, i]
    # A tilt of the vertical towards north changes V by H and H by -V.
    m.r_vv = p.varying * p.varying + horizontal * horizontal * tilt
    m.r_hh = p.varying * p.varying + vertical * vertical * tilt
    m.r_vh = -vertical * horizontal * tilt
    s_vv, s_vh, s_hh = m.p_vv + white + m.r_vv, m.p_vh + m.r_vh, m.p_hh + white + m.r_hh + m.bend
    chi2 = (s_hh * m.off_v * m.off_v - 2.0 * s_vh * m.off_v * m.off_h + s_vv * m.off_h * m.off_h) / (
        s_vv * s_hh - s_vh * s_vh
    )
    ratio: float = chi2 / p.gate
    return ratio


@compiled
def _learn(p: InterferenceParams, s: InterferenceState, m: InterferenceInnovation, step: float) -> None:
    """Update the state with the innovation (Kalman); step: time since the last sample, s."""
    # A correlated error counts as one measurement in twice its correlation time (exponential correlation), and the
    # error of the second-order term as one measurement in `_BEND_TIME`.
    repeats, bend_repeats = 1.0, 1.0
    if step > 0.0:
        repeats = max(2.0 * p.correlation_s / step, 1.0)
        bend_repeats = max(_BEND_TIME / step, 1.0)
    white = p.noise * p.noise
    s_vv, s_vh = m.p_vv + white + m.r_vv * repeats, m.p_vh + m.r_vh * repeats
    s_hh = m.p_hh + white + m.r_hh * repeats + m.bend * bend_repeats
    det = s_vv * s_hh - s_vh * s_vh
    w_v = (s_hh * m.off_v - s_vh * m.off_h) / det
    w_h = (s_vv * m.off_h - s_vh * m.off_v) / det
    for i in range(STATES):
        s.x[i] -= m.gain[0, i] * w_v + m.gain[1, i] * w_h
    for i in range(STATES):
        for j in range(i + 1):
            s.P[i, j] -= (
                s_hh * m.gain[0, i] * m.gain[0, j]
                - s_vh * (m.gain[0, i] * m.gain[1, j] + m.gain[1, i] * m.gain[0, j])
                + s_vv * m.gain[1, i] * m.gain[1, j]
            ) / det
            s.P[j, i] = s.P[i, j]
    s.disturbed_s = 0.0
    s.learnt_s += min(step, p.correlation_s)


@compiled
def _reject(p: InterferenceParams, s: InterferenceState, step: float) -> bool:
    """
    Count the time of rejected samples, and restart the filter from its priors if this time is too long.

    step: time since the last sample, s. Returns True if a restart discards an estimate from less than `_YOUNG` s of
    samples.
    """
    s.disturbed_s += step
    if not s.disturbed_s > min(max(s.learnt_s, p.min_reset_time_s), p.max_reset_time_s):
        return False
    restarted = 0.0 < s.learnt_s < _YOUNG
    for i in range(STATES):
        s.x[i] = s.start[i]
        for j in range(STATES):
            s.P[i, j] = s.prior[i, j]
    s.disturbed_s = s.learnt_s = 0.0
    return restarted


@compiled
def _write(
    p: InterferenceParams,
    s: InterferenceState,
    samples: FieldSamples,
    k: int,
    m: InterferenceInnovation,
    row: InterferenceEstimate,
) -> None:
    """Write the azimuth of sample k, corrected by the state, and its sigmas."""
    g = samples.g_t[k]
    _directions(s, g, samples.b_t[k], m)
    angle = math.atan2(m.east[0], m.north[0])
    row.azimuth = angle + 2.0 * math.pi if angle < 0.0 else angle
    white, tilt = p.noise * p.noise, samples.sigma_g[k] * samples.sigma_g[k]
    spread, horizontal = _variance_east(s, m), m.horizontal
    # A tilt of the vertical turns the horizontal field by the tilt times tan(dip). In a hole near the vertical it also
    # turns the direction of the axis.
    upright = max(1.0 - g[0] * g[0], 1e-12)
    turn = (m.vertical * m.vertical / (horizontal * horizontal) + g[0] * g[0] / upright) * tilt
    row.sigma_own = min(math.sqrt(max(spread, 0.0)) / horizontal, math.pi)
    row.sigma_azimuth = min(math.sqrt((spread + white) / (horizontal * horizontal) + turn), math.pi)


@compiled
def _predict(p: InterferenceParams, s: InterferenceState, stamp_ns: int) -> tuple[float, bool]:
    """Propagate the covariance to a sample; return the step from the last sample, s, and whether the stamp advances."""
    first = s.last_ns < 0
    step = 0.0 if first else 1e-9 * (stamp_ns - s.last_ns)
    if step > 0.0:
        held = min(step, _MAX_STEP)
        for i in range(3):
            s.P[i, i] += p.walk * held
        s.P[Error.HORIZONTAL, Error.HORIZONTAL] += p.field_walk * held
        s.P[Error.VERTICAL, Error.VERTICAL] += p.field_walk * held
    fresh = first or step > 0.0
    if fresh:
        s.last_ns = stamp_ns
    return step, fresh


@compiled
def _run(
    p: InterferenceParams, s: InterferenceState, samples: FieldSamples, m: InterferenceInnovation, rows: Samples
) -> None:
    """Process the samples and fill `rows`; m: scratch record, overwritten by each sample."""
    for k in range(len(samples.stamp_ns)):
        row, finite = rows[k], True
        for i in range(3):
            finite = finite and math.isfinite(samples.b_t[k, i]) and math.isfinite(samples.g_t[k, i])
        if finite:
            step, fresh = _predict(p, s, samples.stamp_ns[k])
            row.ratio = _innovate(p, s, samples, k, m)
            if fresh and row.ratio <= 1.0:
                _learn(p, s, m, step)
            elif fresh:
                row.restarted = _reject(p, s, step)
            _write(p, s, samples, k, m, row)
        else:
            row.azimuth, row.sigma_azimuth, row.sigma_own = math.nan, math.pi, math.pi
        for i in range(3):
            row.bias[i], row.sigma[i] = s.x[i], math.sqrt(max(s.P[i, i], 0.0))

# SPDX-License-Identifier: Apache-2.0
"""Settings, state and results of the interference filter, as records for its kernels."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from mwd_sensors.core.arrays import Array, Stamps
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

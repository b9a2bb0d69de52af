# SPDX-License-Identifier: Apache-2.0
"""Settings, state and rows of the interference filter, in the form that its kernels use."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.records import dtype_of


class ErrorOrder(NamedTuple):
    """
    Order of the error state: the first index of each quantity; STATES in total.

    BIAS and SCALE have x, y, z; HORIZONTAL and VERTICAL are errors of the reference.
    """

    BIAS: int = 0
    SCALE: int = 3
    HORIZONTAL: int = 6
    VERTICAL: int = 7


Error = ErrorOrder()


STATES = 8


class Params(NamedTuple):
    """Priors, noise and gates of the interference filter."""

    #: `axial`, `cross_axial`: prior of the axial interference and of the cross-axial bias, 1 sigma, T.
    axial: float = 2000.0 * 1e-9
    cross_axial: float = 200.0 * 1e-9
    noise: float = 100e-9  #: white noise of each magnetometer axis in one sample, 1 sigma, T
    walk: float = 20.0**2 * 1e-18 / 3600.0  #: random walk of every bias, T^2/s
    field_walk: float = 30.0**2 * 1e-18 / 3600.0  #: random walk of the field along the hole, T^2/s
    varying: float = 30.0 * 1e-9  #: error of H and of V that lasts a correlation time, 1 sigma, T
    correlation_s: float = 10.0  #: correlation time of errors that are not white
    gate: float = 16.0  #: chi-square with two degrees of freedom above which a sample is rejected
    #: `max_reset_time_s`, `min_reset_time_s`: longest and shortest time of rejected samples after which the filter
    #: restarts from its priors; with a lower shortest time it restarts on short disturbances.
    max_reset_time_s: float = 900.0
    min_reset_time_s: float = 10.0


class State:
    """State of the filter."""

    #: `x`, `P`: bias, T, and scale of the three axes, errors of the reference H and V, T; and covariance.
    x: Annotated[Array, STATES]
    P: Annotated[Array, STATES, STATES]
    #: `start`, `prior`: state and covariance used for a restart.
    start: Annotated[Array, STATES]
    prior: Annotated[Array, STATES, STATES]
    field: Annotated[Array, 2]  #: reference H and V, T
    last_ns: int  #: stamp of the last sample; -1 before the first
    #: `disturbed_s`, `learnt_s`: time of the rejected samples since an accepted one, and of all accepted ones, s.
    disturbed_s: float
    learnt_s: float


class Interference:
    """Estimates after a sample."""

    #: `bias`, `sigma`: axial, y and z bias, T, and 1 sigma.
    bias: Annotated[Array, 3]
    sigma: Annotated[Array, 3]
    #: `azimuth`, `sigma_azimuth`: magnetic azimuth without bias and scale, rad in [0, 2 pi), and 1 sigma, at most pi.
    azimuth: float
    sigma_azimuth: float
    #: Part of that sigma due to unknown biases and scales, which lasts from sample to sample.
    sigma_own: float
    ratio: float  #: chi-square of the innovation divided by the gate; above 1 the sample was not used
    #: True if with this sample the filter discarded what it had learnt recently, because it came from a disturbed
    #: place.
    restarted: bool


class FieldSamples(NamedTuple):
    """Magnetic samples with gravity at the same instants, n of them."""

    stamp_ns: Stamps  #: int64, shape (n,); not decreasing; a sample at or before the last stamp is not learnt from
    #: `g_t`, `b_t`: shape (n, 3); unit vector down and field, T, in tool axes.
    g_t: Array
    b_t: Array
    sigma_g: Array  #: shape (n,); 1 sigma of the direction down, rad, an error that lasts a correlation time


class Innovation:
    """Filter innovation of a sample: horizontal and vertical field minus reference, with terms for the azimuth."""

    #: `north`, `east`: unit vectors in tool axes.
    north: Annotated[Array, 3]
    east: Annotated[Array, 3]
    clean: Annotated[Array, 3]  #: expected field, T, without the noise of the measurement
    #: `horizontal`, `vertical`: measured field minus bias and scale, T.
    horizontal: float
    vertical: float
    #: `slope`, `gain`: slopes of the innovations of V and H by the state, and covariance of state and innovation.
    slope: Annotated[Array, 2, STATES]
    gain: Annotated[Array, 2, STATES]
    #: `off_v`, `off_h`: innovations, T.
    off_v: float
    off_h: float
    #: `p_vv`, `p_vh`, `p_hh`: part of their covariance due to the state, T^2.
    p_vv: float
    p_vh: float
    p_hh: float
    #: `r_vv`, `r_vh`, `r_hh`: part of their covariance due to errors that last a correlation time, T^2.
    r_vv: float
    r_vh: float
    r_hh: float
    bend: float  #: variance of the second-order term of H


STATE, INTERFERENCE, INNOVATION = dtype_of(State), dtype_of(Interference), dtype_of(Innovation)

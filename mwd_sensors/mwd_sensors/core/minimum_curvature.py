# SPDX-License-Identifier: Apache-2.0
"""
Well path between survey stations: circular arcs by the minimum curvature method.

Two stations and the measured depth between them define one arc in space that has the surveyed directions at its ends.
All angles are in rad, all lengths in m. Positions are north, east, down (`n`) from the start of the path.

Sources: S. J. Sawaryn and J. L. Thorogood, "A Compendium of Directional Calculations Based on the Minimum Curvature
Method", SPE Drilling & Completion 20 (2005): arc, interpolation and ratio factor. The dogleg is written here as a sum
of positive terms for the half angle, which keeps all its digits from 0 to 180 deg.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau

# Sine of inclination below which a direction is vertical (down or up) and has no azimuth.
VERTICAL = 1e-9
# Two directions do not determine the plane of an arc if their dogleg differs from 180 deg by less than this, rad.
REVERSAL = 1e-6


def tangent(inclination: ArrayLike, azimuth: ArrayLike) -> Array:
    """Return the down-hole unit vector, NED, shape (..., 3), of inclination and azimuth, rad, broadcast to (...)."""
    inc, azi = np.broadcast_arrays(np.asarray(inclination, dtype=float), np.asarray(azimuth, dtype=float))
    s_i = np.sin(inc)
    return np.stack([s_i * np.cos(azi), s_i * np.sin(azi), np.cos(inc)], axis=-1)


def directions(inclination: ArrayLike, azimuth: ArrayLike, known_from: float = VERTICAL) -> npt.NDArray[np.complex128]:
    """
    Return the azimuth of the hole at each station, and its certainty from 0 to 1.

    A vertical station has no azimuth: the number that a list prints there has no meaning. Such a station takes the
    azimuth of the hole below it, or else of the hole above it, because the arcs to the neighbouring stations leave the
    vertical in these directions. Between the vertical and `known_from` the station's own azimuth has the
    weight (sin(inclination) / sin(known_from))^2, so that the result is continuous in inclination and azimuth.

    Parameters
    ----------
    inclination, azimuth : array_like, shape (n,)
        Inclination from the vertical and azimuth, rad.
    known_from : float
        Smallest angle from the vertical at which the station's own azimuth has the full weight 1, rad.

    Returns
    -------
    ndarray of complex, shape (n,)
        The argument is the azimuth, the magnitude is the certainty, from 0 to 1. The magnitude is 0 if no station of
        the hole has an azimuth.
    """
    inc, azi = np.asarray(inclination, dtype=float), np.asarray(azimuth, dtype=float)
    weight = np.minimum((np.sin(inc) / math.sin(known_from)) ** 2, 1.0)
    weight = np.where(np.sin(inc) < VERTICAL, 0.0, weight)
    own = weight * np.exp(1j * azi)
    below, above = own.copy(), np.append(0.0, own)
    for k in np.flatnonzero(weight[:-1] < 1.0)[::-1]:
        below[k] += (1.0 - weight[k]) * below[k + 1]
    for k in np.flatnonzero(weight < 1.0):
        above[k + 1] += (1.0 - weight[k]) * above[k]
    return np.asarray(below + np.where(weight < 1.0, np.maximum(1.0 - np.abs(below), 0.0), 0.0) * above[:-1])


def dogleg(inclination_1: ArrayLike, azimuth_1: ArrayLike, inclination_2: ArrayLike, azimuth_2: ArrayLike) -> Array:
    """
    Return the angle between two directions.

    All arguments rad, broadcast to shape (...). Returns shape (...), rad in [0, pi], with full relative precision for
    the smallest angles and near 180 deg (the arccos of the textbooks loses half the digits at both ends).
    """
    inc_1, inc_2 = np.asarray(inclination_1, dtype=float), np.asarray(inclination_2, dtype=float)
    half_build, half_sum = 0.5 * (inc_2 - inc_1), 0.5 * (inc_2 + inc_1)
    half_turn = 0.5 * (np.asarray(azimuth_2, dtype=float) - np.asarray(azimuth_1, dtype=float))
    s_turn, c_turn = np.sin(half_turn), np.cos(half_turn)
    s_half = np.hypot(np.sin(half_build) * c_turn, np.sin(half_sum) * s_turn)
    c_half = np.hypot(np.cos(half_build) * c_turn, np.cos(half_sum) * s_turn)
    return np.asarray(2.0 * np.arctan2(s_half, c_half))


def path(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """
    Return the positions of the stations.

    Parameters
    ----------
    md : array_like, shape (n,)
        Measured depth, m, strictly increasing.
    inclination, azimuth : array_like, shape (n,)
        Inclination from the vertical and azimuth from the north of the axes, rad.
    start : array_like, shape (3,)
        Position of the first station (the tie-on), m.

    Returns
    -------
    ndarray, shape (n, 3)
        North, east, down, m.

    Raises
    ------
    ValueError
        Lengths differ, a value is not finite, depth does not increase, or two neighbours point in opposite directions.
    """
    depth, inc, azi = checked_stations(md, inclination, azimuth)
    origin = np.asarray(start, dtype=float)
    if origin.shape != (3,) or not np.all(np.isfinite(origin)):
        raise ValueError(f"start: expected three finite numbers (north, east, down in m), got {start!r}")
    angle = dogleg(inc[:-1], azi[:-1], inc[1:], azi[1:])
    _refuse_reversals(angle, depth)
    direction = tangent(inc, azi)
    # tan(D/2) / (D/2), written so that it is exactly one at zero.
    ratio = np.sinc(angle / (2.0 * np.pi)) / np.cos(0.5 * angle)
    step = 0.5 * (np.diff(depth) * ratio)[:, None] * (direction[:-1] + direction[1:])
    return np.asarray(origin + np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)]))


def interpolate(
    md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, positions: ArrayLike, at: ArrayLike
) -> tuple[Array, Array, Array]:
    """
    Return attitude and position on the arcs between the stations.

    Parameters
    ----------
    md, inclination, azimuth : array_like, shape (n,)
        The stations, as for `path`.
    positions : array_like, shape (n, 3)
        Positions returned by `path` for these stations, m.
    at : array_like, shape (...)
        Measured depths, m, anywhere from the first station to the last.

    Returns
    -------
    inclination, azimuth : ndarray, shape (...)
        Angles, rad; at a station exactly the given values, with azimuth wrapped to [0, 2 pi). Where the hole is
        vertical, the azimuth is that of the inclined hole below it, or else above it (`directions`).
    position : ndarray, shape (..., 3)
        North, east, down, m.

    Raises
    ------
    ValueError
        The errors of `path`, or a depth outside the stations.
    """
    depth, inc, azi = checked_stations(md, inclination, azimuth)
    points = np.asarray(positions, dtype=float)
    if points.shape != (depth.size, 3):
        raise ValueError(f"positions: expected shape ({depth.size}, 3) for {depth.size} stations, got {points.shape}")
    wanted = np.asarray(at, dtype=float)
    outside = ~((wanted >= depth[0]) & (wanted <= depth[-1]))
    if np.any(outside):
        worst = wanted[outside].flat[0]
        raise ValueError(f"at: {worst} m is outside the stations, {depth[0]} to {depth[-1]} m")
    if depth.size == 1:
        shape = wanted.shape
        return np.full(shape, inc[0]), np.full(shape, wrap_tau(azi[0])), np.broadcast_to(points[0], (*shape, 3)).copy()
    angle = dogleg(inc[:-1], azi[:-1], inc[1:], azi[1:])
    _refuse_reversals(angle, depth)
    direction = tangent(inc, azi)

    k = np.clip(np.searchsorted(depth, wanted, side="right") - 1, 0, depth.size - 2)
    length = depth[k + 1] - depth[k]
    heading, offset = _on_arc(direction[k], direction[k + 1], angle[k], (wanted - depth[k]) / length)
    offset = length[..., None] * offset

    across = np.hypot(heading[..., 0], heading[..., 1])
    inc_at = np.arctan2(across, heading[..., 2])
    azi_at = np.where(across < 1e-15, azi[k], np.arctan2(heading[..., 1], heading[..., 0]))
    position_at = points[k] + offset
    # At a station return the given values exactly, without the rounding of the arc.
    for station in (k, k + 1):
        there = wanted == depth[station]
        inc_at, azi_at = np.where(there, inc[station], inc_at), np.where(there, azi[station], azi_at)
        position_at = np.where(there[..., None], points[station], position_at)
    return np.asarray(inc_at), wrap_tau(azi_at), np.asarray(position_at)


def _on_arc(upper_t: Array, lower_t: Array, angle: Array, share: Array) -> tuple[Array, Array]:
    """
    Return the tangent at a point of the arc, and the point's offset from the upper station divided by the arc's length.

    upper_t, lower_t, shape (..., 3), are the tangents at the stations; angle, shape (...), is the dogleg, rad; share,
    shape (...), is the distance from the upper station to the point along the arc, divided by the arc's length. Both
    results have shape (..., 3).
    """
    part = share * angle
    sinc_full = np.sinc(angle / np.pi)
    # Arc in the plane of the two tangents: coefficients of the upper and lower tangent, regular at zero dogleg.
    lower = share * np.sinc(part / np.pi) / sinc_full
    upper = np.cos(part) - lower * np.cos(angle)
    reach_lower = 0.5 * (share * np.sinc(part / (2.0 * np.pi))) ** 2 / sinc_full
    reach_upper = share * np.sinc(part / np.pi) - reach_lower * np.cos(angle)
    heading = upper[..., None] * upper_t + lower[..., None] * lower_t
    return heading, reach_upper[..., None] * upper_t + reach_lower[..., None] * lower_t


def dogleg_severity(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, per: float = 30.0) -> Array:
    """
    Return the dogleg of the interval that ends at each station, rad per `per` metres, shape (n,); the first is 0.

    Arguments and errors as for `path`, except that a reversal is allowed.
    """
    depth, inc, azi = checked_stations(md, inclination, azimuth)
    return _rate(depth, dogleg(inc[:-1], azi[:-1], inc[1:], azi[1:]), per)


def build_rate(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, per: float = 30.0) -> Array:
    """
    Return the change of inclination of the interval that ends at each station, rad per `per` metres, shape (n,).

    The first value is 0. Arguments and errors as for `dogleg_severity`.
    """
    depth, inc, _ = checked_stations(md, inclination, azimuth)
    return _rate(depth, np.diff(inc), per)


def turn_rate(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, per: float = 30.0) -> Array:
    """
    Return the change of azimuth of the interval that ends at each station, rad per `per` metres, shape (n,).

    The first value is 0. A change of azimuth is between -180 and 180 deg. An interval that starts or ends vertical has
    the rate 0, because the azimuth has no meaning there. Arguments and errors as for `dogleg_severity`.
    """
    depth, inc, azi = checked_stations(md, inclination, azimuth)
    vertical = np.sin(inc) < VERTICAL
    turn = np.where(vertical[:-1] | vertical[1:], 0.0, wrap_pi(np.diff(azi)))
    return _rate(depth, turn, per)


def vertical_section(positions: ArrayLike, azimuth: float) -> Array:
    """
    Return the horizontal distance of positions from their origin along one azimuth.

    positions, shape (..., 2 or 3): north, east(, down), m. azimuth: direction of the section, rad. Returns shape (...),
    m.
    """
    points = np.asarray(positions, dtype=float)
    return np.asarray(points[..., 0] * np.cos(azimuth) + points[..., 1] * np.sin(azimuth))


def closure(positions: ArrayLike) -> float:
    """
    Return the azimuth from the first position to the last, rad in [0, 2 pi), the usual azimuth of the vertical section.

    positions, shape (n, 2 or 3), n >= 1: north, east(, down), m.
    """
    points = np.asarray(positions, dtype=float)
    north, east = points[-1, :2] - points[0, :2]
    return float(wrap_tau(np.arctan2(east, north)))


def checked_stations(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike) -> tuple[Array, Array, Array]:
    """
    Check measured depth, inclination and azimuth, and return them as float arrays of shape (n,), n >= 1.

    The azimuth of a vertical station is replaced by the azimuth of the hole next to it (`directions`), so that no
    result depends on the meaningless number that a list has there.

    Raises
    ------
    ValueError
        Lengths differ, nothing is given, a value is not finite, inclination is outside [0, pi], or measured depth
        does not increase; the message names the first station at fault, counted from 0.
    """
    depth, inc, azi = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (md, inclination, azimuth))
    if depth.ndim != 1 or depth.size == 0 or not depth.shape == inc.shape == azi.shape:
        raise ValueError(
            "md, inclination, azimuth: expected three lists of one length, at least 1,"
            f" got shapes {depth.shape}, {inc.shape}, {azi.shape}"
        )
    for name, values in (("md", depth), ("inclination", inc), ("azimuth", azi)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise ValueError(f"{name}: must be finite, got {values[bad[0]]} at station {bad[0]}")
    bad = np.flatnonzero((inc < 0.0) | (inc > np.pi))
    if bad.size:
        raise ValueError(f"inclination: must be within 0 and pi rad, got {inc[bad[0]]} at station {bad[0]}")
    bad = np.flatnonzero(np.diff(depth) <= 0.0)
    if bad.size:
        k = int(bad[0])
        raise ValueError(f"md: must increase, got {depth[k + 1]} m at station {k + 1} after {depth[k]} m")
    vertical = np.sin(inc) < VERTICAL
    return depth, inc, np.where(vertical, wrap_tau(np.angle(directions(inc, azi))), azi) if vertical.any() else azi


def _rate(depth: Array, change: Array, per: float) -> Array:
    return np.concatenate([[0.0], change / np.diff(depth) * per])


def _refuse_reversals(angle: Array, depth: Array) -> None:
    bad = np.flatnonzero(angle > np.pi - REVERSAL)
    if bad.size:
        k = int(bad[0])
        raise ValueError(
            f"stations at {depth[k]} and {depth[k + 1]} m point opposite ways: no single arc joins them; check azimuth"
        )

# SPDX-License-Identifier: Apache-2.0
"""
Motion of the sonde, exact at every instant: along the hole, about its axis, and vibration.

The position is the point on the hole's arc plus the bounded displacement of the vibration. The
attitude is the product of three rotations: the hole axes ``h`` (x down-hole, y left, z high side) along the circular
arcs of the hole, a small tilt, and the toolface about x. Every angle comes with its exact first and second derivative,
so that rates and accelerations are never computed from differences.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.simulator.schedule import Timeline
from mwd_sensors.simulator.vibration import (
    CHANNELS,
    Hits,
    PerTurnLines,
    SpectralLines,
    Sweep,
    SweepLines,
    Vibrations,
    add_hits,
    add_lines,
    add_per_turn,
    add_sweep,
)

Vector = tuple[float, float, float]


class WellPath(NamedTuple):
    """A hole of circular arcs between stations (minimum curvature), straight above the first and below the last."""

    md: Array  #: shape (m,); measured depth at the start of each arc, m
    position: Array  #: shape (m, 3); north, east, down at the start of each arc, m
    #: `tangent`, `normal`: shape (m, 3); direction of the hole at the start of each arc, and the direction in which it
    #: bends, NED.
    tangent: Array
    normal: Array
    curvature: Array  #: shape (m,); curvature of each arc, rad/m
    azimuth: Array  #: shape (m,); azimuth to use where the arc is vertical, rad


class Kinematics(NamedTuple):
    """Exact motion of the tool's reference point on its axis at n instants."""

    mat_nt: Array  #: shape (n, 3, 3); rotation from tool axes to north, east, down
    #: `rate_t`, `rate_dot_t`: shape (n, 3); rotation relative to the local level frame, in tool axes, rad/s and
    #: rad/s^2.
    rate_t: Array
    rate_dot_t: Array
    #: `position_n`, `velocity_n`, `acceleration_n`: shape (n, 3); north, east, down from the wellhead, m, m/s, m/s^2.
    position_n: Array
    velocity_n: Array
    acceleration_n: Array
    md: Array  #: shape (n,); measured depth of the sonde, m


class EarthAtPlace(NamedTuple):
    """Earth rate in NED, rad/s, shape (3,); gravity at the surface, m/s^2, and its change with depth, 1/s^2."""

    earth_rate_n: Array
    gravity: float
    gravity_gradient: float


class HolePoint(NamedTuple):
    """Position on an arc of the hole, and the hole's direction there."""

    #: `forward`, `aside`: distance from the start of the arc along its tangent and along its normal, m.
    forward: float
    aside: float
    #: `sin_inc`, `cos_inc`, `sin_azi`, `cos_azi`: sine and cosine of inclination and azimuth.
    sin_inc: float
    cos_inc: float
    sin_azi: float
    cos_azi: float
    #: `inc_s`, `azi_s`, `inc_ss`, `azi_ss`: first and second derivatives of inclination and azimuth along the hole,
    #: rad/m and rad/m^2.
    inc_s: float
    azi_s: float
    inc_ss: float
    azi_ss: float


@compiled
def assemble(path: WellPath, feed: Array, feed_dot: Array, turn: Array, shake: Array, out: Kinematics) -> None:
    """
    Compute the motion of the tool from hole, feed, rotation and vibration, and write it to `out`.

    The caller has set the measured depths `out.md`.

    feed and feed_dot, shape (n,): rate and acceleration of the measured depth, m/s and m/s^2. turn, shape (3, n): angle
    of the string, rad, with its rate and acceleration. shake, shape (6, 3, n): the channels of `vibration`.
    """
    arc = 0
    for i in range(len(out.md)):
        while arc + 1 < len(path.md) and out.md[i] >= path.md[arc + 1]:
            arc += 1
        while arc > 0 and out.md[i] < path.md[arc]:
            arc -= 1
        hole = _hole_point(path, arc, out.md[i] - path.md[arc])
        w, a = _hole_rotation(hole, feed[i], feed_dot[i])
        for k in range(3):
            along = path.position[arc, k] + hole.forward * path.tangent[arc, k]
            out.position_n[i, k] = along + hole.aside * path.normal[arc, k]
        _displace(hole, feed[i], feed_dot[i], w, a, shake, i, out)
        _rotate(hole, w, a, turn, shake, i, out)


@compiled
def _hole_point(path: WellPath, arc: int, x: float) -> HolePoint:
    """Return the point of the hole x metres after the start of an arc."""
    kappa = path.curvature[arc] if x >= 0.0 else 0.0
    bend = kappa * x
    sin_b, cos_b = math.sin(bend), math.cos(bend)
    if kappa > 0.0:
        forward, aside = sin_b / kappa, 2.0 * math.sin(0.5 * bend) ** 2 / kappa
    else:
        forward, aside = x, 0.0
    t0 = cos_b * path.tangent[arc, 0] + sin_b * path.normal[arc, 0]
    t1 = cos_b * path.tangent[arc, 1] + sin_b * path.normal[arc, 1]
    t2 = cos_b * path.tangent[arc, 2] + sin_b * path.normal[arc, 2]
    n0 = cos_b * path.normal[arc, 0] - sin_b * path.tangent[arc, 0]
    n1 = cos_b * path.normal[arc, 1] - sin_b * path.tangent[arc, 1]
    n2 = cos_b * path.normal[arc, 2] - sin_b * path.tangent[arc, 2]
    s_i = math.hypot(t0, t1)
    c_i = t2
    # Inclination and azimuth as functions of depth; the direction moves on a great circle.
    if s_i > 1e-9:
        azimuth = math.atan2(t1, t0)
        inc_s = -kappa * n2 / s_i
        pole = t0 * n1 - t1 * n0
        azi_s = kappa * pole / (s_i * s_i)
    else:
        azimuth = path.azimuth[arc]
        inc_s = kappa if c_i > 0.0 else -kappa
        azi_s = 0.0
    s_a, c_a = math.sin(azimuth), math.cos(azimuth)
    inc_ss = s_i * c_i * azi_s * azi_s
    azi_ss = -2.0 * azi_s * inc_s * c_i / s_i if s_i > 1e-9 else 0.0
    return HolePoint(forward, aside, s_i, c_i, s_a, c_a, inc_s, azi_s, inc_ss, azi_ss)


@compiled
def _hole_rotation(hole: HolePoint, v: float, v_dot: float) -> tuple[Vector, Vector]:
    """
    Return angular rate, rad/s, and angular acceleration, rad/s^2, of the hole axes, in hole axes.

    v and v_dot are rate and acceleration of the measured depth, m/s and m/s^2.
    """
    inc_1, azi_1 = hole.inc_s * v, hole.azi_s * v
    inc_2 = hole.inc_ss * v * v + hole.inc_s * v_dot
    azi_2 = hole.azi_ss * v * v + hole.azi_s * v_dot
    c_i, s_i = hole.cos_inc, hole.sin_inc
    rate = (azi_1 * c_i, -inc_1, -azi_1 * s_i)
    rate_dot = (azi_2 * c_i - azi_1 * inc_1 * s_i, -inc_2, -azi_2 * s_i - azi_1 * inc_1 * c_i)
    return rate, rate_dot


@compiled
def _hole_axes(hole: HolePoint) -> tuple[Vector, Vector, Vector]:
    """Return the matrix from hole axes to NED, row by row; its columns are axis, left and high side."""
    s_i, c_i, s_a, c_a = hole.sin_inc, hole.cos_inc, hole.sin_azi, hole.cos_azi
    return (s_i * c_a, s_a, c_i * c_a), (s_i * s_a, -c_a, c_i * s_a), (c_i, 0.0, -s_i)


@compiled
def _displace(
    hole: HolePoint, v: float, v_dot: float, w: Vector, a: Vector, shake: Array, i: int, out: Kinematics
) -> None:
    """Add the vibration's displacement to the position at instant i, and fill velocity and acceleration."""
    w0, w1, w2 = w
    a0, a1, a2 = a
    # Displacement in hole axes, and its derivatives as seen from the level frame.
    d0, d1, d2 = shake[0, 0, i], shake[1, 0, i], shake[2, 0, i]
    e0, e1, e2 = shake[0, 1, i], shake[1, 1, i], shake[2, 1, i]
    wd0, wd1, wd2 = w1 * d2 - w2 * d1, w2 * d0 - w0 * d2, w0 * d1 - w1 * d0
    vel0, vel1, vel2 = v + e0 + wd0, e1 + wd1, e2 + wd2
    acc0 = shake[0, 2, i] + 2.0 * (w1 * e2 - w2 * e1) + (a1 * d2 - a2 * d1) + (w1 * wd2 - w2 * wd1)
    acc1 = shake[1, 2, i] + 2.0 * (w2 * e0 - w0 * e2) + (a2 * d0 - a0 * d2) + (w2 * wd0 - w0 * wd2)
    acc2 = shake[2, 2, i] + 2.0 * (w0 * e1 - w1 * e0) + (a0 * d1 - a1 * d0) + (w0 * wd1 - w1 * wd0)
    acc0 += v_dot
    acc1 -= hole.azi_s * hole.sin_inc * v * v
    acc2 += hole.inc_s * v * v
    for k, (h0, h1, h2) in enumerate(_hole_axes(hole)):
        out.position_n[i, k] += h0 * d0 + h1 * d1 + h2 * d2
        out.velocity_n[i, k] = h0 * vel0 + h1 * vel1 + h2 * vel2
        out.acceleration_n[i, k] = h0 * acc0 + h1 * acc1 + h2 * acc2


@compiled
def _rotate(hole: HolePoint, w: Vector, a: Vector, turn: Array, shake: Array, i: int, out: Kinematics) -> None:
    """Fill attitude, rate and derivative of the rate at instant i: hole axes, then tilt, then toolface."""
    w0, w1, w2 = w
    a0, a1, a2 = a
    # Tilt: about y by p, then about the new z by q. P transforms tilted axes to hole axes.
    p, p_1, p_2 = shake[3, 0, i], shake[3, 1, i], shake[3, 2, i]
    q, q_1, q_2 = shake[4, 0, i], shake[4, 1, i], shake[4, 2, i]
    s_p, c_p, s_q, c_q = math.sin(p), math.cos(p), math.sin(q), math.cos(q)
    p00, p01, p02 = c_p * c_q, -c_p * s_q, s_p
    p10, p11, p12 = s_q, c_q, 0.0
    p20, p21, p22 = -s_p * c_q, s_p * s_q, c_p
    r0, r1, r2 = p_1 * s_q, p_1 * c_q, q_1
    u0 = p00 * w0 + p10 * w1 + p20 * w2
    u1 = p01 * w0 + p11 * w1 + p21 * w2
    u2 = p02 * w0 + p12 * w1 + p22 * w2
    # d/dt (P^T w) = P^T w' - r x (P^T w)
    b0 = p00 * a0 + p10 * a1 + p20 * a2 - (r1 * u2 - r2 * u1) + p_2 * s_q + p_1 * q_1 * c_q
    b1 = p01 * a0 + p11 * a1 + p21 * a2 - (r2 * u0 - r0 * u2) + p_2 * c_q - p_1 * q_1 * s_q
    b2 = p02 * a0 + p12 * a1 + p22 * a2 - (r0 * u1 - r1 * u0) + q_2
    u0, u1, u2 = u0 + r0, u1 + r1, u2 + r2
    # Toolface: a rotation about x.
    spin = turn[1, i] + shake[5, 1, i]
    spin_dot = turn[2, i] + shake[5, 2, i]
    toolface = turn[0, i] + shake[5, 0, i]
    s_t, c_t = math.sin(toolface), math.cos(toolface)
    z0, z1, z2 = u0, c_t * u1 + s_t * u2, c_t * u2 - s_t * u1
    out.rate_t[i, 0], out.rate_t[i, 1], out.rate_t[i, 2] = z0 + spin, z1, z2
    out.rate_dot_t[i, 0] = b0 + spin_dot
    out.rate_dot_t[i, 1] = c_t * b1 + s_t * b2 + spin * z2
    out.rate_dot_t[i, 2] = c_t * b2 - s_t * b1 - spin * z1
    # mat_nt = H P X: hole axes H, tilt P, and rotation X about x by the toolface.
    for k, (h0, h1, h2) in enumerate(_hole_axes(hole)):
        m0 = h0 * p00 + h1 * p10 + h2 * p20
        m1 = h0 * p01 + h1 * p11 + h2 * p21
        m2 = h0 * p02 + h1 * p12 + h2 * p22
        out.mat_nt[i, k, 0] = m0
        out.mat_nt[i, k, 1] = c_t * m1 + s_t * m2
        out.mat_nt[i, k, 2] = c_t * m2 - s_t * m1


@compiled
def sensed(k: Kinematics, lever_t: Array, place: EarthAtPlace, rate_it: Array, f_t: Array) -> None:
    """
    Compute the inputs of ideal sensors at a lever arm from the reference point.

    Parameters
    ----------
    k : Kinematics
        Motion of the tool's reference point.
    lever_t : ndarray, shape (3,)
        Position of the sensors relative to the reference point, tool axes, m.
    place : EarthAtPlace
        Earth rate and gravity.
    rate_it, f_t : ndarray, shape (n, 3)
        Output: rotation relative to inertial space, rad/s, and specific force, m/s^2, in tool axes.
    """
    e0, e1, e2 = place.earth_rate_n[0], place.earth_rate_n[1], place.earth_rate_n[2]
    x, y, z = lever_t[0], lever_t[1], lever_t[2]
    for i in range(len(k.md)):
        v0, v1, v2 = k.velocity_n[i, 0], k.velocity_n[i, 1], k.velocity_n[i, 2]
        gravity = place.gravity + place.gravity_gradient * k.position_n[i, 2]
        f0 = k.acceleration_n[i, 0] + 2.0 * (e1 * v2 - e2 * v1)
        f1 = k.acceleration_n[i, 1] + 2.0 * (e2 * v0 - e0 * v2)
        f2 = k.acceleration_n[i, 2] + 2.0 * (e0 * v1 - e1 * v0) - gravity
        w0, w1, w2 = k.rate_t[i, 0], k.rate_t[i, 1], k.rate_t[i, 2]
        a0, a1, a2 = k.rate_dot_t[i, 0], k.rate_dot_t[i, 1], k.rate_dot_t[i, 2]
        c0, c1, c2 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
        f_t[i, 0] = a1 * z - a2 * y + w1 * c2 - w2 * c1
        f_t[i, 1] = a2 * x - a0 * z + w2 * c0 - w0 * c2
        f_t[i, 2] = a0 * y - a1 * x + w0 * c1 - w1 * c0
        for axis in range(3):
            m0, m1, m2 = k.mat_nt[i, 0, axis], k.mat_nt[i, 1, axis], k.mat_nt[i, 2, axis]
            f_t[i, axis] += m0 * f0 + m1 * f1 + m2 * f2
            rate_it[i, axis] = k.rate_t[i, axis] + m0 * e0 + m1 * e1 + m2 * e2


def well_path(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike) -> WellPath:
    """
    Return the arcs of a hole through stations.

    md, m, ascending, inclination and azimuth (true north), rad, have shape (m,). The first station lies at its own
    depth vertically below the origin.

    Raises
    ------
    ValueError
        There are no stations, depths do not ascend, or two stations differ by 180 deg in direction.
    """
    depth, inc, azi = (np.atleast_1d(np.asarray(a, dtype=float)) for a in (md, inclination, azimuth))
    if len(depth) == 0 or np.any(np.diff(depth) <= 0.0):
        raise ValueError("path: at least one station is needed, and measured depths must ascend")
    tangents = np.stack([np.sin(inc) * np.cos(azi), np.sin(inc) * np.sin(azi), np.cos(inc)], axis=-1)
    position = np.array([0.0, 0.0, depth[0]])
    rows = []
    for k in range(len(depth)):
        normal, curvature, plane_azimuth = np.zeros(3), 0.0, azi[k]
        if k + 1 < len(depth):
            length, cos_b = depth[k + 1] - depth[k], float(tangents[k] @ tangents[k + 1])
            across = tangents[k + 1] - cos_b * tangents[k]
            sin_b = float(np.linalg.norm(across))
            angle = math.atan2(sin_b, cos_b)
            if angle > math.pi - 1e-6:
                raise ValueError(f"path: the hole turns back on itself between {depth[k]:g} and {depth[k + 1]:g} m")
            if angle > 1e-12:
                normal, curvature = across / sin_b, angle / length
            if math.sin(inc[k]) < 1e-9:
                plane_azimuth = azi[k + 1]
        rows.append((depth[k], position, tangents[k], normal, curvature, plane_azimuth))
        if k + 1 < len(depth):
            position = position + _along(tangents[k], normal, curvature, length)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return WellPath(*columns)


def _along(tangent: Array, normal: Array, curvature: float, length: float) -> Array:
    turn = curvature * length
    # np.sinc is exact for a straight hole.
    forward = length * np.sinc(turn / np.pi)
    aside = 0.5 * curvature * length**2 * np.sinc(0.5 * turn / np.pi) ** 2
    return np.asarray(forward * tangent + aside * normal)


@dataclasses.dataclass(frozen=True)
class SimulatedMotion:
    """
    Motion of a whole simulation, for which all random numbers are drawn; `at` computes the motion at any instant.

    sensor_to_bit : distance from the sensors to the bit along the hole, m.
    """

    path: WellPath
    timeline: Timeline
    sensor_to_bit: float
    vibrations: Vibrations
    lines: SpectralLines
    hits: Hits

    def at(self, first: int, count: int, rate: float, turn: Array | None = None, span: int | None = None) -> Kinematics:
        """
        Return the kinematics at the instants (first + k) / rate, s, k = 0 .. count - 1; first may be negative.

        Parameters
        ----------
        turn : ndarray, shape (3, count), optional
            Angle of the string, rad, with rate and acceleration; it replaces the schedule's rotation.
        span : int, optional
            Number of instants after which the vibration is computed anew from the time; its rounding depends on this
            number. None: all at once.
        """
        dt = 1.0 / rate
        t = (first + np.arange(count)) / rate
        line = self.timeline
        bit, angle = line.bit(t), line.angle(t) if turn is None else turn
        envelopes = np.stack([envelope(t) for envelope in line.envelopes])
        shake = np.zeros((CHANNELS, 3, count))
        for begin in range(0, count, span or count):
            part = slice(begin, begin + (span or count))
            start, added = float(t[begin]), np.ascontiguousarray(shake[:, :, part])
            if len(self.lines.channel):
                add_lines(self.lines, np.ascontiguousarray(envelopes[:, :, part]), start, dt, added)
            if len(self._per_turn.channel):
                add_per_turn(self._per_turn, np.ascontiguousarray(angle[:, part]), added)
            for sweep in self.vibrations.sweeps:
                add_sweep(_sweep_lines(sweep), start, dt, added)
            if len(self.hits.time):
                add_hits(self.hits, start, dt, added)
            shake[:, :, part] = added
        out = Kinematics(
            mat_nt=np.empty((count, 3, 3)),
            rate_t=np.empty((count, 3)),
            rate_dot_t=np.empty((count, 3)),
            position_n=np.empty((count, 3)),
            velocity_n=np.empty((count, 3)),
            acceleration_n=np.empty((count, 3)),
            md=bit[0] - self.sensor_to_bit,
        )
        assemble(self.path, bit[1], bit[2], angle, shake, out)
        return out

    def place(self, at_s: float) -> tuple[Array, Array]:
        """
        Return position, m, north, east, down, and direction of the tool axis, each of shape (3,).

        at_s: time, rounded to milliseconds.
        """
        there = self.at(round(1000.0 * at_s), 1, 1000.0)  # `at` counts instants, here in milliseconds
        return there.position_n[0], there.mat_nt[0, :, 0]

    @functools.cached_property
    def _per_turn(self) -> PerTurnLines:
        channel, per_turn, phase, amplitude = [], [], [], []
        for item in self.vibrations.per_turn:
            # The wobble is given as a share of the speed; its angle is that share divided by the cycles per turn.
            amplitudes = [(axis, item.displacement_mm[axis] * 1e-3) for axis in range(3)]
            amplitudes.append((5, item.speed_fraction / item.per_turn))
            for axis, value in amplitudes:
                if value:
                    channel.append(axis)
                    per_turn.append(item.per_turn)
                    phase.append(math.radians(item.phase_deg))
                    amplitude.append(value)
        return PerTurnLines(
            np.array(channel, np.int64), np.array(per_turn, np.int64), np.array(phase), np.array(amplitude)
        )


def _sweep_lines(sweep: Sweep) -> SweepLines:
    torsion, tilt_y, tilt_z = (math.radians(value) for value in sweep.rate_deg_s)
    rocking = math.radians(sweep.rate_phase_deg)
    return SweepLines(
        low_hz=sweep.low_hz,
        high_hz=sweep.high_hz,
        period_s=sweep.period_s,
        amplitude=np.array([*sweep.acceleration_mps2, tilt_y, tilt_z, torsion]),
        power=np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]),
        phase=np.array([0.0, 0.0, 0.0, rocking, rocking, rocking]),
    )

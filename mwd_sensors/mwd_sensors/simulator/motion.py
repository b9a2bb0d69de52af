"""
Motion of the sonde, exact at every instant: along the hole, round its axis, and shaking.

The attitude is a product of rotations whose angles have exact first and second derivatives, so that rates and
accelerations are formulas, never differences: hole axes ``h`` (x down-hole, z high side) from inclination and azimuth
along arcs of a circle, a small tilt, and the toolface. The position is the arc plus a bounded displacement.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.simulator.schedule import Timeline
from mwd_sensors.simulator.vibration import (
    CHANNELS,
    Hits,
    Lines,
    Sweep,
    Vibrations,
    add_hits,
    add_lines,
    add_per_turn,
    add_sweep,
)


@dataclasses.dataclass(frozen=True)
class WellPath:
    """
    A hole of circular arcs between stations (minimum curvature), straight beyond both ends.

    Attributes
    ----------
    md : ndarray, shape (m,)
        Start of each arc, m.
    position : ndarray, shape (m, 3)
        North, east, down there, m.
    tangent, normal : ndarray, shape (m, 3)
        Direction of the hole there, and the one towards which it bends, NED.
    curvature : ndarray, shape (m,)
        rad/m.
    azimuth : ndarray, shape (m,)
        Of the arc where it is vertical, rad.
    """

    md: Array
    position: Array
    tangent: Array
    normal: Array
    curvature: Array
    azimuth: Array


def well_path(md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike) -> WellPath:
    """
    Arcs through stations.

    md, inclination, azimuth, shape (m,): m ascending, rad, rad (true north). The first station is at the position 0
    moved straight down by its depth.

    Raises
    ------
    ValueError
        No stations, depths that do not ascend, or a turn of 180 deg between two stations.
    """
    depth, inc, azi = (np.atleast_1d(np.asarray(a, dtype=float)) for a in (md, inclination, azimuth))
    if len(depth) == 0 or np.any(np.diff(depth) <= 0.0):
        raise ValueError("path: at least one station is needed, and measured depths must ascend")
    tangents = np.stack([np.sin(inc) * np.cos(azi), np.sin(inc) * np.sin(azi), np.cos(inc)], axis=-1)
    position = np.array([0.0, 0.0, depth[0]])
    rows = []
    for k in range(len(depth)):
        normal, curvature, lean = np.zeros(3), 0.0, azi[k]
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
                lean = azi[k + 1]
        rows.append((depth[k], position, tangents[k], normal, curvature, lean))
        if k + 1 < len(depth):
            position = position + _along(tangents[k], normal, curvature, length)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return WellPath(*columns)


def _along(tangent: Array, normal: Array, curvature: float, length: float) -> Array:
    turn = curvature * length
    # sinc keeps the straight hole exact.
    forward = length * np.sinc(turn / np.pi)
    aside = 0.5 * curvature * length**2 * np.sinc(0.5 * turn / np.pi) ** 2
    return np.asarray(forward * tangent + aside * normal)


@dataclasses.dataclass(frozen=True)
class Kinematics:
    """
    Exact motion of the tool's reference point on its axis at n instants.

    Attributes
    ----------
    mat_nt : ndarray, shape (n, 3, 3)
    rate_t, rate_dot_t : ndarray, shape (n, 3)
        Against the local level frame, in tool axes, rad/s and rad/s^2.
    position_n, velocity_n, acceleration_n : ndarray, shape (n, 3)
        North, east, down from the wellhead, m, m/s, m/s^2.
    md : ndarray, shape (n,)
        Measured depth of the sonde, m.
    """

    mat_nt: Array
    rate_t: Array
    rate_dot_t: Array
    position_n: Array
    velocity_n: Array
    acceleration_n: Array
    md: Array


@dataclasses.dataclass(frozen=True)
class Motion:
    """Everything that moves the sonde, drawn and laid out; `at` evaluates it."""

    path: WellPath
    timeline: Timeline
    sensor_to_bit: float
    vibrations: Vibrations
    lines: Lines
    hits: Hits

    def at(self, first: int, count: int, rate: float, turn: Array | None = None) -> Kinematics:
        """
        Kinematics at the instants (first + k) / rate, s, k = 0 .. count - 1; first may be negative.

        turn, shape (3, count): angle of the string, rad, its rate and acceleration, instead of the schedule's.
        """
        dt, start = 1.0 / rate, first / rate
        t = (first + np.arange(count)) / rate
        line = self.timeline
        bit, angle = line.bit(t), line.angle(t) if turn is None else turn
        envelopes = np.stack([envelope(t) for envelope in line.envelopes])
        shake = np.zeros((CHANNELS, 3, count))
        if len(self.lines.channel):
            item = self.lines
            add_lines(
                item.envelope, item.channel, item.frequency_hz, item.phase, item.amplitude, envelopes, start, dt, shake
            )
        locked = self._locked()
        if len(locked[0]):
            add_per_turn(*locked, angle, shake)
        for sweep in self.vibrations.sweeps:
            add_sweep(sweep.low_hz, sweep.high_hz, sweep.period_s, *_sweep_arrays(sweep), start, dt, shake)
        if len(self.hits.time):
            hits = self.hits
            add_hits(hits.time, hits.width, hits.peak, hits.lobe, hits.direction, start, dt, shake)
        out = Kinematics(
            mat_nt=np.empty((count, 3, 3)),
            rate_t=np.empty((count, 3)),
            rate_dot_t=np.empty((count, 3)),
            position_n=np.empty((count, 3)),
            velocity_n=np.empty((count, 3)),
            acceleration_n=np.empty((count, 3)),
            md=bit[0] - self.sensor_to_bit,
        )
        path = self.path
        assemble(
            path.md,
            path.position,
            path.tangent,
            path.normal,
            path.curvature,
            path.azimuth,
            out.md,
            bit[1],
            bit[2],
            angle,
            shake,
            out.mat_nt,
            out.rate_t,
            out.rate_dot_t,
            out.position_n,
            out.velocity_n,
            out.acceleration_n,
        )
        return out

    def _locked(self) -> tuple[Indices, Indices, Array, Array]:
        channel, per_turn, phase, amplitude = [], [], [], []
        for item in self.vibrations.per_turn:
            # The wobble is given as a fraction of the speed: its angle is that over the cycles in one turn.
            amplitudes = [(axis, item.displacement_mm[axis] * 1e-3) for axis in range(3)]
            amplitudes.append((5, item.speed_fraction / item.per_turn))
            for axis, value in amplitudes:
                if value:
                    channel.append(axis)
                    per_turn.append(item.per_turn)
                    phase.append(math.radians(item.phase_deg))
                    amplitude.append(value)
        return np.array(channel, np.int64), np.array(per_turn, np.int64), np.array(phase), np.array(amplitude)


def _sweep_arrays(sweep: Sweep) -> tuple[Array, Array, Array]:
    torsion, tilt_y, tilt_z = (math.radians(value) for value in sweep.rate_deg_s)
    amplitude = np.array([*sweep.acceleration_mps2, tilt_y, tilt_z, torsion])
    rocking = math.radians(sweep.rate_phase_deg)
    return amplitude, np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.0, rocking, rocking, rocking])


@compiled
def assemble(
    path_md: Array,
    path_position: Array,
    path_tangent: Array,
    path_normal: Array,
    path_curvature: Array,
    path_azimuth: Array,
    md: Array,
    feed: Array,
    feed_dot: Array,
    turn: Array,
    shake: Array,
    mat_nt: Array,
    rate_t: Array,
    rate_dot_t: Array,
    position_n: Array,
    velocity_n: Array,
    acceleration_n: Array,
) -> None:
    """
    Put hole, feed, rotation and vibration together; the last six arguments are filled (see `Kinematics`).

    md, feed, feed_dot, shape (n,): depth of the sonde, m, its rate and acceleration. turn, shape (3, n): angle, rad,
    rate, acceleration. shake, shape (6, 3, n): the channels of `vibration`.
    """
    arc = 0
    for i in range(len(md)):
        while arc + 1 < len(path_md) and md[i] >= path_md[arc + 1]:
            arc += 1
        while arc > 0 and md[i] < path_md[arc]:
            arc -= 1
        # The arc of the hole: tangent, normal and position.
        x = md[i] - path_md[arc]
        kappa = path_curvature[arc] if x >= 0.0 else 0.0
        bend = kappa * x
        sin_b, cos_b = math.sin(bend), math.cos(bend)
        if kappa > 0.0:
            forward, aside = sin_b / kappa, 2.0 * math.sin(0.5 * bend) ** 2 / kappa
        else:
            forward, aside = x, 0.0
        t0 = cos_b * path_tangent[arc, 0] + sin_b * path_normal[arc, 0]
        t1 = cos_b * path_tangent[arc, 1] + sin_b * path_normal[arc, 1]
        t2 = cos_b * path_tangent[arc, 2] + sin_b * path_normal[arc, 2]
        n0 = cos_b * path_normal[arc, 0] - sin_b * path_tangent[arc, 0]
        n1 = cos_b * path_normal[arc, 1] - sin_b * path_tangent[arc, 1]
        n2 = cos_b * path_normal[arc, 2] - sin_b * path_tangent[arc, 2]
        s_i = math.hypot(t0, t1)
        c_i = t2
        # Inclination and azimuth as functions of depth: a great circle on the sphere of directions.
        if s_i > 1e-9:
            azimuth = math.atan2(t1, t0)
            inc_s = -kappa * n2 / s_i
            pole = t0 * n1 - t1 * n0
            azi_s = kappa * pole / (s_i * s_i)
        else:
            azimuth = path_azimuth[arc]
            inc_s = kappa if c_i > 0.0 else -kappa
            azi_s = 0.0
        s_a, c_a = math.sin(azimuth), math.cos(azimuth)
        inc_ss = s_i * c_i * azi_s * azi_s
        azi_ss = -2.0 * azi_s * inc_s * c_i / s_i if s_i > 1e-9 else 0.0
        v, v_dot = feed[i], feed_dot[i]
        inc_1, azi_1 = inc_s * v, azi_s * v
        inc_2 = inc_ss * v * v + inc_s * v_dot
        azi_2 = azi_ss * v * v + azi_s * v_dot
        # Rotation of the hole axes, in hole axes (x down-hole, y left, z high side).
        w0, w1, w2 = azi_1 * c_i, -inc_1, -azi_1 * s_i
        a0 = azi_2 * c_i - azi_1 * inc_1 * s_i
        a1 = -inc_2
        a2 = -azi_2 * s_i - azi_1 * inc_1 * c_i
        # Displacement in hole axes and its derivatives seen from the level frame.
        d0, d1, d2 = shake[0, 0, i], shake[1, 0, i], shake[2, 0, i]
        e0, e1, e2 = shake[0, 1, i], shake[1, 1, i], shake[2, 1, i]
        wd0, wd1, wd2 = w1 * d2 - w2 * d1, w2 * d0 - w0 * d2, w0 * d1 - w1 * d0
        vel0, vel1, vel2 = v + e0 + wd0, e1 + wd1, e2 + wd2
        acc0 = shake[0, 2, i] + 2.0 * (w1 * e2 - w2 * e1) + (a1 * d2 - a2 * d1) + (w1 * wd2 - w2 * wd1)
        acc1 = shake[1, 2, i] + 2.0 * (w2 * e0 - w0 * e2) + (a2 * d0 - a0 * d2) + (w2 * wd0 - w0 * wd2)
        acc2 = shake[2, 2, i] + 2.0 * (w0 * e1 - w1 * e0) + (a0 * d1 - a1 * d0) + (w0 * wd1 - w1 * wd0)
        acc0 += v_dot
        acc1 -= azi_s * s_i * v * v
        acc2 += inc_s * v * v
        # Columns: axis, left, high side.
        h00, h10, h20 = s_i * c_a, s_i * s_a, c_i
        h01, h11, h21 = s_a, -c_a, 0.0
        h02, h12, h22 = c_i * c_a, c_i * s_a, -s_i
        for k in range(3):
            position_n[i, k] = path_position[arc, k] + forward * path_tangent[arc, k] + aside * path_normal[arc, k]
        position_n[i, 0] += h00 * d0 + h01 * d1 + h02 * d2
        position_n[i, 1] += h10 * d0 + h11 * d1 + h12 * d2
        position_n[i, 2] += h20 * d0 + h21 * d1 + h22 * d2
        velocity_n[i, 0] = h00 * vel0 + h01 * vel1 + h02 * vel2
        velocity_n[i, 1] = h10 * vel0 + h11 * vel1 + h12 * vel2
        velocity_n[i, 2] = h20 * vel0 + h21 * vel1 + h22 * vel2
        acceleration_n[i, 0] = h00 * acc0 + h01 * acc1 + h02 * acc2
        acceleration_n[i, 1] = h10 * acc0 + h11 * acc1 + h12 * acc2
        acceleration_n[i, 2] = h20 * acc0 + h21 * acc1 + h22 * acc2
        # Tilt: about y by p, then about the new z by q. P maps tilted axes to hole axes.
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
        rate_t[i, 0], rate_t[i, 1], rate_t[i, 2] = z0 + spin, z1, z2
        rate_dot_t[i, 0] = b0 + spin_dot
        rate_dot_t[i, 1] = c_t * b1 + s_t * b2 + spin * z2
        rate_dot_t[i, 2] = c_t * b2 - s_t * b1 - spin * z1
        # mat_nt = H P X, X about x by the toolface.
        for k in range(3):
            if k == 0:
                g0, g1, g2 = h00, h01, h02
            elif k == 1:
                g0, g1, g2 = h10, h11, h12
            else:
                g0, g1, g2 = h20, h21, h22
            m0 = g0 * p00 + g1 * p10 + g2 * p20
            m1 = g0 * p01 + g1 * p11 + g2 * p21
            m2 = g0 * p02 + g1 * p12 + g2 * p22
            mat_nt[i, k, 0] = m0
            mat_nt[i, k, 1] = c_t * m1 + s_t * m2
            mat_nt[i, k, 2] = c_t * m2 - s_t * m1


@compiled
def sensed(
    mat_nt: Array,
    rate_t: Array,
    rate_dot_t: Array,
    velocity_n: Array,
    acceleration_n: Array,
    down: Array,
    lever_t: Array,
    earth_rate_n: Array,
    gravity: float,
    gradient: float,
    rate_it: Array,
    f_t: Array,
) -> None:
    """
    What ideal sensors at a lever arm feel: fills rate_it (against inertial space, rad/s) and f_t (specific force).

    down, shape (n,): depth of the tool below the ground, m; gravity there is ``gravity + gradient * down``.
    lever_t, earth_rate_n, shape (3,): m, rad/s. The other arrays as in `Kinematics`.
    """
    e0, e1, e2 = earth_rate_n[0], earth_rate_n[1], earth_rate_n[2]
    x, y, z = lever_t[0], lever_t[1], lever_t[2]
    for i in range(len(down)):
        v0, v1, v2 = velocity_n[i, 0], velocity_n[i, 1], velocity_n[i, 2]
        f0 = acceleration_n[i, 0] + 2.0 * (e1 * v2 - e2 * v1)
        f1 = acceleration_n[i, 1] + 2.0 * (e2 * v0 - e0 * v2)
        f2 = acceleration_n[i, 2] + 2.0 * (e0 * v1 - e1 * v0) - (gravity + gradient * down[i])
        w0, w1, w2 = rate_t[i, 0], rate_t[i, 1], rate_t[i, 2]
        a0, a1, a2 = rate_dot_t[i, 0], rate_dot_t[i, 1], rate_dot_t[i, 2]
        c0, c1, c2 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
        f_t[i, 0] = a1 * z - a2 * y + w1 * c2 - w2 * c1
        f_t[i, 1] = a2 * x - a0 * z + w2 * c0 - w0 * c2
        f_t[i, 2] = a0 * y - a1 * x + w0 * c1 - w1 * c0
        for k in range(3):
            m0, m1, m2 = mat_nt[i, 0, k], mat_nt[i, 1, k], mat_nt[i, 2, k]
            f_t[i, k] += m0 * f0 + m1 * f1 + m2 * f2
            rate_it[i, k] = rate_t[i, k] + m0 * e0 + m1 * e1 + m2 * e2

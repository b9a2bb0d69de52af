# SPDX-License-Identifier: Apache-2.0
"""
Motion of the sonde, exact at every instant: along the hole, about its axis, and vibration.

The position is the point on the hole's arc plus the bounded displacement of the vibration. `kinematics` combines
position and rotation.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.simulator.kinematics import Kinematics, WellPath, assemble
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

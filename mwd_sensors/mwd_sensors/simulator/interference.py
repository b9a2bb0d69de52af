# SPDX-License-Identifier: Apache-2.0
"""
Magnetic disturbances: field of the string, soft iron, casings, offset wells, tool joints, daily variation.

Disturbances that rotate with the tool are given in tool axes; disturbances fixed in the ground in north, east, down.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting

# Smallest distance from a sensor to a pole, m; a smaller distance is replaced by this.
_CLOSEST = 0.3


@dataclasses.dataclass(frozen=True)
class Pole:
    """A magnetic pole in the ground: the end of a casing, a joint of an offset well."""

    position_m: tuple[float, float, float] = setting(
        doc="Position of the pole from the wellhead: north, east, down.", low=-1e5, high=1e5
    )
    strength_uwb: float = setting(doc="Strength of the pole, positive where field lines leave it.", low=-1e5, high=1e5)


@dataclasses.dataclass(frozen=True)
class CasedWell:
    """A cased well nearby, with magnetic poles of random sign and strength at the joints of its casing."""

    start_m: tuple[float, float, float] = setting(
        doc="One end of the cased well from the wellhead: north, east, down.", low=-1e5, high=1e5
    )
    end_m: tuple[float, float, float] = setting(
        doc="Other end of the cased well from the wellhead: north, east, down.", low=-1e5, high=1e5
    )
    joint_m: float = setting(12.0, "Length of a casing joint.", low=1.0, high=100.0)
    strength_uwb: float = setting(100.0, "Magnetic pole strength of a joint, 1 sigma.", low=0.0, high=1e5)


@dataclasses.dataclass(frozen=True)
class Anomaly:
    """
    Disturbance of the field at one depth.

    Between two depths the field is interpolated linearly; above the first and below the last depth it is constant.
    """

    md_m: float = setting(doc="Measured depth of the sonde.", low=-100.0, high=20000.0)
    field_nt: tuple[float, float, float] = setting(
        doc="Disturbing field at this depth: north, east, down.", low=-1e6, high=1e6
    )


@dataclasses.dataclass(frozen=True)
class ToolJoints:
    """Magnetised joints of the string, which the sonde passes one by one, as a wireline probe inside the pipe does."""

    spacing_m: float = setting(9.0, "Distance between two joints.", low=0.5, high=50.0)
    axial_nt: float = setting(1500.0, "Field along the axis at a joint.", low=-1e6, high=1e6)
    width_m: float = setting(0.4, "Distance from a joint at which its field is half as strong.", low=0.01, high=10.0)


@dataclasses.dataclass(frozen=True)
class Diurnal:
    """Daily variation of the Earth's field: a sine with a period of 24 h."""

    amplitude_nt: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), "Amplitude of the variation to the north, east and down.", low=0.0, high=5000.0
    )
    peak_hour: float = setting(
        12.0,
        "Hour of the day, UTC, at which the variation of the field is largest.",
        unit="h",
        low=0.0,
        high=24.0,
    )


@dataclasses.dataclass(frozen=True)
class Interference:
    """All magnetic disturbances of one simulation."""

    axial_nt: float = setting(0.0, "Field of the drill string along the tool axis.", low=-1e6, high=1e6)
    axial_relative: float = setting(
        0.0,
        "Further field along the tool axis, as a multiple of the local field. The study S0 uses 0.5, 1 and 2.",
        low=-10.0,
        high=10.0,
    )
    cross_nt: tuple[float, float] = setting(
        (0.0, 0.0), "Field of the drill string across the tool, along y and z.", low=-1e6, high=1e6
    )
    soft_iron: tuple[tuple[float, float, float], ...] = setting(
        (),
        "Soft-iron matrix, three rows: the induced field is the matrix times the field in tool axes. Empty: no "
        "soft iron.",
        low=-1.0,
        high=1.0,
    )
    anomalies: tuple[Anomaly, ...] = setting((), "Disturbances along the hole, to the north, east and down.")
    poles: tuple[Pole, ...] = setting((), "Magnetic poles in the ground.")
    offset_wells: tuple[CasedWell, ...] = setting((), "Cased wells nearby.")
    tool_joints: ToolJoints | None = setting(None, "Magnetised joints that the sonde passes.")
    diurnal: Diurnal | None = setting(None, "Daily variation of the Earth's field.")

    def __post_init__(self) -> None:
        """Raise ValueError if `soft_iron` does not have three rows, or the depths of `anomalies` do not ascend."""
        if self.soft_iron and len(self.soft_iron) != 3:
            raise ValueError(f"soft_iron: three rows are needed, got {len(self.soft_iron)}")
        depths = [item.md_m for item in self.anomalies]
        if depths != sorted(depths):
            raise ValueError(f"anomalies: depths must ascend, got {depths}")


@dataclasses.dataclass(frozen=True)
class Disturbance:
    """Magnetic disturbances of one simulation in SI; the random poles of the settings (`Interference`) are drawn."""

    hard: Array  #: shape (3,); field of the drill string in tool axes, T
    soft: Array  #: shape (3, 3); soft-iron matrix in tool axes
    #: `anomaly_md`, `anomaly_n`: shape (k,) and (k, 3); measured depth, m, and field in NED, T, of the anomalies.
    anomaly_md: Array
    anomaly_n: Array
    #: `pole_position`, `pole_strength`: shape (p, 3) and (p,); position in NED, m, and strength, Wb, of the poles in
    #: the ground.
    pole_position: Array
    pole_strength: Array
    joints: ToolJoints | None
    diurnal: Diurnal | None

    def at(self, mat_nt: Array, earth_n: Array, position_n: Array, md: Array) -> Array:
        """
        Return the disturbing field in tool axes, T, shape (n, 3).

        mat_nt, shape (n, 3, 3); earth_n, shape (n, 3): undisturbed field, NED, T; position_n, shape (n, 3), and md,
        shape (n,), in m.
        """
        ground = pole_field(position_n, self.pole_position, self.pole_strength)
        if len(self.anomaly_md):
            ground = ground + np.stack(
                [np.interp(md, self.anomaly_md, self.anomaly_n[:, axis]) for axis in range(3)], axis=-1
            )
        total_t = to_tool(mat_nt, ground)
        total_t = total_t + to_tool_matrix(self.soft, total_t + to_tool(mat_nt, earth_n)) + self.hard
        if self.joints is not None:
            total_t[:, 0] += joint_field(self.joints, md)
        return total_t

    def daily(self, seconds_of_day: Array) -> Array:
        """Return the daily variation, NED, T, shape (n, 3), at times of the day in UTC, s, shape (n,)."""
        if self.diurnal is None:
            return np.zeros((len(seconds_of_day), 3))
        phase = 2.0 * math.pi * (seconds_of_day / 86400.0 - self.diurnal.peak_hour / 24.0)
        return np.asarray(np.cos(phase)[:, None] * np.array(self.diurnal.amplitude_nt) * 1e-9)


def disturbance(interference: Interference, total: float, rng: np.random.Generator) -> Disturbance:
    """
    Convert an `Interference` to SI; draw the magnetic poles of the offset wells at random.

    total: strength of the Earth's field, T.
    """
    positions = [pole.position_m for pole in interference.poles]
    strengths = [pole.strength_uwb * 1e-6 for pole in interference.poles]
    for well in interference.offset_wells:
        start, end = np.array(well.start_m), np.array(well.end_m)
        length = float(np.linalg.norm(end - start))
        count = max(2, round(length / well.joint_m) + 1)
        # Joints have random magnetisation. Flux that leaves one end enters the other, so the poles of a well sum to
        # zero.
        joints = well.strength_uwb * 1e-6 * rng.standard_normal(count - 1)
        ends = np.zeros(count)
        ends[:-1] += joints
        ends[1:] -= joints
        positions.extend(map(tuple, start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)))
        strengths.extend(ends)
    hard = np.array([interference.axial_nt, *interference.cross_nt]) * 1e-9
    hard[0] += interference.axial_relative * total
    return Disturbance(
        hard=hard,
        soft=np.array(interference.soft_iron) if interference.soft_iron else np.zeros((3, 3)),
        anomaly_md=np.array([item.md_m for item in interference.anomalies]),
        anomaly_n=np.array([item.field_nt for item in interference.anomalies]).reshape(-1, 3) * 1e-9,
        pole_position=np.array(positions).reshape(-1, 3),
        pole_strength=np.array(strengths),
        joints=interference.tool_joints,
        diurnal=interference.diurnal,
    )


def pole_field(position_n: Array, poles_n: Array, strength: Array) -> Array:
    """
    Return the field of magnetic poles, T, shape (n, 3): the sum of strength r / (4 pi |r|^3).

    position_n, shape (n, 3), and poles_n, shape (p, 3), are in m, strength, shape (p,), in Wb. |r| is at least
    `_CLOSEST`.
    """
    field = np.zeros((len(position_n), 3))
    for pole, flux in zip(poles_n, strength, strict=True):
        away = position_n - pole
        distance = np.maximum(np.sqrt((away * away).sum(axis=-1)), _CLOSEST)
        field += flux / (4.0 * math.pi) * away / (distance**3)[:, None]
    return field


def joint_field(joints: ToolJoints, md: Array) -> Array:
    """Return the axial field of passing tool joints, T, shape (n,): a Gaussian at each multiple of the spacing."""
    offset = (md / joints.spacing_m + 0.5) % 1.0 - 0.5
    halves = (offset * joints.spacing_m / joints.width_m) ** 2
    return np.asarray(joints.axial_nt * 1e-9 * np.exp(-math.log(2.0) * halves))


def to_tool(mat_nt: Array, vector_n: Array) -> Array:
    """
    Turn vectors, (n, 3) or (3,), from NED to tool axes by mat_nt, (n, 3, 3); return shape (n, 3).

    Plain sums give the same bits on all machines.
    """
    v = vector_n.reshape(-1, 3)
    return np.asarray(mat_nt[:, 0, :] * v[:, 0:1] + mat_nt[:, 1, :] * v[:, 1:2] + mat_nt[:, 2, :] * v[:, 2:3])


def to_tool_matrix(matrix: Array, vectors: Array) -> Array:
    """
    Multiply one matrix, (3, 3), with each of the vectors, (n, 3); return shape (n, 3).

    Plain sums give the same bits on all machines.
    """
    return np.asarray(vectors[:, 0:1] * matrix[:, 0] + vectors[:, 1:2] * matrix[:, 1] + vectors[:, 2:3] * matrix[:, 2])

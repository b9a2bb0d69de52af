# SPDX-License-Identifier: Apache-2.0
"""What disturbs a station beside the errors of its tool code: each changes the tool, the field or what adds to it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from mwd_sensors.core.arrays import Array
from stations.tool_code import DEG, Tool
from stations.truth import Earth

NOTHING: Array = np.zeros(3)


@dataclasses.dataclass(frozen=True)
class Disturbed:
    """A tool, the Earth's field, and what adds to the field: in tool axes and north, east, down, T, shape (3,)."""

    tool: Tool
    earth: Earth
    of_string: Array = dataclasses.field(default_factory=NOTHING.copy)
    outside_n: Array = dataclasses.field(default_factory=NOTHING.copy)


Disturbance = Callable[[Tool, Earth, np.random.Generator], Disturbed]


def direction(rng: np.random.Generator) -> Array:
    """A unit vector anywhere on the sphere, shape (3,)."""
    drawn = rng.normal(size=3)
    return np.asarray(drawn / np.linalg.norm(drawn))


def between(low: float, high: float, rng: np.random.Generator) -> float:
    """A size drawn evenly over its logarithm."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def across(size: float, rng: np.random.Generator) -> Array:
    """Interference of that many T across the tool's axis, shape (3,)."""
    angle = rng.uniform(0.0, math.tau)
    return size * np.array([0.0, math.cos(angle), math.sin(angle)])


def along(size: float, rng: np.random.Generator) -> Array:
    """Interference of that many T along the axis, either way, shape (3,)."""
    return np.array([size * rng.choice([-1.0, 1.0]), 0.0, 0.0])


def nothing(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """The errors of the tool code alone."""
    return Disturbed(tool, earth)


def cross_axial(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A hot spot of the collar beside the sensor, .1 to 3 uT."""
    return Disturbed(tool, earth, across(between(0.1e-6, 3e-6, rng), rng))


def axial_and_cross(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """The string along the axis, .3 to 5 uT, and a hot spot across it."""
    both = along(between(0.3e-6, 5e-6, rng), rng) + across(between(0.1e-6, 3e-6, rng), rng)
    return Disturbed(tool, earth, both)


def steel(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A casing or a fish nearby, .2 to 10 uT in any direction."""
    return Disturbed(tool, earth, outside_n=between(0.2e-6, 10e-6, rng) * direction(rng))


def storm(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A magnetic storm of 200 to 1000 nT."""
    return Disturbed(tool, earth, outside_n=between(0.2e-6, 1e-6, rng) * direction(rng))


def reference_off(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A reference that is wrong by 400 nT, .5 deg of dip and 1 deg of declination."""
    total, dip, declination = rng.choice([-1.0, 1.0], 3) * [400e-9, 0.5 * DEG, 1.0 * DEG]
    return Disturbed(tool, earth.changed(total, dip, declination))


def strong_magnetometer(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A magnetometer that reads 2 % too much on all axes."""
    return Disturbed(dataclasses.replace(tool, field_scale=tool.field_scale + 0.02), earth)


def shielding(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """Magnetic mud or soft iron about the sensor that takes .5 to 3 % off the field across the axis."""
    share = rng.uniform(0.005, 0.03)
    return Disturbed(dataclasses.replace(tool, field_scale=tool.field_scale - share * np.array([0.0, 1.0, 1.0])), earth)


def one_axis_off(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A magnetometer of which one axis reads 2 % too much or too little."""
    error = rng.choice([-0.02, 0.02]) * np.eye(3)[rng.integers(3)]
    return Disturbed(dataclasses.replace(tool, field_scale=tool.field_scale + error), earth)


def crust(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """A field of the crust of .8 to 2.5 uT that the reference lacks."""
    return Disturbed(tool, earth, outside_n=between(0.8e-6, 2.5e-6, rng) * direction(rng))


def turned_accelerometers(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """Accelerometers turned by 2 deg in their mount, about any axis."""
    turn = Rotation.from_rotvec(2.0 * DEG * direction(rng)).as_matrix()
    return Disturbed(dataclasses.replace(tool, mount=turn), earth)


def hot_collar(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
    """650 nT along the axis and 200 to 500 nT across it."""
    return Disturbed(tool, earth, along(650e-9, rng) + across(rng.uniform(200e-9, 500e-9), rng))


def magnetised(low: float, high: float) -> Disturbance:
    """A string magnetised along its axis by that many T."""

    def of(tool: Tool, earth: Earth, rng: np.random.Generator) -> Disturbed:
        return Disturbed(tool, earth, along(between(low, high, rng), rng))

    return of

# SPDX-License-Identifier: Apache-2.0
"""The Earth's field and gravity at six places, and the attitude of a tool in its hole."""

from __future__ import annotations

import dataclasses
import datetime
import math

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.earth import reference_field
from mwd_sensors.core.frames import mat_nt
from stations import tool_code
from stations.tool_code import Tool

_DATE = datetime.date(2026, 6, 1)
# Latitude and longitude, deg: weak and strong field, both hemispheres, 4 to 24 uT of it horizontal.
PLACES = {
    "Santos": (-25.0, -43.0),
    "Kuwait": (29.0, 48.0),
    "Houston": (29.8, -95.4),
    "North Sea": (60.8, 3.5),
    "Prudhoe Bay": (70.3, -148.5),
    "Bass Strait": (-38.5, 148.0),
}


@dataclasses.dataclass(frozen=True)
class Earth:
    """True field as strength, T, dip and declination, rad; gravity, m/s^2; latitude, rad."""

    total: float
    dip: float
    declination: float
    gravity: float
    latitude: float

    @property
    def field_n(self) -> Array:
        """North, east and down of true north, T, shape (3,)."""
        level = self.total * math.cos(self.dip)
        return np.array(
            [level * math.cos(self.declination), level * math.sin(self.declination), self.total * math.sin(self.dip)]
        )

    def changed(self, total: float, dip: float, declination: float) -> Earth:
        """The field with total and dip changed by the given T and rad."""
        return dataclasses.replace(
            self, total=self.total + total, dip=self.dip + dip, declination=self.declination + declination
        )

    def drawn(self, sigmas: tuple[float, float, float, float], rng: np.random.Generator) -> Earth:
        """The field off by errors of these 1 sigma (`tool_code.OF_WELL`)."""
        total, dip, declination, field = rng.normal(0.0, sigmas)
        return self.changed(total, dip, declination + field / (self.total * math.cos(self.dip)))


def place(name: str) -> tuple[Earth, Reference]:
    """Field of the model at a place, and the reference a user has of it."""
    latitude, longitude = np.radians(PLACES[name])
    model = reference_field(float(latitude), float(longitude), 0.0, _DATE)
    earth = Earth(model.total, model.dip, model.declination, model.gravity, float(latitude))
    reference = Reference(model.total, model.dip, model.declination, None, model.gravity, name)
    return earth, reference


def drawn_place(rng: np.random.Generator) -> tuple[Earth, Reference]:
    """One of the places, its true field off the model's by the errors of a well."""
    earth, reference = place(str(rng.choice(list(PLACES))))
    return earth.drawn(tool_code.OF_WELL, rng), reference


def tool_attitude(inclination: float, azimuth: float, toolface: float, tool: Tool, rng: np.random.Generator) -> Array:
    """
    Tool-to-NED rotation, shape (3, 3), of a tool that lies in a hole of that attitude as the tool code has it.

    OWSG weights of XYM1, XYM2, XYM3E, XYM4E and SAGE, as displacements of the axis upward and to the right: exact
    near the vertical too.
    """
    sine, cosine = math.sin(inclination), math.cos(inclination)
    north, east = math.cos(azimuth), math.sin(azimuth)
    course = rng.normal(0.0, tool_code.COURSE, 2) * abs(cosine)
    up = tool.misalignment[0] * sine + course @ [north, east] + tool.sag * sine**0.25
    right = tool.misalignment[1] * sine + course @ [-east, north]
    axis = np.array([sine * north, sine * east, cosine])
    axis = axis + up * np.array([cosine * north, cosine * east, -sine]) + right * np.array([-east, north, 0.0])
    level = math.hypot(axis[0], axis[1])
    return mat_nt(math.atan2(level, axis[2]), math.atan2(axis[1], axis[0]), toolface)

# SPDX-License-Identifier: Apache-2.0
"""Description of a bottom-hole assembly: hole, mud, sensors, and the components from the bit up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.settings import SettingsError, from_mapping, setting

# 1 sigma of the sag that remains after correction by a model, horizontal hole, deg: SAGE of the OWSG codes with SAG.
SIGMA_CORRECTED_DEG = 0.08


@dataclass(frozen=True)
class Blade:
    """A stabiliser blade, modelled as a ring that may touch the wall of the hole."""

    at_m: float = setting(
        doc="Distance of the middle of the blade from the lower end of its component.", low=0.0, high=2000.0
    )
    od_mm: float = setting(doc="Diameter over the blades.", low=50.0, high=1000.0)


@dataclass(frozen=True)
class Component:
    """
    One component of the assembly, such as the bit, a motor or a collar.

    Raises ValueError if the inner diameter is not smaller than the outer one, or a blade is beyond the length.
    """

    name: str = setting(doc="Name of the component.")
    length_m: float = setting(doc="Length in the assembled (made-up) string.", low=0.05, high=2000.0)
    od_mm: float = setting(doc="Outer diameter of the body.", low=20.0, high=1000.0)
    id_mm: float = setting(doc="Inner diameter.", low=0.0, high=500.0)
    linear_mass_kg_m: float = setting(
        0.0, "Mass in air per metre; 0: computed from diameters and density.", unit="kg/m", low=0.0, high=5000.0
    )
    density_kg_m3: float = setting(7850.0, "Density of the material.", low=1000.0, high=20000.0)
    youngs_modulus_gpa: float = setting(
        206.0, "Young's modulus: 206 for steel, 195 for non-magnetic steel.", unit="GPa", low=10.0, high=500.0
    )
    magnetic: bool = setting(
        True, "Whether the component is made of magnetic steel; false for non-magnetic collars and housings."
    )
    pole_uwb: float = setting(0.0, "Strength of its magnetic poles, as measured; 0: unknown.", low=0.0, high=10000.0)
    blades: tuple[Blade, ...] = setting((), "Stabiliser blades of the component.")

    def __post_init__(self) -> None:
        if not self.id_mm < self.od_mm:
            raise ValueError(f"{self.name}: id_mm {self.id_mm:g} is not smaller than od_mm {self.od_mm:g}")
        outside = [blade.at_m for blade in self.blades if blade.at_m > self.length_m]
        if outside:
            raise ValueError(f"{self.name}: a blade at {outside[0]:g} m is beyond its length, {self.length_m:g} m")

    @property
    def mass(self) -> float:
        """Mass in air per metre, kg/m: the stated one, or computed from diameters and density if none is stated."""
        return self.linear_mass_kg_m or self.density_kg_m3 * self._area

    @property
    def stiffness(self) -> float:
        """Bending stiffness, N m^2."""
        od, inner = self.od_mm * 1e-3, self.id_mm * 1e-3
        return self.youngs_modulus_gpa * 1e9 * math.pi / 64.0 * (od**4 - inner**4)

    def buoyed_mass(self, mud_kg_m3: float) -> float:
        """Return the mass per metre minus the mass of the displaced mud, kg/m; the bore is full of mud."""
        return self.mass - mud_kg_m3 * self._area

    @property
    def _area(self) -> float:
        return math.pi / 4.0 * 1e-6 * (self.od_mm**2 - self.id_mm**2)


@dataclass(frozen=True)
class Assembly:
    """
    A bottom-hole assembly in its hole.

    Raises ValueError without components, if a component or blade is wider than the hole, or if the sensors are above
    the assembly.
    """

    hole_mm: float = setting(doc="Diameter of the hole.", low=50.0, high=1200.0)
    sensor_m: float = setting(doc="Distance of the survey sensors from the bit.", low=0.0, high=500.0)
    components: tuple[Component, ...] = setting(doc="Components in order, from the bit up.")
    name: str = setting("", "Name of the assembly.")
    mud_kg_m3: float = setting(1200.0, "Density of the mud.", low=0.0, high=3000.0)
    weight_on_bit_kn: float = setting(
        0.0, "Weight on bit while a survey is taken; 0: off bottom.", low=0.0, high=1000.0
    )
    build_deg_30m: float = setting(
        0.0, "Build rate of the hole around the assembly; negative if it drops.", unit="deg/30m", low=-60.0, high=60.0
    )
    sigma_sag_deg: float = setting(
        SIGMA_CORRECTED_DEG,
        "Sag error that remains after the correction, in a horizontal hole, 1 sigma (SAGE). Raise it if the "
        "diameters of blades or hole are uncertain.",
        low=0.0,
        high=5.0,
    )

    def __post_init__(self) -> None:
        if not self.components:
            raise ValueError("components: at least one is needed, from the bit up")
        if not self.sensor_m < self.length:
            raise ValueError(f"sensor_m: {self.sensor_m:g} m is beyond the assembly, {self.length:g} m long")
        for part in self.components:
            widest = max([part.od_mm, *(blade.od_mm for blade in part.blades)])
            if widest > self.hole_mm:
                raise ValueError(f"{part.name}: {widest:g} mm does not go into a hole of {self.hole_mm:g} mm")

    @property
    def length(self) -> float:
        """Length of all components, m."""
        return sum(part.length_m for part in self.components)


def read_assembly(path: Path) -> Assembly:
    """
    Read an assembly from a YAML file.

    Raises
    ------
    SettingsError
        If the file is not YAML, has an unknown key (the message suggests similar ones), lacks a key, or has a value
        that is not allowed.
    OSError
        If the file cannot be read.
    """
    table = read_yaml(path)
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path}: expected an assembly with hole_mm, sensor_m and components, got {table!r}")
    return from_mapping(Assembly, table, path.name)

# SPDX-License-Identifier: Apache-2.0
"""
What errs in a magnetic survey, 1 sigma: OWSG set A revision 5.1, MWD+SRGM (A001Mc, its field from A003Mc).

Terms of one name are added in squares: OH, OI, OS and U of DEC, DBH, MFI and MDI stay with the well, R changes at each
station.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array

DEG = math.radians(1.0)
# Biases, m/s^2 and T, and scales of each axis: ABXY, ABZ; ASXY, ASZ; MBXY, MBZ; MSXY, MSZ.
FORCE_BIAS, FORCE_SCALE, FIELD_BIAS, FIELD_SCALE = 0.004, 0.0005, 70e-9, 0.0016
# AMIL, T; XYM1 and XYM2, XYM3E and XYM4E, SAGE, rad.
AXIAL, MISALIGNMENT, COURSE, SAG = 220e-9, 0.1 * DEG, 0.3 * DEG, 0.2 * DEG
# Strength, T, dip, rad, declination, rad, and declination times horizontal field, rad T: of the well, of each station.
OF_WELL = (math.sqrt(73**2 + 13**2 + 88**2 + 61**2) * 1e-9, 0.2012 * DEG, 0.3594 * DEG, 5001e-9 * DEG)
OF_STATION = (60e-9, 0.08 * DEG, 0.1 * DEG, 3000e-9 * DEG)
# Noise of a mean over some seconds at rest, m/s^2 and T: sensors of this class, not in the code.
FORCE_NOISE, FIELD_NOISE = 0.001, 10e-9


@dataclasses.dataclass(frozen=True)
class Tool:
    """One tool in one assembly: what errs alike at all its stations."""

    #: `force_bias`, `force_scale`, `field_bias`, `field_scale`: shape (3,); m/s^2, plain, T, plain. Interference of the
    #: string is part of the field's bias.
    force_bias: Array
    force_scale: Array
    field_bias: Array
    field_scale: Array
    mount: Array  #: shape (3, 3); turn of the accelerometers in their mount
    misalignment: Array  #: shape (2,); misalignment of the tool in the hole, rad
    sag: float  #: sag in a horizontal hole, rad

    def read(self, f_t: Array, b_t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Readings of true specific force, m/s^2, and field, T, shape (3,)."""
        f_read = self.mount @ f_t * (1.0 + self.force_scale) + self.force_bias
        b_read = b_t * (1.0 + self.field_scale) + self.field_bias
        return f_read + rng.normal(0.0, FORCE_NOISE, 3), b_read + rng.normal(0.0, FIELD_NOISE, 3)


def drawn_tool(rng: np.random.Generator) -> Tool:
    """A tool with all errors of the code."""
    return Tool(
        force_bias=rng.normal(0.0, FORCE_BIAS, 3),
        force_scale=rng.normal(0.0, FORCE_SCALE, 3),
        field_bias=rng.normal(0.0, FIELD_BIAS, 3) + np.array([rng.normal(0.0, AXIAL), 0.0, 0.0]),
        field_scale=rng.normal(0.0, FIELD_SCALE, 3),
        mount=np.eye(3),
        misalignment=rng.normal(0.0, MISALIGNMENT, 2),
        sag=rng.normal(0.0, SAG),
    )

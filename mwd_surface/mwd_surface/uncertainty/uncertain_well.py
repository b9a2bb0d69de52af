# SPDX-License-Identifier: Apache-2.0
"""Well with the errors of its stations: covariance from the top, or from the depth where two wells separate."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.remark import Remark
from mwd_surface.uncertainty.error_terms import ErrorReference
from mwd_surface.uncertainty.position_covariance import StationErrors, position_covariance


@dataclasses.dataclass(frozen=True)
class UncertainWell:
    """
    Stations of a well, the tools that measured them, and the size of the hole.

    md, inclination, azimuth: shape (n,), m and rad.
    positions: shape (n, 3), north, east, down, m.
    north: north of azimuths and axes.
    radius: radius of the open hole, m.
    surveyed: measured depth of the last survey, m; the path below is projected or planned.
    remarks: assumptions made for the list of stations.
    """

    name: str
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array
    north: North
    errors: StationErrors
    reference: ErrorReference
    radius: float = 0.0
    surveyed: float = math.inf
    remarks: tuple[Remark, ...] = ()

    def covariance(self) -> Array:
        """
        Return the covariance of the positions, shape (n, 3, 3), m^2.

        Raises
        ------
        ValueError, CovarianceUnavailableError
            As in `position_covariance`.
        """
        return position_covariance(
            self.md,
            self.inclination,
            self.azimuth,
            self.north,
            self.errors,
            self.reference,
            float(self.positions[0, 2]),
        )

    def below(self, md: float) -> UncertainWell:
        """
        Return the well below a measured depth, m, with the position at that depth taken as exact.

        Raises
        ------
        ValueError
            The depth is not on the path above its last station.
        """
        if not self.md[0] <= md < self.md[-1]:
            raise ValueError(
                f"{self.name}: {md:g} m is not on its path, which goes from {self.md[0]:g} to {self.md[-1]:g} m"
            )
        inc, azi, position = mc.interpolate(self.md, self.inclination, self.azimuth, self.positions, md)
        # Omit stations within a metre below this point, because errors hardly grow over so short a distance.
        rest = self.md > md + 1.0
        sigmas = self.errors.sigmas
        tools = [None, *(tool for tool, keep in zip(self.errors.tools, rest, strict=True) if keep)]
        errors = StationErrors(tools, None if sigmas is None else np.vstack([[np.nan, np.nan], sigmas[rest]]))
        return dataclasses.replace(
            self,
            md=np.append(md, self.md[rest]),
            inclination=np.append(inc, self.inclination[rest]),
            azimuth=np.append(azi, self.azimuth[rest]),
            positions=np.vstack([position, self.positions[rest]]),
            errors=errors,
        )

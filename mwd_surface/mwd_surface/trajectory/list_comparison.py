# SPDX-License-Identifier: Apache-2.0
"""
Comparison of two surveys of one hole, station by station, usually a gyro survey and an MWD survey.

The second path is interpolated on its arcs at the measured depths of the stations of the first path, so no station is
moved.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.trajectory.well_path import Definitive


@dataclasses.dataclass(frozen=True)
class PathDifference:
    """First path minus second path, at those stations of the first path that lie within the depths of both."""

    md: Array  #: shape (n,); measured depth, m
    #: `inclination`, `azimuth`: shape (n, 2); angles of the first and the second path, rad
    inclination: Array
    azimuth: Array
    #: shape (n, 2); difference of inclination, and of azimuth wrapped to +-pi, rad; NaN where a path is vertical and
    #: has no azimuth
    turn: Array
    position: Array  #: shape (n, 3); difference north, east, down, m
    sigma: Array  #: shape (n, 3); 1 sigma of the difference, m; NaN if one of the paths has no covariance
    #: shape (n,); Mahalanobis distance of the two positions, in sigmas; its square has 3 degrees of freedom. NaN if
    #: unknown.
    sigmas: Array

    @property
    def distance(self) -> Array:
        """Distance between the two paths at the same measured depth, m, shape (n,)."""
        return np.asarray(np.linalg.norm(self.position, axis=1))


def difference(
    first: Definitive, second: Definitive, covariances: tuple[Array | None, Array | None] = (None, None)
) -> PathDifference:
    """
    Return the difference of two paths that refer to the same north.

    Parameters
    ----------
    covariances : tuple of two ndarray of shape (m, 3, 3) or None
        Covariances of the station positions, m^2. The errors of the two surveys are assumed to be independent.

    Raises
    ------
    ValueError
        The paths refer to different norths, or have no depth in common.
    """
    if first.north != second.north:
        raise ValueError(
            f"the first list is from {first.north.name.lower()} north, the second from {second.north.name.lower()}"
        )
    common = (first.md >= second.md[0]) & (first.md <= second.md[-1])
    if not common.any():
        raise ValueError(
            f"no depth in common: {first.md[0]:.1f} to {first.md[-1]:.1f} m and {second.md[0]:.1f} to"
            f" {second.md[-1]:.1f} m"
        )
    md = first.md[common]
    at = [second.at(float(depth)) for depth in md]
    inclination = np.column_stack([first.inclination[common], [a[0] for a in at]])
    azimuth = np.column_stack([first.azimuth[common], [a[1] for a in at]])
    position = first.positions[common] - np.array([a[2] for a in at])
    vertical = np.any(np.sin(inclination) < mc.VERTICAL, axis=1)
    turned = np.where(vertical, np.nan, wrap_pi(azimuth[:, 0] - azimuth[:, 1]))
    turn = np.column_stack([inclination[:, 0] - inclination[:, 1], turned])
    covariance = np.full((md.size, 3, 3), np.nan)
    if covariances[0] is not None and covariances[1] is not None:
        covariance = covariances[0][common] + covariance_between(second.md, covariances[1], md)
    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    return PathDifference(md, inclination, azimuth, turn, position, sigma, _sigmas(position, covariance))


def covariance_between(md: Array, covariance: Array, at: Array) -> Array:
    """
    Return covariances at the depths `at`, m, linearly interpolated between stations, shape (m, 3, 3), m^2.

    md: depths of the stations, m, shape (n,). covariance: at the stations, shape (n, 3, 3), m^2. Beyond the ends the
    covariance of the end is used. Interpolated covariance matrices are positive semidefinite again.
    """
    flat = covariance.reshape(len(md), 9)
    return np.column_stack([np.interp(at, md, flat[:, k]) for k in range(9)]).reshape(-1, 3, 3)


def _sigmas(position: Array, covariance: Array) -> Array:
    out = np.full(len(position), np.nan)
    for k, (step, cov) in enumerate(zip(position, covariance, strict=True)):
        # At the tie-on neither path has an uncertainty.
        if np.all(np.isfinite(cov)) and np.linalg.eigvalsh(cov)[0] > 0.0:
            out[k] = float(np.sqrt(step @ np.linalg.solve(cov, step)))
    return out

# SPDX-License-Identifier: Apache-2.0
"""Sigma of inclination and azimuth by a tool code's own weighting functions, as welleng computes them."""

import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Errors of depth and of the hole's course between stations are not the station's.
_NOT_THE_STATION = ("DRF", "DSF", "DST", "XCL")


class AttitudeSigma(NamedTuple):
    """1 sigma, rad; azimuth at most pi."""

    inclination: float
    azimuth: float


def at_attitude(
    code: str, inclination: float, azimuth: float, reference: Reference, latitude: float = math.radians(60.0)
) -> AttitudeSigma:
    """
    Sigma of a code at an attitude: a straight hole of four stations 30 m apart.

    code: short name. inclination, azimuth, latitude: rad, azimuth from true north. reference: with a field; its own
    sigmas are not used, the code has its.
    """
    # Each worker of the tests imports this file; the import of welleng takes half a second.
    from welleng.survey import Survey, SurveyHeader

    header = SurveyHeader(
        latitude=math.degrees(latitude),
        longitude=0.0,
        altitude=0.0,
        b_total=reference.total * 1e9,
        dip=math.degrees(reference.dip),
        declination=math.degrees(reference.declination or 0.0),
        convergence=0.0,
        G=STANDARD_GRAVITY if reference.gravity is None else reference.gravity,
        azi_reference="true",
    )
    attitude = (np.full(4, math.degrees(angle)) for angle in (inclination, azimuth))
    terms = Survey(30.0 * np.arange(4.0), *attitude, header=header, error_model=code).err.errors.errors
    covariance = np.zeros((2, 2))
    for name, term in terms.items():
        if not name.startswith(_NOT_THE_STATION):
            weight = np.asarray(term.e_DIA, dtype=float)[2, 1:]
            covariance += np.outer(weight, weight)
    sigma = np.sqrt(np.diagonal(covariance))
    return AttitudeSigma(float(sigma[0]), min(float(sigma[1]), math.pi))

"""
How well the position of each station is known: the ISCWSA error model of a survey tool, and the ellipses it draws.

The model itself is that of `welleng` (ISCWSA error model definition, revision 5.13; OWSG set A tool codes), imported
when first asked for, because it is slow to import and nothing else needs it. Here is what surrounds it: references in
SI, axes that follow the well's own north, and words where it cannot be computed. Covariances are m^2 at 1 sigma.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import warnings

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import wrap_tau
from mwd_surface.surveys.survey_record import North


class CovarianceUnavailableError(RuntimeError):
    """The library of the error models is not installed; the message says how to get it."""


@dataclasses.dataclass(frozen=True)
class ErrorReference:
    """Local field the tool model works in: latitude, dip, declination, convergence in rad; T and m/s^2."""

    latitude: float
    b_total: float
    dip: float
    declination: float
    convergence: float = 0.0
    g_total: float = STANDARD_GRAVITY


@dataclasses.dataclass(frozen=True)
class Ellipse:
    """Semi-axes, m, largest first, and the angle of the larger one from the first axis towards the second, rad."""

    major: float
    minor: float
    angle: float

    def outline(self, points: int = 73) -> Array:
        """Points round the ellipse about zero, shape (points, 2), m, in the two axes it was cut from."""
        t = np.linspace(0.0, math.tau, points)
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = self.major * np.cos(t), self.minor * np.sin(t)
        return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def position_covariance(
    md: ArrayLike, inclination: ArrayLike, azimuth: ArrayLike, north: North, model: str, reference: ErrorReference
) -> Array:
    """
    Covariance of the stations' positions.

    Parameters
    ----------
    md, inclination, azimuth : array_like, shape (n,)
        Stations from the wellhead down (the first one is the surface root where its depth is 0), m and rad.
    north : North
        What azimuth, and the first two axes of the result, refer to.
    model : str
        Tool code, for example "MWD+SRGM", "MWD+IFR2+SAG+MS", "GYRO-NS" or "ISCWSA MWD Rev5.11".
    reference : ErrorReference
        Local field.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        North, east, down, m^2.

    Raises
    ------
    ValueError
        Stations as for `minimum_curvature.path`, an unknown tool code (with its near misses), an unknown north, or a
        reference that is not finite and positive where it must be.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    depth, inc, azi = mc.checked_stations(md, inclination, azimuth)
    fields = dataclasses.asdict(reference)
    wrong = [k for k, v in fields.items() if not math.isfinite(v)]
    if wrong or reference.b_total <= 0.0 or reference.g_total <= 0.0:
        raise ValueError(f"reference: totals must be positive and all values finite, got {fields}")
    to_true = {North.TRUE: 0.0, North.MAGNETIC: reference.declination, North.GRID: reference.convergence}
    if north not in to_true:
        raise ValueError("north: azimuths from an unknown north have no error model")
    check_tool_code(model)
    if depth.size == 1:
        return np.zeros((1, 3, 3))
    count = depth.size
    if count == 2:
        # welleng's singular terms look at a third station; one straight ahead does not change the two above it.
        depth = np.append(depth, 2.0 * depth[1] - depth[0])
        inc, azi = np.append(inc, inc[1]), np.append(azi, azi[1])
    turn = to_true[north]
    covariance = _in_true_axes(depth, inc, wrap_tau(azi + turn), model, reference)[:count]
    c, s = math.cos(turn), math.sin(turn)
    # Rows: the well's north and east in true axes.
    mat = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(mat @ covariance @ mat.T)


def check_tool_code(model: str) -> None:
    """
    Check that a tool code exists.

    Raises
    ------
    ValueError
        It does not; the message names near misses.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    try:
        from welleng.error import get_error_models
    except ImportError as error:
        raise CovarianceUnavailableError(
            "position covariance needs the Python package welleng, which is not installed: pip install welleng"
        ) from error
    known = list(get_error_models())
    if model not in known:
        near = difflib.get_close_matches(model, known, n=3, cutoff=0.4) or known[:3]
        raise ValueError(f"model: no tool code {model!r}; did you mean {' or '.join(near)}?")


def _in_true_axes(depth: Array, inc: Array, azi_true: Array, model: str, reference: ErrorReference) -> Array:
    """Return the covariances by welleng, shape (n, 3, 3), m^2, in true north, east, down."""
    from welleng.survey import Survey, SurveyHeader

    # Without convergence welleng has one set of axes, those of true north.
    header = SurveyHeader(
        latitude=math.degrees(reference.latitude),
        longitude=0.0,
        altitude=0.0,
        survey_date="2026-01-01",
        G=reference.g_total,
        b_total=reference.b_total * 1e9,
        dip=math.degrees(reference.dip),
        declination=math.degrees(reference.declination),
        convergence=0.0,
        azi_reference="true",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        survey = Survey(
            md=depth,
            inc=np.degrees(inc),
            azi=np.degrees(azi_true),
            header=header,
            error_model=model,
            deg=True,
        )
    return np.asarray(survey.cov_nev, dtype=float)


def ellipse(covariance: ArrayLike, sigmas: float = 2.0) -> Ellipse:
    """
    Ellipse of a 2 x 2 covariance, m^2, at so many sigmas.

    Raises
    ------
    ValueError
        The covariance is not 2 x 2 and finite, or sigmas is not positive.
    """
    cov = np.asarray(covariance, dtype=float)
    if cov.shape != (2, 2) or not np.all(np.isfinite(cov)) or not sigmas > 0.0:
        raise ValueError(
            f"covariance, sigmas: expected a finite 2 x 2 matrix and a positive number, got {cov}, {sigmas}"
        )
    values, vectors = np.linalg.eigh(0.5 * (cov + cov.T))
    small, large = np.sqrt(np.maximum(values, 0.0)) * sigmas
    angle = math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi
    return Ellipse(float(large), float(small), angle)


def in_section(covariance: ArrayLike, section_azimuth: float) -> Array:
    """
    Covariance along the vertical section and down.

    covariance, shape (..., 3, 3): north, east, down, m^2. section_azimuth: rad. Returns shape (..., 2, 2), m^2.
    """
    along = np.array([[math.cos(section_azimuth), math.sin(section_azimuth), 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(along @ np.asarray(covariance, dtype=float) @ along.T)

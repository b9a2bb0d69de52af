# SPDX-License-Identifier: Apache-2.0
"""
Position covariance of each station of a well, summed from the error terms of its survey tools, and error ellipses.

Errors of one run are the same at all its stations, errors of the well and of the Earth's field are the same in all
runs, and random errors are new at each station (ISCWSA error model definition 5.13; Williamson, SPE 67616, equations
A-12 to A-15). Covariances are in m^2 at 1 sigma.

A vertical hole has no azimuth, and near the vertical the azimuth in a survey list is noise. Many error sources act
along or across the azimuth of the hole, so the model needs an azimuth: `minimum_curvature.directions` gives the azimuth
of the adjacent hole, as far as it is known. Where the azimuth is unknown, such an error may point in any direction: it
gets the same variance in each direction, and is independent of the errors of the hole with known azimuth.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_tau
from mwd_surface.list_files.remark import Remark
from mwd_surface.uncertainty.error_terms import RANDOM, ErrorReference, ErrorTerm, ErrorTool, Mask, error_terms

# Inclination above which the azimuth of a station is used without the azimuth of the adjacent hole, rad. It is 1 sigma
# of the angle between the tool at a single station and the hole in the OWSG codes (XYM3E, XYM4E).
AZIMUTH_KNOWN_FROM = math.radians(0.3)


@dataclasses.dataclass(frozen=True)
class Ellipse:
    """
    Ellipse: its semi-axes, m, largest first, and the angle from the first coordinate axis to the larger semi-axis, rad.

    The angle of a circle is 0.
    """

    major: float
    minor: float
    angle: float

    def outline(self) -> Array:
        """Return points on the ellipse about the origin, shape (73, 2), m, in the coordinates of its plane."""
        t = np.linspace(0.0, math.tau, 73)
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = self.major * np.cos(t), self.minor * np.sin(t)
        return np.stack([c * x - s * y, s * x + c * y], axis=-1)


@dataclasses.dataclass(frozen=True)
class StationErrors:
    """Information on the errors of a well's stations."""

    #: tool that measured each station; None for a station without errors of its own, such as a tie-on
    tools: Sequence[ErrorTool | None]
    #: shape (n, 2); 1 sigma of inclination and azimuth of each station, rad, used instead of the angle errors of the
    #: tool code. The errors are assumed to be fully correlated within a run, which is the cautious choice. NaN: use the
    #: code.
    sigmas: Array | None = None
    tie_on: Array | None = None  #: shape (3, 3); covariance of the first station, in the axes of the result, m^2


def position_covariance(
    md: ArrayLike,
    inclination: ArrayLike,
    azimuth: ArrayLike,
    north: North,
    errors: StationErrors | str,
    reference: ErrorReference,
    first_tvd: float = 0.0,
) -> Array:
    """
    Return the covariance of the stations' positions.

    Parameters
    ----------
    md, inclination, azimuth : array_like, shape (n,)
        Stations from the wellhead down, m and rad; a first station at depth 0 is the wellhead.
    north : North
        North of the azimuths and of the first two axes of the result.
    errors : StationErrors or str
        Tools of the stations; or one tool code for all stations, for example "MWD+SRGM", "MWD+IFR2+SAG+MS", "GYRO-NS"
        or "ISCWSA MWD Rev5.11".
    reference : ErrorReference
        Local field.
    first_tvd : float
        Vertical depth of the first station, m.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Covariance of north, east, down, m^2.

    Raises
    ------
    ValueError
        Invalid stations as in `minimum_curvature.path`, input that `well_terms` refuses, or an invalid tie-on
        covariance.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    depth, inc, azi = mc.checked_stations(md, inclination, azimuth)
    given = StationErrors([ErrorTool(errors)] * depth.size) if isinstance(errors, str) else errors
    terms = well_terms((depth, inc, azi), north, given, reference, first_tvd)
    covariance = covariance_of(terms, depth.size)
    if given.tie_on is None:
        return covariance
    tie = np.asarray(given.tie_on, dtype=float)
    if tie.shape != (3, 3) or not np.allclose(tie, tie.T) or not np.all(np.linalg.eigvalsh(tie) >= -1e-9):
        raise ValueError(f"tie_on: a covariance must be symmetric, 3 x 3 and not negative, got {tie.tolist()}")
    return np.asarray(covariance + tie)


def well_terms(
    stations: tuple[Array, Array, Array],
    north: North,
    errors: StationErrors,
    reference: ErrorReference,
    first_tvd: float = 0.0,
) -> list[ErrorTerm]:
    """
    Return the error terms of all stations in the axes of the well's own north; see `position_covariance`.

    Raises
    ------
    ValueError
        `error_terms` refuses the input, the north is unknown, or the reference has a value that is not finite, such as
        the angle between this north and true north, or a total that is not positive.
    """
    depth, inc, azi = stations
    needed = {North.MAGNETIC: "declination", North.GRID: "convergence"}.get(north)
    if needed is not None and math.isnan(getattr(reference, needed)):
        raise ValueError(
            f"azimuths from {north.name.lower()} north need the {needed}: give the {needed} (option --{needed})"
        )
    fields = {k: v for k, v in dataclasses.asdict(reference).items() if k != "latitude"}
    if not all(map(math.isfinite, fields.values())) or reference.b_total <= 0.0 or reference.g_total <= 0.0:
        raise ValueError(f"reference: totals must be positive and all values finite, got {fields}")
    to_true = {North.TRUE: 0.0, North.MAGNETIC: reference.declination, North.GRID: reference.convergence}
    if north not in to_true:
        raise ValueError("north: azimuths from an unknown north have no error model")
    if depth.size == 1:
        return []
    turn = to_true[north]
    true = wrap_tau(azi + turn)
    own = np.full((depth.size, 2), np.nan) if errors.sigmas is None else np.asarray(errors.sigmas, dtype=float)
    bare = np.all(np.isfinite(own), axis=1)

    def terms_at(azimuths: Array) -> list[ErrorTerm]:
        stations = (depth, inc, azimuths)
        model = error_terms(stations, errors.tools, reference, first_tvd=first_tvd, without_angles=bare)
        return model + _own_terms(stations, errors.tools, own, bare)

    known = mc.directions(inc, true, AZIMUTH_KNOWN_FROM)
    steep = np.sin(inc) < math.sin(AZIMUTH_KNOWN_FROM)
    true = np.where(steep, wrap_tau(np.angle(known)), true)
    terms = terms_at(true)
    if np.any(np.abs(known[steep]) < 1.0 - 1e-9):
        turned = terms_at(np.where(steep, wrap_tau(true + math.pi), true))
        terms = [part for pair in zip(terms, turned, strict=True) for part in _split(*pair, known, steep)]
    c, s = math.cos(turn), math.sin(turn)
    # Rows: unit vectors of the well's north, east and down in true north, east, down.
    mat = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return [dataclasses.replace(t, error=t.error @ mat.T, own=t.own @ mat.T) for t in terms]


def _split(term: ErrorTerm, turned: ErrorTerm, known: npt.NDArray[np.complex128], steep: Mask) -> list[ErrorTerm]:
    """
    Split an error term into a part with known direction and two perpendicular parts for the unknown direction.

    Parameters
    ----------
    term, turned : ErrorTerm
        Error term at the azimuths of the stations, and with the azimuths of steep stations turned by half a turn. The
        part of the error that changes sign depends on the azimuth; the other part has a fixed direction on the map.
    known : ndarray of complex, shape (n,)
        Mean direction vectors from `minimum_curvature.directions`, in true axes.
    steep : ndarray of bool, shape (n,)
        Stations to split.

    Returns
    -------
    list of ErrorTerm
        Parts of the error; their total variance, summed over all directions, equals the variance of the error at every
        station.
    """
    share = np.minimum(np.abs(known), 1.0)
    rest = np.where(steep, np.sqrt(0.5 * (1.0 - share**2)), 0.0)
    c, s = np.cos(np.angle(known)), np.sin(np.angle(known))
    shifts, across = [], []
    for one, other in ((term.error, turned.error), (term.own, turned.own)):
        odd = 0.5 * (one - other)
        shifts.append(np.where(steep[:, None], one - (1.0 - share)[:, None] * odd, one))
        # Use axes along and across the azimuth instead of north and east, so that the result does not depend on north.
        along, right = c * odd[:, 0] + s * odd[:, 1], c * odd[:, 1] - s * odd[:, 0]
        zero = np.zeros(along.size)
        across.append([rest[:, None] * np.stack(v, axis=-1) for v in ((along, right, zero), (-right, along, zero))])
    parts = [dataclasses.replace(term, error=shifts[0], own=shifts[1])]
    for number, (error, own) in enumerate(zip(*across, strict=True), start=1):
        if np.any(error) or np.any(own):
            shared = RANDOM if term.shared == RANDOM else f"{term.shared}, unknown direction {number}"
            parts.append(dataclasses.replace(term, shared=shared, error=error, own=own, measured=0.0 * term.measured))
    return parts


def covariance_of(terms: Sequence[ErrorTerm], n: int) -> Array:
    """
    Return the covariance of n positions, shape (n, 3, 3), m^2.

    Random errors add the covariance of each station. The shifts due to a shared error are summed before squaring.
    """
    covariance = np.zeros((n, 3, 3))
    for term in terms:
        if term.shared == RANDOM:
            each = np.einsum("ki,kj->kij", term.error, term.error)
            covariance += np.einsum("ki,kj->kij", term.own, term.own)
            covariance[1:] += np.cumsum(each, axis=0)[:-1]
    for shift in shared_shifts(terms).values():
        covariance += np.einsum("ki,kj->kij", shift, shift)
    return covariance


def shared_shifts(terms: Sequence[ErrorTerm]) -> dict[tuple[str, str], Array]:
    """
    Return the shifts of all positions, m, shape (n, 3), that 1 sigma of each shared error causes.

    The key is `name` and `shared` of the terms of the error, see `ErrorTerm`.
    """
    shifts: dict[tuple[str, str], Array] = {}
    for term in terms:
        if term.shared != RANDOM:
            above = np.vstack([np.zeros(3), np.cumsum(term.error, axis=0)[:-1]])
            key = (term.name, term.shared)
            shifts[key] = shifts.get(key, 0.0) + term.own + above
    return shifts


def _own_terms(
    stations: tuple[Array, Array, Array], tools: Sequence[ErrorTool | None], sigmas: Array, bare: Mask
) -> list[ErrorTerm]:
    """
    Return the error terms from the stations' own sigmas, two terms per run: inclination and azimuth.

    The position shifts are computed by the balanced tangential method.
    """
    md, inc, azi = stations
    s_inc = np.sin(inc)
    # Near the vertical the sigma of azimuth is limited to pi, so the direction is made as uncertain across the azimuth
    # as along it.
    least = np.maximum(1.0 - (s_inc / math.sin(AZIMUTH_KNOWN_FROM)) ** 2, 0.0) * sigmas[:, 0]
    sideways = np.maximum(s_inc * sigmas[:, 1], least)
    half = 0.5 * np.diff(md)
    above, below = np.append(0.0, half), np.append(half, 0.0)
    weights = (
        np.stack([np.cos(inc) * np.cos(azi), np.cos(inc) * np.sin(azi), -np.sin(inc)], axis=-1),
        np.stack([-np.sin(azi), np.cos(azi), np.zeros(md.size)], axis=-1),
    )
    terms = []
    for run in dict.fromkeys(t.run for t, b in zip(tools, bare, strict=True) if t is not None and b):
        rows = bare & np.array([t is not None and t.run == run for t in tools])
        for k, (name, weight) in enumerate(zip(("inclination", "azimuth"), weights, strict=True)):
            sigma = np.where(rows, np.nan_to_num(sigmas[:, k]), 0.0)
            shift = weight * np.where(rows, np.nan_to_num((sigmas[:, 0], sideways)[k]), 0.0)[:, None]
            measured = np.zeros((md.size, 3))
            measured[:, k + 1] = sigma
            terms.append(
                ErrorTerm(
                    f"own sigma of {name}",
                    f"run {run}",
                    shift * (above + below)[:, None],
                    shift * above[:, None],
                    measured,
                )
            )
    return terms


def ellipse(covariance: ArrayLike, sigmas: float = 2.0) -> Ellipse:
    """
    Return the ellipse of a 2 x 2 covariance, m^2, at a number of sigmas.

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
    # The angle of a circle, for example of a vertical well, would be determined by rounding errors.
    angle = math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi if large - small > 1e-7 * large else 0.0
    return Ellipse(float(large), float(small), angle)


def in_section(covariance: ArrayLike, section_azimuth: float) -> Array:
    """
    Return the covariance along the vertical section and down.

    covariance, shape (..., 3, 3): north, east, down, m^2. section_azimuth: rad. Returns shape (..., 2, 2), m^2.
    """
    along = np.array([[math.cos(section_azimuth), math.sin(section_azimuth), 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(along @ np.asarray(covariance, dtype=float) @ along.T)


@dataclasses.dataclass(frozen=True)
class UncertainWell:
    """Stations of a well, the tools that measured them, and the size of the hole."""

    name: str
    #: `md`, `inclination`, `azimuth`: shape (n,), m and rad
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array  #: shape (n, 3), north, east, down, m
    north: North  #: north of azimuths and axes
    errors: StationErrors
    reference: ErrorReference
    radius: float = 0.0  #: radius of the open hole, m
    surveyed: float = math.inf  #: measured depth of the last survey, m; the path below is projected or planned
    remarks: tuple[Remark, ...] = ()  #: assumptions made for the list of stations

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
        Return the well below a measured depth, m, with the position at that depth assumed to be exact.

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

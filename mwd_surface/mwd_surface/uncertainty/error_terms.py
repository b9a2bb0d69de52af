# SPDX-License-Identifier: Apache-2.0
"""
Error terms of ISCWSA / OWSG tool codes along a well: the effect of each error source of each tool on the positions.

The codes with their weighting functions and magnitudes come from `welleng` (ISCWSA error model definition, revision
5.13; OWSG sets A and B). Each tool is evaluated on its own stations together with the station before and the station
after them, so that an interval between two tools has a contribution from each (Williamson, SPE 67616, equations A-4 and
A-14). The library is imported on first use, because the import is slow and no other module needs the library.

In a vertical hole the library replaces weighting functions that contain 1 / sin(inclination) by special weights. Some
of these are wrong: XYM3E and XYM4E are multiplied by the squared cosine of the azimuth, and the last station and the
first interval lack contributions. Here every vertical station is therefore evaluated by the ordinary weighting
functions at a small inclination, where the position errors approach a limit (ISCWSA error model definition 5.13,
section 11.5, states the same limits).
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mwd_estimation.survey import tool_code
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY

Mask = npt.NDArray[np.bool_]
RANDOM = "random"
# Propagation modes of the library for errors that are shared within a well or by the wells of a pad. Within one well
# these errors are fully correlated.
_WHOLE_WELL = ("well", "global", "within_pad")
# Inclination below which no tool gives an azimuth, rad.
_VERTICAL = math.radians(1.0)
# Inclination at which a vertical station is evaluated, rad; the relative error of its shifts has the same size.
_NEXT_TO_VERTICAL = 1e-7
# Name prefixes of error sources that affect depth, or the course between stations, instead of the measured angles.
_NOT_OF_ANGLES = ("DRF", "DSF", "DST", "XCL")


class CovarianceUnavailableError(ImportError):
    """Raised if the library of error models is not installed; the message says how to install it."""


@dataclasses.dataclass(frozen=True)
class ErrorReference:
    """Local magnetic field and gravity for the tool models, in rad, T and m/s^2."""

    latitude: float  #: NaN if the location of the well is not given; only gyro codes need the latitude
    b_total: float
    dip: float
    declination: float
    convergence: float = 0.0
    g_total: float = STANDARD_GRAVITY


@dataclasses.dataclass(frozen=True)
class ErrorTool:
    """Tool that measured a station: tool code, and the run within which its systematic errors stay the same."""

    code: str
    run: str = ""


@dataclasses.dataclass(frozen=True)
class ErrorTerm:
    """One error source of one tool at 1 sigma."""

    name: str  #: name of the source in the error model, for example "DRFR"
    #: terms with the same name and the same text here have one common error; RANDOM: each station has its own error
    shared: str
    #: shape (n, 3); shift of all deeper stations due to the error at a station, m, in true north, east, down; 0 for
    #: stations of other tools
    error: Array
    own: Array  #: shape (n, 3); shift of a station due to the error at this station, m, axes as `error`
    #: shape (n, 3); error of measured depth, m, inclination and azimuth, rad, that causes the shifts `error` and `own`;
    #: 0 for errors of the course between stations, which are position errors. The error of the azimuth grows without
    #: limit towards the vertical.
    measured: Array


@dataclasses.dataclass(frozen=True)
class _CourseStations:
    """Stations of a part of the well, shape (n,) each: measured depth, m, inclination, azimuth from true north, rad."""

    md: Array
    inclination: Array
    azimuth: Array
    first_tvd: float = 0.0  #: vertical depth of the first station, m

    def cut(self, first: int, last: int, inclination: Array) -> _CourseStations:
        """Return the stations from index first to last - 1; inclination: new inclinations of all stations, rad."""
        start = (0.0, 0.0, self.first_tvd)
        tvd = float(mc.path(self.md, self.inclination, self.azimuth, start)[first, 2])
        return _CourseStations(self.md[first:last], inclination[first:last], self.azimuth[first:last], tvd)


def tool_codes() -> tuple[str, ...]:
    """
    Return the short names of all tool codes: OWSG sets A and B, gyros, and the ISCWSA's own examples.

    Raise CovarianceUnavailableError if `welleng` is not installed.
    """
    try:
        return tool_code.names()
    except ImportError as error:
        # Name of the missing package: welleng itself, or a package that welleng needs.
        missing = (error.name or "welleng").partition(".")[0]
        raise CovarianceUnavailableError(
            f"position covariance needs the Python package {missing}, which is not installed: pip install {missing}"
        ) from error


def check_tool_code(code: str) -> None:
    """
    Check that a tool code exists.

    Raises
    ------
    ValueError
        The code does not exist; the message names similar codes.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    if code not in tool_codes():
        tool_code.check(code)


def error_terms(
    stations: tuple[Array, Array, Array],
    tools: Sequence[ErrorTool | None],
    reference: ErrorReference,
    *,
    first_tvd: float = 0.0,
    without_angles: Mask | None = None,
) -> list[ErrorTerm]:
    """
    Return the error terms of all tools of a well.

    Parameters
    ----------
    stations : tuple of ndarray, shape (n,) each
        Measured depth, m, inclination and azimuth from true north, rad.
    tools : sequence of ErrorTool or None, length n
        Tool that measured each station; None for a station that is taken as given (a tie-on).
    first_tvd : float
        Vertical depth of the first station, m.
    without_angles : ndarray of bool, shape (n,), optional
        Stations for which only the errors of depth and course apply, because their angles have their own sigmas.

    Raises
    ------
    ValueError
        A tool code is unknown or cannot be evaluated on this well, a station is outside the inclination range of its
        code, or a gyro code has no latitude or gives no azimuth at a station.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    whole = _CourseStations(*stations, first_tvd)
    bare = np.zeros(whole.md.size, dtype=bool) if without_angles is None else without_angles
    terms = []
    for tool in dict.fromkeys(t for t in tools if t is not None):
        check_tool_code(tool.code)
        terms += list(_of_tool(whole, tool, np.array([t == tool for t in tools]), reference, bare))
    return terms


def angle_covariance(stations: tuple[Array, Array, Array], tool: ErrorTool, reference: ErrorReference) -> Array:
    """
    Return the covariance of inclination and azimuth along a well surveyed by one tool, shape (n, 2, 2), rad^2.

    stations: measured depth, m, inclination and azimuth from true north, rad, shape (n,) each. Raises the exceptions of
    `error_terms`.
    """
    # Some terms have no value at the first station, so add a station above it.
    md, inc, azi = (np.append(values[:1], values).astype(float) for values in stations)
    md[0] -= 30.0
    total = np.zeros((inc.size, 2, 2))
    for term in error_terms((md, inc, azi), [tool] * inc.size, reference):
        if not term.name.startswith(_NOT_OF_ANGLES):
            total += np.einsum("ki,kj->kij", term.measured[:, 1:], term.measured[:, 1:])
    return total[1:]


def _of_tool(
    whole: _CourseStations, tool: ErrorTool, own: Mask, reference: ErrorReference, bare: Mask
) -> Iterator[ErrorTerm]:
    """
    Yield the error terms of one tool.

    own, bare : masks, shape (n,), of the stations of the tool, and of the stations without errors of angles.
    """
    n = whole.md.size
    rows = np.flatnonzero(own)
    low, high = _inclination_limits(tool.code)
    for k in rows:
        if not low <= whole.inclination[k] < high:
            raise ValueError(
                f"{tool.code} is meant for inclinations from {math.degrees(low):g} to {math.degrees(high):g} deg; the "
                f"station at {whole.md[k]:.1f} m has {math.degrees(whole.inclination[k]):.1f} deg: choose another code"
                " from there on"
            )
    first, last = max(0, int(rows[0]) - 1), min(n, int(rows[-1]) + 2)
    # Stations of other tools in between only define the path: their inclinations are clipped to this code's range.
    shape = np.where(own, whole.inclination, np.clip(whole.inclination, low, np.nextafter(high, 0.0)))
    part = whole.cut(first, last, shape)
    errors, tortuosity = _evaluated(part, tool.code, reference)
    if _needs_latitude(tool.code):
        _check_azimuth(tool.code, errors, whole, own, first)
    for name, source in errors.items():
        counted = own if name.startswith(_NOT_OF_ANGLES) else own & ~bare
        scale = _vertical_scale(name, part, tortuosity)
        for number, active in enumerate(_realisations(source)):
            kept = np.zeros(n, dtype=bool)
            kept[first:last] = counted[first:last] & active[: last - first]
            arrays = [np.zeros((n, 3)) for _ in range(3)]
            for array, values in zip(arrays, (source.e_NEV, source.e_NEV_star, source.e_DIA), strict=True):
                array[kept] = (np.asarray(values)[: last - first] * scale[:, None])[kept[first:last]]
            shared = _shared(source.propagation, tool) + (f", part {number}" if number else "")
            yield ErrorTerm(name, shared, *arrays)


def _vertical_scale(name: str, stations: _CourseStations, tortuosity: float) -> Array:
    """Return the factor by which errors decrease near the vertical, per station, shape (n,); 1 elsewhere."""
    s_inc = np.sin(stations.inclination)
    scale = np.ones(s_inc.size)
    if name.startswith("SAGE"):
        # SAGE is the only term whose weight, sin(inclination)**0.25, decreases more slowly than the inclination when
        # the hole becomes vertical.
        low = s_inc < math.sin(_NEXT_TO_VERTICAL)
        scale[low] = (np.maximum(s_inc[low], 0.0) / math.sin(_NEXT_TO_VERTICAL)) ** 0.25
        scale[s_inc < mc.VERTICAL] = 0.0
    elif name.startswith("XCLA"):
        # After a vertical station the hole does not turn, so only the tortuosity remains (definition 5.13, XCLA).
        turn = np.abs(s_inc[1:] * np.sin(np.diff(stations.azimuth)))
        least = tortuosity * np.diff(stations.md)
        scale[1:] = np.where(s_inc[:-1] < mc.VERTICAL, least / np.maximum(turn, least), 1.0)
    return scale


def _check_azimuth(code: str, errors: dict[str, Any], whole: _CourseStations, own: Mask, first: int) -> None:
    """
    Raise ValueError if a station more than 1 deg from the vertical has an azimuth error of 90 deg or more.

    The errors of a north-seeking gyro grow with 1 / cos(inclination) towards the horizontal.
    """
    largest = np.max([np.abs(np.asarray(source.e_DIA))[:, 2] for source in errors.values()], axis=0, initial=0.0)
    for k in np.flatnonzero(own & (np.sin(whole.inclination) > math.sin(_VERTICAL))):
        if not largest[k - first] < 0.5 * math.pi:
            raise ValueError(
                f"{code} gives no azimuth at {whole.md[k]:.1f} m, at {math.degrees(whole.inclination[k]):.1f} deg of"
                " inclination: choose another code from there on"
            )


def _shared(propagation: str, tool: ErrorTool) -> str:
    if propagation == RANDOM:
        return RANDOM
    # The tool's own errors are constant within a run; errors of the well and of the Earth's field are constant within
    # the whole well.
    return "whole well" if propagation in _WHOLE_WELL else f"{tool.code}, run {tool.run}"


def _realisations(source: Any) -> list[Mask]:
    """
    Return masks, shape (n,), of the stations that share one realisation of an error.

    A continuous gyro has a new random error from each start (definition 5.13, section 7.3). For such an error the
    library gives only the covariance of all parts together; here the parts are separated.
    """
    n = len(source.e_NEV)
    sigma = np.asarray(source.sigma_e_NEV)
    if source.propagation == RANDOM or np.allclose(source.cov_NEV, sigma[:, :, None] * sigma[:, None, :]):
        return [np.ones(n, dtype=bool)]
    active = np.any(source.e_DIA != 0.0, axis=1)
    number = np.cumsum(active & ~np.concatenate([[False], active[:-1]]))
    return [active & (number == k) for k in range(1, int(number.max(initial=0)) + 1)]


def _evaluated(stations: _CourseStations, code: str, reference: ErrorReference) -> tuple[dict[str, Any], float]:
    """
    Return the library's error sources by name, and the code's tortuosity, rad/m.

    The arrays of a source have one row for each station, and may have additional rows at the end.
    """
    from welleng.survey import Survey, SurveyHeader

    md, azi = stations.md, stations.azimuth
    inc = np.clip(stations.inclination, _NEXT_TO_VERTICAL, math.pi - _NEXT_TO_VERTICAL)
    if md.size < 3:
        # welleng's singular terms need three stations; a station straight ahead does not change the two above it.
        ahead = md[-1] + (md[-1] - md[0] if md.size > 1 else 30.0)
        md, inc, azi = np.append(md, ahead), np.append(inc, inc[-1]), np.append(azi, azi[-1])
    if _needs_latitude(code) and not math.isfinite(reference.latitude):
        raise ValueError(f"{code} is a gyro code and needs the latitude of the well (well.latitude_deg, --lat)")
    # With zero convergence all axes of welleng refer to true north.
    header = SurveyHeader(
        latitude=math.degrees(reference.latitude) if math.isfinite(reference.latitude) else 0.0,
        longitude=0.0,
        altitude=0.0,
        survey_date="2026-01-01",
        G=reference.g_total,
        b_total=reference.b_total * 1e9,
        dip=math.degrees(reference.dip),
        declination=math.degrees(reference.declination),
        convergence=0.0,
        azi_reference="true",
        # With limit 0 the library uses its special weights for no station: see the docstring of this file.
        vertical_inc_limit=0.0,
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            survey = Survey(
                md=md,
                inc=np.degrees(inc),
                azi=np.degrees(azi),
                header=header,
                error_model=tool_code.model(code),
                start_nev=[0.0, 0.0, stations.first_tvd],
                deg=True,
            )
    except (AssertionError, ValueError, KeyError) as error:
        raise ValueError(f"{code} cannot be evaluated on this well: {error}") from error
    dropped = survey.err.errors.dropped_terms
    if dropped:
        raise ValueError(f"{code} has terms that cannot be evaluated, {dropped}: its covariance would be too small")
    return dict(survey.err.errors.errors), float(survey.err.errors.tortuosity)


@functools.cache
def _inclination_limits(code: str) -> tuple[float, float]:
    """Return the lowest inclination of a code, included, and its upper limit, excluded, rad; inf if it has no limit."""
    found = next(iter(sorted(tool_code.folder().glob(f"*/{code}.json"))), None)
    if found is None:
        return 0.0, math.inf
    parameters = json.loads(found.read_text(encoding="utf-8")).get("parameters", {})
    low, high = float(parameters.get("inc_min", 0.0)), float(parameters.get("inc_max", 180.0))
    return math.radians(low), math.radians(high) if high < 180.0 else math.inf


@functools.cache
def _needs_latitude(code: str) -> bool:
    found = next(iter(sorted(tool_code.folder().glob(f"*/{code}.json"))), None)
    return found is not None and "Latitude" in found.read_text(encoding="utf-8")

# SPDX-License-Identifier: Apache-2.0
"""
Survey programme of a well: the tool code of each interval, and the uncertainty of the first station.

A programme is a YAML file with `intervals`, each a depth range with a tool code and its run, and `tie_on` with the
sigmas or the covariance of the first station. Depths are in m, covariances in m^2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mwd_sensors.core import settings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.settings import setting
from mwd_surface.uncertainty.error_terms import ErrorTool, check_tool_code
from mwd_surface.uncertainty.position_covariance import StationErrors

CODE, STATION = "code", "station"  # source of the sigmas of the angles: the tool code, or each station itself
#: Method of a station that was taken while the string turned, and the tool code of such stations of an MWD.
ROTARY = "rotary"
ROTARY_CODE = "ISCWSA Rot 6Axis MWD+SRGM"


class ProgrammeError(ValueError):
    """Raised for a survey programme that cannot be used; the message says where and why."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """
    One row of the programme.

    A station at depth d belongs to the first row with from_m < d <= to_m.
    """

    code: str = setting("MWD+SRGM", "Tool code of OWSG set A or B, or of a gyro.")
    from_m: float = setting(0.0, "Measured depth at which the interval starts.", low=0.0)
    to_m: float | None = setting(
        None, "Measured depth at which the interval ends. If left out, it ends with the well.", low=0.0
    )
    run: str = setting(
        "",
        "Name of the tool run. Rows with the same run share its systematic errors. If left out, the row is a run "
        "of its own.",
    )
    leg: str = setting("", "Leg of the survey list to which the row applies. If left out, it applies to every leg.")
    angles: str = setting(
        CODE,
        "Source of the sigmas of inclination and azimuth: the tool code, or each station; in the second case the "
        "code gives only the errors of depth and course.",
        choices=(CODE, STATION),
    )
    #: tool code by method of a station's azimuth, for example {gyro: GYRO-MWD}; this code replaces the code of the row.
    #: Stations taken while the string turned have the method rotary; in a row with an MWD code their code is
    #: `ROTARY_CODE` by default.
    methods: dict[str, str] = dataclasses.field(default_factory=dict)

    def code_of(self, method: str) -> str:
        """Return the tool code of a station whose azimuth has a given method."""
        usual = ROTARY_CODE if method == ROTARY and self.code.startswith("MWD") else self.code
        return self.methods.get(method, usual)


@dataclasses.dataclass(frozen=True)
class TieOnErrors:
    """Uncertainty of the position of the first station; all zero if positions are relative to the first station."""

    sigma_north_m: float = setting(0.0, "1 sigma of the first station to the north.", low=0.0)
    sigma_east_m: float = setting(0.0, "1 sigma of the first station to the east.", low=0.0)
    sigma_tvd_m: float = setting(0.0, "1 sigma of the vertical depth of the first station.", low=0.0)
    #: full 3 x 3 covariance of north, east, down, m^2; replaces the sigmas if it is given
    covariance_m2: list[list[float]] = dataclasses.field(default_factory=list)

    def covariance(self) -> Array | None:
        """Return the covariance of the first station, shape (3, 3), m^2; None if its position is exact."""
        if self.covariance_m2:
            return np.array(self.covariance_m2)
        sigmas = np.array([self.sigma_north_m, self.sigma_east_m, self.sigma_tvd_m])
        return np.diag(sigmas**2) if np.any(sigmas) else None


@dataclasses.dataclass(frozen=True)
class SurveyProgramme:
    """Survey programme."""

    intervals: tuple[Interval, ...]
    tie_on: TieOnErrors = dataclasses.field(default_factory=TieOnErrors)
    name: str = ""  #: name of the file, for messages

    @classmethod
    def of_code(cls, code: str) -> SurveyProgramme:
        """Return the programme of a well that is surveyed by one tool from top to bottom."""
        return cls((Interval(code, run="all"),), name=code)

    def errors(self, stations: ProgrammeStations) -> StationErrors:
        """
        Return the tools of the stations of a well, their own sigmas where used, and the covariance of the tie-on.

        Raises
        ------
        ProgrammeError
            A station is covered by no interval, or has no sigmas although its interval uses the sigmas of the stations.
        """
        tools: list[ErrorTool | None] = []
        sigmas = np.full((stations.md.size, 2), np.nan)
        for k, md in enumerate(stations.md):
            if k == 0 and md > 0.0:
                # The first station of a list that starts below the surface is a tie-on, which has no tool.
                tools.append(None)
                continue
            number, row = self._interval(float(md), stations.legs[k], first=k == 0)
            code = row.code_of(stations.methods[k])
            run = row.run or f"interval {number + 1}"
            tools.append(ErrorTool(code, f"{run}, {stations.tools[k]}" if stations.tools[k] else run))
            if k == 0 or not stations.measured[k]:
                continue
            known = np.all(np.isfinite(stations.sigmas[k]))
            if row.angles == STATION and not known:
                raise ProgrammeError(
                    f"{self.name}: the station at {md:.1f} m has no sigma of its own; use the errors of the code for it"
                    " (angles: code)"
                )
            # A tool code gives the errors of surveys that pass their checks, not of one that failed but is used anyway.
            if known and (row.angles == STATION or stations.failed[k]):
                sigmas[k] = stations.sigmas[k]
        return StationErrors(tools, sigmas, self.tie_on.covariance())

    def _interval(self, md: float, leg: str, first: bool) -> tuple[int, Interval]:
        for number, row in enumerate(self.intervals):
            starts = row.from_m < md or (first and row.from_m <= md)
            if row.leg in ("", leg) and starts and (row.to_m is None or md <= row.to_m):
                return number, row
        raise ProgrammeError(
            f"{self.name}: no interval covers the station at {md:.1f} m"
            + (f" of leg {leg}" if leg else "")
            + "; add one, or leave out to_m of the last"
        )


@dataclasses.dataclass(frozen=True)
class ProgrammeStations:
    """Data of the stations for the programme, one entry per station."""

    md: Array  #: shape (n,); measured depth, m
    sigmas: Array  #: shape (n, 2); 1 sigma of inclination and azimuth of each station, rad, NaN if unknown
    measured: Sequence[bool]  #: True for stations, False for projected or planned points
    failed: Sequence[bool]  #: True for a survey that is used although its verdict is doubtful or reject
    #: `legs`, `tools`, `methods`: leg, serial number of the tool, method of the azimuth; empty text if unknown
    legs: Sequence[str]
    tools: Sequence[str]
    methods: Sequence[str]

    @classmethod
    def plain(cls, md: Array) -> ProgrammeStations:
        """Return measured stations of which only the depths are known; md, shape (n,): m."""
        n = md.size
        empty = [""] * n
        return cls(md, np.full((n, 2), np.nan), [True] * n, [False] * n, empty, empty, empty)


def read_programme(path: Path) -> SurveyProgramme:
    """
    Return the survey programme in a YAML file.

    Raises
    ------
    ProgrammeError
        The file cannot be read, is not a YAML table with intervals, has unknown keys or codes, an interval that does
        not end below its start, or a covariance of the tie-on that is not symmetric.
    """
    try:
        table = read_yaml(path)
    except OSError as error:
        raise ProgrammeError(f"{path}: {error.strerror}") from error
    except settings.SettingsError as error:
        raise ProgrammeError(str(error)) from error
    if not isinstance(table, dict) or not table.get("intervals"):
        raise ProgrammeError(f"{path.name}: expected a table with intervals, each with to_m and code")
    try:
        programme = settings.from_mapping(SurveyProgramme, {"name": path.name, **table})
        for row in programme.intervals:
            for code in (row.code, *row.methods.values()):
                check_tool_code(code)
    except ValueError as error:
        raise ProgrammeError(f"{path.name}: {error}") from error
    for number, row in enumerate(programme.intervals, start=1):
        if row.to_m is not None and not row.to_m > row.from_m:
            raise ProgrammeError(
                f"{path.name}: interval {number} ends at {row.to_m:g} m, not below its start at {row.from_m:g} m"
            )
    matrix = programme.tie_on.covariance()
    if matrix is not None and (matrix.shape != (3, 3) or not np.allclose(matrix, matrix.T)):
        raise ProgrammeError(f"{path.name}: tie_on.covariance_m2 must be a symmetric table of 3 x 3")
    return programme

# SPDX-License-Identifier: Apache-2.0
"""
Position uncertainty of a surveyed well at its stations, at the bit, and ahead along the plan.

The tools of the stations come from the well's survey programme, or from its single tool code. A tool with another
serial number has its own systematic errors. The bit and the plan ahead count as stations of the tool in the hole.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import ROTARY as SURVEY_ROTARY
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan, interpolated, nearest
from mwd_surface.trajectory.well_path import Definitive
from mwd_surface.uncertainty.error_terms import CovarianceUnavailableError, ErrorReference
from mwd_surface.uncertainty.position_covariance import UncertainWell
from mwd_surface.uncertainty.programme import ROTARY, ROTARY_CODE, ProgrammeStations, SurveyProgramme, read_programme

AHEAD = "planned"
_OF_START = (RemarkKind.HOLE_ABOVE_ASSUMED, RemarkKind.TIE_ON_ASSUMED)


@dataclasses.dataclass(frozen=True)
class PathCovariance:
    """Covariance of the stations of a path."""

    covariance: Array | None  #: shape (n, 3, 3), m^2 in the axes of the path, or None
    note: str  #: the error model, or why there is no covariance


def programme_of(well: Well) -> SurveyProgramme | None:
    """
    Return the programme of a well; None if neither programme nor tool code is set.

    Raises
    ------
    ProgrammeError
        The programme file cannot be used.
    """
    if well.programme:
        return read_programme(Path(well.programme).expanduser())
    return SurveyProgramme.of_code(well.error_model) if well.error_model else None


def error_reference(well: Well, survey: Survey) -> ErrorReference:
    """
    Return the local reference field of a survey, at the place of the well; unknown values are NaN.

    An unknown angle that the north of the well does not need is 0, and an unknown gravity is standard gravity.
    """
    # The angle between the well's north and true north must be known; the other angle does not affect the result.
    unknown = {North.MAGNETIC: ("declination",), North.GRID: ("convergence",)}.get(
        North[well.north_reference.upper()], ()
    )
    declination, convergence = (
        0.0 if math.isnan(angle) and name not in unknown else angle
        for name, angle in (("declination", survey.declination), ("convergence", survey.convergence))
    )
    return ErrorReference(
        latitude=math.nan if well.latitude_deg is None else math.radians(well.latitude_deg),
        b_total=survey.b_reference,
        dip=survey.dip_reference,
        declination=declination,
        convergence=convergence,
        # An imported survey may have neither a reference gravity nor a measured one.
        g_total=next(filter(math.isfinite, (survey.g_reference, survey.g_total, STANDARD_GRAVITY))),
    )


def uncertain(surveys: SurveyList, path: Definitive) -> PathCovariance:
    """Return the covariance of a path of the list; there is none if the start is assumed or no error model applies."""
    # The error model describes the errors of measurements, not the error of an assumption.
    made_up = [one.text for one in path.assumptions if one.kind in _OF_START]
    if made_up:
        return PathCovariance(None, f"not given, because the coordinates are assumed: {'; '.join(made_up)}")
    try:
        covariance = uncertain_well(surveys, path).covariance()
    except (CovarianceUnavailableError, ValueError) as error:
        return PathCovariance(None, str(error))
    well = surveys.well
    what = f"survey programme {Path(well.programme).name}" if well.programme else f"error model {well.error_model}"
    turning = sum(r is not None and r.survey.kind == SURVEY_ROTARY for r in surveys.records_on(path))
    what += (
        f" ({turning} rotary surveys: {ROTARY_CODE.removeprefix('ISCWSA ')})" if turning and not well.programme else ""
    )
    stations = programme_stations(surveys, path)
    failed = int(np.sum(np.isfinite(stations.sigmas).all(axis=1) & np.array(stations.failed, dtype=bool)))
    what += f" (failed surveys in use, with their own sigmas: {failed})" if failed else ""
    beside = "".join(f"; not including the error of an assumption: {one.text}" for one in path.assumptions)
    return PathCovariance(covariance, f"{what} (ISCWSA), 1 sigma, relative to the first station{beside}")


def uncertain_well(
    surveys: SurveyList,
    path: Definitive,
    radius: float = 0.0,
    programme: SurveyProgramme | None = None,
) -> UncertainWell:
    """
    Return a path of the list with the survey tools of its stations.

    radius: radius of the hole, m. programme: survey programme, by default from the well.

    Raises
    ------
    ValueError
        No survey has a reference field, there is neither programme nor tool code, or the programme does not cover
        the stations.
    """
    # Stations of a gyro list have no reference field. The field belongs to the place of the well, so the reference of
    # a survey that is not in use serves as well.
    candidates = [*surveys.records, *filter(None, surveys.records_on(path))]
    reference = next((r.survey for r in reversed(candidates) if r.survey.has_reference), None)
    if reference is None:
        raise ValueError(
            "no survey has a reference field, which the error model needs: give the place of the well and a date, or "
            "total field and dip"
        )
    programme = programme or programme_of(surveys.well)
    if programme is None:
        raise ValueError("no error model is configured")
    return UncertainWell(
        surveys.well.wellbore_name,
        path.md,
        path.inclination,
        path.azimuth,
        path.positions,
        path.north,
        programme.errors(programme_stations(surveys, path)),
        error_reference(surveys.well, reference),
        radius,
        remarks=surveys.remarks,
    )


def programme_stations(surveys: SurveyList, path: Definitive) -> ProgrammeStations:
    """
    Return the stations of a path in the form that a survey programme needs.

    A station without a survey gets leg and tool of the station above.
    """
    records = surveys.records_on(path)
    sigmas = np.full((path.md.size, 2), np.nan)
    legs, tools, methods = [path.leg] * path.md.size, [""] * path.md.size, [""] * path.md.size
    failed = [r is not None and r.survey.verdict in (Verdict.DOUBTFUL, Verdict.REJECT) for r in records]
    leg, tool = path.leg, ""
    known = [r for r in records if r is not None]
    if known:
        leg, tool = known[0].leg, known[0].tool
    for k, record in enumerate(records):
        if record is not None:
            survey = record.survey
            leg, tool = record.leg, record.tool
            methods[k] = AzimuthMethod.GYRO if azimuth_source(survey).mostly_gyro else survey.azimuth_method
            if survey.kind == SURVEY_ROTARY:
                methods[k] = ROTARY
            if survey.sigma_inclination > 0.0 and survey.sigma_azimuth > 0.0:
                sigmas[k] = survey.sigma_inclination, survey.sigma_azimuth
        legs[k], tools[k] = leg, tool
    return ProgrammeStations(path.md, sigmas, [r is not None for r in records], failed, legs, tools, methods)


def continued(path: Definitive, plan: Plan | None, reach: float, step: float = 30.0) -> Definitive:
    """
    Return the path continued from its end in the directions of the plan, for at most `reach` m, in steps of `step` m.

    The planned stations keep the present offset from the plan: no steering back is assumed. Without a plan, at the end
    of the plan, or with a reach of 0, the path is returned unchanged.

    Raises
    ------
    ValueError
        reach is negative.
    """
    if reach < 0.0:
        raise ValueError(f"reach: must not be negative, got {reach}")
    if plan is None or reach == 0.0:
        return path
    here = nearest(plan, path.positions[-1])
    whole = interpolated(plan, step)
    ahead = (whole.md > here + 1.0) & (whole.md <= here + reach)
    if not np.any(ahead):
        return path
    md = np.append(path.md, path.md[-1] + whole.md[ahead] - here)
    inc = np.append(path.inclination, whole.inclination[ahead])
    azi = np.append(path.azimuth, whole.azimuth[ahead])
    n = path.md.size
    beyond = mc.path(md[n - 1 :], inc[n - 1 :], azi[n - 1 :], path.positions[-1])[1:]
    return path.through(
        (md, inc, azi),
        np.vstack([path.positions, beyond]),
        (*path.kind, *[AHEAD] * len(beyond)),
        (*path.sequence, *[0] * len(beyond)),
    )

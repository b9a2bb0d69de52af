# SPDX-License-Identifier: Apache-2.0
"""
Conversion of an imported list of stations to a survey list, with which path, reports and exports work.

`station_list.start_of` decides where the path starts, as for plans and offset wells. Stations whose own verdict is not
"accept" are listed but not used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.survey import REFERENCE_FIELDS, Nine, Survey, Verdict
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings, utc
from mwd_surface.list_files.list_checks import are_sharp
from mwd_surface.list_files.provenance import Provenance
from mwd_surface.list_files.remark import Remark, RemarkKind, distinct
from mwd_surface.list_files.station_list import Start, StationList, start_of
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.well import Well

# Words of WITSML 1.4.1.1 for types of stations and survey tools, with the tool code of each.
TOOL_CODES: Mapping[str, str] = {
    "gyro north seeking": "GYRO-NS",
    "gyroscopic north seeking": "GYRO-NS",
    "gyro mwd": "GYRO-MWD",
    "gyroscopic mwd": "GYRO-MWD",
    "magnetic mwd": "MWD+SRGM",
    "magnetic multi-shot": "EMS+SRGM",
    "magnetic multiple-shot": "EMS+SRGM",
}
_TIE_IN = "tie in point"


def survey_list(
    stations: StationList,
    well: Well | None = None,
    *,
    tie_on: TieOn | None = None,
    reference: Reference | None = None,
    every: bool = False,
) -> SurveyList:
    """
    Return the survey list of imported stations; its remarks are those of the reader and of this conversion.

    Parameters
    ----------
    well : Well, optional
        Well; by default the well stored in a list that this project exported, or else a default well. A north named by
        the list replaces the north of the well. A tool code named by a list of another program replaces the tool code
        of the well.
    tie_on : TieOn, optional
        Start of the path, with azimuth from the north of the list. Stations that are not below the start are left out,
        and so is the station at the start, whose depth may be rounded in another unit (`ListRules.same_depth`).
    reference : Reference, optional
        Field and norths of the site; without it no magnetic error model can be evaluated.
    every : bool
        Whether to use all stations, including those whose verdict is not "accept".

    Raises
    ------
    ValueError
        No station remains, or the path cannot be computed.
    """
    remarks = list(stations.remarks)
    well = well or well_of(stations) or Well()
    north = stations.north or well.north_reference
    if not stations.north:
        text = f"{stations.name} does not name the north of its azimuths: {north} is assumed; set it with --north"
        remarks.append(Remark(RemarkKind.NORTH_ASSUMED, text))
    well = dataclasses.replace(well, north_reference=north)
    codes = tool_codes_of(stations)
    code = codes.pop() if len(codes) == 1 else ""
    if len(codes) > 1:
        text = (
            f"{stations.name}: its stations name the tool codes {', '.join(sorted(codes))}; {well.error_model} is used"
            " for the whole list: --programme gives codes by interval, --code another one"
        )
        remarks.append(Remark(RemarkKind.TOOL_ASSUMED, text, {"codes": float(len(codes))}))
    if code and not stations.well:
        well = dataclasses.replace(well, error_model=code)
    start = tie_on
    if start is None:
        first = start_of(stations)
        start = TieOn(first.md, first.inclination, first.azimuth, *first.position, Origin(first.source))
        remarks += first.remarks
    apart = stations.md - start.measured_depth
    below = [int(k) for k in np.flatnonzero(apart > 0.0 if tie_on is None else apart >= ListRules().same_depth)]
    records = [_record(stations, k, North[north.upper()], reference, every=every) for k in below]
    if not records and stations.md.size > 1:
        raise ValueError(f"{stations.name}: no station lies below the tie-on at {start.measured_depth:g} m")
    if tie_on is not None:
        remarks += _sharp_start(tie_on, next((record for record in records if record.in_use), None), stations.name)
    unused = [record for record in records if not record.in_use]
    blind = sum(math.isnan(record.survey.azimuth) for record in unused)
    if blind:
        text = f"{blind} of {len(records)} stations are not used, because they are inclined and have no azimuth"
        remarks.append(Remark(RemarkKind.STATIONS_NOT_USED, text, {"stations": blind}))
    left = len(unused) - blind
    if left:
        text = f"{left} of {len(records)} stations are not used, because their verdict is not accept; --all uses them"
        remarks.append(Remark(RemarkKind.STATIONS_NOT_USED, text, {"stations": left}))
    bare = SurveyList(
        well=well,
        legs=(Leg(tie_on=start),),
        records=tuple(records),
        changed_ns=max((record.survey.stamp_ns for record in records), default=0),
        remarks=tuple(remarks),
    )
    return SurveyList.from_mapping(bare.to_mapping())


def _sharp_start(tie_on: TieOn, first: SurveyRecord | None, name: str) -> list[Remark]:
    """Return a remark if the hole turns implausibly from a tie-on that a person gave to the first station in use."""
    if first is None:
        return []
    turned = mc.dogleg(tie_on.inclination, tie_on.azimuth, first.survey.inclination, first.survey.azimuth)
    length = first.measured_depth - tie_on.measured_depth
    if not are_sharp(turned, np.asarray(length)):
        return []
    text = (
        f"{name}: the hole turns by {math.degrees(turned):.1f} deg from the tie-on at {tie_on.measured_depth:.2f} m to "
        f"the station at {first.measured_depth:.2f} m, which is implausible: check the tie-on"
    )
    return [Remark(RemarkKind.TIE_ON_SHARP, text, {"dogleg": float(turned), "measured_depth": tie_on.measured_depth})]


def well_of(stations: StationList) -> Well | None:
    """
    Return the well stored in a list that this project exported; None for any other list.

    Raises
    ------
    ValueError
        The stored settings are not valid for a well.
    """
    return settings.from_mapping(Well, stations.well, f"{stations.name}: well") if stations.well else None


def provenance_of(surveys: SurveyList, leg: str | None = None, *, whole: bool = True) -> Provenance:
    """
    Return the data of a list to store in an export, so that `survey_list` makes the same path from the export.

    Parameters
    ----------
    leg : str, optional
        Leg to export, if not the current one.
    whole : bool
        Whether the export includes the path of the parent legs. If false, the export begins at the tie-on of the leg.
    """
    there = surveys.find_leg(leg)
    assumptions = surveys.definitive(there.name).assumptions
    while whole and there.parent:
        there = surveys.find_leg(there.parent)
    t = there.tie_on
    reference = reference_in(surveys)
    # Leave out the names of files on this machine, which readers of the export do not have.
    well = dataclasses.replace(surveys.well, programme="", offset_wells="")
    if reference is not None and reference.source:
        well = dataclasses.replace(well, geomagnetic_model=well.geomagnetic_model or reference.source)
    # Leave out the facts of a mine hole if they have their default values.
    left_out = [name for name in ("convention", "mine") if getattr(well, name) == getattr(Well(), name)]
    return Provenance(
        well={name: value for name, value in settings.to_mapping(well).items() if name not in left_out},
        start=Start(t.measured_depth, t.inclination, t.azimuth, (t.north, t.east, t.vertical_depth), t.source.value),
        reference=_reference_figures(reference),
        remarks=distinct((*surveys.remarks, *assumptions)),
    )


def reference_in(surveys: SurveyList) -> Reference | None:
    """Return the reference field of the last survey in use that has a reference; None if no survey in use has one."""
    known = [r.survey for r in surveys.records if r.in_use and r.survey.has_reference]
    if not known:
        return None
    last = known[-1]
    return dataclasses.replace(last.reference, source=last.reference_source or surveys.well.geomagnetic_model)


def _reference_figures(reference: Reference | None) -> dict[str, float]:
    """Return the known values of a reference; the keys are attributes of `Survey`."""
    values = {field: getattr(reference, name, None) for name, field in REFERENCE_FIELDS.items()}
    return {field: value for field, value in values.items() if value is not None}


def tool_codes_of(stations: StationList) -> set[str]:
    """
    Return the tool codes of the stations of a list.

    Words of WITSML are converted to tool codes (`TOOL_CODES`); unknown words are left out.
    """
    from mwd_surface.uncertainty.error_terms import tool_codes

    named = {word.strip() for word in stations.tool} - {"", _TIE_IN}
    known = set(tool_codes())
    return {word if word in known else TOOL_CODES.get(word.lower(), "") for word in named} - {""}


def _record(stations: StationList, k: int, north: North, reference: Reference | None, *, every: bool) -> SurveyRecord:
    verdict = {"doubtful": Verdict.DOUBTFUL, "reject": Verdict.REJECT}.get(stations.verdict[k], Verdict.ACCEPT)
    azimuth = float(stations.azimuth[k])
    known = not math.isnan(azimuth)
    survey = Survey(
        stamp_ns=_stamp(stations.time[k]),
        uuid=f"{stations.name}-{k + 1}",
        sequence=k + 1,
        inclination=float(stations.inclination[k]),
        azimuth=azimuth,
        north=int(north),
        covariance=_covariance(stations, k),
        verdict=int(verdict),
        reasons=(f"imported from {stations.name}",),
        headline="imported: its readings are not known",
        **_figures(stations, k, reference),
    )
    vertical = known or survey.inclination <= math.radians(1.0)
    return SurveyRecord(
        survey,
        float(stations.md[k]),
        0.0,
        in_use=vertical and (every or verdict == Verdict.ACCEPT),
        leg=Leg().name,
        tool=stations.tool[k],
    )


def _covariance(stations: StationList, k: int) -> Nine:
    """Return the covariance of inclination, azimuth and toolface, rad^2; only the first two variances are known."""
    inclination, azimuth = (float(s) ** 2 for s in (stations.sigma_inclination[k], stations.sigma_azimuth[k]))
    unknown = math.nan
    return inclination, unknown, unknown, unknown, azimuth, unknown, unknown, unknown, unknown


def _figures(stations: StationList, k: int, reference: Reference | None) -> dict[str, Any]:
    """
    Return the known reference values of a station by name of the `Survey` attribute.

    Values of the given reference replace values of the list.
    """
    figures: dict[str, Any] = {
        name: float(values[k]) for name, values in stations.figures.items() if math.isfinite(values[k])
    }
    if reference is not None:
        figures |= _reference_figures(reference) | {"reference_source": reference.source}
    return figures


def _stamp(text: str) -> int:
    """Return a time as ns since the epoch; 0 if the text is not a time."""
    try:
        return utc.stamp_ns(utc.moment(text))
    except ValueError:
        return 0

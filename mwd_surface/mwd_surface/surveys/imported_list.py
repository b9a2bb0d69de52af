# SPDX-License-Identifier: Apache-2.0
"""
A list of stations that others measured as a survey list: path, reports and exports then work as for one of our own.

Where its path starts is decided by `station_list.start_of`, as for plans and offset wells. Stations whose own verdict
is not "accept" are listed, not used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core import utc
from mwd_sensors.core.unknown import or_none
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.station_list import StationList, start_of
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Nine, Survey, SurveyRecord, Verdict
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.north import North

# Words of WITSML 1.4.1.1 (types of stations and of survey tools), and the tool code of each.
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
    The survey list of an imported list of stations; its remarks are those of the reader and of this conversion.

    Parameters
    ----------
    stations : StationList
    well : Well, optional
        Its north and error model are replaced by those of the list where the list names them.
    tie_on : TieOn, optional
        Where the path starts, in the north of the list; stations not below it are left out.
    reference : Reference, optional
        Field and norths of the place; without one no magnetic error model can be evaluated.
    every : bool
        Use the stations whose verdict is not "accept", too.

    Raises
    ------
    ValueError
        No station is left, or the path cannot be computed.
    """
    remarks = list(stations.remarks)
    north = stations.north or (well or Well()).north_reference
    if not stations.north:
        text = (
            f"{stations.name} does not say from which north its azimuths are: {north} is assumed; state it with --north"
        )
        remarks.append(Remark(RemarkKind.NORTH_ASSUMED, text))
    well = dataclasses.replace(well or Well(), north_reference=north)
    code = tool_code(stations)
    if code:
        well = dataclasses.replace(well, error_model=code)
    start = tie_on
    if start is None:
        first = start_of(stations)
        origin = Origin.STATION if first.md == stations.md[0] else Origin.WELLHEAD
        if any(one.kind == RemarkKind.TIE_ON_ASSUMED for one in first.remarks):
            origin = Origin.WITHOUT_POSITION
        start = TieOn(first.md, first.inclination, first.azimuth, *first.position, origin)
        remarks += first.remarks
    below = [k for k in range(stations.md.size) if stations.md[k] > start.measured_depth]
    records = [_record(stations, k, North[north.upper()], reference, every=every) for k in below]
    if not records and stations.md.size > 1:
        raise ValueError(f"{stations.name}: no station lies below the tie-on at {start.measured_depth:g} m")
    left = sum(not record.in_use for record in records)
    if left:
        text = f"{left} of {len(records)} stations are not used, their verdict is not accept; --all uses them"
        remarks.append(Remark(RemarkKind.STATIONS_NOT_USED, text, {"stations": left}))
    bare = SurveyList(
        well=well,
        legs=(Leg(tie_on=start),),
        records=tuple(records),
        changed_ns=max((record.survey.stamp_ns for record in records), default=0),
        remarks=tuple(remarks),
    )
    return SurveyList.from_mapping(bare.to_mapping())


def reference_in(surveys: SurveyList) -> Reference | None:
    """The reference of the last survey in use that has one."""
    known = [r.survey for r in surveys.records if r.in_use and r.survey.has_reference]
    if not known:
        return None
    last = known[-1]
    return Reference(
        total=last.b_reference,
        dip=last.dip_reference,
        declination=or_none(last.declination),
        convergence=or_none(last.convergence),
        gravity=or_none(last.g_reference),
        source=last.reference_source or surveys.well.geomagnetic_model,
    )


def tool_code(stations: StationList) -> str:
    """The tool code that a list names, by itself or in words; empty where it names none or several."""
    from mwd_surface.uncertainty.error_terms import tool_codes

    named = {word.strip() for word in stations.tool} - {"", _TIE_IN}
    known = set(tool_codes())
    codes = {word if word in known else TOOL_CODES.get(word.lower(), "") for word in named}
    return codes.pop() if len(codes) == 1 else ""


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
    """Return the covariance of inclination and azimuth, rad^2; unknown where the list has no sigma."""
    inclination, azimuth = (float(s) ** 2 for s in (stations.sigma_inclination[k], stations.sigma_azimuth[k]))
    unknown = math.nan
    return inclination, unknown, unknown, unknown, azimuth, unknown, unknown, unknown, unknown


def _figures(stations: StationList, k: int, reference: Reference | None) -> dict[str, Any]:
    """Fields of a survey that tell its reference: the one given, else that of the list; unknown ones are left out."""
    figures: dict[str, Any] = {
        name: float(values[k]) for name, values in stations.figures.items() if math.isfinite(values[k])
    }
    if reference is not None:
        given = {
            "b_reference": reference.total,
            "dip_reference": reference.dip,
            "declination": reference.declination,
            "convergence": reference.convergence,
            "g_reference": reference.gravity,
            "reference_source": reference.source,
        }
        figures |= {name: value for name, value in given.items() if value is not None}
    return figures


def _stamp(text: str) -> int:
    """Time of a station, ns; 0 where none is written."""
    try:
        return utc.stamp_ns(utc.moment(text))
    except ValueError:
        return 0

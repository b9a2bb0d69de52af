# SPDX-License-Identifier: Apache-2.0
"""
The final list of a well from several sources: runs of the surface unit, recordings, and lists such as a gyro survey.

Where two sources cover the same interval, the one with the smaller position uncertainty at the end of the interval is
used. The stations of the other source stay in the list, marked as not used. Positions are not averaged, because an
averaged path does not correspond to measured stations.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.core.reason_text import text
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import AzimuthEstimate, Survey
from mwd_estimation.survey.tool_code import sensor_errors
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.list_checks import are_sharp
from mwd_surface.surveys import multi_station_analysis
from mwd_surface.surveys.leg import Leg
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.well_position import programme_of, uncertain_well
from mwd_surface.trajectory.list_comparison import covariance_between
from mwd_surface.trajectory.well_path import Definitive
from mwd_surface.uncertainty.programme import Interval, SurveyProgramme

# Smallest number of stations for a multi-station analysis.
_TOGETHER = 3
# Smallest difference between two azimuths of one survey, in sigmas, that chance and correlated errors do not explain.
_CONTRADICTS = 4.0
# Largest distance between the places that two sources of one well state, m. Places are rounded, and may be those of the
# rig or of the field; 10 km is also the largest distance of a first station from its wellhead (`clearance.py`).
_SAME_WELL = 10e3


@dataclasses.dataclass(frozen=True)
class ListSource:
    """A survey list of the well: name for people, the list, and the tool code of its stations."""

    name: str
    surveys: SurveyList
    code: str


@dataclasses.dataclass(frozen=True)
class Overlap:
    """An interval that two sources cover."""

    #: `from_m`, `to_m`: measured depths.
    from_m: float
    to_m: float
    #: `used`, `left_out`: names of the sources.
    used: str
    left_out: str
    #: `sigma_used`, `sigma_left_out`: semi-major axis of the horizontal error ellipse at to_m, 1 sigma, m, of the path
    #: with each source.
    sigma_used: float
    sigma_left_out: float
    #: Depths, m, at which the two paths differ by more than the 99.9 % limit of their uncertainties.
    apart: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class FinalList:
    """The final list, the survey programme of its stations, the overlaps of its sources, and remarks for people."""

    surveys: SurveyList
    programme: SurveyProgramme
    overlaps: tuple[Overlap, ...] = ()
    remarks: tuple[str, ...] = ()
    #: Name of the source of each station, by its number.
    sources: Mapping[int, str] = dataclasses.field(default_factory=dict)


def final_list(sources: Sequence[ListSource]) -> FinalList:
    """
    Return one list made from the sources of one well; well, legs and rules come from the first source.

    Stations of the other sources are put on the path of the current leg of the first source: on this leg if they lie
    below its kick-off point, otherwise on the parent leg. A survey that several sources have (same uuid) is used once.
    Each run of the first source with at least three magnetic stations gets a multi-station analysis for comparison.

    Raises
    ------
    ValueError
        The first source has no tool code or programme, azimuths cannot be converted to the north of its well, or no
        path joins the stations.
    """
    first = sources[0]
    well = dataclasses.replace(first.surveys.well, error_model=first.code or first.surveys.well.error_model)
    programme = programme_of(well)
    if programme is None:
        raise ValueError(f"{first.name} has no tool code; give one as {first.name}=CODE")
    surveys, remarks = _analysed(first.surveys.configured(well, first.surveys.rules), well.error_model)
    found = FinalList(surveys, programme, (), remarks, {r.survey.sequence: first.name for r in surveys.records})
    for source in sources[1:]:
        _check_place(first, source)
        found = _joined(found, source)
    return dataclasses.replace(found, remarks=(*found.remarks, *_sharp_joints(found)))


def _check_place(first: ListSource, other: ListSource) -> None:
    """Raise ValueError if two sources state places so far apart that they cannot be lists of one well."""
    places = []
    for one in (first, other):
        well = one.surveys.well
        if well.latitude_deg is None or well.longitude_deg is None:
            return
        places.append((well.latitude_deg, well.longitude_deg))
    distance = earth.distance(*(math.radians(angle) for place in places for angle in place))
    if distance > _SAME_WELL:
        at = [f"{lat:.4f}, {lon:.4f} deg" for lat, lon in places]
        raise ValueError(
            f"{first.name} at {at[0]} and {other.name} at {at[1]} are {distance / 1000.0:.0f} km apart, so they are "
            "not lists of the same well: leave one out, or correct the place in its list"
        )


def _sharp_joints(final: FinalList) -> list[str]:
    """Return a remark for each implausible dogleg of the path between stations of two sources."""
    path = final.surveys.definitive()
    names = [final.sources.get(number, "") for number in path.sequence]
    length = np.diff(path.md, prepend=path.md[:1])
    turned = path.dogleg_severity * length
    sharp = are_sharp(turned, length)
    return [
        f"an implausible dogleg of {math.degrees(turned[k]):.1f} deg from {path.md[k - 1]:.1f} m ({names[k - 1]}) to "
        f"{path.md[k]:.1f} m ({names[k]}): check that both sources are of this hole and have the same north and depth "
        "datum"
        for k in range(1, path.md.size)
        if sharp[k] and names[k - 1] and names[k] not in ("", names[k - 1])
    ]


def _joined(whole: FinalList, source: ListSource) -> FinalList:
    """
    Return the final list with the stations of another source, and with the overlap if both cover an interval.

    If no station of the source is in use, only a remark is added.
    """
    surveys = whole.surveys
    mine = [r for r in surveys.records if r.in_use and _on_path(surveys, r)]
    theirs = _renamed(source, surveys)
    if not any(r.in_use for r in theirs):
        remark = f"{source.name}: none of its stations is used"
        return dataclasses.replace(whole, remarks=(*whole.remarks, remark))
    spans = [[r.measured_depth for r in rows if r.in_use] for rows in (mine, theirs)]
    upper, lower = max(map(min, spans)) if mine else math.inf, min(map(max, spans)) if mine else -math.inf
    # Stations of two sources nearer than `same_depth` are one station, whose depth each source rounds in its own unit.
    near = surveys.rules.same_depth
    if upper - lower >= near:
        return _with(whole, [*surveys.records, *theirs], theirs, source)
    upper = min(upper, lower)
    held = _held(surveys, theirs)

    def left_out(record: SurveyRecord, better: str) -> SurveyRecord:
        inside = upper - near < record.measured_depth < lower + near
        here = record.in_use and inside and _on_path(surveys, record)
        if not here or record.survey.sequence in held:
            return record
        comment = f"{record.comment}; replaced by {better}".removeprefix("; ")
        return dataclasses.replace(record, in_use=False, comment=comment)

    covering = [r for r in mine if upper - near < r.measured_depth < lower + near] or mine
    name = ", ".join(dict.fromkeys(whole.sources[r.survey.sequence] for r in covering))
    # Compute the well twice: with the present stations in the interval, and with the stations of the other source.
    kept = [left_out(r, name) for r in theirs]
    with_mine = _with(whole, [*surveys.records, *kept], kept, source)
    with_theirs = _with(whole, [*(left_out(r, source.name) for r in surveys.records), *theirs], theirs, source)
    ways = _path(with_mine), _path(with_theirs)
    sigmas = [_horizontal_sigma(*way, lower) for way in ways]
    best = int(sigmas[1] < sigmas[0])
    names = (name, source.name)
    overlap = Overlap(
        upper, lower, names[best], names[1 - best], sigmas[best], sigmas[1 - best], _apart(ways, upper, lower)
    )
    chosen = (with_mine, with_theirs)[best]
    return dataclasses.replace(chosen, overlaps=(*whole.overlaps, overlap))


def _on_path(surveys: SurveyList, record: SurveyRecord) -> bool:
    """Return whether a station lies in the hole of the current leg: on this leg, or on a parent above the kick-off."""
    return record.leg == _leg_at(surveys, record.measured_depth).name


def _leg_at(surveys: SurveyList, measured_depth: float) -> Leg:
    """Return the leg to which a depth, m, in the hole of the current leg belongs."""
    leg = surveys.find_leg()
    while leg.parent and measured_depth <= leg.tie_on.measured_depth:
        leg = surveys.find_leg(leg.parent)
    return leg


def _held(surveys: SurveyList, theirs: Sequence[SurveyRecord]) -> set[int]:
    """
    Return the numbers of stations that must stay in use, because kick-offs of the current leg or its parents need them.

    Such a station is the deepest one of a parent, if it is not below the kick-off. Without it the kick-off would keep
    the position of a path that is no longer used. A station of `theirs` at least as deep on that parent replaces it.
    """
    held: set[int] = set()
    leg = surveys.find_leg()
    while leg.parent:
        above = [r for r in (*surveys.records, *theirs) if r.in_use and r.leg == leg.parent]
        if above:
            deepest = max(above, key=lambda r: r.measured_depth)
            if deepest not in theirs and deepest.measured_depth <= leg.tie_on.measured_depth:
                held.add(deepest.survey.sequence)
        leg = surveys.find_leg(leg.parent)
    return held


def _renamed(source: ListSource, surveys: SurveyList) -> list[SurveyRecord]:
    """
    Return the stations of a source that are not in a list yet, with the next free numbers and the legs of that list.

    Stations without a depth are left out; stations at or above the tie-on are not in use.
    """
    known = {record.survey.uuid for record in surveys.records}
    fresh = [r for r in source.surveys.records if r.survey.uuid not in known and math.isfinite(r.measured_depth)]
    found = []
    for number, record in enumerate(fresh, surveys.next_sequence):
        leg = _leg_at(surveys, record.measured_depth)
        one = dataclasses.replace(
            record,
            survey=dataclasses.replace(record.survey, sequence=number),
            leg=leg.name,
            tool=record.tool or source.name,
            comment=f"{record.comment}; from {source.name}".removeprefix("; "),
            in_use=record.in_use and record.measured_depth > leg.tie_on.measured_depth,
        )
        found.append(one)
    return found


def _with(
    whole: FinalList, records: Sequence[SurveyRecord], theirs: Sequence[SurveyRecord], source: ListSource
) -> FinalList:
    """
    Return the final list with other records; the intervals of a new source come first in the survey programme.

    records: all records of the result. theirs: the records that come from the new source.
    """
    code = source.code or source.surveys.well.error_model
    surveys = whole.surveys.with_records(records)
    legs = {r.survey.sequence: r.leg for r in theirs if r.in_use}
    path = surveys.definitive()
    intervals: list[Interval] = []
    station = 0
    for k, number in enumerate(path.sequence):
        # A kick-off point has no survey of its own. Its survey tool is that of the shallower station next to it.
        station = number or station
        if station not in legs:
            continue
        above, here, leg = float(path.md[k - 1]), float(path.md[k]), legs[station]
        if intervals and (intervals[-1].to_m, intervals[-1].leg) == (above, leg):
            intervals[-1] = dataclasses.replace(intervals[-1], to_m=here)
        else:
            intervals.append(Interval(code, above, here, source.name, leg))
    programme = dataclasses.replace(whole.programme, intervals=(*intervals, *whole.programme.intervals))
    names = {**whole.sources, **{r.survey.sequence: source.name for r in theirs}}
    return dataclasses.replace(whole, surveys=surveys, programme=programme, sources=names)


def _path(whole: FinalList) -> tuple[Definitive, Array]:
    """Return the path and the covariance of its stations, shape (n, 3, 3), m^2."""
    path = whole.surveys.definitive()
    return path, uncertain_well(whole.surveys, path, programme=whole.programme).covariance()


def _horizontal_sigma(path: Definitive, covariance: Array, md: float) -> float:
    """Return the semi-major axis of the horizontal error ellipse at a measured depth, 1 sigma, m."""
    flat = covariance_between(path.md, covariance, np.array([md]))[0, :2, :2]
    return math.sqrt(max(float(np.linalg.eigvalsh(flat)[-1]), 0.0))


def _apart(
    ways: tuple[tuple[Definitive, Array], tuple[Definitive, Array]], upper: float, lower: float
) -> tuple[float, ...]:
    """
    Return the depths in (`upper`, `lower`], m, at which two paths differ by more than the 99.9 % limit of their errors.

    ways: path and covariance of each of the two surveys of the hole.
    """
    from welleng.combination import fuse_covariances

    depths = np.unique(np.concatenate([path.md for path, _ in ways]))
    depths = depths[(depths > upper) & (depths <= lower)]
    if not depths.size:
        return ()
    positions = [np.array([path.at(float(md))[2] for md in depths]) for path, _ in ways]
    spread = [covariance_between(path.md, covariance, depths) for path, covariance in ways]
    # Above the interval both paths have the same stations, and so the same errors.
    common = np.broadcast_to(covariance_between(ways[0][0].md, ways[0][1], np.array([upper])), spread[0].shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        fused = fuse_covariances(*spread, cross=common, pos_a=positions[0], pos_b=positions[1])
    flags = fused.innovation_flag
    return () if flags is None else tuple(float(md) for md in depths[flags])


def _analysed(surveys: SurveyList, code: str) -> tuple[SurveyList, tuple[str, ...]]:
    """
    Return the list with azimuths by multi-station analysis added to its surveys, and remarks for people.

    A run consists of the surveys of one leg and one tool. Runs of fewer than three magnetic surveys are not analysed;
    without a magnetic tool code the list is returned unchanged.
    """
    try:
        errors = sensor_errors(code)
    except ValueError:
        return surveys, ()
    runs: dict[tuple[str, str], list[SurveyRecord]] = {}
    for record in surveys.records:
        s = record.survey
        if s.has_readings and s.has_reference and math.isfinite(sum(s.magnetic_field) + sum(s.specific_force)):
            runs.setdefault((record.leg, record.tool), []).append(record)
    found: dict[str, Survey] = {}
    remarks = []
    for (leg, tool), records in runs.items():
        if len(records) < _TOGETHER:
            continue
        force, field = (np.array([getattr(r.survey, name) for r in records]) for name in _READINGS)
        done = multi_station_analysis.analyse(force, field, records[-1].survey.reference, errors)
        refused = "" if done.refused is None else text(done.refused)
        run = " ".join(filter(None, (f"leg {leg}", tool)))
        if refused:
            remarks.append(f"multi-station analysis of {run} is refused: {refused}")
        odd = [str(r.survey.sequence) for r, used in zip(records, done.used, strict=True) if not used]
        if odd:
            remarks.append(f"outliers of the multi-station analysis of {run}: survey {', '.join(odd)}")
        for record, azimuth, sigma in zip(records, done.azimuth, done.sigma_azimuth, strict=True):
            estimate = AzimuthEstimate(
                str(AzimuthMethod.MULTI_STATION),
                int(North.MAGNETIC),
                float(azimuth) % math.tau,
                float(sigma),
                reason=refused,
            )
            found[record.survey.uuid] = _with_estimate(record, estimate)
        if not refused:
            remarks += _contradiction(run, [found[record.survey.uuid] for record in records])
    records_now = [
        r if r.survey.uuid not in found else dataclasses.replace(r, survey=found[r.survey.uuid])
        for r in surveys.records
    ]
    return surveys.with_records(records_now), tuple(remarks)


def _contradiction(run: str, surveys: Sequence[Survey]) -> list[str]:
    """
    Return a remark if a multi-station analysis contradicts the azimuths of its surveys, else an empty list.

    The analysis knows errors of the string and of the sensors only. A field from outside the string, or an azimuth
    that a gyro has decided, shows as a contradiction, and its sigma is then meaningless.
    """
    apart = []
    for survey in surveys:
        msa = next((one for one in survey.azimuths if one.method == AzimuthMethod.MULTI_STATION), None)
        if msa is not None and survey.has_azimuth:
            difference = math.remainder(msa.azimuth - survey.azimuth, math.tau)
            apart.append((abs(difference) / math.hypot(msa.sigma, survey.sigma_azimuth), abs(difference), survey))
    worst = max(apart, key=lambda one: one[0], default=None)
    if worst is None or not worst[0] > _CONTRADICTS:
        return []
    sigmas, difference, survey = worst
    where = f"by {math.degrees(difference):.1f} deg or {sigmas:.0f} sigma at survey {survey.sequence}"
    return [
        (
            f"the azimuths by multi-station analysis of {run} contradict the azimuths of the list, {where}: the "
            "analysis does not model a field from outside the string, so its azimuths and their sigmas are not valid"
        )
    ]


_READINGS = ("specific_force", "magnetic_field")


def _with_estimate(record: SurveyRecord, estimate: AzimuthEstimate) -> Survey:
    others = [one for one in record.survey.azimuths if one.method != estimate.method]
    # Azimuths of a survey refer to its own north.
    azimuth = record.survey.turned(estimate.azimuth, North.MAGNETIC, North(record.survey.north))
    if azimuth is None:
        return record.survey
    estimate = dataclasses.replace(estimate, azimuth=azimuth, north=record.survey.north)
    return dataclasses.replace(record.survey, azimuths=(*others, estimate))

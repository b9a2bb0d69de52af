# SPDX-License-Identifier: Apache-2.0
"""
Checks whether a station may enter the path of its leg, and computation of its place on the path and of its flags.

Units are SI and rad; azimuths are from the north of the well.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_record import COORDINATES_ASSUMED, PLACE, Judgement, SurveyRecord
from mwd_surface.trajectory.well_path import ASSUMED, SURVEY, TIE_ON, Definitive, path_of, projected

if TYPE_CHECKING:
    from mwd_surface.surveys.survey_list import SurveyList

NO_DEPTH = "no measured depth"
# Kinds of reader remarks that make the coordinates of the whole path doubtful.
_OF_COORDINATES = (RemarkKind.NORTH_ASSUMED, RemarkKind.UNIT_ASSUMED, RemarkKind.NUMBERS_ASSUMED)


def in_use_on(whole: SurveyList, leg: str) -> list[SurveyRecord]:
    """Return the stations in use on a leg."""
    return [r for r in whole.records if r.leg == leg and r.in_use]


def at_same_depth(whole: SurveyList, record: SurveyRecord) -> list[SurveyRecord]:
    """Return the other stations in use on the leg of a record that lie less than `rules.same_depth` from its depth."""
    return [
        r
        for r in in_use_on(whole, record.leg)
        if r.survey.uuid != record.survey.uuid
        and abs(r.measured_depth - record.measured_depth) < whole.rules.same_depth
    ]


def fatal_reasons(whole: SurveyList, record: SurveyRecord) -> list[str]:
    """Return the reasons why no decision can put the record into the path; empty if the record can be used."""
    if math.isnan(record.measured_depth):
        return [NO_DEPTH]
    why = []
    tie_on = whole.find_leg(record.leg).tie_on
    if record.measured_depth <= tie_on.measured_depth:
        why.append(f"the depth {record.measured_depth:.2f} m is not below the tie-on at {tie_on.measured_depth:.2f} m")
    if record.survey.azimuth_from(whole.north) is None and not _is_vertical(record, whole.rules):
        have = North(record.survey.north).name.lower()
        why.append(
            f"its azimuth is from {have} north, and the angle to {whole.well.north_reference} north is not known"
            if record.survey.has_azimuth
            else "no azimuth"
        )
    return why


def conflicts(whole: SurveyList, record: SurveyRecord) -> list[str]:
    """
    Return sentences on conflicts of a record with stations in use; empty without conflicts.

    A conflict is another station at the same depth, or stations whose order of depth contradicts their order in time.
    The record can enter the path only if a person explicitly replaces the other stations.
    """
    rivals = at_same_depth(whole, record)
    why = [f"duplicate depth: survey {r.survey.sequence} is at {r.measured_depth:.2f} m" for r in rivals]
    own = next((r for r in in_use_on(whole, record.leg) if r.survey.uuid == record.survey.uuid), None)
    # A station in use has been accepted in its present order; only a new depth can contradict the times of others.
    known = rivals if own is None else [*rivals, *_out_of_order(whole, own)]
    wrong = [r for r in _out_of_order(whole, record) if r not in known]
    deeper = [r for r in wrong if r.measured_depth > record.measured_depth]
    if deeper:
        last = max(deeper, key=lambda r: r.measured_depth)
        why.append(f"decreasing depth: survey {last.survey.sequence} is deeper, at {last.measured_depth:.2f} m")
    elif wrong and record.judgement == Judgement.ACCEPTED:
        # If nobody has decided, the later stations do not exclude the record: the clock of a restarted tool may be
        # behind.
        first = min(wrong, key=lambda r: r.measured_depth)
        why.append(f"decreasing depth: survey {first.survey.sequence} is later, at {first.measured_depth:.2f} m")
    return why


def _out_of_order(whole: SurveyList, record: SurveyRecord) -> list[SurveyRecord]:
    """Return the stations in use that are deeper and earlier than a record, or shallower and later."""
    if not record.survey.stamp_ns:
        return []
    return [
        r
        for r in in_use_on(whole, record.leg)
        if r.survey.stamp_ns
        and (r.measured_depth - record.measured_depth) * (r.survey.stamp_ns - record.survey.stamp_ns) < 0.0
    ]


def obstacles(whole: SurveyList, record: SurveyRecord) -> list[str]:
    """
    Return the reasons, other than its verdict, why the record does not enter the path automatically.

    The result is empty if there are none.
    """
    why = fatal_reasons(whole, record)
    if math.isnan(record.measured_depth):
        return why
    why += [*_age_flag(record, whole.rules), *conflicts(whole, record)]
    if not why:
        try:
            leg_path(whole, whole.find_leg(record.leg), [*(r for r in whole.records if r.in_use), record], None)
        except ValueError as error:
            why.append(str(error))
    return why


def placed(whole: SurveyList, record: SurveyRecord, place: tuple[Definitive, int] | None) -> SurveyRecord:
    """
    Return the record with its flags and its place on the path.

    place: path, and index of the station on the path; None if the record is not on the path. Without a place, the
    record is not in use, its place is NaN, and its flags name the obstacles, unless a person has rejected the survey.
    """
    if place is None or not record.in_use:
        nowhere: dict[str, Any] = dict.fromkeys(PLACE, math.nan)
        bare = dataclasses.replace(record, in_use=False, flags=(), **nowhere)
        # A rejected station gets no flags of obstacles, because it is not in the path in any case.
        flags = [] if record.judgement == Judgement.REJECTED else obstacles(whole, bare)
        return dataclasses.replace(bare, flags=(*flags, *revision_flags(record, whole.north)))
    path, k = place
    n, e, d = (float(v) for v in path.positions[k])
    return dataclasses.replace(
        record,
        north=n,
        east=e,
        vertical_depth=d,
        vertical_section=float(path.vertical_section[k]),
        dogleg_severity=float(path.dogleg_severity[k]),
        build_rate=float(path.build_rate[k]),
        turn_rate=float(path.turn_rate[k]),
        flags=tuple(quality_flags(whole, record, path, k)),
    )


def quality_flags(whole: SurveyList, record: SurveyRecord, path: Definitive, k: int) -> list[str]:
    """Return the flags of a station in use, at index k of its path."""
    flags = [*_age_flag(record, whole.rules), *([COORDINATES_ASSUMED] if path.assumed else [])]
    if record.survey.azimuth_from(whole.north) is None:
        flags.append("no azimuth: that of the station above is used")
    severity = math.degrees(path.dogleg_severity[k]) * 30.0
    if severity > whole.rules.dogleg_limit_deg:
        flags.append(f"dogleg {severity:.1f} deg/30 m is over {whole.rules.dogleg_limit_deg:g} deg/30 m")
    gap = float(path.md[k] - path.md[k - 1])
    # A vertical hole below a known tie-on needs no stations; a gap below an assumed hole is covered by the flag for
    # assumed coordinates.
    vertical = path.kind[k - 1] == TIE_ON and max(path.inclination[k - 1 : k + 1]) <= _vertical_limit(whole.rules)
    if path.kind[k - 1] != ASSUMED and not vertical and gap > whole.rules.gap_limit:
        flags.append(f"gap {gap:.0f} m is over {whole.rules.gap_limit:g} m")
    if record.judgement == Judgement.ACCEPTED and record.survey.verdict != Verdict.ACCEPT:
        verdict = Verdict(record.survey.verdict).name.lower()
        flags.append(f"accepted by {record.operator_name} against the automatic verdict {verdict}")
    return flags + revision_flags(record, whole.north)


def revision_flags(record: SurveyRecord, north: North) -> list[str]:
    """Return flags if later surveys have changed the value of a record, or if a change waits for a person."""
    flags = []
    if record.replaced is not None:
        flags.append(f"revised by later surveys; first value: {_value(record.replaced, north)}")
    if record.proposal is not None:
        why = f": {record.proposal.action}" if record.proposal.action else ""
        flags.append(f"revision not applied: {_value(record.proposal, north)}{why}; needs a decision")
    return flags


def revision_doubt(record: SurveyRecord, north: North) -> str:
    """
    Return a sentence if later surveys contradict the value in use; otherwise an empty text.

    The revised value contradicts if its verdict is neither "accept" nor the verdict in use, or if the azimuth moved by
    more than 1 sigma. A revision that was present when a person decided is not reported.
    """
    used, now = record.survey, record.proposal
    if now is None or not record.in_use or now.revision <= record.decided_revision:
        return ""
    if not moved(used, now, north) and now.verdict in (Verdict.ACCEPT, used.verdict):
        return ""
    why = f": {now.action}" if now.action else ""
    place = f"survey {used.sequence} at {record.measured_depth:.1f} m"
    return f"{place} is in use with {_value(used, north)}; its revised value is {_value(now, north)}{why}"


def moved(before: Survey, now: Survey, north: North) -> bool:
    """Return whether the azimuth of a survey moved by more than its former 1 sigma, or appeared, or disappeared."""
    one, other = before.azimuth_from(north), now.azimuth_from(north)
    if one is None or other is None:
        return one is not other
    return abs(math.remainder(other - one, math.tau)) > before.sigma_azimuth


def revision_sentence(before: SurveyRecord, now: SurveyRecord, north: North) -> str:
    """Return a sentence on the revision of a station: values, reason, and whether it leaves or joins the path."""
    place = f" at {now.measured_depth:.1f} m" if math.isfinite(now.measured_depth) else ""
    use = {(True, False): "; the survey leaves the path", (False, True): "; the survey joins the path"}.get(
        (before.in_use, now.in_use), ""
    )
    why = now.survey.action or "magnetic field at the later surveys"
    values = f"from {_value(before.survey, north)} to {_value(now.survey, north)}"
    return f"survey {now.survey.sequence}{place} revised {values}; reason: {why}{use}"


def _value(survey: Survey, north: North) -> str:
    """Return azimuth with sigma and verdict of a survey in words."""
    azimuth = survey.azimuth_from(north)
    word = Verdict(survey.verdict).word
    if azimuth is None:
        return f"no azimuth ({word})"
    return f"azimuth {math.degrees(azimuth):.2f} ±{math.degrees(survey.sigma_azimuth):.2f} deg ({word})"


def withdrawal(record: SurveyRecord) -> str:
    """Return a sentence which states that a survey is withdrawn, and why."""
    place = f" at {record.measured_depth:.1f} m" if math.isfinite(record.measured_depth) else ""
    return f"survey {record.survey.sequence}{place} is withdrawn from the path: {record.survey.action}"


def leg_path(whole: SurveyList, leg: Leg, used: list[SurveyRecord], bit_depth: float | None) -> Definitive:
    """
    Return the path of a leg through its parents, from the stations `used`, projected to bit_depth, m, if given.

    Raises ValueError if the path cannot be computed, or if a parent does not exist.
    """
    t = leg.tie_on
    own = sorted((r for r in used if r.leg == leg.name), key=lambda r: r.measured_depth)
    md, inc, azi = [t.measured_depth], [t.inclination], [t.azimuth]
    for record in own:
        azimuth = record.survey.azimuth_from(whole.north)
        md.append(record.measured_depth)
        inc.append(record.survey.inclination)
        azi.append(azi[-1] if azimuth is None else azimuth)
    positions = mc.path(md, inc, azi, (t.north, t.east, t.vertical_depth))
    first = (md[1], inc[1]) if own else (bit_depth, 0.0)
    assumptions = tie_on_assumptions(whole.rules, t, *first)
    if assumptions:
        # If the reader of the list has already described this assumption, use the reader's remarks.
        said = tuple(one for one in whole.remarks if one.kind == assumptions[0].kind)
        assumptions = said or assumptions
    made_up = any(one.kind == RemarkKind.HOLE_ABOVE_ASSUMED for one in assumptions)
    kind: tuple[str, ...] = (ASSUMED if made_up else TIE_ON, *(SURVEY for _ in own))
    sequence: tuple[int, ...] = (0, *(r.survey.sequence for r in own))
    columns = np.column_stack([md, inc, azi])
    if leg.parent:
        above = leg_path(whole, whole.find_leg(leg.parent), used, None)
        keep = int(np.searchsorted(above.md, t.measured_depth, side="left"))
        columns = np.vstack([np.column_stack([above.md, above.inclination, above.azimuth])[:keep], columns])
        positions = np.vstack([above.positions[:keep], positions])
        kind, sequence = above.kind[:keep] + kind, above.sequence[:keep] + sequence
        assumptions = above.assumptions
    else:
        assumptions = (*assumptions, *(one for one in whole.remarks if one.kind in _OF_COORDINATES))
    if whole.well.section_azimuth_deg is not None:
        section_azimuth = math.radians(whole.well.section_azimuth_deg)
    else:
        section_azimuth = mc.closure(positions) if whole.plan is None else whole.plan.section_azimuth
    md_all, inc_all, azi_all = columns.T
    path = path_of(leg.name, whole.north, section_azimuth, (md_all, inc_all, azi_all), positions, kind, sequence)
    path = dataclasses.replace(path, assumptions=assumptions)
    return path if bit_depth is None else projected(path, bit_depth, whole.rules.projection)


def tie_on_assumptions(
    rules: ListRules, tie_on: TieOn, first_depth: float | None, inclination: float
) -> tuple[Remark, ...]:
    """
    Return the assumptions of a tie-on about the hole above the first station.

    A tie-on given without its full position has one assumption: the missing coordinates. A default tie-on at the
    wellhead has one, unless there is no station yet or the first station lies within the gap and dogleg limits of
    `rules`. Any other tie-on has none.

    Parameters
    ----------
    tie_on : TieOn
        Tie-on of a leg without a parent.
    first_depth, inclination : float
        Measured depth, m, and inclination, rad, of the first station below the tie-on; depth is None if there is none
        yet.
    """
    if tie_on.source == Origin.WITHOUT_POSITION:
        text = (
            f"the position of the tie-on at {tie_on.measured_depth:.2f} m is not given in full; missing values are"
            " assumed to be straight below the wellhead"
        )
        return (Remark(RemarkKind.TIE_ON_ASSUMED, text, {"measured_depth": tie_on.measured_depth}),)
    if tie_on.source != Origin.WELLHEAD or first_depth is None:
        return ()
    length = first_depth - tie_on.measured_depth
    bend = math.degrees(inclination) * 30.0
    if length <= rules.gap_limit and bend <= rules.dogleg_limit_deg * length:
        return ()
    text = (
        f"no tie-on is given; the hole above the first station at {first_depth:.2f} m is assumed to leave the wellhead"
        " vertically and to reach the station in one arc"
    )
    return (Remark(RemarkKind.HOLE_ABOVE_ASSUMED, text, {"measured_depth": first_depth}),)


def _age_flag(record: SurveyRecord, rules: ListRules) -> list[str]:
    if math.isnan(record.depth_age):
        return ["depth age unknown"]
    old = record.depth_age > rules.depth_age_limit
    return [f"the nearest depth of the rig is {record.depth_age:.0f} s from the survey: check it"] if old else []


def _is_vertical(record: SurveyRecord, rules: ListRules) -> bool:
    return record.survey.inclination <= _vertical_limit(rules)


def _vertical_limit(rules: ListRules) -> float:
    return math.radians(rules.vertical_limit_deg)

# SPDX-License-Identifier: Apache-2.0
"""
Survey list of a well: measurements, automatic verdicts, decisions of people, and the path.

A list is an immutable value: every operation returns a new list, or raises `ValueError` and leaves the old list
unchanged. Automatic verdict and decision are both kept; no measurement is ever dropped. The path is in order of depth.
A station waits until a person accepts it explicitly if an earlier station is deeper, or if another station is at the
same depth. At the same depth, a station with a clearly more certain direction replaces the other one without a
decision, if no person has judged the other one. Units are SI and rad; azimuths and map axes of the path refer to the
north named by the well.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.foreign_text import unprintable
from mwd_surface.list_files.list_checks import DEEPEST
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.surveys.leg import MAIN, Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import LAST_SEQUENCE, ListRules
from mwd_surface.surveys.station_checks import (
    at_same_depth,
    conflicts,
    fatal_reasons,
    in_use_on,
    leg_path,
    obstacles,
    placed,
)
from mwd_surface.surveys.survey_record import Judgement, SurveyDecisionRecord, SurveyRecord, Value, checked_survey
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.well_path import Definitive

#: Kinds of remarks about the start of the path.
OF_START = (RemarkKind.HOLE_ABOVE_ASSUMED, RemarkKind.TIE_ON_ASSUMED, RemarkKind.TIE_ON_OF_LIST)

# Largest ratio of direction sigmas (new station to present station) at which a new station replaces the present one at
# its depth. The sigmas of equal tools differ by less, so that the path does not move back and forth.
_CLEARLY = 0.8


@dataclasses.dataclass(frozen=True)
class SurveyList:
    """Survey list of a well, in order of depth within each leg; the docstring of the module describes its rules."""

    well: Well = dataclasses.field(default_factory=Well)
    rules: ListRules = dataclasses.field(default_factory=ListRules)
    legs: tuple[Leg, ...] = (Leg(),)
    records: tuple[SurveyRecord, ...] = ()
    #: `leg`, `tool`: leg and tool of the next surveys.
    leg: str = MAIN
    tool: str = ""
    changed_ns: int = 0  #: time of the last change
    #: Plan in force; the vertical section lies along the plan if the well sets no azimuth.
    plan: Plan | None = None
    #: Assumptions behind the list, for example those of the reader that imported it.
    remarks: tuple[Remark, ...] = ()

    @property
    def north(self) -> North:
        """North of azimuths and map axes."""
        return North[self.well.north_reference.upper()]

    @property
    def next_sequence(self) -> int:
        """Highest survey number in the list plus 1."""
        return 1 + max((r.survey.sequence for r in self.records), default=0)

    def find(self, sequence: int) -> SurveyRecord:
        """
        Return the record of a survey number.

        Raises
        ------
        ValueError
            There is no such survey; the message lists the last numbers.
        """
        for record in self.records:
            if record.survey.sequence == sequence:
                return record
        known = sorted(r.survey.sequence for r in self.records)[-8:]
        raise ValueError(
            f"survey {sequence} is not in the list; " + (f"the last are {known}" if known else "it is empty")
        )

    def definitive(self, leg: str | None = None, bit_depth: float | None = None) -> Definitive:
        """
        Return the path of a leg (by default the current one), through its parents up to the wellhead.

        bit_depth: m, finite; if the bit is deeper than the last station, a station marked as projected is added there.

        Raises
        ------
        ValueError
            There is no such leg.
        """
        return leg_path(self, self.find_leg(leg), [r for r in self.records if r.in_use], bit_depth)

    def records_on(self, path: Definitive) -> tuple[SurveyRecord | None, ...]:
        """Return the record of each station of a path of this list; None for a station without a survey."""
        by_number = {r.survey.sequence: r for r in self.records}
        return tuple(by_number.get(number) if number else None for number in path.sequence)

    def add(
        self,
        survey: Survey,
        measured_depth: float = math.nan,
        depth_age: float = math.nan,
        *,
        leg: str | None = None,
        tool: str | None = None,
        comment: str = "",
    ) -> SurveyList:
        """
        Return the list with a new survey, which enters the path if the rules allow it without a decision.

        Parameters
        ----------
        survey : Survey
            Survey; one that is already in the list (same uuid) changes nothing. A number that is taken, for example
            after a tool lost its memory, or that exceeds `LAST_SEQUENCE`, is replaced by the next free one; the comment
            says so.
        measured_depth, depth_age : float
            Depth of the sensor at the survey, m, and time between the survey and the depth reading, s; NaN: unknown.
        leg, tool : str, optional
            Leg and tool, if not the current ones.

        Raises
        ------
        ValueError
            A value of the survey or its depth is not finite or out of range, or there is no such leg.
        """
        survey = checked_survey(survey)
        if any(r.survey.uuid == survey.uuid for r in self.records):
            return self
        _checked_depth(measured_depth, depth_age)
        taken = any(r.survey.sequence == survey.sequence for r in self.records)
        if taken or survey.sequence > LAST_SEQUENCE:
            comment = f"{comment}; ".lstrip("; ") + f"numbered {survey.sequence} by the tool"
            survey = dataclasses.replace(survey, sequence=self.next_sequence)
        record = SurveyRecord(
            survey,
            measured_depth,
            depth_age,
            leg=self.find_leg(leg).name,
            tool=self.tool if tool is None else tool,
            comment=comment,
        )
        return self.with_records(self._entered(record), max(survey.stamp_ns, self.changed_ns))

    def _entered(self, record: SurveyRecord) -> tuple[SurveyRecord, ...]:
        """
        Return the records of the list with a new record, which enters the path if the rules allow it.

        The new record replaces stations at its depth that are clearly less certain, if no person has judged them.
        """
        replaced = {r.survey.uuid for r in at_same_depth(self, record) if _is_better(record, r)}
        rest = tuple(dataclasses.replace(r, in_use=r.in_use and r.survey.uuid not in replaced) for r in self.records)
        if not dataclasses.replace(self, records=rest)._allows(record):
            return (*self.records, dataclasses.replace(record, in_use=False))
        whole = dataclasses.replace(self, records=(*rest, dataclasses.replace(record, in_use=True)))
        # A survey that conflicted with a replaced station can go into the path now.
        for waiting in whole.records if replaced else ():
            if waiting.judgement == Judgement.NOT_JUDGED and not waiting.in_use and whole._allows(waiting):
                used = dataclasses.replace(waiting, in_use=True)
                whole = dataclasses.replace(whole, records=tuple(used if r is waiting else r for r in whole.records))
        return whole.records

    def _allows(self, record: SurveyRecord) -> bool:
        """Return whether the rules let a survey enter the path of the stations in use without a person's decision."""
        accepted = record.survey.verdict == Verdict.ACCEPT
        return self.rules.automatic and accepted and not obstacles(self, record)

    def _waits_at(self, record: SurveyRecord, revised: SurveyRecord) -> bool:
        """Return whether a survey is at the depth of a revised one, is not in use, and was not judged by a person."""
        waits = record is not revised and record.judgement == Judgement.NOT_JUDGED and not record.in_use
        apart = abs(record.measured_depth - revised.measured_depth)
        return waits and record.leg == revised.leg and apart < self.rules.same_depth

    def accept(
        self,
        sequence: int,
        operator_name: str,
        reason: str,
        stamp_ns: int,
        *,
        measured_depth: float = math.nan,
        replace: bool = False,
        value: Value = Value.DEFINITIVE,
    ) -> SurveyList:
        """
        Return the list with a survey put into the path by a person; the automatic verdict stays in the list.

        Parameters
        ----------
        operator_name, reason : str
            Person and reason. The name must not be empty.
        measured_depth : float
            New depth of the survey, m; NaN keeps the present one.
        replace : bool
            Whether to accept the survey even if another station is at this depth (that station is then rejected), or if
            an earlier station is deeper or a later one shallower (both then stay).
        value : Value
            Value of the survey to accept; it stays definitive until a person accepts another value.

        Raises
        ------
        ValueError
            There is no operator, survey, depth or usable azimuth; the depth is out of range or not below the tie-on;
            the survey has no revised value to accept; `replace` is false and the survey conflicts with another station;
            or no path can join the stations.
        """
        old = self.find(sequence)
        _checked_operator(operator_name)
        record = _with_value(old, value)
        if value != Value.DEFINITIVE:
            record = _commented(record, f"{operator_name} accepted the {value.name.lower()} value")
        if not math.isnan(measured_depth):
            _checked_depth(measured_depth, 0.0)
            record = _commented(record, f"depth {measured_depth:.2f} m given by hand")
            record = dataclasses.replace(record, measured_depth=measured_depth, depth_age=0.0)
        record = _judged(record, Judgement.ACCEPTED, operator_name, reason, stamp_ns)
        fatal = fatal_reasons(self, record)
        if fatal:
            raise ValueError(f"survey {sequence} cannot be used: {'; '.join(fatal)}")
        against = conflicts(self, record)
        if against and not replace:
            raise ValueError(
                f"survey {sequence} needs an explicit replacement: {'; '.join(against)}; accept it with replace=true "
                "(on the page: 'replace the one there')"
            )
        replaced = {r.survey.uuid for r in at_same_depth(self, record)}
        why = f"replaced by survey {sequence}" + (f": {reason}" if reason else "")
        records = []
        for r in self.records:
            if r is old:
                records.append(dataclasses.replace(record, in_use=True))
            else:
                records.append(_rejected(r, operator_name, why, stamp_ns) if r.survey.uuid in replaced else r)
        return self.with_records(records, stamp_ns)

    def reject(self, sequence: int, operator_name: str, reason: str, stamp_ns: int) -> SurveyList:
        """
        Return the list with a survey taken out of the path by a person; the survey stays in the list.

        Raises
        ------
        ValueError
            There is no operator or no such survey.
        """
        old = self.find(sequence)
        _checked_operator(operator_name)
        record = _rejected(old, operator_name, reason, stamp_ns)
        return self.with_records([record if r is old else r for r in self.records], stamp_ns)

    def revise(self, survey: Survey) -> SurveyList:
        """
        Return the list with the estimator's revised value of a survey.

        Normally this value becomes definitive, and its verdict decides whether the survey is in the path. If a person
        has accepted the survey, or if `rules.apply_revisions` requires a person's decision, the revised value is only
        stored as a proposal. A survey that the estimator withdraws leaves the path without a decision, unless a person
        has accepted it. The list is returned unchanged if it does not contain the survey (uuid), or if it has this
        revision or a newer one.

        Raises
        ------
        ValueError
            A value of the survey is not finite or out of range.
        """
        survey = checked_survey(survey)
        old = next((r for r in self.records if r.survey.uuid == survey.uuid), None)
        if old is None or old.newest_revision >= survey.revision:
            return self
        survey = dataclasses.replace(survey, sequence=old.survey.sequence)
        ask = self.rules.apply_revisions == "ask" and not (survey.withdrawn or old.survey.withdrawn)
        record = dataclasses.replace(old, revised=(survey,))
        if old.judgement != Judgement.ACCEPTED and not ask:
            record = dataclasses.replace(_with_value(record, Value.REVISED), in_use=False)
        whole = dataclasses.replace(self, records=tuple(record if r is old else r for r in self.records))
        if record.judgement == Judgement.NOT_JUDGED and not ask:
            # If the survey leaves the path, another survey at its depth may take its place.
            for one in (record, *(r for r in whole.records if whole._waits_at(r, record))):
                rest = dataclasses.replace(whole, records=tuple(r for r in whole.records if r is not one))
                whole = dataclasses.replace(rest, records=rest._entered(one))
        return self.with_records(whole.records)

    def as_first_decided(self) -> SurveyList:
        """
        Return the list with the first value of each survey, before all revisions.

        The rules decide again on surveys that no person has judged.
        """
        bare = self.with_records(())
        for record in sorted(self.records, key=lambda one: one.survey.stamp_ns):
            first = dataclasses.replace(record, survey=record.as_first_decided, first=(), revised=(), in_use=False)
            if record.judgement == Judgement.NOT_JUDGED:
                bare = bare.with_records(bare._entered(first))
            else:
                bare = bare.with_records((*bare.records, dataclasses.replace(first, in_use=record.in_use)))
        return bare

    def tied_on(self, tie_on: TieOn, leg: str | None = None) -> SurveyList:
        """
        Return the list with a new tie-on of a leg.

        Raises
        ------
        ValueError
            A value is not finite or out of range, stations in use lie above the tie-on, or there is no such leg.
        """
        there = self.find_leg(leg)
        tie_on = settings.from_mapping(TieOn, settings.to_mapping(tie_on), "tie_on")
        mc.checked_stations([tie_on.measured_depth], [tie_on.inclination], [tie_on.azimuth])
        above = [r.survey.sequence for r in in_use_on(self, there.name) if r.measured_depth <= tie_on.measured_depth]
        if above:
            raise ValueError(f"tie_on: surveys {above} of leg {there.name!r} lie at or above {tie_on.measured_depth} m")
        legs = tuple(dataclasses.replace(g, tie_on=tie_on) if g is there else g for g in self.legs)
        # A tie-on given by a person replaces a reader's assumption about the start of the path.
        remarks = self.remarks if there.parent else tuple(one for one in self.remarks if one.kind not in OF_START)
        return dataclasses.replace(self, legs=legs, remarks=remarks).with_records(self.records)

    def sidetracked(self, name: str, measured_depth: float, parent: str | None = None) -> SurveyList:
        """
        Return the list with a new current leg that starts at a measured depth on the path of another leg.

        Raises
        ------
        ValueError
            The name is empty or taken, there is no such parent, or the depth is not on the parent's path.
        """
        source = self.find_leg(parent)
        if not name or any(g.name == name for g in self.legs):
            raise ValueError(f"name: a new leg needs a new name, got {name!r}")
        inc, azi, position = self.definitive(source.name).at(measured_depth)
        n, e, d = (float(v) for v in position)
        tie_on = TieOn(measured_depth, inc, azi, n, e, d, Origin.LEG)
        return dataclasses.replace(self, legs=(*self.legs, Leg(name, tie_on, source.name)), leg=name)

    def using(self, *, leg: str | None = None, tool: str | None = None) -> SurveyList:
        """
        Return the list with another current leg or tool for the next surveys; None keeps the present one.

        Raises ValueError if there is no such leg.
        """
        return dataclasses.replace(self, leg=self.find_leg(leg).name, tool=self.tool if tool is None else tool)

    def configured(self, well: Well, rules: ListRules) -> SurveyList:
        """
        Return the list with another well and other rules; stations in use stay in use.

        Raises
        ------
        ValueError
            The well names another north, and a tie-on or a station in use cannot be converted to it.
        """
        changed = dataclasses.replace(self, well=well, rules=rules)
        if well.north_reference != self.well.north_reference:
            for leg in self.legs:
                t = leg.tie_on
                if (t.inclination, t.north, t.east) != (0.0, 0.0, 0.0):
                    raise ValueError(
                        f"north_reference: leg {leg.name!r} is tied on from {self.well.north_reference} north;"
                        f" give its tie-on from {well.north_reference} north first"
                    )
            for record in self.records:
                fatal = fatal_reasons(changed, record) if record.in_use else []
                if fatal:
                    raise ValueError(f"north_reference: survey {record.survey.sequence}: {'; '.join(fatal)}")
        return changed.with_records(self.records)

    def along(self, plan: Plan | None) -> SurveyList:
        """Return the list with another plan, or without a plan (None)."""
        return self if plan == self.plan else dataclasses.replace(self, plan=plan).with_records(self.records)

    def to_mapping(self) -> dict[str, Any]:
        """Return the list, without its rules, as a plain table for a file."""
        table = settings.to_mapping(dataclasses.replace(self, plan=None))
        table.pop("rules")
        return {**table, "plan": None if self.plan is None else self.plan.to_mapping()}

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], rules: ListRules | None = None) -> SurveyList:
        """
        Return the list of a table made by `to_mapping`, with the given rules (by default the default rules).

        Raises
        ------
        ValueError
            A key or value is not valid (settings.SettingsError), or a path cannot be computed.
        """
        planned = table.get("plan")
        plan = None if planned is None else Plan.from_mapping(planned)
        plain = settings.from_mapping(cls, {**table, "plan": plan, "rules": settings.to_mapping(rules or ListRules())})
        plain.find_leg(plain.leg)
        return plain.with_records(plain.records)

    def find_leg(self, name: str | None = None) -> Leg:
        """
        Return a leg by its name, by default the current one.

        Raises
        ------
        ValueError
            There is no such leg; the message lists the existing ones.
        """
        wanted = self.leg if name is None else name
        for leg in self.legs:
            if leg.name == wanted:
                return leg
        raise ValueError(f"leg: there is no {wanted!r}; there are {', '.join(repr(g.name) for g in self.legs)}")

    def with_records(self, records: Iterable[SurveyRecord], changed_ns: int | None = None) -> SurveyList:
        """
        Return the list with other records, sorted, and all derived values recomputed.

        changed_ns: new time of the last change; None keeps the present one.

        Raises
        ------
        ValueError
            A record has an unknown leg, or no path can join the stations.
        """
        order = {leg.name: k for k, leg in enumerate(self.legs)}
        ordered = sorted(records, key=lambda r: (order.get(r.leg, -1), r.measured_depth, r.survey.sequence))
        strangers = sorted({r.leg for r in ordered} - set(order))
        if strangers:
            raise ValueError(f"records: legs {strangers} do not exist")
        fresh = dataclasses.replace(
            self, records=tuple(ordered), changed_ns=self.changed_ns if changed_ns is None else changed_ns
        )
        fresh = fresh._with_kick_offs()
        places = {}
        for leg in fresh.legs:
            path = fresh.definitive(leg.name)
            places.update({(leg.name, s): (path, k) for k, s in enumerate(path.sequence) if s})
        done = tuple(placed(fresh, r, places.get((r.leg, r.survey.sequence))) for r in ordered)
        return dataclasses.replace(fresh, records=done)

    def _with_kick_offs(self) -> SurveyList:
        """
        Return the list with the tie-on of each sidetrack moved onto the present path of its parent.

        A tie-on below the end of the path of its parent stays unchanged.
        """
        whole = self
        for k, leg in enumerate(self.legs):
            if leg.tie_on.source != Origin.LEG:
                continue
            path = whole.definitive(leg.parent)
            if leg.tie_on.measured_depth > path.md[-1]:
                continue
            inc, azi, (north, east, down) = path.at(leg.tie_on.measured_depth)
            place = float(north), float(east), float(down)
            tie_on = TieOn(leg.tie_on.measured_depth, inc, azi, *place, Origin.LEG)
            legs = (*whole.legs[:k], dataclasses.replace(leg, tie_on=tie_on), *whole.legs[k + 1 :])
            whole = dataclasses.replace(whole, legs=legs)
        return whole


def _is_better(record: SurveyRecord, other: SurveyRecord) -> bool:
    """Return whether a station is clearly more certain than another one that no person has judged."""
    return other.judgement == Judgement.NOT_JUDGED and _sigma(record.survey) < _CLEARLY * _sigma(other.survey)


def _sigma(survey: Survey) -> float:
    """Return 1 sigma of the direction of the hole, rad."""
    azimuth = survey.sigma_azimuth if math.isfinite(survey.sigma_azimuth) else math.pi
    return math.hypot(survey.sigma_inclination, math.sin(survey.inclination) * azimuth)


def _rejected(record: SurveyRecord, operator_name: str, reason: str, stamp_ns: int) -> SurveyRecord:
    judged = _judged(record, Judgement.REJECTED, operator_name, reason, stamp_ns)
    return dataclasses.replace(judged, in_use=False)


def _commented(record: SurveyRecord, note: str) -> SurveyRecord:
    """Return the record with a note added at the end of its comment."""
    return dataclasses.replace(record, comment=f"{record.comment}; {note}" if record.comment else note)


def _judged(record: SurveyRecord, judgement: Judgement, who: str, reason: str, stamp_ns: int) -> SurveyRecord:
    """Return the record with a new decision in force, appended to the earlier ones."""
    decision = SurveyDecisionRecord(int(judgement), who, reason, stamp_ns, record.measured_depth)
    return dataclasses.replace(
        record,
        judgement=int(judgement),
        operator_name=who,
        reason=reason,
        judged_ns=stamp_ns,
        decisions=(*record.decisions, decision),
        decided_revision=record.newest_revision,
    )


def _with_value(record: SurveyRecord, value: Value) -> SurveyRecord:
    """
    Return the record with one of its values made definitive; no value is lost.

    Nothing changes if the definitive value is requested, or the first value of a record that stores no first value.

    Raises ValueError if `value` is `REVISED`, and no revised value of the survey waits for a decision.
    """
    number = record.survey.sequence
    if value == Value.REVISED:
        if not record.revised:
            raise ValueError(f"survey {number} has no revised value that waits for a decision")
        return dataclasses.replace(
            record, survey=record.revised[-1], first=record.first or (record.survey,), revised=()
        )
    if value == Value.FIRST and record.first:
        return dataclasses.replace(record, survey=record.first[0], first=(), revised=record.revised or (record.survey,))
    return record


def _checked_depth(measured_depth: float, depth_age: float) -> None:
    if measured_depth < 0.0 or measured_depth > DEEPEST:
        raise ValueError(f"measured_depth: must be within 0 and {DEEPEST:g} m, got {measured_depth:g}")
    if depth_age < 0.0 or depth_age == math.inf:
        raise ValueError(f"depth_age: must be 0 s or more, got {depth_age}")


def _checked_operator(name: str) -> None:
    if not name.strip():
        raise ValueError("operator_name: must not be empty: the log says who decided")
    if fault := unprintable(name):
        raise ValueError(f"operator_name: {fault}")

# SPDX-License-Identifier: Apache-2.0
"""
The survey list of a well: measurements, automatic verdicts, decisions of people, and the path.

A list is a value: every operation returns a new one or raises `ValueError` and leaves the old one as it was. Automatic
verdict and decision are both kept; no measurement is ever dropped. Depth, once given, decides the order:
a station at a depth already taken, or above a deeper one, waits until a person accepts it explicitly.

Units are SI and rad; azimuths and map axes of the path refer to the north that the well names.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.surveys.leg import MAIN, Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import DEEPEST, LAST_SEQUENCE, ListRules
from mwd_surface.surveys.station_checks import (
    at_same_depth,
    conflicts,
    fatal_reasons,
    in_use_on,
    leg_path,
    obstacles,
    placed,
)
from mwd_surface.surveys.survey_record import Decision, Judgement, Survey, SurveyRecord, Verdict, checked_survey
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.north import North
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.well_path import Definitive

#: Kinds of remarks about where the path of a list starts.
OF_START = (RemarkKind.HOLE_ABOVE_ASSUMED, RemarkKind.TIE_ON_ASSUMED, RemarkKind.TIE_ON_OF_LIST)


@dataclasses.dataclass(frozen=True)
class SurveyList:
    """The whole list, in order of measured depth within each leg; the rules are those of the module."""

    well: Well = dataclasses.field(default_factory=Well)
    rules: ListRules = dataclasses.field(default_factory=ListRules)
    legs: tuple[Leg, ...] = (Leg(),)
    records: tuple[SurveyRecord, ...] = ()
    leg: str = MAIN
    tool: str = ""
    changed_ns: int = 0
    #: In force; the vertical section lies along it where the well sets no azimuth.
    plan: Plan | None = None
    #: Assumptions behind the list, such as those of the reader that imported it.
    remarks: tuple[Remark, ...] = ()

    @property
    def north(self) -> North:
        """North of azimuths and map axes."""
        return North[self.well.north_reference.upper()]

    @property
    def next_sequence(self) -> int:
        """Number after the highest in the list."""
        return 1 + max((r.survey.sequence for r in self.records), default=0)

    def find(self, sequence: int) -> SurveyRecord:
        """
        Return the record of a survey number.

        Raises
        ------
        ValueError
            There is none; the message lists the last numbers there are.
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

        bit_depth: m; where it is deeper than the last station the path is projected to it and marked so.

        Raises
        ------
        ValueError
            No such leg.
        """
        return leg_path(self, self.find_leg(leg), [r for r in self.records if r.in_use], bit_depth)

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
        Add a survey to the list, and to the path if the rules allow it without a decision.

        Parameters
        ----------
        survey : Survey
            One already there (same uuid) changes nothing. A number already taken by another survey, as after a tool
            that lost its memory, or beyond `LAST_SEQUENCE` becomes the next free one; the comment says so.
        measured_depth, depth_age : float
            Of the sensor at the survey, m, and how old that reading was, s; NaN: unknown.
        leg, tool : str, optional
            Other than the current ones.

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
        allowed = self.rules.automatic and survey.verdict == Verdict.ACCEPT and not obstacles(self, record)
        record = dataclasses.replace(record, in_use=allowed)
        return self._with((*self.records, record), max(survey.stamp_ns, self.changed_ns))

    def accept(
        self,
        sequence: int,
        operator_name: str,
        reason: str,
        stamp_ns: int,
        *,
        measured_depth: float = math.nan,
        replace: bool = False,
    ) -> SurveyList:
        """
        Put a survey into the path by decision of a person, whatever its automatic verdict; both are kept.

        Parameters
        ----------
        sequence : int
            Number of the survey.
        operator_name, reason : str
            Who and why. The name must not be empty.
        stamp_ns : int
            When, ns.
        measured_depth : float
            Depth to give it, m; NaN keeps what it has.
        replace : bool
            True: also where another station has this depth (that one is then rejected by the same person, in favour
            of this) or a deeper one exists (this one is put between).

        Raises
        ------
        ValueError
            No operator, no such survey, no depth, no usable azimuth, a depth already taken or passed without
            `replace`, or a path that no arc can join. The list is unchanged.
        """
        old = self.find(sequence)
        _checked_operator(operator_name)
        record = old
        if not math.isnan(measured_depth):
            _checked_depth(measured_depth, 0.0)
            note = f"depth {measured_depth:.2f} m given by hand"
            comment = f"{old.comment}; {note}" if old.comment else note
            record = dataclasses.replace(record, measured_depth=measured_depth, depth_age=0.0, comment=comment)
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
        return self._with(records, stamp_ns)

    def reject(self, sequence: int, operator_name: str, reason: str, stamp_ns: int) -> SurveyList:
        """
        Take a survey out of the path by decision of a person; it stays in the list.

        Raises
        ------
        ValueError
            No operator or no such survey.
        """
        old = self.find(sequence)
        _checked_operator(operator_name)
        record = _rejected(old, operator_name, reason, stamp_ns)
        return self._with([record if r is old else r for r in self.records], stamp_ns)

    def revise(self, survey: Survey) -> SurveyList:
        """
        Keep what the estimator says of a survey now that it knows later ones; the first value stays in the path.

        Returns the list unchanged where it has no such survey (uuid) or a newer revision; a person decides about it.

        Raises
        ------
        ValueError
            A value of the survey is not finite or out of range.
        """
        survey = checked_survey(survey)
        old = next((r for r in self.records if r.survey.uuid == survey.uuid), None)
        if old is None or any(one.revision >= survey.revision for one in old.revised):
            return self
        record = dataclasses.replace(old, revised=(dataclasses.replace(survey, sequence=old.survey.sequence),))
        return self._with([record if r is old else r for r in self.records])

    def remark(self, sequence: int, comment: str) -> SurveyList:
        """Return the list with another comment at a survey; ValueError where there is none."""
        old = self.find(sequence)
        return self._with([dataclasses.replace(r, comment=comment) if r is old else r for r in self.records])

    def tied_on(self, tie_on: TieOn, leg: str | None = None) -> SurveyList:
        """
        Return the list with another tie-on of a leg.

        Raises
        ------
        ValueError
            A value is not finite or out of range, stations in use lie above it, or no such leg.
        """
        there = self.find_leg(leg)
        tie_on = settings.from_mapping(TieOn, settings.to_mapping(tie_on), "tie_on")
        mc.checked_stations([tie_on.measured_depth], [tie_on.inclination], [tie_on.azimuth])
        above = [r.survey.sequence for r in in_use_on(self, there.name) if r.measured_depth <= tie_on.measured_depth]
        if above:
            raise ValueError(f"tie_on: surveys {above} of leg {there.name!r} lie at or above {tie_on.measured_depth} m")
        legs = tuple(dataclasses.replace(g, tie_on=tie_on) if g is there else g for g in self.legs)
        # A reader's assumption about the start of the path ends where a person gives the start.
        remarks = self.remarks if there.parent else tuple(one for one in self.remarks if one.kind not in OF_START)
        return dataclasses.replace(self, legs=legs, remarks=remarks)._with(self.records)

    def sidetracked(self, name: str, measured_depth: float, parent: str | None = None) -> SurveyList:
        """
        Return the list with a new current leg that leaves a leg at a measured depth on its path.

        Raises
        ------
        ValueError
            The name is empty or taken, or the depth is not on the parent's path.
        """
        source = self.find_leg(parent)
        if not name or any(g.name == name for g in self.legs):
            raise ValueError(f"name: a new leg needs a name of its own, got {name!r}")
        inc, azi, position = self.definitive(source.name).at(measured_depth)
        n, e, d = (float(v) for v in position)
        tie_on = TieOn(measured_depth, inc, azi, n, e, d, Origin.LEG)
        return dataclasses.replace(self, legs=(*self.legs, Leg(name, tie_on, source.name)), leg=name)

    def using(self, *, leg: str | None = None, tool: str | None = None) -> SurveyList:
        """Return the list with another current leg (which must exist) or tool for the surveys to come."""
        return dataclasses.replace(self, leg=self.find_leg(leg).name, tool=self.tool if tool is None else tool)

    def configured(self, well: Well, rules: ListRules) -> SurveyList:
        """
        Return the same stations with another well and other rules; stations in use stay in use.

        Raises
        ------
        ValueError
            The well names another north and a tie-on or a station in use has none from there.
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
        return changed._with(self.records)

    def along(self, plan: Plan | None) -> SurveyList:
        """Return the same stations with another plan, or without a plan."""
        return self if plan == self.plan else dataclasses.replace(self, plan=plan)._with(self.records)

    def to_mapping(self) -> dict[str, Any]:
        """Return everything but the rules as a plain table for a file."""
        table = settings.to_mapping(dataclasses.replace(self, plan=None))
        table.pop("rules")
        return {**table, "plan": None if self.plan is None else self.plan.to_mapping()}

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], rules: ListRules | None = None) -> SurveyList:
        """
        Return the list of such a table.

        Raises
        ------
        ValueError
            A key or value that does not belong there (settings.SettingsError), or a path that cannot be computed.
        """
        planned = table.get("plan")
        plan = None if planned is None else Plan.from_mapping(planned)
        plain = settings.from_mapping(cls, {**table, "plan": plan, "rules": settings.to_mapping(rules or ListRules())})
        plain.find_leg(plain.leg)
        return plain._with(plain.records)

    def find_leg(self, name: str | None = None) -> Leg:
        """
        Return a leg by its name (by default the current one).

        Raises
        ------
        ValueError
            There is none; the message lists those there are.
        """
        wanted = self.leg if name is None else name
        for leg in self.legs:
            if leg.name == wanted:
                return leg
        raise ValueError(f"leg: there is no {wanted!r}; there are {', '.join(repr(g.name) for g in self.legs)}")

    def _with(self, records: Iterable[SurveyRecord], changed_ns: int | None = None) -> SurveyList:
        """Return the list with other records, in order, and everything that follows from them."""
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
        """Return the list with each sidetrack starting on the path of its parent, where that still gets there."""
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


def _rejected(record: SurveyRecord, operator_name: str, reason: str, stamp_ns: int) -> SurveyRecord:
    judged = _judged(record, Judgement.REJECTED, operator_name, reason, stamp_ns)
    return dataclasses.replace(judged, in_use=False)


def _judged(record: SurveyRecord, judgement: Judgement, who: str, reason: str, stamp_ns: int) -> SurveyRecord:
    """Return the record with a decision in force, which joins those before."""
    decision = Decision(int(judgement), who, reason, stamp_ns, record.measured_depth)
    return dataclasses.replace(
        record,
        judgement=int(judgement),
        operator_name=who,
        reason=reason,
        judged_ns=stamp_ns,
        decisions=(*record.decisions, decision),
        decided_revision=max((one.revision for one in record.revised), default=0),
    )


def _checked_depth(measured_depth: float, depth_age: float) -> None:
    if measured_depth < 0.0 or measured_depth > DEEPEST:
        raise ValueError(f"measured_depth: must be within 0 and {DEEPEST:g} m, got {measured_depth:g}")
    if depth_age < 0.0 or depth_age == math.inf:
        raise ValueError(f"depth_age: must be 0 s or more, got {depth_age}")


def _checked_operator(name: str) -> None:
    if not name.strip():
        raise ValueError("operator_name: must not be empty: the log says who decided")
    if fault := settings.unprintable(name):
        raise ValueError(f"operator_name: {fault}")

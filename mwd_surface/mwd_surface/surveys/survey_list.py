"""
The survey list of a well: what was measured, what quality control said, what people decided, and the path it gives.

A list is a value: every operation returns a new one or raises `ValueError` and leaves the old one as it was. Automatic
verdict and human judgement stay side by side; nothing measured is ever dropped. Depth, once given, decides the order:
a station at a depth already taken, or above a deeper one, waits until a person accepts it explicitly.

Units are SI and rad; azimuths and map axes of the path refer to the north that the well names.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.settings import setting
from mwd_surface.surveys.survey_record import Judgement, North, Survey, SurveyRecord, Verdict, checked_survey
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive, path_of, projected

MAIN = "main"


@dataclasses.dataclass(frozen=True)
class ListRules:
    """When a survey goes into the definitive list by itself, and what is pointed out."""

    automatic: bool = setting(True, "use a survey that quality control accepts without waiting for a person")
    same_depth: float = setting(0.5, "closer in measured depth than this is the same depth", unit="m", low=0.01)
    depth_age_limit: float = setting(30.0, "an older depth needs a person's acceptance", unit="s", low=0.1)
    gap_limit: float = setting(60.0, "a longer interval between stations is pointed out", unit="m", low=1.0)
    dogleg_limit_deg: float = setting(10.0, "a sharper dogleg is pointed out", unit="deg/30 m", low=0.1)
    vertical_limit_deg: float = setting(
        1.0, "below this inclination a station without azimuth is used with the azimuth of the one above",
        unit="deg", low=0.0, high=5.0,
    )  # fmt: skip
    projection: str = setting(
        "straight", "how the path goes on from the last station to the bit", choices=("straight", "curve")
    )


@dataclasses.dataclass(frozen=True)
class TieOn:
    """Where a leg starts: a station that is taken as given. m and rad, in the north of the well."""

    measured_depth: float = 0.0
    inclination: float = 0.0
    azimuth: float = 0.0
    north: float = 0.0
    east: float = 0.0
    vertical_depth: float = 0.0
    source: str = "wellhead"


@dataclasses.dataclass(frozen=True)
class Leg:
    """A stretch of hole with its own stations; a sidetrack names the leg it leaves."""

    name: str = MAIN
    tie_on: TieOn = dataclasses.field(default_factory=TieOn)
    parent: str = ""


@dataclasses.dataclass(frozen=True)
class SurveyList:
    """The whole list, in order of measured depth within each leg; see the module for its law."""

    well: Well = dataclasses.field(default_factory=Well)
    rules: ListRules = dataclasses.field(default_factory=ListRules)
    legs: tuple[Leg, ...] = (Leg(),)
    records: tuple[SurveyRecord, ...] = ()
    leg: str = MAIN
    tool: str = ""
    changed_ns: int = 0

    @property
    def north(self) -> North:
        """The north of azimuths and map axes."""
        return North[self.well.north_reference.upper()]

    @property
    def next_sequence(self) -> int:
        """The number after the highest in the list."""
        return 1 + max((r.survey.sequence for r in self.records), default=0)

    def find(self, sequence: int) -> SurveyRecord:
        """
        The record of a survey number.

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
        The path of a leg (the current one), through its parents up to the wellhead.

        bit_depth: m; where it is deeper than the last station the path is projected to it and marked so.

        Raises
        ------
        ValueError
            No such leg.
        """
        return _definitive(self, self._leg(leg), [r for r in self.records if r.in_use], bit_depth)

    def add(
        self,
        survey: Survey,
        measured_depth: float = -1.0,
        depth_age: float = -1.0,
        *,
        leg: str | None = None,
        tool: str | None = None,
        comment: str = "",
    ) -> SurveyList:
        """
        Take a survey into the list, and into the path if the rules allow it without a person.

        Parameters
        ----------
        survey : Survey
            One already there (same uuid) changes nothing. A number already taken by another survey, as after a tool
            that lost its memory, becomes the next free one; the comment says so.
        measured_depth, depth_age : float
            Of the sensor at the survey, m, and how old that reading was, s; -1 unknown.
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
        if any(r.survey.sequence == survey.sequence for r in self.records):
            comment = f"{comment}; ".lstrip("; ") + f"numbered {survey.sequence} by the tool"
            survey = dataclasses.replace(survey, sequence=self.next_sequence)
        record = SurveyRecord(
            survey,
            measured_depth,
            depth_age,
            leg=self._leg(leg).name,
            tool=self.tool if tool is None else tool,
            comment=comment,
        )
        allowed = self.rules.automatic and survey.verdict == Verdict.ACCEPT and not self._obstacles(record)
        record = dataclasses.replace(record, in_use=allowed)
        return self._with((*self.records, record), max(survey.stamp_ns, self.changed_ns))

    def accept(
        self,
        sequence: int,
        operator_name: str,
        reason: str,
        stamp_ns: int,
        *,
        measured_depth: float = -1.0,
        replace: bool = False,
    ) -> SurveyList:
        """
        Put a survey into the path on a person's word, whatever its automatic verdict; both are kept.

        Parameters
        ----------
        sequence : int
            Number of the survey.
        operator_name, reason : str
            Who and why. The name must not be empty.
        stamp_ns : int
            When, ns.
        measured_depth : float
            Depth to give it, m; -1 keeps what it has.
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
        record = dataclasses.replace(
            old, judgement=int(Judgement.ACCEPTED), operator_name=operator_name, reason=reason, judged_ns=stamp_ns
        )
        if measured_depth != -1.0:
            _checked_depth(measured_depth, 0.0)
            note = f"depth {measured_depth:.2f} m given by hand"
            comment = f"{old.comment}; {note}" if old.comment else note
            record = dataclasses.replace(record, measured_depth=measured_depth, depth_age=0.0, comment=comment)
        fatal = self._fatal(record)
        if fatal:
            raise ValueError(f"survey {sequence} cannot be used: {'; '.join(fatal)}")
        conflicts = self._conflicts(record)
        if conflicts and not replace:
            raise ValueError(f"survey {sequence} needs an explicit replacement: {'; '.join(conflicts)}")
        same = {r.survey.uuid for r in self._rivals(record)}
        loser = f"replaced by survey {sequence}" + (f": {reason}" if reason else "")
        records = [
            dataclasses.replace(record, in_use=True)
            if r.survey.uuid == record.survey.uuid
            else dataclasses.replace(
                r,
                in_use=False,
                judgement=int(Judgement.REJECTED),
                operator_name=operator_name,
                reason=loser,
                judged_ns=stamp_ns,
            )
            if r.survey.uuid in same
            else r
            for r in self.records
        ]
        return self._with(records, stamp_ns)

    def reject(self, sequence: int, operator_name: str, reason: str, stamp_ns: int) -> SurveyList:
        """
        Take a survey out of the path on a person's word; it stays in the list.

        Raises
        ------
        ValueError
            No operator or no such survey.
        """
        old = self.find(sequence)
        _checked_operator(operator_name)
        record = dataclasses.replace(
            old,
            judgement=int(Judgement.REJECTED),
            operator_name=operator_name,
            reason=reason,
            judged_ns=stamp_ns,
            in_use=False,
        )
        return self._with([record if r is old else r for r in self.records], stamp_ns)

    def remark(self, sequence: int, comment: str) -> SurveyList:
        """The list with another comment at a survey; ValueError where there is none."""
        old = self.find(sequence)
        return self._with([dataclasses.replace(r, comment=comment) if r is old else r for r in self.records])

    def tied_on(self, tie_on: TieOn, leg: str | None = None) -> SurveyList:
        """
        The list with another start of a leg.

        Raises
        ------
        ValueError
            A value is not finite or out of range, stations in use lie above it, or no such leg.
        """
        there = self._leg(leg)
        tie_on = settings.from_mapping(TieOn, settings.to_mapping(tie_on), "tie_on")
        mc.checked_stations([tie_on.measured_depth], [tie_on.inclination], [tie_on.azimuth])
        above = [r.survey.sequence for r in self._used(there.name) if r.measured_depth <= tie_on.measured_depth]
        if above:
            raise ValueError(f"tie_on: surveys {above} of leg {there.name!r} lie at or above {tie_on.measured_depth} m")
        legs = tuple(dataclasses.replace(g, tie_on=tie_on) if g is there else g for g in self.legs)
        return dataclasses.replace(self, legs=legs)._with(self.records)

    def sidetracked(self, name: str, measured_depth: float, parent: str | None = None) -> SurveyList:
        """
        The list with a new leg, now the current one, that leaves a leg at a measured depth on its path.

        Raises
        ------
        ValueError
            The name is empty or taken, or the depth is not on the parent's path.
        """
        source = self._leg(parent)
        if not name or any(g.name == name for g in self.legs):
            raise ValueError(f"name: a new leg needs a name of its own, got {name!r}")
        inc, azi, position = self.definitive(source.name).at(measured_depth)
        n, e, d = (float(v) for v in position)
        tie_on = TieOn(measured_depth, inc, azi, n, e, d, f"leg {source.name}")
        return dataclasses.replace(self, legs=(*self.legs, Leg(name, tie_on, source.name)), leg=name)

    def using(self, *, leg: str | None = None, tool: str | None = None) -> SurveyList:
        """The list with another current leg (which must exist) or tool for the surveys to come."""
        return dataclasses.replace(self, leg=self._leg(leg).name, tool=self.tool if tool is None else tool)

    def configured(self, well: Well, rules: ListRules) -> SurveyList:
        """
        The same stations under another description of the well and other rules; what is in use stays in use.

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
                fatal = changed._fatal(record) if record.in_use else []
                if fatal:
                    raise ValueError(f"north_reference: survey {record.survey.sequence}: {'; '.join(fatal)}")
        return changed._with(self.records)

    def to_mapping(self) -> dict[str, Any]:
        """Everything but the rules, as a plain table for a file."""
        table = settings.to_mapping(self)
        table.pop("rules")
        return table

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], rules: ListRules | None = None) -> SurveyList:
        """
        The list of such a table.

        Raises
        ------
        ValueError
            A key or value that does not belong there (settings.SettingsError), or a path that cannot be computed.
        """
        plain = settings.from_mapping(cls, {**table, "rules": settings.to_mapping(rules or ListRules())})
        plain._leg(plain.leg)
        return plain._with(plain.records)

    def _leg(self, name: str | None) -> Leg:
        wanted = self.leg if name is None else name
        for leg in self.legs:
            if leg.name == wanted:
                return leg
        raise ValueError(f"leg: there is no {wanted!r}; there are {', '.join(repr(g.name) for g in self.legs)}")

    def _used(self, leg: str) -> list[SurveyRecord]:
        return [r for r in self.records if r.leg == leg and r.in_use]

    def _rivals(self, record: SurveyRecord) -> list[SurveyRecord]:
        """Stations in use at the same depth of the same leg."""
        return [
            r
            for r in self._used(record.leg)
            if r.survey.uuid != record.survey.uuid
            and abs(r.measured_depth - record.measured_depth) < self.rules.same_depth
        ]

    def _fatal(self, record: SurveyRecord) -> list[str]:
        """Why nobody can put the record into the path as it stands."""
        if record.measured_depth < 0.0:
            return ["no measured depth"]
        why = []
        tie_on = self._leg(record.leg).tie_on
        if record.measured_depth <= tie_on.measured_depth:
            why.append(f"at {record.measured_depth:.2f} m it is not below the tie-on at {tie_on.measured_depth:.2f} m")
        if record.survey.azimuth_from(self.north) is None and not _is_vertical(record, self.rules):
            have = North(record.survey.north).name.lower()
            why.append(
                f"its azimuth is from {have} north and nothing turns it to {self.well.north_reference} north"
                if record.survey.has_azimuth
                else "no azimuth"
            )
        return why

    def _conflicts(self, record: SurveyRecord) -> list[str]:
        """What only an explicit replacement may set aside."""
        rivals = self._rivals(record)
        why = [f"duplicate depth: survey {r.survey.sequence} is at {r.measured_depth:.2f} m" for r in rivals]
        deeper = [
            r
            for r in self._used(record.leg)
            if r.measured_depth > record.measured_depth
            and r.survey.stamp_ns < record.survey.stamp_ns
            and r not in rivals
        ]
        if deeper and not record.in_use:
            last = max(deeper, key=lambda r: r.measured_depth)
            why.append(f"decreasing depth: survey {last.survey.sequence} is deeper, at {last.measured_depth:.2f} m")
        return why

    def _obstacles(self, record: SurveyRecord) -> list[str]:
        """Why the record does not go into the path by itself, apart from its verdict."""
        why = self._fatal(record)
        if record.measured_depth < 0.0:
            return why
        why += [*_age_flag(record, self.rules), *self._conflicts(record)]
        if not why:
            try:
                _definitive(self, self._leg(record.leg), [*(r for r in self.records if r.in_use), record], None)
            except ValueError as error:
                why.append(str(error))
        return why

    def _with(self, records: Iterable[SurveyRecord], changed_ns: int | None = None) -> SurveyList:
        """Other records, in order, with everything that follows from them computed anew."""
        order = {leg.name: k for k, leg in enumerate(self.legs)}
        ordered = sorted(records, key=lambda r: (order.get(r.leg, -1), r.measured_depth, r.survey.sequence))
        strangers = sorted({r.leg for r in ordered} - set(order))
        if strangers:
            raise ValueError(f"records: legs {strangers} do not exist")
        fresh = dataclasses.replace(
            self, records=tuple(ordered), changed_ns=self.changed_ns if changed_ns is None else changed_ns
        )
        places = {}
        for leg in self.legs:
            path = fresh.definitive(leg.name)
            places.update({(leg.name, s): (path, k) for k, s in enumerate(path.sequence) if s})
        done = tuple(fresh._placed(r, places.get((r.leg, r.survey.sequence))) for r in ordered)
        return dataclasses.replace(fresh, records=done)

    def _placed(self, record: SurveyRecord, place: tuple[Definitive, int] | None) -> SurveyRecord:
        if place is None or not record.in_use:
            bare = dataclasses.replace(
                record,
                in_use=False,
                north=0.0,
                east=0.0,
                vertical_depth=0.0,
                vertical_section=0.0,
                dogleg_severity=0.0,
                build_rate=0.0,
                turn_rate=0.0,
                flags=(),
            )
            # What a person rejected is out for that reason; whether it could be used at all is beside the point.
            flags = [] if record.judgement == Judgement.REJECTED else self._obstacles(bare)
            return dataclasses.replace(bare, flags=tuple(flags))
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
            flags=tuple(self._quality_flags(record, path, k)),
        )

    def _quality_flags(self, record: SurveyRecord, path: Definitive, k: int) -> list[str]:
        flags = _age_flag(record, self.rules)
        if record.survey.azimuth_from(self.north) is None:
            flags.append("no azimuth: that of the station above is used")
        severity = math.degrees(path.dogleg_severity[k]) * 30.0
        if severity > self.rules.dogleg_limit_deg:
            flags.append(f"dogleg {severity:.1f} deg/30 m is over {self.rules.dogleg_limit_deg:g}")
        gap = float(path.md[k] - path.md[k - 1])
        if path.kind[k - 1] != "tie-on" and gap > self.rules.gap_limit:
            flags.append(f"gap {gap:.0f} m is over {self.rules.gap_limit:g}")
        if record.judgement == Judgement.ACCEPTED and record.survey.verdict != Verdict.ACCEPT:
            verdict = Verdict(record.survey.verdict).name.lower()
            flags.append(f"accepted by {record.operator_name} against the automatic verdict {verdict}")
        return flags


def _definitive(whole: SurveyList, leg: Leg, used: list[SurveyRecord], bit_depth: float | None) -> Definitive:
    t = leg.tie_on
    own = sorted((r for r in used if r.leg == leg.name), key=lambda r: r.measured_depth)
    md, inc, azi = [t.measured_depth], [t.inclination], [t.azimuth]
    for record in own:
        azimuth = record.survey.azimuth_from(whole.north)
        md.append(record.measured_depth)
        inc.append(record.survey.inclination)
        azi.append(azi[-1] if azimuth is None else azimuth)
    positions = mc.path(md, inc, azi, (t.north, t.east, t.vertical_depth))
    kind: tuple[str, ...] = ("tie-on", *("survey" for _ in own))
    sequence: tuple[int, ...] = (0, *(r.survey.sequence for r in own))
    columns = np.column_stack([md, inc, azi])
    if leg.parent:
        above = _definitive(whole, whole._leg(leg.parent), used, None)
        keep = int(np.searchsorted(above.md, t.measured_depth, side="left"))
        columns = np.vstack([np.column_stack([above.md, above.inclination, above.azimuth])[:keep], columns])
        positions = np.vstack([above.positions[:keep], positions])
        kind, sequence = above.kind[:keep] + kind, above.sequence[:keep] + sequence
    section_azimuth = math.radians(whole.well.section_azimuth_deg)
    md_all, inc_all, azi_all = columns.T
    path = path_of(leg.name, whole.north, section_azimuth, md_all, inc_all, azi_all, positions, kind, sequence)
    return path if bit_depth is None else projected(path, bit_depth, whole.rules.projection)


def _age_flag(record: SurveyRecord, rules: ListRules) -> list[str]:
    if record.depth_age < 0.0:
        return ["depth age unknown"]
    return [f"depth age {record.depth_age:.0f} s"] if record.depth_age > rules.depth_age_limit else []


def _is_vertical(record: SurveyRecord, rules: ListRules) -> bool:
    return record.survey.inclination <= math.radians(rules.vertical_limit_deg)


def _checked_depth(measured_depth: float, depth_age: float) -> None:
    if measured_depth != -1.0 and not (math.isfinite(measured_depth) and measured_depth >= 0.0):
        raise ValueError(f"measured_depth: must be -1 (unknown) or 0 m and more, got {measured_depth}")
    if depth_age != -1.0 and not (math.isfinite(depth_age) and depth_age >= 0.0):
        raise ValueError(f"depth_age: must be -1 (unknown) or 0 s and more, got {depth_age}")


def _checked_operator(name: str) -> None:
    if not name.strip():
        raise ValueError("operator_name: must not be empty: the log says who decided")

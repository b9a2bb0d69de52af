# SPDX-License-Identifier: Apache-2.0
"""Survey list of a well while drilling: pair surveys with depths, and publish list, path and alarms."""

from __future__ import annotations

import concurrent.futures
from typing import Any

import numpy as np

from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.wire import RIG_VALID
from mwd_surface.exports.survey_table import table_of
from mwd_surface.list_files.remark import RemarkKind, distinct
from mwd_surface.live.alarms import Severity
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.well_context import WellContext
from mwd_surface.logs.depth_log import STEP_M, DepthLog
from mwd_surface.logs.log_journal import LogJournal
from mwd_surface.logs.tool_health import HealthLedger
from mwd_surface.surveys.depth import DepthRules, DepthTrack
from mwd_surface.surveys.mine_hole import branches
from mwd_surface.surveys.station_checks import moved, revision_doubt, revision_flags, revision_sentence, withdrawal
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.trajectory.well_path import Definitive

_BIT_STEP = 0.1  # movement of the bit after which the projection to it is shown again, m
_SHIFT = 0.05  # smallest movement of the path that is mentioned, m

_AGAIN = "and put the surveys.json that it writes into the folder `surveys` of the well while the surface is stopped"
_TIE_ON = (
    "leg.tie_on_depth, leg.tie_on_inclination_deg, leg.tie_on_azimuth_deg, leg.tie_on_north, leg.tie_on_east and"
    " leg.tie_on_vertical_depth"
)
# Kind of assumption about the coordinates of a path -> advice how to replace the assumption by facts.
_REMEDIES = {
    RemarkKind.HOLE_ABOVE_ASSUMED: f"give the last station of the hole above with its position: {_TIE_ON}",
    RemarkKind.TIE_ON_ASSUMED: f"give the tie-on together with its whole position: {_TIE_ON}",
    RemarkKind.NORTH_ASSUMED: f"read the list again, with its north: `mwd path LIST --north NORTH -o DIR`, {_AGAIN}",
    RemarkKind.UNIT_ASSUMED: (
        f"read the list again, with its unit: `mwd path LIST --length-unit UNIT --angle-unit UNIT -o DIR`, {_AGAIN}"
    ),
    RemarkKind.NUMBERS_ASSUMED: (
        f"read the list again, with its decimal mark: `mwd path LIST --decimal point -o DIR`, or comma, {_AGAIN}"
    ),
}


class SurveyBook:
    """
    Survey list of one well, with bit depth, log channels and tool health.

    Parameters
    ----------
    log_step : float
        Depth step of the log channels, m.
    """

    def __init__(
        self,
        context: WellContext,
        plan: PlanMonitor,
        surveys: SurveyList,
        depth: DepthRules,
        log_step: float = STEP_M,
    ) -> None:
        self.depth = DepthTrack(depth)  #: bit depth over time
        self.surveys = surveys  #: the list in force
        #: Log channels over depth.
        self.logs = DepthLog(surveys.well.sensor_offset, log_step, history=depth.history, rules=depth)
        self.health = HealthLedger()  #: account of the tool's health
        self.journal: LogJournal | None = None  #: log samples on disk
        self._clock, self._live = context.clock, context.live
        self._alarm_log, self._outlet = context.alarm_log, context.outlet
        self._plan = plan
        self._covariance: Any = None
        self._path: Definitive = surveys.definitive()
        self._shown_bit: float | None = None
        self._revised: dict[int, str] = {}  # sentences on the stations revised since the last survey, by number

    def definitive(self) -> Definitive:
        """Return the well path, projected to the bit if the bit is deeper than the last station."""
        return self.surveys.definitive(bit_depth=self.bit_depth)

    @property
    def bit_depth(self) -> float | None:
        """Bit depth, m; None until the rig or an operator has given one."""
        return self.depth.latest[1] if self.depth.latest else None

    # Rig data and surveys.

    def on_rig_state(self, samples: Samples) -> float | None:
        """Accept depths of the rig, `wire.RIG_STATE`; return the last depth, m, or None if it was not accepted."""
        accepted = False
        for sample in samples:
            known = bool(sample["valid"] & RIG_VALID["bit_depth"])
            accepted = known and self.depth.update(int(sample["stamp_ns"]), float(sample["bit_depth"]))
            if accepted and self.depth.latest is not None:
                self.logs.add_depth(*self.depth.latest)
        return self.bit_depth if accepted else None

    def set_depth_by_hand(self, stamp_ns: int, bit_depth: float) -> None:
        """
        Accept a bit depth that a person has set, m, for surveys and logs.

        Raises
        ------
        ValueError
            The depth is not finite, negative, or larger than `DepthRules.deepest`.
        """
        self.depth.set_by_hand(stamp_ns, bit_depth)
        self.logs.add_depth(stamp_ns, bit_depth)

    def on_sonde(self, samples: Samples) -> None:
        """Accept the stamps of samples of the sonde, to compare the sonde's clock with the rig's clock."""
        if len(samples):
            self.depth.note_sonde(int(samples["stamp_ns"][-1]))

    def on_survey(self, survey: Survey) -> str:
        """
        Add a survey of the estimator to the list with the depth at its time; return the outcome in words.

        A survey that the list refuses raises an alarm, which ends with the next survey that the list takes; a survey
        that is in the list already changes nothing.
        """
        at = self.depth.sensor_depth(survey.stamp_ns, self.surveys.well.sensor_offset)
        known = any(r.survey.uuid == survey.uuid for r in self.surveys.records)
        try:
            self.replace(self.surveys.add(survey, at.measured_depth, at.depth_age, comment=at.reason))
        except ValueError as error:
            text = f"survey {survey.sequence} was not added to the list: {error}"
            self._alarm_log.raise_alarm("survey.refused", Severity.WARNING, text)
            return text
        record = next(r for r in self.surveys.records if r.survey.uuid == survey.uuid)
        self._alarm_log.clear_alarm("survey.refused")
        self._revised.clear()
        self._alarm_log.set_alarms("survey.revised", {})
        number = f"survey {record.survey.sequence}"
        if known:
            return f"{number} is in the list already"
        words = "in use" if record.in_use else "waits for a decision"
        why = [record.comment, *survey.reasons] if record.comment else survey.reasons
        self._alarm_log.log_event("survey", f"survey {record.survey.sequence} {words}: {'; '.join(why)}")
        if record.in_use:
            self._outlet.on_accepted(record)
        return outcome(survey, record)

    def on_revision(self, survey: Survey) -> None:
        """
        Apply a revised survey of the estimator, and log the changed station and the movement of the path.

        A station that leaves or joins the path, or whose azimuth moved by more than 1 sigma, raises an alarm. A
        revision that the list refuses is only logged; a revision without effect on the list is ignored.
        """
        before = self.surveys
        try:
            surveys = self.surveys.revise(survey)
        except ValueError as error:
            self._alarm_log.log_event("survey", f"the revision of survey {survey.sequence} is not used: {error}")
            return
        if surveys is self.surveys:
            return
        self.replace(surveys)
        old, record = (next(r for r in whole.records if r.survey.uuid == survey.uuid) for whole in (before, surveys))
        north = self.surveys.north
        if record.survey is old.survey:
            text = f"survey {record.survey.sequence}: {'; '.join(revision_flags(record, north))}"
            severity = Severity.WARNING if record.in_use and survey.verdict != Verdict.ACCEPT else Severity.INFO
            self._alarm_log.log_event("survey", text, severity)
            return
        text = revision_sentence(old, record, north)
        shift = self._shift(before) if old.in_use or record.in_use else 0.0
        if shift >= _SHIFT:
            text += f"; the well path moves {shift:.1f} m at the bit"
        self._alarm_log.log_event("survey", text, Severity.WARNING if record.survey.withdrawn else Severity.INFO)
        if record.in_use:
            self._outlet.on_accepted(record)
        if record.survey.withdrawn or (old.in_use == record.in_use and not moved(old.survey, record.survey, north)):
            return
        # A new survey may revise many earlier stations at once: one alarm names them all.
        self._revised[record.survey.sequence] = text
        remedy = "check the plan ahead against the moved path; another value can be accepted in the survey list"
        causes = {"survey.revised": (int(Severity.INFO), "; ".join(self._revised.values()), remedy)}
        self._alarm_log.set_alarms("survey.revised", causes)

    def _shift(self, before: SurveyList) -> float:
        """Return the distance between the paths of an earlier list and this list, at the deepest point, m."""
        lists = (before, self.surveys)
        depth = max(self.bit_depth or 0.0, *(float(one.definitive().md[-1]) for one in lists))
        then, now = (one.definitive(bit_depth=depth).at(depth)[2] for one in lists)
        return float(np.linalg.norm(now - then))

    def _alarm_revisions(self) -> None:
        """Raise an alarm for each contradicted or withdrawn survey until a person has decided about the survey."""
        remedy = (
            "do not steer by either value: take a check shot, then accept one of the two values in the survey list, or"
            " reject the survey"
        )
        doubts = {r.survey.sequence: revision_doubt(r, self.surveys.north) for r in self.surveys.records}
        causes = {
            f"survey.contradicted.{k}": (int(Severity.CRITICAL), text, remedy) for k, text in doubts.items() if text
        }
        self._alarm_log.set_alarms("survey.contradicted.", causes)
        remedy = (
            "do not steer by this survey; act on the reason, take another survey, then reject this survey in the list"
        )
        causes = {
            f"survey.withdrawn.{r.survey.sequence}": (int(Severity.CRITICAL), withdrawal(r), remedy)
            for r in self.surveys.records
            if r.survey.withdrawn and r.judgement == Judgement.NOT_JUDGED
        }
        self._alarm_log.set_alarms("survey.withdrawn.", causes)

    def _alarm_doubt(self) -> None:
        """Raise an alarm while the azimuth of the newest survey is in doubt and nobody has decided about the survey."""
        newest = max(self.surveys.records, key=lambda record: record.survey.stamp_ns, default=None)
        causes = {}
        if newest is not None and newest.azimuth_doubt and newest.judgement == Judgement.NOT_JUDGED:
            severity = Severity.CRITICAL if newest.survey.verdict_azimuth == Verdict.REJECT else Severity.WARNING
            remedy = "act on the reason, or accept or reject the survey in the list"
            causes = {"survey.azimuth": (int(severity), newest.azimuth_doubt, remedy)}
        self._alarm_log.set_alarms("survey.azimuth", causes)

    def _alarm_assumptions(self, path: Definitive) -> None:
        """Raise an alarm while the coordinates of the path depend on an assumption."""
        texts: dict[RemarkKind, list[str]] = {}
        for one in distinct(path.assumptions):
            texts.setdefault(one.kind, []).append(one.text)
        causes = {
            f"path.assumed.{kind}": (
                int(Severity.WARNING),
                f"coordinates are assumed: {'; '.join(said)}",
                _REMEDIES[kind],
            )
            for kind, said in texts.items()
        }
        self._alarm_log.set_alarms("path.assumed.", causes)

    # Publish and show the list and its path.

    def on_list(self, surveys: SurveyList) -> None:
        """Replace the list by a list that a surface node published; give it the plan of this well, if there is one."""
        plan = self._plan.plan
        self.replace(surveys if plan is None else surveys.along(plan))

    def replace(self, surveys: SurveyList) -> None:
        """Put a list in force, and show it if it is another object than the present list."""
        if surveys is not self.surveys:
            self.surveys = surveys
            self.show()

    def show(self) -> None:
        """Show and publish list and path, and compute the covariance in the background."""
        surveys, path = self.surveys, self.definitive()
        self._alarm_doubt()
        self._alarm_revisions()
        self._alarm_assumptions(path)
        self._outlet.on_surveys(surveys, path)
        self._live.show(self._clock.now, surveys=surveys)
        self._covariance, self._shown_bit = None, self.bit_depth
        self._show_path(path)
        made_ns = self._alarm_log.now_ns()
        self._outlet.run(lambda: _uncertain(surveys, path, made_ns), lambda job: self._show_uncertain(surveys, job))

    def _show_path(self, path: Definitive) -> None:
        self._path = path
        self._live.show(self._clock.now, path=path, covariance=self._covariance)
        self._plan.show_offset(path)

    def _show_uncertain(self, surveys: SurveyList, job: concurrent.futures.Future[Any]) -> None:
        covariance, of_hole = job.result()
        if surveys is self.surveys:
            self._live.show(self._clock.now, **of_hole)
        # Show the covariance only of the list in force: a newer list computes its own.
        if covariance is not None and surveys is self.surveys:
            measured = np.isfinite(covariance).all(axis=(1, 2))
            self._covariance = covariance[measured]
            self._live.show(self._clock.now, covariance=self._covariance)

    def update_projection(self) -> None:
        """Show projection and offset from the plan again if the bit has moved by `_BIT_STEP`; called once a second."""
        bit = self.bit_depth
        if bit is None or (self._shown_bit is not None and abs(bit - self._shown_bit) < _BIT_STEP):
            return
        self._shown_bit = bit
        self._show_path(self.definitive())


def _uncertain(surveys: SurveyList, path: Definitive, made_ns: int) -> tuple[Array | None, dict[str, Any]]:
    """
    Return the covariance of a path's positions, (n, 3, 3), m^2, or None, and parts of the state of a mine hole by name.

    The parts are its deviation from the plan, deepest first, its branches, and its closure on a surveyed point.
    """
    table = table_of(surveys, path, made_ns)
    of_mine = surveys.well.angles.points
    return table.covariance, {
        "deviation": tuple(reversed(table.deviations)) if of_mine else (),
        "branches": branches(surveys) if of_mine else (),
        "closure": table.closure,
    }


def outcome(survey: Survey, record: SurveyRecord) -> str:
    """Return number and verdict of a survey in words."""
    return f"survey {record.survey.sequence}: {Verdict(survey.verdict).name.lower()}"

# SPDX-License-Identifier: Apache-2.0
"""
Survey list of a processed recording, equal to the list of the surface node if this program made the recording.

Depths come from a given table, else from the live list (for the same surveys), else from the rig's data. Decisions of
people and revisions are applied in the order in which they were made, if the settings are those of the recording.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_sensors.core.wire import RIG_VALID
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing.bag_input import InputSettings, Topics, namespace_of
from mwd_surface.surveys.depth import DepthReading, DepthTrack
from mwd_surface.surveys.depth_table import read_depths
from mwd_surface.surveys.leg_settings import arranged
from mwd_surface.surveys.recorded_list import Decided, DepthByHand, RecordedList, Revised, recorded_list
from mwd_surface.surveys.recorded_settings import Recorded, SurfacePart
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well

Arrived = tuple[Stamps, Samples]  #: times of messages in a recording, ns, and their samples


class ListBuilder:
    """
    Builder of survey list and depths while a recording is processed once.

    Parameters
    ----------
    topics : Topics
        Topics of the well.
    estimator, given : settings
        Settings in force.
    recorded : Recorded
        Settings in the recording.
    frame : str
        Frame of the tool, which each survey names.
    """

    def __init__(
        self,
        bag: Bag,
        topics: Topics,
        estimator: EstimatorSettings,
        given: InputSettings,
        recorded: Recorded,
        frame: str,
    ) -> None:
        self._bag, self._estimator, self._recorded, self._frame = bag, estimator, recorded, frame
        known_namespace = namespace_of(bag, topics.imu)
        self.namespace = namespace = "/" if known_namespace is None else known_namespace
        self._surface = recorded.surface or SurfacePart()
        self._well = recorded.well(Well(name=namespace.strip("/") or Well().name))
        known = self._well.sensor_to_bit
        #: Distance from sensor to bit, m; None if neither the options nor the recording give it.
        self.sensor_to_bit = known if given.sensor_to_bit_m is None else given.sensor_to_bit_m
        self._table = read_depths(Path(given.depths)) if given.depths else None
        self._live = recorded_list(bag, namespace, self._well) if recorded.surface is not None else RecordedList()
        # The live depth of a survey is kept, unless the options give a table of depths, a topic of the rig, or a
        # distance from sensor to bit that differs from the distance in the recording.
        self._live_depths = not given.depths and not given.rig_topic and self.sensor_to_bit == known
        #: Bit depth of the rig, as passed to `take_rig`, with the corrections of people.
        self.depth = DepthTrack(self._surface.depth)
        self._given_depths = given.depths
        self._rig_topic = topics.rig
        self._live_used = 0
        #: Whether the settings are those of the live list in the recording, so that the same list must result.
        self.as_live = self._live.last is not None and estimator == recorded.estimator
        self._changes = list(self._live.changes)
        self.surveys = SurveyList()  #: the list so far
        self.warnings: list[str] = list(recorded.remarks)
        if self._live.without_events:
            self.warnings.append(
                f"the recording has no operator events ({namespace}operator_events): requested surveys are "
                "not repeated, and only decisions in its survey lists are applied; record this topic"
            )
        self._begun = False

    @property
    def uses_rig(self) -> bool:
        """Whether the depths of the rig are used."""
        return self._table is None

    @property
    def depth_source(self) -> str:
        """Source of the depths, as text."""
        if self._table is not None:
            return f"from the table {self._given_depths}"
        if self._live_used:
            return "from the live list"
        if self._rig_topic is None:
            return "none: the recording has no depths of the rig; give a table of depths with --depths"
        return f"from the rig ({self._rig_topic})"

    def take_rig(self, rig: Arrived, imu: Arrived | None) -> None:
        """
        Accept depths of the rig, `wire.RIG_STATE`, and the IMU samples of the same part of the recording.

        Both come with the log times of their messages, which give the order of arrival.
        """
        if not self.uses_rig:
            return
        log_ns, samples = rig
        before = np.full(len(log_ns), -1) if imu is None else np.searchsorted(imu[0], log_ns, side="right") - 1
        for row, at in zip(samples, before, strict=True):
            if imu is not None and at >= 0:
                self.depth.note_sonde(int(imu[1]["stamp_ns"][at]))
            known = bool(row["valid"] & RIG_VALID["bit_depth"])
            self.depth.update(int(row["stamp_ns"]), float(row["bit_depth"]), known)

    def add(self, survey: DecidedSurvey, log_ns: int | None = None) -> float:
        """
        Add a survey of the estimator to the list; return the measured depth of the sensor, m, nan if unknown.

        log_ns : log time of the survey's last sample. Changes that were made live before the survey was listed are
        applied first.
        """
        if not self._begun:
            self._begin(survey)
        self._take_changes(self._live.arrived_ns.get(survey.uuid, log_ns))
        reading = self._depth_of(survey)
        live = self._live.records.get(survey.uuid)
        listed = self._listed(survey)
        legs = {leg.name for leg in self.surveys.legs}
        leg = live.leg if live is not None and live.leg in legs else None
        tool = live.tool if live is not None else None
        md = reading.measured_depth
        try:
            self.surveys = self.surveys.add(listed, md, reading.depth_age, comment=reading.reason, leg=leg, tool=tool)
        except ValueError as error:
            self.warnings.append(f"survey {survey.sequence} is not in the survey list: {error}")
        return md

    def _listed(self, survey: DecidedSurvey) -> Survey:
        return survey.record(self._frame)

    def _take_changes(self, until_ns: float | None) -> None:
        """
        Apply the depths set by hand that were recorded before a log time, ns; None applies nothing.

        With the settings of the live list, also apply the decisions of people and the revisions before this time.
        """
        while self._changes and until_ns is not None and self._changes[0].log_ns < until_ns:
            change = self._changes.pop(0)
            if isinstance(change, DepthByHand):
                if self.uses_rig:
                    self.depth.set_by_hand(change.stamp_ns, change.bit_depth)
            elif not self.as_live:
                continue
            elif isinstance(change, Revised):
                self.surveys = self.surveys.revise(change.survey)
            else:
                self._decide(change)

    def _decide(self, decided: Decided) -> None:
        try:
            self.surveys = decided.applied(self.surveys, depths=self._live_depths)
        except ValueError as error:
            self.warnings.append(f"the decision of {decided.operator_name} is not applied: {error}")

    def _revise(self, survey: DecidedSurvey) -> None:
        """
        Apply the revised value of a survey, which the estimator gives at the end of the recording.

        A survey that is not in the list is ignored.

        With the settings of the live list, only a withdrawal that is not among the recorded revisions is applied.
        """
        old = next((r for r in self.surveys.records if r.survey.uuid == survey.uuid), None)
        if old is None:
            return
        known = (old.survey, *old.revised)
        if self.as_live and (not survey.withdrawn or any(one.withdrawn for one in known)):
            return
        survey = dataclasses.replace(survey, revision=old.newest_revision + 1)
        self.surveys = self.surveys.revise(self._listed(survey))

    def finish(self, revisions: Sequence[DecidedSurvey] = ()) -> tuple[SurveyList, str]:
        """
        Return the list with the decisions of people, and a text that compares this list with the live list.

        Without a live list the text is empty.

        revisions : revised values of surveys, computed from the whole recording. A live list with the same settings has
        its own revisions; then only withdrawn surveys are used.
        """
        if not self._begun:
            self.surveys = self._empty(dataclasses.replace(self._well, sensor_to_bit=self.sensor_to_bit))
        self._take_changes(math.inf)
        for survey in revisions:
            self._revise(survey)
        if not self._live.records:
            return self.surveys, ""
        if not self.as_live and any(r.judgement for r in self._live.records.values()):
            self.warnings.append("decisions of people in the live list are not applied, because the settings differ")
        # A message has only the last decision about a survey, without the revision that was known at that time.
        told = (dataclasses.replace(r, decisions=r.decisions[-1:], decided_revision=0) for r in self.surveys.records)
        ours = {record.survey.uuid: record for record in told}
        same = sum(ours.get(uuid) == record for uuid, record in self._live.records.items())
        missing = sum(uuid not in ours for uuid in self._live.records)
        text = f"{same} of {len(self._live.records)} surveys equal those of the live list"
        return self.surveys, text + (f", missing here: {missing}" if missing else "")

    def _begin(self, first: DecidedSurvey) -> None:
        """Begin the list like the live list: with its well, legs and plan, and the surveys of earlier recordings."""
        self._begun = True
        well = self._well
        place, recorded = self._estimator.place, self._recorded.estimator
        other_grid = recorded is not None and place.grid != recorded.place.grid
        other_north = recorded is None or self._estimator.survey.north != recorded.survey.north
        if self._recorded.surface is None or other_north or other_grid:
            well = dataclasses.replace(well, north_reference=first.station.north)
        if place.grid != "none" and (recorded is None or other_grid):
            well = dataclasses.replace(well, grid=place.grid)
        if recorded is None or place != recorded.place:
            well = dataclasses.replace(well, latitude_deg=place.lat_deg, longitude_deg=place.lon_deg)
        well = dataclasses.replace(well, sensor_to_bit=self.sensor_to_bit)
        self.surveys = self._empty(well)
        earlier = self._live.before(self._bag.start_ns if self._clock_is_the_recorder_s(first) else first.stamp_ns)
        if earlier:
            legs = {leg.name for leg in self.surveys.legs}
            kept = tuple(r for r in earlier if r.leg in legs)
            table = dataclasses.replace(self.surveys, records=kept).to_mapping()
            self.surveys = SurveyList.from_mapping(table, self._surface.rules)
            self.warnings.append(f"{len(kept)} surveys of earlier recordings are copied from the live list")

    def _empty(self, well: Well) -> SurveyList:
        """Return the list before its first survey: with legs and plan of the live list, else from the settings."""
        bare = SurveyList(well=well, rules=self._surface.rules)
        live = self._live.last
        if live is not None and live.well.north_reference == well.north_reference:
            tool = self._surface.leg.tool
            return dataclasses.replace(bare, legs=live.legs, leg=live.leg, plan=live.plan, tool=tool)
        if live is not None and (live.legs, live.plan) != (bare.legs, None):
            self.warnings.append(
                "legs and plan of the recording are not used, because their azimuths are from "
                f"{live.well.north_reference} north"
            )
            return bare
        try:
            return arranged(bare, self._surface.leg)
        except ValueError as error:
            self.warnings.append(f"the leg of the recording is not used: {error}")
            return bare

    def _clock_is_the_recorder_s(self, first: DecidedSurvey) -> bool:
        return self._bag.start_ns <= first.stamp_ns <= self._bag.end_ns

    def _depth_of(self, survey: DecidedSurvey) -> DepthReading:
        if self._table is not None:
            return self._table.sensor_depth(survey.sequence, survey.stamp_ns, self.sensor_to_bit or 0.0)
        live = self._live.first.get(survey.uuid)
        if live is not None and self._live_depths:
            self._live_used += 1
            return DepthReading(live.measured_depth, live.depth_age, reason=live.comment)
        return self.depth.sensor_depth(survey.stamp_ns, self.sensor_to_bit or 0.0)

# SPDX-License-Identifier: Apache-2.0
"""Advice on steering: computed from plan, path and slide sheet, told to rig systems, shown on the page."""

from __future__ import annotations

import dataclasses

from mwd_surface.live.toolface import MAGNETIC
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.advice import Advice, AdvisorySettings, Known, advise
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import Stretch, yields


class AdviceMonitor:
    """Advice for one well."""

    def __init__(self, context: WellContext) -> None:
        self._live, self._outlet, self._clock = context.live, context.outlet, context.clock
        self._advice: Advice | None = None

    def update(
        self,
        now: float,
        settings: AdvisorySettings,
        plan: Plan | None,
        surveys: SurveyList,
        bit_depth: float | None,
        stretches: tuple[Stretch, ...],
    ) -> None:
        """Tell and show the advice where it has changed; called once a second. now: time, s."""
        path = surveys.definitive(bit_depth=bit_depth)
        reading = self._live.toolface_reading
        magnetic = reading is not None and reading.mode == MAGNETIC
        advice = advise(
            settings, plan, path, yields(stretches, surveys.definitive()), _last_survey(surveys, magnetic=magnetic)
        )
        if advice == self._advice:
            return
        self._advice = advice
        # The page shows the stamp that the message has, as a viewer of its recording does.
        advice = dataclasses.replace(advice, stamp_ns=self._clock.now_ns)
        self._live.show(now, advice=advice)
        self._outlet.on_advice(advice)


def _last_survey(surveys: SurveyList, *, magnetic: bool) -> Known:
    last = max((r for r in surveys.records if r.in_use), key=lambda r: r.survey.stamp_ns, default=None)
    if last is None:
        return Known(magnetic=magnetic)
    survey = last.survey
    return Known(survey.sequence, survey.stamp_ns, survey.sigma_inclination, survey.sigma_azimuth, magnetic)

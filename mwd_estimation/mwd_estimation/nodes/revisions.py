# SPDX-License-Identifier: Apache-2.0
"""
Surveys judged again while the run goes on, on the topic survey/revised: by later surveys, and by faults of sensors.

The judgement of many stations takes a second of computing time and runs in a thread beside the samples.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Callable

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.revision import is_revised
from mwd_estimation.survey.survey import STATIC

# Stations that are judged again after each survey: steel and a gyro that steps show within a few stations. Faults that
# were there from the start reach back to all of the surveys that are kept.
_NEWEST, _KEPT = 30, 1000
# Longest wait for a judgement at the end, s: the node stops within three seconds.
_AT_THE_END_S = 1.5


class LiveRevisions:
    """
    Revisions of the surveys published so far.

    publish: called with each revised survey and the frame of its readings, in the thread of `update`.
    """

    def __init__(self, publish: Callable[[DecidedSurvey, str], None]) -> None:
        self._publish = publish
        self._executor = concurrent.futures.ThreadPoolExecutor(1, "revisions")
        self._job: concurrent.futures.Future[dict[int, DecidedSurvey]] | None = None
        self._waiting: Callable[[], dict[int, DecidedSurvey]] | None = None
        # As it was published first, and as it was revised last.
        self._surveys: dict[int, tuple[DecidedSurvey, DecidedSurvey]] = {}
        self._frame = ""

    def close(self) -> None:
        """Start no further judgement; one under way is completed."""
        self._waiting = None
        self._executor.shutdown(wait=False, cancel_futures=True)

    def take(self, survey: DecidedSurvey, pipeline: Pipeline, frame: str) -> None:
        """Take a survey that was published; the ones before it are judged again."""
        self._surveys[survey.sequence], self._frame = (survey, survey), frame
        while len(self._surveys) > _KEPT:
            del self._surveys[next(iter(self._surveys))]
        if survey.kind == STATIC:
            self.judge_again(pipeline)

    def judge_again(self, pipeline: Pipeline) -> None:
        """Judge all surveys by what the pipeline knows now: call it after a survey, or where a fault has changed."""
        if self._surveys:
            self._waiting = pipeline.judging_again(_NEWEST)

    def finish(self) -> None:
        """Publish what is still to be revised, before the estimator stops."""
        self.update()
        while self._job is not None:
            concurrent.futures.wait([self._job], _AT_THE_END_S)
            if not self._job.done():
                return
            self.update()

    def update(self) -> None:
        """Publish what a finished judgement revised, and begin the one that waits."""
        if self._job is not None and self._job.done():
            job, self._job = self._job, None
            now = job.result()
            # A fault of the sensors that has gone withdraws no survey any more.
            back = {k: first for k, (first, last) in self._surveys.items() if last.withdrawn and k not in now}
            for number, survey in {**back, **now}.items():
                self._revise(number, survey)
        if self._job is None and self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._job = self._executor.submit(waiting)

    def _revise(self, number: int, now: DecidedSurvey) -> None:
        """Publish a revision that differs from what was said of the survey last."""
        if number not in self._surveys:
            return
        first, last = self._surveys[number]
        changed = now.withdrawn != last.withdrawn
        if changed or is_revised(last.station, now.station, now.station.sigma_azimuth):
            survey = dataclasses.replace(now, status=first.status, revision=last.revision + 1)
            self._surveys[number] = first, survey
            self._publish(survey, self._frame)

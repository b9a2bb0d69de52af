# SPDX-License-Identifier: Apache-2.0
"""
Surveys judged again while the run goes on, on the topic survey/revised: what was published first stays.

The judgement of many stations takes a second of computing time and runs in a thread beside the samples.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Callable

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.survey.revision import is_revised
from mwd_estimation.survey.survey import STATIC, Survey

# Stations that are judged again after each survey: steel and a gyro that steps show within a few stations.
_NEWEST = 30


class LiveRevisions:
    """
    Revisions of the surveys published so far.

    publish: called with each revised survey and the frame of its readings, in the thread of `update`.
    """

    def __init__(self, publish: Callable[[Survey, str], None]) -> None:
        self._publish = publish
        self._executor = concurrent.futures.ThreadPoolExecutor(1, "revisions")
        self._job: concurrent.futures.Future[dict[int, Survey]] | None = None
        self._waiting: Callable[[], dict[int, Survey]] | None = None
        # As it was published first, and as it was revised last.
        self._surveys: dict[int, tuple[Survey, Survey]] = {}
        self._frame = ""

    def close(self) -> None:
        """Start no further judgement; one under way is completed."""
        self._waiting = None
        self._executor.shutdown(wait=False, cancel_futures=True)

    def take(self, survey: Survey, pipeline: Pipeline, frame: str) -> None:
        """Take a survey that was published; the ones before it are judged again."""
        if survey.kind != STATIC:
            return
        self._surveys[survey.sequence], self._frame = (survey, survey), frame
        while len(self._surveys) > _NEWEST:
            del self._surveys[next(iter(self._surveys))]
        if len(self._surveys) > 1:
            self._waiting = pipeline.judging_again(_NEWEST)

    def update(self) -> None:
        """Publish what a finished judgement revised, and begin the one that waits."""
        if self._job is not None and self._job.done():
            job, self._job = self._job, None
            for number, survey in job.result().items():
                self._revise(number, survey)
        if self._job is None and self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._job = self._executor.submit(waiting)

    def _revise(self, number: int, now: Survey) -> None:
        """Publish a revision that differs from what was said of the survey last."""
        if number not in self._surveys:
            return
        first, last = self._surveys[number]
        if is_revised(last.station, now.station, now.station.sigma_azimuth):
            survey = dataclasses.replace(now, status=first.status, revision=last.revision + 1)
            self._surveys[number] = first, survey
            self._publish(survey, self._frame)

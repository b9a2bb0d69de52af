# SPDX-License-Identifier: Apache-2.0
"""The actions of the estimator, with their feedback: a north seek, and a survey while the string rotates."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mwd_msgs.action import NorthSeek, RotarySurvey
from mwd_msgs.msg import OperatorEvent
from mwd_msgs.msg import Survey as SurveyMessage

from mwd_estimation.core.reason_text import text
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_sensors.ros.deferred import DeferredGoal

FEEDBACK_PERIOD = 0.5  # interval between feedback messages, s


class EstimatorActions:
    """
    Goals of the estimator's actions, at most one of each; the pipeline does the work.

    pipeline: function that returns the current pipeline. samples_arrive: function that returns whether samples of the
    IMU arrive. tell: function that publishes each request; it is called with the kind and further fields of
    mwd_msgs/msg/OperatorEvent.
    """

    def __init__(
        self, pipeline: Callable[[], Pipeline], samples_arrive: Callable[[], bool], tell: Callable[..., None]
    ) -> None:
        self._pipeline, self._samples_arrive, self._tell = pipeline, samples_arrive, tell
        self._north: DeferredGoal | None = None
        self._rotary: DeferredGoal | None = None

    def start_north_seek(self, goal: DeferredGoal) -> None:
        """Start a north seek, or finish the goal with the reason why a seek is not possible."""
        reason = self._refused(lambda: self._pipeline().request_north(goal.request.duration, goal.request.mode))
        asked = {"duration": goal.request.duration, "mode": goal.request.mode}
        self._tell(OperatorEvent.NORTH_SEEK, success=not reason, message=reason, **asked)
        if reason:
            goal.finish(_no_north(reason))
        else:
            self._north = goal

    def cancel_north_seek(self, goal: DeferredGoal) -> None:
        """Cancel the north seek, and finish its goal."""
        self._cancel_north("cancelled")
        self._north = None
        goal.finish(_no_north("cancelled"))

    def _cancel_north(self, why: str) -> None:
        if self._pipeline().requests.north is not None:
            self._tell(OperatorEvent.CANCEL_NORTH_SEEK, message=why)
        self._pipeline().requests.cancel_north()

    def start_rotary_survey(self, goal: DeferredGoal) -> None:
        """Start a rotary survey, or finish the goal with the reason why a survey is not possible."""
        reason = self._refused(lambda: self._pipeline().requests.start_rotary(goal.request.duration))
        self._tell(OperatorEvent.ROTARY_SURVEY, success=not reason, message=reason, duration=goal.request.duration)
        if reason:
            goal.finish(_no_survey(reason))
        else:
            self._rotary = goal

    def cancel_rotary_survey(self, goal: DeferredGoal) -> None:
        """Cancel the rotary survey, and finish its goal."""
        self._cancel_rotary("cancelled")
        self._rotary = None
        goal.finish(_no_survey("cancelled"))

    def _cancel_rotary(self, why: str) -> None:
        if self._pipeline().requests.rotary_progress is not None:
            self._tell(OperatorEvent.CANCEL_ROTARY_SURVEY, message=why)
        self._pipeline().requests.cancel_rotary()

    def _refused(self, request: Callable[[], Any]) -> str:
        if not self._samples_arrive():
            return "no samples arrive from the sonde"
        try:
            request()
        except ValueError as error:
            return str(error)
        return ""

    def publish_feedback(self) -> None:
        """Publish the progress of the goals; abort them if no more samples arrive."""
        if (self._north is not None or self._rotary is not None) and not self._samples_arrive():
            self.abort("the samples stopped")
            return
        north, rotary = self._pipeline().requests.north, self._pipeline().requests.rotary_progress
        if self._north is not None and north is not None:
            found = north.solution()
            unknown = not (math.isfinite(found.azimuth) and math.isfinite(found.sigma))
            self._north.publish_feedback(
                NorthSeek.Feedback(
                    elapsed=north.elapsed,
                    remaining=north.remaining,
                    azimuth=math.nan if unknown else found.azimuth,
                    sigma=math.nan if unknown else found.sigma,
                    state=f"seeking, {found.method}" if found.reason is None else text(found.reason),
                )
            )
        if self._rotary is not None and rotary is not None:
            self._rotary.publish_feedback(
                RotarySurvey.Feedback(
                    elapsed=rotary.elapsed, remaining=rotary.remaining, samples=rotary.samples, state=rotary.state
                )
            )

    def abort(self, reason: str) -> None:
        """Cancel the requests in the pipeline, and finish every goal without success, for a reason."""
        self._cancel_north(reason)
        self._cancel_rotary(reason)
        if self._north is not None:
            self._north.finish(_no_north(reason))
        if self._rotary is not None:
            self._rotary.finish(_no_survey(reason))
        self._north = self._rotary = None

    def finish_north_seek(self, solution: Solution) -> None:
        """Finish the goal of the north seek, if there is one, with the pipeline's solution."""
        goal, self._north = self._north, None
        if goal is not None:
            goal.finish(_north(solution) if solution.reason is None else _no_north(text(solution.reason)))

    def finish_rotary_survey(self, survey: SurveyMessage | None, words: str) -> None:
        """
        Finish the rotary survey.

        survey: None if no survey was taken. words: verdict, or the reason why no survey was taken.
        """
        goal, self._rotary = self._rotary, None
        if goal is None:
            return
        if survey is None:
            goal.finish(_no_survey(words))
        else:
            goal.finish(RotarySurvey.Result(success=True, message=words, survey=survey))


def _north(solution: Solution) -> NorthSeek.Result:
    azimuth_deg, sigma_deg = math.degrees(solution.azimuth), math.degrees(solution.sigma)
    return NorthSeek.Result(
        success=True,
        message=f"azimuth {azimuth_deg:.2f} +- {sigma_deg:.2f} deg from true north, "
        f"{solution.method}, {solution.elapsed:.0f} s",
        azimuth=solution.azimuth,
        sigma=solution.sigma,
        method=solution.method,
    )


def _no_north(reason: str) -> NorthSeek.Result:
    return NorthSeek.Result(success=False, message=f"no north found: {reason}", azimuth=math.nan, sigma=math.nan)


def _no_survey(reason: str) -> RotarySurvey.Result:
    return RotarySurvey.Result(success=False, message=f"no survey taken: {reason}")

"""The estimator's actions: north sought, and a survey taken while the string turns, with progress until the result."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mwd_msgs.action import NorthSeek, RotarySurvey
from mwd_msgs.msg import Survey as SurveyMessage

from mwd_estimation.core.reason_text import text
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.nodes.messages import known
from mwd_estimation.pipeline import Pipeline
from mwd_sensors.ros.lifecycle_node import Errand

# s between two words of progress.
PERIOD = 0.5


class Errands:
    """
    At most one goal of each action; the pipeline does the work.

    Parameters
    ----------
    pipeline : callable
        Gives the one in force.
    hears : callable
        Whether samples arrive.
    """

    def __init__(self, pipeline: Callable[[], Pipeline], hears: Callable[[], bool]) -> None:
        self._pipeline, self._hears = pipeline, hears
        self._north: Errand | None = None
        self._rotary: Errand | None = None

    def seek_north(self, errand: Errand) -> None:
        """Begin, or say why not."""
        why = self._refused(lambda: self._pipeline().request_north(errand.goal.duration, errand.goal.mode))
        if why:
            errand.finish(_no_north(why))
        else:
            self._north = errand

    def cancel_north(self, errand: Errand) -> None:
        """Stop seeking."""
        self._pipeline().cancel_north()
        self._north = None
        errand.finish(_no_north("cancelled"))

    def take_rotary(self, errand: Errand) -> None:
        """Begin, or say why not."""
        why = self._refused(lambda: self._pipeline().request_rotary(errand.goal.duration))
        if why:
            errand.finish(RotarySurvey.Result(success=False, message=f"no survey taken: {why}"))
        else:
            self._rotary = errand

    def cancel_rotary(self, errand: Errand) -> None:
        """Stop averaging."""
        self._pipeline().cancel_rotary()
        self._rotary = None
        errand.finish(RotarySurvey.Result(success=False, message="no survey taken: cancelled"))

    def _refused(self, ask: Callable[[], Any]) -> str:
        if not self._hears():
            return "no samples arrive from the sonde"
        try:
            ask()
        except ValueError as error:
            return str(error)
        return ""

    def tell(self) -> None:
        """Progress of what is under way; what can come to no end is ended."""
        if (self._north is not None or self._rotary is not None) and not self._hears():
            self.end("the samples stopped")
            return
        north, rotary = self._pipeline().north_progress, self._pipeline().rotary_progress
        if self._north is not None and north is not None:
            self._north.progress(
                NorthSeek.Feedback(
                    elapsed=north.elapsed,
                    remaining=north.remaining,
                    azimuth=known(north.azimuth, 0.0),
                    sigma=known(north.sigma, -1.0),
                    state=north.state,
                )
            )
        if self._rotary is not None and rotary is not None:
            self._rotary.progress(
                RotarySurvey.Feedback(
                    elapsed=rotary.elapsed, remaining=rotary.remaining, samples=rotary.samples, state=rotary.state
                )
            )

    def end(self, why: str) -> None:
        """Nothing will come of what is under way."""
        self._pipeline().cancel_north()
        self._pipeline().cancel_rotary()
        if self._north is not None:
            self._north.finish(_no_north(why))
        if self._rotary is not None:
            self._rotary.finish(RotarySurvey.Result(success=False, message=f"no survey taken: {why}"))
        self._north = self._rotary = None

    def north_found(self, found: Solution) -> None:
        """The seek has ended."""
        errand, self._north = self._north, None
        if errand is not None:
            errand.finish(_north(found) if found.reason is None else _no_north(text(found.reason)))

    def rotary_taken(self, survey: SurveyMessage | None, words: str) -> None:
        """The rotary survey has ended; None: there is none, and why."""
        errand, self._rotary = self._rotary, None
        if errand is None:
            return
        if survey is None:
            errand.finish(RotarySurvey.Result(success=False, message=f"no survey taken: {words}"))
        else:
            errand.finish(RotarySurvey.Result(success=True, message=words, survey=survey))


def _north(found: Solution) -> NorthSeek.Result:
    words = (
        f"azimuth {math.degrees(found.azimuth):.2f} +- {math.degrees(found.sigma):.2f} deg from true north, "
        f"{found.method}, {found.elapsed:.0f} s"
    )
    return NorthSeek.Result(success=True, message=words, azimuth=found.azimuth, sigma=found.sigma, method=found.method)


def _no_north(why: str) -> NorthSeek.Result:
    return NorthSeek.Result(success=False, message=f"no north found: {why}", sigma=-1.0)

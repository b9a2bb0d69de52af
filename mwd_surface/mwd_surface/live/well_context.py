# SPDX-License-Identifier: Apache-2.0
"""Objects that every part of a well shares, and the interface through which a well publishes its results."""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Callable
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.toolface import ToolfaceReading
from mwd_surface.live.well_clock import WellClock
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.slide_sheet import DrilledStretch
from mwd_surface.trajectory.well_path import Definitive


class WellOutlet:
    """
    Receiver of the results of a well.

    The surface node publishes and saves them. This class itself ignores them, for the viewer of a recording.
    """

    def warn(self, text: str) -> None:
        """Log a warning, for example about a message that cannot be decoded."""

    def on_toolface(self, reading: ToolfaceReading, age: float, frame: str) -> None:
        """Accept a new toolface; age: age of the word that it comes from, s; frame: frame name of the attitude."""

    def on_inputs(self, table: InputTable) -> None:
        """Accept clocks and ages of the inputs, once a second."""

    def on_advice(self, advice: Advice) -> None:
        """Accept changed advice."""

    def on_stretch(self, stretch: DrilledStretch) -> None:
        """Accept an interval of the slide sheet that has ended."""

    def on_accepted(self, record: SurveyRecord) -> None:
        """Accept a survey that is now in use."""

    def on_surveys(self, surveys: SurveyList, path: Definitive) -> None:
        """Accept the changed survey list, and the well path computed from it."""

    def on_alarms(self, log: AlarmLog, missing: tuple[str, ...], stamp_ns: int) -> None:
        """Accept changed alarms and events; missing: kinds of alarms that are not evaluated, in words."""

    def on_rig_state(self, samples: Samples) -> None:
        """Accept rig data of the source in force, `wire.RIG_STATE`, unchanged."""

    def is_simulated(self) -> bool:
        """Return whether a simulator makes the data."""
        return False

    def readings(self) -> dict[str, float]:
        """Return the state of the recorder's queue and of the disk for `supervision.TABLE`; empty for a recording."""
        return {}

    def run(self, job: Callable[[], Any], done: Callable[[concurrent.futures.Future[Any]], None]) -> None:
        """Run slow work and call `done` with its future; this class runs the work at once, the node in a thread."""
        future: concurrent.futures.Future[Any] = concurrent.futures.Future()
        try:
            future.set_result(job())
        except Exception as error:  # noqa: BLE001  (as in a thread: the error is raised where the result is read)
            future.set_exception(error)
        done(future)


@dataclasses.dataclass(frozen=True)
class WellContext:
    """Objects that the parts of one well share."""

    clock: WellClock
    live: LiveState  #: state of the well for page and rig interfaces
    alarm_log: AlarmLog
    outlet: WellOutlet = dataclasses.field(default_factory=WellOutlet)

# SPDX-License-Identifier: Apache-2.0
"""Slide sheet of a well: intervals of sliding and rotating drilling with their toolface, and the quill's angle."""

from __future__ import annotations

import time
from typing import Any

from mwd_msgs import msg
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_surface.live.alarms import Severity
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.slide_file import NAME, append_stretch, read_stretches
from mwd_surface.trajectory.slide_sheet import SlideRules, SlideSheet, Stretch, yields

_ON_BOTTOM = 0.5  # m; a bit closer to the end of the hole is drilling
_ROTATING_SPEED = 10.0  # rad/s; stands for a rotary speed of which only is known that it is not zero
_DEPTHS = int(msg.RigState.BIT_DEPTH) | int(msg.RigState.HOLE_DEPTH)


class SlideRecorder:
    """
    Records the slide sheet of one well, in the folder of its survey list.

    Parameters
    ----------
    context : SurfaceContext
        Folder of the well, live state and alarm log.
    rules : SlideRules
        What counts as sliding.
    """

    def __init__(self, context: SurfaceContext, rules: SlideRules) -> None:
        self._file = context.folder / "surveys" / NAME
        self._live, self._alarm_log = context.live, context.alarm_log
        earlier, bad = read_stretches(self._file)
        if bad:
            self._alarm_log.log_event("slide sheet", f"{bad} lines of {self._file} cannot be read", Severity.WARNING)
        self._sheet = SlideSheet(rules, earlier)
        self._surveys = SurveyList()
        self._rotating = False
        self._shown: tuple[Any, ...] = ()

    def stretches(self) -> tuple[Stretch, ...]:
        """Return the intervals recorded so far."""
        return self._sheet.stretches

    def on_surveys(self, surveys: SurveyList) -> None:
        """Take the changed survey list."""
        self._surveys = surveys

    def on_attitude(self, samples: Samples) -> None:
        """Take attitudes, `wire.ATTITUDE`: whether the tool rotates."""
        self._rotating = bool(int(samples[-1]["status"]) & Status.ROTATING)

    def on_rig_state(self, samples: Samples, bit_depth: float | None) -> None:
        """
        Take rig data, `wire.RIG_STATE`.

        bit_depth: accepted bit depth, m; None where there is none, or the last reading was not accepted.
        """
        last = samples[-1]
        valid = int(last["valid"])
        # Without a rotary speed of the rig the attitude still shows whether the string rotates.
        speed = _ROTATING_SPEED if self._rotating else 0.0
        if valid & msg.RigState.ROTARY_SPEED:
            speed = float(last["rotary_speed"])
        if bit_depth is None or valid & _DEPTHS != _DEPTHS or float(last["hole_depth"]) - bit_depth > _ON_BOTTOM:
            self._live.on_log_depth(None)
            return
        self._live.on_log_depth(bit_depth - self._surveys.well.sensor_offset)
        reading = self._live.toolface_reading
        known = reading is not None and reading.sigma >= 0.0
        stretch = self._sheet.update(
            int(last["stamp_ns"]),
            bit_depth,
            speed,
            reading.angle if reading is not None and known else None,
            magnetic=reading is not None and reading.mode == msg.Toolface.MAGNETIC,
        )
        self._keep(stretch)

    def close(self) -> None:
        """Write the current interval to the file; the next start continues from its end."""
        self._keep(self._sheet.finish())

    def _keep(self, stretch: Stretch | None) -> None:
        if stretch is None:
            return
        try:
            append_stretch(self._file, stretch)
        except OSError as error:
            self._alarm_log.raise_alarm("slides.unsaved", Severity.WARNING, f"slide sheet not saved: {error}")
        else:
            self._alarm_log.clear_alarm("slides.unsaved")

    def on_quill(self, data: bytes) -> None:
        """Show the angle of the quill: the first joint of a serialised sensor_msgs/JointState."""
        angles = deserialize_message(data, JointState).position
        if len(angles):
            self._live.on_quill(float(angles[0]), time.monotonic())

    def update(self, now: float) -> None:
        """Show a changed sheet; called once a second. now: steady time, s."""
        stretches = self._sheet.stretches
        state = (len(stretches), stretches[-1:], self._surveys.changed_ns, len(self._surveys.records))
        if state == self._shown:
            return
        self._shown = state
        found = yields(stretches, self._surveys.definitive())
        self._live.on_steering(stretches, found, now)

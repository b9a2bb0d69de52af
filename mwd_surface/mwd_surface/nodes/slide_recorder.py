"""Steering on the graph: slide sheet, depth tracks and quill, from rig data, attitude and what the surveys found."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from mwd_msgs import msg
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.surveys.slide_file import NAME, append_stretch, read_stretches
from mwd_surface.surveys.slide_sheet import SlideRules, SlideSheet, Stretch, yields
from mwd_surface.surveys.survey_list import SurveyList

_ON_BOTTOM = 0.5  # m between bit and end of hole that still is drilling
_TURNS = 10.0  # rad/s; stands for a speed that only is known not to be zero
_DEPTHS = int(msg.RigState.BIT_DEPTH) | int(msg.RigState.HOLE_DEPTH)


class SteeringDesk:
    """
    The slide sheet of one well.

    folder : Path
        The sheet is kept there.
    """

    def __init__(self, folder: Path, rules: SlideRules, live: LiveState, journal: Journal) -> None:
        self._file, self._live, self._journal = folder / NAME, live, journal
        earlier, bad = read_stretches(self._file)
        if bad:
            journal.note("slide sheet", f"{bad} lines of {self._file} cannot be read", Severity.WARNING)
        self._sheet = SlideSheet(rules, earlier)
        self._surveys = SurveyList()
        self._turning = False
        self._told: tuple[Any, ...] = ()

    def stretches(self) -> tuple[Stretch, ...]:
        """The sheet as it stands."""
        return self._sheet.stretches

    def on_surveys(self, surveys: SurveyList) -> None:
        """The survey list changed."""
        self._surveys = surveys

    def on_attitude(self, samples: Samples) -> None:
        """Attitudes, `wire.ATTITUDE`: whether the tool turns."""
        self._turning = bool(int(samples[-1]["status"]) & Status.ROTATING)

    def on_rig_state(self, samples: Samples, bit_depth: float | None) -> None:
        """
        Rig data, `wire.RIG_STATE`.

        bit_depth: the depth that is believed, m; None while none is, or the last reading is not.
        """
        last = samples[-1]
        valid = int(last["valid"])
        # Where the rig's figure is missing the tool knows whether it turns, if not how fast at the top.
        speed = float(last["rotary_speed"]) if valid & msg.RigState.ROTARY_SPEED else _TURNS if self._turning else 0.0
        if bit_depth is None or valid & _DEPTHS != _DEPTHS or float(last["hole_depth"]) - bit_depth > _ON_BOTTOM:
            self._live.on_log_depth(None)
            return
        self._live.on_log_depth(bit_depth - self._surveys.well.sensor_to_bit)
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
        """Put the stretch at hand into the file: the next start goes on from its end."""
        self._keep(self._sheet.finish())

    def _keep(self, stretch: Stretch | None) -> None:
        if stretch is None:
            return
        try:
            append_stretch(self._file, stretch)
        except OSError as error:
            self._journal.alarm("slides.unsaved", Severity.WARNING, f"slide sheet not saved: {error}")
        else:
            self._journal.clear("slides.unsaved")

    def on_quill(self, data: bytes) -> None:
        """Angle of the quill, serialised sensor_msgs/JointState: its first joint."""
        angles = deserialize_message(data, JointState).position
        if len(angles):
            self._live.on_quill(float(angles[0]), time.monotonic())

    def tell(self, now: float) -> None:
        """Bring the sheet to the page; called once a second."""
        stretches = self._sheet.stretches
        state = (len(stretches), stretches[-1:], self._surveys.changed_ns, len(self._surveys.records))
        if state == self._told:
            return
        self._told = state
        found = yields(stretches, self._surveys.definitive())
        self._live.on_steering(stretches, found, now)

# SPDX-License-Identifier: Apache-2.0
"""Slide sheet of a well: intervals of sliding and rotating drilling with their toolface, and the quill's angle."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import RIG_VALID
from mwd_surface.live.toolface import MAGNETIC
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.slide_sheet import SlideRules, SlideSheet, Stretch, yields

_ON_BOTTOM = 0.5  # m; a bit closer to the end of the hole is drilling
_ROTATING_SPEED = 10.0  # rad/s; stands for a rotary speed of which only is known that it is not zero
_DEPTHS = RIG_VALID["bit_depth"] | RIG_VALID["hole_depth"]


class SlideRecorder:
    """
    Makes the slide sheet of one well.

    Parameters
    ----------
    context : WellContext
    rules : SlideRules
        What counts as sliding.
    earlier : iterable of Stretch
        Intervals that were made before, the oldest first.
    """

    def __init__(self, context: WellContext, rules: SlideRules, earlier: Iterable[Stretch] = ()) -> None:
        self._clock, self._live, self._outlet = context.clock, context.live, context.outlet
        self._sheet = SlideSheet(rules, tuple(earlier))
        self._rotating = False
        self._shown: tuple[Any, ...] = ()

    def stretches(self) -> tuple[Stretch, ...]:
        """Return the intervals recorded so far."""
        return self._sheet.stretches

    def on_attitude(self, samples: Samples) -> None:
        """Accept attitudes, `wire.ATTITUDE`: whether the tool rotates."""
        self._rotating = bool(int(samples[-1]["status"]) & Status.ROTATING)

    def on_rig_state(self, samples: Samples, bit_depth: float | None, sensor_to_bit: float) -> None:
        """
        Take rig data, `wire.RIG_STATE`.

        bit_depth: accepted bit depth, m; None where there is none, or the last reading was not accepted.
        sensor_to_bit: m.
        """
        last = samples[-1]
        valid = int(last["valid"])
        # Without a rotary speed of the rig the attitude still shows whether the string rotates.
        speed = _ROTATING_SPEED if self._rotating else 0.0
        if valid & RIG_VALID["rotary_speed"]:
            speed = float(last["rotary_speed"])
        if bit_depth is None or valid & _DEPTHS != _DEPTHS or float(last["hole_depth"]) - bit_depth > _ON_BOTTOM:
            self._live.on_log_depth(None)
            return
        self._live.on_log_depth(bit_depth - sensor_to_bit)
        reading = self._live.toolface_reading
        known = reading is not None and math.isfinite(reading.angle)
        stretch = self._sheet.update(
            int(last["stamp_ns"]),
            bit_depth,
            speed,
            reading.angle if reading is not None and known else None,
            magnetic=reading is not None and reading.mode == MAGNETIC,
        )
        self._keep(stretch)

    def on_depth_by_hand(self) -> None:
        """Count no hole for the step of a depth that a person has set."""
        self._sheet.forget_depth()

    def finish(self) -> None:
        """End the current interval; the next start continues from there."""
        self._keep(self._sheet.finish())

    def _keep(self, stretch: Stretch | None) -> None:
        if stretch is not None:
            self._outlet.on_stretch(stretch)

    def on_quill(self, message: Any) -> None:
        """Show the angle of the quill: the first joint of a sensor_msgs/JointState."""
        if len(message.position) and math.isfinite(message.position[0]):
            self._live.show(self._clock.now, quill=float(message.position[0]) % math.tau)

    def update(self, now: float, surveys: SurveyList) -> None:
        """Show a changed sheet, with the yields between the stations; called once a second. now: time, s."""
        stretches = self._sheet.stretches
        state = (len(stretches), stretches[-1:], surveys.changed_ns, len(surveys.records))
        if state == self._shown:
            return
        self._shown = state
        self._live.show(now, stretches=tuple(stretches), yields=tuple(yields(stretches, surveys.definitive())))

# SPDX-License-Identifier: Apache-2.0
"""Advice on steering: computed from plan, path and slide sheet, published for rig systems, shown on the page."""

from __future__ import annotations

from typing import Any

from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.toolface import MAGNETIC
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.advice import Advice, AdvisorySettings, Known, advise
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import Stretch, yields


class AdviceServer:
    """
    Advice for one well.

    Parameters
    ----------
    context : SurfaceContext
        Node, live state and time.
    """

    def __init__(self, context: SurfaceContext) -> None:
        self._context, self._node, self._live = context, context.node, context.live
        self._advice: Advice | None = None

    def open(self) -> None:
        """Open the topic."""
        self._publisher = self._node.add_publisher(msg.SteeringAdvice, "steering/advice", TOPICS["steering/advice"][1])

    def update(
        self,
        now: float,
        settings: AdvisorySettings,
        plan: Plan | None,
        surveys: SurveyList,
        bit_depth: float | None,
        stretches: tuple[Stretch, ...],
    ) -> None:
        """Publish and show the advice where it has changed; called once a second. now: steady time, s."""
        path = surveys.definitive(bit_depth=bit_depth)
        reading = self._live.toolface_reading
        magnetic = reading is not None and reading.mode == MAGNETIC
        advice = advise(
            settings, plan, path, yields(stretches, surveys.definitive()), _known(surveys, magnetic=magnetic)
        )
        if advice == self._advice:
            return
        self._advice = advice
        self._live.on_advice(advice, now)
        message = advice_message(advice)
        message.header.stamp = stamp(advice.stamp_ns or self._context.now_ns())
        message.header.frame_id = self._node.frame(wire.SONDE_FRAME)
        self._publisher.publish(message)


def _known(surveys: SurveyList, *, magnetic: bool) -> Known:
    last = max((r for r in surveys.records if r.in_use), key=lambda r: r.survey.stamp_ns, default=None)
    if last is None:
        return Known(magnetic=magnetic)
    sigmas = (float(last.survey.sigma_inclination), float(last.survey.sigma_azimuth))
    inclination, azimuth = (sigma if sigma >= 0.0 else None for sigma in sigmas)
    return Known(last.survey.sequence, last.survey.stamp_ns, inclination, azimuth, magnetic)


def advice_message(advice: Advice) -> Any:
    """Message of an advice, without its header."""

    def known(value: float | None) -> float:
        return -1.0 if value is None else value

    return msg.SteeringAdvice(
        mode=int(advice.mode),
        toolface_mode=msg.Toolface.MAGNETIC if advice.magnetic else msg.Toolface.GRAVITY,
        toolface=0.0 if advice.toolface is None else advice.toolface,
        limit=advice.limit,
        sigma=known(advice.sigma),
        confidence=known(advice.confidence),
        from_depth=known(advice.from_depth),
        slide_to_depth=known(advice.slide_to_depth),
        to_depth=known(advice.to_depth),
        valid_for=-1.0,
        dogleg_severity=known(advice.dogleg_severity),
        motor_yield=known(advice.motor_yield),
        survey=advice.survey,
        source=advice.source,
        reason=advice.reason,
    )

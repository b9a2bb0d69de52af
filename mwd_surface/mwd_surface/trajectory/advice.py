# SPDX-License-Identifier: Apache-2.0
"""
Advice on the next interval (slide or rotate, toolface, length) from plan, projected path and slide sheet.

One arc brings the well back to the plan: from the bit to the point of the plan that lies `look_ahead_m` ahead. The
dogleg severity of this arc, divided by the motor's dogleg per metre slid, is the share of the interval to slide;
directional drillers calculate this share in the same way.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import statistics
from collections.abc import Sequence
from typing import ClassVar

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.settings import setting
from mwd_surface.list_files.remark import sentences
from mwd_surface.trajectory.plan import Plan, azimuth_at, nearest, steering_to
from mwd_surface.trajectory.slide_sheet import Yield
from mwd_surface.trajectory.well_path import Definitive

_PER_30_M = math.radians(1.0) / 30.0  # one degree per 30 m, in rad/m
_YIELDS = 3  # number of latest intervals for the motor yield, which changes with formation and wear
_LEAST_AHEAD = 1.0  # shortest part of the plan ahead of the bit with which there is advice, m


class AdviceMode(enum.IntEnum):
    """Mode of an advice, as in mwd_msgs/SteeringAdvice."""

    NONE = 0
    ROTATE = 1
    SLIDE = 2


@dataclasses.dataclass(frozen=True)
class AdvisorySettings:
    """Settings of the steering advice."""

    toolface_deg: float = setting(
        -1.0,
        "Toolface set by the directional driller, used instead of one computed from the plan. Below 0 it is computed.",
        low=-1.0,
        high=360.0,
    )
    limit_deg: float = setting(
        15.0,
        "Largest deviation from the advised toolface that the page shows as good. Raising it hides larger errors.",
        low=1.0,
        high=180.0,
    )
    interval_m: float = setting(28.0, "Length drilled between two decisions, usually a stand.", low=1.0, high=500.0)
    look_ahead_m: float = setting(
        60.0,
        "Distance along the plan at which the well should be back on the plan. Lowering it steers harder and makes "
        "a more tortuous hole.",
        low=5.0,
        high=2000.0,
    )
    least_slide_m: float = setting(
        2.0, "Shortest slide that is worth its set-up time; a shorter one is rotated instead.", low=0.0, high=100.0
    )
    motor_yield_deg_30m: float = setting(
        8.0,
        "Dogleg severity of a slide as specified for the motor, used until the slide sheet has measured it.",
        low=0.1,
        high=60.0,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Advice(MessageRecord):
    """Advice for the next interval, with the fields of mwd_msgs/SteeringAdvice; NaN if unknown."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/SteeringAdvice"

    mode: AdviceMode = AdviceMode.NONE
    #: toolface for mode SLIDE, rad, from the high side, or from north if `magnetic`; NaN for other modes
    toolface: float = math.nan
    toolface_mode: int = 0  #: as in mwd_msgs/Toolface: 0 from the high side, 1 from north
    limit: float = 0.0  #: allowed deviation of the toolface, rad
    #: `sigma`, `confidence`: 1 sigma of the toolface, rad; probability that the needed toolface deviates by less than
    #: `limit`
    sigma: float = math.nan
    confidence: float = math.nan
    #: `from_depth`, `slide_to_depth`, `to_depth`: measured depths of the bit: start, end of the slide, end of the
    #: interval, m
    from_depth: float = math.nan
    slide_to_depth: float = math.nan
    to_depth: float = math.nan
    #: time after `stamp_ns` for which the advice holds, s; NaN: it holds until the interval is drilled
    valid_for: float = math.nan
    #: `dogleg_severity`, `motor_yield`: dogleg severity needed, and dogleg per metre slid, rad/m
    dogleg_severity: float = math.nan
    motor_yield: float = math.nan
    #: `survey`, `stamp_ns`: number and stamp of the survey on which the advice is based, or 0
    survey: int = 0
    stamp_ns: int = 0
    source: str = ""
    reason: str = ""

    @property
    def magnetic(self) -> bool:
        """Whether the toolface is measured from north."""
        return self.toolface_mode == 1


@dataclasses.dataclass(frozen=True)
class AdviceBasis:
    """Survey on which an advice is based: number, stamp, and sigmas, rad, NaN if unknown."""

    survey: int = 0
    stamp_ns: int = 0
    sigma_inclination: float = math.nan
    sigma_azimuth: float = math.nan
    magnetic: bool = False  #: whether the advised toolface is measured from north


def motor_yield(yields: Sequence[Yield]) -> float | None:
    """
    Return the median dogleg per metre slid of the last three intervals with a known yield, rad/m.

    yields: deepest last. None if no interval has a yield above 0.
    """
    measured = [value for value in (one.motor for one in yields) if value is not None and value > 0.0]
    return statistics.median(measured[-_YIELDS:]) if measured else None


def advise(
    settings: AdvisorySettings, plan: Plan | None, path: Definitive, yields: Sequence[Yield], known: AdviceBasis
) -> Advice:
    """
    Return the advice for the next interval.

    path: path, to the bit if the bit depth is known. yields: yields of the surveyed intervals, deepest last. If no
    advice can be computed, for example without a plan or survey, the mode is NONE and `reason` says why.
    """
    limit = math.radians(settings.limit_deg)
    base = Advice(
        limit=limit, toolface_mode=int(known.magnetic), survey=known.survey, stamp_ns=known.stamp_ns, source="plan"
    )
    if settings.toolface_deg >= 0.0:
        wanted = math.radians(settings.toolface_deg) % math.tau
        said = "set by hand"
        return dataclasses.replace(
            base, mode=AdviceMode.SLIDE, toolface=wanted, source="directional driller", reason=said
        )
    if plan is None:
        return dataclasses.replace(base, source="", reason="no plan: set plan.file, or advisory.toolface_deg")
    if len(path.md) < 2:
        return dataclasses.replace(base, reason="no survey is accepted yet")
    if path.assumed:
        why = "; ".join(sentences(path.assumptions))
        return dataclasses.replace(
            base, reason=f"the position is assumed, so no steering to the plan can be computed: {why}"
        )
    return _to_plan(settings, plan, path, yields, known, base)


def _to_plan(
    settings: AdvisorySettings,
    plan: Plan,
    path: Definitive,
    yields: Sequence[Yield],
    known: AdviceBasis,
    base: Advice,
) -> Advice:
    depth, inclination, azimuth = (float(row[-1]) for row in (path.md, path.inclination, path.azimuth))
    here = nearest(plan, path.positions[-1])
    ahead = min(here + settings.look_ahead_m, float(plan.md[-1]))
    if ahead - here < _LEAST_AHEAD:
        return dataclasses.replace(base, reason="the plan ends here")
    _, _, target = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, ahead)
    try:
        arc = steering_to(path.positions[-1], inclination, azimuth, target)
    except ValueError:
        return dataclasses.replace(base, reason="the well has passed the plan: no arc leads back to it from here")
    measured = motor_yield(yields)
    gives = settings.motor_yield_deg_30m * _PER_30_M if measured is None else measured
    interval = settings.interval_m
    slide = interval * arc.dogleg_severity / gives
    advice = dataclasses.replace(
        base, from_depth=depth, to_depth=depth + interval, dogleg_severity=arc.dogleg_severity, motor_yield=gives
    )
    needs = f"{arc.dogleg_severity / _PER_30_M:.1f} deg/30 m needed to be on plan in {ahead - here:.0f} m"
    if slide < settings.least_slide_m:
        return dataclasses.replace(advice, mode=AdviceMode.ROTATE, reason=f"{needs}: too little for a slide")
    words = "motor as specified" if measured is None else "motor as measured"
    if slide > interval:
        words += f", which gives {gives / _PER_30_M:.1f} at most: the well falls behind the plan"
    sigma = _toolface_sigma(arc.toolface, inclination, 0.5 * arc.dogleg_severity * arc.length, known)
    return dataclasses.replace(
        advice,
        mode=AdviceMode.SLIDE,
        # The toolface from north is the toolface from the high side plus the azimuth of the high side.
        toolface=(arc.toolface + (azimuth_at(inclination, azimuth) if known.magnetic else 0.0)) % math.tau,
        sigma=sigma,
        confidence=math.erf(base.limit / (math.sqrt(2.0) * max(sigma, 1e-12))),
        slide_to_depth=depth + min(slide, interval),
        reason=f"{needs}; {words}",
    )


def _toolface_sigma(toolface: float, inclination: float, turn: float, known: AdviceBasis) -> float:
    """
    Return 1 sigma of the steering direction, rad, from the sigmas of the survey; NaN if these are unknown.

    turn: angle from the hole direction to the direction of the target, rad. A survey error across the steering plane
    rotates that plane by the error divided by the turn.
    """
    along_high = math.sin(toolface) * known.sigma_inclination
    along_right = math.cos(toolface) * known.sigma_azimuth * math.sin(inclination)
    return min(math.hypot(along_high, along_right) / max(turn, 1e-12), math.pi)

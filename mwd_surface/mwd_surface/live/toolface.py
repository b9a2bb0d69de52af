# SPDX-License-Identifier: Apache-2.0
"""
Toolface for steering: from the high side, or from north if the hole is too near to vertical for a high side.

The status NEAR_VERTICAL of the estimator selects one of the two. The status has hysteresis, so that the dial does not
alternate, and the dial never shows a gravity toolface that the estimator calls undefined.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import ClassVar

import numpy as np

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.message_record import MessageRecord


class ToolfaceMode(enum.IntEnum):
    """Zero direction of a toolface, with the numbers of mwd_msgs/Toolface: the high side, or north."""

    GRAVITY = 0
    MAGNETIC = 1


GRAVITY, MAGNETIC = ToolfaceMode


@dataclasses.dataclass(frozen=True, eq=False)
class ToolfaceReading(MessageRecord):
    """A toolface, with the fields of mwd_msgs/Toolface except its age."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/Toolface"

    stamp_ns: int
    mode: ToolfaceMode
    #: `angle`, `sigma`: toolface and its 1 sigma, rad, NaN if not available.
    angle: float
    sigma: float
    rotating: bool = False  #: whether the string rotates, or has turned so lately that the toolface is not settled
    rotary_speed: float = 0.0  #: rotary speed of the string, rad/s


class ToolfaceSelector:
    """
    Selector of the gravity or the magnetic toolface, by the status of the attitude.

    Before the first inclination the mode is gravity. The mode is the only state.
    """

    def __init__(self) -> None:
        self.mode: ToolfaceMode = GRAVITY

    def update(self, samples: Samples, rotary_speed: float = 0.0) -> ToolfaceReading | None:
        """
        Return the toolface of the last attitude sample; None without samples.

        samples, shape (n,), have the dtype of `wire.ATTITUDE`; rotary_speed, rad/s, is copied to the result. A toolface
        that is not available has angle and sigma NaN.
        """
        if len(samples) == 0:
            return None
        known = samples[np.isfinite(samples["sigma_inclination"])]
        if len(known):
            self.mode = MAGNETIC if int(known["status"][-1]) & Status.NEAR_VERTICAL else GRAVITY
        last = samples[-1]
        kind = "gravity_toolface" if self.mode == GRAVITY else "magnetic_toolface"
        angle, sigma = float(last[kind]), float(last["sigma_" + kind])
        if not math.isfinite(angle + sigma):
            angle = sigma = math.nan
        rotating = bool(int(last["status"]) & (Status.ROTATING | Status.TOOLFACE_UNSETTLED))
        return ToolfaceReading(int(last["stamp_ns"]), self.mode, angle % math.tau, sigma, rotating, rotary_speed)

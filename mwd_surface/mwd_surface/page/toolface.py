"""
The toolface a driller steers by: from the high side, or from north where the hole is too near vertical for one.

The switch has a threshold and a hysteresis so that the dial does not flip while the inclination hovers about it.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.status import Status
from mwd_sensors.settings import setting
from mwd_sensors.wire import Samples

GRAVITY, MAGNETIC = 0, 1


@dataclasses.dataclass(frozen=True)
class ToolfaceSettings:
    """Where the dial changes from north up to high side up."""

    magnetic_below_deg: float = setting(
        5.0, "below this inclination the toolface counts from north", unit="deg", low=0.0, high=30.0
    )
    hysteresis_deg: float = setting(
        1.0, "further inclination before it counts from the high side again", unit="deg", low=0.0, high=10.0
    )


@dataclasses.dataclass(frozen=True)
class ToolfaceReading:
    """As the Toolface message: mode GRAVITY or MAGNETIC, angle and sigma in rad (sigma -1: not available), rad/s."""

    stamp_ns: int
    mode: int
    angle: float
    sigma: float
    rotating: bool = False
    rotary_speed: float = 0.0


class ToolfaceSelector:
    """
    Picks gravity or magnetic toolface sample by sample; all that changes is the mode in force.

    Before the first inclination the mode is gravity.
    """

    def __init__(self, settings: ToolfaceSettings | None = None) -> None:
        self.settings = settings or ToolfaceSettings()
        self.mode = GRAVITY
        self._decided = False

    def update(self, samples: Samples, rotary_speed: float = 0.0) -> ToolfaceReading | None:
        """
        Reading of the last of some attitude samples; None where there are none.

        samples, shape (n,): `wire.ATTITUDE`. rotary_speed: rad/s, passed through. A toolface that is not available
        has angle 0 and sigma -1.
        """
        if len(samples) == 0:
            return None
        for sample in samples:
            self._switch(float(sample["inclination"]), float(sample["sigma_inclination"]))
        last = samples[-1]
        kind = "gravity_toolface" if self.mode == GRAVITY else "magnetic_toolface"
        angle, sigma = float(last[kind]), float(last["sigma_" + kind])
        if not (math.isfinite(angle) and math.isfinite(sigma) and sigma >= 0.0):
            angle, sigma = 0.0, -1.0
        rotating = bool(int(last["status"]) & Status.ROTATING)
        return ToolfaceReading(int(last["stamp_ns"]), self.mode, angle % math.tau, sigma, rotating, rotary_speed)

    def _switch(self, inclination: float, sigma: float) -> None:
        if not (math.isfinite(inclination) and sigma >= 0.0):
            return
        low = math.radians(self.settings.magnetic_below_deg)
        high = low + math.radians(self.settings.hysteresis_deg) if self._decided else low
        # A hole that goes up has a high side as well, until it is vertical again.
        from_vertical = min(inclination, math.pi - inclination)
        if from_vertical < low:
            self.mode = MAGNETIC
        elif from_vertical >= high:
            self.mode = GRAVITY
        self._decided = True

# SPDX-License-Identifier: Apache-2.0
"""North as a gyrocompass method found it, or the reason why it found none."""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.core.reasons import Reason


@dataclasses.dataclass(frozen=True)
class Solution:
    """A north seek so far."""

    reason: Reason | None  #: why it was refused; None on success
    #: What the tool did: still, two_position or rotating; s1 of `static_ekf`; the mode asked for while that
    #: is unknown.
    method: str
    #: `azimuth`, `sigma`: of the hole axis from true north and its one sigma, rad; given also when refused, NaN before
    #: the filter runs.
    azimuth: float = math.nan
    sigma: float = math.nan
    inclination: float = math.nan  #: of the hole axis from the vertical, rad
    #: Azimuth of the scribe line seen from above, from true north, rad; what a near-vertical hole has instead.
    toolface: float = math.nan
    elapsed: float = 0.0  #: s of data used
    limit: float = math.nan  #: sigma of an ideal estimator with this gyro noise, time, latitude and geometry, rad
    #: Azimuths and sigmas, rad, of which only one can be right, where that is why it was refused.
    choices: tuple[tuple[float, float], ...] = ()
    began_ns: int | None = None  #: stamp at which the seek of a station began, ns; surveys of one seek share it

    @property
    def success(self) -> bool:
        """Whether the azimuth may be used."""
        return self.reason is None

    @property
    def answers(self) -> bool:
        """Whether there is an azimuth that may be used, or several of which one is right."""
        return self.success or bool(self.choices)

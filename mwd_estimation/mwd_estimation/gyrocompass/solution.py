# SPDX-License-Identifier: Apache-2.0
"""Result of a gyrocompass method: the azimuth from true north, and the reason if the azimuth must not be used."""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.core.reasons import Reason


@dataclasses.dataclass(frozen=True)
class Solution:
    """Result of a north seek so far."""

    reason: Reason | None  #: reason why the azimuth is refused; None on success
    #: Motion of the tool: still, two_position or rotating; s1 for `static_ekf`; the requested mode while the motion is
    #: unknown.
    method: str
    #: `azimuth`, `sigma`: azimuth of the hole axis from true north and 1 sigma, rad, even if the azimuth is refused;
    #: NaN before the filter runs.
    azimuth: float = math.nan
    sigma: float = math.nan
    inclination: float = math.nan  #: inclination of the hole axis from the vertical, rad
    #: Azimuth of the scribe line seen from above, from true north, rad; it replaces the azimuth near vertical.
    toolface: float = math.nan
    elapsed: float = 0.0  #: duration of the used data, s
    limit: float = math.nan  #: 1 sigma of an ideal estimator for this gyro noise, time, latitude and geometry, rad
    #: Possible azimuths with their sigmas, rad, if the result is refused because several azimuths fit; one is right.
    choices: tuple[tuple[float, float], ...] = ()
    began_ns: int | None = None  #: stamp at which the seek of a station began, ns; surveys of one seek share it

    @property
    def success(self) -> bool:
        """Whether the azimuth of the seek may be used."""
        return self.reason is None

    @property
    def answers(self) -> bool:
        """Whether the result is a usable azimuth, or several azimuths of which one is right (`choices`)."""
        return self.success or bool(self.choices)

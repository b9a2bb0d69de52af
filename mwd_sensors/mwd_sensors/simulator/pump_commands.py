# SPDX-License-Identifier: Apache-2.0
"""Flow of pumps that obey commands: the scheduled flow times a share that ramps to a command and back to 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mwd_sensors.core.arrays import Array

_KEPT_S = 600.0  # s; history of the share, which pressure and tool flow still ask for


class CommandedFlow:
    """
    Flow of a run whose pumps obey commands.

    Parameters
    ----------
    scheduled : callable
        Flow of the schedule, m^3/s, as a `Profile` returns it. Pumps that the schedule has switched off stay off.
    full : float
        Drilling flow, m^3/s, at which the commanded share is 1.
    ramp_s : float
        Time from no flow to the drilling flow, s.
    """

    def __init__(self, scheduled: Callable[[Array], Array], full: float, ramp_s: float) -> None:
        self._scheduled, self._full, self._rate = scheduled, full, 1.0 / ramp_s
        self._knots: list[tuple[float, float]] = [(0.0, 1.0)]

    def __call__(self, t: Array) -> Array:
        """Return flow, m^3/s, with rate and acceleration, shape (3, n), at ascending times t, s, shape (n,)."""
        found = self._scheduled(t)
        if len(self._knots) > 1:
            found *= self._share(t)
        return found

    def ask(self, time: float, flow: float, valid_for: float) -> None:
        """
        Bring the flow to a value at a time, s.

        valid_for seconds later the flow returns to the schedule, unless another command follows.

        Raises
        ------
        ValueError
            The flow is above the drilling flow, the most that these pumps deliver.
        """
        if not flow <= self._full * (1.0 + 1e-9):
            raise ValueError(f"flow_rate: these pumps give at most {self._full:.4g} m^3/s, got {flow:.4g}")
        share = flow / self._full if self._full > 0.0 else 1.0
        reached = self._ramp(time, share)
        self._ramp(max(time + valid_for, reached), 1.0, follows=True)

    def release(self, time: float) -> None:
        """Return to the scheduled flow from a time on, s."""
        self._ramp(time, 1.0)

    def _ramp(self, time: float, share: float, *, follows: bool = False) -> float:
        """Ramp to a share from a time on, dropping later changes; return the time at which it is reached, s."""
        now = self._knots[-1][1] if follows else float(self._share(np.array([time]))[0])
        if not follows:
            self._knots = [knot for knot in self._knots if time - _KEPT_S < knot[0] < time] or [(time, now)]
        reached = time + abs(share - now) / self._rate
        self._knots += [(time, now), (reached, share)]
        return reached

    def _share(self, t: Array) -> Array:
        times, shares = np.array(self._knots).T
        return np.asarray(np.interp(t, times, shares))

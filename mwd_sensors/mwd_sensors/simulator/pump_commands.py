# SPDX-License-Identifier: Apache-2.0
"""Flow of pumps that obey commands: the schedule's, times a share that ramps to what is asked and back to one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mwd_sensors.core.arrays import Array

_KEPT_S = 600.0  # the past that is still asked for: pressure and the flow in the tool follow the run


class CommandedFlow:
    """
    Flow of a run, whatever its pumps are told.

    Parameters
    ----------
    scheduled : callable
        Flow of the schedule as a `Profile` gives it, m^3/s. Pumps that it has switched off stay off.
    full : float
        Drilling flow, m^3/s; a share of 1 of a command.
    ramp_s : float
        Time from no flow to the drilling flow, s.
    """

    def __init__(self, scheduled: Callable[[Array], Array], full: float, ramp_s: float) -> None:
        self._scheduled, self._full, self._rate = scheduled, full, 1.0 / ramp_s
        self._knots: list[tuple[float, float]] = [(0.0, 1.0)]

    def __call__(self, t: Array) -> Array:
        """Flow, m^3/s, its rate and acceleration at the times t, shape (n,), s, ascending. Returns shape (3, n)."""
        found = self._scheduled(t)
        if len(self._knots) > 1:
            found *= self._share(t)
        return found

    def ask(self, time: float, flow: float, valid_for: float) -> None:
        """
        Bring the flow to a value from a time on, s, and back to the schedule's valid_for later, unless asked again.

        Raises
        ------
        ValueError
            A flow above the drilling flow, which these pumps do not give.
        """
        if not flow <= self._full * (1.0 + 1e-9):
            raise ValueError(f"flow_rate: these pumps give at most {self._full:.4g} m^3/s, got {flow:.4g}")
        share = flow / self._full if self._full > 0.0 else 1.0
        reached = self._ramp(time, share)
        self._ramp(max(time + valid_for, reached), 1.0, follows=True)

    def release(self, time: float) -> None:
        """Bring the flow back to the schedule's from a time on, s."""
        self._ramp(time, 1.0)

    def _ramp(self, time: float, share: float, *, follows: bool = False) -> float:
        """Ramp to a share from a time on; what was to come after it is dropped. Returns when it is reached, s."""
        now = self._knots[-1][1] if follows else float(self._share(np.array([time]))[0])
        if not follows:
            self._knots = [knot for knot in self._knots if time - _KEPT_S < knot[0] < time] or [(time, now)]
        reached = time + abs(share - now) / self._rate
        self._knots += [(time, now), (reached, share)]
        return reached

    def _share(self, t: Array) -> Array:
        times, shares = np.array(self._knots).T
        return np.asarray(np.interp(t, times, shares))

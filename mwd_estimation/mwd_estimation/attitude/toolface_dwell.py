# SPDX-License-Identifier: Apache-2.0
"""
Decide whether a toolface can be used for steering: the string must not have turned about its axis for some time.

In stick-slip the bit stands still for seconds while the top drive keeps turning, and then turns again. A pause
therefore counts as the end of the rotation only if it lasts longer than the pauses of a stick-slip cycle: at least a
fixed time, and at least a multiple of the longest recent cycle.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numpy.typing import NDArray

from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# A longer time between rotations is not a stick-slip cycle, s. The torsional mode of the longest strings has a period
# of 10 s (Jansen and van den Steen 1995).
LONGEST_CYCLE = 30.0
MEMORY = 300.0  # time constant with which the longest cycle decays while the string rotates, s
_ROTATING, _REJECTED, _UNSETTLED = int(Status.ROTATING), int(Status.REJECTED), int(Status.TOOLFACE_UNSETTLED)


class DwellParams(NamedTuple):
    """Settings of the decision whether a toolface can be used."""

    dwell: float = 5.0  #: smallest time without rotation before a toolface can be used, s
    cycles: float = 1.5  #: smallest time without rotation, as a multiple of the longest recent stick-slip cycle


class DwellRecord:
    """State between two blocks of samples."""

    last_ns: int  #: stamp of the last sample used, ns; 0 before the first
    turned_ns: int  #: stamp of the last sample in which the string turned, ns; 0 before the first
    begun_ns: int  #: stamp at which the last rotation began, ns
    turning: bool  #: whether the string turned in the last sample
    angle: float  #: angle turned since `begun_ns`, rad
    cycle: float  #: time between the starts of the previous and the last rotation, s; 0 if unknown or already used
    longest: float  #: longest recent stick-slip cycle, s


RECORD = dtype_of(DwellRecord)


def run(params: DwellParams, state: Samples, stamps: Stamps, track: Track) -> None:
    """
    Set the status bit TOOLFACE_UNSETTLED in the samples of a track whose toolface cannot be used, in place.

    Parameters
    ----------
    state : ndarray of dtype RECORD, shape (1,)
        State, zeros at first, changed in place; the result does not depend on how the samples are cut into blocks.
    stamps : ndarray of int64, shape (n,)
        Stamps, ns.
    track : Track
        Track whose rotary speed and status are read, and whose status is changed.
    """
    _run(params, state, stamps, track.rotary_speed, track.status)


@compiled
def _run(p: DwellParams, state: Samples, stamps: Stamps, rotary_speed: Array, status: NDArray[Any]) -> None:
    s: DwellRecord = state[0]
    for i in range(len(stamps)):
        if status[i] & _REJECTED == 0 and stamps[i] > s.last_ns:
            _follow(s, stamps[i], abs(rotary_speed[i]), status[i] & _ROTATING != 0)
        dwell = max(p.dwell, p.cycles * s.longest)
        if s.turned_ns != 0 and (s.turning or (s.last_ns - s.turned_ns) * 1e-9 < dwell):
            status[i] |= _UNSETTLED


@compiled
def _follow(s: DwellRecord, stamp: int, speed: float, turning: bool) -> None:
    """Update the state with one sample; stamp: ns; speed: rotary speed, rad/s; turning: whether the string turns."""
    if turning and not s.turning:
        s.cycle = (stamp - s.begun_ns) * 1e-9 if s.turned_ns != 0 else 0.0
        s.begun_ns, s.angle = stamp, 0.0
    if turning:
        dt = (stamp - s.last_ns) * 1e-9 if s.turning else 0.0
        s.angle += speed * dt
        s.longest *= math.exp(-dt / MEMORY)
        # Less than a full turn is not stick-slip: a driller who orients the tool turns it by less at a time.
        if s.angle > math.tau and s.cycle > 0.0:
            if s.cycle < LONGEST_CYCLE:
                s.longest = max(s.longest, s.cycle)
            s.cycle = 0.0
        s.turned_ns = stamp
    s.turning, s.last_ns = turning, stamp

# SPDX-License-Identifier: Apache-2.0
"""
Decide when a toolface can be used for steering: when the string has not turned about its axis for some time.

In stick-slip the bit stands still for seconds while the top drive goes on turning, and then turns again. A pause of
the rotation therefore counts as its end only when it has lasted longer than the pauses of a stick-slip cycle: at least
a given time, and a given number of the longest cycles seen lately.
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

LONGEST_CYCLE = 30.0  # s; the torsional mode of the longest strings takes 10 s (Jansen and van den Steen 1995)
MEMORY = 300.0  # time constant with which the longest cycle decays while the string rotates, s
_ROTATING, _REJECTED, _UNSETTLED = int(Status.ROTATING), int(Status.REJECTED), int(Status.TOOLFACE_UNSETTLED)


class Params(NamedTuple):
    """Settings of the decision."""

    dwell: float = 5.0  #: time without rotation before a toolface counts, s
    cycles: float = 1.5  #: the same time as a multiple of the longest stick-slip cycle


class Record:
    """State that is carried from one block of samples to the next."""

    last_ns: int  #: stamp of the last sample used; 0 before the first
    turned_ns: int  #: stamp of the last sample in which the string turned; 0 before the first
    begun_ns: int  #: stamp at which the rotation of `turned_ns` began
    turning: bool  #: whether the string turned in the last sample
    angle: float  #: angle turned since `begun_ns`, rad
    cycle: float  #: time from the begin of the rotation before to that of this one, s; 0: there was none, or it counted
    longest: float  #: longest stick-slip cycle seen lately, s


RECORD = dtype_of(Record)


def run(params: Params, state: Samples, stamps: Stamps, track: Track) -> None:
    """
    Set the status bit TOOLFACE_UNSETTLED in a track of n samples, in place.

    Parameters
    ----------
    params : Params
    state : ndarray of dtype RECORD, shape (1,)
        Zeros at first; changed in place. Blocks of any length give the same bits.
    stamps : ndarray of int64, shape (n,)
        ns.
    track : Track
        Its rotary speed and its status are read.
    """
    _run(params, state[0], stamps, track.rotary_speed, track.status)


@compiled
def _run(p: Params, s: Record, stamps: Stamps, rotary_speed: Array, status: NDArray[Any]) -> None:
    for i in range(len(stamps)):
        if status[i] & _REJECTED == 0 and stamps[i] > s.last_ns:
            _follow(s, stamps[i], abs(rotary_speed[i]), status[i] & _ROTATING != 0)
        dwell = max(p.dwell, p.cycles * s.longest)
        if s.turned_ns != 0 and (s.turning or (s.last_ns - s.turned_ns) * 1e-9 < dwell):
            status[i] |= _UNSETTLED


@compiled
def _follow(s: Record, stamp: int, speed: float, turning: bool) -> None:
    """Follow rotation and pauses over one sample; speed: rad/s."""
    if turning and not s.turning:
        s.cycle = (stamp - s.begun_ns) * 1e-9 if s.turned_ns != 0 else 0.0
        s.begun_ns, s.angle = stamp, 0.0
    if turning:
        dt = (stamp - s.last_ns) * 1e-9 if s.turning else 0.0
        s.angle += speed * dt
        s.longest *= math.exp(-dt / MEMORY)
        # A driller who orients the tool turns it by less than a turn at a time.
        if s.angle > math.tau and s.cycle > 0.0:
            if s.cycle < LONGEST_CYCLE:
                s.longest = max(s.longest, s.cycle)
            s.cycle = 0.0
        s.turned_ns = stamp
    s.turning, s.last_ns = turning, stamp

# SPDX-License-Identifier: Apache-2.0
"""
Triplex mud pumps: flow of three pistons with common pump faults, and the switch that counts strokes.

The flow of a piston is its speed while it delivers (crank and connecting rod). Three pistons 120 deg apart leave a
ripple at 6 times the stroke rate and, with finite rods and unequal pistons, at 1, 2 and 3 times. A leaking valve loses
a share of one piston's delivery. Source: J. E. Miller, The Reciprocating Pump, 1995, chapter 2.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting

_ROD = 0.2  # length of the crank divided by that of the connecting rod


@dataclasses.dataclass(frozen=True)
class Pump:
    """One mud pump."""

    strokes_hz: float = setting(1.5, "Strokes per second (90 per minute is 1.5).", unit="Hz", low=0.1, high=5.0)
    share: float = setting(1.0, "Share of the flow relative to the other pumps.", low=0.01, high=100.0)
    leak: float = setting(0.0, "Share of one piston's delivery that a leaking valve loses.", low=0.0, high=1.0)
    imbalance: float = setting(0.01, "Difference between the deliveries of the pistons.", low=0.0, high=0.5)
    hunting: float = setting(0.0015, "Variation of the stroke rate, 1 sigma, as a share.", low=0.0, high=0.2)
    hunting_s: float = setting(15.0, "Correlation time of this variation.", unit="s", low=0.5, high=600.0)


class PumpStream:
    """
    Flow of one pump, produced block after block.

    Parameters
    ----------
    pump : Pump
    flow : float
        Mean flow of this pump, m^3/s.
    random : numpy Generator
        Random numbers for phase and stroke rate.
    rate_hz : float
        Sample rate, Hz.
    """

    def __init__(self, pump: Pump, flow: float, random: np.random.Generator, rate_hz: float) -> None:
        self._pump, self._flow, self._random, self._rate = pump, flow, random, rate_hz
        self._phase = float(random.uniform())
        self._hunt = np.zeros(1)
        self._samples = 0
        self._strokes: list[Array] = []

    def block(self, flow: Array) -> Array:
        """
        Return the flow of the next samples, m^3/s, shape (n,).

        flow, shape (n,), is the share of the full flow; the pump runs slower for less.
        """
        pump, n = self._pump, len(flow)
        decay = math.exp(-1.0 / (self._rate * pump.hunting_s))
        white = self._random.normal(size=n) * math.sqrt(1.0 - decay**2) * pump.hunting
        hunt, self._hunt = scipy.signal.lfilter([1.0], [1.0, -decay], white, zi=self._hunt)
        rate = pump.strokes_hz * flow * (1.0 + hunt)
        turns = self._phase + np.concatenate([[0.0], np.cumsum(rate) / self._rate])
        whole = np.floor(turns)
        at = np.flatnonzero(whole[1:] > whole[:-1])
        if len(at):
            share = (whole[at + 1] - turns[at]) / (turns[at + 1] - turns[at])
            self._strokes.append((self._samples + at + share) / self._rate)
        self._phase = float(turns[-1] - whole[-1])
        self._samples += n
        return np.asarray(self._delivered(2.0 * math.pi * turns[:-1]) * self._flow * flow)

    def strokes(self) -> Array:
        """Return the times at which the stroke switch closed, s."""
        return np.concatenate(self._strokes) if self._strokes else np.zeros(0)

    def _delivered(self, angle: Array) -> Array:
        """Return the flow of the three pistons divided by its mean, at a crank angle, rad."""
        total = np.zeros(len(angle))
        for k in range(3):
            turn = angle - 2.0 * math.pi * k / 3.0
            speed = np.sin(turn) * (1.0 + _ROD * np.cos(turn))
            delivery = 1.0 + self._pump.imbalance * (k - 1) - (self._pump.leak if k == 0 else 0.0)
            total += np.maximum(speed, 0.0) * delivery
        return np.asarray(total * math.pi / 3.0)

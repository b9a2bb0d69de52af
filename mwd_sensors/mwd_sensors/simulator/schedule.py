# SPDX-License-Identifier: Apache-2.0
"""
The rig's schedule: phases of drilling, sliding and connections as profiles of depth, rotation, pumps and hook.

The sonde's motion and the rig's gauges come from the same profiles, so that depths match the surveys.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.vibration import ENVELOPES

# Kinds of phases.
KINDS = ("drill", "slide", "circulate", "still", "connection", "move")
# Values of `activity` in mwd_msgs/Truth.
STILL, SLIDING, ROTATING, TRIPPING = range(4)


@dataclasses.dataclass(frozen=True)
class SchedulePhase:
    """One phase of the schedule."""

    kind: str = setting("drill", "Kind of work.", choices=KINDS)
    seconds: float = setting(
        10.0, "Duration of the phase; for a connection, the time without motion.", unit="s", low=0.5, high=360000.0
    )
    rpm: float = setting(120.0, "Rotary speed while drilling or circulating.", unit="r/min", low=-600.0, high=600.0)
    rop_m_h: float = setting(
        30.0, "Rate of penetration, or speed of a move (negative: upwards).", unit="m/h", low=-36000.0, high=36000.0
    )
    toolface_deg: float | None = setting(
        None, "Toolface of a slide. Without it the toolface stays as it is.", low=-360.0, high=360.0
    )
    vibration: float = setting(1.0, "Factor on all vibration while drilling or moving.", low=0.0, high=10.0)
    pumps: bool = setting(True, "True if the pumps run while the string stands still or moves.")
    repeat: int = setting(1, "Number of times that the phase runs.", low=1, high=10000)


@dataclasses.dataclass(frozen=True)
class Rig:
    """Properties of the rig."""

    ramp_s: float = setting(3.0, "Time in which rotation or feed changes to a new value.", low=0.0, high=60.0)
    pump_ramp_s: float = setting(2.0, "Time in which the pumps start or stop.", low=0.1, high=120.0)
    running_start: bool = setting(False, "True if the first phase is already under way at time zero.")
    pick_up_m: float = setting(
        0.5, "Distance by which the bit is lifted off bottom before a connection.", low=0.0, high=30.0
    )
    stand_m: float = setting(9.0, "Length of pipe that a connection adds.", low=0.5, high=40.0)
    flow_lpm: float = setting(1200.0, "Flow while drilling.", low=0.0, high=6000.0)
    pressure_bar: float = setting(110.0, "Standpipe pressure at the drilling flow.", low=0.0, high=600.0)
    time_lapse: float = setting(
        1.0,
        "Factor by which the bit advances faster than the rate of penetration, so that hours of drilling pass in "
        "minutes. Rotation and vibration keep their own speed. Above 1 the hole bends faster than any real one.",
        low=1.0,
        high=1000.0,
    )
    string_kn: float = setting(450.0, "Hookload with the string hanging free.", low=1.0, high=5000.0)
    block_kn: float = setting(60.0, "Hookload of the empty hook.", low=0.0, high=1000.0)
    weight_on_bit_kn: float = setting(60.0, "Weight on bit while drilling.", low=0.0, high=1000.0)
    torque_knm: float = setting(8.0, "Torque while drilling with rotation.", unit="kN m", low=0.0, high=200.0)
    bottom_block_m: float = setting(2.0, "Block height at a connection.", low=0.0, high=50.0)


@dataclasses.dataclass(frozen=True)
class Timeline:
    """Schedule of a simulation as functions of time."""

    bit: Profile  #: measured depth of the bit, m
    angle: Profile  #: angle of the string, rad, without vibration
    envelopes: tuple[Profile, ...]  #: one envelope for each name of `vibration.ENVELOPES`
    hole: Profile  #: depth of the hole, that is the greatest bit depth so far, m
    #: `block`, `hookload`, `weight`, `torque`: block position, m; hookload, N; weight on bit, N; torque, N m.
    block: Profile
    hookload: Profile
    weight: Profile
    torque: Profile
    #: Flow, m^3/s, called like a `Profile`; a `CommandedFlow` if the pumps obey commands.
    flow: Callable[[Array], Array]
    #: `slips`, `activity`: in slips, 0 or 1; activity, one of `STILL`, `SLIDING`, `ROTATING`, `TRIPPING`.
    slips: Profile
    activity: Profile
    still: list[tuple[float, float]]  #: intervals without any motion, s
    seconds: float  #: length of the schedule, s

    def active(self, when: str) -> list[tuple[float, float]]:
        """Return the intervals, s, in which the envelope `when`, a name of `ENVELOPES`, is constant and above 0.5."""
        profile = self.envelopes[ENVELOPES.index(when)]
        ends = np.append(profile.starts[1:], self.seconds)
        steady = (profile.terms[:, 0] > 0.5) & (np.abs(profile.terms[:, 1:]).max(axis=1) == 0.0)
        merged: list[tuple[float, float]] = []
        for start, end in zip(profile.starts[steady], ends[steady], strict=True):
            if merged and merged[-1][1] == start:
                merged[-1] = (merged[-1][0], float(end))
            elif end > start:
                merged.append((float(start), float(end)))
        return merged


# Profiles whose value changes smoothly, and profiles whose value switches.
_SMOOTH = ("weight", "torque", "flow", "hookload", *("e_" + name for name in ENVELOPES))
_SWITCHED = ("slips", "activity")
Targets = dict[str, float]


class _Lanes:
    """
    All profiles of a schedule under construction; they all end at the same time.

    A step changes profiles to the values of its targets ("bit_rate" and "angle_rate" are rates); the other profiles
    keep their values.
    """

    def __init__(self, bit_m: float, rig: Rig, angle: float) -> None:
        self.bit, self.angle = ProfileBuilder(bit_m), ProfileBuilder(angle)
        self.hole, self.block = ProfileBuilder(bit_m), ProfileBuilder(rig.bottom_block_m + rig.stand_m)
        self.lanes = {name: ProfileBuilder() for name in (*_SMOOTH, *_SWITCHED)}
        self.lanes["hookload"] = ProfileBuilder(rig.string_kn * 1e3)
        self.lanes["e_always"] = ProfileBuilder(1.0)
        self.still: list[tuple[float, float]] = []

    @property
    def time(self) -> float:
        return self.bit.time

    @property
    def moving(self) -> bool:
        return self.bit.rate != 0.0 or self.angle.rate != 0.0

    def jump(self, targets: Targets) -> None:
        """Set the profiles to their targets at once, for a simulation that starts in the middle of a phase."""
        for name, value in targets.items():
            if name in ("bit_rate", "angle_rate"):
                (self.bit if name == "bit_rate" else self.angle).rate = value
            elif name == "angle":
                self.angle.value = value
            else:
                self.lanes[name].value = value

    def step(self, seconds: float, targets: Targets) -> None:
        """
        Append to all profiles a piece of the given length, s, in which the profiles change to their targets.

        If the length is 0, the profiles change at once (`jump`).
        """
        if seconds <= 0.0:
            self.jump(targets)
            return
        start, bit, angle = self.time, self.bit.value, self.angle.value
        for name, lane in (("bit", self.bit), ("angle", self.angle)):
            if name in targets:
                lane.to_value(targets[name], seconds)
            else:
                lane.to_rate(targets.get(name + "_rate", lane.rate), seconds)
        for name in _SMOOTH:
            self.lanes[name].to_value(targets.get(name, self.lanes[name].value), seconds)
        for name in _SWITCHED:
            self.lanes[name].value = targets.get(name, self.lanes[name].value)
            self.lanes[name].hold(seconds)
        if self.bit.value > self.hole.value and bit > self.hole.value - 1e-6:
            # On bottom the hole becomes deeper with the bit.
            self.hole.follow(self.bit)
        else:
            self.hole.to_value(max(self.hole.value, self.bit.value), seconds)
        if "block" in targets:
            self.block.to_value(targets["block"], seconds)
        else:
            self.block.follow(self.bit, -1.0)
        if not self.moving and self.bit.value == bit and self.angle.value == angle:
            if self.still and self.still[-1][1] == start:
                start = self.still.pop()[0]
            self.still.append((start, self.time))


def timeline(
    phases: tuple[SchedulePhase, ...],
    rig: Rig,
    bit_m: float,
    whirl: tuple[tuple[tuple[float, float], tuple[float, float]], ...],
    rng: np.random.Generator,
    toolface: float = 0.0,
) -> Timeline:
    """
    Return the profiles of a schedule.

    Parameters
    ----------
    phases, rig
        Phases of the schedule and properties of the rig.
    bit_m : float
        Measured depth of the bit at time zero.
    whirl : tuple of ((float, float), (float, float))
        Shortest and longest burst, and shortest and longest pause, of each whirl, s; only the first whirl is used.
    rng : Generator
        Random numbers for the whirl bursts.
    toolface : float
        Angle of the string at time zero, rad.

    Raises
    ------
    ValueError
        A phase of drilling, sliding or circulation is not longer than the ramp of the rig.
    """
    lanes = _Lanes(bit_m, rig, toolface)
    first = True
    for phase in phases:
        for _ in range(phase.repeat):
            _lay(lanes, phase, rig, under_way=first and rig.running_start)
            first = False
    built = {name: lane.build() for name, lane in lanes.lanes.items()}
    envelopes = [built["e_" + name] for name in ENVELOPES]
    line = Timeline(
        bit=lanes.bit.build(),
        angle=lanes.angle.build(),
        envelopes=tuple(envelopes),
        hole=lanes.hole.build(),
        block=lanes.block.build(),
        hookload=built["hookload"],
        weight=built["weight"],
        torque=built["torque"],
        flow=built["flow"],
        slips=built["slips"],
        activity=built["activity"],
        still=lanes.still,
        seconds=lanes.time,
    )
    if whirl:
        envelopes[ENVELOPES.index("burst")] = _bursts(line.active("rotating"), whirl[0], rng)
    return dataclasses.replace(line, envelopes=tuple(envelopes))


def _lay(lanes: _Lanes, phase: SchedulePhase, rig: Rig, *, under_way: bool) -> None:
    if phase.kind in ("drill", "slide", "circulate"):
        _work(lanes, phase, rig, under_way=under_way)
        return
    if lanes.moving:
        lanes.step(rig.ramp_s, _at_rest(rig))
    if phase.kind == "connection":
        _connect(lanes, phase, rig)
    elif phase.kind == "still":
        pumps = _pumps(rig, on=phase.pumps) | {"activity": float(STILL)}
        if under_way:
            lanes.jump(pumps)
        elif (lanes.lanes["flow"].value > 0.0) != phase.pumps:
            lanes.step(rig.pump_ramp_s, pumps)
        lanes.step(phase.seconds, {"activity": float(STILL)})
    else:
        ramp = min(rig.ramp_s, 0.4 * phase.seconds)
        speed = {"bit_rate": phase.rop_m_h / 3600.0, "e_moving": phase.vibration, "activity": float(TRIPPING)}
        lanes.step(ramp, speed | _pumps(rig, on=phase.pumps))
        lanes.step(phase.seconds - 2.0 * ramp, {})
        lanes.step(ramp, {"bit_rate": 0.0, "e_moving": 0.0})


def _at_rest(rig: Rig) -> Targets:
    quiet = dict.fromkeys(("e_rotating", "e_sliding", "e_drilling", "e_stick_slip", "weight", "torque"), 0.0)
    return quiet | {"bit_rate": 0.0, "angle_rate": 0.0, "hookload": rig.string_kn * 1e3}


def _pumps(rig: Rig, *, on: bool) -> Targets:
    return {"flow": rig.flow_lpm * 1e-3 / 60.0 if on else 0.0, "e_pumping": 1.0 if on else 0.0}


def _connect(lanes: _Lanes, phase: SchedulePhase, rig: Rig) -> None:
    bottom = lanes.bit.value
    if rig.pick_up_m:
        lanes.step(rig.ramp_s, {"bit": bottom - rig.pick_up_m, "activity": float(TRIPPING)})
    lanes.step(rig.pump_ramp_s, _pumps(rig, on=False) | {"activity": float(STILL)})
    hang = min(1.0, 0.1 * phase.seconds)
    lanes.step(hang, {"slips": 1.0, "hookload": rig.block_kn * 1e3})
    lanes.step(phase.seconds - 2.0 * hang, {"block": lanes.block.value + rig.stand_m})
    lanes.step(hang, {"slips": 0.0, "hookload": rig.string_kn * 1e3})
    lanes.step(rig.pump_ramp_s, _pumps(rig, on=True))
    if rig.pick_up_m:
        lanes.step(rig.ramp_s, {"bit": bottom, "activity": float(TRIPPING)})


def _work(lanes: _Lanes, phase: SchedulePhase, rig: Rig, *, under_way: bool) -> None:
    if phase.seconds <= rig.ramp_s:
        raise ValueError(f"schedule: a phase of {phase.seconds:g} s is shorter than the rig's ramp, {rig.ramp_s:g} s")
    turning, on_bottom = phase.kind != "slide", phase.kind != "circulate"
    spin = phase.rpm * 2.0 * math.pi / 60.0 if turning else 0.0
    weight = rig.weight_on_bit_kn * 1e3 if on_bottom else 0.0
    targets: Targets = {
        "bit_rate": phase.rop_m_h / 3600.0 * rig.time_lapse if on_bottom else 0.0,
        "angle_rate": spin,
        "weight": weight,
        "torque": rig.torque_knm * 1e3 if on_bottom and turning else 0.0,
        "hookload": rig.string_kn * 1e3 - weight,
        "e_rotating": phase.vibration if spin else 0.0,
        "e_sliding": 0.0 if turning else phase.vibration,
        "e_drilling": phase.vibration if on_bottom else 0.0,
        "e_stick_slip": phase.vibration * spin if on_bottom else 0.0,
        "activity": float(ROTATING if spin else SLIDING),
        **_pumps(rig, on=True),
    }
    if not turning and phase.toolface_deg is not None:
        if lanes.angle.rate and not under_way:
            lanes.step(rig.ramp_s, {"angle_rate": 0.0})
        turn = (math.radians(phase.toolface_deg) - lanes.angle.value + math.pi) % (2.0 * math.pi) - math.pi
        targets["angle"] = lanes.angle.value + turn
        del targets["angle_rate"]
    if under_way:
        lanes.jump(targets)
        lanes.step(phase.seconds, {})
    else:
        lanes.step(rig.ramp_s, targets)
        lanes.step(phase.seconds - rig.ramp_s, {})


def _bursts(
    active: list[tuple[float, float]], ranges: tuple[tuple[float, float], tuple[float, float]], rng: np.random.Generator
) -> Profile:
    burst, pause = ranges
    lane = ProfileBuilder()
    for start, end in active:
        lane.hold(start - lane.time)
        while True:
            lane.hold(rng.uniform(*pause))
            length = rng.uniform(*burst)
            edge = min(0.5, 0.3 * length)
            if lane.time + length >= end:
                break
            lane.to_value(1.0, edge)
            lane.hold(length - 2.0 * edge)
            lane.to_value(0.0, edge)
    return lane.build()


# Piecewise polynomials of time with exact derivatives, for depth, toolface and envelopes.


@dataclasses.dataclass(frozen=True)
class Profile:
    """Piecewise polynomial of time."""

    starts: Array  #: shape (m,); start of each piece, s, ascending; the last piece has no end
    terms: Array  #: shape (m, 7); coefficients, in rising powers, of the time since the start of the piece

    def __call__(self, t: Array) -> Array:
        """Return value, rate and acceleration, shape (3, n), at ascending times t, s, shape (n,)."""
        out = np.empty((3, len(t)))
        evaluate(self.starts, self.terms, t, out)
        return out

    @property
    def end(self) -> float:
        """Start of the last piece, s."""
        return float(self.starts[-1])


class ProfileBuilder:
    """
    Builder of a `Profile`, to which pieces are added one after the other; starts with a value and a rate.

    time : end of the last piece, s.
    value, rate : value at that time, and the value's rate of change per s.
    """

    def __init__(self, value: float = 0.0, rate: float = 0.0) -> None:
        self.time = 0.0
        self.value = value
        self.rate = rate
        self._starts: list[float] = []
        self._terms: list[list[float]] = []

    def hold(self, seconds: float) -> None:
        """Add a piece of a length, s, with the present rate."""
        if seconds > 0.0:
            self._add(seconds, [self.value, self.rate, 0.0, 0.0, 0.0, 0.0, 0.0])

    def to_rate(self, rate: float, seconds: float) -> None:
        """
        Change the rate to a new rate within a time, s; the rate and its first two derivatives stay continuous.

        If the time is 0, the rate changes at once.
        """
        change, s = rate - self.rate, seconds
        if change == 0.0 or s <= 0.0:
            self.hold(seconds)
            self.rate = rate
            return
        # Integral of rate + change (10 u^3 - 15 u^4 + 6 u^5), u = t / s.
        self._add(s, [self.value, self.rate, 0.0, 0.0, 2.5 * change / s**3, -3.0 * change / s**4, change / s**5])
        self.rate = rate

    def to_value(self, value: float, seconds: float) -> None:
        """Change the value to a new value within a time, s; the rate is 0 at the beginning and at the end."""
        change, s = value - self.value, seconds
        if change == 0.0:
            self.rate = 0.0
            self.hold(seconds)
            return
        self._add(s, [self.value, 0.0, 0.0, 10.0 * change / s**3, -15.0 * change / s**4, 6.0 * change / s**5, 0.0])
        self.value, self.rate = value, 0.0

    def follow(self, other: ProfileBuilder, factor: float = 1.0) -> None:
        """
        Append the last segment of another profile, from the present value on.

        factor: multiplies the segment's change.
        """
        _, *changes = other._terms[-1]
        self._add(other.time - other._starts[-1], [self.value, *(factor * term for term in changes)])
        self.rate = factor * other.rate

    def build(self) -> Profile:
        """Return the finished profile, which continues at its last rate."""
        starts = [*self._starts, self.time]
        terms = [*self._terms, [self.value, self.rate, 0.0, 0.0, 0.0, 0.0, 0.0]]
        return Profile(np.array(starts), np.array(terms))

    def _add(self, seconds: float, terms: list[float]) -> None:
        self._starts.append(self.time)
        self._terms.append(terms)
        self.time += seconds
        # Not sum(): from Python 3.12 on it compensates rounding, and a different last bit would change the simulation.
        value = 0.0
        for term in reversed(terms):
            value = value * seconds + term
        self.value = value


@compiled
def evaluate(starts: Array, terms: Array, t: Array, out: Array) -> None:
    """Fill out, shape (3, n), with value, rate and acceleration of a profile at ascending t, s, shape (n,)."""
    low, high = 0, len(starts) - 1
    while low < high:
        middle = (low + high + 1) // 2
        if starts[middle] <= t[0]:
            low = middle
        else:
            high = middle - 1
    piece = low
    for k in range(len(t)):
        while piece + 1 < len(starts) and starts[piece + 1] <= t[k]:
            piece += 1
        u = t[k] - starts[piece]
        value = terms[piece, 6]
        rate = 0.0
        half_acceleration = 0.0
        for power in range(5, -1, -1):
            half_acceleration = half_acceleration * u + rate
            rate = rate * u + value
            value = value * u + terms[piece, power]
        out[0, k] = value
        out[1, k] = rate
        out[2, k] = 2.0 * half_acceleration

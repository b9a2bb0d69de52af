"""
The rig's day: phases of drilling, sliding and connections, laid out as profiles of depth, rotation, pumps and hook.

The sonde's motion and the rig's own gauges come from the same profiles, so that depth pairs with surveys.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.profile import Profile, ProfileBuilder
from mwd_sensors.settings import setting
from mwd_sensors.vibration import ENVELOPES

Array = NDArray[np.float64]

KINDS = ("drill", "slide", "circulate", "still", "connection", "move")
# As in mwd_msgs/Truth.
STILL, SLIDING, ROTATING, TRIPPING = range(4)


@dataclasses.dataclass(frozen=True)
class Phase:
    """One entry of the schedule."""

    kind: str = setting("drill", "what is done", choices=KINDS)
    seconds: float = setting(10.0, "how long; of a connection: standing still", unit="s", low=0.5, high=360000.0)
    rpm: float = setting(120.0, "rotary speed while drilling or circulating", unit="r/min", low=-600.0, high=600.0)
    rop_m_h: float = setting(
        30.0, "rate of penetration, or speed of a move (up is negative)", unit="m/h", low=-36000.0, high=36000.0
    )
    toolface_deg: float | None = setting(None, "of a slide; left out, as it stands", unit="deg", low=-360.0, high=360.0)
    vibration: float = setting(1.0, "factor on everything felt while drilling", low=0.0, high=10.0)
    pumps: bool = setting(True, "flow while still or moving")
    repeat: int = setting(1, "so many times", low=1, high=10000)


@dataclasses.dataclass(frozen=True)
class Rig:
    """How the rig does it."""

    ramp_s: float = setting(3.0, "to bring rotation or feed up or down", unit="s", low=0.0, high=60.0)
    pump_ramp_s: float = setting(2.0, "to bring the pumps up or down", unit="s", low=0.1, high=120.0)
    running_start: bool = setting(False, "the first phase is under way at time zero, instead of starting from rest")
    pick_up_m: float = setting(0.5, "off bottom before a connection", unit="m", low=0.0, high=30.0)
    stand_m: float = setting(9.0, "length added by a connection", unit="m", low=0.5, high=40.0)
    flow_lpm: float = setting(1200.0, "drilling flow", unit="l/min", low=0.0, high=6000.0)
    pressure_bar: float = setting(110.0, "standpipe pressure at drilling flow", unit="bar", low=0.0, high=600.0)
    string_kn: float = setting(450.0, "hookload with the string hanging free", unit="kN", low=1.0, high=5000.0)
    block_kn: float = setting(60.0, "hookload of the empty hook", unit="kN", low=0.0, high=1000.0)
    weight_on_bit_kn: float = setting(60.0, "while drilling", unit="kN", low=0.0, high=1000.0)
    torque_knm: float = setting(8.0, "while drilling with rotation", unit="kN m", low=0.0, high=200.0)
    bottom_block_m: float = setting(2.0, "block height at a connection", unit="m", low=0.0, high=50.0)


@dataclasses.dataclass(frozen=True)
class Timeline:
    """
    Everything the schedule decides, as functions of time.

    Attributes
    ----------
    bit : Profile
        Measured depth of the bit, m.
    angle : Profile
        Angle turned by the string, rad, before any vibration.
    envelopes : tuple of Profile
        One for each name of `vibration.ENVELOPES`.
    hole : Profile
        Greatest depth the bit has been at, m.
    block, hookload, weight, torque, flow : Profile
        m, N, N, N m, m^3/s.
    slips, activity : Profile
        0 or 1; `STILL`, `SLIDING`, `ROTATING` or `TRIPPING`.
    still : list of (float, float)
        Intervals without any motion, s.
    seconds : float
        Length of the schedule.
    """

    bit: Profile
    angle: Profile
    envelopes: tuple[Profile, ...]
    hole: Profile
    block: Profile
    hookload: Profile
    weight: Profile
    torque: Profile
    flow: Profile
    slips: Profile
    activity: Profile
    still: list[tuple[float, float]]
    seconds: float

    def active(self, when: str) -> list[tuple[float, float]]:
        """Intervals, s, in which an envelope holds steadily above zero."""
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


class _Lanes:
    """All profiles under construction, kept at one time."""

    def __init__(self, bit_m: float, rig: Rig, angle: float) -> None:
        self.rig = rig
        self.lanes = {name: ProfileBuilder() for name in ("weight", "torque", "flow", "slips", "activity")}
        self.lanes["bit"] = ProfileBuilder(bit_m)
        self.lanes["hole"] = ProfileBuilder(bit_m)
        self.lanes["angle"] = ProfileBuilder(angle)
        self.lanes["block"] = ProfileBuilder(rig.bottom_block_m + rig.stand_m)
        self.lanes["hookload"] = ProfileBuilder(rig.string_kn * 1e3)
        self.lanes.update({"e_" + name: ProfileBuilder(1.0 if name == "always" else 0.0) for name in ENVELOPES})
        self.still: list[tuple[float, float]] = []
        self.levels = dict.fromkeys(ENVELOPES, 0.0) | {"always": 1.0}

    @property
    def time(self) -> float:
        return self.lanes["bit"].time

    def step(self, seconds: float, *, jump: bool = False, **targets: float) -> None:
        """Move lanes to new values (bit_rate and angle_rate: to new rates) within a time; the others stay."""
        if seconds <= 0.0 and not jump:
            return
        start = self.time
        moved = {"bit_rate", "angle_rate"}
        self._rate("bit", targets.get("bit_rate", self.lanes["bit"].rate), targets.get("bit"), seconds)
        self._rate("angle", targets.get("angle_rate", self.lanes["angle"].rate), targets.get("angle"), seconds)
        bit = self.lanes["bit"]
        for name, lane in self.lanes.items():
            if name in ("bit", "angle", "hole", "block"):
                continue
            if name in ("slips", "activity"):
                lane.value = targets.get(name, lane.value)
                lane.rate = 0.0
                lane.hold(seconds)
            elif jump:
                lane.value = targets.get(name, lane.value)
            else:
                lane.to_value(targets.get(name, lane.value), seconds)
        moved |= set(self.lanes)
        unknown = set(targets) - moved
        if unknown:
            raise ValueError(f"no such lane: {', '.join(sorted(unknown))}")
        if jump:
            return
        # The hole deepens with the bit once it is back on bottom; the block follows the string, or runs up for the next stand.
        hole, block = self.lanes["hole"], self.lanes["block"]
        _follow(hole, max(hole.value, bit.value), seconds)
        if "block" in targets:
            block.to_value(targets["block"], seconds)
        else:
            _follow(block, block.value - (bit.value - self._bit_before), seconds)
        if bit.rate == 0.0 and self._bit_before == bit.value and self.lanes["angle"].rate == 0.0 and not self._turned:
            if self.still and self.still[-1][1] == start:
                self.still[-1] = (self.still[-1][0], self.time)
            else:
                self.still.append((start, self.time))

    def _rate(self, name: str, rate: float, value: float | None, seconds: float) -> None:
        lane = self.lanes[name]
        before = lane.value
        if seconds <= 0.0:
            lane.rate = rate
        elif value is not None:
            lane.to_value(value, seconds)
        else:
            lane.to_rate(rate, seconds)
        if name == "bit":
            self._bit_before = before
        else:
            self._turned = lane.value != before


def _follow(lane: ProfileBuilder, value: float, seconds: float) -> None:
    lane.rate = (value - lane.value) / seconds
    lane.hold(seconds)
    lane.value = value


def timeline(
    phases: tuple[Phase, ...],
    rig: Rig,
    bit_m: float,
    whirl: tuple[tuple[tuple[float, float], tuple[float, float]], ...],
    rng: np.random.Generator,
    toolface: float = 0.0,
) -> Timeline:
    """
    Lay out a schedule.

    Parameters
    ----------
    phases, rig
        What is done and how.
    bit_m : float
        Measured depth of the bit at time zero, m.
    whirl : tuple of ((float, float), (float, float))
        Shortest and longest burst and pause of each whirl, s; the first one sets the bursts.
    rng : Generator
        Draws the whirl bursts.
    toolface : float
        Angle of the string at time zero, rad.
    """
    lanes = _Lanes(bit_m, rig, toolface)
    first = True
    for phase in phases:
        for _ in range(phase.repeat):
            _lay(lanes, phase, rig, jump=first and rig.running_start)
            first = False
    built = {name: lane.build() for name, lane in lanes.lanes.items()}
    envelopes = [built["e_" + name] for name in ENVELOPES]
    seconds = lanes.time
    line = Timeline(
        bit=built["bit"],
        angle=built["angle"],
        envelopes=tuple(envelopes),
        hole=built["hole"],
        block=built["block"],
        hookload=built["hookload"],
        weight=built["weight"],
        torque=built["torque"],
        flow=built["flow"],
        slips=built["slips"],
        activity=built["activity"],
        still=lanes.still,
        seconds=seconds,
    )
    if whirl:
        envelopes[ENVELOPES.index("burst")] = _bursts(line.active("rotating"), whirl[0], rng)
    return dataclasses.replace(line, envelopes=tuple(envelopes))


def _lay(lanes: _Lanes, phase: Phase, rig: Rig, *, jump: bool) -> None:
    flow = rig.flow_lpm * 1e-3 / 60.0
    off_bottom = {"weight": 0.0, "torque": 0.0, "hookload": rig.string_kn * 1e3}
    quiet = {"e_rotating": 0.0, "e_sliding": 0.0, "e_drilling": 0.0, "e_stick_slip": 0.0}
    at_rest = {"bit_rate": 0.0, "angle_rate": 0.0, **off_bottom, **quiet}
    pumps_on, pumps_off = {"flow": flow, "e_pumping": 1.0}, {"flow": 0.0, "e_pumping": 0.0}
    moving = lanes.lanes["bit"].rate != 0.0 or lanes.lanes["angle"].rate != 0.0
    if phase.kind in ("drill", "slide", "circulate"):
        _work(lanes, phase, rig, pumps_on, jump=jump)
        return
    if moving:
        lanes.step(rig.ramp_s, activity=lanes.lanes["activity"].value, **at_rest)
    if phase.kind == "connection":
        bottom = lanes.lanes["bit"].value
        if rig.pick_up_m:
            lanes.step(rig.ramp_s, bit=bottom - rig.pick_up_m, activity=TRIPPING)
        lanes.step(rig.pump_ramp_s, activity=STILL, **pumps_off)
        hang = min(1.0, 0.1 * phase.seconds)
        block = lanes.lanes["block"].value
        lanes.step(hang, slips=1.0, hookload=rig.block_kn * 1e3)
        lanes.step(phase.seconds - 2.0 * hang, block=block + rig.stand_m)
        lanes.step(hang, slips=0.0, hookload=rig.string_kn * 1e3)
        lanes.step(rig.pump_ramp_s, **pumps_on)
        if rig.pick_up_m:
            lanes.step(rig.ramp_s, bit=bottom, activity=TRIPPING)
    elif phase.kind == "still":
        if (lanes.lanes["flow"].value > 0.0) != phase.pumps:
            pumps = pumps_on if phase.pumps else pumps_off
            lanes.step(0.0 if jump else rig.pump_ramp_s, jump=jump, activity=STILL, **pumps)
        lanes.step(phase.seconds, activity=STILL)
    else:
        speed = phase.rop_m_h / 3600.0
        ramp = min(rig.ramp_s, 0.4 * phase.seconds)
        pumps = pumps_on if phase.pumps else pumps_off
        lanes.step(ramp, bit_rate=speed, activity=TRIPPING, **pumps)
        lanes.step(phase.seconds - 2.0 * ramp)
        lanes.step(ramp, bit_rate=0.0)


def _work(lanes: _Lanes, phase: Phase, rig: Rig, pumps_on: dict[str, float], *, jump: bool) -> None:
    turning = phase.kind != "slide"
    on_bottom = phase.kind != "circulate"
    spin = phase.rpm * 2.0 * math.pi / 60.0 if turning else 0.0
    targets = {
        "bit_rate": phase.rop_m_h / 3600.0 if on_bottom else 0.0,
        "angle_rate": spin,
        "weight": rig.weight_on_bit_kn * 1e3 if on_bottom else 0.0,
        "torque": rig.torque_knm * 1e3 if on_bottom and turning else 0.0,
        "hookload": (rig.string_kn - (rig.weight_on_bit_kn if on_bottom else 0.0)) * 1e3,
        "e_rotating": phase.vibration if spin else 0.0,
        "e_sliding": phase.vibration if phase.kind == "slide" else 0.0,
        "e_drilling": phase.vibration if on_bottom else 0.0,
        "e_stick_slip": phase.vibration * spin if on_bottom else 0.0,
        "activity": ROTATING if spin else SLIDING,
        **pumps_on,
    }
    ramp = rig.ramp_s
    if jump:
        lanes.step(0.0, jump=True, **targets)
        if phase.toolface_deg is not None:
            lanes.lanes["angle"].value = math.radians(phase.toolface_deg)
        lanes.step(phase.seconds)
        return
    angle = lanes.lanes["angle"]
    if not turning and phase.toolface_deg is not None:
        if angle.rate:
            lanes.step(ramp, angle_rate=0.0, activity=ROTATING)
        turn = (math.radians(phase.toolface_deg) - angle.value + math.pi) % (2.0 * math.pi) - math.pi
        targets["angle"] = angle.value + turn
    if phase.seconds <= ramp:
        raise ValueError(f"phase of {phase.seconds:g} s is shorter than the ramp of the rig, {ramp:g} s")
    lanes.step(ramp, **targets)
    lanes.step(phase.seconds - ramp)


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

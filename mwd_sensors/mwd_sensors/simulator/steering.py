# SPDX-License-Identifier: Apache-2.0
"""
Top drive that obeys commands, and a string below it that winds up, sticks and slips.

The string is a torsional spring with a lumped inertia at its end. The defaults of spring, inertia and damping are from
Jansen and van den Steen, Journal of Sound and Vibration 179 (1995). Friction on the wall falls with speed,
which causes stick-slip. Friction acts against the direction in which the pipe moves over the wall. A string that slides
along the hole therefore yields slowly to any torque, and a string that does not slide sticks. The reactive torque of a
mud motor turns the string to the left (counter-clockwise looking down-hole). Angles and speeds are positive clockwise.

Unlike the rest of the motion, the angle of such a string has no closed form. It is integrated at the instants of the
kinematics, one after the other, so that the same commands at the same steps give the same bits.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.schedule import Timeline

# Values of `mode` in mwd_msgs/RigCommand; before the first command and after a release the top drive follows the
# schedule.
HOLD, ROTATE, ORIENT, PUMP, RELEASE = range(5)
_SCHEDULE = -1
_RPM = math.pi / 30.0
_LINES = 24  # number of sines in the motor's unsteady torque
# Speed at which a top drive at its torque limit unwinds, per angle of wind-up beyond the limit, rad/s per rad.
_YIELD = 10.0
# Lower limit of the sliding speed divided by the pipe radius, rad/s: friction of a string that does not slide.
_LEAST_SLIDE = 1e-5


class State:
    """State of top drive and string, and the command in force."""

    #: `drive`, `drive_rate`, `end`, `end_rate`: angle, rad, and speed, rad/s, of the top drive and of the lower end of
    #: the string.
    drive: float
    drive_rate: float
    end: float
    end_rate: float
    mode: int  #: mode of the command in force; _SCHEDULE before the first command
    #: `speed`, `target`, `left`: commanded speed, rad/s, and angle, rad; remaining validity of the command, s.
    speed: float
    target: float
    left: float
    then: int  #: mode after the validity has ended: HOLD or RELEASE
    limit: float  #: largest torque of the top drive while it turns on command, N m


_STATE = dtype_of(State)


class SteeringParams(NamedTuple):
    """
    Constants of string and top drive, SI.

    The string has `stiffness`, N m/rad, `inertia`, kg m^2, and `damping`, N m s/rad. Wall friction, N m, is `kinetic`
    plus `more` at standstill and `kinetic` at speeds far above `decay`, rad/s. `fastest` (speed while turning to an
    angle, rad/s), `ramp`, rad/s^2, and `yields`, 1/s, belong to the top drive.
    """

    stiffness: float
    inertia: float
    damping: float
    kinetic: float
    more: float
    decay: float
    fastest: float
    ramp: float
    yields: float


@dataclasses.dataclass(frozen=True)
class Steering:
    """Properties of a top drive that obeys commands, and of its string."""

    stiffness_nm_rad: float = setting(
        473.0,
        "Torsional stiffness of the string. Lowering it lets the string wind up further.",
        unit="N m/rad",
        low=10.0,
        high=1e5,
    )
    inertia_kgm2: float = setting(
        374.0, "Moment of inertia at the lower end of the string.", unit="kg m^2", low=1.0, high=1e5
    )
    damping_nms: float = setting(
        23.0, "Torsional damping between top drive and lower end.", unit="N m s/rad", low=0.0, high=1e4
    )
    static_nm: float = setting(
        2200.0, "Friction torque at the wall at standstill. Raising it makes the string stick more.", low=0.0, high=1e5
    )
    kinetic_nm: float = setting(1000.0, "Friction torque at the wall at high speed.", low=0.0, high=1e5)
    decay_rpm: float = setting(
        48.0,
        "Speed over which the friction torque falls from its value at standstill to that at high speed.",
        low=0.1,
        high=500.0,
    )
    pipe_radius_m: float = setting(0.1, "Radius of the pipe where it touches the wall.", low=0.01, high=1.0)
    motor_nm: float = setting(800.0, "Reactive torque of the motor at the drilling weight.", low=0.0, high=1e5)
    motor_unsteady: float = setting(
        0.1, "Root mean square of the variation of the reactive torque, as a share of this torque.", low=0.0, high=1.0
    )
    motor_band_hz: tuple[float, float] = setting(
        (0.02, 0.3), "Lowest and highest frequency of the variation of the reactive torque.", low=0.001, high=20.0
    )
    most_rpm: float = setting(200.0, "Highest speed of the top drive.", low=1.0, high=600.0)
    orient_rpm: float = setting(10.0, "Highest speed while the top drive turns to an angle.", low=0.1, high=60.0)
    ramp_rpm_s: float = setting(
        20.0, "Change of the top drive's speed per second.", unit="r/min/s", low=0.1, high=1000.0
    )
    most_nm: float = setting(50000.0, "Largest torque that a command may set.", low=100.0, high=2e5)
    most_turn_deg: float = setting(720.0, "Largest turn in one command.", low=1.0, high=36000.0)

    def __post_init__(self) -> None:
        """Raise ValueError if friction rises with speed, or the band of the motor's torque has no width."""
        if self.kinetic_nm > self.static_nm:
            raise ValueError(f"kinetic_nm {self.kinetic_nm:g} must not be above static_nm {self.static_nm:g}")
        if self.motor_band_hz[0] >= self.motor_band_hz[1]:
            raise ValueError(f"motor_band_hz {self.motor_band_hz}: the lowest frequency must be below the highest")


@dataclasses.dataclass(frozen=True)
class SteeringCommand:
    """
    Command to the top drive or the pumps.

    mode is `HOLD`, `ROTATE` at rotary_speed, rad/s, `ORIENT` by turn, rad, from the present angle of the top drive (or
    from the angle where it comes to rest, if it turns), `PUMP` at flow_rate, m^3/s, or `RELEASE`, which returns top
    drive and pumps to the schedule. Without a newer command within valid_for, s, the top drive holds, or returns to the
    schedule if `returns` is set; the pumps always return to the schedule.
    """

    mode: int
    rotary_speed: float = 0.0
    turn: float = 0.0
    valid_for: float = 10.0
    flow_rate: float = 0.0
    returns: bool = False


def check(command: SteeringCommand, steering: Steering) -> None:
    """
    Raise ValueError if the rig cannot carry out a command.

    The reason is an unknown mode, a number that is not finite or outside the rig's limits, or a validity that is not
    positive.
    """
    if command.mode not in range(RELEASE + 1):
        raise ValueError(f"mode: must be 0 (hold), 1 (rotate), 2 (orient), 3 (pump) or 4 (release), got {command.mode}")
    if not (math.isfinite(command.flow_rate) and command.flow_rate >= 0.0):
        raise ValueError(f"flow_rate: must be 0 or more, got {command.flow_rate:g}")
    for name, limit in (("rotary_speed", steering.most_rpm * _RPM), ("turn", math.radians(steering.most_turn_deg))):
        value = getattr(command, name)
        if not math.isfinite(value) or abs(value) > limit * (1.0 + 1e-9):
            raise ValueError(f"{name}: must be within {limit:.4g} of zero, got {value:g}")
    if not (math.isfinite(command.valid_for) and command.valid_for > 0.0):
        raise ValueError(f"valid_for: must be above zero and finite, got {command.valid_for:g}")


class String:
    """
    Top drive, string and motor of one simulation.

    Parameters
    ----------
    timeline : Timeline
        Schedule of depth, weight and pumps; before the first command also of the rotation.
    toolface : float
        Toolface of the string's end at the beginning, rad.
    rate : int
        Rate of the kinematics, Hz.
    rng : Generator
        Random numbers for the motor's variation.
    """

    def __init__(
        self, steering: Steering, timeline: Timeline, toolface: float, rate: int, rng: np.random.Generator
    ) -> None:
        self.steering = steering
        self._rate = float(rate)
        self._timeline = timeline
        low, high = steering.motor_band_hz
        self._frequency = low + (high - low) / _LINES * (np.arange(_LINES) + rng.random(_LINES))
        self._phase = 2.0 * math.pi * rng.random(_LINES)
        self._full_weight = max(float(timeline.weight.terms[:, 0].max()), 1e-9)
        self._params = SteeringParams(
            stiffness=steering.stiffness_nm_rad,
            inertia=steering.inertia_kgm2,
            damping=steering.damping_nms,
            kinetic=steering.kinetic_nm,
            more=steering.static_nm - steering.kinetic_nm,
            decay=steering.decay_rpm * _RPM,
            fastest=steering.orient_rpm * _RPM,
            ramp=steering.ramp_rpm_s * _RPM,
            # Limit the speed of unwinding, so that spring and damping torque together stay below the torque limit.
            yields=min(_YIELD, steering.stiffness_nm_rad / max(steering.damping_nms, 1e-9)),
        )
        # A simulation that starts with rotation starts with a wound-up string.
        start = np.zeros(1)
        speed, motor = float(timeline.angle(start)[1, 0]), float(self._motor(start)[0])
        fall = math.exp(-abs(speed) / (steering.decay_rpm * _RPM))
        drag = steering.kinetic_nm + (steering.static_nm - steering.kinetic_nm) * fall
        wound = (motor + math.copysign(drag, speed) * (speed != 0.0)) / steering.stiffness_nm_rad
        self._state = np.zeros(1, _STATE)
        self._state[0] = (toolface + wound, speed, toolface, speed, _SCHEDULE, 0.0, 0.0, 0.0, HOLD, steering.most_nm)

    def command(self, command: SteeringCommand) -> None:
        """
        Obey a command from the next instant on.

        A command to the pumps, and a release while the top drive follows the schedule, change nothing here.

        Raises
        ------
        ValueError
            The command is refused by `check`.
        """
        check(command, self.steering)
        state = self._state[0]
        if command.mode == PUMP or (command.mode == RELEASE and state.mode == _SCHEDULE):
            return
        speed = float(state.drive_rate)
        rest = float(state.drive) + 0.5 * speed * abs(speed) / (self.steering.ramp_rpm_s * _RPM)
        state.mode, state.speed, state.left = command.mode, command.rotary_speed, command.valid_for
        state.target = rest + command.turn
        state.then = RELEASE if command.returns else HOLD

    def prolong(self, valid_for: float) -> None:
        """Extend the validity of a turn (`ORIENT`) in force to `valid_for`, s, from now; else do nothing."""
        if self._state[0].mode == ORIENT:
            self._state[0].left = valid_for

    def limit_torque(self, limit: float) -> None:
        """Limit the torque while the top drive turns on command, N m; 0 restores the top drive's own limit."""
        most = self.steering.most_nm
        self._state[0].limit = min(limit, most) if limit > 0.0 else most

    @property
    def quill(self) -> float:
        """Present angle of the top drive, rad."""
        return float(self._state[0].drive)

    @property
    def obeys(self) -> int | None:
        """Mode of the command in force, or None while the top drive follows the schedule."""
        mode = int(self._state[0].mode)
        return None if mode in (_SCHEDULE, RELEASE) else mode

    def advance(self, first: int, count: int) -> tuple[Array, Array]:
        """
        Advance over the instants (first + k) / rate, s, k = 0 .. count - 1, which follow the instants of the last call.

        Returns
        -------
        turn : ndarray, shape (3, n)
            Angle of the string's end with its rate and acceleration, rad, rad/s, rad/s^2.
        drive : ndarray, shape (n, 2)
            Speed of the top drive, rad/s, and its torque, N m.
        """
        t = (first + np.arange(count)) / self._rate
        turn, drive = np.empty((3, count)), np.empty((count, 2))
        slide = np.abs(self._timeline.bit(t)[1]) / self.steering.pipe_radius_m
        scheduled = np.ascontiguousarray(self._timeline.angle(t)[1])
        advance(self._params, self._state, slide, scheduled, self._motor(t), 1.0 / self._rate, turn, drive)
        return turn, drive

    def _motor(self, t: Array) -> Array:
        """Return the reactive torque of the motor, N m, at times t, s, shape (n,)."""
        item, line = self.steering, self._timeline
        working = line.weight(t)[0] / self._full_weight * (line.flow(t)[0] > 0.0)
        waves = np.cos(2.0 * math.pi * self._frequency[:, None] * t + self._phase[:, None]).sum(axis=0)
        return np.asarray(item.motor_nm * working * (1.0 + item.motor_unsteady * math.sqrt(2.0 / _LINES) * waves))


@compiled
def advance(
    p: SteeringParams,
    state: Samples,
    slide: Array,
    scheduled: Array,
    motor: Array,
    dt: float,
    turn: Array,
    drive: Array,
) -> None:
    """
    Integrate top drive and string over n instants that are dt, s, apart.

    Changes state, shape (1,), and fills turn and drive (see `String.advance`). slide, shape (n,): speed along the hole
    divided by the pipe radius, rad/s. scheduled, shape (n,): speed of the top drive by the schedule, rad/s. motor,
    shape (n,): reactive torque, N m.
    """
    s = state[0]
    for i in range(len(slide)):
        if s.mode > HOLD and s.mode != RELEASE:
            s.left -= dt
            if s.left <= 0.0:
                s.mode = s.then
        # Desired speed of the top drive.
        wanted = 0.0
        if s.mode == _SCHEDULE or s.mode == RELEASE:
            wanted = scheduled[i]
        elif s.mode == ROTATE:
            wanted = s.speed
        elif s.mode == ORIENT:
            rest = s.target - s.drive
            # Use the highest speed from which the top drive can still stop at the target; be slower close to it.
            wanted = min(p.fastest, math.sqrt(1.6 * p.ramp * abs(rest)), 10.0 * abs(rest))
            if rest < 0.0:
                wanted = -wanted
        before = wanted if s.mode == _SCHEDULE else s.drive_rate
        speed, end = before + min(max(wanted - before, -p.ramp * dt), p.ramp * dt), s.end_rate
        if s.mode == ROTATE or s.mode == ORIENT:
            # At the torque limit a top drive turns no faster than the string yields, whatever speed is commanded.
            wound, most = s.drive - s.end, s.limit / p.stiffness
            speed = min(max(speed, end - (most + wound) * p.yields), end + (most - wound) * p.yields)
        torque = p.stiffness * (s.drive - s.end) + p.damping * (before - end)
        # Friction coefficient at the previous speed; the friction term is implicit, so that sticking is stable.
        drag = p.kinetic + p.more * math.exp(-abs(end) / p.decay)
        viscous = drag / math.hypot(end, max(slide[i], _LEAST_SLIDE))
        push = p.stiffness * (s.drive - s.end) + p.damping * before - motor[i]
        after = (end + dt / p.inertia * push) / (1.0 + dt / p.inertia * (viscous + p.damping))
        turn[0, i], turn[1, i] = s.end, end
        turn[2, i] = (after - end) / dt
        drive[i, 0], drive[i, 1] = before, torque
        s.drive += 0.5 * dt * (before + speed)
        s.end += 0.5 * dt * (end + after)
        s.drive_rate, s.end_rate = speed, after

# SPDX-License-Identifier: Apache-2.0
"""
Simulated sonde: turn a scenario into the samples of every topic, block by block in constant memory.

The same scenario gives the same bytes for any length of the requested blocks: internally everything runs in steps of a
fixed number of samples, and each source of randomness has its own stream.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from mwd_sensors.core import earth, frames, input_covariance, wire
from mwd_sensors.core.arrays import Array, Samples, Stamps, joined
from mwd_sensors.simulator import faults, instrument, interference, motion, steering
from mwd_sensors.simulator.battery import BatteryModel
from mwd_sensors.simulator.gamma import GammaDetector
from mwd_sensors.simulator.instrument_grade import grade
from mwd_sensors.simulator.motion import EarthAtPlace, sensed
from mwd_sensors.simulator.scenario import Scenario, SimulatedUnit, parse_date
from mwd_sensors.simulator.schedule import ROTATING, SLIDING, timeline
from mwd_sensors.simulator.telemetry_link import TelemetryLink
from mwd_sensors.simulator.vibration import draw_hits, draw_lines

# Streams of random numbers. Append new streams and keep the order, so that old seeds give the same simulations.
_STREAMS = (
    "timeline",
    "lines",
    "hits",
    "interference",
    "ahrs_draw",
    "ahrs_run",
    "precision_draw",
    "precision_run",
    "mag_draw",
    "mag_run",
    "temperature",
    "clock",
    "faults",
    "link",
    "steering",
    "gamma",
    "battery",
)
# Streams that differ from one start of the same tool to the next: a real sensor never has the same noise twice.
_NOISE = ("ahrs_run", "precision_run", "mag_run", "gamma")
_STEPS = 20  # largest number of steps that are simulated together; more of them would not fit in the cache
_TURNING = 0.5  # speed of the top drive below which the activity is sliding, rad/s


class Sonde:
    """
    Simulation of a sonde in a hole.

    Parameters
    ----------
    scenario : Scenario
        Settings of the simulation.
    epoch_ns : int, optional
        Stamp of time zero; the default is the date of the scenario.
    starts_before : int
        Number of earlier starts of this tool. Each start has the same tool errors and motion, but other noise.
    """

    def __init__(self, scenario: Scenario, epoch_ns: int | None = None, starts_before: int = 0) -> None:
        self.scenario = scenario
        seeds = dict(zip(_STREAMS, np.random.SeedSequence(scenario.seed).spawn(len(_STREAMS)), strict=True))
        if starts_before:
            again = np.random.SeedSequence((scenario.seed, starts_before)).spawn(len(_NOISE))
            seeds |= dict(zip(_NOISE, again, strict=True))
        self._rng = {name: np.random.Generator(np.random.PCG64(s)) for name, s in seeds.items()}
        start = parse_date(scenario.date)
        self.epoch_ns = epoch_ns if epoch_ns is not None else round(start.timestamp()) * wire.NANOSECONDS
        self._day_s = start.hour * 3600.0 + start.minute * 60.0 + start.second
        #: Reference field for surveys at the place and date, or the scenario's override.
        self.reference = reference_of(scenario)
        #: `motion`: exact motion of the sonde.
        self.motion, self._pumps = _motion(scenario, self._rng)
        self.duration = self.motion.timeline.seconds  #: length of the simulation, s
        #: Top drive and string, if the scenario has steering.
        self.string = (
            steering.String(
                scenario.steering,
                self.motion.timeline,
                math.radians(scenario.well.toolface_deg),
                scenario.kinematics_hz,
                self._rng["steering"],
            )
            if scenario.steering is not None
            else None
        )
        latitude = math.radians(scenario.place.latitude_deg)
        self._place = EarthAtPlace(
            earth.earth_rate_n(latitude), self.reference.gravity, earth.gravity_gradient(latitude)
        )
        #: Telemetry link to the surface, if the scenario has one.
        self.link = (
            TelemetryLink(
                scenario.telemetry,
                self.motion.timeline,
                scenario.rig,
                scenario.seed,
                self.motion.place,
                scenario.clock.drift_ppm * 1e-6,
            )
            if scenario.telemetry is not None
            else None
        )
        self.interference = interference.disturbance(
            scenario.interference, self.reference.total, self._rng["interference"]
        )
        rate, step = scenario.rate_hz, scenario.kinematics_hz
        self._outputs = max(1, rate // 10)
        self._per_output = step // rate
        self.ahrs = MeasuringUnit(scenario.ahrs, step, rate, self._rng["ahrs_draw"], self._rng["ahrs_run"])
        self.precision = (
            MeasuringUnit(scenario.precision, step, rate, self._rng["precision_draw"], self._rng["precision_run"])
            if scenario.precision is not None
            else None
        )
        self._units = [unit for unit in (self.ahrs, self.precision) if unit is not None]
        self._margin = max(unit.margin for unit in self._units)
        self.magnetometer = instrument.magnetometer_triad(self.ahrs.grade.magnetometer, self._rng["mag_draw"])
        self._temperature_error = self.ahrs.grade.temperature_c * float(self._rng["temperature"].standard_normal())
        item = scenario.gamma
        #: Detector of natural gamma, if the scenario has one.
        self.gamma = None if item is None else GammaDetector(item, self.motion.path, self._rng["gamma"])
        cells = scenario.battery
        #: Battery, if the scenario has one.
        self.battery = None if cells is None else BatteryModel(cells, self._rng["battery"])
        #: Topics of the blocks: `wire.SONDE_TOPICS`, the counts of the detector and the state of the tool.
        self.topics = dict(wire.SONDE_TOPICS)
        if self.gamma is not None:
            self.topics[wire.GAMMA_TOPIC] = wire.COUNTS
        if self.battery is not None:
            self.topics[wire.STATUS_TOPIC] = wire.TOOL_STATUS
        self.faults = faults.start(scenario.faults, self._rng["faults"])
        names = sorted(topic for topic in wire.SONDE_TOPICS if topic not in ("truth", "rig/state"))
        self._links = {
            topic: faults.start_link(scenario.link, rng)
            for topic, rng in zip(names, self._rng["link"].spawn(len(names)), strict=True)
        }
        self._inputs: TrueInputs | None = None
        self._step = 0
        self._given = 0.0
        self._kept: dict[str, list[tuple[Samples, Array]]] = {topic: [] for topic in self.topics}

    @property
    def time(self) -> float:
        """Simulation time up to which samples exist, s; at most 0.1 s (one step) ahead of the returned blocks."""
        return self._step * self._outputs / self.scenario.rate_hz

    def inject(self, fault: faults.Fault) -> None:
        """
        Add a fault whose `start_s` counts from `time`. The fault "ok" ends all faults of its component.

        Raises
        ------
        ValueError
            The fault is not possible (see `faults.check`).
        """
        faults.check(fault)
        if fault.fault == "ok":
            self.faults.faults = [old for old in self.faults.faults if old.component != fault.component]
        else:
            self.faults.faults.append(dataclasses.replace(fault, start_s=self.time + fault.start_s))

    def command(self, command: steering.SteeringCommand) -> None:
        """
        Pass a command to the top drive or the pumps.

        The command acts at most 0.2 s after `time` (one step and the delay of the sensors).

        Raises
        ------
        ValueError
            The scenario has no steering, or the rig cannot carry out the command (see `steering.check`).
        """
        if self.string is None or self._pumps is None:
            raise ValueError("the rig of this scenario does not obey commands; add `steering: {}` to the scenario")
        self.string.command(command)
        if command.mode == steering.PUMP:
            self._pumps.ask(self.time, command.flow_rate, command.valid_for)
        elif command.mode == steering.RELEASE:
            self._pumps.release(self.time)

    def stamp_ns(self, seconds: float, *, of_tool: bool) -> int:
        """Return the stamp, ns, of a simulation time, s, by the tool's clock, which drifts, or by the rig's clock."""
        drift = self.scenario.clock.drift_ppm * 1e-6 if of_tool else 0.0
        return self.epoch_ns + round(seconds * (1.0 + drift) * wire.NANOSECONDS)

    def seconds(self, stamp_ns: int) -> float:
        """Return the simulation time, s, of a stamp of the tool; inverse of `stamp_ns`."""
        return (stamp_ns - self.epoch_ns) / wire.NANOSECONDS / (1.0 + self.scenario.clock.drift_ppm * 1e-6)

    def blocks(self, seconds: float = 1.0) -> Iterator[dict[str, Samples]]:
        """
        Yield the samples of every topic in blocks of `seconds`, s, to the end of the schedule.

        Each block holds, for each topic of `topics`, the samples that arrive in it (possibly none). A second
        call continues where the last block ended.

        Raises
        ------
        ValueError
            The length is not positive.
        """
        if not seconds > 0.0:
            raise ValueError(f"seconds must be positive, got {seconds!r}")
        end = math.floor(self.duration * self.scenario.rate_hz + 1e-6) / self.scenario.rate_hz
        start, count = self._given, 1
        while self._given < end:
            self._given = min(start + count * seconds, end)
            until = self._given + 1e-9
            while self.time < self._given - 1e-9:
                missing = math.ceil((self._given - 1e-9 - self.time) * self.scenario.rate_hz / self._outputs)
                for topic, arrived in self._advance(min(max(missing, 1), _STEPS)).items():
                    self._kept[topic].append(arrived)
            yield {topic: self._remove(topic, until) for topic in self.topics}
            count += 1

    def _remove(self, topic: str, until: float) -> Samples:
        parts = self._kept[topic]
        if not parts:
            return self.topics[topic].empty(0)
        samples, t = joined([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        # Arrival times ascend, so a block is a slice.
        cut = int(np.searchsorted(t, until))
        parts[:] = [(samples[cut:], t[cut:])]
        return np.asarray(samples[:cut])

    def _advance(self, steps: int) -> dict[str, tuple[Samples, Array]]:
        """Simulate a number of steps; return samples and arrival times of every topic."""
        scenario, rate = self.scenario, self.scenario.rate_hz
        inputs = self._next_inputs(steps)
        index = self._step * self._outputs + 1 + np.arange(steps * self._outputs, dtype=np.int64)
        t = index / rate
        self._step += steps
        at = self._margin + self._per_output * np.arange(1, len(t) + 1)
        mat_nt, position, md = inputs.mat_nt[at], inputs.position_n[at], inputs.md[at]
        celsius = self._celsius(t, position)
        warm = celsius[:: self._outputs] - self.ahrs.grade.calibrated_at_c
        gravity = self._gravity(position[:: self._outputs, 2])
        stamps = self._stamps(index)
        out: dict[str, tuple[Samples, Array]] = {}
        forces = inputs.f_t, inputs.precision_f_t
        for name, unit, f_t in zip(("imu/data_raw", "gyro/data_raw"), self._units, forces, strict=False):
            out[name] = (unit.samples(inputs.rate_it, f_t, self._margin, stamps, warm, gravity), t)
        if self.precision is None:
            out["gyro/data_raw"] = (wire.IMU.empty(0), t[:0])
        earth_n = self.reference.field_n + self.interference.daily(self._day_s + t)
        earth_t = interference.to_tool(mat_nt, earth_n)
        disturbing_t = self.interference.at(mat_nt, earth_n, position, md)
        out["imu/mag"] = (self._mag(stamps, earth_t + disturbing_t, warm), t)
        whole = index % rate == 0
        out["imu/temperature"] = (self._temperature(stamps[whole], celsius[whole]), t[whole])
        for topic, link in self._links.items():
            out[topic] = faults.carry(link, *self._spoiled(topic, *out[topic], t[self._outputs :: self._outputs]))
        truth = self._truth(inputs, at, t, stamps, celsius, earth_t, disturbing_t)
        out["truth"] = (truth, t)
        if self.gamma is not None:
            bit = md + self.scenario.well.sensor_to_bit_m
            counts, picked = self.gamma.samples(index, stamps, truth["gravity_toolface"], bit, rate)
            out[wire.GAMMA_TOPIC] = (counts, t[picked])
        if self.battery is not None:
            pumping = self.motion.timeline.flow(t[whole])[0] > 0.0
            status = self.battery.samples(t[whole], stamps[whole], celsius[whole], pumping)
            out[wire.STATUS_TOPIC] = (status, t[whole])
        gauge = index % (rate // scenario.rig_hz) == 0
        out["rig/state"] = (self._rig(index[gauge], t[gauge], inputs.drive[at][gauge]), t[gauge])
        return out

    def _spoiled(self, topic: str, samples: Samples, t: Array, starts: Array) -> tuple[Samples, Array]:
        """Apply the faults step by step, because they share random numbers; starts: of the steps after the first, s."""
        if not self.faults.faults or not len(starts):
            return faults.spoil(self.faults, topic, samples, t)
        cuts = np.searchsorted(t, starts)
        parts = [
            faults.spoil(self.faults, topic, *part)
            for part in zip(np.split(samples, cuts), np.split(t, cuts), strict=True)
        ]
        return joined([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def _truth(
        self,
        inputs: TrueInputs,
        at: Stamps,
        t: Array,
        stamps: Stamps,
        celsius: Array,
        earth_t: Array,
        disturbing_t: Array,
    ) -> Samples:
        """Return the true values of the steps, at the rows `at` of the kinematics and the times `t`, s."""
        mat_nt = inputs.mat_nt[at]
        truth = wire.TRUTH.empty(len(t))
        truth["stamp_ns"] = stamps
        truth["orientation"] = frames.orientation_et(mat_nt)
        truth["angular_velocity"] = inputs.rate_t[at]
        truth["specific_force"] = inputs.f_t[at]
        truth["gravity"] = mat_nt[:, 2, :]
        truth["position"], truth["velocity"] = inputs.position_n[at], inputs.velocity_n[at]
        truth["magnetic_field"], truth["interference"] = earth_t, disturbing_t
        for prefix, unit in zip(("", "precision_"), self._units, strict=False):
            truth[prefix + "gyro_bias"] = np.repeat(unit.gyro_bias, self._outputs, axis=0)
            truth[prefix + "accel_bias"] = np.repeat(unit.accel_bias, self._outputs, axis=0)
        truth["inclination"], truth["azimuth"], truth["gravity_toolface"] = frames.hole_angles(mat_nt)
        truth["measured_depth"], truth["temperature"] = inputs.md[at], celsius
        activity = np.round(self.motion.timeline.activity(t)[0]).astype(np.uint32)
        if self.string is not None:
            turning = np.where(np.abs(inputs.drive[at][:, 0]) > _TURNING, ROTATING, SLIDING)
            activity = np.where((activity == SLIDING) | (activity == ROTATING), turning, activity)
        truth["activity"] = activity
        return truth

    def _next_inputs(self, steps: int) -> TrueInputs:
        """Return the kinematics of the steps with the margins that the low-passes need on both sides."""
        n = self._outputs * self._per_output
        first, around = self._step * n, 2 * self._margin + 1
        if self._inputs is None:
            old = self._inputs_at(first - self._margin, around, around)
        else:
            old = TrueInputs(*(values[-around:] for values in self._inputs))
        new = self._inputs_at(first + self._margin + 1, steps * n, n)
        self._inputs = TrueInputs(*(np.concatenate(both) for both in zip(old, new, strict=True)))
        return self._inputs

    def _inputs_at(self, first: int, count: int, span: int) -> TrueInputs:
        rate = self.scenario.kinematics_hz
        turn, drive = None, np.empty((count, 0))
        if self.string is not None:
            turn, drive = self.string.advance(first, count)
        k = self.motion.at(first, count, float(rate), turn, span)
        rate_it, f_t = np.empty((count, 3)), np.empty((count, 3))
        precision_f_t = np.empty((0 if self.precision is None else count, 3))
        for unit, force in zip(self._units, (f_t, precision_f_t), strict=False):
            sensed(k, unit.lever_t, self._place, rate_it, force)
        return TrueInputs(k.mat_nt, k.rate_t, rate_it, k.position_n, k.velocity_n, k.md, f_t, precision_f_t, drive)

    def _gravity(self, down: Array) -> Array:
        return self._place.gravity + self._place.gravity_gradient * down

    def _celsius(self, t: Array, position: Array) -> Array:
        item = self.scenario.temperature
        warm_up = item.warm_up_c * (1.0 - np.exp(-t / item.warm_up_s))
        return np.asarray(item.surface_c + item.gradient_c_km * 1e-3 * position[:, 2] + warm_up)

    def _stamps(self, index: Stamps) -> Stamps:
        scenario = self.scenario
        nominal = index * wire.NANOSECONDS // scenario.rate_hz
        drift = np.round(nominal * (scenario.clock.drift_ppm * 1e-6)).astype(np.int64)
        jitter = np.zeros(len(index), dtype=np.int64)
        if scenario.clock.jitter_us:
            jitter = np.round(scenario.clock.jitter_us * 1e3 * self._rng["clock"].standard_normal(len(index))).astype(
                np.int64
            )
        stamps = self.epoch_ns + nominal + drift + jitter
        return faults.jumped(scenario.link, stamps, index / scenario.rate_hz)

    def _mag(self, stamps: Stamps, b_t: Array, warm: Array) -> Samples:
        triad = self.magnetometer
        noise = triad.noise * self._rng["mag_run"].standard_normal(b_t.shape)
        read = np.empty_like(b_t)
        bias = triad.bias + triad.bias_per_c * warm[:, None]
        instrument.convert(triad, bias, warm, b_t, np.zeros_like(b_t), np.zeros_like(warm), noise, read)
        samples = wire.MAG.empty(len(stamps))
        samples["stamp_ns"], samples["magnetic_field"] = stamps, read
        samples["magnetic_field_covariance"][:, ::4] = triad.noise**2 + triad.step**2 / 12.0
        return samples

    def _temperature(self, stamps: Stamps, celsius: Array) -> Samples:
        samples = wire.TEMPERATURE.empty(len(stamps))
        samples["stamp_ns"], samples["temperature"] = stamps, celsius + self._temperature_error
        samples["variance"] = self.ahrs.grade.temperature_c**2
        return samples

    def _rig(self, index: Stamps, t: Array, drive: Array) -> Samples:
        # The rig's clock is exact, so depths match surveys even if the sonde's clock drifts.
        samples = wire.RIG_STATE.empty(len(t))
        if len(t) == 0:
            return samples
        line, rig = self.motion.timeline, self.scenario.rig
        bit = line.bit(t)
        flow = line.flow(t)[0]
        samples["stamp_ns"] = self.epoch_ns + index * wire.NANOSECONDS // self.scenario.rate_hz
        samples["bit_depth"], samples["hole_depth"] = bit[0], np.maximum(line.hole(t)[0], bit[0])
        samples["block_position"] = line.block(t)[0]
        samples["hookload"], samples["weight_on_bit"] = line.hookload(t)[0], line.weight(t)[0]
        if self.string is not None:
            samples["rotary_speed"], samples["torque"] = drive[:, 0], drive[:, 1]
        else:
            samples["torque"], samples["rotary_speed"] = line.torque(t)[0], line.angle(t)[1]
        samples["flow_rate"] = flow
        full = max(rig.flow_lpm, 1e-9) * 1e-3 / 60.0
        samples["pressure"] = rig.pressure_bar * 1e5 * (flow / full) ** 2
        speed = np.maximum(bit[1], 0.0) / rig.time_lapse
        samples["rate_of_penetration"] = np.where(bit[0] >= line.hole(t)[0] - 1e-6, speed, 0.0)
        samples["valid"] = sum(wire.RIG_VALID.values())
        samples["in_slips"] = line.slips(t)[0] > 0.5
        return samples


def reference_of(scenario: Scenario) -> earth.ReferenceField:
    """Return the reference field at a scenario's place and date, or the scenario's override."""
    place = scenario.place
    lat, lon = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    date = parse_date(scenario.date).date()
    if scenario.field_override is None:
        return earth.reference_field(lat, lon, place.height_m, date, scenario.model)
    total_nt, dip_deg, declination_deg = scenario.field_override
    return earth.ReferenceField(
        total=total_nt * 1e-9,
        dip=math.radians(dip_deg),
        declination=math.radians(declination_deg),
        convergence=earth.grid_convergence(lat, lon),
        gravity=earth.gravity(lat, place.height_m),
        source="configured",
    )


def _motion(
    scenario: Scenario, rng: dict[str, np.random.Generator]
) -> tuple[motion.SimulatedMotion, CommandedFlow | None]:
    """Return the motion of a simulation, and the pumps if they obey commands."""
    well, vibration = scenario.well, scenario.vibration
    line = timeline(
        scenario.schedule * scenario.cycles,
        scenario.rig,
        well.bit_m,
        tuple((item.burst_s, item.pause_s) for item in vibration.whirl),
        rng["timeline"],
        math.radians(well.toolface_deg),
    )
    pumps = None
    if scenario.steering is not None:
        pumps = CommandedFlow(line.flow, scenario.rig.flow_lpm * 1e-3 / 60.0, scenario.rig.pump_ramp_s)
        line = dataclasses.replace(line, flow=pumps)
    active = {when: line.active(when) for when in {item.when for item in vibration.shocks}}
    moved = motion.SimulatedMotion(
        path=motion.well_path(*well.hole),
        timeline=line,
        sensor_to_bit=well.sensor_to_bit_m,
        vibrations=vibration,
        lines=draw_lines(vibration, rng["lines"]),
        hits=draw_hits(vibration.shocks, active, rng["hits"]),
    )
    return moved, pumps


# True motion of the sonde and true inputs of its sensors over an interval, without sensor errors.


class TrueInputs(NamedTuple):
    """True motion and sensor inputs of n kinematic samples; fields without a description are as in `Kinematics`."""

    mat_nt: Array
    rate_t: Array
    rate_it: Array  #: shape (n, 3); rotation relative to inertial space, rad/s
    position_n: Array
    velocity_n: Array
    md: Array
    #: `f_t`, `precision_f_t`: shape (n, 3); specific force at the conventional unit and at the precision unit, m/s^2;
    #: shape (0, 3) without a precision unit.
    f_t: Array
    precision_f_t: Array
    #: Shape (n, 2); speed, rad/s, and torque, N m, of a top drive that obeys commands; shape (n, 0) without such a top
    #: drive.
    drive: Array


# Flow of pumps that obey commands: the scheduled flow times a share that ramps to a command and back to 1.


_KEPT_S = 600.0  # time for which past shares are kept, s, because pressure and tool flow are computed later


class CommandedFlow:
    """
    Flow of pumps that obey commands.

    Parameters
    ----------
    scheduled : callable
        Flow of the schedule, m^3/s, as a `Profile` returns it. Pumps that the schedule has switched off stay off.
    full : float
        Drilling flow, m^3/s, at which the commanded share is 1.
    ramp_s : float
        Time from no flow to the drilling flow.
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
        Change the flow to a value, m^3/s, from a time on, s.

        After valid_for seconds the flow returns to the schedule, unless another command follows.

        Raises
        ------
        ValueError
            The flow is above the drilling flow, the largest flow of these pumps.
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
        """
        Ramp the flow to a share of the full flow from a time on, s; return the time at the end of the ramp, s.

        follows: append the ramp to the last ramp; otherwise the new ramp replaces all changes after its start.
        """
        now = self._knots[-1][1] if follows else float(self._share(np.array([time]))[0])
        if not follows:
            self._knots = [knot for knot in self._knots if time - _KEPT_S < knot[0] < time] or [(time, now)]
        reached = time + abs(share - now) / self._rate
        self._knots += [(time, now), (reached, share)]
        return reached

    def _share(self, t: Array) -> Array:
        times, shares = np.array(self._knots).T
        return np.asarray(np.interp(t, times, shares))


# Measuring unit of the sonde: gyros and accelerometers, from true inputs to output samples.


class MeasuringUnit:
    """
    Gyros and accelerometers of one unit with their randomly drawn errors.

    Parameters
    ----------
    unit : SimulatedUnit
        Grade, lever arm and output of the unit.
    step, rate : int
        Rate of the kinematics and of the output, Hz.
    draw, run : Generator
        Random numbers of the tool's constant errors, and of noise and drift during the simulation.
    """

    def __init__(
        self, unit: SimulatedUnit, step: int, rate: int, draw: np.random.Generator, run: np.random.Generator
    ) -> None:
        self.grade = grade(unit.grade, unit.changes)
        self.lever_t = np.array(unit.lever_mm) * 1e-3
        self.gyro = instrument.gyro_triad(self.grade.gyro, draw)
        self.accelerometer = instrument.accelerometer_triad(self.grade.accelerometer, draw)
        gyro, accelerometer = self.grade.gyro, self.grade.accelerometer
        self._gyro_weights = instrument.low_pass(gyro.bandwidth_hz, gyro.delay_ms * 1e-3, step)
        self._accel_weights = instrument.low_pass(accelerometer.bandwidth_hz, accelerometer.delay_ms * 1e-3, step)
        #: Number of kinematic samples needed before and after each output.
        self.margin = max(len(self._gyro_weights), len(self._accel_weights)) // 2
        self._integrated = unit.output == "integrated"
        # The noise of a single sample has the sensor's bandwidth; noise that is integrated has the full bandwidth of
        # the converter.
        full = float(self.grade.adc_hz)
        self._gyro_band = full if self._integrated else instrument.noise_band(gyro.bandwidth_hz, full)
        self._accel_band = full if self._integrated else instrument.noise_band(accelerometer.bandwidth_hz, full)
        self._stride = step // self.grade.adc_hz
        self._ratio = self.grade.adc_hz // rate
        self._rate = rate
        self._run = run
        self._gyro_state = instrument.initial(self.gyro, run)
        self._accel_state = instrument.initial(self.accelerometer, run)

    def samples(self, rate_it: Array, f_t: Array, margin: int, stamps: Stamps, warm: Array, gravity: Array) -> Samples:
        """
        Return the output of s steps, dtype of `wire.IMU`.

        Parameters
        ----------
        rate_it, f_t : ndarray, shape (n, 3)
            True rate, rad/s, and specific force, m/s^2, at the unit, at the kinematic rate, from `margin` samples
            before the steps to at least `self.margin` samples after them.
        margin : int
            Number of samples before the steps.
        stamps : ndarray, shape (m,)
            Stamps of the outputs, ns.
        warm : ndarray, shape (s,)
            Temperature minus the temperature of the calibration, degC.
        gravity : ndarray, shape (s,)
            Strength of gravity, m/s^2.
        """
        outputs, steps = len(stamps), len(warm)
        count = outputs * self._ratio
        first = margin + (self._stride // 2 if self._integrated else self._stride)
        rate, force = np.empty((count, 3)), np.empty((count, 3))
        instrument.filtered(rate_it, self._gyro_weights, first, self._stride, rate)
        instrument.filtered(f_t, self._accel_weights, first, self._stride, force)
        seconds = outputs // steps / self._rate
        # Random numbers of each step: for the slow biases of gyro and accelerometer, then for the noise of both.
        per_step = count // steps
        draws = self._run.standard_normal((steps, 4 + 2 * per_step, 3))
        #: Slow bias in each step of the last samples, rad/s and m/s^2; shape (s, 3).
        self.gyro_bias, self.accel_bias = np.empty((steps, 3)), np.empty((steps, 3))
        rate_read, force_read = np.empty_like(rate), np.empty_like(force)
        for k, (triad, state, bias, x, band, read) in enumerate(
            (
                (self.gyro, self._gyro_state, self.gyro_bias, rate, self._gyro_band, rate_read),
                (self.accelerometer, self._accel_state, self.accel_bias, force, self._accel_band, force_read),
            )
        ):
            slow, draw = draws[:, 2 * k : 2 * k + 2], draws[:, 4 + k * per_step : 4 + (k + 1) * per_step]
            instrument.advance(triad, state, seconds, warm, np.ascontiguousarray(slow), bias)
            noise = (triad.noise * math.sqrt(band) * draw).reshape(x.shape)
            instrument.convert(triad, bias, warm, x, force, gravity, noise, read)
        if self._integrated:
            rate_out, force_out = np.empty((outputs, 3)), np.empty((outputs, 3))
            instrument.strapdown(rate_read, force_read, self._ratio, 1.0 / self.grade.adc_hz, rate_out, force_out)
            gyro_band = accel_band = float(self._rate)
        else:
            gyro_band, accel_band = self._gyro_band, self._accel_band
            rate_out, force_out = rate_read[self._ratio - 1 :: self._ratio], force_read[self._ratio - 1 :: self._ratio]
        samples = wire.IMU.empty(outputs)
        samples["stamp_ns"] = stamps
        # No orientation is measured (REP-145).
        samples["orientation_covariance"][:, 0] = -1.0
        samples["angular_velocity"], samples["linear_acceleration"] = rate_out, force_out
        samples["angular_velocity_covariance"][:, ::4] = self.gyro.noise**2 * gyro_band + self.gyro.step**2 / 12.0
        accel = self.accelerometer
        samples["linear_acceleration_covariance"][:, ::4] = accel.noise**2 * accel_band + accel.step**2 / 12.0
        if self.grade.flags_clipping:
            for vector, triad, read in (
                ("angular_velocity", self.gyro, rate_read),
                ("linear_acceleration", self.accelerometer, force_read),
            ):
                at_limit = (np.abs(read) >= triad.limit - triad.step).reshape(outputs, self._ratio, 3)
                input_covariance.mark_clipped(samples, vector, np.asarray(at_limit.any(axis=1)))
        return samples

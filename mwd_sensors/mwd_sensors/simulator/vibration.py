"""
Vibration of a sonde in its hole: displacements and small angles in closed form, so that they stay bounded.

Everything is a displacement first; velocity and acceleration are its exact derivatives. A random vibration is a sum
of sines with random frequencies and phases in its band, which keeps the asked spectrum, integrates to a bounded
displacement and needs no memory. Six channels: displacement along the hole axes x (down-hole), y, z (high side), m;
tilt about y and about z, rad; torsion about x, rad. The hole axes are the tool's at toolface zero.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

CHANNELS = 6
# When a vibration is felt: an envelope of the schedule.
WHEN = ("always", "rotating", "sliding", "drilling", "pumping")
# Driven by the rotary speed of the phase, rad/s, and by whirl bursts: internal envelopes.
ENVELOPES = (*WHEN, "stick_slip", "burst")

_AXES = "along the hole axes x (down-hole), y, z (high side)"
_ANGLES = "about x (torsion), y, z (tilt)"


@dataclasses.dataclass(frozen=True)
class RandomVibration:
    """Random vibration with a flat spectrum of acceleration (and of angular rate) in a band."""

    band_hz: tuple[float, float] = setting(
        (8.0, 300.0), "lowest and highest frequency", unit="Hz", low=0.01, high=900.0
    )
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"root mean square {_AXES}", unit="m/s^2", low=0.0, high=1000.0
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"angular rate, root mean square {_ANGLES}", unit="deg/s", low=0.0, high=2000.0
    )
    lines: int = setting(40, "sines for each channel", low=8, high=2000)
    when: str = setting("drilling", "phases in which it is felt", choices=WHEN)

    def __post_init__(self) -> None:
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(f"band_hz {self.band_hz}: the lowest frequency must be below the highest")


@dataclasses.dataclass(frozen=True)
class Tone:
    """One sine."""

    frequency_hz: float = setting(0.3, "frequency", unit="Hz", low=0.01, high=900.0)
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"amplitude {_AXES}", unit="m/s^2", low=0.0, high=1000.0
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"amplitude of the angular rate {_ANGLES}", unit="deg/s", low=0.0, high=2000.0
    )
    when: str = setting("drilling", "phases in which it is felt", choices=WHEN)


@dataclasses.dataclass(frozen=True)
class PerTurn:
    """Motion locked to the rotation: run-out, bit bounce, wobble of the speed."""

    per_turn: int = setting(1, "cycles in one turn", low=1, high=24)
    displacement_mm: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"amplitude {_AXES}", unit="mm", low=0.0, high=50.0
    )
    speed_fraction: float = setting(
        0.0, "amplitude of the wobble of the rotary speed", unit="of the speed", low=0.0, high=1.0
    )
    phase_deg: float = setting(0.0, "phase at toolface zero", unit="deg", low=-360.0, high=360.0)


@dataclasses.dataclass(frozen=True)
class Whirl:
    """Backward (or forward) whirl: the axis runs round the hole in bursts."""

    frequency_hz: float = setting(12.0, "turns of the axis round the hole", unit="Hz", low=0.1, high=100.0)
    acceleration_mps2: float = setting(30.0, "centripetal acceleration", unit="m/s^2", low=0.0, high=1000.0)
    burst_s: tuple[float, float] = setting((2.0, 5.0), "shortest and longest burst", unit="s", low=0.2, high=600.0)
    pause_s: tuple[float, float] = setting((1.0, 4.0), "shortest and longest pause", unit="s", low=0.2, high=600.0)
    backward: bool = setting(True, "against the rotation")


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A sine whose frequency runs up and down linearly, as on a shaker (S3's vibration test)."""

    low_hz: float = setting(10.0, "frequency at the start", unit="Hz", low=0.5, high=900.0)
    high_hz: float = setting(150.0, "frequency at half the period", unit="Hz", low=0.5, high=900.0)
    period_s: float = setting(332.0, "up and down again", unit="s", low=1.0, high=36000.0)
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 50.0), f"amplitude {_AXES}; the sign is the phase", unit="m/s^2", low=-1000.0, high=1000.0
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0),
        f"amplitude of the angular rate of the rocking table {_ANGLES}",
        unit="deg/s",
        low=0.0,
        high=2000.0,
    )
    rate_phase_deg: float = setting(30.0, "of the rocking after the vibration", unit="deg", low=-360.0, high=360.0)


@dataclasses.dataclass(frozen=True)
class Shocks:
    """Hits of the wall: half-sine accelerations, each with approach and rebound: the tool stays in place."""

    rate_hz: float = setting(2.0, "mean number in a second", unit="Hz", low=0.001, high=50.0)
    peak_g: tuple[float, float] = setting(
        (50.0, 100.0), "smallest and largest peak", unit="standard gravity", low=0.1, high=5000.0
    )
    width_ms: tuple[float, float] = setting((0.5, 4.0), "shortest and longest half-sine", unit="ms", low=0.1, high=50.0)
    clearance_mm: float = setting(15.0, "the tool moves no further than this", unit="mm", low=0.5, high=200.0)
    axial_share: float = setting(0.3, "of the direction along the hole, root mean square", low=0.0, high=1.0)
    when: str = setting("drilling", "phases in which they are felt", choices=WHEN)


@dataclasses.dataclass(frozen=True)
class StickSlip:
    """The bit sticks and slips: the rotary speed swings between zero and twice its mean, or beyond."""

    frequency_hz: float = setting(0.2, "stick-slip cycles", unit="Hz", low=0.02, high=5.0)
    depth: float = setting(
        1.0, "1: down to standstill; above: backward as well", unit="of the mean speed", low=0.0, high=3.0
    )
    sticky: bool = setting(False, "stands still for a part of the cycle, then runs 2.67 times the mean speed")


@dataclasses.dataclass(frozen=True)
class Hunting:
    """Wandering of the toolface while sliding, from reactive torque."""

    toolface_deg: float = setting(8.0, "root mean square", unit="deg", low=0.0, high=180.0)
    band_hz: tuple[float, float] = setting((0.02, 0.3), "lowest and highest frequency", unit="Hz", low=0.001, high=20.0)


@dataclasses.dataclass(frozen=True)
class Vibrations:
    """All that shakes the sonde."""

    random: tuple[RandomVibration, ...] = setting((), "random vibrations")
    tones: tuple[Tone, ...] = setting((), "sines")
    per_turn: tuple[PerTurn, ...] = setting((), "motion locked to the rotation")
    whirl: tuple[Whirl, ...] = setting((), "whirl in bursts while rotating")
    sweeps: tuple[Sweep, ...] = setting((), "frequency sweeps, always felt")
    shocks: tuple[Shocks, ...] = setting((), "shocks")
    stick_slip: StickSlip | None = setting(None, "stick-slip while rotating")
    hunting: Hunting | None = setting(None, "wandering toolface while sliding")


@dataclasses.dataclass(frozen=True)
class Lines:
    """Sines, sorted by envelope and channel; arrays of shape (k,): Hz, rad, and amplitude in m or rad."""

    envelope: Indices
    channel: Indices
    frequency_hz: Array
    phase: Array
    amplitude: Array


@dataclasses.dataclass(frozen=True)
class Hits:
    """Shocks in order of time; arrays of shape (k,), direction (k, 3): s, s, m/s^2, s, unit vector in hole axes."""

    time: Array
    width: Array
    peak: Array
    lobe: Array
    direction: Array

    @property
    def displacement(self) -> Array:
        """Largest displacement of each, m, shape (k,)."""
        impulse = 2.0 * self.peak * self.width / math.pi
        return np.asarray(impulse * self.lobe / 4.0 + self.peak * self.width**2 / math.pi**2)


def lines(vibrations: Vibrations, rng: np.random.Generator) -> Lines:
    """Draw the sines of all vibrations that are sums of sines."""
    rows: list[tuple[int, int, float, float, float]] = []

    def band(when: str, channel: int, band_hz: tuple[float, float], count: int, rms: float, power: int) -> None:
        if rms == 0.0:
            return
        edges = np.linspace(band_hz[0], band_hz[1], count + 1)
        frequency = edges[:-1] + np.diff(edges) * rng.random(count)
        phase = 2.0 * math.pi * rng.random(count)
        amplitude = rms * math.sqrt(2.0 / count) / (2.0 * math.pi * frequency) ** power
        envelope = ENVELOPES.index(when)
        rows.extend((envelope, channel, f, p, a) for f, p, a in zip(frequency, phase, amplitude, strict=True))

    for item in vibrations.random:
        for axis in range(3):
            band(item.when, axis, item.band_hz, item.lines, item.acceleration_mps2[axis], 2)
            band(item.when, _ANGLE_CHANNELS[axis], item.band_hz, item.lines, math.radians(item.rate_deg_s[axis]), 1)
    for tone in vibrations.tones:
        omega = 2.0 * math.pi * tone.frequency_hz
        for axis in range(3):
            for channel, amplitude in (
                (axis, tone.acceleration_mps2[axis] / omega**2),
                (_ANGLE_CHANNELS[axis], math.radians(tone.rate_deg_s[axis]) / omega),
            ):
                if amplitude:
                    phase = 2.0 * math.pi * rng.random()
                    rows.append((ENVELOPES.index(tone.when), channel, tone.frequency_hz, phase, amplitude))
    for whirl in vibrations.whirl:
        radius = whirl.acceleration_mps2 / (2.0 * math.pi * whirl.frequency_hz) ** 2
        phase = 2.0 * math.pi * rng.random()
        # Turning from y to z is forward (clockwise looking down-hole).
        lag = 0.5 * math.pi if whirl.backward else -0.5 * math.pi
        burst = ENVELOPES.index("burst")
        rows.append((burst, 1, whirl.frequency_hz, phase, radius))
        rows.append((burst, 2, whirl.frequency_hz, phase + lag, radius))
    if vibrations.hunting is not None:
        band("sliding", 5, vibrations.hunting.band_hz, 24, math.radians(vibrations.hunting.toolface_deg), 0)
    if vibrations.stick_slip is not None:
        rows.extend(_stick_slip(vibrations.stick_slip))
    rows.sort(key=lambda row: row[:2])
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Lines(
        envelope=table[:, 0].astype(np.int64),
        channel=table[:, 1].astype(np.int64),
        frequency_hz=np.ascontiguousarray(table[:, 2]),
        phase=np.ascontiguousarray(table[:, 3]),
        amplitude=np.ascontiguousarray(table[:, 4]),
    )


_ANGLE_CHANNELS = (5, 3, 4)


def _stick_slip(item: StickSlip) -> list[tuple[int, int, float, float, float]]:
    # Rate / mean = 1 - d cos(w t), or its square brought to mean 1: 1 - 4/3 cos(w t) + 1/3 cos(2 w t), flat at zero.
    omega = 2.0 * math.pi * item.frequency_hz
    harmonics = ((1, -4.0 / 3.0), (2, 1.0 / 3.0)) if item.sticky else ((1, -1.0),)
    envelope = ENVELOPES.index("stick_slip")
    # The angle is the integral: cos(w t) -> sin(w t) / w = cos(w t - pi/2) / w.
    return [
        (envelope, 5, n * item.frequency_hz, -0.5 * math.pi, item.depth * weight / (n * omega))
        for n, weight in harmonics
    ]


def hits(shocks: tuple[Shocks, ...], active: dict[str, list[tuple[float, float]]], rng: np.random.Generator) -> Hits:
    """
    Draw the shocks of a whole run.

    active: for each name of `WHEN`, the intervals (start, end), s, in which it holds fully.
    """
    rows: list[list[float]] = []
    for item in shocks:
        for start, end in active[item.when]:
            t = start + rng.uniform(0.2, 1.0) / item.rate_hz
            while t < end:
                peak = rng.uniform(*item.peak_g) * STANDARD_GRAVITY
                width = rng.uniform(*item.width_ms) * 1e-3
                direction = rng.standard_normal(3)
                direction[0] *= item.axial_share
                direction /= np.linalg.norm(direction)
                impulse = 2.0 * peak * width / math.pi
                room = item.clearance_mm * 1e-3 - peak * width**2 / math.pi**2
                # Approach and rebound as long as the clearance allows, at most 0.1 s, at least the pulse itself.
                lobe = float(np.clip(4.0 * room / impulse, width, 0.1))
                if start < t - lobe - width and t + lobe + width < end:
                    rows.append([t, width, peak, lobe, *direction])
                t += rng.uniform(0.5, 1.5) / item.rate_hz
    table = np.array(sorted(rows), dtype=float).reshape(-1, 7)
    time, width_, peak_, lobe_ = (np.ascontiguousarray(table[:, k]) for k in range(4))
    return Hits(time=time, width=width_, peak=peak_, lobe=lobe_, direction=np.ascontiguousarray(table[:, 4:]))


@compiled
def add_lines(
    envelope: Indices,
    channel: Indices,
    frequency_hz: Array,
    phase: Array,
    amplitude: Array,
    envelopes: Array,
    start: float,
    dt: float,
    out: Array,
) -> None:
    """
    Add sines, each times its envelope, to out.

    envelopes, shape (e, 3, n), and out, shape (6, 3, n): value, rate, acceleration at start + k dt.
    """
    n = out.shape[2]
    value, rate, acceleration = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(len(channel)):
        omega = 2.0 * math.pi * frequency_hz[k]
        # Whole turns are dropped before they cost digits.
        turns = frequency_hz[k] * start
        angle = 2.0 * math.pi * (turns - math.floor(turns)) + phase[k]
        c, s = amplitude[k] * math.cos(angle), amplitude[k] * math.sin(angle)
        step_c, step_s = math.cos(omega * dt), math.sin(omega * dt)
        for i in range(n):
            value[i] += c
            rate[i] -= omega * s
            acceleration[i] -= omega * omega * c
            c, s = c * step_c - s * step_s, s * step_c + c * step_s
        last = k + 1 == len(channel)
        if last or channel[k + 1] != channel[k] or envelope[k + 1] != envelope[k]:
            e, ch = envelope[k], channel[k]
            for i in range(n):
                e0, e1, e2 = envelopes[e, 0, i], envelopes[e, 1, i], envelopes[e, 2, i]
                out[ch, 0, i] += e0 * value[i]
                out[ch, 1, i] += e0 * rate[i] + e1 * value[i]
                out[ch, 2, i] += e0 * acceleration[i] + 2.0 * e1 * rate[i] + e2 * value[i]
                value[i] = 0.0
                rate[i] = 0.0
                acceleration[i] = 0.0


@compiled
def add_per_turn(channel: Indices, per_turn: Indices, phase: Array, amplitude: Array, turn: Array, out: Array) -> None:
    """
    Add motion locked to the rotation: amplitude cos(per_turn * angle + phase).

    turn, shape (3, n): angle turned, rad, its rate and acceleration. out as in `add_lines`.
    """
    for k in range(len(channel)):
        m = float(per_turn[k])
        for i in range(out.shape[2]):
            angle = m * turn[0, i] + phase[k]
            c, s = amplitude[k] * math.cos(angle), amplitude[k] * math.sin(angle)
            omega = m * turn[1, i]
            out[channel[k], 0, i] += c
            out[channel[k], 1, i] -= omega * s
            out[channel[k], 2, i] -= omega * omega * c + m * turn[2, i] * s


@compiled
def add_sweep(
    low_hz: float,
    high_hz: float,
    period: float,
    amplitude: Array,
    power: Array,
    phase: Array,
    start: float,
    dt: float,
    out: Array,
) -> None:
    """
    Add a triangular frequency sweep: -amplitude sin(phi + phase) / omega^power in each channel.

    amplitude, power, phase, shape (6,): m/s^2 with power 2, rad/s with power 1. out as in `add_lines`.
    """
    half = 0.5 * period
    slope = (high_hz - low_hz) / half
    whole = 0.5 * (low_hz + high_hz) * half
    for i in range(out.shape[2]):
        t = start + i * dt
        cycle = math.floor(t / period)
        u = t - cycle * period
        turns = 2.0 * cycle * whole
        if u < half:
            frequency, change = low_hz + slope * u, slope
            turns += low_hz * u + 0.5 * slope * u * u
        else:
            w = u - half
            frequency, change = high_hz - slope * w, -slope
            turns += whole + high_hz * w - 0.5 * slope * w * w
        omega, omega_dot = 2.0 * math.pi * frequency, 2.0 * math.pi * change
        angle = 2.0 * math.pi * (turns - math.floor(turns))
        for ch in range(6):
            if amplitude[ch] == 0.0:
                continue
            p = power[ch]
            g = omega**-p
            g1 = -p * g * omega_dot / omega
            g2 = p * (p + 1.0) * g * (omega_dot / omega) ** 2
            s, c = math.sin(angle + phase[ch]), math.cos(angle + phase[ch])
            out[ch, 0, i] -= amplitude[ch] * g * s
            out[ch, 1, i] -= amplitude[ch] * (g1 * s + g * omega * c)
            out[ch, 2, i] -= amplitude[ch] * ((g2 - g * omega * omega) * s + (2.0 * g1 * omega + g * omega_dot) * c)


@compiled
def add_hits(
    time: Array, width: Array, peak: Array, lobe: Array, direction: Array, start: float, dt: float, out: Array
) -> None:
    """
    Add shocks: approach, half-sine, rebound; velocity and displacement are zero before and after.

    The acceleration is the mean over one step dt (the difference of the exact velocities), so that no pulse shorter
    than a step is lost or overweighted. out as in `add_lines`.
    """
    n = out.shape[2]
    end = start + n * dt
    first = np.searchsorted(time, start - 0.2)
    for k in range(first, len(time)):
        if time[k] - 0.2 > end:
            break
        reach = 0.5 * width[k] + lobe[k] + dt
        from_i = max(0, math.floor((time[k] - reach - start) / dt))
        to_i = min(n, math.ceil((time[k] + reach - start) / dt) + 1)
        for i in range(from_i, to_i):
            u = start + i * dt - time[k]
            displacement, velocity = _hit(u, width[k], peak[k], lobe[k])
            before = _hit(u - 0.5 * dt, width[k], peak[k], lobe[k])[1]
            after = _hit(u + 0.5 * dt, width[k], peak[k], lobe[k])[1]
            for axis in range(3):
                out[axis, 0, i] += direction[k, axis] * displacement
                out[axis, 1, i] += direction[k, axis] * velocity
                out[axis, 2, i] += direction[k, axis] * (after - before) / dt


@compiled
def _hit(u: float, width: float, peak: float, lobe: float) -> tuple[float, float]:
    """Displacement, m, and velocity, m/s, at the time u, s, from the middle of a shock."""
    impulse = 2.0 * peak * width / math.pi
    half = 0.5 * width
    if abs(u) <= half:
        speed = peak * width / math.pi
        turn = math.pi * u / width
        return -0.25 * impulse * lobe - speed * width / math.pi * math.cos(turn), speed * math.sin(turn)
    # By symmetry the rebound is the approach run backwards.
    v = lobe + half - abs(u)
    if v <= 0.0:
        return 0.0, 0.0
    turn = 2.0 * math.pi * v / lobe
    velocity = -impulse / lobe * (0.5 * v - lobe * math.sin(turn) / (4.0 * math.pi))
    displacement = -impulse / lobe * (0.25 * v * v + lobe * lobe * (math.cos(turn) - 1.0) / (8.0 * math.pi**2))
    return displacement, velocity if u < 0.0 else -velocity

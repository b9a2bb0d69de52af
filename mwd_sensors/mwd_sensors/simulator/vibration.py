# SPDX-License-Identifier: Apache-2.0
"""
Vibration of a sonde in its hole: shocks, random vibration, whirl, stick-slip and hunting toolface, in closed form.

Every vibration is first a bounded displacement or small angle; velocity and acceleration are its exact derivatives.
Random vibration is a sum of sines with random frequencies and phases in its band: it has the requested spectrum and a
bounded displacement, and can be computed at any instant. The six channels are: displacement along the hole axes x
(down-hole), y, z (high side), m; tilt about y and about z, rad; torsion about x, rad. The hole axes are the tool axes
at toolface zero.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

# Phases in which a vibration acts; each is an envelope of the schedule.
WHEN = ("always", "rotating", "sliding", "drilling", "pumping", "moving")
# Envelopes of the schedule: one for each phase of `WHEN`; "stick_slip", the rotary speed of the phase, rad/s; and
# "burst", the bursts of whirl.
ENVELOPES = (*WHEN, "stick_slip", "burst")

_AXES = "along the hole axes x (down-hole), y, z (high side)"
_ANGLES = "about x (torsion), y, z (tilt)"


@dataclasses.dataclass(frozen=True)
class RandomVibration:
    """Random vibration whose acceleration (and angular rate) has a flat spectrum in a band."""

    band_hz: tuple[float, float] = setting(
        (8.0, 300.0), "Lowest and highest frequency of the band.", low=0.01, high=900.0
    )
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"Root mean square {_AXES}.", unit="m/s^2", low=0.0, high=1000.0
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"Root mean square of the angular rate {_ANGLES}.", low=0.0, high=2000.0
    )
    lines: int = setting(
        40,
        "Number of sines per channel of which the vibration is composed. Raising it costs computing time.",
        low=8,
        high=2000,
    )
    when: str = setting("drilling", "Phases of the schedule in which the vibration acts.", choices=WHEN)

    def __post_init__(self) -> None:
        """Raise ValueError if the lowest frequency is not below the highest."""
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(f"band_hz {self.band_hz}: the lowest frequency must be below the highest")


@dataclasses.dataclass(frozen=True)
class Tone:
    """Vibration at one frequency."""

    frequency_hz: float = setting(0.3, "Frequency of the vibration.", low=0.01, high=900.0)
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"Amplitude {_AXES}.", unit="m/s^2", low=0.0, high=1000.0
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"Amplitude of the angular rate {_ANGLES}.", low=0.0, high=2000.0
    )
    when: str = setting("drilling", "Phases of the schedule in which the vibration acts.", choices=WHEN)


@dataclasses.dataclass(frozen=True)
class PerTurn:
    """Motion locked to the rotation: run-out, bit bounce, variation of the speed."""

    per_turn: int = setting(1, "Number of cycles in one turn.", low=1, high=24)
    displacement_mm: tuple[float, float, float] = setting((0.0, 0.0, 0.0), f"Amplitude {_AXES}.", low=0.0, high=50.0)
    speed_fraction: float = setting(
        0.0, "Amplitude of the variation of the rotary speed, as a share of this speed.", low=0.0, high=1.0
    )
    phase_deg: float = setting(0.0, "Phase of the motion at toolface zero.", low=-360.0, high=360.0)


@dataclasses.dataclass(frozen=True)
class Whirl:
    """Backward (or forward) whirl: the tool axis moves around the hole in bursts."""

    frequency_hz: float = setting(12.0, "Revolutions of the tool axis around the hole per second.", low=0.1, high=100.0)
    acceleration_mps2: float = setting(
        30.0, "Centripetal acceleration of the tool axis.", unit="m/s^2", low=0.0, high=1000.0
    )
    burst_s: tuple[float, float] = setting((2.0, 5.0), "Shortest and longest duration of a burst.", low=0.2, high=600.0)
    pause_s: tuple[float, float] = setting(
        (1.0, 4.0), "Shortest and longest pause between bursts.", low=0.2, high=600.0
    )
    backward: bool = setting(True, "True if the axis revolves against the rotation of the string.")


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A sine whose frequency rises and falls linearly, as on a shaker (test in S3, docs/references.md)."""

    low_hz: float = setting(10.0, "Frequency at the start.", low=0.5, high=900.0)
    high_hz: float = setting(150.0, "Frequency after half the period.", low=0.5, high=900.0)
    period_s: float = setting(332.0, "Duration of one rise and fall of the frequency.", low=1.0, high=36000.0)
    acceleration_mps2: tuple[float, float, float] = setting(
        (0.0, 0.0, 50.0),
        f"Amplitude {_AXES}. A negative sign reverses the phase.",
        unit="m/s^2",
        low=-1000.0,
        high=1000.0,
    )
    rate_deg_s: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), f"Amplitude of the angular rate of the rocking table {_ANGLES}.", low=0.0, high=2000.0
    )
    rate_phase_deg: float = setting(
        30.0, "Phase by which the rocking of the table follows the vibration.", low=-360.0, high=360.0
    )


@dataclasses.dataclass(frozen=True)
class Shocks:
    """Impacts on the wall: half-sine accelerations with approach and rebound, so that the tool stays in place."""

    rate_hz: float = setting(2.0, "Mean number of shocks per second.", low=0.001, high=50.0)
    peak_g: tuple[float, float] = setting(
        (50.0, 100.0), "Smallest and largest peak acceleration.", unit="standard gravity", low=0.1, high=5000.0
    )
    width_ms: tuple[float, float] = setting(
        (0.5, 4.0), "Shortest and longest duration of a half-sine.", unit="ms", low=0.1, high=50.0
    )
    clearance_mm: float = setting(15.0, "Largest displacement of the tool.", low=0.5, high=200.0)
    axial_share: float = setting(
        0.3,
        "Component of a shock along the hole divided by each component across it, root mean square. At 1 all "
        "directions are equally probable.",
        low=0.0,
        high=1.0,
    )
    when: str = setting("drilling", "Phases of the schedule in which shocks occur.", choices=WHEN)


@dataclasses.dataclass(frozen=True)
class StickSlip:
    """Stick-slip of the bit: the rotary speed varies between zero and twice its mean, or more."""

    frequency_hz: float = setting(0.2, "Number of stick-slip cycles per second.", low=0.02, high=5.0)
    depth: float = setting(
        1.0,
        "Amplitude of the rotary speed, as a share of the mean speed. At 1 the string stops for a moment; above 1 it "
        "also turns backward.",
        low=0.0,
        high=3.0,
    )
    sticky: bool = setting(
        False, "True if the string stands still for part of the cycle and then reaches 2.67 times the mean speed."
    )


@dataclasses.dataclass(frozen=True)
class Hunting:
    """Wandering of the toolface while sliding, caused by reactive torque."""

    toolface_deg: float = setting(
        8.0, "Deviation of the toolface from its mean, root mean square.", low=0.0, high=180.0
    )
    band_hz: tuple[float, float] = setting(
        (0.02, 0.3), "Lowest and highest frequency of the deviation.", low=0.001, high=20.0
    )


@dataclasses.dataclass(frozen=True)
class Vibrations:
    """All vibration of the sonde."""

    random: tuple[RandomVibration, ...] = setting((), "Random vibrations.")
    tones: tuple[Tone, ...] = setting((), "Vibrations at one frequency.")
    per_turn: tuple[PerTurn, ...] = setting((), "Motions locked to the rotation.")
    whirl: tuple[Whirl, ...] = setting((), "Whirl in bursts while the string rotates.")
    sweeps: tuple[Sweep, ...] = setting((), "Frequency sweeps, which always act.")
    shocks: tuple[Shocks, ...] = setting((), "Shocks at the wall of the hole.")
    stick_slip: StickSlip | None = setting(None, "Stick-slip while the string rotates.")
    hunting: Hunting | None = setting(None, "Wandering toolface while sliding.")


CHANNELS = 6


class SpectralLines(NamedTuple):
    """Sines sorted by envelope and channel; arrays of shape (k,): frequency, Hz, phase, rad, amplitude, m or rad."""

    envelope: Indices
    channel: Indices
    frequency_hz: Array
    phase: Array
    amplitude: Array


class PerTurnLines(NamedTuple):
    """Sines of the string's angle; arrays of shape (k,): channel, cycles per turn, phase, rad, amplitude, m or rad."""

    channel: Indices
    per_turn: Indices
    phase: Array
    amplitude: Array


class SweepLines(NamedTuple):
    """
    A frequency sweep.

    Each array has one element per channel, shape (6,): amplitude of the acceleration, m/s^2 (power 2), or of the
    angular rate, rad/s (power 1), and phase, rad.
    """

    low_hz: float
    high_hz: float
    period_s: float
    amplitude: Array
    power: Array
    phase: Array


class Hits(NamedTuple):
    """
    Shocks in order of time: time, s, width, s, peak, m/s^2, and lobe, s, shape (k,) each, and direction, shape (k, 3).

    The lobe is the duration of approach and of rebound. The direction is a unit vector in hole axes.
    """

    time: Array
    width: Array
    peak: Array
    lobe: Array
    direction: Array

    @property
    def displacement(self) -> Array:
        """Largest displacement of each shock, m, shape (k,)."""
        impulse = 2.0 * self.peak * self.width / math.pi
        return np.asarray(impulse * self.lobe / 4.0 + self.peak * self.width**2 / math.pi**2)


def draw_lines(vibrations: Vibrations, rng: np.random.Generator) -> SpectralLines:
    """Return the sines of random vibration, tones, whirl, hunting and stick-slip; only stick-slip has a fixed phase."""
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
        # A rotation from y to z is forward (clockwise looking down-hole).
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
    return SpectralLines(
        envelope=table[:, 0].astype(np.int64),
        channel=table[:, 1].astype(np.int64),
        frequency_hz=np.ascontiguousarray(table[:, 2]),
        phase=np.ascontiguousarray(table[:, 3]),
        amplitude=np.ascontiguousarray(table[:, 4]),
    )


_ANGLE_CHANNELS = (5, 3, 4)


def _stick_slip(item: StickSlip) -> list[tuple[int, int, float, float, float]]:
    # Rate / mean = 1 - d cos(w t). Sticky: (1 - cos(w t))^2 scaled to mean 1, which is
    # 1 - 4/3 cos(w t) + 1/3 cos(2 w t) and flat at zero.
    omega = 2.0 * math.pi * item.frequency_hz
    harmonics = ((1, -4.0 / 3.0), (2, 1.0 / 3.0)) if item.sticky else ((1, -1.0),)
    envelope = ENVELOPES.index("stick_slip")
    # The angle is the integral of the rate: cos(w t) becomes sin(w t) / w = cos(w t - pi/2) / w.
    return [
        (envelope, 5, n * item.frequency_hz, -0.5 * math.pi, item.depth * weight / (n * omega))
        for n, weight in harmonics
    ]


def draw_hits(
    shocks: tuple[Shocks, ...], active: dict[str, list[tuple[float, float]]], rng: np.random.Generator
) -> Hits:
    """
    Draw the shocks of a whole simulation.

    active maps each name of `WHEN` to the intervals (start, end), s, in which its envelope is constant and above 0.5.
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
                # Approach and rebound last as long as the clearance allows, at most 0.1 s and at least as long as the
                # pulse.
                lobe = float(np.clip(4.0 * room / impulse, width, 0.1))
                if start < t - lobe - width and t + lobe + width < end:
                    rows.append([t, width, peak, lobe, *direction])
                t += rng.uniform(0.5, 1.5) / item.rate_hz
    table = np.array(sorted(rows), dtype=float).reshape(-1, 7)
    time, width_, peak_, lobe_ = (np.ascontiguousarray(table[:, k]) for k in range(4))
    return Hits(time=time, width=width_, peak=peak_, lobe=lobe_, direction=np.ascontiguousarray(table[:, 4:]))


@compiled
def add_lines(lines: SpectralLines, envelopes: Array, start: float, dt: float, out: Array) -> None:
    """
    Add sines, each multiplied by its envelope, to out.

    envelopes, shape (e, 3, n), and out, shape (6, 3, n), hold value, rate and acceleration at start + k dt.
    """
    count = len(lines.channel)
    omega = 2.0 * math.pi * lines.frequency_hz
    c, s, step_c, step_s = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for k in range(count):
        # Subtract whole turns first, because a large angle would lose digits.
        turns = lines.frequency_hz[k] * start
        angle = 2.0 * math.pi * (turns - math.floor(turns)) + lines.phase[k]
        c[k], s[k] = lines.amplitude[k] * math.cos(angle), lines.amplitude[k] * math.sin(angle)
        step_c[k], step_s[k] = math.cos(omega[k] * dt), math.sin(omega[k] * dt)
    first = 0
    while first < count:
        e, ch = lines.envelope[first], lines.channel[first]
        end = first + 1
        while end < count and lines.channel[end] == ch and lines.envelope[end] == e:
            end += 1
        # Lines whose envelope is zero in the whole block are skipped.
        active = np.any(envelopes[e] != 0.0)
        for i in range(out.shape[2] if active else 0):
            value, rate, acceleration = 0.0, 0.0, 0.0
            for k in range(first, end):
                value += c[k]
                rate -= omega[k] * s[k]
                acceleration -= omega[k] * omega[k] * c[k]
                c[k], s[k] = c[k] * step_c[k] - s[k] * step_s[k], s[k] * step_c[k] + c[k] * step_s[k]
            e0, e1, e2 = envelopes[e, 0, i], envelopes[e, 1, i], envelopes[e, 2, i]
            out[ch, 0, i] += e0 * value
            out[ch, 1, i] += e0 * rate + e1 * value
            out[ch, 2, i] += e0 * acceleration + 2.0 * e1 * rate + e2 * value
        first = end


@compiled
def add_per_turn(lines: PerTurnLines, turn: Array, out: Array) -> None:
    """
    Add motion locked to the rotation: amplitude cos(per_turn * angle + phase).

    turn, shape (3, n), is the string's angle, rad, with rate and acceleration. out is as in `add_lines`.
    """
    channel, per_turn, phase, amplitude = lines.channel, lines.per_turn, lines.phase, lines.amplitude
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
def add_sweep(sweep: SweepLines, start: float, dt: float, out: Array) -> None:
    """
    Add a triangular frequency sweep to out: -amplitude sin(phi + phase) / omega^power in each channel.

    out is as in `add_lines`.
    """
    low_hz, high_hz, period = sweep.low_hz, sweep.high_hz, sweep.period_s
    amplitude, power, phase = sweep.amplitude, sweep.power, sweep.phase
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
def add_hits(hits: Hits, start: float, dt: float, out: Array) -> None:
    """
    Add shocks (approach, half-sine, rebound); velocity and displacement are zero before and after.

    The acceleration is the mean over one step dt (the difference of the exact velocities), so that a pulse that is
    shorter than a step keeps its weight. out is as in `add_lines`.
    """
    n = out.shape[2]
    end = start + n * dt
    time, width, peak, lobe, direction = hits.time, hits.width, hits.peak, hits.lobe, hits.direction
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
    """Return displacement, m, and velocity, m/s, at a time u, s, from the middle of a shock."""
    impulse = 2.0 * peak * width / math.pi
    half = 0.5 * width
    if abs(u) <= half:
        speed = peak * width / math.pi
        turn = math.pi * u / width
        return -0.25 * impulse * lobe - speed * width / math.pi * math.cos(turn), speed * math.sin(turn)
    # By symmetry the rebound is the approach in reverse.
    v = lobe + half - abs(u)
    if v <= 0.0:
        return 0.0, 0.0
    turn = 2.0 * math.pi * v / lobe
    velocity = -impulse / lobe * (0.5 * v - lobe * math.sin(turn) / (4.0 * math.pi))
    displacement = -impulse / lobe * (0.25 * v * v + lobe * lobe * (math.cos(turn) - 1.0) / (8.0 * math.pi**2))
    return displacement, velocity if u < 0.0 else -velocity

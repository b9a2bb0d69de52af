# SPDX-License-Identifier: Apache-2.0
"""Vibration settings of a scenario: shocks, random vibration, whirl, stick-slip and hunting toolface."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

# Phases in which a vibration acts; each is an envelope of the schedule.
WHEN = ("always", "rotating", "sliding", "drilling", "pumping", "moving")
# Envelopes of the phases of `WHEN`, and two more: rotary speed of the phase, rad/s, for stick-slip, and whirl bursts.
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
    when: str = setting("drilling", "Phases of the schedule in which it acts.", choices=WHEN)

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
    when: str = setting("drilling", "Phases of the schedule in which it acts.", choices=WHEN)


@dataclasses.dataclass(frozen=True)
class PerTurn:
    """Motion locked to the rotation: run-out, bit bounce, variation of the speed."""

    per_turn: int = setting(1, "Number of cycles in one turn.", low=1, high=24)
    displacement_mm: tuple[float, float, float] = setting((0.0, 0.0, 0.0), f"Amplitude {_AXES}.", low=0.0, high=50.0)
    speed_fraction: float = setting(
        0.0, "Amplitude of the variation of the rotary speed.", unit="of the speed", low=0.0, high=1.0
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
        "Amplitude of the rotary speed. At 1 the string stops for a moment; above 1 it also turns backward.",
        unit="of the mean speed",
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

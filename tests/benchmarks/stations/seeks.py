# SPDX-License-Identifier: Apache-2.0
"""Gyro azimuths of the stations of a run, by a tactical unit that is as its data sheet says, better, worse or moved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from north_signals import measured, motion

from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.time_bins import Bin
from mwd_estimation.gyrocompass.seek_state import TACTICAL
from mwd_estimation.gyrocompass.station import GyroStation
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import wrap_pi
from stations.tool_code import DEG

HEAD = "| gyro | stations | azimuth given % | rms deg | sigma deg | NEES | +- by the runs | > 3 sigma % |"
STATIONS = 8
# White noise of a tactical unit, deg/sqrt(h), and of its accelerometers, ug/sqrt(Hz); the rest is as `TACTICAL` states.
_NOISE, _ACCEL_NOISE = 0.05, TACTICAL.accel_noise_ug_rthz
_RATE, _BIN = 50.0, 25
# A station: time to settle, which shows the noise, and at rest, s; and the time between two.
_SETTLING_BINS, _AT_REST_S, _BETWEEN_S = 10, 62.0, 1800.0
# Local gravity less normal gravity, as a share, 1 sigma.
_LOCAL_GRAVITY = 2e-4
# Time in which the temperature, and with it the ramp of a bias, becomes another, s.
_WARMING_S = 3600.0
# Sway of a hanging string, Hz, and the spread of inclination and azimuth between stations.
_SWAY_HZ, _CURVES = (0.05, 0.5), (3.0 * DEG, 4.0 * DEG)
# The station before which biases step.
_STEPS_AT = 4


@dataclasses.dataclass(frozen=True)
class Unit:
    """How a unit and its string differ from what is stated."""

    worse: float = 1.0  #: bias and drift over those stated, 1 sigma
    noise: float = 1.0  #: white noise over that of a tactical unit
    warming: float = 0.0  #: ramp of each bias, either way, throughout, deg/h per hour; 0: drawn as stated
    stated_noise: float = 0.0  #: white noise that the settings state, deg/sqrt(h); 0: measured at rest
    g_sensitivity: float = 1.0  #: g-sensitivity over that stated, 1 sigma
    #: Error of the latitude that the settings state, deg, either way.
    latitude_off: float = 0.0
    #: Amplitudes of the sway of the string, rad: least and largest.
    sway: tuple[float, float] = (0.0, 0.0)
    step: float = 0.0  #: of each bias before the fifth station, 1 sigma, deg/h
    one_attitude: bool = False  #: the toolface, inclination and azimuth of all stations are the first one's
    #: What of the run is judged, by the words its row has.
    parts: dict[str, slice] = dataclasses.field(default_factory=lambda: {"": slice(None)})


UNITS = {
    "as stated": Unit(),
    "as stated, all stations at one attitude": Unit(one_attitude=True),
    "warming up, 3 deg/h per hour": Unit(warming=3.0),
    "noise four times as large": Unit(noise=4.0),
    "string swaying up to .2 deg": Unit(sway=(0.0, 0.2 * DEG)),
    "three times better than stated": Unit(worse=1.0 / 3.0),
    "three times worse than stated": Unit(worse=3.0),
    "bias stepping by 5 deg/h": Unit(
        step=5.0,
        parts={
            "before it": slice(0, _STEPS_AT),
            "next after it": slice(_STEPS_AT, _STEPS_AT + 1),
            "later": slice(_STEPS_AT + 1, None),
        },
    ),
    "noise four times the stated one": Unit(noise=4.0, stated_noise=_NOISE),
    "g-sensitivity three times the stated one": Unit(g_sensitivity=3.0),
    "string swaying by .05 deg": Unit(sway=(0.05 * DEG, 0.05 * DEG)),
    "bias ramp of 10 deg/h per hour": Unit(warming=10.0),
    "latitude 3 deg wrong": Unit(latitude_off=3.0),
    "latitude 10 deg wrong": Unit(latitude_off=10.0),
    "latitude 15 deg wrong": Unit(latitude_off=15.0),
}


@dataclasses.dataclass(frozen=True)
class Found:
    """Error and sigma of one gyro azimuth, rad; whether it was given."""

    error: float
    sigma: float
    given: bool


class _Biases:
    """True biases of a unit, rad/s, over a run."""

    def __init__(self, unit: Unit, rng: np.random.Generator) -> None:
        self._unit, self._rng = unit, rng
        self._ramp_sigma = unit.worse * TACTICAL.gyro_ramp_deg_h2 * DEG_PER_HOUR / 3600.0
        self._walk = unit.worse * TACTICAL.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0
        self.now: Array = unit.worse * TACTICAL.gyro_bias_deg_h * DEG_PER_HOUR * rng.standard_normal(3)
        self._ramp: Array = self._ramp_sigma * rng.standard_normal(3)
        if unit.warming:
            self._ramp = rng.choice([-1.0, 1.0], 3) * unit.warming * DEG_PER_HOUR / 3600.0

    def at_rest(self, samples: int) -> Array:
        """Biases of each sample, shape (n, 3)."""
        time = (np.arange(samples) + 1.0)[:, None] / _RATE
        walked = self._walk / math.sqrt(_RATE) * np.cumsum(self._rng.standard_normal((samples, 3)), axis=0)
        biases = self.now + self._ramp * time + walked
        self.now = biases[-1]
        return np.asarray(biases)

    def drill(self, seconds: float) -> None:
        """Let them drift until the next station."""
        self.now = self.now + self._ramp * seconds + self._walk * math.sqrt(seconds) * self._rng.standard_normal(3)
        if not self._unit.warming:
            kept = math.exp(-seconds / _WARMING_S)
            other = self._ramp_sigma * self._rng.standard_normal(3)
            self._ramp = kept * self._ramp + math.sqrt(1.0 - kept * kept) * other


def run(unit: Unit, rng: np.random.Generator) -> list[Found]:
    """One run of eight stations of a minute, half an hour apart, at a place and with attitudes of its own."""
    latitude_deg, biases = rng.uniform(10.0, 62.0), _Biases(unit, rng)
    stated_deg = latitude_deg + unit.latitude_off * rng.choice([-1.0, 1.0]) if unit.latitude_off else latitude_deg
    station = GyroStation(dataclasses.replace(TACTICAL, latitude_deg=stated_deg, gyro_noise_deg_rth=unit.stated_noise))
    errs = _lasting(unit, rng)
    inclination, azimuth, toolface = rng.uniform([20.0, 0.0, 0.0], [90.0, 360.0, 360.0]) * DEG
    found = []
    for k in range(STATIONS):
        if not unit.one_attitude:
            inclination = min(max(inclination + rng.normal(0.0, _CURVES[0]), 15.0 * DEG), 100.0 * DEG)
            azimuth, toolface = azimuth + rng.normal(0.0, _CURVES[1]), rng.uniform(0.0, math.tau)
        if k == _STEPS_AT:
            biases.now = biases.now + unit.step * DEG_PER_HOUR * rng.standard_normal(3)
        stamps, values = _samples(unit, (inclination, azimuth, toolface), latitude_deg, errs, biases, rng)
        stamps = stamps + round(k * _BETWEEN_S * 1e9)
        _rest(station, stamps, values)
        given = station.solution()
        if given is None:
            raise RuntimeError("the station got no samples")
        found.append(Found(float(wrap_pi(given.azimuth - azimuth)), given.sigma, given.success))
        _drill(station, int(stamps[-1]), _BETWEEN_S - _AT_REST_S)
        biases.drill(_BETWEEN_S - _AT_REST_S)
    return found


def _lasting(unit: Unit, rng: np.random.Generator) -> dict[str, Any]:
    """
    Errors that are the same throughout, other than the gyros' biases.

    These are g-sensitivity, rad/s per m/s^2, accelerometer bias, and accelerometer scale with the local gravity.
    """
    sensitivity = (
        unit.g_sensitivity
        * TACTICAL.g_sensitivity_deg_h_g
        * DEG_PER_HOUR
        / STANDARD_GRAVITY
        * rng.standard_normal((2, 2))
    )
    return {
        "g_sensitivity": sensitivity,
        "accel_bias": TACTICAL.accel_bias_ug * MICRO_G * rng.standard_normal(3),
        "accel_scale": float(rng.standard_normal(2) @ [TACTICAL.accel_scale_ppm * 1e-6, _LOCAL_GRAVITY]),
    }


def _samples(
    unit: Unit,
    attitude: tuple[float, float, float],
    latitude_deg: float,
    errs: dict[str, Any],
    biases: _Biases,
    rng: np.random.Generator,
) -> tuple[Stamps, Array]:
    """Stamps, shape (n,), and rates and forces, shape (n, 6), of a tool that hangs still or sways."""
    inclination, azimuth, toolface = attitude
    size, hz = rng.uniform(*unit.sway), rng.uniform(*_SWAY_HZ)
    phase = rng.uniform(0.0, math.tau, 2)

    def swaying(middle: float, size: float, phase: float) -> Callable[[Array], Array]:
        return lambda t: middle + size * np.sin(math.tau * hz * t + phase)

    clean = motion(
        _AT_REST_S,
        latitude_deg * DEG,
        swaying(inclination, size, phase[0]),
        swaying(azimuth, size / max(math.sin(inclination), 0.2), phase[1]),
        lambda t: np.full(np.shape(t), toolface),
        _RATE,
    )
    gyro, accel = measured(clean, rng, _NOISE * unit.noise, None, _ACCEL_NOISE, **errs)
    return clean.stamp_ns, np.hstack([gyro + biases.at_rest(len(gyro)), accel])


def _rest(station: GyroStation, stamps: Stamps, values: Array) -> None:
    """A rest, bin by bin; the string settles in the first ones."""
    for k, at in enumerate(range(0, len(stamps), _BIN)):
        part = slice(at, at + _BIN)
        station.add(_bin(values[part], 0.0), _BIN / _RATE, k >= _SETTLING_BINS, True, _unit(stamps[part], values[part]))


def _drill(station: GyroStation, last_ns: int, seconds: float) -> None:
    """One bin of drilling: it shakes, and its samples leave no gap to the rests around it."""
    stamps = last_ns + np.array([1, round(seconds * 1e9) - 1], dtype=np.int64)
    values = np.zeros((2, 6))
    station.add(_bin(values, 1e4), seconds, False, False, _unit(stamps, values))


def _bin(values: Array, scatter: float) -> Bin:
    return Bin(0, len(values), values.mean(axis=0), scatter * np.eye(6), values.min(axis=0), values.max(axis=0))


def _unit(stamps: Stamps, values: Array) -> UnitSamples:
    return UnitSamples(stamps, values, None)


def rows(name: str, count: int, seed: int) -> list[str]:
    """Rows under `HEAD`: runs of a unit, one row for each part that is judged."""
    unit, rng = UNITS[name], np.random.default_rng([seed, 300 + list(UNITS).index(name)])
    runs = [run(unit, rng) for _ in range(count)]
    return [
        _row(f"{name}{words and f': {words}'}", [found[part] for found in runs]) for words, part in unit.parts.items()
    ]


def _row(name: str, runs: list[list[Found]]) -> str:
    given = [[(one.error, one.sigma) for one in found if one.given] for found in runs]
    pairs = np.array([pair for found in given for pair in found]).reshape(-1, 2)
    stations = sum(len(found) for found in runs)
    words = [name, str(stations), f"{100.0 * len(pairs) / stations:.0f}"]
    if not len(pairs):
        return "| " + " | ".join([*words, *[""] * 5]) + " |"
    error, sigma = pairs.T
    squares, nees = (error / sigma) ** 2, float(np.mean((error / sigma) ** 2))
    # The stations of a run share its biases: the spread of the mean is that of a ratio of sums over runs (Cochran,
    # Sampling Techniques, section 6.3).
    off = [sum((e / s) ** 2 - nees for e, s in found) for found in given]
    spread = 1.96 * math.sqrt(float(np.sum(np.square(off)))) / len(pairs)
    words += [f"{math.sqrt(np.mean(error**2)) / DEG:.2f}", f"{float(np.median(sigma)) / DEG:.2f}"]
    words += [f"{nees:.2f}", f"{spread:.2f}", f"{100.0 * np.mean(squares > 9.0):.2f}"]
    return "| " + " | ".join(words) + " |"

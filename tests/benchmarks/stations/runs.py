# SPDX-License-Identifier: Apache-2.0
"""Runs of stations with one tool in one assembly, each decided with those before it, as a live run is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from mwd_estimation.attitude.gyro_azimuth_filter import PropagatedAzimuth
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau
from stations import disturbances, judge, tool_code, truth
from stations.disturbances import Disturbance
from stations.judge import Judged
from stations.tool_code import DEG

STATIONS = 30
_BETWEEN_S = 1800
_HOURS = np.arange(STATIONS) * _BETWEEN_S / 3600.0
_ALONG = np.linspace(0.0, 1.0, STATIONS)
# The first station after a trip out of the hole and back, h, and the stations of a landing.
_TRIP, _TRIP_HOURS, _LANDING = 10, 30.0, slice(8, 23)
# Stations with steel nearby; those whose readings are played again in place of new ones, and what is played.
STEEL, REPLAYED, PLAYED = slice(12, 18), slice(20, 23), 10
# A gyro at the equator, rad: errs anew at each station, alike at all; azimuth propagated between two stations.
_GYRO_NOISE, _GYRO_LASTING, _PROPAGATED = 1.0 * DEG, 0.4 * DEG, 0.5 * DEG
_OUTLIER = 20.0 * DEG
_DISAGREES = 3.0

Attitudes = Callable[[np.random.Generator], tuple[Array, Array]]
Outside = Callable[[np.random.Generator], Array]
# Field of the string at each station beside that of `of_tool`, tool axes, T, shape (30, 3).
OfString = Callable[[np.random.Generator], Array]


@dataclasses.dataclass(frozen=True)
class Gyro:
    """North at each station: share of outliers, and what is added to the azimuth from a station on, rad."""

    outliers: float = 0.0
    steps: tuple[tuple[int, float], ...] = ()

    def seek(self, azimuth: Array, latitude: float, rng: np.random.Generator) -> list[Solution | None]:
        """Azimuths from true north, rad, shape (n,), as a seek hands them over."""
        noise, lasting = (size / math.cos(latitude) for size in (_GYRO_NOISE, _GYRO_LASTING))
        n = len(azimuth)
        found = azimuth + rng.normal(0.0, noise, n) + rng.normal(0.0, lasting)
        found = found + np.where(rng.random(n) < self.outliers, rng.normal(0.0, _OUTLIER, n), 0.0)
        for first, step in self.steps:
            found[first:] += step
        sigma = math.hypot(noise, lasting)
        return [Solution(None, "still", float(one), sigma, 0.0, 0.0, 120.0, noise) for one in wrap_tau(found)]


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of run."""

    attitudes: Attitudes  #: inclination and azimuth of the hole, rad, shape (30,)
    of_tool: Disturbance = disturbances.nothing  #: disturbance that lasts for the whole run
    outside: Outside | None = None  #: field from outside at each station, north, east, down, T, shape (30, 3)
    gyro: Gyro | None = None
    twice: bool = False  #: the readings of each station come twice
    replayed: bool = False  #: at some stations the readings of an earlier one come again, though the tool has moved
    #: What of the run is judged, by the words its row has.
    parts: dict[str, slice] = dataclasses.field(default_factory=lambda: {"": slice(None)})
    #: Field of the string at each station where it changes within the run, tool axes, T, shape (30, 3).
    of_string: OfString | None = None
    hours: Array = dataclasses.field(default_factory=_HOURS.copy)  #: shape (30,); time of each station, h


def _curve(rng: np.random.Generator) -> tuple[Array, Array]:
    """From 5 deg, built to an east-west horizontal."""
    return (5.0 + 85.0 * _ALONG) * DEG, (20.0 + 70.0 * _ALONG) * DEG


def _east_west(rng: np.random.Generator) -> tuple[Array, Array]:
    return (90.0 + 1.5 * np.sin(8.0 * _ALONG)) * DEG, (90.0 + 4.0 * np.sin(5.0 * _ALONG)) * DEG


def _near_vertical(rng: np.random.Generator) -> tuple[Array, Array]:
    return (1.0 + 5.0 * _ALONG) * DEG, rng.uniform(0.0, math.tau) + 30.0 * DEG * _ALONG


def _build_and_lateral(rng: np.random.Generator) -> tuple[Array, Array]:
    """Built to 45 deg towards the east before a trip, then an east-west lateral."""
    inclination, azimuth = 90.0 + 1.5 * np.sin(8.0 * _ALONG), 90.0 + 4.0 * np.sin(5.0 * _ALONG)
    inclination[:_TRIP], azimuth[:_TRIP] = np.linspace(5.0, 45.0, _TRIP), np.linspace(40.0, 85.0, _TRIP)
    return inclination * DEG, azimuth * DEG


def _landed(rng: np.random.Generator) -> tuple[Array, Array]:
    """From 30 deg, landed to an east-west lateral."""
    place = np.clip((np.arange(STATIONS) - 4) / 16.0, 0.0, 1.0)
    return (30.0 + 60.0 * place) * DEG, (60.0 + 30.0 * place + 3.0 * np.sin(6.0 * _ALONG)) * DEG


def _after_trip() -> Array:
    hours = _HOURS.copy()
    hours[_TRIP:] += _TRIP_HOURS
    return hours


def _other_string(low: float, high: float, cross: float = 0.0) -> OfString:
    """The string another from the trip on: its field before and after, along and across, T."""

    def of(rng: np.random.Generator) -> Array:
        field = np.zeros((STATIONS, 3))
        field[_TRIP:] = disturbances.along(disturbances.between(low, high, rng), rng)
        if cross:
            field[_TRIP:] += disturbances.across(rng.uniform(0.2, 1.0) * cross, rng)
        return field

    return of


def _growing(low: float, high: float) -> OfString:
    """Remanence along the axis that grows evenly through a landing, T."""

    def of(rng: np.random.Generator) -> Array:
        grown = np.zeros(STATIONS)
        grown[_LANDING] = np.linspace(0.0, 1.0, _LANDING.stop - _LANDING.start)
        grown[_LANDING.stop :] = 1.0
        return np.outer(grown, disturbances.along(disturbances.between(low, high, rng), rng))

    return of


def _steel_in_the_middle(rng: np.random.Generator) -> Array:
    """.5 to 4 uT, another at each of six stations."""
    field = np.zeros((STATIONS, 3))
    for k in range(*STEEL.indices(STATIONS)):
        field[k] = disturbances.between(0.5e-6, 4e-6, rng) * disturbances.direction(rng)
    return field


def _drifting_storm(rng: np.random.Generator) -> Array:
    """150 to 400 nT, root mean square, correlated over three hours."""
    size, keep = rng.uniform(150e-9, 400e-9) / math.sqrt(3.0), math.exp(-_BETWEEN_S / 10800.0)
    field = np.zeros((STATIONS, 3))
    field[0] = rng.normal(0.0, size, 3)
    for k in range(1, STATIONS):
        field[k] = keep * field[k - 1] + rng.normal(0.0, size * math.sqrt(1.0 - keep**2), 3)
    return field


KINDS = {
    "curve to east-west, no interference": Kind(_curve),
    "curve to east-west, 300-1500 nT along, a gyro with 10 % outliers": Kind(
        _curve, disturbances.magnetised(300e-9, 1500e-9), gyro=Gyro(0.1)
    ),
    "the same, steel .5-4 uT at six stations": Kind(
        _curve,
        disturbances.magnetised(300e-9, 1500e-9),
        _steel_in_the_middle,
        Gyro(0.1),
        parts={"before it": slice(0, 12), "at it": STEEL, "after it": slice(18, None)},
    ),
    "steel .5-4 uT at six stations, no gyro": Kind(
        _curve,
        disturbances.magnetised(300e-9, 1500e-9),
        _steel_in_the_middle,
        parts={"before it": slice(0, 12), "at it": STEEL, "after it": slice(18, None)},
    ),
    "east-west throughout, 900 nT along": Kind(_east_west, disturbances.magnetised(900e-9, 900.1e-9)),
    "hot collar, 650 nT along, 200-500 nT across": Kind(_curve, disturbances.hot_collar),
    "storm, 150-400 nT, drifting": Kind(_curve, outside=_drifting_storm),
    "reference off 400 nT, .5, 1 deg": Kind(_curve, disturbances.reference_off),
    "near vertical, 1-6 deg": Kind(_near_vertical),
    "string magnetised along, 3-20 uT": Kind(_curve, disturbances.magnetised(3e-6, 20e-6)),
    "gyro stepping by 4 and -6 deg": Kind(_curve, gyro=Gyro(steps=((14, 4.0 * DEG), (22, -6.0 * DEG)))),
    "magnetometer 2 % strong": Kind(_curve, disturbances.strong_magnetometer),
    "accelerometers turned 2 deg": Kind(_curve, disturbances.turned_accelerometers),
    "each station played twice": Kind(_curve, twice=True),
    "readings of an earlier station again": Kind(_curve, replayed=True, parts={"those": REPLAYED}),
    "hot collar, .1-3 uT across": Kind(_curve, disturbances.cross_axial),
    "string and hot collar, .3-5 uT along, .1-3 uT across": Kind(_curve, disturbances.axial_and_cross),
    "build, trip of 30 h, east-west lateral, .3-5 uT along from then on": Kind(
        _build_and_lateral,
        of_string=_other_string(0.3e-6, 5e-6),
        hours=_after_trip(),
        parts={"build": slice(0, _TRIP), "lateral": slice(_TRIP, None)},
    ),
    "the same, 300-1500 nT along before it, .2-.7 uT across from then on": Kind(
        _build_and_lateral,
        disturbances.magnetised(300e-9, 1500e-9),
        of_string=_other_string(0.3e-6, 5e-6, 0.7e-6),
        hours=_after_trip(),
        parts={"build": slice(0, _TRIP), "lateral": slice(_TRIP, None)},
    ),
    "the same trip, the string as it was, 300-1500 nT along": Kind(
        _build_and_lateral,
        disturbances.magnetised(300e-9, 1500e-9),
        hours=_after_trip(),
        parts={"build": slice(0, _TRIP), "lateral": slice(_TRIP, None)},
    ),
    "curve to east-west, another string at the tenth station, .3-5 uT along": Kind(
        _curve, of_string=_other_string(0.3e-6, 5e-6), parts={"before": slice(0, _TRIP), "after": slice(_TRIP, None)}
    ),
    "landing east-west, remanence growing by .2-1 uT": Kind(_landed, of_string=_growing(0.2e-6, 1e-6)),
    "landing east-west, remanence growing by 1-3 uT": Kind(_landed, of_string=_growing(1e-6, 3e-6)),
    "landing east-west, the string as it was": Kind(_landed, disturbances.magnetised(300e-9, 1500e-9)),
    "mud that shields .5-3 % of the field across the axis": Kind(_curve, disturbances.shielding),
    "one axis of the magnetometer 2 % off": Kind(_curve, disturbances.one_axis_off),
    "field of the crust, .8-2.5 uT": Kind(_curve, disturbances.crust),
}
# What the table's row of disturbed runs pools, of each kind one part: the disturbances of `singles.POOLED`. The others
# have no disturbance, one along the axis alone or weaker than these, a gyro, or a fault of a sensor or of the data.
POOLED = {
    "hot collar, .1-3 uT across": "",
    "string and hot collar, .3-5 uT along, .1-3 uT across": "",
    "steel .5-4 uT at six stations, no gyro": "at it",
    "storm, 150-400 nT, drifting": "",
    "reference off 400 nT, .5, 1 deg": "",
}


def run(kind: Kind, rng: np.random.Generator) -> list[Judged]:
    """One run, decided station by station."""
    earth, reference = truth.drawn_place(rng)
    inclination, azimuth = kind.attitudes(rng)
    source = np.arange(STATIONS)
    if kind.twice:
        source = source // 2
        inclination, azimuth = inclination[source], azimuth[source]
    now = kind.of_tool(tool_code.drawn_tool(rng), earth, rng)
    outside = np.zeros((STATIONS, 3)) if kind.outside is None else kind.outside(rng)
    of_string = now.of_string + (np.zeros((STATIONS, 3)) if kind.of_string is None else kind.of_string(rng))
    readings = []
    for k in range(STATIONS):
        here = now.earth.drawn(tool_code.OF_STATION, rng)
        mat_tn = truth.tool_attitude(inclination[k], azimuth[k], rng.uniform(0.0, math.tau), now.tool, rng).T
        b_t = mat_tn @ (here.field_n + now.outside_n + outside[k]) + of_string[k]
        readings.append(now.tool.read(mat_tn @ np.array([0.0, 0.0, -here.gravity]), b_t, rng))
    if kind.twice:
        readings = [readings[2 * k] for k in source]
    if kind.replayed:
        readings[REPLAYED] = [readings[PLAYED]] * (REPLAYED.stop - REPLAYED.start)
    gyros = kind.gyro.seek(azimuth, earth.latitude, rng) if kind.gyro else [None] * STATIONS
    return decided(readings, inclination, azimuth, reference, gyros, rng, kind.hours)


def decided(
    readings: list[tuple[Array, Array]],
    inclination: Array,
    azimuth: Array,
    reference: Reference,
    gyros: list[Solution | None],
    rng: np.random.Generator,
    hours: Array = _HOURS,
) -> list[Judged]:
    """
    Readings of a run, m/s^2 and T, taken at these hours, through one decision.

    With a gyro the azimuth is propagated between stations.
    """
    decision, found = judge.new_decision(), []
    propagated, disagreed = judge.UNKNOWN, False
    for k, (f_t, b_t) in enumerate(readings):
        begun = decision.begin(judge.still(f_t, b_t, round(3600.0 * hours[k])), k + 1, reference, gyros[k])
        found.append(judge.judged(decision.complete(begun, propagated), inclination[k], azimuth[k]))
        if gyros[k] is None or k + 1 == STATIONS:
            continue
        turned = float(wrap_pi(azimuth[k + 1] - azimuth[k])) + rng.normal(0.0, _PROPAGATED)
        start, known = begun.accepted_azimuth, propagated[:3]
        if math.isfinite(start.azimuth):
            # As the filter of the azimuth does: one station that disagrees does not replace what was propagated.
            apart = abs(float(wrap_pi(start.azimuth - known[0]))) / math.hypot(start.sigma, known[1])
            disagreed = apart > _DISAGREES and not start.by_gyro and not disagreed
            known = known if disagreed else start[:3]
        propagated = PropagatedAzimuth(
            float(wrap_tau(known[0] + turned)), math.hypot(known[1], _PROPAGATED), known[2], math.nan, math.nan
        )
    if any(one.wrong for one in found):
        for number, survey in decision.revisions().items():
            k = number - 1
            now = judge.judged(survey, inclination[k], azimuth[k])
            found[k] = dataclasses.replace(found[k], put_right=not now.wrong)
    return found


def parts(name: str, count: int, seed: int) -> dict[str, list[Judged]]:
    """Stations of runs of a kind, by the part of the run that is judged."""
    kind, rng = KINDS[name], np.random.default_rng([seed, 100 + list(KINDS).index(name)])
    done = [run(kind, rng) for _ in range(count)]
    return {words: [one for found in done for one in found[part]] for words, part in kind.parts.items()}

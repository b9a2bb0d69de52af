# SPDX-License-Identifier: Apache-2.0
"""
What each check and each limit of sensor health is good for, as Markdown: `bench_health.py --ablation`.

Every check is left out, and every limit is set to a value with which it decides nothing, one after the other, on
scenarios and seeds on which nothing was tuned. Counted are the faults that are then missed, those named or doubted more
than a second later, those with another name, those for which a sound sensor is accused, and healthy runs with an alarm;
a row without any is a check or limit to delete.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np
from bench_health import CONVENTIONAL, Run, disturbed, sent, spoilt
from numpy.typing import NDArray

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health import monitor
from mwd_estimation.health.monitor import MonitorParams
from mwd_sensors.simulator.faults import Fault

PARAMS = MonitorParams()
SECONDS = 46.0
# Scenario and changes; the seeds are used nowhere else.
CASES = (
    ("curve_and_lateral", {"seed": 4711}),
    ("sliding", {"seed": 4712}),
    ("stick_slip_hell", {"seed": 4713}),
    ("bench/rot155", {"seed": 4714}),
    ("bench/shocks", {"seed": 4715}),
    ("casing", {"seed": 4716}),
)
# Errors of the installation from the first sample on, broken electronics from some moment on.
INSTALLED = (
    ("accel", "in_g", "all"),
    ("gyro", "in_deg_s", "all"),
    *(("mag", unit, "all") for unit in ("in_ut", "in_mt", "in_gauss", "in_nt")),
    *((c, "swapped", a) for c in CONVENTIONAL for a in ("xy", "yz", "xz")),
    *((c, "flipped", a) for c in CONVENTIONAL for a in ("x", "y", "z", "all")),
    *(("mag", "turned", a) for a in "xyz"),
)
BROKEN = (
    *((c, "stuck", a) for c in CONVENTIONAL for a in ("x", "y", "z", "all")),
    *((c, word, "all") for c in CONVENTIONAL for word in ("nan", "off", "garbage")),
    ("accel", "garbage", "x"),
    ("accel", "saturated", "y"),
    ("gyro", "saturated", "z"),
    ("gyro", "slow", "all"),
    ("gyro", "repeated_stamps", "all"),
)
# Value of a limit with which it decides nothing.
SIGNAL = {
    "gyro_turns": math.inf,
    "shakes": math.inf,
    "steps": 0.0,
    "varied_bins": 1 << 40,
    "missing": math.inf,
    "clipped": math.inf,
    "saturated": math.inf,
    "white": 0.0,
    "noise_of_range": math.inf,
    "field_noise": math.inf,
    "no_tesla": math.inf,
    "off_pace": math.inf,
    "in_pace": 0.0,
    "lost": math.inf,
    "repeated": math.inf,
}
WINDOW = {
    "fits": math.inf,
    "rejects": math.inf,
    "margin": math.inf,
    "quiet": math.inf,
    "field_held": 0.0,
    "field_better": 0.0,
    "dip": math.inf,
    "dip_frame": math.inf,
    "strength": math.inf,
    "fastest": math.inf,
    "no_gravity": math.inf,
    "variances": 0.0,
    "pushed": math.inf,
}
CONSISTENCY = {"length": math.inf, "sigmas": 0.0, "field": 0.0, "dip": math.inf}


# Name: stream, field and what is done to its values of a healthy run: wrong ones, and right ones that look odd.
Change = Callable[[NDArray[np.float64]], NDArray[np.float64]]
ODD_FAULTS: dict[str, tuple[str, str, Change]] = {
    "accelerometer of half the range": ("imu/data_raw", "linear_acceleration", lambda v: 2.0 * v),
    "accelerometer reads noise of 20 m/s^2": (
        "imu/data_raw",
        "linear_acceleration",
        lambda v: np.random.default_rng(6).normal(0.0, 20.0, v.shape),
    ),
    "gyro sends values twice": ("imu/data_raw", "angular_velocity", lambda v: v[np.arange(len(v)) // 2 * 2]),
    "stamps stand still": ("imu/data_raw", "stamp_ns", lambda v: np.minimum(v, v[len(v) // 2])),
}
ODD_HEALTHY: dict[str, tuple[str, str, Change]] = {
    "coarse gyro": ("imu/data_raw", "angular_velocity", lambda v: np.round(v / 1e-3) * 1e-3),
    "coarse accelerometer": ("imu/data_raw", "linear_acceleration", lambda v: np.round(v / 5e-3) * 5e-3),
    "coarse magnetometer": ("imu/mag", "magnetic_field", lambda v: np.round(v / 1e-7) * 1e-7),
    "tone of 100 m/s^2 at 10 Hz": (
        "imu/data_raw",
        "linear_acceleration",
        lambda v: v + 100.0 * np.sin(0.6283 * np.arange(len(v)))[:, None],
    ),
}


@dataclasses.dataclass
class Outcome:
    """Seconds until the right sensor is named and doubted (inf: never), the code, whether a sound one is accused."""

    named: float
    doubted: float
    code: int
    wrong: bool


@dataclasses.dataclass
class Trial:
    """A run with the sensor that is at fault in it (none: -1), from when on, s."""

    run: Run
    sensor: int
    start_s: float


def changed(run: Run, topic: str, field: str, change: Change) -> Run:
    """The run with a change done to a field of a stream."""
    samples = run.streams[topic].copy()
    samples[field] = change(samples[field])
    return Run({**run.streams, topic: samples}, run.reference)


def trials() -> Iterator[Trial]:
    """Every fault in every case, and the healthy runs."""
    for seed, (name, changes) in enumerate(CASES):
        run = sent(name, changes, SECONDS)
        yield Trial(run, -1, 0.0)
        for _, streams in disturbed(run.streams, 100 + seed):
            yield Trial(Run(streams, run.reference), -1, 0.0)
        for one in ODD_HEALTHY.values():
            yield Trial(changed(run, *one), -1, 0.0)
        slow = {**run.streams, "imu/mag": run.streams["imu/mag"][::10]}
        yield Trial(Run(slow, run.reference), -1, 0.0)
        for title, one in ODD_FAULTS.items():
            yield Trial(changed(run, *one), int(title.startswith("acc")), 0.0)
        for faults, start in ((INSTALLED, 0.0), (BROKEN, 20.7)):
            for component, word, axis in faults:
                streams = spoilt(run, Fault(component, word, axis, start_s=start))
                yield Trial(Run(streams, run.reference), CONVENTIONAL.index(component), start)


def outcome(trial: Trial, params: MonitorParams = PARAMS, without: int = -1) -> Outcome:
    """What is named with these parameters, without one check."""
    imu, mag = trial.run.streams["imu/data_raw"], trial.run.streams["imu/mag"]
    state = monitor.initial(*trial.run.reference)
    monitor.push_mag(state, mag["stamp_ns"], mag["magnetic_field"])
    gyro, accel = imu["angular_velocity"], imu["linear_acceleration"]
    step = monitor.run(params, state, imu["stamp_ns"], gyro, accel)
    # By the number of the sample: stamps may be what is wrong.
    t = 0.01 * np.arange(len(imu))
    doubted = t[(step.suspect & 1 << max(trial.sensor, 0) > 0) & (t >= trial.start_s)]
    found = Outcome(math.inf, float(doubted[0]) - trial.start_s if len(doubted) else math.inf, -1, False)
    for one, at in zip(step.changes, step.places, strict=True):
        if one.cleared_ns or one.code == without:
            continue
        if trial.sensor in one.sensors and t[at] >= trial.start_s:
            if found.code < 0:
                found.named, found.code = float(t[at]) - trial.start_s, int(one.code)
        elif one.unusable or (trial.sensor < 0 and one.code != FaultCode.CLIPPED):
            found.wrong = True
    found.doubted = min(found.doubted, found.named)
    return found


def compared(what: str, before: list[Outcome], after: list[Outcome], cases: list[Trial]) -> str:
    """A row of the table."""
    counts = [0] * 6
    for one, a, b in zip(cases, before, after, strict=True):
        if one.sensor < 0:
            counts[5] += b.wrong and not a.wrong
            continue
        missed = math.isfinite(a.named) and not math.isfinite(b.named)
        found = (
            missed,
            math.isfinite(b.named) and b.named > a.named + 1.0,
            b.doubted > a.doubted + 1.0,
            not missed and b.code != a.code,
            b.wrong and not a.wrong,
        )
        for k, hit in enumerate(found):
            counts[k] += bool(hit)
    return f"| {what} | " + " | ".join(str(count) for count in counts) + " |"


def table() -> Iterator[str]:
    """All rows."""
    cases = list(trials())
    before = [outcome(one) for one in cases]
    sick = [result for one, result in zip(cases, before, strict=True) if one.sensor >= 0]
    well = [result for one, result in zip(cases, before, strict=True) if one.sensor < 0]
    named, wrong = sum(math.isfinite(one.named) for one in sick), sum(one.wrong for one in sick)
    yield f"{len(sick)} faults, {named} named, {wrong} with a sound sensor accused;"
    yield f"{len(well)} healthy runs, {sum(one.wrong for one in well)} with an alarm.\n"
    yield "| left out | missed | later | doubted later | other name | wrong sensor | alarms |"
    yield "|---|---|---|---|---|---|---|"
    for code in FaultCode:
        if any(one.code == code for one in before):
            after = [outcome(one, without=code) for one in cases]
            yield compared(code.name.lower().replace("_", " "), before, after, cases)
    for group, values in (("signal", SIGNAL), ("window", WINDOW), ("consistency", CONSISTENCY)):
        for name, value in values.items():
            params = PARAMS._replace(**{group: getattr(PARAMS, group)._replace(**{name: value})})
            yield compared(f"`{group}.{name}`", before, [outcome(one, params) for one in cases], cases)

"""
What each check and each limit of sensor health is good for, as Markdown: `bench_health.py --ablation`.

Every check is left out, and every limit is set to a value with which it decides nothing, one after the other, on
scenarios and seeds on which nothing was tuned. Counted are the faults that are then missed, those named more than a
second later, wrong sensors named, and alarms on healthy runs; a row without any is a check or limit to delete.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from bench_health import CONVENTIONAL, Run, disturbed, sent, spoilt

from mwd_estimation.health import monitor
from mwd_estimation.health.monitor import LIMITS, Limits
from mwd_estimation.health.sensor_fault import FaultCode, SensorFault
from mwd_sensors.simulator.faults import Fault

SECONDS = 62.0
# Scenario and changes; the seeds are used nowhere else.
CASES = (
    ("curve_and_lateral", {"seed": 4711}),
    ("sliding", {"seed": 4712}),
    ("stick_slip_hell", {"seed": 4713}),
    ("bench/rot155", {"seed": 4714}),
    ("bench/shocks", {"seed": 4715}),
    ("bench/surge", {"seed": 4716}),
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
    "gyro_moves": math.inf, "gyro_turns": math.inf, "shakes": math.inf, "field_turns": math.inf, "steps": 0.0,
    "varied_bins": 1 << 40, "missing": math.inf, "clipped": math.inf, "saturated": math.inf, "white": 0.0,
    "noise_of_range": math.inf, "field_noise": math.inf, "no_tesla": math.inf, "off_pace": math.inf,
    "in_pace": 0.0, "lost": math.inf, "repeated": math.inf,
}  # fmt: skip
WINDOW = {
    "fits": math.inf, "rejects": math.inf, "margin": math.inf, "quiet": math.inf, "field_held": 0.0,
    "field_better": 0.0, "turned_between": math.inf, "dip": math.inf, "dip_frame": math.inf, "dip_sign": 0.0,
    "dip_noise": math.inf, "strength": math.inf, "strength_frame": math.inf, "fastest": math.inf,
    "no_gravity": math.inf, "variances": 0.0, "pushed": math.inf,
}  # fmt: skip
CONSISTENCY = {"length": math.inf, "sigmas": 0.0, "field": 0.0, "dip": math.inf}


@dataclasses.dataclass
class Trial:
    """A run with the sensor that is at fault in it (none: -1), from when on, s."""

    run: Run
    sensor: int
    start_s: float


def trials() -> Iterator[Trial]:
    """Every fault in every case, and the healthy runs."""
    for seed, (name, changes) in enumerate(CASES):
        run = sent(name, changes, SECONDS)
        yield Trial(run, -1, 0.0)
        for _, streams in disturbed(run.streams, 100 + seed):
            yield Trial(Run(streams, run.reference), -1, 0.0)
        for faults, start in ((INSTALLED, 0.0), (BROKEN, 30.7)):
            for component, word, axis in faults:
                streams = spoilt(run, Fault(component, word, axis, start_s=start))
                yield Trial(Run(streams, run.reference), CONVENTIONAL.index(component), start)


def changes_of(trial: Trial, limits: Limits) -> list[tuple[float, SensorFault]]:
    """Faults that were found, and the seconds after which."""
    imu, mag = trial.run.streams["imu/data_raw"], trial.run.streams["imu/mag"]
    state = monitor.initial(monitor.Params(), *trial.run.reference)
    monitor.push_mag(state, mag["stamp_ns"], mag["magnetic_field"])
    gyro, accel = imu["angular_velocity"], imu["linear_acceleration"]
    step = monitor.run(monitor.Params(), state, imu["stamp_ns"], gyro, accel, limits)
    t = (imu["stamp_ns"] - imu["stamp_ns"][0]) * 1e-9
    found = zip(step.changes, step.places, strict=True)
    return [(float(t[at]), one) for one, at in found if not one.cleared_ns]


def outcome(trial: Trial, changes: list[tuple[float, SensorFault]]) -> tuple[float, bool]:
    """Seconds until the right sensor is named (inf: never), and whether a sound one is accused."""
    right, wrong = math.inf, False
    for at, one in changes:
        if trial.sensor in one.sensors and at >= trial.start_s:
            right = min(right, at - trial.start_s)
        elif one.unusable or trial.sensor < 0:
            wrong = wrong or not (one.code == FaultCode.CLIPPED and trial.sensor < 0)
    return right, wrong


def compared(what: str, before: list[tuple[float, bool]], after: list[tuple[float, bool]], healthy: list[bool]) -> str:
    """A row: missed, later, wrong, alarms."""
    a, b = np.array(before), np.array(after)
    sick = ~np.array(healthy)
    missed = int((np.isfinite(a[:, 0]) & ~np.isfinite(b[:, 0]) & sick).sum())
    later = int((np.isfinite(b[:, 0]) & (b[:, 0] > a[:, 0] + 1.0) & sick).sum())
    accused = (b[:, 1] > 0) & ~(a[:, 1] > 0)
    return f"| {what} | {missed} | {later} | {int((accused & sick).sum())} | {int((accused & ~sick).sum())} |"


def table() -> Iterator[str]:
    """All rows."""
    cases = list(trials())
    healthy = [one.sensor < 0 for one in cases]
    changes = [changes_of(one, LIMITS) for one in cases]
    before = [outcome(one, found) for one, found in zip(cases, changes, strict=True)]
    named = sum(math.isfinite(right) for right, _ in before)
    wrong = sum(bad for (_, bad), fine in zip(before, healthy, strict=True) if not fine)
    alarms = sum(bad for (_, bad), fine in zip(before, healthy, strict=True) if fine)
    yield f"{len(cases) - sum(healthy)} faults, {named} named, {wrong} with a sound sensor accused; "
    yield f"{sum(healthy)} healthy runs, {alarms} with an alarm.\n"
    yield "| left out | missed | later | wrong sensor | alarms |\n|---|---|---|---|---|"
    for code in FaultCode:
        kept = [[(at, one) for at, one in found if one.code != code] for found in changes]
        if [len(one) for one in kept] != [len(one) for one in changes]:
            after = [outcome(one, found) for one, found in zip(cases, kept, strict=True)]
            yield compared(code.name.lower().replace("_", " "), before, after, healthy)
    for group, values in (("signal", SIGNAL), ("window", WINDOW), ("consistency", CONSISTENCY)):
        for name, value in values.items():
            limits = LIMITS._replace(**{group: getattr(LIMITS, group)._replace(**{name: value})})
            after = [outcome(one, changes_of(one, limits)) for one in cases]
            yield compared(f"`{group}.{name}`", before, after, healthy)

# SPDX-License-Identifier: Apache-2.0
"""
Sensor health: alarms on healthy tools, and how long each fault takes to be doubted and named, as Markdown.

    nice -n 10 python tests/benchmarks/bench_health.py [--ablation]

Healthy: every scenario of the project (its first four minutes, without its own faults), with and without a reference
field, and with what a poor link or point samples do to it: a third of the IMU's samples lost, white noise on each
force, S3's sweep that passes the sample rate; and the BROAD recordings. Faults: each
word of the simulator on each sensor, from two moments within a window of three seconds; the slower counts. "-": never
named in 30 s, because that motion does not show it (or hides it); a sensor named wrongly is an error and shown as such.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, FaultCode, SensorFault
from mwd_estimation.health import monitor as health
from mwd_estimation.health.signal_checks import BIN_NS
from mwd_estimation.health.unit_comparison import PrecisionHealth
from mwd_sensors.core import wire
from mwd_sensors.simulator import faults, scenario
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.sonde import Sonde
from project import REFERENCE_DATA, ROOT

SCENARIOS = ROOT / "bags" / "scenarios"
BROAD = REFERENCE_DATA / "broad"
SECONDS = 240.0
STARTS = (30.1, 31.6)
SENSOR = {
    "gyro": "gyro",
    "accel": "accelerometer",
    "mag": "magnetometer",
    "precision_gyro": "precision",
    "precision_accel": "precision",
}
CONVENTIONAL = ("gyro", "accel", "mag")
# What the clips of these two scenarios are: rotation beyond the gyro's range, which is no false alarm.
CLIPPING = ("bench/gyroclip", "stick_slip_hell")
# The string wobbles by 1 deg/s across its axis, slower than 2 Hz.
WOBBLE = {
    "vibration": {
        "random": [
            {"band_hz": [8.0, 300.0], "acceleration_mps2": [10.0, 10.0, 10.0]},
            {"band_hz": [0.2, 2.0], "acceleration_mps2": [0.5, 0.5, 0.5], "rate_deg_s": [0.0, 1.0, 1.0]},
        ]
    }
}
STILL_THEN_DRILL = {
    "schedule": [
        {"kind": "still", "seconds": 33.0, "pumps": False},
        {"kind": "drill", "seconds": 40.0, "rpm": 100.0, "rop_m_h": 0.0},
    ]
}
PRECISION = {"precision": {"grade": "tactical_north"}}
Cases = tuple[tuple[str, str, dict[str, Any]], ...]
CASES: Cases = (
    ("build", "bench/build", {}),
    ("drillvib", "bench/drillvib", {}),
    ("stickslip", "bench/stickslip", {}),
    ("whirl", "bench/whirl", {}),
    ("offaxis", "bench/offaxis", {}),
    ("wobble", "bench/drillvib", WOBBLE),
    ("still, then drilling", "bench/drillvib", STILL_THEN_DRILL),
)
FINE_CASES: Cases = (
    ("drillvib", "bench/drillvib", PRECISION),
    ("stickslip", "bench/stickslip", PRECISION),
    ("sliding", "sliding", PRECISION),
    ("still", "bench/drillvib", {"schedule": [{"kind": "still", "seconds": 70.0, "pumps": False}], **PRECISION}),
)
# By the bits of what cannot be used.
REMAINS = {
    0: "everything",
    1: "inclination, toolface by the accelerometer; magnetic azimuth",
    2: "nothing of attitude; surveys are rejected",
    4: "inclination, toolface; azimuth if gyros carry it",
    6: "nothing of attitude; surveys are rejected",
    8: "everything but the gyro azimuth",
}
FAULTS = (
    *((c, "stuck", a) for c in CONVENTIONAL for a in ("x", "z", "all")),
    *((c, "nan", "all") for c in CONVENTIONAL),
    ("gyro", "off", "all"),
    ("mag", "off", "all"),
    ("accel", "saturated", "y"),
    ("accel", "garbage", "all"),
    ("accel", "garbage", "x"),
    ("mag", "garbage", "all"),
    ("accel", "in_g", "all"),
    ("gyro", "in_deg_s", "all"),
    *(("mag", unit, "all") for unit in ("in_ut", "in_mt", "in_gauss", "in_nt")),
    *((c, "swapped", a) for c in CONVENTIONAL for a in ("xy", "yz", "xz")),
    *((c, "flipped", a) for c in CONVENTIONAL for a in ("x", "y", "z", "all")),
    *(("mag", "turned", a) for a in "xyz"),
    ("gyro", "slow", "all"),
    ("gyro", "repeated_stamps", "all"),
)
# Of the conventional unit, held against the precision one.
BOTH_FAULTS = (("gyro", "swapped", "yz"), ("gyro", "flipped", "y"), ("gyro", "flipped", "z"))
# Cross-axis turn, deg/s rms, in bands, Hz, of which the gyro's y and z are asked for.
ACROSS = ((0.2, 2.0), (2.0, 5.0), (5.0, 10.0))
TURNS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
FINE_FAULTS = (
    *(
        ("precision_gyro", word, a)
        for word, a in (
            ("stuck", "y"),
            ("stuck", "all"),
            ("off", "all"),
            ("nan", "all"),
            ("saturated", "y"),
            ("in_deg_s", "all"),
            ("swapped", "xy"),
            ("swapped", "yz"),
            ("swapped", "xz"),
            ("flipped", "x"),
            ("flipped", "y"),
            ("flipped", "z"),
            ("flipped", "all"),
            ("turned", "x"),
            ("repeated_stamps", "all"),
        )
    ),
    *(
        ("precision_accel", word, a)
        for word, a in (
            ("stuck", "x"),
            ("stuck", "all"),
            ("in_g", "all"),
            ("swapped", "xy"),
            ("swapped", "yz"),
            ("flipped", "x"),
            ("flipped", "all"),
            ("turned", "x"),
        )
    ),
)
TOPICS = ("imu/data_raw", "imu/mag", "gyro/data_raw")
Streams = dict[str, NDArray[np.void]]


@dataclasses.dataclass(frozen=True)
class Run:
    """What a healthy sonde sent, and its reference."""

    streams: Streams
    reference: tuple[float | None, float | None, float | None]


def sent(name: str, changes: dict[str, Any], seconds: float) -> Run:
    """The first seconds of a scenario without its own faults."""
    sonde = Sonde(scenario.read(SCENARIOS / f"{name}.yaml", {**changes, "faults": []}))
    blocks = []
    for block in sonde.blocks(5.0):
        blocks.append(block)
        if 5.0 * len(blocks) >= seconds:
            break
    field = sonde.reference
    return Run(
        {topic: np.concatenate([block[topic] for block in blocks]) for topic in TOPICS},
        (field.gravity, field.total, field.dip),
    )


def judged(streams: Streams, reference: tuple[float | None, ...]) -> tuple[health.Step, float]:
    """Step of the whole run, and ns a sample."""
    params = health.MonitorParams()
    state = health.initial(*reference)
    imu, mag = streams["imu/data_raw"], streams["imu/mag"]
    gyro, accel = (np.ascontiguousarray(imu[name]) for name in ("angular_velocity", "linear_acceleration"))
    stamps, field = np.ascontiguousarray(imu["stamp_ns"]), np.ascontiguousarray(mag["magnetic_field"])
    begun = time.process_time()
    health.push_mag(state, mag["stamp_ns"], field)
    step = health.run(params, state, stamps, gyro, accel)
    return step, (time.process_time() - begun) * 1e9 / len(imu)


@dataclasses.dataclass
class Watched:
    """What a run reported: changes and the seconds after which, and the seconds from which on there was doubt."""

    changes: list[tuple[float, SensorFault]]
    doubts: NDArray[np.float64]


def watched(streams: Streams, reference: tuple[float | None, ...]) -> Watched:
    """The conventional unit and the magnetometer over a run."""
    step, _ = judged(streams, reference)
    t = (streams["imu/data_raw"]["stamp_ns"] - streams["imu/data_raw"]["stamp_ns"][0]) * 1e-9
    return Watched([(t[at], one) for one, at in zip(step.changes, step.places, strict=True)], t[step.suspect > 0])


def fine_watched(streams: Streams, reference: tuple[float | None, ...]) -> Watched:
    """The precision unit over a run, bin by bin as the estimator does it: without a conventional unit in doubt."""
    step, _ = judged(streams, reference)
    health_of = PrecisionHealth(math.radians(5.0) / 3600.0)
    imu, fine = streams["imu/data_raw"], streams["gyro/data_raw"]
    beside = np.hstack([imu["angular_velocity"], imu["linear_acceleration"]])
    sensed = beside.copy()
    beside[(step.suspect | step.unusable) & (GYRO | ACCEL) > 0] = np.nan
    values = np.hstack([fine["angular_velocity"], fine["linear_acceleration"]])
    begin, found = int(imu["stamp_ns"][0]), Watched([], np.zeros(0))
    for k in range(begin // BIN_NS + 1, int(imu["stamp_ns"][-1]) // BIN_NS):
        a, b = np.searchsorted(imu["stamp_ns"], [k * BIN_NS, (k + 1) * BIN_NS])
        c, d = np.searchsorted(fine["stamp_ns"], [k * BIN_NS, (k + 1) * BIN_NS])
        if a == b:
            continue
        here = sensed[a:b]
        still = bool((np.abs(here[:, :3].mean(axis=0)) < 0.03).all() and here[:, 3:].std(axis=0).max() < 0.25)
        health_of.beside(imu["stamp_ns"][a + 1 : b + 1], beside[a + 1 : b + 1])
        now = ((k + 1) * BIN_NS - begin) * 1e-9
        reported = health_of.judge((k + 1) * BIN_NS, still, (fine["stamp_ns"][c:d].copy(), values[c:d]))
        found.changes += [(now, one) for one in reported]
        if health_of.suspect:
            found.doubts = np.append(found.doubts, now)
    return found


def healthy() -> list[str]:
    """Table of alarms on healthy tools."""
    rows: list[str] = []
    speeds: list[float] = []
    counts: dict[str, list[float]] = {}

    def count(kind: str, name: str, reported: Watched, every: float) -> None:
        clips = name.split(",")[0] in CLIPPING
        false = [one for _, one in reported.changes if not (clips and one.code == FaultCode.CLIPPED)]
        sums = counts.setdefault(kind, [0, 0, 0.0])
        sums[0] += 1
        sums[1] += len(false)
        sums[2] += every * len(reported.doubts)
        rows.extend(f"- `{name}`: {describe(one).message}" for one in false)

    for seed, path in enumerate(sorted(SCENARIOS.rglob("*.yaml"))):
        name = str(path.relative_to(SCENARIOS).with_suffix(""))
        run = sent(name, {}, SECONDS)
        for reference in (run.reference, (None, None, None)):
            speeds.append(judged(run.streams, reference)[1])
            count("scenarios", name, watched(run.streams, reference), 0.01)
        for what, streams in disturbed(run.streams, seed):
            # Without any noise of its own a sensor that another is added to seems stuck.
            if name != "s0_table":
                count(what, f"{name}, {what}", watched(streams, run.reference), 0.01)
        if len(run.streams["gyro/data_raw"]):
            count("precision units", name, fine_watched(run.streams, run.reference), 0.5)
    for file in sorted(BROAD.glob("*.npz")):
        data = np.load(file)
        stamps = np.round(np.arange(len(data["gyr"])) * 1e9 / float(data["fs"])).astype(np.int64)
        imu, mag = wire.IMU.empty(len(stamps)), wire.MAG.empty(len(stamps))
        imu["stamp_ns"] = mag["stamp_ns"] = stamps
        imu["angular_velocity"], imu["linear_acceleration"] = data["gyr"], data["acc"]
        mag["magnetic_field"] = data["mag"] * 1e-6
        reported = watched({"imu/data_raw": imu, "imu/mag": mag}, (None, None, None))
        count("BROAD", file.stem, reported, 1.0 / float(data["fs"]))
    return [
        "| healthy | runs | false alarms | in doubt, s |",
        "|---|---|---|---|",
        *(f"| {kind} | {runs} | {alarms} | {seconds:.1f} |" for kind, (runs, alarms, seconds) in counts.items()),
        "",
        f"{np.median(speeds):.0f} ns a sample (median of the runs, 100 Hz).",
        "",
        *rows,
        *([""] if rows else []),
    ]


def disturbed(streams: Streams, seed: int) -> Iterator[tuple[str, Streams]]:
    """What becomes of a run on a poor link, and by point samples of vibration."""
    rng = np.random.default_rng(seed)
    imu = streams["imu/data_raw"]
    yield "a third of the samples lost", {**streams, "imu/data_raw": imu[rng.random(len(imu)) > 0.33]}
    t = (imu["stamp_ns"] - imu["stamp_ns"][0]) * 1e-9
    # 50 m/s^2 from 10 to 150 Hz in 166 s: while it passes 100 Hz it is an alias near zero.
    sweep = 50.0 * np.cos(0.84 * np.pi * (t - 0.5 * t[-1]) ** 2)
    for what, added in (
        ("white 10 m/s^2", 10.0 * rng.standard_normal((len(imu), 3))),
        ("white 30 m/s^2", 30.0 * rng.standard_normal((len(imu), 3))),
        ("sweep of 50 m/s^2", sweep[:, None] * [0.0, 0.0, 1.0]),
    ):
        changed = imu.copy()
        changed["linear_acceleration"] += added
        yield what, {**streams, "imu/data_raw": changed}


def spoilt(run: Run, fault: Fault) -> Streams:
    """The run with a fault done to it by the simulator's own code."""
    topic = faults.COMPONENTS[fault.component][0]
    state = faults.start([fault], np.random.default_rng(1))
    samples = run.streams[topic]
    t = (samples["stamp_ns"] - run.streams["imu/data_raw"]["stamp_ns"][0]) * 1e-9
    return {**run.streams, topic: faults.spoil(state, topic, samples, t)[0]}


def row(runs: list[Run], component: str, word: str, axis: str, watch: Callable[..., Watched]) -> str:
    """A fault's row: what it is named, by the motion how long it takes to be doubted and named, and what remains."""
    cells, names, bits = [], [], 0
    for run in runs:
        doubted, named, wrong = 0.0, 0.0, ""
        for start in STARTS:
            reported = watch(spoilt(run, Fault(component, word, axis, start_s=start)), run.reference)
            right = [(at - start, one) for at, one in reported.changes if not one.cleared_ns and at >= start]
            named_as = [describe(one).sensor for _, one in right]
            wrong = next((sensor for sensor in named_as if SENSOR[component] not in sensor), wrong)
            if not right:
                named = math.inf
                break
            later = reported.doubts[reported.doubts >= start]
            first = float(later[0]) - start if len(later) else math.inf
            doubted, named = max(doubted, min(first, right[0][0])), max(named, right[0][0])
            text = describe(right[0][1])
            names.append(f"{text.kind} {text.axis}".strip())
            bits = bits or right[-1][1].unusable
        cells.append(f"wrong: {wrong}" if wrong else "-" if named == math.inf else f"{doubted:.1f}, {named:.1f}")
    name = max(names, key=names.count) if names else "-"
    remains = REMAINS[bits] if names else ""
    return f"| {component.replace('_', ' ')} {word} {axis} | {name} | " + " | ".join(cells) + f" | {remains} |"


def turns_across() -> list[str]:
    """How much a rotating tool must turn across its axis for y and z of the gyro to be judged: seconds until named."""
    lines = [
        "| cross-axis turn, deg/s rms | " + " | ".join(f"{low:g} to {high:g} Hz" for low, high in ACROSS) + " |",
        "|---|" + "---|" * len(ACROSS),
    ]
    for rate in TURNS:
        cells = []
        for band in ACROSS:
            noise = {"band_hz": list(band), "acceleration_mps2": [3.0, 3.0, 3.0], "rate_deg_s": [0.0, rate, rate]}
            run = sent("bench/drillvib", {"vibration": {"random": [noise]}}, 62.0)
            cells.append(row([run], "gyro", "flipped", "y", watched).split("|")[3].strip())
        lines.append(f"| {rate:g} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def table(cases: Cases, faulty: Sequence[tuple[str, str, str]], watch: Callable[..., Watched]) -> None:
    """Print the faults of one unit."""
    runs = [sent(name, changes, 62.0) for _, name, changes in cases]
    print("| fault | named | " + " | ".join(title for title, *_ in cases) + " | what remains |")
    print("|---|---|" + "---|" * len(cases) + "---|")
    for component, word, axis in faulty:
        print(row(runs, component, word, axis, watch), flush=True)
    print()


def main() -> None:
    """All tables, or with --ablation what each check and limit is good for."""
    if "--ablation" in sys.argv[1:]:
        import health_ablation

        for line in health_ablation.table():
            print(line, flush=True)
        return
    print("\n".join(healthy()))
    print("Seconds from a fault until the sensor is in doubt, and until it is named; the slower of two moments.\n")
    table(CASES, FAULTS, watched)
    print("y of the conventional gyro reversed, at 120 r/min: what the string must turn across its axis to show it.\n")
    print("\n".join(turns_across()))
    print("The precision unit, held against the conventional one:\n")
    table(FINE_CASES, FINE_FAULTS, fine_watched)
    print("y and z of the conventional gyro, held against the precision one (both are named):\n")
    table(FINE_CASES, BOTH_FAULTS, fine_watched)


if __name__ == "__main__":
    main()

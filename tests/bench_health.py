"""
Sensor health: alarms on healthy tools, and how long each fault takes to be named, as Markdown.

    nice -n 10 python tests/bench_health.py

Healthy: every scenario of the project (its first four minutes, without its own faults), with and without a reference
field, and the BROAD recordings if they lie beside the repository. Faults: each word of the simulator on each sensor,
from three moments within a window of three seconds; the slowest counts. "-": never named in 30 s, because that motion
does not show it (or hides it); a sensor named wrongly is an error and shown as such.
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import sensor_health as health
from mwd_sensors import faults, scenario
from mwd_sensors.faults import Fault
from mwd_sensors.sonde import Sonde

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ROOT / "bags" / "scenarios"
BROAD = ROOT.parent / "shared" / "data" / "broad"
SECONDS = 240.0
STARTS = (30.1, 31.1, 32.1)
SENSOR = {"gyro": "gyro", "accel": "accelerometer", "mag": "magnetometer"}
# What the clips of these two scenarios are: rotation beyond the gyro's range, which is no false alarm.
CLIPPING = ("bench/gyroclip", "stick_slip_hell")
STILL_THEN_DRILL = {
    "schedule": [
        {"kind": "still", "seconds": 33.0, "pumps": False},
        {"kind": "drill", "seconds": 40.0, "rpm": 100.0, "rop_m_h": 0.0},
    ]
}
CASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("build", "bench/build", {}),
    ("drillvib", "bench/drillvib", {}),
    ("stickslip", "bench/stickslip", {}),
    ("whirl", "bench/whirl", {}),
    ("offaxis", "bench/offaxis", {}),
    ("still, then drilling", "bench/drillvib", STILL_THEN_DRILL),
)
FAULTS = (
    *((c, "stuck", a) for c in SENSOR for a in ("x", "z", "all")),
    *((c, "nan", "all") for c in SENSOR),
    ("gyro", "off", "all"),
    ("mag", "off", "all"),
    ("accel", "saturated", "y"),
    ("accel", "in_g", "all"),
    ("gyro", "in_deg_s", "all"),
    *(("mag", unit, "all") for unit in ("in_ut", "in_mt", "in_gauss", "in_nt")),
    *((c, "swapped", a) for c in SENSOR for a in ("xy", "yz", "xz")),
    *((c, "flipped", a) for c in SENSOR for a in ("x", "y", "z", "all")),
    *(("mag", "turned", a) for a in "xyz"),
    ("gyro", "slow", "all"),
    ("gyro", "repeated_stamps", "all"),
)
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
        {topic: np.concatenate([block[topic] for block in blocks]) for topic in ("imu/data_raw", "imu/mag")},
        (field.gravity, field.total, field.dip),
    )


def judged(streams: Streams, reference: tuple[float | None, ...]) -> tuple[health.Step, float]:
    """Step of the whole run, and ns a sample."""
    params = health.Params()
    state = health.initial(params, *reference)
    imu, mag = streams["imu/data_raw"], streams["imu/mag"]
    gyro, accel = (np.ascontiguousarray(imu[name]) for name in ("angular_velocity", "linear_acceleration"))
    stamps, field = np.ascontiguousarray(imu["stamp_ns"]), np.ascontiguousarray(mag["magnetic_field"])
    begun = time.process_time()
    health.push_mag(state, mag["stamp_ns"], field)
    step = health.run(params, state, stamps, gyro, accel)
    return step, (time.process_time() - begun) * 1e9 / len(imu)


def healthy() -> list[str]:
    """Table of alarms on healthy tools."""
    rows, alarms, speeds = [], 0, []
    for path in sorted(SCENARIOS.rglob("*.yaml")):
        name = str(path.relative_to(SCENARIOS).with_suffix(""))
        run = sent(name, {}, SECONDS)
        for reference in (run.reference, (None, None, None)):
            step, nanoseconds = judged(run.streams, reference)
            speeds.append(nanoseconds)
            false = [one for one in step.changes if not (name in CLIPPING and one.kind == "saturated")]
            alarms += len(false)
            rows += [f"- `{name}`: {one.message}" for one in false]
    trials = sorted(BROAD.glob("*.npz"))
    for file in trials:
        data = np.load(file)
        stamps = np.round(np.arange(len(data["gyr"])) * 1e9 / float(data["fs"])).astype(np.int64)
        state = health.initial(health.Params())
        health.push_mag(state, stamps, data["mag"].astype(float) * 1e-6)
        step = health.run(health.Params(), state, stamps, data["gyr"].astype(float), data["acc"].astype(float))
        alarms += len(step.changes)
        rows += [f"- `{file.stem}`: {one.message}" for one in step.changes]
    return [
        f"Healthy tools: {alarms} false alarms in {len(speeds)} runs of scenarios and {len(trials)} BROAD recordings.",
        f"{np.median(speeds):.0f} ns a sample (median of the runs, 100 Hz).",
        "",
        *rows,
        *([""] if rows else []),
    ]


def spoilt(run: Run, fault: Fault) -> Streams:
    """The run with a fault done to it by the simulator's own code."""
    topic = faults.COMPONENTS[fault.component][0]
    state = faults.start([fault], np.random.default_rng(1))
    samples = run.streams[topic]
    t = (samples["stamp_ns"] - run.streams["imu/data_raw"]["stamp_ns"][0]) * 1e-9
    return {**run.streams, topic: faults.spoil(state, topic, samples, t)[0]}


def named_after(run: Run, component: str, word: str, axis: str) -> str:
    """Seconds from the fault to its name, the slowest of three; who else was named."""
    slowest = 0.0
    for start in STARTS:
        streams = spoilt(run, Fault(component, word, axis, start_s=start))
        step, _ = judged(streams, run.reference)
        stamps = streams["imu/data_raw"]["stamp_ns"]
        wrong = [one for one in step.changes if SENSOR[component] not in one.sensor]
        if wrong:
            return f"wrong: {wrong[0].sensor}"
        right = [at for one, at in zip(step.changes, step.places, strict=True) if not one.cleared_ns]
        if not right:
            return "-"
        slowest = max(slowest, (stamps[right[0]] - stamps[0]) * 1e-9 - start)
    return f"{slowest:.1f}"


def main() -> None:
    """Both tables."""
    print("\n".join(healthy()))
    runs = [sent(name, changes, 62.0) for _, name, changes in CASES]
    print("Seconds from a fault to its name, the slowest of three moments:\n")
    print("| fault | " + " | ".join(title for title, *_ in CASES) + " |")
    print("|---|" + "---|" * len(CASES))
    for component, word, axis in FAULTS:
        cells = [named_after(run, component, word, axis) for run in runs]
        print(f"| {SENSOR[component]} {word} {axis} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""
Gravity while drilling: our methods, the papers' and the peers on the same data in one run, as Markdown.

    nice -n 10 python tests/benchmarks/bench_gravity.py [SEEDS]

Accuracy after 10 s on the eleven benchmark scenarios, as they are and with the errors of calibration taken out, on four
BROAD trials; honesty of sigma there and on scenarios drawn at random; speed per sample as a ratio to VQF's C++ in the
same run. Peers: vqf, imufusion, ahrs from PyPI; those that are not installed are left out by name. The tables of S3
stand in docs/papers.md.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import math
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from consistency import consistency
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.gravity import smoother
from mwd_estimation.gravity.bounded import filter as gravity_bounded
from mwd_estimation.settings import derivation, tool_file
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import from_mapping
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import REFERENCE_DATA, ROOT

Follow = Callable[[NDArray[np.int64], Array, Array], Array]
Data = tuple[NDArray[np.int64], Array, Array, Array]
Changes = dict[str, Any]

SCENARIOS = ROOT / "bags" / "scenarios"
BROAD = REFERENCE_DATA / "broad"
CASES = (
    "rot155",
    "vib50",
    "drillvib",
    "stickslip",
    "whirl",
    "shocks",
    "build",
    "offaxis",
    "biasdrift",
    "gyroclip",
    "surge",
)
SKIP_NS = 10_000_000_000
GRAVITY = earth.gravity(math.radians(38.0), 1100.0)  # m/s^2, at the place of the scenarios


def held(inclination_deg: float, phase: Changes, vibration: Changes, rate_hz: int = 100, **more: Any) -> Changes:
    """Another scenario, as changes to one: a schedule of one phase, random vibration (m/s^2 rms) and what is given."""
    shaken = {name: value for name, value in vibration.items() if name != "rms"}
    if "rms" in vibration:
        random = {"band_hz": [8.0, 300.0], "acceleration_mps2": [vibration["rms"]] * 3}
        shaken["random"] = [random, *shaken.get("random", [])]
    stations = [[0.0, inclination_deg, 60.0]]
    return {"well": {"stations": stations}, "schedule": [phase], "vibration": shaken, "rate_hz": rate_hz, **more}


def turning(rpm: float, seconds: float = 120.0) -> Changes:
    """A phase of rotary drilling."""
    return {"kind": "drill", "seconds": seconds, "rpm": rpm, "rop_m_h": 0.0}


def slides(seconds: float = 140.0) -> Changes:
    """A phase of sliding."""
    return {"kind": "slide", "seconds": seconds, "rop_m_h": 0.0, "toolface_deg": 40.0}


DRAWN = 14
DRAW_SEED = 20261123  # another for each release: what was looked at while tuning is held out no more


def drawn() -> dict[str, Changes]:
    """Scenarios that nobody chose: motion, attitude, rate, vibration and place of the sensor drawn at random."""
    rng = np.random.default_rng(DRAW_SEED)
    return dict(_drawn(rng) for _ in range(DRAWN))


def _drawn(rng: np.random.Generator) -> tuple[str, Changes]:
    def some(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    inclination, rate, rpm = some(3.0, 92.0), int(rng.choice([50, 100, 200, 500])), some(30.0, 220.0)
    motion = str(rng.choice(["rotary", "rotary", "slide", "still"]))
    phase = {"rotary": turning(rpm), "slide": slides(120.0), "still": {"kind": "still", "seconds": 120.0}}[motion]
    words, vibration = [f"{motion} {inclination:.0f} deg", f"{rate} Hz"], Changes()
    if motion != "still":
        vibration["rms"] = some(1.0, 25.0)
        if rng.random() < 0.25:
            heave = {"frequency_hz": some(0.15, 0.6), "acceleration_mps2": [some(0.3, 2.0), 0.0, 0.0]}
            vibration["tones"] = [heave]
            words.append("heave")
        if rng.random() < 0.2:
            shocks = {"peak_g": [20.0, 80.0], "width_ms": [0.5, 3.0], "clearance_mm": 10.0}
            vibration["shocks"] = [{"rate_hz": some(0.2, 2.0), **shocks}]
            words.append("shocks")
    if motion == "rotary":
        words.append(f"{rpm:.0f} r/min")
        if rng.random() < 0.3:
            vibration["stick_slip"] = {"frequency_hz": some(0.1, 0.4), "depth": some(0.3, 1.0)}
            words.append("stick-slip")
        if rng.random() < 0.25:
            bursts = {"burst_s": [1.0, 6.0], "pause_s": [1.0, 3.0]}
            whirl = {"frequency_hz": some(3.0, 12.0), "acceleration_mps2": some(5.0, 25.0), **bursts}
            vibration["whirl"] = [whirl]
            words.append("whirl")
    lever = [float(mm) for mm in rng.normal(scale=20.0, size=3)]
    ahrs = {"grade": "mti3_calibrated", "lever_mm": lever}
    return ", ".join(words), held(inclination, phase, vibration, rate, ahrs=ahrs)


_MADE: dict[str, Data] = {}  # several tables ask for the same run; about 1 MB each


def drilled(path: Path, changes: Changes, calibrated: bool = False) -> Data:
    """
    Stamps, rates, forces and true down of a scenario.

    calibrated takes the true accelerometer matrix and biases and the true misalignment of the gyros out of the samples:
    what is left is what a filter can do something about (gyro bias and scale, noise, motion).
    """
    key = repr((path, changes, calibrated))
    if key in _MADE:
        return _MADE[key]
    imu, truth = [], []
    sonde = Sonde(scenario.read(path, changes))
    for block in sonde.blocks(5.0):
        imu.append(block["imu/data_raw"])
        truth.append(block["truth"])
    sensed, known = np.concatenate(imu), np.concatenate(truth)
    known = known[np.searchsorted(known["stamp_ns"], sensed["stamp_ns"])]
    w, f = sensed["angular_velocity"], sensed["linear_acceleration"]
    if calibrated:
        gyro = sonde.ahrs.gyro.matrix
        w = w @ np.linalg.inv(gyro / np.diag(gyro)[:, None]).T
        f = (f - known["accel_bias"]) @ np.linalg.inv(sonde.ahrs.accelerometer.matrix).T
    _MADE[key] = sensed["stamp_ns"], w, f, known["gravity"]
    return _MADE[key]


def broad() -> dict[str, tuple[Data, NDArray[np.bool_]]]:
    """Trials by number: data and which samples are scored."""
    trials = {}
    for file in sorted(BROAD.glob("*.npz")):
        data = np.load(file)
        w, x, y, z = data["quat"].astype(float).T
        down = -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)
        stamps = np.round(np.arange(len(down)) * 1e9 / float(data["fs"])).astype(np.int64)
        scored = data["movement"] & np.isfinite(down[:, 0])
        trials[file.name[:2]] = ((stamps, data["gyr"].astype(float), data["acc"].astype(float), down), scored)
    return trials


def angle(a: Array, b: Array) -> Array:
    """Angle between unit vectors, deg."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def inclination(g: Array) -> Array:
    """Of unit vectors down, deg."""
    return np.degrees(np.arctan2(np.hypot(g[:, 1], g[:, 2]), g[:, 0]))


def toolface(g: Array) -> Array:
    """Gravity toolface of unit vectors down, deg."""
    return np.degrees(np.arctan2(-g[:, 1], -g[:, 2]))


def rms(values: Array | Iterable[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values)))))


def ours(name: str, **settings: Any) -> Follow:
    """A method of ours as a function of stamps, rates and forces."""
    method = gravity.method(name)
    params = method.Params(**settings)
    return lambda t, w, f: method.run(params, method.initial(params), t, w, f).g_t


def smoothed(t: NDArray[np.int64], w: Array, f: Array) -> Array:
    """The smoother."""
    return smoother.smooth(gravity_bounded.BoundedParams(), t, w, f).g_t


def down_of(q_wxyz: Array) -> Array:
    """Down in the sensor's axes of quaternions sensor to east-north-up or any frame with z up."""
    w, x, y, z = q_wxyz.T
    return -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def period(t: NDArray[np.int64]) -> float:
    """Mean sampling period, s."""
    return float(t[-1] - t[0]) * 1e-9 / (len(t) - 1)


def vqf(**settings: float) -> Follow:
    """VQF (C++), 6-axis."""
    from vqf import VQF

    return lambda t, w, f: down_of(
        VQF(period(t), **settings).updateBatch(np.ascontiguousarray(w), np.ascontiguousarray(f))["quat6D"]
    )


def imufusion(t: NDArray[np.int64], w: Array, f: Array) -> Array:
    """x-io's Fusion (revised Madgwick), 6-axis, its own defaults."""
    import imufusion as fusion

    filtered = fusion.Ahrs()
    filtered.set_sample_period(period(t))
    out = np.empty((len(t), 4))
    for k in range(len(t)):
        filtered.update_no_magnetometer(np.degrees(w[k]), f[k] / 9.80665)
        out[k] = filtered.get_quaternion()
    return down_of(out)


def madgwick(t: NDArray[np.int64], w: Array, f: Array) -> Array:
    """Madgwick's filter of the `ahrs` package, 6-axis, its own defaults."""
    from ahrs.common.orientation import acc2q
    from ahrs.filters import Madgwick

    filtered = Madgwick(frequency=1.0 / period(t))
    out = np.empty((len(t), 4))
    out[0] = acc2q(f[0])
    for k in range(1, len(t)):
        out[k] = filtered.updateIMU(out[k - 1], gyr=w[k], acc=f[k])
    return down_of(out)


def methods() -> dict[str, Follow]:
    """Rows of the accuracy tables, those installed."""
    rows: dict[str, Follow] = {
        "raw accelerometer": ours("raw"),
        "S3 (fuzzy Mahony)": ours("s3"),
        "Mahony, fixed gains": ours("mahony"),
        "Kalman (Ligorio type)": ours("kalman"),
    }
    if importlib.util.find_spec("ahrs"):
        rows["Madgwick (ahrs)"] = madgwick
    if importlib.util.find_spec("imufusion"):
        rows["imufusion"] = imufusion
    if importlib.util.find_spec("vqf"):
        rows["VQF default"] = vqf()
        rows["VQF tauAcc 2, biasSigmaMotion .02"] = vqf(tauAcc=2.0, biasSigmaMotion=0.02)
    rows["**bounded (default)**"] = ours("bounded")
    rows["smoother (offline)"] = smoothed
    return rows


def accuracy(title: str, rows: dict[str, Follow], seeds: int, calibrated: bool = False) -> list[str]:
    """Inclination / gravity direction, deg rms after 10 s, eleven cases."""
    data = {
        case: [
            drilled(SCENARIOS / "bench" / f"{case}.yaml", {"seed": seed}, calibrated) for seed in range(1, seeds + 1)
        ]
        for case in CASES
    }
    out = [f"| {title} | " + " | ".join(CASES) + " | mean* |", "|---" * (len(CASES) + 2) + "|"]
    for name, follow in rows.items():
        cells, directions = [], []
        for case in CASES:
            inc, way = [], []
            for t, w, f, down in data[case]:
                got, late = follow(t, w, f), t - t[0] > SKIP_NS
                inc.append(rms((inclination(got) - inclination(down))[late]))
                way.append(rms(angle(got, down)[late]))
            cells.append(f"{rms(inc):.3f}/{rms(way):.3f}")
            directions.append(rms(way))
        mean = math.exp(float(np.mean(np.log(directions))))
        out.append(f"| {name} | " + " | ".join(cells) + f" | {mean:.3f} |")
    out.append("")
    out.append(f"{seeds} seeds; * geometric mean of the direction.")
    return out


def told(path: Path, changes: Changes) -> Any:
    """Parameters of the default method for the place of the scenarios and the tool file of the scenario's grade."""
    grade = scenario.read(path, changes).ahrs.grade
    table = tool_file.from_file(Path(str(importlib.resources.files("mwd_sensors"))) / f"simulator/grades/{grade}.yaml")
    return derivation.gravity_params(from_mapping(EstimatorSettings, {"tool": table}), GRAVITY)


def default_params() -> Any:
    """Parameters of the default method for the place of the scenarios and a tool of which nothing is told."""
    return derivation.gravity_params(EstimatorSettings(), GRAVITY)


def honesty(
    name: str,
    run: Callable[..., Any],
    cases: dict[str, tuple[Path, Changes]],
    seeds: range,
    tool_file_given: bool = True,
) -> list[str]:
    """
    Squared error over published variance (NEES, 1 expected) of inclination and toolface, case by case.

    The filter knows the figures of the tool's grade (`tool_file_given`), or nothing of the tool. The 95 % band is that
    of a chi-square of as many degrees of freedom as independent samples were seen, all seeds together; a value outside
    it is marked: > bold, < cautious.
    """
    out = [f"| {name} | " + " | ".join(cases) + " | inside |", "|---" * (len(cases) + 2) + "|"]
    rows: dict[str, list[str]] = {"NEES inclination": [], "NEES toolface": [], "sigma inclination, deg": []}
    inside = {"NEES inclination": 0, "NEES toolface": 0}
    for number, (path, changes) in enumerate(cases.values()):
        squares: dict[str, list[tuple[Array, Array]]] = {row: [] for row in inside}
        sigma = []
        params = told(path, changes) if tool_file_given else default_params()
        for seed in seeds:
            # A seed draws the tool: cases with the same tools would err alike.
            t, w, f, down = drilled(path, {**changes, "seed": seed + 1000 * number})
            got, late = run(params, t, w, f), t - t[0] > SKIP_NS
            errors = np.degrees(got.inclination) - inclination(down), toolface(got.g_t) - toolface(down)
            published = got.sigma_inclination, got.sigma_toolface
            for row, error, one in zip(squares, errors, published, strict=True):
                wrapped = (error + 180.0) % 360.0 - 180.0
                squares[row].append((wrapped[late], np.degrees(one)[late]))
            sigma.append(rms(np.degrees(got.sigma_inclination[late])))
        for row, values in squares.items():
            got = consistency(values)
            inside[row] += got.inside
            mark = ">" if got.nees > got.high else "<" if got.nees < got.low else ""
            rows[row].append(f"{mark}{got.nees:.2f} ({got.low:.2f}-{got.high:.2f})")
        rows["sigma inclination, deg"].append(f"{rms(sigma):.3f}")
    for row, cells in rows.items():
        total = f"{inside[row]} of {len(cases)}" if row in inside else ""
        out.append(f"| {row} | " + " | ".join(cells) + f" | {total} |")
    out.append("")
    out.append(f"{len(seeds)} seeds; (95 % band); > bolder, < more cautious than the band.")
    return out


def honest_on_broad() -> list[str]:
    """Squared error of inclination and toolface over published variance, default method, BROAD."""
    out = ["| default method on BROAD | NEES inclination | NEES toolface | sigma, deg |", "|---|---|---|---|"]
    method = gravity.method(gravity.DEFAULT)
    for trial, ((t, w, f, down), scored) in broad().items():
        got = method.run(method.Params(), method.initial(method.Params()), t, w, f)
        errors = np.degrees(got.inclination) - inclination(down), toolface(got.g_t) - toolface(down)
        cells = []
        for error, one in zip(errors, (got.sigma_inclination, got.sigma_toolface), strict=True):
            u = (((error + 180.0) % 360.0 - 180.0) / np.degrees(one))[scored]
            cells.append(f"{float(np.mean(u * u)):.2f}")
        out.append(f"| {trial} | {' | '.join(cells)} | {rms(np.degrees(got.sigma_inclination[scored])):.3f} |")
    return out


def real(rows: dict[str, Follow]) -> list[str]:
    """6-axis inclination error on BROAD, deg rms over the samples in motion."""
    trials = broad()
    out = ["| BROAD, deg | " + " | ".join(trials) + " | mean |", "|---" * (len(trials) + 2) + "|"]
    for name, follow in rows.items():
        errors = []
        for (t, w, f, down), scored in trials.values():
            errors.append(rms(angle(follow(t, w, f), down)[scored]))
        out.append(f"| {name} | " + " | ".join(f"{e:.3f}" for e in errors) + f" | {np.mean(errors):.3f} |")
    return out


def speed() -> list[str]:
    """
    Batch time per sample at 100 Hz and 1 kHz, and its ratio to VQF's C++ in the same run.

    The time is the best of fifteen of the processor; the methods take turns, so that all meet the same load.
    """
    rows = {name: ours(name) for name in ("bounded", "s3", "mahony", "kalman", "raw")}
    if importlib.util.find_spec("vqf"):
        rows = {"VQF C++": vqf(), **rows}
    cells: dict[str, list[str]] = {name: [] for name in rows}
    for changes in ({}, {"rate_hz": 1000, "schedule": [turning(155.0, 60.0)]}):
        t, w, f, _ = drilled(SCENARIOS / "bench" / "rot155.yaml", changes)
        taken = dict.fromkeys(rows, math.inf)
        # The first turn compiles.
        for turn in range(16):
            for name, follow in rows.items():
                begin = time.thread_time()
                follow(t, w, f)
                taken[name] = min(taken[name], math.inf if turn == 0 else (time.thread_time() - begin) / len(t) * 1e9)
        unit = taken.get("VQF C++", math.nan)
        for name, ns in taken.items():
            cells[name] += [f"{ns:.0f}", f"{ns / unit:.2f}"]
    out = [
        "| batch | ns per sample, 100 Hz | ratio to VQF | ns per sample, 1 kHz | ratio to VQF |",
        "|---|---|---|---|---|",
    ]
    return out + [f"| {name} | {' | '.join(row)} |" for name, row in cells.items()]


def main(seeds: int = 3) -> None:
    """Print all tables. Honesty takes four times the seeds."""
    rows = methods()
    default = gravity.method(gravity.DEFAULT)
    bench: dict[str, tuple[Path, Changes]] = {case: (SCENARIOS / "bench" / f"{case}.yaml", {}) for case in CASES}
    others = {case: (SCENARIOS / "bench" / "rot155.yaml", changes) for case, changes in drawn().items()}
    own = {name: rows[name] for name in list(rows)[-2:]}
    once, again, fresh = range(1, 4 * seeds + 1), range(101, 4 * seeds + 101), range(201, 4 * seeds + 201)

    def follow(params: Any, t: NDArray[np.int64], w: Array, f: Array) -> Any:
        return default.run(params, default.initial(params), t, w, f)

    for table in (
        lambda: accuracy("inclination / direction, deg", rows, seeds),
        lambda: accuracy("calibration errors taken out", own, seeds, calibrated=True),
        lambda: honesty("default", follow, bench, once),
        lambda: honesty("default, other seeds", follow, bench, again),
        lambda: honesty("default, drawn", follow, others, fresh),
        lambda: honesty("default, no tool file", follow, others, fresh, tool_file_given=False),
        lambda: honesty("smoother", smoother.smooth, bench, once),
        lambda: real(rows),
        honest_on_broad,
        speed,
    ):
        print("\n".join(table()), end="\n\n", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)

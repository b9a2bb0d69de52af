# SPDX-License-Identifier: Apache-2.0
"""
What each term of the bounded filter is worth: errors and honesty without it, as Markdown.

    nice -n 10 python tests/benchmarks/bench.py --only ablation

Each variant runs in a process of its own with its constants changed before the kernels are compiled. The scenarios are
other than those of the benchmark and of its drawn set; they are simulated once. Errors above 1.1 times those of all
terms are bold.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import bench_gravity as bench
import numpy as np

from consistency import consistency
from mwd_estimation.gravity.bounded import filter as bounded

ROOM = "mwd_estimation.gravity.bounded."
SEEDS = (401, 402)
CASES: dict[str, bench.Changes] = {
    "rotation": bench.held(55.0, bench.turning(60.0), {"rms": 5.0}),
    "slide": bench.held(45.0, bench.slides(), {"rms": 8.0}),
    "stick-slip": bench.held(
        50.0, bench.turning(70.0), {"rms": 12.0, "stick_slip": {"frequency_hz": 0.15, "depth": 1.0}}, 200
    ),
    "heave": bench.held(
        35.0, bench.turning(50.0), {"rms": 8.0, "tones": [{"frequency_hz": 0.35, "acceleration_mps2": [2.0, 0.0, 0.0]}]}
    ),
    "off axis": bench.held(
        40.0, bench.turning(100.0), {"rms": 9.0}, ahrs={"grade": "mti3_calibrated", "lever_mm": [0.0, 40.0, 10.0]}
    ),
    "shocks": bench.held(
        60.0,
        bench.turning(90.0),
        {
            "rms": 12.0,
            "shocks": [{"rate_hz": 1.2, "peak_g": [40.0, 90.0], "width_ms": [0.5, 3.0], "clearance_mm": 12.0}],
        },
    ),
    "clipping": bench.held(
        70.0, bench.turning(200.0), {"rms": 7.0, "stick_slip": {"frequency_hz": 0.22, "depth": 1.0}}
    ),
    "point samples": bench.held(
        50.0, bench.turning(80.0), {"rms": 4.0}, ahrs={"grade": "mti3_calibrated", "output": "sampled"}
    ),
    "curve": bench.held(
        60.0,
        {"kind": "slide", "seconds": 85.0, "rop_m_h": 3600.0, "toolface_deg": 40.0},
        {"rms": 3.0},
        well={"stations": [[0.0, 60.0, 30.0], [90.0, 60.0, 62.0]], "bit_m": 0.0, "sensor_to_bit_m": 0.0},
    ),
    "rest, then heave": {
        **bench.held(
            35.0,
            bench.turning(60.0),
            {"rms": 8.0, "tones": [{"frequency_hz": 0.35, "acceleration_mps2": [2.0, 0.0, 0.0]}]},
        ),
        "schedule": [{"kind": "still", "seconds": 60.0}, bench.turning(60.0, 30.0)],
    },
    "points, strong": bench.held(
        40.0, bench.slides(), {"rms": 25.0}, ahrs={"grade": "mti3_calibrated", "output": "sampled"}
    ),
    "fast rotation": bench.held(80.0, bench.turning(210.0), {"rms": 15.0}),
    "uncalibrated": bench.held(60.0, bench.turning(110.0, 60.0), {"rms": 6.0}, ahrs={"grade": "mti3"}),
    "white force": bench.held(30.0, bench.turning(120.0), {}),
    "turned in a gap": bench.held(50.0, bench.slides(), {"rms": 6.0}),
}
WHITE = 30.0  # m/s^2, force in every sample, as of vibration that point samples fold down
GAP_S, TURNED = 5.0, np.diag([1.0, -1.0, -1.0])  # data gap in which the tool turned by half a turn
# What is changed: constants by module, settings of `Params`.
VARIANTS: dict[str, tuple[dict[str, dict[str, float]], dict[str, Any]]] = {
    "all terms": ({}, {}),
    "x scale": ({}, {"scale_sigma": 1e-6}),
    "lever arm": ({}, {"lever_sigma": 1e-4}),
    "gyro bias": ({}, {"bias_sigma": 1e-6, "bias_walk": 0.0}),
    "noise of rates across": ({}, {"rate_noise": 0.0}),
    "accelerometer errors": (
        {},
        {"accel_bias_sigma": 0.0, "accel_scale_sigma": 0.0, "accel_misalignment_sigma": 0.0, "gravity_sigma": 1.0},
    ),
    "gyro misalignment": ({}, {"misalignment_sigma": 0.0}),
    "travel along a curve": ({}, {"axial_speed": 0.0}),
    "vertical force": ({"state": {"DOWN_SIGMA": 1e-9}, "noise": {"DOWN_WALK": 0.0}}, {}),
    "noise of the rate about x": ({"noise": {"ROTARY_NOISE": 0.0}}, {}),
    "displacement follows the motion": ({"noise": {"WALK_PER_DISPLACEMENT": 0.0}}, {}),
    "displacement assumed at a start": ({"noise": {"START_DISPLACEMENT": 0.0}}, {}),
    "white force": ({"noise": {"WHITE_SHARE": 0.0, "FOLDED_LEAST": 1e9}}, {}),
    "share of white force": ({"noise": {"WHITE_SHARE": 0.0}}, {}),
    "white force counts whole": ({"noise": {"FOLDED_LEAST": 1e9}}, {}),
    "white force assumed at a start": ({"noise": {"FOLDED_YOUNG": 0.0}}, {}),
    "velocity lost in clipped shocks": ({"clipping": {"LOST": 0.0}}, {}),
    "gate of lost velocities": ({"clipping": {"LEAST_EXPECTED": 1e30}}, {}),
    "bend of a clipped rate": ({"clipping": {"CURVE_LAG": 1e9}}, {}),
    "middle of the band": ({"scale": {"BAND": 0.0}}, {}),
    "attitude found lost": ({"alignment": {"LOST_FORCE2": 1e30}}, {}),
    "scale": ({"scale": {"SCALE_TIME": 1e12, "SCALE_YOUNG": 1e12}}, {}),
    "young scale": ({"scale": {"OWN_AGE": 1e9, "SCALE_SETTLED": 1e-9}}, {}),
    "errors of the accelerometers follow the filter": ({"accelerometer_errors": {"RESPONSE": 1e9}}, {}),
    "gyro bias that rotation hides": ({"scale": {"BIAS_SHARE": 0.0}}, {}),
}


class Row(NamedTuple):
    """Of each case the direction error, deg, and the normalised error squared of both angles; how many are in band."""

    errors: list[float]
    nees: list[tuple[float, float]]
    inside: int


def recordings(folder: Path) -> None:
    """Simulate every case once and keep it for the variants."""
    for number, (name, changes) in enumerate(CASES.items()):
        for seed in SEEDS:
            t, w, f, down = bench.drilled(bench.SCENARIOS / "bench" / "rot155.yaml", {**changes, "seed": seed})
            if name == "white force":
                f = f + np.random.default_rng(seed).normal(scale=WHITE, size=f.shape)
            elif name == "turned in a gap":
                behind = slice(len(t) // 3, None)
                t, w, f, down = t.copy(), w.copy(), f.copy(), down.copy()
                t[behind] += round(GAP_S * 1e9)
                w[behind], f[behind], down[behind] = w[behind] @ TURNED, f[behind] @ TURNED, down[behind] @ TURNED
            np.savez(folder / f"{number}_{seed}.npz", t=t, w=w, f=f, down=down)


def measure(name: str, folder: Path) -> Row:
    """One row of the table."""
    constants, settings = VARIANTS[name]
    for module, values in constants.items():
        for constant, value in values.items():
            setattr(importlib.import_module(ROOM + module), constant, value)
    # The place is known, as to the estimator.
    p = bounded.BoundedParams(**{"gravity": bench.GRAVITY, "gravity_sigma": 0.002, **settings})
    row, inside = Row([], [], 0), 0
    for number in range(len(CASES)):
        errors, inclined, turned = [], [], []
        for seed in SEEDS:
            with np.load(folder / f"{number}_{seed}.npz") as data:
                t, down = data["t"], data["down"]
                got, late = bounded.run(p, bounded.initial(p), t, data["w"], data["f"]), t - t[0] > bench.SKIP_NS
            errors.append(bench.rms(bench.angle(got.g_t, down)[late]))
            apart = np.degrees(got.inclination) - bench.inclination(down)
            aside = (bench.toolface(got.g_t) - bench.toolface(down) + 180.0) % 360.0 - 180.0
            inclined.append((apart[late], np.degrees(got.sigma_inclination[late])))
            turned.append((aside[late], np.degrees(got.sigma_toolface[late])))
        one, other = consistency(inclined), consistency(turned)
        inside += one.inside + other.inside
        row.errors.append(bench.rms(errors))
        row.nees.append((one.nees, other.nees))
    p = p._replace(gravity=bounded.BoundedParams().gravity)
    for (t, w, f, down), scored in bench.broad().values():
        row.errors.append(bench.rms(bench.angle(bounded.run(p, bounded.initial(p), t, w, f).g_t, down)[scored]))
    return row._replace(inside=inside)


def cells(row: Row, reference: Row) -> list[str]:
    """Errors and honesty of a row; `reference`: with all terms."""
    words = [
        f"**{error:.3f}**" if error > 1.1 * usual else f"{error:.3f}"
        for error, usual in zip(row.errors, reference.errors, strict=True)
    ]
    honest = [f"{word} {one:.1f}/{other:.1f}" for word, (one, other) in zip(words, row.nees, strict=False)]
    return [*honest, *words[len(honest) :], f"{row.inside} of {2 * len(CASES)}"]


def main() -> None:
    """Print the table, a process for each row."""
    print("Direction error, deg, and normalised error squared of inclination/toolface.\n")
    print("| without | " + " | ".join([*CASES, *(f"BROAD {trial}" for trial in bench.broad())]) + " | in band |")
    print("|---" * (len(CASES) + len(bench.broad()) + 2) + "|", flush=True)
    reference = None
    with tempfile.TemporaryDirectory() as kept:
        recordings(Path(kept))
        for name in VARIANTS:
            with tempfile.TemporaryDirectory() as cache:
                environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
                command = [sys.executable, str(Path(__file__).resolve()), name, kept]
                row = Row(*json.loads(subprocess.run(command, env=environment, check=True, capture_output=True).stdout))
            reference = reference or row
            print(f"| {name} | " + " | ".join(cells(row, reference)) + " |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(sys.argv[1], Path(sys.argv[2]))))
    else:
        main()

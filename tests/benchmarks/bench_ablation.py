"""
What each term of the bounded filter is worth: errors and honesty without it, as Markdown.

    nice -n 10 python tests/benchmarks/bench.py --only ablation

Each variant runs in a process of its own with its constants changed before the kernels are compiled. The scenarios are
other than those of the benchmark and of its held-out set.
"""

from __future__ import annotations

import importlib
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

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
    "points, strong": bench.held(
        40.0, bench.slides(), {"rms": 25.0}, ahrs={"grade": "mti3_calibrated", "output": "sampled"}
    ),
}
# What is changed: constants by module, settings of `Params`.
VARIANTS: dict[str, tuple[dict[str, dict[str, float]], dict[str, Any]]] = {
    "all terms": ({}, {}),
    "x scale": ({}, {"scale_sigma": 1e-6}),
    "lever arm": ({}, {"lever_sigma": 1e-4}),
    "displacement follows the motion": ({"noise": {"WHITE_PER_DISPLACEMENT": 0.0, "WALK_PER_DISPLACEMENT": 0.0}}, {}),
    "displacement assumed at a start": ({"noise": {"START_DISPLACEMENT": 0.0}}, {}),
    "white force": ({"noise": {"WHITE_SHARE": 0.0, "FOLDED_LEAST": 1e9}}, {}),
    "white force counts whole": ({"noise": {"FOLDED_LEAST": 1e9}}, {}),
    "velocity lost in clipped shocks": ({"clipping": {"LOST": 0.0}}, {}),
    "gate of lost velocities": ({"clipping": {"GATE": 1e30}}, {}),
    "bend of a clipped rate": ({"clipping": {"CURVE_LAG": 1e9}}, {}),
    "gyros out of line": ({}, {"misalignment_sigma": 0.0}),
    "calibration": ({}, {"calibration_sigma": 0.0}),
    "scale": ({"scale": {"SCALE_TIME": 1e12, "SCALE_AGE": 1e12, "SUDDEN": 1e30}}, {}),
    "scale follows sudden changes": ({"scale": {"SUDDEN": 1e30}}, {}),
    "young scale": ({"scale": {"OWN_AGE": 1e9, "SCALE_AGE": 1e9}}, {}),
}


def measure(name: str) -> str:
    """One row of the table: direction error, deg, and normalised error squared of inclination and toolface."""
    constants, settings = VARIANTS[name]
    for module, values in constants.items():
        for constant, value in values.items():
            setattr(importlib.import_module(ROOM + module), constant, value)
    p = bounded.Params(**settings)
    cells, inside = [], 0
    for changes in CASES.values():
        errors, inclined, turned = [], [], []
        for seed in SEEDS:
            t, w, f, down = bench.drilled(bench.SCENARIOS / "bench" / "rot155.yaml", {**changes, "seed": seed})
            got, late = bounded.run(p, bounded.initial(p), t, w, f), t - t[0] > bench.SKIP_NS
            errors.append(bench.rms(bench.angle(got.g_t, down)[late]))
            apart = np.degrees(got.inclination) - bench.inclination(down)
            aside = (bench.toolface(got.g_t) - bench.toolface(down) + 180.0) % 360.0 - 180.0
            inclined.append((apart[late], np.degrees(got.sigma_inclination[late])))
            turned.append((aside[late], np.degrees(got.sigma_toolface[late])))
        one, other = consistency(inclined), consistency(turned)
        inside += one.inside + other.inside
        cells.append(f"{bench.rms(errors):.3f} {one.nees:.1f}/{other.nees:.1f}")
    trials = bench.broad().values()
    if trials:
        real = [
            bench.rms(bench.angle(bounded.run(p, bounded.initial(p), t, w, f).g_t, down)[scored])
            for (t, w, f, down), scored in trials
        ]
        cells.append(f"{np.mean(real):.3f}")
    else:
        cells.append(str(math.nan))
    return f"| {name} | " + " | ".join(cells) + f" | {inside} of {2 * len(CASES)} |"


def main() -> None:
    """Print the table, a process for each row."""
    print("| without | " + " | ".join(CASES) + " | BROAD | in band |")
    print("|---" * (len(CASES) + 3) + "|")
    for name in VARIANTS:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
            command = [sys.executable, str(Path(__file__).resolve()), name]
            print(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.strip())
            sys.stdout.flush()
    print("\nDirection error, deg, and normalised error squared of inclination / toolface (1 expected) of two tools.")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(measure(sys.argv[1]))
    else:
        main()

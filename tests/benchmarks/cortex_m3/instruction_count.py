# SPDX-License-Identifier: Apache-2.0
"""
Instructions of an update of S3's filters on a controller without a floating-point unit, counted in emulation.

`make cortex` compiles the C form of the filters (gravity_filters.h) for a Cortex-M3, runs it in QEMU over samples of
the two simulated experiments of S3, compares each direction with the Python kernels, and writes counts.csv. It needs
the Debian packages gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm, and is therefore not in the gate.
"""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.gravity import methods as gravity
from mwd_sensors.core.arrays import Array
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

HERE = Path(__file__).resolve().parent
COUNTS = HERE / "counts.csv"
COLUMNS = ("experiment", "filter", "instructions_per_update", "compiler", "emulator")
#: Filter of main.c and the method of the estimator that it repeats.
FILTERS = {"fuzzy": "s3", "kalman_reduced": "kalman", "kalman_full": "kalman"}
RATE_HZ = 100
SECONDS, COUNTED_S = 8.0, 4.0
#: Experiment, its scenario, and the second at which the samples begin.
EXPERIMENTS: dict[str, tuple[str, dict[str, Any], float]] = {
    "rotation": ("s3_rotation", {}, 9.0),
    "vibration": ("s3_vibration", {"link": {"loss": 0.0}}, 30.0),
}
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
_TARGET = ("-mcpu=cortex-m3", "-mthumb", "-mfloat-abi=soft", "-DCORTEX_M3", "--specs=rdimon.specs")
#: Line of main.c that checks the clock, and the instructions of its loop.
_CLOCK, _LOOP = "clock", 1002
_BOARD = ("-M", "mps2-an385", "-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=0")


def samples(experiment: str) -> tuple[Array, Array]:
    """Return rates, rad/s, and forces, m/s^2, of an experiment, shape (n, 3), rounded to single precision."""
    name, changes, start_s = EXPERIMENTS[experiment]
    blocks = []
    for block in Sonde(scenario.read(SCENARIOS / f"{name}.yaml", changes)).blocks(1.0):
        blocks.append(block["imu/data_raw"])
        if len(blocks) >= start_s + SECONDS:
            break
    found = np.concatenate(blocks)[round(start_s * RATE_HZ) :][: round(SECONDS * RATE_HZ)]
    rates, forces = found["angular_velocity"], found["linear_acceleration"]
    return rates.astype(np.float32).astype(float), forces.astype(np.float32).astype(float)


def expected(name: str, rates: Array, forces: Array) -> Array:
    """Return the direction of gravity after each sample by the Python kernel of a filter, shape (n, 3)."""
    method = gravity.method(FILTERS[name])
    params = method.Params()
    stamps = np.arange(len(rates), dtype=np.int64) * (1_000_000_000 // RATE_HZ)
    found: Array = method.run(params, method.initial(params), stamps, rates, forces).g_t
    return found


def write_samples(folder: Path, rates: Array, forces: Array) -> None:
    """Write samples.h, the input of main.c."""
    lines = [f"#define SAMPLES {len(rates)}", f"#define FROM {len(rates) - round(COUNTED_S * RATE_HZ)}"]
    lines.append(f"#define DT {1.0 / RATE_HZ}")
    for name, values in (("rates", rates), ("forces", forces)):
        rows = ",".join("{" + ",".join(f"R({v:.17g})" for v in row) + "}" for row in values)
        lines.append(f"static const real {name}[SAMPLES][3] = {{{rows}}};")
    (folder / "samples.h").write_text("\n".join(lines) + "\n", encoding="ascii")


def compiled(folder: Path, compiler: str, *options: str) -> Path:
    """Compile main.c with the samples of a folder; raises subprocess.CalledProcessError if that fails."""
    program = folder / "filters.elf"
    words = [compiler, "-O2", "-Wall", "-Werror", "-std=c11", f"-I{folder}", *options, "-o", str(program)]
    subprocess.run([*words, str(HERE / "main.c"), "-lm"], check=True)
    return program


def output(words: list[str]) -> dict[str, tuple[float, NDArray[np.float64]]]:
    """
    Run the program and return its count of instructions and its directions, by filter.

    Raises
    ------
    RuntimeError
        The clock does not count instructions.
    """
    done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=600)
    found: dict[str, tuple[float, NDArray[np.float64]]] = {}
    rows: list[list[float]] = []
    for line in reversed(done.stdout.splitlines()):
        first, *more = line.split()
        if first == _CLOCK:
            if abs(float(more[0]) - _LOOP) > 2.0:
                raise RuntimeError(
                    f"the clock of the emulator counts {more[0]} instructions where {_LOOP} are executed"
                )
        elif first in FILTERS:
            found[first] = float(more[0]), np.array(rows[::-1])
            rows = []
        else:
            rows.append([float(first), *map(float, more)])
    return found


def furthest(got: Array, wanted: Array) -> float:
    """Return the largest angle between directions, rad."""
    return float(np.linalg.norm(np.cross(got, wanted), axis=1).max())


def main() -> None:
    """Count, compare and write the table."""
    missing = [name for name in (COMPILER, EMULATOR) if shutil.which(name) is None]
    if missing:
        sys.exit(
            f"{' and '.join(missing)} not found, nothing was counted:"
            " apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
        )
    versions = [
        subprocess.run([name, "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]
        for name in (COMPILER, EMULATOR)
    ]
    rows = []
    for experiment in EXPERIMENTS:
        rates, forces = samples(experiment)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_samples(folder, rates, forces)
            board = (*_TARGET, "-T", str(HERE / "mps2_an385.ld"), str(HERE / "startup.c"))
            program = compiled(folder, COMPILER, *board)
            found = output([EMULATOR, *_BOARD, "-kernel", str(program)])
        for name in FILTERS:
            count, directions = found[name]
            off = furthest(directions, expected(name, rates, forces))
            print(f"{experiment}, {name}: {count:.0f} instructions, at most {off:.1e} rad from the Python kernel")
            if off > 1e-4:
                sys.exit("the C filter and the Python kernel differ by more than single precision explains")
            rows.append((experiment, name, f"{count:.0f}", *versions))
    with COUNTS.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()

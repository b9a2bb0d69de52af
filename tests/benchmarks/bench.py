# SPDX-License-Identifier: Apache-2.0
"""
All benchmarks in one run, printed and written to docs/benchmarks.md: ours, the papers' methods and the peers.

Each is a program of its own beside this one that prints its figures; `--only` runs some of them and leaves the rest of
the file as it stands.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
OUTPUT = HERE.parents[1] / "docs" / "benchmarks.md"
# Name, title, program and its arguments, whether it prints Markdown.
SECTIONS = (
    ("gravity", "Gravity while drilling", ["bench_gravity.py", "3"], True),
    ("ablation", "What each term of the gravity filter is worth", ["bench_ablation.py"], True),
    ("north", "North seeking", ["bench_north.py"], True),
    ("magnetics", "Magnetics and fusion", ["bench_magnetics.py"], True),
    ("surveys", "Surveys against truth", ["bench_surveys.py"], True),
    ("health", "Sensor health", ["bench_health.py"], True),
    ("bags", "Bags and reprocessing", ["bench_bags.py"], False),
    ("fleet", "A fleet of bags", ["bench_fleet.py"], True),
    ("link", "The telemetry link", ["bench_link.py", "10"], True),
    ("link_codes", "The telemetry link: carriers, EM, serial", ["bench_link_codes.py", "4"], True),
    ("downlink", "The downlink", ["bench_downlink.py"], True),
    ("live", "The live chain", ["bench_live.py"], True),
    ("surface", "The surface node", ["bench_surface.py"], True),
)


# The packages of this tree, whichever is installed; the benchmarks read signals and figures that the tests use too.
_PACKAGES = tuple(HERE.parents[1] / name for name in ("mwd_sensors", "mwd_estimation", "mwd_surface"))
_TESTS = HERE.parent, _PACKAGES[1] / "test", _PACKAGES[2] / "test" / "surveys"
_SHARED = (*_PACKAGES, *_TESTS)
# Linear algebra in one thread, as the nodes have it.
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1"} | os.environ | {"PYTHONPATH": os.pathsep.join(map(str, _SHARED))}


def run(words: list[str]) -> list[str]:
    """Lines of a program, shown as they come; a failure ends the run."""
    lines = []
    with subprocess.Popen(
        [sys.executable, str(HERE / words[0]), *words[1:]], stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as one:
        for line in one.stdout or ():
            print(line, end="", flush=True)
            lines.append(line.rstrip())
    if one.returncode:
        sys.exit(f"{words[0]} ended with status {one.returncode}")
    return lines


def sections_of(text: str) -> dict[str, str]:
    """What the file holds so far, by title."""
    parts = re.split(r"^## (.+)\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def main() -> None:
    """Run them all, or those asked for."""
    names = [name for name, *_ in SECTIONS]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="which benchmarks to run")
    options = parser.parse_args()
    found = sections_of(OUTPUT.read_text()) if OUTPUT.exists() else {}
    for name, title, words, markdown in SECTIONS:
        if name in options.only:
            print(f"\n## {title}\n", flush=True)
            lines = run(words)
            found[title] = "\n".join(["", *(lines if markdown else ["```", *lines, "```"]), "", ""])
            write(found)


def write(found: dict[str, str]) -> None:
    """The file, with every section there is."""
    head = (
        "# Benchmarks\n\n"
        "Written by `make bench`: ours, the papers' methods and the peers on the same data in the same run.\n"
        f"Quote ratios; times are of one machine ({os.cpu_count()} cores, CPython {platform.python_version()}).\n\n"
    )
    body = "".join(f"## {title}\n{found[title].rstrip()}\n\n" for _, title, *_ in SECTIONS if title in found)
    OUTPUT.write_text(head + body.rstrip() + "\n")


if __name__ == "__main__":
    main()

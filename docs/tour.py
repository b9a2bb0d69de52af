# SPDX-License-Identifier: Apache-2.0
"""
Run the commands of the README one after the other, and write their durations to docs/tour.md.

`make tour` takes a quarter of an hour. A command that must be ended by hand (`mwd view`) is left out.
"""

from __future__ import annotations

import datetime
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "tour.md"
HEADINGS = ("A first tour", "Your own data")
ENDED_BY_HAND = ("mwd view",)
# Placeholder in the README -> the reader's own file.
OWN = {"YOUR_BAG": "out/first"}
HEAD = """# The tour, timed

`make tour` runs the commands of the README in this order; `YOUR_BAG` is the recording of the first command. The
short commands mainly take the time to start Python. `mwd compare` ends with status 1 if the runs differ, like
`diff`. `mwd run` and `mwd replay` take the time of their recording at the given rate.

"""


def commands() -> list[str]:
    """Return the commands in the README's tour, without comments."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = []
    for heading in HEADINGS:
        block = text.partition(f"## {heading}\n")[2].partition("```sh\n")[2].partition("```")[0]
        found += [line.partition("#")[0].strip() for line in block.splitlines() if line.startswith("mwd ")]
    return [one for one in found if not one.startswith(ENDED_BY_HAND)]


def run(command: str, folder: Path, environment: dict[str, str]) -> tuple[float, int]:
    """Run a command; return its duration, s, and exit status. Its output is appended to log.txt in the folder."""
    for word, own in OWN.items():
        command = command.replace(word, own)
    with (folder / "log.txt").open("a", encoding="utf-8") as log:
        began = time.monotonic()
        words = ["bash", "-c", command]
        status = subprocess.run(words, cwd=folder, env=environment, stdout=log, stderr=log, check=False).returncode
    return time.monotonic() - began, status


def main() -> int:
    """Run all commands and write the table; return 1 if a command failed, else 0."""
    rows, failed = [], False
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        tool = folder / "bin" / "mwd"
        tool.parent.mkdir()
        tool.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mwd_surface.cli "$@"\n', encoding="utf-8")
        tool.chmod(0o755)
        environment = os.environ | {"PATH": f"{tool.parent}:{os.environ['PATH']}"}
        for command in commands():
            seconds, status = run(command, folder, environment)
            rows.append(f"| `{command}` | {seconds:.0f} | {status} |")
            print(rows[-1], flush=True)
            if status != (1 if command.startswith("mwd compare") else 0):
                failed = True
                print((folder / "log.txt").read_text(encoding="utf-8")[-2000:], flush=True)
    day = datetime.datetime.now(tz=datetime.UTC).date()
    about = f"{day}, Python {sys.version.split()[0]}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.0f}.\n\n"
    table = "\n".join(["| command | s | status |", "|---|---|---|", *rows])
    TABLE.write_text(f"{HEAD}{about}{table}\n", encoding="utf-8")
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())

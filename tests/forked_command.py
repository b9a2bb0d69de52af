# SPDX-License-Identifier: Apache-2.0
"""
`mwd` commands in processes of their own, without the start of Python and the import of numba and scipy for each.

A server process imports these packages once. Each command is a fork of it, so its memory, time and exit status are its
own, as when a user starts it.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import multiprocessing
import os
import resource
import sys
import tempfile
from multiprocessing.context import ForkServerContext
from pathlib import Path

# Modules that import most of what any command needs.
_IMPORTED_ONCE = [
    "mwd_surface.cli",
    "mwd_surface.commands.table_reference",
    "mwd_surface.commands.terminal",
    "mwd_surface.exports.export",
    "mwd_surface.exports.survey_table",
    "mwd_surface.list_files.list_file",
    "mwd_surface.list_files.six_axis_table",
    "mwd_surface.plots.bag_plots",
    "mwd_surface.processing.inspection",
    "mwd_surface.processing.process",
    "mwd_surface.receiver.link.receivers",
    "mwd_surface.receiver.pressure_files",
    "mwd_surface.runs.calibration_run",
    "mwd_surface.runs.player",
    "mwd_surface.runs.simulate",
    "mwd_surface.surveys.multi_station_analysis",
    "mwd_surface.surveys.survey_source",
    "pyarrow.parquet",
    "pydantic.main",
    "rich.console",
]


@functools.cache
def _server() -> ForkServerContext:
    # The server would pass over a name that does not exist.
    assert all(importlib.util.find_spec(name) for name in _IMPORTED_ONCE)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_IMPORTED_ONCE)
    return context


def _run(words: list[str], output: str, folder: str, memory: int) -> None:
    from mwd_surface import cli

    file = os.open(output, os.O_WRONLY | os.O_CREAT)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    sys.argv = ["mwd", *words]
    cli.main()


def run(*words: object, memory: int, timeout_s: float) -> tuple[int | None, str]:
    """
    Run a command in the present folder.

    Parameters
    ----------
    words
        Words of the command line after `mwd`.
    memory
        Limit of its address space, bytes.
    timeout_s
        Time after which it is killed, s.

    Returns
    -------
    int or None
        Exit status; negative for the number of a signal, None if the time was over.
    str
        What it wrote to its output and its errors.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        process = _server().Process(target=_run, args=([*map(str, words)], str(output), str(Path.cwd()), memory))
        process.start()
        process.join(timeout_s)
        status = process.exitcode
        process.kill()
        process.join()
        with contextlib.suppress(FileNotFoundError):
            return status, output.read_text(encoding="utf-8")
        return status, ""

# SPDX-License-Identifier: Apache-2.0
"""`mwd compare`: comparison of two runs, or of a recording with a golden run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.speech import spoken_figure

if TYPE_CHECKING:
    from mwd_surface.processing.compare import Comparison


def compare(
    run_a: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="Results of `mwd process`, a recording, or the folder of a golden recording (see above).",
        ),
    ],
    run_b: Annotated[
        Path | None,
        typer.Argument(
            metavar="[EXPECTED]", help="Results to compare with: a folder of `mwd process` or of a golden recording."
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Largest allowed difference of a quantity, e.g. survey_azimuth_deg=0.1. May be repeated.",
        ),
    ] = None,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept", help="Process the bag of a golden recording, and store the results as the expected results."
        ),
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="PNG file to write, with a plot of both runs.", metavar="PNG")
    ] = None,
) -> None:
    """
    Show the differences of two runs, by station and over all samples. Exit status 0: within the limits; 1: not.

    Without limits, any difference in a printed digit counts. A golden recording is a folder with a bag, the results
    that this bag must give, and limits with their reasons. If only this folder is given, its bag is processed and
    compared with its results. A recording is processed with the settings of the results to compare with.

    \b
    Examples:
      mwd compare out_new out_old
      mwd compare out_new out_old --limit survey_azimuth_deg=0.1 --limit attitude_gravity_deg=0.05
      mwd compare bags/run_7 out_old -o both.png
      mwd compare bags/golden/stations
    """
    from mwd_surface.processing import compare as runs
    from mwd_surface.processing import run_folder

    if accept:
        if run_b is not None or limit:
            raise ValueError("--accept: give only the folder of a golden recording, and no limits")
        runs.accept_golden(run_a)
        terminal.tell(f"written: the expected results of {run_a}")
        return
    ours, expected = (run_a / "bag", run_a) if run_b is None else (run_a, run_b)
    if output is not None and output.suffix.lower() != ".png":
        raise ValueError(f"--output {output}: the plot must be .png")
    if run_b is None and not runs.is_golden(run_a):
        raise ValueError(
            f"{run_a} is not a golden recording (bag/ and limits.yaml); give the results to compare with as well"
        )
    if not run_folder.is_run(expected):
        raise ValueError(f"{expected} holds no results to compare with; `mwd process {expected} -o DIR` makes them")
    with runs.processed(ours, expected) as run:
        limits = {**runs.limits_of(expected), **_limits(limit)}
        found = runs.compare(run, expected, limits)
        if output is not None:
            picture = _picture(run, expected)
    names = (str(run_a), str(run_b)) if run_b is not None else (f"{run_a} as processed now", "its stored results")
    _show(found, names, limited=bool(limits))
    if output is not None:
        terminal.write(output.parent, {output.name: picture})
    if not found.agree:
        raise typer.Exit(1)


def _picture(run: Path, expected: Path) -> bytes:
    from mwd_surface.plots import run_comparison
    from mwd_surface.plots.drawing import png
    from mwd_surface.processing import run_folder

    ours, theirs = (
        run_comparison.ComparedRun(path.resolve().name, run_folder.attitude(path), run_folder.surveys(path))
        for path in (run, expected)
    )
    return png(spoken_figure(run_comparison.picture(ours, theirs)))


def _limits(given: list[str] | None) -> dict[str, float]:
    limits = {}
    for one in given or []:
        name, _, value = one.partition("=")
        try:
            limits[name] = float(value)
        except ValueError as error:
            raise ValueError(f"--limit {one}: expected NAME=VALUE") from error
    return limits


def _show(found: Comparison, names: tuple[str, str], *, limited: bool) -> None:
    """
    Print the differences of two runs, first minus second.

    names: names of the runs. limited: whether limits are set; exceeded limits are then printed.
    """
    console = terminal.output()
    terminal.tell(f"differences: {names[0]} minus {names[1]}")
    if found.stations:
        headings = ("nr", "depth m", "time s", "inclination deg", "azimuth deg", "toolface deg")
        table = terminal.table(headings, title="stations")
        for one in found.stations:
            shown = ("inclination_deg", "azimuth_deg", "toolface_deg")
            angles = ("-" if name in one.unknown else f"{one.differences[name]:+.4f}" for name in shown)
            table.add_row(one.sequence, one.measured_depth or "-", f"{one.stamp_difference_s:+.3f}", *angles)
        console.print(table)
    table = terminal.table(("", "samples", "mean deg", "rms deg", "largest deg"), title="samples")
    for line in found.statistics:
        figures = (f"{line.mean:+.5f}", f"{line.rms:.5f}", f"{line.largest:.5f}") if line.count else ("-", "-", "-")
        table.add_row(line.name, str(line.count), *figures)
    console.print(table)
    terminal.tell(
        f"{found.rows} samples in both, {found.rows_extra} only in the first, {found.rows_missing} only in the second; "
        f"status differs at {found.status_differs} samples"
    )
    for failure in found.failures if limited else ():
        terminal.tell(f"differs: {failure}")
    differ = (
        f"{len(found.failures)} limits exceeded" if limited else "the runs differ; --limit sets allowed differences"
    )
    terminal.tell("the runs agree" if found.agree else differ)

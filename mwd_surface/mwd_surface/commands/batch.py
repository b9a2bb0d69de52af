# SPDX-License-Identifier: Apache-2.0
"""`mwd batch`: process a fleet of recordings into one data set, on a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    PLACE,
    READING,
    Changes,
    Config,
    GivenPlace,
    Reading,
    assignments,
    input_settings,
    placed_settings,
    recording_changes,
    takes,
)

if TYPE_CHECKING:
    from mwd_surface.fleet.fleet_task import Outcome

_CLUSTER = "Cluster"

Scheduler = Annotated[
    str,
    typer.Option(
        help="Where to process: on this machine in processes (local) or in threads of one process (threads), or on the "
        "Dask cluster at tls://HOST:PORT or tcp://HOST:PORT.",
        rich_help_panel=_CLUSTER,
    ),
]
TlsCa = Annotated[
    Path | None,
    typer.Option(
        "--tls-ca", help="PEM file with the certificate authority of a tls:// cluster.", rich_help_panel=_CLUSTER
    ),
]
TlsCert = Annotated[
    Path | None,
    typer.Option(
        "--tls-cert",
        help="PEM file with the certificate of this client for a tls:// cluster.",
        rich_help_panel=_CLUSTER,
    ),
]
TlsKey = Annotated[
    Path | None,
    typer.Option(
        "--tls-key", help="PEM file with the private key of the certificate of --tls-cert.", rich_help_panel=_CLUSTER
    ),
]
Workers = Annotated[
    int,
    typer.Option(
        help="Number of parallel workers on this machine; 0: one per processor core.", min=0, rich_help_panel=_CLUSTER
    ),
]


@takes(PLACE, READING)
def batch(
    bags: Annotated[
        list[str], typer.Argument(help="Recordings, folders that contain recordings, or patterns with * and **.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the data set; created if missing.")],
    method: Annotated[str | None, typer.Option(help="Method that estimates gravity, as in `mwd process`.")] = None,
    config: Config = None,
    changes: Changes = None,
    scheduler: Scheduler = "local",
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    workers: Workers = 0,
    *,
    place: GivenPlace,
    reading: Reading,
) -> None:
    """
    Process many recordings into one data set of Parquet tables, with a page that lists the result of each.

    Writes DIR/bags, DIR/surveys and DIR/attitude (one row for every ten seconds), each a folder that polars, duckdb and
    pandas read as one table, and DIR/index.html. If you run the command again, it continues: the results of recordings
    whose content and settings have not changed are kept. A recording of the surface node contains the settings with
    which it was made; options change single settings, and --config replaces all of them. The input options apply to
    every recording. A recording that fails is listed with the reason; the exit status is then 1.

    \b
    Examples:
      mwd batch 'bags/**' -o fleet
      mwd batch pad_7 pad_8 -o fleet --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd batch '/data/**/*.mcap' -o /data/fleet --scheduler tcp://10.0.0.5:8786
      duckdb -c "select bag, count(*) from 'fleet/surveys/*.parquet' where verdict = 'accept' group by bag"
    """
    try:
        from mwd_surface.fleet import fleet_run
    except ModuleNotFoundError as error:
        hint = "pip install distributed pyarrow"
        raise ValueError(f"mwd batch needs the package {error.name}, which is not installed: {hint}") from error
    from mwd_surface.fleet.fleet_dataset import FAILED

    placed = recording_changes(*place)
    estimator = placed_settings(config, changes, placed, method)
    named = placed if method is None else placed | {"gravity.method": method}
    of_recordings = None if config else {**named, **assignments(changes)}
    found = fleet_run.find_bags(bags)
    given = input_settings(reading)
    tls = fleet_run.Tls(*(str(path) if path is not None else "" for path in (tls_ca, tls_cert, tls_key)))
    began = time.monotonic()
    if scheduler.startswith("tcp://"):
        terminal.warn(f"{scheduler}: anyone who can reach this cluster can run programs on it; use tls:// instead")

    def report(outcome: Outcome, share: float) -> None:
        if outcome.row["outcome"] == FAILED:
            terminal.warn(f"{outcome.bag}: {outcome.row['reason']}")
        progress(share)

    try:
        with (
            fleet_run.cluster(scheduler, workers, tls) as client,
            terminal.progress(f"{len(found)} recordings") as progress,
        ):
            outcomes = fleet_run.run(found, output, client, estimator, given, report, of_recordings)
    except KeyboardInterrupt:
        terminal.warn("interrupted; finished results are kept; run the same command again to continue")
        raise typer.Exit(130) from None
    failed = _show(output, fleet_run.write_index(output, outcomes), outcomes, time.monotonic() - began)
    if failed:
        raise typer.Exit(1)


def _show(output: Path, index: Path, outcomes: Sequence[Outcome], elapsed: float) -> int:
    """Print the totals of a batch of recordings; return the number of recordings that failed."""
    from mwd_surface.fleet.fleet_dataset import FAILED

    fresh = [one for one in outcomes if not one.kept and one.row["outcome"] != FAILED]
    failures = [one for one in outcomes if one.row["outcome"] == FAILED]
    samples = sum(one.row["samples"] for one in fresh)
    lines = [
        ("recordings", f"{len(outcomes)}: {len(fresh)} processed, {len(outcomes) - len(fresh) - len(failures)} kept"),
        ("failed", str(len(failures))),
        ("surveys", str(sum(one.row["surveys"] or 0 for one in outcomes))),
        ("speed", f"{samples / max(elapsed, 1e-9):,.0f} samples/s ({elapsed:.1f} s)"),
        ("written", f"{index}, {', '.join(f'{output / name}/*.parquet' for name in ('bags', 'surveys', 'attitude'))}"),
    ]
    terminal.facts(lines, 10)
    return len(failures)

# SPDX-License-Identifier: Apache-2.0
"""
Processing of a fleet of recordings on a Dask cluster, one task per recording.

`fleet_task` describes a task, and `fleet_dataset` the reason why a task can safely run twice. This module finds the
recordings, distributes them to workers, and returns an outcome for each recording, even if its worker fails. A page
lists all outcomes, failures first, in one file without scripts.
"""

from __future__ import annotations

import contextlib
import dataclasses
import glob
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import distributed
import jinja2

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.output_files import write_whole
from mwd_surface.fleet import fleet_dataset
from mwd_surface.fleet.fleet_dataset import FAILED
from mwd_surface.fleet.fleet_task import FleetWork, Outcome, carry_out, changes_text, config_text, failed
from mwd_surface.processing.bag_input import InputSettings

SCHEDULERS = ("local", "processes", "threads")
_ENDINGS = (".mcap", ".db3", ".bag")


def find_bags(patterns: Sequence[str]) -> list[Path]:
    """
    Return the recordings that match the patterns, each once, sorted: folders with a metadata.yaml, and single files.

    A pattern may be a path, a folder to search, or contain `*` and `**`.

    Raises
    ------
    ValueError
        A pattern matches no recording.
    """
    found: set[Path] = set()
    for pattern in patterns:
        # Use glob.glob, because Path.glob does not accept absolute patterns.
        matches = [Path(one) for one in glob.glob(str(Path(pattern).expanduser()), recursive=True)]  # noqa: PTH207
        inside = [path for match in matches for path in (match.rglob("*") if match.is_dir() else ())]
        bags = {_bag_of(path) for path in (*matches, *inside) if path.suffix in _ENDINGS and path.is_file()}
        bags |= {path.parent for path in (*matches, *inside) if path.name == "metadata.yaml"}
        if not bags:
            raise ValueError(f"{pattern}: no recording found")
        found |= {path.resolve() for path in bags}
    return sorted(found)


def _bag_of(file: Path) -> Path:
    return file.parent if (file.parent / "metadata.yaml").is_file() else file


@dataclasses.dataclass(frozen=True)
class Tls:
    """PEM files for an encrypted cluster: certificate of the authority, and certificate and key of this client."""

    ca: str = ""
    cert: str = ""
    key: str = ""


def _security(scheduler: str, tls: Tls) -> distributed.Security | None:
    if not scheduler.startswith("tls://"):
        return None
    missing = [f"--tls-{field.name}" for field in dataclasses.fields(tls) if not getattr(tls, field.name)]
    if missing:
        raise ValueError(f"--scheduler {scheduler}: needs {', '.join(missing)}")
    return distributed.Security(
        tls_ca_file=tls.ca, tls_client_cert=tls.cert, tls_client_key=tls.key, require_encryption=True
    )


@contextlib.contextmanager
def cluster(scheduler: str, workers: int = 0, tls: Tls | None = None) -> Iterator[distributed.Client]:
    """
    Yield a Dask client of an existing cluster (`tls://...`, `tcp://...`), or of a cluster that is made for the run.

    scheduler: address of the cluster; or "local" or "processes" (worker processes, restarted when they die), or
    "threads" (workers in this process). workers: number of workers; 0: one per core. tls: files for a cluster at
    tls://.

    Raises
    ------
    ValueError
        The name is unknown, or files for a tls:// cluster are missing.
    OSError
        No scheduler answers at the address.
    """
    if "://" in scheduler:
        with distributed.Client(scheduler, timeout="10s", security=_security(scheduler, tls or Tls())) as client:
            yield client
        return
    if scheduler not in SCHEDULERS:
        raise ValueError(f"--scheduler {scheduler}: expected {', '.join(SCHEDULERS)} or tcp://HOST:PORT")
    processes = scheduler != "threads"
    cores = workers or len(os.sched_getaffinity(0))
    # The processes that are started here ignore Ctrl-C, and this process ends them.
    with _interrupts(signal.SIG_IGN):
        made = distributed.LocalCluster(
            n_workers=cores if processes else 1,
            threads_per_worker=1 if processes else cores,
            processes=processes,
            host="127.0.0.1" if processes else None,
            # Use any free port, so that two fleets can run at the same time.
            dashboard_address="127.0.0.1:0",
            silence_logs=50,
        )
    with made, distributed.Client(made) as client:
        yield client


@contextlib.contextmanager
def _interrupts(handler: Any) -> Iterator[None]:
    """Let SIGINT call another handler during this block, if the block runs in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def run(
    bags: Sequence[Path],
    folder: Path,
    client: distributed.Client,
    estimator: EstimatorSettings,
    given: InputSettings | None = None,
    report: Callable[[Outcome, float], None] = lambda _outcome, _share: None,
    changes: Mapping[str, Any] | None = None,
) -> list[Outcome]:
    """
    Process every recording that is not yet in the data set in `folder`.

    Parameters
    ----------
    bags : sequence of Path
        Recordings from `find_bags`. Workers on other machines need them, and `folder`, under the same paths.
    report : callable
        Called with each outcome and the share of recordings done, 0 to 1.
    changes : mapping, optional
        Changes to the settings of recordings that contain settings. None: process all recordings with `estimator`.

    Returns
    -------
    list of Outcome
        One outcome per recording, in the same order.

    Raises
    ------
    OSError
        The data set cannot be written.
    """
    done: queue.SimpleQueue[distributed.Future | None] = queue.SimpleQueue()
    # Python's own handler would raise KeyboardInterrupt at any point of the program. Within a garbage collection, where
    # Dask has a callback, the exception would be ignored.
    with _interrupts(lambda *_: done.put(None)):
        (folder / "bags").mkdir(parents=True, exist_ok=True)
        text = config_text(estimator)
        place = str(folder.resolve())
        own = "" if changes is None else changes_text(changes)
        works = [FleetWork(str(bag), place, text, given or InputSettings(), own) for bag in bags]
        # If a worker dies, Dask gives its task to another worker, until the task has killed a few workers.
        futures = {client.submit(carry_out, work, pure=False): work for work in works}
        for future in futures:
            future.add_done_callback(done.put)
        outcomes: dict[str, Outcome] = {}
        for _ in works:
            future = done.get()
            if future is None:
                client.cancel(list(futures))
                raise KeyboardInterrupt
            work = futures[future]
            outcome = _outcome(future, work)
            outcomes[work.bag] = outcome
            report(outcome, len(outcomes) / len(works))
    fleet_dataset.tidy(folder, {one.bag: one.key for one in outcomes.values() if one.key})
    return [outcomes[work.bag] for work in works]


def _outcome(future: distributed.Future, work: FleetWork) -> Outcome:
    if future.status == "finished":
        outcome: Outcome = future.result()
        return outcome
    error = future.exception()
    if isinstance(error, OSError):
        raise error
    return failed(work, "", f"the worker failed: {type(error).__name__}: {error}"[:500])


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Fleet of {{ outcomes | length }} recordings</title>
<style>
body { font: 14px/1.45 "DejaVu Sans", Arial, sans-serif; color: #111; background: #fff; margin: 1.5rem auto;
  max-width: 90rem; padding: 0 1rem; }
h1 { font-size: 1.5rem; } dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; }
dt { color: #444; } dd { margin: 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .85rem; width: 100%; }
th, td { padding: .2rem .5rem; border-bottom: 1px solid #ccc; text-align: right; white-space: nowrap; }
th { background: #eef2f5; } .t { text-align: left; } .w { text-align: left; white-space: normal; min-width: 20rem; }
tr.failed td { background: #fff3e0; } tr.failed td:first-child { border-left: 4px solid #d55e00; }
</style>
</head>
<body>
<main>
<h1>Fleet of {{ outcomes | length }} recordings</h1>
<dl>
{% for name, value in totals %}<dt>{{ name }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl>
<div class="scroll"><table>
<thead><tr><th class="t" scope="col">recording</th><th class="t" scope="col">outcome</th><th scope="col">hours</th>
<th scope="col">samples</th><th scope="col">refused</th><th scope="col">gaps</th><th scope="col">surveys</th>
<th scope="col">accepted</th><th scope="col">doubtful</th><th scope="col">rejected</th>
<th class="t" scope="col">remarks</th></tr></thead>
<tbody>
{% for one in outcomes %}{% set r = one.row %}<tr class="{{ r.outcome }}"><td class="t">{{ one.bag }}</td>
<td class="t">{{ r.outcome }}</td>
{% if r.outcome == failed %}<td colspan="8"></td><td class="w">{{ r.reason }}</td>
{% else %}<td>{{ "%.2f" | format(r.seconds / 3600) }}</td><td>{{ r.samples }}</td><td>{{ r.samples_rejected }}</td>
<td>{{ r.gaps }}</td><td>{{ r.surveys }}</td><td>{{ r.surveys_accepted }}</td><td>{{ r.surveys_doubtful }}</td>
<td>{{ r.surveys_rejected }}</td><td class="w">{{ r.warnings | join("; ") }}</td>
{% endif %}</tr>
{% endfor %}</tbody></table></div>
<p>The tables behind this page: <code>bags/*.parquet</code>, <code>surveys/*.parquet</code>,
<code>attitude/*.parquet</code> (one row for every ten seconds).</p>
</main>
</body>
</html>
"""


def index_html(outcomes: Sequence[Outcome]) -> str:
    """Return the page as HTML text; texts from recordings are escaped."""
    done = [one.row for one in outcomes if one.row["outcome"] != FAILED]
    totals = [
        ("processed", f"{len(done)} of {len(outcomes)}"),
        ("failed", str(len(outcomes) - len(done))),
        ("hours", f"{sum(row['seconds'] for row in done) / 3600.0:.2f}"),
        ("IMU samples", str(sum(row["samples"] for row in done))),
        ("bytes", str(sum(one.row["bytes"] for one in outcomes))),
        ("surveys", str(sum(row["surveys"] for row in done))),
        ("accepted", str(sum(row["surveys_accepted"] for row in done))),
    ]
    ordered = sorted(outcomes, key=lambda one: (one.row["outcome"] != FAILED, one.bag))
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    return environment.from_string(_PAGE).render(outcomes=ordered, totals=totals, failed=FAILED)


def write_index(folder: Path, outcomes: Sequence[Outcome]) -> Path:
    """
    Write index.html into a folder, completely or not at all; return the path of the file.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    path = folder / "index.html"
    write_whole(path, index_html(outcomes))
    return path

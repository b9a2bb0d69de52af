# SPDX-License-Identifier: Apache-2.0
"""Page of a fleet: one line per recording, failures first, in one file without scripts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import jinja2

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.output_files import write_whole
from mwd_surface.fleet.fleet_dataset import FAILED
from mwd_surface.fleet.fleet_task import Outcome

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

# SPDX-License-Identifier: Apache-2.0
"""`mwd survey`: surveys with verdicts from a table of six-axis readings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    FIELD_PANEL,
    PLACE,
    Changes,
    Config,
    Convergence,
    Declination,
    GivenPlace,
    takes,
)
from mwd_surface.commands.table_reference import GivenReference, RowReference, table_reference, table_settings


@takes(PLACE)
def survey(
    stations: Annotated[Path, typer.Argument(help="CSV file with one line per station and named columns.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV file to write, in addition to the printed table.")
    ] = None,
    declination: Declination = None,
    convergence: Convergence = None,
    gravity: Annotated[float | None, typer.Option(help="Local gravity, m/s^2.", rich_help_panel=FIELD_PANEL)] = None,
    axial: Annotated[
        str | None, typer.Option(help="Axis that points down-hole, x or z, if columns are named like gx, gy, gz.")
    ] = None,
    single: Annotated[
        bool, typer.Option("--single", help="Judge each row alone, not together with the other rows of its run.")
    ] = False,
    runs: Annotated[
        str | None,
        typer.Option(help="Column that names the tool run of each row; by default run, bha or tool."),
    ] = None,
    config: Config = None,
    changes: Changes = None,
    *,
    place: GivenPlace,
) -> None:
    """
    Compute surveys from a table of six-axis readings, each with its verdict and the reasons.

    Columns are found by name and unit (grav_axial_mps2, mag_tran1_nT, b_ref_nT, decl_used_deg ...); options replace the
    values of the table. The azimuth of a station without a reference field is not corrected and is from magnetic north;
    the station is marked as such. The rows of a run (column run, bha or tool; without such a column, the whole table)
    are analysed together, because the errors of string and sensors are the same in all of them. A row can then be
    revised; its first value, which uses only the rows before it, is also kept. Inclination and azimuth that the table
    already has (incl_deg, azi_grid_deg) are compared with the readings: a table whose sensor columns have a wrong sign,
    order or unit or are left-handed, or which has a dead axis, is rejected, and the reason says which columns to
    correct.

    \b
    Examples:
      mwd survey stations.csv -o surveys.csv
      mwd survey stations.csv -o surveys.csv --field 50360,71.63 --declination -2.2 --convergence -0.95
      mwd survey stations.csv --lat 58.44 --lon 1.88 --date 2026-03-01 --axial z
      mwd survey stations.csv --single
    """
    from mwd_estimation.settings.derivation import station_params
    from mwd_surface.commands.survey_table import (
        correction_sentences,
        repeated,
        revision_sentences,
        run_sentences,
        show_surveys,
    )
    from mwd_surface.list_files.remark import sentences
    from mwd_surface.list_files.six_axis_table import find_columns, read_readings, single_stations, table_rows
    from mwd_surface.surveys import survey_csv
    from mwd_surface.surveys.table_run import run_stations, table_surveys

    table, left_out = read_readings(stations, axial)
    settings = table_settings(config, changes, place)
    columns = find_columns(table, axial)
    times = table.get(columns.time or "", ())
    override, remarks = table_reference(
        settings, GivenReference.of(place.field, declination, convergence, gravity), times
    )
    rows = RowReference(settings)
    read = table_rows(table, override, axial=axial, refine=rows.at, run=runs)
    params = station_params(settings)
    with terminal.progress(f"{len(read)} stations") as progress:
        worked = table_surveys(single_stations(read, params) if single else run_stations(read, params, progress))
    terminal.warn(*sentences(left_out), *columns.assumed, *remarks)
    records = [row.record for row in worked]
    show_surveys(records)
    terminal.tell(*correction_sentences([row.reference for row in read]))
    if not single:
        terminal.tell(*run_sentences(worked), *revision_sentences(records))
    if all(math.isnan(row.azimuth) for row in read):
        terminal.tell(
            "the table has no azimuths of its own: nothing shows whether its axes are right-handed; in a left-handed "
            "table every azimuth is mirrored at magnetic north"
        )
    terminal.tell(*repeated(worked, settings))
    if output is not None:
        lines = [
            survey_csv.cells(row.record) | {"time": row.time, "run": row.run, "outlier": "yes" if row.outlier else "no"}
            for row in worked
        ]
        terminal.write(output.parent, {output.name: survey_csv.text(lines, tuple(survey_csv.OF_TABLES))})

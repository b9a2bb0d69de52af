# SPDX-License-Identifier: Apache-2.0
"""`mwd forecast`: forecast of the accuracy of surveys along a plan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import LIST, PLACE, Changes, Convergence, Declination, GivenPlace, takes
from mwd_surface.commands.speech import spoken_figure
from mwd_surface.commands.table_reference import GivenReference, table_reference, table_settings

if TYPE_CHECKING:
    from mwd_surface.list_files.list_settings import ListSettings
    from mwd_surface.uncertainty.forecast import Forecast


@takes(PLACE, LIST)
def forecast(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="File of the planned path, in any format that `mwd path` reads.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    code: Annotated[str, typer.Option(help="ISCWSA tool code of the surveys, e.g. MWD+IFR1+SAG.")] = "MWD+SRGM",
    axial: Annotated[float, typer.Option(help="Expected axial interference of the drill string, nT.")] = 0.0,
    limit: Annotated[
        float,
        typer.Option(
            help="Largest useful 1 sigma of an azimuth after the axial correction, deg; a station above it is marked "
            "no-go."
        ),
    ] = 2.0,
    declination: Declination = None,
    convergence: Convergence = None,
    changes: Changes = None,
    *,
    place: GivenPlace,
    listed: ListSettings,
) -> None:
    """
    Forecast surveys along a plan: sigmas, limits of quality control, no-go directions of the axial correction.

    Writes DIR/forecast.csv and DIR/forecast.png. The column accepted gives the share of stations that pass quality
    control if the tool is healthy, the interference is as given, and each station is judged alone. Stations of a run
    are accepted more often, because together they show the interference of the string.

    \b
    Examples:
      mwd forecast plan.csv -o ahead --code MWD+IFR1+SAG --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd forecast plan.csv -o ahead --field 50500,71.2,-1.1 --north grid --convergence -0.9 --axial 400
    """
    from mwd_surface.exports.csv_tables import forecast_csv
    from mwd_surface.list_files.remark import sentences
    from mwd_surface.plots.drawing import png
    from mwd_surface.plots.path_plots import forecast_figure
    from mwd_surface.surveys.well import Well
    from mwd_surface.trajectory.plan import in_north, read_plan
    from mwd_surface.uncertainty.error_terms import check_tool_code
    from mwd_surface.uncertainty.forecast import corrected_sibling, correction_map
    from mwd_surface.uncertainty.forecast import forecast as work_out

    check_tool_code(code)
    if not limit > 0.0:
        raise ValueError(f"--limit {limit:g}: must be positive")
    planned = read_plan(plan, given=listed.given())
    # If the plan does not give its north, use the default north of a well, with a remark.
    from_north = planned.north or Well().north_reference
    planned = in_north(planned, plan, from_north)
    settings = table_settings(None, changes, place)
    reference, remarks = table_reference(settings, GivenReference.of(place.field, declination, convergence))
    if reference is None or reference.total is None:
        raise ValueError("a forecast needs the field: give --lat, --lon and --date, or --field")
    terminal.warn(*sentences(planned.remarks), *remarks)
    latitude = math.nan if settings.place.lat_deg is None else math.radians(settings.place.lat_deg)
    found = work_out(planned, from_north, code, reference, latitude, axial=axial * 1e-9, most=math.radians(limit))
    chart = correction_map(code, reference, latitude) if corrected_sibling(code) else None
    _show(found)
    drawn = spoken_figure(forecast_figure(found, chart))
    terminal.write(output, {"forecast.csv": forecast_csv(found), "forecast.png": png(drawn)})


def _show(found: Forecast) -> None:
    import numpy as np

    from mwd_surface.signals.cells import fixed

    names = ("depth m", "incl", "azi true", "σ incl", "σ azi", "σ corr", "", "±B nT", "±dip", "accept %")
    table = terminal.table(names)
    # Print only some of the stations; the file has all of them.
    for k in np.unique(np.linspace(0, found.md.size - 1, 14).astype(int)):
        degrees = (found.inclination, found.true_azimuth, found.sigma_inclination, found.sigma_azimuth)
        table.add_row(
            f"{found.md[k]:.0f}",
            *(fixed(math.degrees(v[k]), n) for v, n in zip(degrees, (1, 1, 2, 2), strict=True)),
            fixed(math.degrees(found.sigma_corrected[k]), 2),
            "no-go" if found.no_go[k] else "",
            fixed(float(found.limits[k, 1]) * 1e9, 0),
            fixed(math.degrees(found.limits[k, 2]), 2),
            fixed(100.0 * float(found.accepted[k]), 0),
        )
    console = terminal.output()
    console.print(table)
    if np.any(found.no_go):
        part = found.md[found.no_go]
        terminal.tell(
            f"the axial correction is not useful at {np.count_nonzero(found.no_go)} stations between {part[0]:.0f} and "
            f"{part[-1]:.0f} m: plan for a gyro, multi-station analysis or more non-magnetic collars there"
        )

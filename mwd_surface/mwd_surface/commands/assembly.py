# SPDX-License-Identifier: Apache-2.0
"""`mwd sag` and `mwd spacing`: effects of a planned bottom-hole assembly on inclination and azimuth."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_sensors.core import settings
from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import PLACE, GivenPlace, numbers_in, place_changes, takes

if TYPE_CHECKING:
    from mwd_estimation.core.reference_field import Reference
    from mwd_surface.uncertainty.collar_spacing import Steel

_MOST_ROWS = 10_000  # largest number of rows in the table of sag corrections
_STRING = "String, if no assembly is given"


def sag(
    assembly: Annotated[Path, typer.Argument(metavar="BHA", help="YAML file that describes the bottom-hole assembly.")],
    inclination: Annotated[
        str,
        typer.Option(
            help="Inclinations, deg: LOW:HIGH:STEP, LOW:HIGH (10 values) or numbers separated by commas.",
            metavar="RANGE",
        ),
    ] = "0:90:10",
    build: Annotated[
        str | None,
        typer.Option(
            "--build",
            "--dls",
            help="Build rates, deg/30 m, in the form of --inclination; negative where the hole drops. By default the "
            "build rate in the BHA file.",
            metavar="RANGE",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV file to write, in addition to the printed table.")
    ] = None,
) -> None:
    """
    Compute the sag correction of a bottom-hole assembly, to add to measured inclinations.

    If the parameter tool.assembly_file names the BHA file, `mwd process` and the estimator node add the correction to
    every survey.

    \b
    Examples:
      mwd sag bha.yaml
      mwd sag bha.yaml --inclination 0:90:5 --build=-3:3:1.5 -o sag.csv
    """
    from mwd_estimation.assembly.assembly import read_assembly
    from mwd_estimation.assembly.sag import sag as sag_of

    described = read_assembly(assembly)
    builds = [described.build_deg_30m] if build is None else _numbers("--build", build)
    inclinations = _numbers("--inclination", inclination)
    if not all(0.0 <= angle <= 180.0 for angle in inclinations):
        raise ValueError(f"--inclination {inclination}: must be within 0 and 180 deg")
    if len(builds) * len(inclinations) > _MOST_ROWS:
        raise ValueError(f"--inclination and --build: more than {_MOST_ROWS} rows; use a larger step")
    rows = [
        (angle, rate, math.degrees(sag_of(described, math.radians(angle), math.radians(rate) / 30.0)))
        for angle in inclinations
        for rate in builds
    ]
    _show_sag(rows)
    if output is not None:
        lines = ["inclination_deg,build_deg_30m,sag_correction_deg"]
        lines += [f"{angle:g},{rate:g},{correction:.4f}" for angle, rate, correction in rows]
        terminal.write(output.parent, {output.name: "\n".join([*lines, ""])})


@takes(PLACE)
def spacing(
    inclination: Annotated[float, typer.Option(help="Inclination of the hole, deg.")],
    azimuth: Annotated[
        float,
        typer.Option(
            help="Azimuth of the hole, deg: from true north, or from magnetic north if --field has no declination."
        ),
    ],
    assembly: Annotated[
        Path | None,
        typer.Argument(metavar="[BHA]", help="YAML file that describes the bottom-hole assembly.", show_default=False),
    ] = None,
    limit: Annotated[float, typer.Option(help="Allowed azimuth error, deg.")] = 0.5,
    above: Annotated[
        str,
        typer.Option(
            help="Magnetic pole strength of the steel above the non-magnetic collars: a number in uWb, or collars for "
            "the usual value of steel drill collars.",
            rich_help_panel=_STRING,
        ),
    ] = "collars",
    below: Annotated[
        str,
        typer.Option(
            help="Magnetic pole strength of the steel below the non-magnetic collars: a number in uWb, or motor, short "
            "collars or bit for a usual value.",
            rich_help_panel=_STRING,
        ),
    ] = "motor",
    below_length: Annotated[
        float, typer.Option(help="Length of the steel below the non-magnetic collars, m.", rich_help_panel=_STRING)
    ] = 10.0,
    *,
    place: GivenPlace,
) -> None:
    """
    Predict the axial magnetic interference of the steel in the string, the azimuth error, and the collars needed.

    The result is the length of non-magnetic collars above and below the sensors that keeps the azimuth error within
    --limit. Give the magnetic field by --lat and --lon, or by --field.

    \b
    Examples:
      mwd spacing bha.yaml --inclination 60 --azimuth 85 --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd spacing --inclination 90 --azimuth 90 --field 50360,71.63,-2.2 --limit 0.3 --below bit
    """
    from mwd_estimation.assembly.assembly import read_assembly
    from mwd_estimation.core.reference_field import north_correction
    from mwd_surface.uncertainty import collar_spacing

    reference = _reference(place)
    if not 0.0 <= inclination <= 180.0 or not limit > 0.0:
        raise ValueError("--inclination: must be within 0 and 180 deg; --limit: must be above 0")
    turn = north_correction(reference, "true")
    # Without a declination no angle is subtracted, because azimuth and field both refer to magnetic north.
    attitude = math.radians(inclination), math.radians(azimuth) - (turn or 0.0)
    most = collar_spacing.largest_interference(math.radians(limit), *attitude, reference.horizontal)
    lines: list[tuple[str, str]] = []
    if assembly is not None:
        pieces = collar_spacing.pieces_of(read_assembly(assembly))
        _show_pieces(pieces)
        field_t = collar_spacing.interference(pieces)
        error = max(
            abs(collar_spacing.azimuth_error(sign * field_t, *attitude, reference.horizontal)) for sign in (-1.0, 1.0)
        )
        lines.append(("interference", f"up to {field_t * 1e9:.0f} nT along the tool"))
        verdict = "within" if error <= math.radians(limit) else "beyond"
        lines.append(("azimuth error", f"up to {math.degrees(error):.2f} deg, {verdict} the limit of {limit:g} deg"))
    if math.isinf(most):
        lines.append(("allowed", f"any interference: in this direction none changes the azimuth by {limit:g} deg"))
        terminal.facts(lines)
        return
    lines.append(("allowed", f"{most * 1e9:.0f} nT for an azimuth error of {limit:g} deg"))
    poles = _pole("--above", above), _pole("--below", below)
    if assembly is not None:
        poles, below_length = _poles_of(pieces, poles, below_length)
    up, down = collar_spacing.shortest_collars(*poles, below_length, most)
    lines.append(
        ("collars", f"{up:.1f} m of non-magnetic collars above the sensors and {down:.1f} m below them are enough")
    )
    terminal.facts(lines)


def _poles_of(
    pieces: tuple[Steel, ...], poles: tuple[float, float], below_length: float
) -> tuple[tuple[float, float], float]:
    """
    Return the pole strengths of an assembly above and below the sensors, Wb, and the length of the steel below, m.

    poles, below_length : values for an assembly that has no such steel.
    """
    up = max((piece.pole for piece in pieces if math.isinf(piece.length)), default=poles[0])
    finite = [piece for piece in pieces if math.isfinite(piece.length)]
    if not finite:
        return (up, 0.0), below_length
    strongest = max(finite, key=lambda piece: piece.field)
    return (up, strongest.pole), strongest.length


def _reference(place: GivenPlace) -> Reference:
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_estimation.settings.place import reference_of

    changes = place_changes(*place)
    reference = reference_of(settings.changed(EstimatorSettings(), changes).place, time.time_ns())
    if reference is None:
        raise ValueError("the azimuth error depends on the field; give --lat and --lon, or --field")
    return reference


def _pole(option: str, text: str) -> float:
    from mwd_surface.uncertainty.collar_spacing import POLES

    if text in POLES:
        return POLES[text]
    try:
        strength = float(text)
    except ValueError:
        strength = -1.0
    if not strength >= 0.0:
        raise ValueError(f"{option} {text}: expected a pole strength in uWb, or one of {', '.join(POLES)}")
    return strength * 1e-6


def _numbers(option: str, text: str) -> list[float]:
    """
    Return the numbers of LOW:HIGH:STEP, of LOW:HIGH (10 values), or of a list with commas.

    option: name of the option, for the message. Raises ValueError if the text has another form, STEP is not above 0,
    LOW is above HIGH, or there are too many values.
    """
    parts = numbers_in(text, ":" if ":" in text else ",")
    if not parts or (":" in text and len(parts) not in (2, 3)):
        raise ValueError(f"{option} {text}: expected LOW:HIGH, LOW:HIGH:STEP or numbers separated by commas")
    if ":" not in text:
        return parts
    low, high, step = parts if len(parts) == 3 else [*parts, max((parts[1] - parts[0]) / 9.0, 1e-9)]
    if not (step > 0.0 and low <= high and (high - low) / step < _MOST_ROWS):
        raise ValueError(
            f"{option} {text}: LOW must not be above HIGH and STEP must be above 0; at most {_MOST_ROWS} values are "
            "allowed"
        )
    return [low + k * step for k in range(math.floor((high - low) / step + 1e-9) + 1)]


def _show_sag(rows: list[tuple[float, float, float]]) -> None:
    table = terminal.table(("inclination deg", "build deg/30m", "add to inclination deg"))
    for angle, rate, correction in rows:
        table.add_row(f"{angle:g}", f"{rate:g}", f"{round(correction, 3) + 0.0:+.3f}")
    terminal.output().print(table, soft_wrap=False)


def _show_pieces(pieces: tuple[Steel, ...]) -> None:
    table = terminal.table(("steel", "from sensors m", "length m", "pole uWb", "field nT"), left=("steel",))
    for piece in pieces:
        length = f"{piece.length:.1f}" if piece.length < 1e6 else "string"
        table.add_row(piece.name, f"{piece.near:.1f}", length, f"{piece.pole * 1e6:.0f}", f"{piece.field * 1e9:.0f}")
    terminal.output().print(table, soft_wrap=False)

# SPDX-License-Identifier: Apache-2.0
"""`mwd calibrate`: errors of a probe from a tumble and temperature run, and the file that corrects these errors."""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_sensors.core.settings import SettingsError, unknown_key
from mwd_surface.commands import terminal
from mwd_surface.commands.scenario import Seed
from mwd_surface.commands.shared_options import (
    FIELD_PANEL,
    PLACE,
    READING,
    GivenPlace,
    Reading,
    field_figures,
    given_names,
    input_settings,
    place_changes,
    takes,
)

if TYPE_CHECKING:
    from mwd_sensors.calibration.triad_calibration import Calibration
    from mwd_sensors.simulator.scenario import Scenario
    from mwd_surface.runs.calibration_run import CalibrationReadings


@takes(PLACE, READING)
def calibrate(
    run: Annotated[
        str, typer.Argument(metavar="BAG|SCENARIO", help="Recording of the tumble run, or a scenario to simulate.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML file for the calibration.")],
    unit: Annotated[
        str,
        typer.Option(
            help="Unit to calibrate: ahrs (conventional IMU and magnetometer) or precision (high-precision gyros and "
            "accelerometers)."
        ),
    ] = "ahrs",
    grade: Annotated[
        str | None, typer.Option(help="Instrument grade of the simulated unit; by default the grade in the scenario.")
    ] = None,
    seed: Seed = None,
    gravity: Annotated[
        float | None, typer.Option(help="Gravity at the place of the run, m/s².", rich_help_panel=FIELD_PANEL)
    ] = None,
    *,
    place: GivenPlace,
    reading: Reading,
) -> None:
    """
    Estimate bias, scale and misalignment of a probe's sensors, and their change with temperature, from a tumble run.

    In a tumble run the probe rests in many attitudes and is turned between them while its temperature changes; no
    calibration stand is needed.
    Gravity and field come from the scenario, from --lat and --lon, or from --field and --gravity.

    \b
    Examples:
      mwd calibrate tumble -o probe_12.yaml
      mwd calibrate bags/tumble_12 -o probe_12.yaml --lat 60.4 --lon 5.3
      mwd calibrate tumble -o precision.yaml --unit precision --grade tactical_north
    """
    from mwd_surface.runs import calibration_run

    data, scenario, day_ns = _data(run, unit, grade, seed, reading)
    strength, found_field, source = _place(place, day_ns)
    if strength is None and scenario is not None:
        strength, known = calibration_run.field_of(scenario)
        found_field, source = found_field or known, source or "its scenario"
    strength = gravity if gravity is not None else strength
    if strength is None:
        raise ValueError(f"{run}: gravity is unknown; give the place with --lat and --lon, or --gravity (and --field)")
    if found_field is None and data.mag is not None and unit == "ahrs":
        terminal.warn("the field is unknown: magnetometers are not calibrated (give --lat and --lon, or --field)")
    found = calibration_run.calibrated(data, strength, found_field)
    about: dict[str, Any] = {"from": data.source, "unit": unit, "gravity_mps2": strength, "place": source or "options"}
    if found_field is not None:
        about |= {"field_t": found_field[0], "dip_rad": found_field[1]}
    about["temperature_c"] = [round(float(limit), 1) for limit in (data.celsius.min(), data.celsius.max())]
    calibration_run.write(output, found, about)
    _show(data.source, unit, found)
    terminal.tell(f"written: {output}")


def _data(
    run: str, unit: str, grade: str | None, seed: int | None, reading: Reading
) -> tuple[CalibrationReadings, Scenario | None, int]:
    """
    Return the samples of a recording or a simulation, its scenario (None if unknown), and its start.

    The start is in ns since the epoch, 0 for a simulation. Raises SettingsError for an unknown unit, and ValueError for
    options that have no use with a recording or with a scenario.
    """
    from mwd_surface.bags.bag_files import storage_of
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.runs import calibration_run

    if unit not in calibration_run.UNITS:
        raise SettingsError(unknown_key(unit, calibration_run.UNITS, "--unit"))
    path = Path(run)
    if path.is_dir() or storage_of(path):
        if grade is not None or seed is not None:
            raise ValueError("--grade, --seed: only for scenarios, not for a recording")
        with Bag(path) as bag, terminal.waiting(f"reading {path.name}"):
            data, remarks = calibration_run.recorded(bag, unit, input_settings(reading))
            found = data, calibration_run.scenario_of(bag), bag.start_ns
        terminal.warn(*remarks)
        return found
    if names := given_names(reading):
        raise ValueError(f"{names[0]} is an option for recordings; {run} is a scenario")
    scenario = _scenario(run, unit, grade, seed)
    with terminal.waiting(f"simulating {scenario.name}"):
        return calibration_run.simulated(scenario, unit), scenario, 0


def _show(source: str, unit: str, found: Calibration) -> None:
    """Print the residuals of a calibration and the sensor errors that it found."""
    from mwd_surface.commands.spoken_console import SpokenTable
    from mwd_surface.runs import calibration_run

    console = terminal.output()
    table = SpokenTable(title=f"{source}, {unit}: residuals, root mean square")
    for name in ("triad", "rests or turns", "before", "after", "unit"):
        table.add_column(name, justify="left" if name in ("triad", "unit") else "right")
    for name, count, before, after, words in calibration_run.residuals(found):
        table.add_row(name, str(count), f"{before:.4g}", f"{after:.4g}", words)
    console.print(table, soft_wrap=False)
    axes = SpokenTable(title=f"errors at {found.accelerometer.reference_c:.1f} °C, ± 1 sigma")
    for name in ("triad", "figure", "x", "y", "z"):
        axes.add_column(name, justify="left" if name in ("triad", "figure") else "right")
    for name, words, values in calibration_run.errors(found):
        axes.add_row(name, words, *values)
    console.print(axes, soft_wrap=False)


def _scenario(name: str, unit: str, grade: str | None, seed: int | None) -> Any:
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import SimulatedUnit, read

    scenario = read(scenario_files.find(name), {} if seed is None else {"seed": seed})
    if grade is None:
        return scenario
    known = getattr(scenario, unit) or SimulatedUnit()
    # Build the unit again, which checks that the grade exists and fits the unit.
    changed: dict[str, Any] = {unit: dataclasses.replace(known, grade=grade)}
    return dataclasses.replace(scenario, **changed)


def _place(given: GivenPlace, day_ns: int) -> tuple[float | None, tuple[float, float] | None, str]:
    """
    Return gravity, m/s^2, the field (total, T, and dip, rad), and their source as text.

    Gravity or field is None if no option gives it; if both are None, the source is "".

    day_ns : time of the data, ns since the epoch, for the field model.

    Raises ValueError if options contradict each other or the date is not valid.
    """
    from mwd_sensors.core import earth

    place_changes(*given)  # refuses options that contradict each other
    lat, lon, date, field = given
    if field is not None:
        total, dip, _ = field_figures(field)
        return None, (total * 1e-9, math.radians(dip)), "--field"
    if lat is None or lon is None:
        return None, None, ""
    day = datetime.datetime.fromtimestamp(day_ns * 1e-9, tz=datetime.UTC).date()
    if date is not None:
        try:
            day = datetime.date.fromisoformat(date)
        except ValueError as error:
            raise ValueError(f"--date {date}: write it as YYYY-MM-DD") from error
    reference = earth.reference_field(math.radians(lat), math.radians(lon), 0.0, day)
    return reference.gravity, (reference.total, reference.dip), reference.source

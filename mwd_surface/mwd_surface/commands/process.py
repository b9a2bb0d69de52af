# SPDX-License-Identifier: Apache-2.0
"""`mwd process`: attitude, surveys and effective settings from a recording."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    FIELD_PANEL,
    INPUT_PANEL,
    PLACE,
    READING,
    Changes,
    Config,
    GivenPlace,
    Mount,
    Precision,
    Reading,
    Recording,
    Tool,
    given_settings,
    input_settings,
    mount_changes,
    placed_settings,
    recording_changes,
    takes,
    tool_changes,
)

if TYPE_CHECKING:
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.processing.run_output import OutputSettings
    from mwd_surface.processing.run_summary import Summary
    from mwd_surface.surveys.recorded_settings import Recorded


@takes(PLACE, READING)
def process(
    bag: Recording,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    method: Annotated[
        str | None,
        typer.Option(
            help="Method that estimates gravity (see `mwd doctor`); by default the method in the recording, else "
            "bounded."
        ),
    ] = None,
    north: Annotated[
        str | None,
        typer.Option(
            help="North of the azimuths: magnetic, true, grid, or best (grid if known, else true, else magnetic).",
            rich_help_panel=FIELD_PANEL,
        ),
    ] = None,
    tool: Tool = None,
    precision: Precision = None,
    config: Config = None,
    changes: Changes = None,
    sensor_to_bit_m: Annotated[
        float | None,
        typer.Option(
            "--sensor-to-bit",
            help="Distance of the sonde behind the bit, m; by default the distance in the recording, else 0.",
            rich_help_panel=INPUT_PANEL,
        ),
    ] = None,
    depths: Annotated[
        str | None,
        typer.Option(
            help="CSV table of depths, with columns time and bit_depth_m, or survey and md_m; by default the rig's "
            "depths.",
            metavar="FILE",
            rich_help_panel=INPUT_PANEL,
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="YAML file from `mwd calibrate`, to correct IMU and magnetometer.", rich_help_panel=INPUT_PANEL
        ),
    ] = None,
    mount: Mount = None,
    accelerometer: Annotated[
        str | None,
        typer.Option(
            help="Direction in which the accelerometer reads at rest: up (specific force) or down (gravity).",
            rich_help_panel=INPUT_PANEL,
        ),
    ] = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format", "-f", help="Format of the attitude: csv (default), parquet or mcap.", rich_help_panel="Output"
        ),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(
            "--rate",
            help="Largest number of attitude rows per second, Hz; by default one row for every IMU message.",
            metavar="HZ",
            rich_help_panel="Output",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Also use later samples to estimate gravity (method bounded only).",
            rich_help_panel="Output",
        ),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the results of an earlier run in the folder.")
    ] = False,
    *,
    place: GivenPlace,
    reading: Reading,
) -> None:
    """
    Compute attitude and surveys from a recording.

    Writes DIR/attitude.csv (one line per IMU sample), DIR/surveys.csv, DIR/surveys.json (for `mwd export DIR` and `mwd
    report DIR`), DIR/faults.csv (sensor faults and their times) and DIR/config.yaml (the settings used). The results
    equal those of the live graph. A recording of the surface node contains the settings with which it was made (place,
    tool, well, sensor to bit); options change single settings. --format mcap writes a copy of the recording with the
    estimates, DIR/merged.

    \b
    Examples:
      mwd process bags/run_7 -o out
      mwd process bags/run_7 -o out --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd process bags/run_7 -o out --field 50360,71.63,-2.2 --method s3
      mwd process bags/run_7 -o out --format parquet --rate 10
      mwd process bags/run_7 -o out --format mcap --smooth
      mwd process bags/run_7 -o out --mount z-down
      mwd process bags/other_names -o out --imu-topic /tool/imu --gyro-topic /tool/fog
    """
    from mwd_surface.processing.run_output import OutputSettings

    if not force:
        _refuse_taken(output)
    placed = recording_changes(*place)
    sensors = tool_changes(tool, precision) | mount_changes(mount, accelerometer)
    _run(
        bag,
        output,
        lambda recorded: placed_settings(config, changes, placed, method, north, sensors, recorded),
        input_settings(reading, sensor_to_bit_m=sensor_to_bit_m, depths=depths),
        given_settings(OutputSettings, {"format": form, "rate_hz": rate_hz, "smooth": smooth}),
        calibration,
    )


def _refuse_taken(output: Path) -> None:
    """Raise ValueError if a folder already has results of a run."""
    from mwd_surface.processing.run_output import results_in

    if found := results_in(output):
        names = ", ".join(path.name for path in found)
        raise ValueError(f"{output} contains the results of a run ({names}): choose another folder, or use --force")


def _run(
    path: Path,
    output: Path,
    settings: Callable[[EstimatorSettings | None], EstimatorSettings],
    given: InputSettings,
    wanted: OutputSettings,
    calibration: Path | None,
) -> None:
    """
    Process a recording and show the summary.

    settings: function that returns the settings to use, from the settings in the recording or None.
    """
    from mwd_sensors.calibration.compensation import Compensation
    from mwd_sensors.core.compiled import when_compiling
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.processing import process as batch
    from mwd_surface.surveys.recorded_settings import recorded_settings, with_a_model

    compensation = None
    if calibration is not None:
        # Import only if needed, because this module loads scipy's optimisation.
        from mwd_surface.runs import calibration_run

        compensation = Compensation(calibration_run.read(calibration))
    began = time.monotonic()
    with (
        Bag(path) as opened,
        terminal.progress(f"processing {path.name}") as progress,
        when_compiling(
            lambda: terminal.remark("compiling the filters; this can take minutes, and is needed only once")
        ),
    ):
        recorded = recorded_settings(opened)
        estimator, remark = with_a_model(settings(recorded.estimator), opened.start_ns)
        if calibration is not None:
            estimator = calibration_run.within_calibration(estimator, calibration)
        summary = batch.process(opened, output, estimator, given, progress, compensation, wanted, recorded)
    if remark:
        summary.warnings.insert(0, remark)
    _show(summary, estimator, recorded, output, time.monotonic() - began)


def _show(summary: Summary, estimator: EstimatorSettings, recorded: Recorded, folder: Path, elapsed: float) -> None:
    from mwd_estimation.core.fault_messages import describe
    from mwd_estimation.core.sensor_fault import FaultCode
    from mwd_surface.commands.survey_table import list_warnings, revision_sentences, show_surveys

    terminal.warn(*summary.warnings)
    place = estimator.place
    if summary.reference == "none" and (place.lat_deg is None) != (place.lon_deg is None):
        missing = "--lat" if place.lat_deg is None else "--lon"
        terminal.warn(
            f"{missing} is not given, so there is no reference field: the azimuths of the magnetometer are not"
            " corrected and are from magnetic north; give latitude and longitude"
        )
    for fault in summary.faults:
        if fault.code == FaultCode.NEVER_CAME and not summary.mag_used:
            continue  # a warning or the line "magnetometer" reports this
        # Print the time relative to the first sample, like --start and --end.
        moment = max((fault.cleared_ns or fault.since_ns) - summary.start_ns, 0)
        text = describe(fault)
        terminal.warn(f"{moment * 1e-9:.1f} s: {text.message}" + (f"; {text.remedy}" if text.remedy else ""))
    rate = (summary.rows - 1) / summary.seconds if summary.seconds > 0.0 else 0.0
    other = "; the input differs from the live input" if summary.other_input else ""
    lines = [
        ("IMU", f"{summary.topics.imu}: {summary.rows} samples, {summary.seconds:.1f} s, {rate:.1f} Hz"),
        ("magnetometer", summary.topics.mag or "none: no azimuth"),
        ("method", estimator.gravity.method),
        ("reference", summary.reference),
        ("azimuth", f"from {summary.north} north"),
        ("inclination", _range(math.degrees(summary.lowest), math.degrees(summary.highest))),
        ("not used", f"{summary.rejected} samples refused, {summary.gaps} gaps{other}"),
        ("unknown", f"{summary.without_gravity} rows without gravity, {summary.without_azimuth} without azimuth"),
        ("speed", f"{summary.rows / max(elapsed, 1e-9):,.0f} samples/s ({elapsed:.1f} s)"),
    ]
    lines[2:2] = _settings_lines(estimator, recorded, summary)
    terminal.facts(lines)
    if summary.surveys:
        records = sorted(summary.listed.records, key=lambda one: one.survey.sequence)
        show_surveys(records, summary.listed.well.angles)
        terminal.tell(*revision_sentences(records))
        # Warn of each survey without a depth only if there is a source of depths. Without any source, the line "depths"
        # above says so once.
        if summary.topics.rig is not None or summary.depth_table:
            terminal.warn(*list_warnings(summary.listed.records))
    else:
        terminal.facts([("surveys", f"none: {summary.no_survey}")])
    terminal.facts([("written", ", ".join(str(folder / name) for name in summary.files))])


def _settings_lines(estimator: EstimatorSettings, recorded: Recorded, summary: Summary) -> list[tuple[str, str]]:
    """Return lines about the sources of settings and depths: name and value of each line."""
    from mwd_sensors.core import settings

    lines = []
    if recorded.estimator is not None:
        before, now = settings.flat(recorded.estimator), settings.flat(estimator)
        other = [name for name, (value, _) in now.items() if before.get(name, (None, None))[0] != value]
        changed = f"; changed: {', '.join(other[:6])}" + (" ..." if len(other) > 6 else "") if other else ""
        lines.append(("settings", f"{recorded.source}{changed}"))
    place, gyro = estimator.place, estimator.tool.precision.gyro
    if place.model:
        day = place.date or "the day of the recording"
        where = f"{place.lat_deg:.4f}, {place.lon_deg:.4f} deg, {place.height_m:.0f} m, {day}"
        lines.append(("place", where))
    behind = summary.listed.well.sensor_to_bit if summary.surveys else None
    words = [f"sensor {behind:.2f} m behind the bit"] if behind is not None else []
    words += [f"tool code {estimator.survey.tool_code}"] if estimator.survey.tool_code else []
    if summary.topics.precision is not None:
        words.append(f"precision gyro of {gyro.bias_deg_h:g} deg/h")
    if words:
        lines.append(("tool", ", ".join(words)))
    if summary.surveys:
        lines.append(("depths", summary.depths))
    return lines + ([("live list", summary.live)] if summary.live else [])


def _range(low: float, high: float) -> str:
    return f"{low:.2f} to {high:.2f} deg" if low == low else "unknown"

"""`mwd process`: a recording to attitude, surveys and the configuration in force."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands.reference_options import FIELD_PANEL, Changes, Config, Date, Field, Lat, Lon, Precision, Tool

if TYPE_CHECKING:
    from mwd_estimation.pipeline import EstimatorSettings
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.runs.run_summary import Summary

_INPUT, _OUTPUT = "Input", "Output"


def process(
    bag: Annotated[Path, typer.Argument(help="Folder of a rosbag2 recording, or its .mcap or .db3 file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; made if need be.")],
    method: Annotated[
        str | None, typer.Option("--method", help="Gravity extraction: s3, mahony, raw ... (`mwd doctor` lists them).")
    ] = None,
    lat: Lat = None,
    lon: Lon = None,
    date: Date = None,
    field: Field = None,
    north: Annotated[
        str | None,
        typer.Option("--north", help="North of the azimuth: magnetic, true or grid.", rich_help_panel=FIELD_PANEL),
    ] = None,
    tool: Tool = None,
    precision: Precision = None,
    config: Config = None,
    changes: Changes = None,
    imu_topic: Annotated[str | None, typer.Option(help="Topic of the IMU.", rich_help_panel=_INPUT)] = None,
    mag_topic: Annotated[str | None, typer.Option(help="Topic of the magnetometer.", rich_help_panel=_INPUT)] = None,
    gyro_topic: Annotated[str | None, typer.Option(help="Topic of the precision unit.", rich_help_panel=_INPUT)] = None,
    temperature_topic: Annotated[
        str | None, typer.Option(help="Topic of the IMU's temperature.", rich_help_panel=_INPUT)
    ] = None,
    rig_topic: Annotated[
        str | None, typer.Option(help="Topic of the rig state, for depths.", rich_help_panel=_INPUT)
    ] = None,
    accel_unit: Annotated[str | None, typer.Option(help="m/s2, g or mg.", rich_help_panel=_INPUT)] = None,
    gyro_unit: Annotated[str | None, typer.Option(help="rad/s or deg/s.", rich_help_panel=_INPUT)] = None,
    mag_unit: Annotated[str | None, typer.Option(help="T, mT, uT, nT, G or mG.", rich_help_panel=_INPUT)] = None,
    start: Annotated[
        float | None, typer.Option(help="Begin so many seconds after the first message.", rich_help_panel=_INPUT)
    ] = None,
    end: Annotated[
        float | None, typer.Option(help="End so many seconds after the first message.", rich_help_panel=_INPUT)
    ] = None,
    sensor_to_bit: Annotated[
        float | None, typer.Option(help="Sonde behind the bit, m, for depths.", rich_help_panel=_INPUT)
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(help="Calibration of the IMU and magnetometer, from `mwd calibrate`.", rich_help_panel=_INPUT),
    ] = None,
    same_axes: Annotated[
        bool,
        typer.Option("--same-axes", help="IMU and magnetometer share axes under two names.", rich_help_panel=_INPUT),
    ] = False,
    form: Annotated[
        str | None,
        typer.Option("--format", "-f", help="Attitude as csv, parquet or mcap.", rich_help_panel=_OUTPUT),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="At most so many rows of attitude a second.", metavar="HZ", rich_help_panel=_OUTPUT),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth", help="Gravity from what came after each sample too: never live.", rich_help_panel=_OUTPUT
        ),
    ] = False,
    partial: Annotated[
        bool, typer.Option("--partial", help="Use what can be read of a damaged bag.", rich_help_panel=_INPUT)
    ] = False,
) -> None:
    """
    Work out attitude and surveys of a recording.

    Writes DIR/attitude.csv (one line per IMU message), DIR/surveys.csv, DIR/surveys.json (for `mwd export DIR` and
    `mwd report DIR`), DIR/faults.csv (what was found wrong with a sensor, and when) and DIR/config.yaml (the settings
    in force). Needs no middleware; the results equal those of the live graph. --format parquet writes
    DIR/attitude.parquet, --format mcap a copy of the recording with the estimates beside its messages, DIR/merged,
    for Foxglove.

    \b
    Examples:
      mwd process bags/run_7 -o out
      mwd process bags/run_7 -o out --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd process bags/run_7 -o out --field 50360,71.63,-2.2 --method s3
      mwd process bags/run_7 -o out --field 50360,71.63,-2.2 --lat 58.44
      mwd process bags/run_7 -o out --format parquet --rate 10
      mwd process bags/run_7 -o out --format mcap --smooth
      mwd process bags/two_wells -o out --imu-topic /well_2/imu/data_raw
      mwd process bags/other_names -o out --imu-topic /tool/imu --gyro-topic /tool/fog
    """
    from mwd_sensors.calibration.compensation import Compensation
    from mwd_sensors.core import settings
    from mwd_sensors.core.compiled import when_compiling
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.commands import terminal
    from mwd_surface.commands.reference_options import placed_settings, recording_changes, tool_changes
    from mwd_surface.runs import calibration_run
    from mwd_surface.runs import process as batch
    from mwd_surface.runs.bag_input import InputSettings
    from mwd_surface.runs.run_output import OutputSettings

    place, sensors = recording_changes(lat, lon, date, field), tool_changes(tool, precision)
    estimator = placed_settings(config, changes, place, method, north, sensors)
    asked = {
        "imu_topic": imu_topic,
        "mag_topic": mag_topic,
        "gyro_topic": gyro_topic,
        "temperature_topic": temperature_topic,
        "rig_topic": rig_topic,
        "accel_unit": accel_unit,
        "gyro_unit": gyro_unit,
        "mag_unit": mag_unit,
        "start_s": start,
        "end_s": end,
        "sensor_to_bit_m": sensor_to_bit,
        "same_axes": same_axes,
        "partial": partial,
    }
    if start is not None and end is not None and end <= start:
        raise ValueError(f"--end {end:g}: not after --start {start:g}")
    given = settings.from_mapping(InputSettings, {k: v for k, v in asked.items() if v is not None})
    asked = {"format": form, "rate_hz": rate, "smooth": smooth}
    wanted = settings.from_mapping(OutputSettings, {k: v for k, v in asked.items() if v is not None})
    compensation = Compensation(calibration_run.read(calibration)) if calibration is not None else None
    began = time.monotonic()
    with (
        Bag(bag) as opened,
        terminal.progress(f"processing {bag.name}") as progress,
        when_compiling(lambda: terminal.remark("compiling filters that are new here, which may take minutes, once")),
    ):
        estimator, remark = _with_a_model(opened, estimator)
        summary = batch.process(opened, output, estimator, given, progress, compensation, wanted)
    if remark:
        summary.warnings.insert(0, remark)
    _show(summary, estimator, output, time.monotonic() - began)


def _with_a_model(bag: Bag, estimator: EstimatorSettings) -> tuple[EstimatorSettings, str]:
    """An older recording's field comes from the IGRF where the newer model does not reach back to its day."""
    from mwd_estimation.pipeline import reference_of
    from mwd_sensors.core import settings

    try:
        reference_of(estimator.place, bag.start_ns)
    except ValueError as error:
        older = settings.changed(estimator, {"place.model": "igrf"})
        if older == estimator:
            raise
        try:
            reference_of(older.place, bag.start_ns)
        except ValueError:
            raise error from None
        return older, f"{error}: the field is taken from the IGRF"
    return estimator, ""


def _show(summary: Summary, estimator: EstimatorSettings, folder: Path, elapsed: float) -> None:
    import math

    from mwd_estimation.health.fault_messages import describe
    from mwd_estimation.health.sensor_fault import FaultCode
    from mwd_surface.commands import terminal
    from mwd_surface.commands.survey_table import show_surveys

    console = terminal.output()
    for warning in summary.warnings:
        terminal.warn(warning)
    for fault in summary.faults:
        if fault.code == FaultCode.NEVER_CAME and summary.topics.mag is None:
            continue  # the recording has none, as the table below says
        # Relative to the first sample, as --start and --end count.
        moment = max((fault.cleared_ns or fault.since_ns) - summary.start_ns, 0)
        text = describe(fault)
        terminal.warn(f"{moment * 1e-9:.1f} s: {text.message}" + (f"; {text.remedy}" if text.remedy else ""))
    rate = (summary.rows - 1) / summary.seconds if summary.seconds > 0.0 else 0.0
    lines = [
        ("IMU", f"{summary.topics.imu}: {summary.rows} samples, {summary.seconds:.1f} s, {rate:.1f} Hz"),
        ("magnetometer", summary.topics.mag or "none: no azimuth"),
        ("method", estimator.gravity.method),
        ("reference", summary.reference),
        ("azimuth", f"from {summary.north} north"),
        ("inclination", _range(math.degrees(summary.lowest), math.degrees(summary.highest))),
        ("not used", f"{summary.rejected} samples refused, {summary.gaps} gaps"),
        ("unknown", f"{summary.without_gravity} rows without gravity, {summary.without_azimuth} without azimuth"),
        ("speed", f"{summary.rows / max(elapsed, 1e-9):,.0f} samples/s ({elapsed:.1f} s)"),
    ]
    for name, value in lines:
        console.print(f"{name:>13}  {value}", markup=False)
    if summary.surveys:
        show_surveys(console, [(survey.station, depth) for survey, depth in summary.surveys])
        # Where the hole comes from to the first of them a recording does not say.
        for record in summary.listed.records[1:] if summary.topics.rig is not None else ():
            for flag in record.flags:
                terminal.warn(f"survey {record.survey.sequence}: {flag}")
    else:
        console.print(f"{'surveys':>13}  none: the tool never kept still for long enough", markup=False)
    console.print(f"{'written':>13}  {', '.join(str(folder / name) for name in summary.files)}", markup=False)


def _range(low: float, high: float) -> str:
    return f"{low:.2f} to {high:.2f} deg" if low == low else "unknown"

# SPDX-License-Identifier: Apache-2.0
"""`mwd tool`: write and check the configuration of a tool, simulate a recording of such a tool, locate its coil."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal

if TYPE_CHECKING:
    from mwd_sensors.core.arrays import Array
    from mwd_sensors.telemetry.sequences import SequenceItem
    from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
    from mwd_sensors.telemetry.words import Word

tool = typer.Typer(
    help="Configuration of a tool (tool.yaml): check it, simulate it, locate its coil.", no_args_is_help=True
)
Configuration = Annotated[Path, typer.Argument(metavar="TOOL.YAML", help="Tool configuration.")]


@tool.command()
def new(
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write; an existing file is not overwritten.")],
    code: Annotated[str, typer.Option(help="Telemetry code: mary (pulses), psk (carrier) or serial (wire).")] = "mary",
) -> None:
    """
    Write an example of a tool configuration, with usual sequences: pulses of 0.8 s, or another telemetry code.

    \b
    Examples:
      mwd tool new -o tool.yaml
      mwd tool new -o siren.yaml --code psk
    """
    from mwd_sensors.telemetry.tool_configuration import starting, text

    configuration = starting(code)
    with output.open("x", encoding="utf-8") as file:
        file.write(text(configuration))
    terminal.tell(f"written: {output}")


@tool.command()
def check(
    configuration: Configuration,
    channel: Annotated[
        Path | None,
        typer.Option(
            help="Pressure (CSV, WAV or recording) with the signal of such a tool, to find the shortest pulse width "
            "that can be received."
        ),
    ] = None,
    on: Annotated[
        Path | None,
        typer.Option(
            help="Pressure (CSV, WAV or recording) with the tool's signal, to find its pulse width, sync and parity."
        ),
    ] = None,
    columns: Annotated[str, typer.Option(help="Columns of a table with pressure, as in `mwd decode`.")] = "",
) -> None:
    """
    Show the properties of a tool configuration: time on air, survey time, toolface rate, steps of the words.

    \b
    Examples:
      mwd tool check tool.yaml
      mwd tool check tool.yaml --channel pressure.csv
      mwd tool check tool.yaml --on pressure.csv
    """
    from mwd_sensors.telemetry import tool_configuration

    read = tool_configuration.read(configuration)
    bits = sum(item.length for item in read.surveys[0])
    rate = bits / read.seconds(read.surveys[0])
    terminal.tell(f"{read.code}, {_signal_line(read)}, {rate:.2f} bit/s of words")
    if read.head_s:
        terminal.tell(f"sync and header {read.head_s:.1f} s")
    terminal.tell(f"sent {read.transmit_delay_s:g} s after flow-on")
    for number, items in enumerate(read.surveys):
        on_air = read.seconds(items)
        total = read.transmit_delay_s + read.head_s + on_air
        terminal.tell(f"survey {number}: {on_air:.1f} s on air, complete {total:.0f} s after flow-on")
    for number, items in enumerate(read.toolfaces):
        terminal.tell(f"toolface {number}: {_toolface_line(read, items)}")
    pulses = read.code == "mary"
    seen = dict.fromkeys(item for items in (*read.surveys, *read.toolfaces) for item in items)
    for item in seen:
        unprotected = "" if item.parity or not pulses else ", no parity: errors cannot be detected"
        terminal.tell(f"  {_word_line(item, read.table[item.name])}{unprotected}")
    if not read.toolfaces:
        terminal.tell("no toolface sequence: silent after the survey")
    lines = [] if channel is None else _channel_lines(read, channel, columns)
    lines += [] if on is None else _lines_on(read, on, columns)
    terminal.tell(*lines)


def _word_line(item: SequenceItem, word: Word) -> str:
    """Return the range and resolution of a word, as text."""
    span = f"{item.name}:{item.bits} {word.low:g} to {word.high:g} {word.unit}"
    if word.logarithmic:
        return f"{span}, each step {word.value(1, item.bits) / word.value(0, item.bits):.3g} times the previous one"
    return f"{span}, step {word.step(item.bits):.3g}, sigma {word.sigma_of(item.bits):.3g}"


def _lines_on(read: ToolConfiguration, file: Path, columns: str) -> list[str]:
    """
    Return lines on the pulse width, sync and parity in a pressure file, and on whether they are as configured.

    Raises ValueError if the tool sends no pulses, or as `pressure_files.read` does.
    """
    from mwd_surface.receiver import pressure_files
    from mwd_surface.receiver.link import other_width
    from mwd_surface.receiver.pulse.sync_search import USUAL_SYNCS

    if read.code != "mary":
        raise ValueError(f"--on: {read.code} sends no pulses; omit it")
    pressure = pressure_files.read(file, columns=columns)
    syncs = list(dict.fromkeys((read.sync, *USUAL_SYNCS)))
    with terminal.progress(f"searching {file.name}") as progress:
        found = other_width.sent_tool(read, pressure.time_s, pressure.pressure_pa, {}, syncs, ("even", "odd"), progress)
    if found is None:
        text = (
            f"{file.name}: no words of these sequences with any usual pulse width, sync and parity; check the sequences"
            " and header_bits, and with mwd doctor the pressure"
        )
        return [text]
    return [
        f"{file.name} has words of this tool with",
        f"  pulse_width_s: {found.pulse_width_s:.3g}",
        f"  sync: edges_tu {', '.join(map(str, found.sync.edges_tu))}, length_tu {found.sync.length_tu}",
        f"  parity: {found.parity}",
        "as configured" if _alike(read, found) else "change the configuration, which has other values, to these values",
    ]


def _alike(one: ToolConfiguration, other: ToolConfiguration) -> bool:
    """Return whether two configurations have the same sync and parity, and pulse widths that agree within 1 %."""
    close = abs(one.pulse_width_s / other.pulse_width_s - 1.0) < 0.01
    return close and (one.sync, one.parity) == (other.sync, other.parity)


def _channel_lines(read: ToolConfiguration, file: Path, columns: str) -> list[str]:
    """
    Return lines on the pulse widths that can be received with the noise and the pulses of a pressure file.

    Raises ValueError if the tool sends no pulses, or if no word of the tool is in the file.
    """
    import numpy as np

    from mwd_surface.receiver import pressure_files
    from mwd_surface.receiver.link.link import NEEDED_DB
    from mwd_surface.receiver.pulse import pulse_widths
    from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver

    if read.code != "mary":
        raise ValueError(f"--channel: {read.code} sends no pulses; omit it")
    pressure = pressure_files.read(file, columns=columns)
    receiver = PulseReceiver(read)
    got = receiver.push(pressure.time_s, pressure.pressure_pa)
    got.add(receiver.finish())
    if receiver.channel is None:
        raise ValueError(f"--channel {file}: {receiver.why_nothing()}")
    ebn0_db = float(np.mean([frame.ebn0_db for frame in got.frames]))
    found = pulse_widths.margins(receiver.channel, read.pulse_width_s, ebn0_db)
    enough = [one.width_s for one in found if one.ebn0_db >= NEEDED_DB]
    verdict = (
        f"shortest pulse width with 19 of 20 words right: {min(enough):g} s"
        if enough
        else f"no pulse width up to {found[0].width_s:g} s has 19 of 20 words right"
    )
    return [
        f"channel of {file.name}, energy of a bit over noise density (19 of 20 words need {NEEDED_DB:g} dB):",
        *(f"  pulses of {one.width_s:g} s: {one.ebn0_db:.1f} dB" for one in found),
        verdict,
    ]


def _signal_line(read: ToolConfiguration) -> str:
    if read.code == "psk":
        one = read.carrier
        return (
            f"{one.modulation.upper()} on {one.frequency_hz:g} Hz in the {one.medium}, {one.symbol_rate_hz:g} symbols a"
            f" second, blocks of {one.block_bits} bits in {one.block_s:.1f} s"
        )
    if read.code == "serial":
        return f"{read.serial.format} frames at {read.serial.baud} baud"
    return f"pulse width {read.pulse_width_s:g} s"


def _toolface_line(read: ToolConfiguration, items: tuple[SequenceItem, ...]) -> str:
    on_air = read.seconds(items)
    toolfaces = sum(item.name.upper().endswith("TFA") for item in items)
    each = f", a toolface every {on_air / toolfaces:.1f} s on average" if toolfaces else ", without a toolface"
    return f"{on_air:.1f} s on air{each}"


@tool.command()
def simulate(
    configuration: Configuration,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the recording and sent.csv.")],
    depth: Annotated[float, typer.Option(help="Measured depth of the bit, m.", min=200.0, max=12000.0)] = 3000.0,
    minutes: Annotated[
        float, typer.Option(help="Duration, min; the flow begins after 20 s.", min=2.0, max=600.0)
    ] = 10.0,
    seed: Annotated[int, typer.Option(help="Seed of values and noise.")] = 1,
    clock: Annotated[float, typer.Option(help="Error of the tool's clock, %.", min=-1.0, max=1.0)] = 0.0,
    resistivity: Annotated[
        float, typer.Option(help="Resistivity of the ground for an EM tool or a coil, ohm m.", min=0.1, max=1e4)
    ] = 20.0,
    bit_errors: Annotated[float, typer.Option(help="Share of wrong bits on a serial line.", min=0.0, max=0.1)] = 1e-4,
    distance: Annotated[
        float, typer.Option(help="Distance from a level coil to the receiver ahead of it, m.", min=0.5, max=500.0)
    ] = 20.0,
) -> None:
    """
    Simulate what the surface would record of this tool; sent.csv contains the words sent.

    For a tool with pulses or a carrier in the mud, the other files are pressure.csv, with two pumps and noise, and
    strokes.csv; for a carrier in the earth voltage.csv, with rig noise; for a coil voltage.csv, with noise of the
    mains; for a serial line bytes.bin.

    \b
    Example:
      mwd tool simulate tool.yaml -o well --depth 4000
      mwd decode well/pressure.csv --tool tool.yaml -o decoded
    """
    from mwd_sensors.simulator import carrier_tool, pulse_tool, serial_channel
    from mwd_sensors.simulator.coil_channel import CoilChannel, coil_run
    from mwd_sensors.simulator.earth_channel import EarthChannel, Ground, earth_run
    from mwd_sensors.simulator.mud_channel import MudChannel, WellGeometry
    from mwd_sensors.telemetry import tool_configuration

    read = tool_configuration.read(configuration)
    flow_on, seconds, error = 20.0, 60.0 * minutes, 0.01 * clock
    flows = ((flow_on, seconds),)
    output.mkdir(parents=True, exist_ok=True)
    if read.medium == "serial":
        data, words = serial_channel.transmit(read, seconds, seed)
        line = serial_channel.SerialChannel(bit_errors=bit_errors)
        data = serial_channel.SerialStream(line, read.serial.baud, seed).carry(0.0, data)
        (output / "bytes.bin").write_bytes(data)
        name = "bytes.bin"
    elif read.medium == "earth":
        sent = carrier_tool.transmit(read, flows, seed, error)
        ground = Ground(bottom_m=(12000.0,), resistivity=(resistivity,), depth_m=depth)
        _write_samples(output / "voltage.csv", "voltage_v", *earth_run(EarthChannel(ground), sent, seconds, seed))
        words, name = sent.words, "voltage.csv"
    elif read.medium == "coil":
        sent = carrier_tool.transmit(read, flows, seed, error)
        receiver = CoilChannel(position_m=(distance, 0.0, 0.0), axis=(1.0, 0.0, 0.0), resistivity=resistivity)
        _write_samples(output / "voltage.csv", "voltage_v", *coil_run(receiver, read.coil, sent, seconds, seed))
        words, name = sent.words, "voltage.csv"
    else:
        well, off = WellGeometry(depth_m=depth), ((-100.0, flow_on),)
        if read.code == "psk":
            siren = carrier_tool.transmit(read, flows, seed, error)
            run = carrier_tool.siren_run(MudChannel(well=well, flow_off_s=off), siren, seconds, seed)
        else:
            pulses = pulse_tool.transmit(read, flows, seed, error)
            run = pulse_tool.link_run(MudChannel(well=well, flow_off_s=off), pulses, seconds, seed)
        _write_samples(output / "pressure.csv", "pressure_pa", run.time_s, run.pressure_pa)
        strokes = ((k + 1, f"{at:.4f}") for k, times in enumerate(run.strokes_s) for at in times)
        _write_rows(output / "strokes.csv", ("pump", "time_s"), strokes)
        words, name = run.sent.words, "pressure.csv, strokes.csv"
    _write_rows(
        output / "sent.csv",
        ("start_s", "end_s", "frame", "name", "raw", "value"),
        (
            (
                f"{word.start_s:.3f}",
                f"{word.end_s:.3f}",
                word.frame,
                word.name,
                word.raw,
                f"{read.table[word.name].value(word.raw, word.bits):.6g}",
            )
            for word in words
        ),
    )
    terminal.tell(f"written: {output}/{name}, sent.csv ({len(words)} words sent)")


@tool.command()
def locate(
    readings: Annotated[
        Path,
        typer.Argument(
            metavar="READINGS",
            help="CSV table with north_m, east_m, down_m, and strength_nt or b_north_nt, b_east_nt, b_down_nt.",
        ),
    ],
    configuration: Annotated[
        Path | None, typer.Option("--tool", help="Tool configuration with the coil.", metavar="TOOL.YAML")
    ] = None,
    words: Annotated[
        Path | None,
        typer.Option(help="words.csv of `mwd decode`: its last inclination is the pitch, its last toolface the roll."),
    ] = None,
    pitch: Annotated[
        float | None, typer.Option(help="Pitch of the sonde, deg, up positive, in place of --words.")
    ] = None,
    azimuth: Annotated[
        float | None, typer.Option(help="Rough azimuth of the bore, deg, from the north of the table.")
    ] = None,
    calibrate: Annotated[
        str | None,
        typer.Option(
            metavar="M,NT",
            help="Calibration: distance from the sonde, at its level and beside it, m, and field strength there, nT.",
        ),
    ] = None,
    noise: Annotated[float, typer.Option(help="Noise of a reading, 1 sigma, nT.", min=0.0)] = 0.01,
    share: Annotated[
        float, typer.Option(help="Error of gain and alignment, 1 sigma, as a share of the reading.", min=1e-4)
    ] = 0.02,
) -> None:
    """
    Locate the coil of a sonde below the surface from the strength of its field at some points.

    Prints the point above the sonde, and depth, pitch, azimuth and roll of the sonde with their sigmas. If the surface
    is level, it also prints the points behind and ahead of the sonde where the field is vertical. A receiver with three
    coils gives the three components of the field, whose common sign has no meaning; a receiver that gives only the
    strength needs more points.

    \b
    Examples:
      mwd tool locate readings.csv --tool tool.yaml --words decoded/words.csv --azimuth 42
      mwd tool locate readings.csv --pitch -4.5 --calibrate 3,18.5
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_sensors.telemetry.carrier import Coil
    from mwd_surface.receiver import sonde_locate, surface_readings

    if words is not None and pitch is not None:
        raise ValueError("--words and --pitch both give the pitch; omit one")
    coil = Coil() if configuration is None else tool_configuration.read(configuration).coil
    if configuration is None and calibrate is None:
        terminal.warn(f"no --tool and no --calibrate: the usual coil of {coil.moment_a_m2:g} A m^2 is assumed")
    sent = surface_readings.sent_attitude(words) if words is not None else surface_readings.SentAttitude()
    known = sonde_locate.SondeFacts(
        coil.moment_a_m2 if calibrate is None else surface_readings.calibrated(calibrate),
        pitch=sent.pitch if pitch is None else math.radians(pitch),
        azimuth=math.nan if azimuth is None else math.radians(azimuth),
    )
    errors = sonde_locate.ReadingErrors(1e-9 * noise, share)
    fix = sonde_locate.locate(surface_readings.read(readings), known, errors)
    terminal.tell(*surface_readings.lines(fix, sent))
    terminal.warn(*fix.doubts)


def _write_samples(path: Path, column: str, time_s: Array, value: Array) -> None:
    import numpy as np

    form = "%.3f" if column == "pressure_pa" else "%.9g"
    table = np.column_stack([time_s, value])
    np.savetxt(path, table, fmt=["%.4f", form], delimiter=",", header=f"time_s,{column}", comments="")


def _write_rows(path: Path, header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> None:
    import csv

    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)

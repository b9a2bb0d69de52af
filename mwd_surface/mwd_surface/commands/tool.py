"""`mwd tool`: the configuration of a tool checked, and a recording simulated as such a tool would make it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mwd_sensors.telemetry.sequences import SequenceItem
    from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

tool = typer.Typer(help="Configuration of a tool (tool.yaml): check it, try it.", no_args_is_help=True)
Configuration = Annotated[Path, typer.Argument(metavar="TOOL.YAML", help="Tool configuration.")]


@tool.command()
def new(
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write; an existing one is kept.")],
    code: Annotated[str, typer.Option(help="mary, combinatorial, psk or serial.")] = "mary",
) -> None:
    """
    Write a tool configuration to begin with: pulses of 0.8 s or another code, and sequences as kits have them.

    \b
    Examples:
      mwd tool new -o tool.yaml
      mwd tool new -o siren.yaml --code psk
    """
    from mwd_sensors.telemetry.tool_configuration import starting, text
    from mwd_surface.commands import terminal

    configuration = starting(code)
    with output.open("x", encoding="utf-8") as file:
        file.write(text(configuration))
    terminal.output().print(f"written: {output}", markup=False)


@tool.command()
def check(configuration: Configuration) -> None:
    """
    Say what a tool configuration means: time on air, survey time, toolface rate, steps of the words.

    \b
    Example:
      mwd tool check tool.yaml
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.commands import terminal

    read = tool_configuration.read(configuration)
    console = terminal.output()
    bits = sum(item.length for item in read.surveys[0])
    rate = bits / read.seconds(read.surveys[0])
    console.print(f"{read.code}, {_signal_line(read)}, {rate:.2f} bit/s of words", markup=False)
    if read.head_s:
        console.print(f"sync and header {read.head_s:.1f} s", markup=False)
    console.print(f"sent {read.transmit_delay_s:g} s after flow-on", markup=False)
    for number, items in enumerate(read.surveys):
        on_air = read.seconds(items)
        total = read.transmit_delay_s + read.head_s + on_air
        console.print(f"survey {number}: {on_air:.1f} s on air, complete {total:.0f} s after flow-on", markup=False)
    for number, items in enumerate(read.toolfaces):
        console.print(f"toolface {number}: {_toolface_line(read, items)}", markup=False)
    pulses = read.code in tool_configuration.PULSE_CODES
    seen = dict.fromkeys(item for items in (*read.surveys, *read.toolfaces) for item in items)
    for item in seen:
        word = read.table[item.name]
        unprotected = "" if item.parity or not pulses else ", no parity: an error in it cannot be seen"
        console.print(
            f"  {item.name}:{item.bits} {word.low:g} to {word.high:g} {word.unit}, step"
            f" {word.step(item.bits):.3g}, sigma {word.sigma_of(item.bits):.3g}{unprotected}",
            markup=False,
        )


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
    each = f", a toolface every {on_air / toolfaces:.1f} s in the mean" if toolfaces else ", without a toolface"
    return f"{on_air:.1f} s on air{each}"


@tool.command()
def simulate(
    configuration: Configuration,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of pressure.csv, strokes.csv and sent.csv.")],
    depth: Annotated[float, typer.Option(help="Measured depth, m.", min=200.0, max=12000.0)] = 3000.0,
    minutes: Annotated[float, typer.Option(help="Length; flow begins after 20 s.", min=2.0, max=600.0)] = 10.0,
    seed: Annotated[int, typer.Option(help="Of values and noise.")] = 1,
    clock: Annotated[float, typer.Option(help="Error of the tool's clock, %.", min=-1.0, max=1.0)] = 0.0,
) -> None:
    """
    Simulate the standpipe pressure of a well with this tool, two pumps and noise; sent.csv has what was sent.

    \b
    Example:
      mwd tool simulate tool.yaml -o well --depth 4000
      mwd decode well/pressure.csv --tool tool.yaml -o decoded
    """
    import csv

    import numpy as np

    from mwd_sensors.simulator.mud_channel import MudChannel
    from mwd_sensors.simulator.mud_line import Well
    from mwd_sensors.simulator.pulse_tool import link_run, transmit
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.commands import terminal

    read = tool_configuration.read(configuration)
    flow_on, seconds = 20.0, 60.0 * minutes
    channel = MudChannel(well=Well(depth_m=depth), flow_off_s=((-100.0, flow_on),))
    sent = transmit(read, ((flow_on, seconds),), seed, 0.01 * clock)
    run = link_run(channel, sent, seconds, seed)
    output.mkdir(parents=True, exist_ok=True)
    table = np.column_stack([run.time_s, run.pressure_pa])
    np.savetxt(output / "pressure.csv", table, fmt="%.3f", delimiter=",", header="time_s,pressure_pa", comments="")
    with (output / "strokes.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("pump", "time_s"))
        rows.writerows((k + 1, f"{at:.4f}") for k, times in enumerate(run.strokes_s) for at in times)
    with (output / "sent.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("start_s", "end_s", "frame", "name", "raw", "value"))
        for word in sent.words:
            value = read.table[word.name].value(word.raw, word.bits)
            rows.writerow((f"{word.start_s:.3f}", f"{word.end_s:.3f}", word.frame, word.name, word.raw, f"{value:.6g}"))
    console = terminal.output()
    console.print(f"written: {output}/pressure.csv, strokes.csv, sent.csv ({len(sent.words)} words sent)", markup=False)

# SPDX-License-Identifier: Apache-2.0
"""`mwd decode`: words and surveys from standpipe pressure, earth voltage or serial bytes of a tool."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_sensors.core.output_files import write_whole
from mwd_surface.commands import terminal
from mwd_surface.commands.speech import spoken_figure

if TYPE_CHECKING:
    from mwd_sensors.core.arrays import Array
    from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
    from mwd_surface.receiver.link.receivers import Receiver
    from mwd_surface.receiver.pressure_files import PressureFile
    from mwd_surface.receiver.words import Reception


def decode(
    file: Annotated[
        Path,
        typer.Argument(
            help="Table with time and pressure or voltage (CSV, TXT), a WAV file, or a recording; for a tool on a "
            "serial line, a recording or a file of the captured bytes."
        ),
    ],
    tool: Annotated[Path, typer.Option(help="YAML file of the tool configuration (see `mwd tool new`).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for words.csv, surveys.csv and picture.png.")],
    strokes: Annotated[
        Path | None,
        typer.Option(
            help="CSV file with the strokes that a counter counted: columns pump and time_s. By default the strokes in "
            "the recording are used; without any, the stroke rate of the pumps is estimated from the pressure."
        ),
    ] = None,
    gauge: Annotated[int, typer.Option(help="Pressure gauge to read, if FILE has two: 1 or 2.")] = 1,
    topic: Annotated[str, typer.Option(help="Topic of the pressure, if a recording has several.")] = "",
    columns: Annotated[
        str,
        typer.Option(
            help="Columns of time and pressure in a table that does not name them with their units, by name or number, "
            "for example time_s=1,pressure_bar=2."
        ),
    ] = "",
) -> None:
    """
    Decode the signal of an MWD tool: pulses or a carrier in standpipe pressure, a carrier in the earth, serial frames.

    A word is one transmitted value, such as the inclination. words.csv gives its confidence (the probability that the
    word was received without error) and its sigma (the error of the value if the word is right). A word is believed,
    which means used, if its confidence is 0.99 or more (survey) or 0.95 or more (toolface). Any other word is erased,
    which means not used, unless earlier surveys show which of its alternatives is right. The same samples give the same
    words from every file format.

    \b
    Examples:
      mwd decode pressure.csv --tool tool.yaml -o decoded
      mwd decode pressure.csv --strokes strokes.csv --tool tool.yaml -o decoded
      mwd decode standpipe.wav --tool tool.yaml -o decoded
      mwd decode voltage.csv --tool em.yaml -o decoded
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.receiver import pressure_files
    from mwd_surface.receiver.link import other_width, receivers
    from mwd_surface.receiver.words import BELIEVED

    configuration = tool_configuration.read(tool)
    wired = configuration.code == "serial"
    if wired:
        read = pressure_files.read_bytes(file, configuration.serial.baud)
    else:
        read = pressure_files.read(file, gauge, topic, configuration.link, columns)
    for note in read.notes:
        terminal.warn(f"{file.name}: {note}")
    if wired and strokes:
        raise ValueError("--strokes: not used for a serial line; omit it")
    counted = pressure_files.read_strokes(strokes) if strokes else read.strokes
    receiver = receivers.receiver_of(configuration)
    got = _received(receiver, read, counted)
    if configuration.code == "mary" and not any(w.status == BELIEVED for w in got.words):
        with terminal.progress("searching another pulse width") as progress:
            width = other_width.sent_width(configuration, read.time_s, read.pressure_pa, counted, progress)
        if width is not None:
            terminal.warn(f"{other_width.sentence(configuration, width)}; the file is decoded with {width:.3g} s")
            configuration = dataclasses.replace(configuration, pulse_width_s=width)
            receiver = receivers.receiver_of(configuration)
            got = _received(receiver, read, counted)
    names = _write(output, configuration, read, got)
    _print_words(got, wired)
    if not any(word.status == BELIEVED for word in got.words):
        terminal.warn(receiver.why_nothing())
    elif configuration.code == "mary":
        _warn_of_unread(configuration, read, counted, got)
    terminal.tell(f"written: {output}/{names} ({read.origin})")


def _warn_of_unread(
    configuration: ToolConfiguration, read: PressureFile, strokes: dict[int, Array], got: Reception
) -> None:
    """Warn of a flow from which no word is believed, although words of other flows are; name the pulse width there."""
    from mwd_surface.receiver.link import other_width

    flow = other_width.unread_flow(configuration, read.time_s, read.pressure_pa, got.words)
    if flow is None:
        return
    inside = other_width.during(flow, read.time_s)
    with terminal.progress("searching another pulse width") as progress:
        width = other_width.sent_width(configuration, read.time_s[inside], read.pressure_pa[inside], strokes, progress)
    part = f"no word from {flow[0]:.0f} to {flow[1]:.0f} s is believed, with the flow on"
    if width is None:
        terminal.warn(f"{part}; the tool may have been silent, too weak, or set to another pulse width")
    else:
        terminal.warn(f"{part}: there the tool sends pulses of {width:.3g} s; decode the file with this width, too")


def _received(receiver: Receiver, read: PressureFile, strokes: dict[int, Array]) -> Reception:
    """Return the words and frames received from a file; strokes: times of the strokes of each pump, s."""
    from mwd_surface.receiver.sampled_receiver import SampledReceiver

    if isinstance(receiver, SampledReceiver):
        for pump, times in strokes.items():
            receiver.strokes(pump, times)
    got = receiver.push(read.time_s, read.pressure_pa)
    got.add(receiver.finish())
    return got


def _write(folder: Path, configuration: ToolConfiguration, read: PressureFile, got: Reception) -> str:
    """Write the tables of words and surveys, and for a sampled signal a plot; return the names of the files."""
    from mwd_surface.plots.drawing import png
    from mwd_surface.receiver import picture, words

    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "words.csv", words.words_csv(got.words))
    write_whole(folder / "surveys.csv", words.surveys_csv(got.words))
    if configuration.code == "serial":
        return "words.csv, surveys.csv"
    quantity = picture.VOLTAGE if configuration.medium in ("earth", "coil") else picture.PRESSURE
    drawn = picture.figure_of(read.time_s, read.pressure_pa, got.words, configuration, quantity)
    write_whole(folder / "picture.png", png(spoken_figure(drawn), 110))
    return "words.csv, surveys.csv, picture.png"


def _print_words(got: Reception, wired: bool) -> None:
    """Print a line for each frame and each value of a survey; a serial line has no signal quality to print."""
    from mwd_surface.receiver.words import BELIEVED

    for frame in got.frames:
        words = [word for word in got.words if word.frame == frame.frame]
        believed = sum(word.status == BELIEVED for word in words)
        signal = "" if wired else f"  Eb/N0 {frame.ebn0_db:4.1f} dB  clock {100.0 * frame.clock_error:+.3f} %"
        terminal.tell(
            f"{frame.start_s:8.1f} s  {frame.kind:8} {believed:3} of {len(words)} words believed{signal}"
            f"  {frame.reason}".rstrip()
        )
    for word in got.words:
        if word.kind == "survey" and word.usable:
            chosen = "" if word.status == BELIEVED else "  (chosen because it fits earlier surveys)"
            terminal.tell(f"{word.end_s:8.1f} s  {word.name} {word.value:.2f} {word.unit}{chosen}")

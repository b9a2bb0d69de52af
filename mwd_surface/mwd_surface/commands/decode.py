"""`mwd decode`: standpipe pressure of a pulse tool to words and surveys."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def decode(
    file: Annotated[
        Path, typer.Argument(help="CSV (time_s,pressure_pa[,pressure_2_pa]), WAV, or a recording with FluidPressure.")
    ],
    tool: Annotated[Path, typer.Option("--tool", help="Tool configuration, YAML: what the tool sends, and how.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of words.csv, surveys.csv and picture.png.")],
    strokes: Annotated[
        Path | None,
        typer.Option(help="CSV pump,time_s of a stroke counter; omit it to find the pumps in the pressure."),
    ] = None,
    gauge: Annotated[int, typer.Option(help="Which pressure gauge: 1 or 2.")] = 1,
    topic: Annotated[str, typer.Option(help="Topic of a recording that has several pressures.")] = "",
) -> None:
    """
    Decode the pulses of an MWD tool from standpipe pressure.

    Each word has a confidence, the probability that its code is right, and a sigma, its error if it is right. A word
    below 0.99 (survey) or 0.95 (toolface) is erased and shows its alternatives. The same samples give the same words,
    whatever file they come in.

    \b
    Examples:
      mwd decode pressure.csv --tool tool.yaml -o decoded
      mwd decode pressure.csv --strokes strokes.csv --tool tool.yaml -o decoded
      mwd decode standpipe.wav --tool tool.yaml -o decoded
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.commands import terminal
    from mwd_surface.receiver import picture, pressure_files, pulse_receiver, word_files
    from mwd_surface.receiver.words import BELIEVED

    configuration = tool_configuration.read(tool)
    read = pressure_files.read(file, gauge, topic)
    for note in read.notes:
        terminal.warn(f"{file.name}: {note}")
    receiver = pulse_receiver.PulseReceiver(configuration)
    for pump, times in (pressure_files.read_strokes(strokes) if strokes else {}).items():
        receiver.strokes(pump, times)
    got = receiver.push(read.time_s, read.pressure_pa)
    got.add(receiver.finish())
    output.mkdir(parents=True, exist_ok=True)
    (output / "words.csv").write_text(word_files.words_csv(got.words), encoding="utf-8")
    (output / "surveys.csv").write_text(word_files.surveys_csv(got.words), encoding="utf-8")
    (output / "picture.png").write_bytes(picture.image(read.time_s, read.pressure_pa, got.words, configuration.tu_s))
    console = terminal.output()
    for frame in got.frames:
        words = [word for word in got.words if word.frame == frame.frame]
        believed = sum(word.status == BELIEVED for word in words)
        console.print(
            f"{frame.start_s:8.1f} s  {frame.kind:8} {believed:3} of {len(words)} words believed"
            f"  Eb/N0 {frame.ebn0_db:4.1f} dB  clock {100.0 * frame.clock_error:+.3f} %  {frame.reason}".rstrip(),
            markup=False,
        )
    for word in got.words:
        if word.kind == "survey" and word.status == BELIEVED:
            console.print(f"{word.end_s:8.1f} s  {word.name} {word.value:.2f} {word.unit}", markup=False)
    if not got.words:
        terminal.warn(receiver.why_nothing())
    console.print(f"written: {output}/words.csv, surveys.csv, picture.png ({read.origin})", markup=False)

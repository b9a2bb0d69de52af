# SPDX-License-Identifier: Apache-2.0
"""`mwd listen`: decode a live gauge, sound card or serial line."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_sensors.core import settings
from mwd_surface.commands import terminal

if TYPE_CHECKING:
    from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
    from mwd_surface.receiver.sources import SampleSource
    from mwd_surface.receiver.words import ReceivedWord, Reception, WordFiles

_PAUSE_S = 0.05  # time between two reads of the source, s


def listen(
    source: Annotated[
        str,
        typer.Argument(
            help="Source of the signal: modbus:HOST:PORT (a 4-20 mA gauge), opcua:URL, wits:HOST:PORT, tcp:HOST:PORT"
            " (lines of text), lines:- (lines of text on standard input), wav:- (a WAV stream on standard input), or"
            " serial:DEVICE (a wired tool)."
        ),
    ],
    tool: Annotated[Path, typer.Option(help="YAML file of the tool configuration (see `mwd tool new`).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for words.csv and surveys.csv.")],
    gauge: Annotated[
        Path | None,
        typer.Option(
            help="YAML file of the Modbus gauge: unit, register, count_4_ma, count_20_ma, pressure_4_ma, "
            "pressure_20_ma, rate_hz."
        ),
    ] = None,
    columns: Annotated[
        str,
        typer.Option(
            help="Where the pressure is, and its unit: for lines the columns (time_s=1,pressure_bar=2), for WITS the "
            "item (pressure_psi=0121), for OPC UA the node (pressure_bar=ns=2;s=SPP)."
        ),
    ] = "",
    seconds: Annotated[
        float, typer.Option(help="Time after which decoding stops, s; 0: at Ctrl-C or at the end of the stream.")
    ] = 0.0,
) -> None:
    """
    Decode the signal of an MWD tool live, without ROS, and print each word when it is received.

    A word (one transmitted value) is final at the end of its sequence; it is then written to words.csv and surveys.csv.
    Written words survive a power failure.

    \b
    Examples:
      mwd listen modbus:192.168.1.20:502 --gauge gauge.yaml --tool tool.yaml -o heard
      arecord -t wav -f S32_LE -r 400 | mwd listen wav:- --tool tool.yaml -o heard
      mwd listen serial:/dev/ttyUSB0 --tool serial.yaml -o heard
      gauge_logger | mwd listen lines:- --columns time_s=1,pressure_bar=2 --tool tool.yaml -o heard
      mwd listen wits:192.168.1.30:9872 --columns pressure_psi=0121 --tool tool.yaml -o heard
      mwd listen opcua:opc.tcp://192.168.1.40:4840 --columns "pressure_bar=ns=2;s=SPP" --tool tool.yaml -o heard
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.receiver import words
    from mwd_surface.receiver.link import receivers
    from mwd_surface.receiver.lone_stamps import SteadyTimes

    configuration = tool_configuration.read(tool)
    receiver, steady = receivers.receiver_of(configuration), SteadyTimes().steady
    began = time.monotonic()
    opened = _opened(source, configuration, gauge, columns, lambda: time.monotonic() - began)
    output.mkdir(parents=True, exist_ok=True)
    said = ""
    with words.WordFiles(output) as files:
        try:
            while not (opened.ended or (seconds and time.monotonic() - began > seconds)):
                _print_words(receiver.push(*steady(*opened.read())), files)
                if opened.failure and opened.failure != said:
                    terminal.warn(opened.failure)
                said = opened.failure
                time.sleep(_PAUSE_S)
        except KeyboardInterrupt:
            terminal.tell("stopped")
        _print_words(receiver.push(*steady(*opened.read())), files)
        _print_words(receiver.finish(), files)
    opened.close()
    if not files.count:
        terminal.warn(receiver.why_nothing())
    terminal.tell(f"written: {output}/words.csv, surveys.csv")


def _print_words(got: Reception, files: WordFiles) -> None:
    """Print words as soon as they are received, and write them once they are final."""
    # A code whose words are final at once has no provisional words: print the final words.
    _print(got.provisional or got.words)
    files.add(got.words)


def _print(words: list[ReceivedWord]) -> None:
    for word in words:
        value = f"{word.value:.6g} {word.unit}".rstrip() if word.status != "erased" else "erased"
        # Round down, so that a confidence below 1 is not printed as 1.
        share = math.floor(1000.0 * word.confidence) / 1000.0
        line = f"{word.end_s:9.1f} s  {word.kind:8} {word.name} {value}  confidence {share:.3f}"
        terminal.tell(line)


def _opened(
    where: str, configuration: ToolConfiguration, gauge: Path | None, columns: str, clock: Callable[[], float]
) -> SampleSource:
    """
    Return the source of live samples for a name such as `modbus:HOST:PORT`; its times come from `clock`, s.

    Raises ValueError if the name has another form or does not fit the code of the tool.
    """
    from mwd_sensors.core.input_files import read_yaml
    from mwd_surface.receiver import network_sources, pressure_columns, sources
    from mwd_surface.rig.wits.format import KEEP_ALIVE

    kind, _, rest = where.partition(":")
    wired = configuration.code == "serial"
    if kind == "serial" and wired:
        return sources.SerialBytes(rest, configuration.serial.baud, clock)
    if kind == "wav" and rest == "-" and not wired:
        return sources.WavStream(0)
    host, _, port = rest.rpartition(":")
    said = pressure_columns.columns_of(columns)
    if kind == "lines" and rest == "-" and not wired:
        return network_sources.LineSource(sources.Pipe(0), said, clock)
    if kind == "opcua" and rest and not wired:
        return network_sources.OpcUaSource(rest, said)
    if kind in ("tcp", "wits") and host and port.isdigit() and not wired:
        if kind == "tcp":
            return network_sources.LineSource(network_sources.TcpClient(host, int(port)), said, clock)
        line = network_sources.TcpClient(host, int(port), KEEP_ALIVE)
        return network_sources.WitsSource(line, said, clock)
    if kind == "modbus" and host and port.isdigit() and not wired:
        plain = (read_yaml(gauge) if gauge is not None else None) or {}
        return sources.ModbusGauge(
            settings.from_mapping(sources.GaugeSettings, {**plain, "host": host, "port": int(port)}), clock
        )
    wanted = (
        "serial:DEVICE" if wired else "modbus:HOST:PORT, opcua:URL, wits:HOST:PORT, tcp:HOST:PORT, lines:- or wav:-"
    )
    raise ValueError(f"{where}: the source for a tool of code {configuration.code} must be {wanted}")

# SPDX-License-Identifier: Apache-2.0
"""`mwd emulate`: emulate a probe on a pseudo terminal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import READING, Reading, given_names, input_settings, takes

if TYPE_CHECKING:
    from mwd_sensors.core.arrays import Samples


@takes(READING)
def emulate(
    source: Annotated[
        str, typer.Argument(metavar="RECORDING|SCENARIO", help="Recording or scenario that gives the measurements.")
    ],
    protocol: Annotated[str, typer.Option(help="Protocol of the line: binary, ascii, xsens or polled.")] = "binary",
    link: Annotated[Path | None, typer.Option(help="Symbolic link to create to the line, such as /tmp/probe.")] = None,
    rate: Annotated[float, typer.Option(help="Speed relative to real time; 0: as fast as the line allows.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end (recordings only).")] = False,
    frame: Annotated[
        Path | None,
        typer.Option(help="YAML file with the requests and replies, for --protocol polled; by default Modbus RTU."),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Send nothing until a driver sends the start command.")] = False,
    *,
    reading: Reading,
) -> None:
    """
    Play a recording or a scenario as a probe on an emulated serial line, for the probe node or any other driver.

    The command prints the device name of the line; give this name to the driver as its port. The emulated probe obeys
    the commands of the protocol: start or stop samples, report its time, report its name.

    \b
    Examples:
      mwd emulate default --link /tmp/probe
      mwd emulate bags/run_7 --protocol ascii --wait
      mwd node probe --ros-args -p port:=/tmp/probe -p clock:=unit
    """
    from mwd_sensors.drivers import polled_line
    from mwd_sensors.drivers.emulator import PROTOCOLS, Emulator

    if protocol not in PROTOCOLS:
        raise ValueError(f"--protocol {protocol}: unknown; use one of {', '.join(PROTOCOLS)}")
    if rate < 0.0:
        raise ValueError(f"--rate {rate:g}: must be 0 or more")
    if frame is not None and protocol != "polled":
        raise ValueError(f"--frame: the protocol {protocol} has no frame; omit it, or use --protocol polled")
    samples = _samples(source, reading)
    asked = None if frame is None else polled_line.read(frame, polled_line.PROBE_QUANTITIES)
    with Emulator(protocol, link, wait, asked) as emulator:
        terminal.tell(str(link or emulator.device))
        emulator.play(samples, rate)
        while loop and Path(source).exists():
            emulator.play(_samples(source, reading), rate)
        terminal.remark(f"{emulator.sent} samples sent")


def _samples(source: str, reading: Reading) -> Iterator[dict[str, Samples]]:
    """
    Return an iterator over blocks of samples, by topic, of a recording or a scenario.

    Raises ValueError if options for recordings are given with a scenario.
    """
    if not Path(source).exists() or Path(source).suffix in (".yaml", ".yml"):
        if names := given_names(reading):
            raise ValueError(f"{names[0]} is an option for recordings; {source} is a scenario")
        from mwd_sensors.simulator import scenario_files
        from mwd_sensors.simulator.scenario import read
        from mwd_sensors.simulator.sonde import Sonde

        return iter(Sonde(read(scenario_files.find(source))).blocks(0.1))
    return _recorded(Path(source), reading)


def _recorded(path: Path, reading: Reading) -> Iterator[dict[str, Samples]]:
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.processing.bag_input import find_topics
    from mwd_surface.processing.input_stream import InputStream

    given = input_settings(reading)
    with Bag(path) as bag:
        topics = find_topics(bag, given)
        names = {
            topics.imu: "imu/data_raw",
            topics.mag: "imu/mag",
            topics.precision: "gyro/data_raw",
            topics.temperature: "imu/temperature",
        }
        for block in InputStream(bag, topics, given).blocks():
            yield {names[name]: samples for name, (_, samples) in block.items() if name in names}

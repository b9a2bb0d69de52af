# SPDX-License-Identifier: Apache-2.0
"""`mwd rig`: rig interfaces of a running graph."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.speech import say

if TYPE_CHECKING:
    from mwd_surface.rig.status import RigStatus

rig = typer.Typer(help="Interfaces to the rig: WITS, OPC UA, Modbus, WITSML.", no_args_is_help=True)


@rig.command()
def status(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Folder of a run or a well; by default the folders out and ~/mwd_data.", show_default=False
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON list, for programs.")] = False,
) -> None:
    """
    Show the rig interfaces of running graphs: state and address, peers, rates, drops, last values.

    The command ends with status 1 if no graph is running.

    \b
    Examples:
      mwd rig status
      mwd rig status ~/mwd_data/well_1 --json
    """
    import json

    from mwd_surface.rig.status import RigStatusError, read_status, status_files, status_lines

    places = folders or [Path("out"), Path("~/mwd_data").expanduser()]
    now = time.time()
    running: list[tuple[Path, RigStatus]] = []
    gone: list[tuple[Path, RigStatus]] = []
    for path in status_files(places):
        try:
            found = read_status(path)
        except (OSError, RigStatusError) as error:
            terminal.warn(str(error))
            continue
        (running if found.alive(now) else gone).append((path, found))
    if as_json:
        table = [{"folder": str(path.parent), **dataclasses.asdict(found)} for path, found in running]
        typer.echo(json.dumps(table))
    else:
        for path, found in running:
            terminal.tell(f"{found.well} ({path.parent})")
            terminal.tell(*(f"  {line}" for line in status_lines(found.interfaces, found.written)))
        for path, found in gone:
            age = now - found.written
            terminal.warn(
                f"{found.well} ({path.parent}) last reported {age:.0f} s ago: its surface node hangs or was killed"
            )
        if not running:
            where = ", ".join(str(place) for place in places)
            terminal.tell(f"no status of a running surface node was found below {where}")
            terminal.tell("start a graph with `mwd run`, or name the folder of a surface node")
    raise typer.Exit(0 if running else 1)


@rig.command("manifest")
def print_manifest() -> None:
    """
    Print the D-WIS manifest of all signals: the JSON description that the surface node sends to a D-WIS blackboard.

    \b
    Examples:
      mwd rig manifest > manifest.json
    """
    import json

    from mwd_surface.rig.blackboard.client import manifest

    typer.echo(json.dumps(manifest(), indent=2))


@rig.command("conformance")
def conformance(
    namespace: Annotated[
        str,
        typer.Option(
            "--ros", help="Namespace of the well: tests its ROS interface, and grants all requests of the tests."
        ),
    ] = "",
    opcua: Annotated[str, typer.Option(help="Address of the OPC UA server to test.")] = "",
    modbus: Annotated[str, typer.Option(help="HOST:PORT of the Modbus server to test.")] = "",
    heartbeat: Annotated[
        float, typer.Option(help="Heartbeat limit of the tested system, s: the value of its control.heartbeat_s.")
    ] = 2.0,
    well: Annotated[str, typer.Option(help="Name of the OPC UA object that has the control methods.")] = "well",
    certificate: Annotated[Path | None, typer.Option(help="Certificate file of this OPC UA client.")] = None,
    key: Annotated[Path | None, typer.Option(help="File with the private key of --certificate.")] = None,
    server_certificate: Annotated[Path | None, typer.Option(help="Certificate file of the OPC UA server.")] = None,
    application: Annotated[str, typer.Option(help="OPC UA application URI in --certificate.")] = "urn:mwd:conformance",
    unit: Annotated[int, typer.Option(help="Unit identifier of the Modbus server.")] = 1,
    domain: Annotated[
        int | None, typer.Option(help="ROS domain of the tested system; by default ROS_DOMAIN_ID, else 0.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON list, for programs.")] = False,
) -> None:
    """
    Test whether the surface node, or a rig with the same interfaces, refuses wrong control commands.

    The command prints the result of each case. A controller may command top drive and pumps only with a lease of
    control, and within limits. The test breaks these rules on purpose. Run it only on a rig that is switched off or
    simulated, because it also commands rotation, turns and flow within the limits. The command ends with status 1 if a
    case fails, 2 if an interface does not answer.

    \b
    Examples:
      mwd rig conformance --ros /well_1
      mwd rig conformance --ros /well_1 --modbus 127.0.0.1:5020
      mwd rig conformance --ros /well_1 --opcua opc.tcp://127.0.0.1:4840/ --certificate own.der --key own.pem
        --server-certificate server.der --json
    """
    import json

    from mwd_surface.conformance import cases
    from mwd_surface.conformance.bench import Interface, Person

    if not (namespace or opcua or modbus):
        raise ValueError("no interface to test is given: use --ros, --opcua or --modbus")
    interfaces: list[Interface] = []
    person: Person | None = None
    results: list[cases.Result] = []
    with contextlib.ExitStack() as stack:
        if namespace:
            from mwd_surface.ros.conformance_client import RosConformance

            chosen = int(os.environ.get("ROS_DOMAIN_ID", "0")) if domain is None else domain
            person = on_graph = RosConformance(chosen, namespace)
            stack.callback(on_graph.close)
            interfaces.append(on_graph)
        if opcua:
            from mwd_surface.conformance.opcua import OpcuaConformance, OpcuaKeys

            if certificate is None or key is None or server_certificate is None:
                raise ValueError("OPC UA needs --certificate, --key and --server-certificate")
            on_server = OpcuaConformance(opcua, OpcuaKeys(certificate, key, server_certificate, application), well)
            stack.callback(on_server.close)
            interfaces.append(on_server)
        if modbus:
            from mwd_surface.conformance.modbus import ModbusConformance

            host, _, port = modbus.rpartition(":")
            if not port.isdecimal():
                raise ValueError(f"--modbus: {modbus} has no port; write HOST:PORT")
            on_line = ModbusConformance(host, int(port), unit)
            stack.callback(on_line.close)
            interfaces.append(on_line)
        for one in interfaces:
            for result in cases.run(one, person, heartbeat):
                results.append(result)
                if not as_json:
                    word = {True: "pass", False: "FAIL", None: "-"}[result.passed]
                    typer.echo(f"{word:4}  {result.interface:6}  {result.case}: {result.expected} | {result.observed}")
    failed = [result for result in results if result.passed is False]
    if as_json:
        typer.echo(json.dumps([dataclasses.asdict(result) for result in results]))
    else:
        done = sum(result.passed is not None for result in results)
        typer.echo(say(f"{done - len(failed)} of {done} cases pass; {len(results) - done} cannot be tested"))
    raise typer.Exit(1 if failed else 0)

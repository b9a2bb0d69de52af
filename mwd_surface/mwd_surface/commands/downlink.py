# SPDX-License-Identifier: Apache-2.0
"""`mwd downlink`: send a command to the tool from the terminal, with the same permission as on the page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_surface.commands.graph import Domain, visit
from mwd_surface.commands.speech import say

if TYPE_CHECKING:
    from mwd_surface.ros.graph_client import GraphClient

downlink = typer.Typer(
    no_args_is_help=True,
    help="Send commands to the tool in the hole by changes of flow or rotation, through the running nodes.",
)
Name = Annotated[str, typer.Option("--name", help="Your name, for the record; required except to abort.")]
Number = Annotated[int, typer.Argument(min=1, help="Number of the request, from `mwd downlink state`.")]
_SUBMIT, _GRANT, _DENY, _ABORT = range(4)  # decisions, as in mwd_msgs/DecideDownlink
# Words for the states, in the order of their numbers in mwd_msgs/DownlinkState.
_STATES = (
    *("idle", "draft", "pending", "granted", "armed", "running", "sent", "confirmed", "unconfirmed", "denied"),
    *("lapsed", "aborted"),
)
_ENDED = _STATES[7:]  # states in which a command has ended
_LISTEN_S = 3.0  # longest wait for a state before the graph is asked again, s


@downlink.command("send")
def send(
    command: Annotated[
        str, typer.Argument(help="Command: sequence, pulse_width, carrier, toolface_rate, survey_now or mute.")
    ],
    value: Annotated[
        float,
        typer.Argument(
            help="Number of the sequence from 0, pulse width in s, carrier in Hz, or number of times that each "
            "toolface is sent. Omit it for survey_now and mute."
        ),
    ] = 0.0,
    name: Name = "",
    domain: Domain = None,
) -> None:
    """
    Request a command to the tool; the request waits until a named person grants it.

    \b
    Examples:
      mwd downlink send pulse_width 0.5 --name "A. Driller"
      mwd downlink state
      mwd downlink grant 1 --name "B. Toolpusher"
      mwd downlink watch
    """
    with visit(domain) as client:
        _call(client, "draft_downlink", {"command": command, "value": value, "operator_name": name})
        _call(client, "decide_downlink", {"decision": _SUBMIT, "operator_name": name})


@downlink.command("grant")
def grant(number: Number, name: Name = "", domain: Domain = None) -> None:
    """Grant the pending request; the command starts as soon as all interlocks allow it."""
    with visit(domain) as client:
        _call(client, "decide_downlink", {"decision": _GRANT, "operator_name": name, "number": number})


@downlink.command("deny")
def deny(number: Number, name: Name = "", domain: Domain = None) -> None:
    """Deny the pending request."""
    with visit(domain) as client:
        _call(client, "decide_downlink", {"decision": _DENY, "operator_name": name, "number": number})


@downlink.command("abort")
def abort(name: Name = "", domain: Domain = None) -> None:
    """Abort the present command; flow and rotation return to the driller's values."""
    with visit(domain) as client:
        _call(client, "decide_downlink", {"decision": _ABORT, "operator_name": name})


@downlink.command("state")
def state(domain: Domain = None) -> None:
    """Show the present command: its state, the reason, and the conditions that still prevent its start."""
    with visit(domain) as client:
        last = _newest(client, _LISTEN_S)
        typer.echo(say(_line(last)))
        for text in last["blocked_by"]:
            typer.echo(say(f"  waits because {text}"))


@downlink.command("watch")
def watch(
    seconds: Annotated[float, typer.Option(help="Time after which the command ends, s.")] = float("inf"),
    domain: Domain = None,
) -> None:
    """Print the states of the newest command until it ends; exit status 1 if the tool did not confirm the command."""
    with visit(domain) as client:
        newest = _newest(client, seconds)
        before = ""
        if _STATES[newest["state"]] in _ENDED:
            _shown(newest, before)
        # The topic also delivers earlier messages: ignore messages of earlier commands.
        for _, message in client.listen("downlink/state", seconds):
            if message["number"] >= newest["number"]:
                before = _shown(message, before)


def _shown(message: dict[str, Any], before: str) -> str:
    """
    Print the line of a state unless it equals `before`; return the line.

    Raises typer.Exit if the downlink command has ended; the exit status is 0 if the tool confirmed it, else 1.
    """
    line, word = _line(message), _STATES[message["state"]]
    if line != before:
        typer.echo(say(line))
    if word in _ENDED:
        raise typer.Exit(0 if word == "confirmed" else 1)
    return line


def _newest(client: GraphClient, seconds: float) -> dict[str, Any]:
    """Return the last published state of the downlink; raise ValueError if no state arrives within `seconds`."""
    heard: list[dict[str, Any]] = []
    listened = 0.0
    while not heard and listened < seconds:
        heard = [message for _, message in client.listen("downlink/state", min(_LISTEN_S, seconds - listened))]
        listened += _LISTEN_S
    if not heard:
        raise ValueError(
            f"no downlink state received within {seconds:g} s: the machine is busy, or the surface node has no"
            " downlink; set its parameter downlink.tool_file to a tool.yaml with a section downlink"
        )
    return heard[-1]


def _line(message: dict[str, Any]) -> str:
    word = _STATES[message["state"]]
    progress = f", symbol {message['symbol']} of {message['symbols']}" if word == "running" else ""
    return f"{message['number']} {word}{progress}: {message['reason'] or 'no command was sent yet'}"


def _call(client: GraphClient, service: str, fields: dict[str, Any]) -> None:
    answer = client.call(service, fields)
    typer.echo(say(answer["message"]))
    if not answer["success"]:
        raise typer.Exit(1)

# SPDX-License-Identifier: Apache-2.0
"""`mwd call`, `mwd param` and `mwd topic`: access to a running graph, like `ros2`, but without a ROS installation."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_surface.commands.node import without_ros
from mwd_surface.commands.shared_options import assignments
from mwd_surface.commands.speech import say

if TYPE_CHECKING:
    from mwd_surface.ros.graph_client import GraphClient

Domain = Annotated[
    int | None,
    typer.Option(help="ROS domain of the nodes; by default ROS_DOMAIN_ID, else the domain of the run on this machine."),
]
NodeName = Annotated[str, typer.Argument(help="Name of the node, or the last part of this name.")]
ParameterName = Annotated[str, typer.Argument(help="Full name of the parameter.")]
param = typer.Typer(no_args_is_help=True, help="Parameters of the nodes of a running graph.")
topic = typer.Typer(no_args_is_help=True, help="Topics of a running graph.")


def call(
    service: Annotated[
        str | None,
        typer.Argument(help="Name of the service, or the last part of this name; if omitted, all services are listed."),
    ] = None,
    fields: Annotated[
        list[str] | None, typer.Argument(metavar="[FIELD=VALUE]...", help="Fields of the request.")
    ] = None,
    domain: Domain = None,
) -> None:
    """
    Call a service of a running graph, like `ros2 service call`; exit status 1 if the service reports failure.

    \b
    Examples:
      mwd call
      mwd call take_survey duration=10
      mwd call /well_1/accept_survey sequence=3 operator_name="A. Driller" reason="by gyro" measured_depth=nan
    """
    with visit(domain) as client:
        if service is None:
            _print_table(client.services())
            return
        response = client.call(service, _assigned(fields))
    _print_yaml(response)
    if response.get("success") is False:
        raise typer.Exit(1)


@param.command("list")
def param_list(
    node: Annotated[
        str | None,
        typer.Argument(help="Name of the node, or the last part of this name; if omitted, the nodes are listed."),
    ] = None,
    domain: Domain = None,
) -> None:
    """List the nodes, or the parameters of one node with their values."""
    with visit(domain) as client:
        if node is None:
            for name in client.nodes():
                typer.echo(name)
        else:
            _print_yaml(client.parameters(node))


@param.command("get")
def param_get(
    node: NodeName,
    name: ParameterName,
    domain: Domain = None,
) -> None:
    """
    Show the value and meaning of a parameter.

    \b
    Example:
      mwd param get estimator survey.duration_s
    """
    with visit(domain) as client:
        values = client.parameters(node)
        if name not in values:
            raise ValueError(f"{node} has no parameter {name}: `mwd param list {node}` lists them")
        _print_yaml({name: values[name]})
        if words := client.describe(node, name):
            typer.echo(f"# {words}")


@param.command("set")
def param_set(
    node: NodeName,
    name: ParameterName,
    value: Annotated[str, typer.Argument(help="New value, written as in YAML.")],
    domain: Domain = None,
) -> None:
    """
    Set a parameter; if the node refuses it, print the reason.

    \b
    Example:
      mwd param set surface leg.tool T-0042
    """
    with visit(domain) as client:
        client.set_parameter(node, name, assignments([f"{name}={value}"])[name])
    typer.echo(say(f"{name} is set"))


@topic.command("list")
def topic_list(domain: Domain = None) -> None:
    """List the topics with their types."""
    with visit(domain) as client:
        _print_table(client.topics())


@topic.command("echo")
def topic_echo(
    name: Annotated[str, typer.Argument(help="Name of the topic, or the last part of this name.")],
    count: Annotated[int, typer.Option("--count", "-n", help="End after this number of messages; 0: no limit.")] = 0,
    seconds: Annotated[float, typer.Option(help="Time after which the command ends, s.")] = float("inf"),
    domain: Domain = None,
) -> None:
    """
    Print the messages of a topic, as YAML.

    \b
    Example:
      mwd topic echo survey -n 1
    """
    with visit(domain) as client:
        for k, (_, message) in enumerate(client.listen(name, seconds)):
            _print_yaml(message)
            typer.echo("---")
            if k + 1 == count:
                return


@topic.command("hz")
def topic_hz(
    name: Annotated[str, typer.Argument(help="Name of the topic, or the last part of this name.")],
    seconds: Annotated[float, typer.Option(help="Duration of the measurement, s.")] = 5.0,
    domain: Domain = None,
) -> None:
    """Measure the rate of a topic."""
    with visit(domain) as client:
        times = [at for at, _ in client.listen(name, seconds)]
    if len(times) < 2:
        typer.echo(say(f"{len(times)} messages in {seconds:g} s"))
        raise typer.Exit(1)
    gaps = [after - before for before, after in itertools.pairwise(times)]
    rate = (len(times) - 1) / max(times[-1] - times[0], 1e-9)
    typer.echo(say(f"{rate:.2f} Hz, {len(times)} messages, longest gap {max(gaps):.3f} s"))


@contextlib.contextmanager
def visit(domain: int | None) -> Iterator[GraphClient]:
    """
    Yield a client that is connected to the nodes of a ROS domain until the block ends.

    domain : None: ROS_DOMAIN_ID, else the domain of the run on this machine.
    """
    import tempfile

    from mwd_surface.runs import launch_plan

    chosen = launch_plan.visited_domain(os.environ, domain)
    os.environ.update(launch_plan.graph_environment(os.environ, chosen, tempfile.gettempdir()))
    with without_ros():
        from mwd_surface.ros.graph_client import GraphClient
    with GraphClient(chosen) as client:
        yield client


def _assigned(fields: list[str] | None) -> dict[str, Any]:
    """Return FIELD=VALUE texts as a dict, nested at dots; ValueError if a field has both a value and fields."""
    table: dict[str, Any] = {}
    for name, value in assignments(fields).items():
        *parents, leaf = name.split(".")
        place = table
        try:
            for parent in parents:
                place = place.setdefault(parent, {})
            place[leaf] = value
        except (AttributeError, TypeError) as error:
            raise ValueError(f"{name}: {'.'.join(parents)} already has a value") from error
    return table


def _print_table(rows: dict[str, str]) -> None:
    width = max((len(name) for name in rows), default=0)
    for name, kind in sorted(rows.items()):
        typer.echo(f"{name:<{width}}  {kind}")


def _print_yaml(table: dict[str, Any]) -> None:
    import yaml

    typer.echo(yaml.safe_dump(table, sort_keys=False, allow_unicode=True).rstrip())

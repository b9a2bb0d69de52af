"""Parameters of all nodes of a well as tables for a recording, so that it can be understood and played again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from mwd_sensors.core import settings
from mwd_sensors.ros.lifecycle_node import GraphNode

_SECRETS = ("token", "password")


class ParameterTables:
    """
    Asks the other nodes of the well for their parameters as soon as they are there.

    others : sequence of str
        Names of the nodes, relative to the well.
    """

    def __init__(self, node: GraphNode[Any], others: Sequence[str]) -> None:
        self._node = node
        self._others = others
        self._tables: dict[str, dict[str, str]] = {}
        self._fresh: list[str] = []

    def open(self) -> None:
        """Open the clients."""
        self._clients = {
            other: (
                self._node.reach(ListParameters, f"{other}/list_parameters"),
                self._node.reach(GetParameters, f"{other}/get_parameters"),
            )
            for other in self._others
        }

    def ask(self) -> None:
        """Ask whoever is there and has not answered yet; called once a second."""
        for other, (names, values) in self._clients.items():
            if other in self._tables or not (names.service_is_ready() and values.service_is_ready()):
                continue
            # An empty table until the answer comes, so that nobody is asked twice.
            self._tables[other] = {}
            names.call_async(ListParameters.Request()).add_done_callback(
                lambda done, other=other, values=values: self._listed(other, values, done)
            )

    def _listed(self, other: str, values: Any, done: Any) -> None:
        names = list(done.result().result.names)
        values.call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda got: self._got(other, names, got)
        )

    def _got(self, other: str, names: list[str], done: Any) -> None:
        table = {n: parameter_value_to_python(v) for n, v in zip(names, done.result().values, strict=True)}
        self._tables[other] = without_secrets(table)
        self._fresh.append(other)

    def own(self) -> dict[str, str]:
        """Parameters of the node itself."""
        return without_secrets({name: value for name, (value, _) in settings.flat(self._node.settings).items()})

    def tables(self) -> dict[str, dict[str, str]]:
        """Everything known, by the name under which it goes into a recording."""
        known = {f"parameters/{name}": table for name, table in self._tables.items() if table}
        return {f"parameters/{self._node.get_name()}": self.own(), **known}

    def take_fresh(self) -> dict[str, dict[str, str]]:
        """Tables that came since the last call: a recording that runs already lacks them."""
        fresh, self._fresh = self._fresh, []
        return {f"parameters/{name}": self._tables[name] for name in fresh}


def without_secrets(table: dict[str, Any]) -> dict[str, str]:
    """As text; what only the owner may know is left out."""
    return {name: str(value) for name, value in table.items() if name.rsplit(".", 1)[-1] not in _SECRETS}

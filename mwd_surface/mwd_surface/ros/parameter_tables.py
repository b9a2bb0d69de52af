# SPDX-License-Identifier: Apache-2.0
"""Tables with the parameters of all nodes of a well in a recording, for processing the recording again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from mwd_sensors.core import settings
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import STATE

_SECRETS = ("token", "password")


class ParameterTables:
    """
    Collector of the parameters of the other nodes of a well.

    Parameters
    ----------
    others : sequence of str
        Names of the other nodes, relative to the namespace of the well.
    """

    def __init__(self, node: GraphNode[Any], others: Sequence[str]) -> None:
        self._node = node
        self._others = others
        self._tables: dict[str, dict[str, str]] = {}
        self._asked: set[str] = set()
        self._new: list[str] = []

    def open(self) -> None:
        """Create the service clients, and follow changes of the parameters of the other nodes."""
        node = self._node
        services = {other: (f"{other}/list_parameters", f"{other}/get_parameters") for other in self._others}
        self._clients = {
            other: (node.add_client(ListParameters, names), node.add_client(GetParameters, values))
            for other, (names, values) in services.items()
        }
        self._names = {
            node.resolve_service_name(names).removesuffix("/list_parameters"): other
            for other, (names, _) in services.items()
        }
        node.add_subscription(ParameterEvent, "/parameter_events", self._on_event, STATE)

    def refresh(self) -> None:
        """Request all parameters again, because events may have been missed while the node was not active."""
        self._asked.clear()

    def _on_event(self, event: Any) -> None:
        """Request the parameters of a node again that has changed them, or that was started again."""
        self._asked.discard(self._names.get(event.node, ""))

    def request(self) -> None:
        """Request the parameters of nodes that exist and whose parameters may be new; called once per second."""
        for other, (names, values) in self._clients.items():
            if other in self._asked or not (names.service_is_ready() and values.service_is_ready()):
                continue
            self._asked.add(other)
            names.call_async(ListParameters.Request()).add_done_callback(
                lambda done, other=other, values=values: self._listed(other, values, done)
            )

    def _listed(self, other: str, values: Any, done: Any) -> None:
        names = list(done.result().result.names)
        values.call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda got: self._got(other, names, got)
        )

    def _got(self, other: str, names: list[str], done: Any) -> None:
        found = {n: parameter_value_to_python(v) for n, v in zip(names, done.result().values, strict=True)}
        table = without_secrets(found)
        if table != self._tables.get(other):
            self._tables[other] = table
            self._new.append(other)

    def own(self) -> dict[str, dict[str, str]]:
        """Return the parameters of the surface node itself as a table, by the name of the table in a recording."""
        table = without_secrets({name: value for name, (value, _) in settings.flat(self._node.settings).items()})
        return {f"parameters/{self._node.get_name()}": table}

    def tables(self) -> dict[str, dict[str, str]]:
        """Return the parameters of all nodes as tables, by the name of the table in a recording."""
        return self.own() | {f"parameters/{name}": table for name, table in self._tables.items()}

    def value(self, node: str, name: str) -> Any:
        """Return a parameter of another node; None if it is not known yet."""
        return self._tables.get(node, {}).get(name)

    def take_new(self) -> dict[str, dict[str, str]]:
        """Return the parameter tables that arrived since the last call, to add them to the running recording."""
        new, self._new = self._new, []
        return {f"parameters/{name}": self._tables[name] for name in new}


def without_secrets(table: dict[str, Any]) -> dict[str, str]:
    """Return the values of a table as texts, without tokens and passwords."""
    return {name: str(value) for name, value in table.items() if name.rsplit(".", 1)[-1] not in _SECRETS}

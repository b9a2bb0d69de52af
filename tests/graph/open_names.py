# SPDX-License-Identifier: Apache-2.0
"""Program of tests: print what the nodes that are named have open, once it no longer changes."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

import rclpy
from rclpy.action.graph import get_action_client_names_and_types_by_node as action_clients
from rclpy.action.graph import get_action_server_names_and_types_by_node as action_servers

_LONGEST = 120.0  # s


def read_graph(visitor: Any, nodes: Iterable[str]) -> dict[str, dict[str, list[str]]]:
    """
    Read the topics, services and actions that nodes of a running graph have open, by their full names.

    visitor: rclpy node on the same domain. nodes: full names.
    """
    table: dict[str, dict[str, list[str]]] = {}
    for full in nodes:
        space, _, name = full.rpartition("/")
        open_: dict[str, Callable[[str, str], list[tuple[str, list[str]]]]] = {
            "publish": visitor.get_publisher_names_and_types_by_node,
            "subscribe": visitor.get_subscriber_names_and_types_by_node,
            "reply": visitor.get_service_names_and_types_by_node,
            "request": visitor.get_client_names_and_types_by_node,
            "execute": lambda node, where: action_servers(visitor, node, where),
            "call": lambda node, where: action_clients(visitor, node, where),
        }
        table[full] = {kind: _relative(found(name, space or "/"), space, name) for kind, found in open_.items()}
    return table


def _relative(found: Iterable[tuple[str, list[str]]], space: str, node: str) -> list[str]:
    """Return names without the well; the parts of actions are left out, because rights to actions cover them."""
    names = {name.removeprefix(f"{space}/") if space else name for name, _ in found if "/_action/" not in name}
    # Write a node's own services with a tilde, so that they apply if the node has another name.
    return sorted(f"~/{name.removeprefix(f'{node}/')}" if name.startswith(f"{node}/") else name for name in names)


def main() -> None:
    """Look every three seconds until two looks agree."""
    rclpy.init()
    node = rclpy.create_node("visitor", start_parameter_services=False)
    wanted, before, table = sys.argv[1:], None, {}
    until = time.monotonic() + _LONGEST
    while time.monotonic() < until and (table != before or not table):
        for _ in range(30):
            rclpy.spin_once(node, timeout_sec=0.1)
        if set(wanted) <= {f"{space}/{name}" for name, space in node.get_node_names_and_namespaces()}:
            before, table = table, read_graph(node, wanted)
    sys.stdout.write(f"{json.dumps(table)}\n")


if __name__ == "__main__":
    main()

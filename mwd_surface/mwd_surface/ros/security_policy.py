# SPDX-License-Identifier: Apache-2.0
"""
Rights of each node of a well with DDS security (SROS2): the topics, services and actions that it may use.

The table is kept in `security_policy.yaml`; a test compares it with a running graph.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import yaml

#: Names of topics, services and actions by node and key of `KINDS`; a relative name is in the namespace of the well.
Table = dict[str, dict[str, list[str]]]

# Element, attribute and inner element of the policy file for each kind of access.
KINDS = {
    "publish": ("topics", "publish", "topic"),
    "subscribe": ("topics", "subscribe", "topic"),
    "reply": ("services", "reply", "service"),
    "request": ("services", "request", "service"),
    "execute": ("actions", "execute", "action"),
    "call": ("actions", "call", "action"),
}
#: Profiles for clients that call services and read topics, as `ros2` and `mwd call` do, and for controllers.
OPERATOR, CONTROLLER = "operator", "controller"
# Rights of a controller in addition to reading: to request and release control, and to send set-points.
_CONTROL = {"publish": ["control/command"], "request": ["release_control", "request_control"], "call": []}
_FILE = Path(__file__).with_name("security_policy.yaml")


def shipped() -> Table:
    """Return the table of rights that is shipped with the package."""
    table: Table = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    return table


def merged(first: Mapping[str, Mapping[str, list[str]]], second: Mapping[str, Mapping[str, list[str]]]) -> Table:
    """Return the union of two tables of rights."""
    nodes = sorted({*first, *second})
    return {
        node: {
            kind: sorted({*first.get(node, {}).get(kind, ()), *second.get(node, {}).get(kind, ())}) for kind in KINDS
        }
        for node in nodes
    }


def missing(allowed: Mapping[str, Mapping[str, list[str]]], found: Mapping[str, Mapping[str, list[str]]]) -> list[str]:
    """Return a sentence for each topic, service or action that a node of a graph uses and the table does not allow."""
    return [
        f"{node} may not {kind} {name}"
        for node, kinds in found.items()
        for kind, names in kinds.items()
        for name in names
        if name not in allowed.get(node, {}).get(kind, ())
    ]


def policy_xml(table: Mapping[str, Mapping[str, list[str]]], well: str) -> str:
    """
    Return a policy file for `ros2 security create_permission`, version 0.2.0, with an enclave for each node of a well.

    well: namespace of the well without slashes at its ends; empty: no namespace.

    Raises
    ------
    ValueError
        The well is not a valid ROS name.
    """
    if well and not all(part.isidentifier() for part in well.strip("/").split("/")):
        raise ValueError(f"well: must be a name of letters, digits and underscores, got {well!r}")
    space = f"/{well.strip('/')}" if well.strip("/") else ""
    policy = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(policy, "enclaves")
    operator = _of_operator(table)
    controller = {**operator, **_CONTROL, "publish": operator["publish"] + _CONTROL["publish"]}
    for node, kinds in {**table, OPERATOR: operator, CONTROLLER: controller}.items():
        enclave = ET.SubElement(enclaves, "enclave", path=f"{space}/{node}")
        # Operators and controllers may give their nodes other names; their rights depend on their enclave.
        profile = ET.SubElement(ET.SubElement(enclave, "profiles"), "profile", ns=space or "/", node=node)
        for kind, (element, attribute, inner) in KINDS.items():
            if kinds.get(kind):
                allowed = ET.SubElement(profile, element, {attribute: "ALLOW"})
                for name in kinds[kind]:
                    ET.SubElement(allowed, inner).text = name
    ET.indent(policy)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(policy, encoding="unicode")}\n'


def _of_operator(table: Mapping[str, Mapping[str, list[str]]]) -> dict[str, list[str]]:
    """Return the rights of the operator: read all topics, call all services and actions, publish only a log."""

    def of_nodes(kind: str) -> list[str]:
        names = {
            f"{node}/{name.removeprefix('~/')}" if name.startswith("~/") else name
            for node, kinds in table.items()
            for name in kinds.get(kind, ())
        }
        return sorted(names)

    return {
        "publish": ["/parameter_events", "/rosout"],
        "subscribe": of_nodes("publish"),
        "request": of_nodes("reply"),
        "call": of_nodes("execute"),
    }

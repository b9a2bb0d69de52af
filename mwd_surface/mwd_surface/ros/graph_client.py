# SPDX-License-Identifier: Apache-2.0
"""
Client of a running ROS graph: calls services, reads and sets parameters, listens to topics, like `ros2`.

A message is represented by a dict that has, for the name of each field, a number, text, list or dict.
"""

from __future__ import annotations

import difflib
import importlib
import os
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import rclpy
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from mwd_surface.ros.topics import message_class

DISCOVERY_S = 5.0  # longest wait for a named topic, service or node to appear
_QUIET_S = 1.5  # a list counts as complete after this time without additions, as discovery is gradual
_CALL_S = 600.0  # longest wait for the response of a service
_MUTUAL_DISCOVERY_S = 0.5  # time for the server to discover a client that has discovered the server
# Beginnings of the types of services that every node has; these services are not listed.
_COMMON = ("rcl_interfaces/", "lifecycle_msgs/", "type_description_interfaces/")


class GraphError(ValueError):
    """Raised if a name is not in the graph or does not answer; the message suggests existing names."""


class GraphClient:
    """
    Temporary node on a ROS graph.

    domain: domain of the middleware.
    """

    def __init__(self, domain: int) -> None:
        rclpy.init(args=[], domain_id=domain)
        self._node = rclpy.create_node(f"mwd_visitor_{os.getpid()}", start_parameter_services=False)

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        rclpy.try_shutdown()

    def __enter__(self) -> GraphClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def services(self) -> dict[str, str]:
        """Return name and type of every service, except services that every node has, and parts of actions."""
        self.nodes()
        there = _settled(self._services).items()
        return {name: kind for name, kind in there if not kind.startswith(_COMMON) and "/_action/" not in name}

    def topics(self) -> dict[str, str]:
        """Return name and type of every topic."""
        self.nodes()
        return _settled(self._topics)

    def nodes(self) -> list[str]:
        """Return the full names of the nodes."""
        return list(_settled(lambda: dict.fromkeys(self._nodes(), "")))

    def call(self, service: str, fields: Mapping[str, Any]) -> dict[str, Any]:
        """
        Call a service and return its response; the end of the service's name is enough if it is unique.

        Raises
        ------
        GraphError
            There is no such service, or no answer.
        ValueError
            The request does not have a given field, or a value has a wrong type.
        """
        name, kind = self._found(service, self._services, "service")
        package, _, type_name = kind.partition("/srv/")
        made = getattr(importlib.import_module(f"{package}.srv"), type_name)
        response: dict[str, Any] = plain(self._called(made, name, filled(made.Request, fields)))
        return response

    def listen(self, topic: str, seconds: float) -> Iterator[tuple[float, dict[str, Any]]]:
        """
        Yield the messages of a topic with their time of arrival, s, for some seconds; inf: until the caller stops.

        Raises
        ------
        GraphError
            There is no such topic, or the package of its type is not installed.
        """
        name, kind = self._found(topic, self._topics, "topic")
        made = message_class(kind)
        if made is None:
            raise GraphError(f"{name} is a {kind}, whose package is not installed for this Python")
        waiting: list[tuple[float, Any]] = []
        offered = self._node.get_publishers_info_by_topic(name)
        # Use the publisher's durability, so that a latched topic delivers its earlier message.
        profile = QoSProfile(depth=100, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        if offered and all(one.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for one in offered):
            profile.reliability = QoSReliabilityPolicy.RELIABLE
            profile.durability = QoSDurabilityPolicy.TRANSIENT_LOCAL
        self._node.create_subscription(made, name, lambda one: waiting.append((time.monotonic(), one)), profile)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(self._node, timeout_sec=0.1)
            for at, message in waiting:
                yield at, plain(message)
            waiting.clear()

    def parameters(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node; node: end of its name. Raise GraphError if there is no such node."""
        full = self._node_named(node)
        listed = self._called(ListParameters, f"{full}/list_parameters", ListParameters.Request())
        names = sorted(listed.result.names)
        got = self._called(GetParameters, f"{full}/get_parameters", GetParameters.Request(names=names))
        return {name: parameter_value_to_python(v) for name, v in zip(names, got.values, strict=True)}

    def describe(self, node: str, name: str) -> str:
        """Return the description of a parameter, empty if there is none; GraphError if there is no such node."""
        request = DescribeParameters.Request(names=[name])
        found = self._called(DescribeParameters, f"{self._node_named(node)}/describe_parameters", request)
        return str(found.descriptors[0].description) if found.descriptors else ""

    def set_parameter(self, node: str, name: str, value: Any) -> None:
        """
        Set a parameter of a node.

        Raises
        ------
        GraphError
            There is no such node or parameter, or the node refuses the value; the message gives the reason.
        """
        before = self.parameters(node)
        if name not in before:
            raise GraphError(f"{node} has no parameter {name}{_near(name, before)}")
        if isinstance(before[name], float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        answer = self._called(SetParameters, f"{self._node_named(node)}/set_parameters", request)
        if not answer.results[0].successful:
            raise GraphError(f"{name} was not set: {answer.results[0].reason}")

    def _node_named(self, node: str) -> str:
        return self._found(node, lambda: dict.fromkeys(self._nodes(), ""), "node")[0]

    def _called(self, made: Any, name: str, request: Any) -> Any:
        client = self._node.create_client(made, name)
        if not client.wait_for_service(DISCOVERY_S):
            raise GraphError(f"{name} does not answer: is the node alive?")
        # A reply is lost if the server has not yet discovered this client's reader. This cannot be queried, so wait.
        time.sleep(_MUTUAL_DISCOVERY_S)
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=_CALL_S)
        if not future.done():
            raise GraphError(f"{name} has not answered for {_CALL_S:.0f} s")
        return future.result()

    def _found(self, wanted: str, there: Callable[[], dict[str, str]], what: str) -> tuple[str, str]:
        """
        Wait until an item appears, and return its full name and type; wanted: full name, or the end of the name.

        Raises GraphError if no item has this name within `DISCOVERY_S`, or if several names have this end.
        """
        end = time.monotonic() + DISCOVERY_S
        names: dict[str, str] = {}
        while time.monotonic() < end:
            names = there()
            if wanted in names:
                return wanted, names[wanted]
            tail = "/" + wanted.strip("/")
            fitting = [name for name in names if name.endswith(tail)]
            if len(fitting) == 1 and not wanted.startswith("/"):
                return fitting[0], names[fitting[0]]
            if len(fitting) > 1 and not wanted.startswith("/"):
                raise GraphError(
                    f"{wanted}: there are {len(fitting)}: {', '.join(sorted(fitting))}; name the one you mean"
                )
            time.sleep(0.1)
        raise GraphError(f"there is no {what} {wanted} in this graph{_near(wanted, names)}")

    def _services(self) -> dict[str, str]:
        return {name: kinds[0] for name, kinds in self._node.get_service_names_and_types()}

    def _topics(self) -> dict[str, str]:
        return {name: kinds[0] for name, kinds in self._node.get_topic_names_and_types()}

    def _nodes(self) -> list[str]:
        own = self._node.get_name()
        found = self._node.get_node_names_and_namespaces()
        return sorted(f"{space.rstrip('/')}/{name}" for name, space in found if name != own)


def _settled(there: Callable[[], dict[str, str]]) -> dict[str, str]:
    """
    Return the items that `there` returns, when their number has not changed for `_QUIET_S`.

    If there is no item, or the number continues to change, wait no longer than `DISCOVERY_S`.
    """
    end, changed_at, found = time.monotonic() + DISCOVERY_S, time.monotonic(), there()
    while time.monotonic() < end and (not found or time.monotonic() - changed_at < _QUIET_S):
        time.sleep(0.1)
        now = there()
        if len(now) != len(found):
            found, changed_at = now, time.monotonic()
    return found


def plain(message: Any) -> Any:
    """Return a message as dicts, lists, numbers and texts."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if hasattr(message, "tolist"):
        return message.tolist()
    if isinstance(message, (bytes, bytearray)):
        return list(message)
    return [plain(one) for one in message] if isinstance(message, (list, tuple)) else message


def filled(made: type[Any], fields: Mapping[str, Any]) -> Any:
    """
    Return a message of a class with the values of `fields`, and defaults for the other fields.

    Raises
    ------
    ValueError
        The message does not have a field (the message names its fields), or a value has a wrong type.
    """
    # Check the types here: otherwise a wrong type would cause an error of the middleware when the message is sent.
    message = made(check_fields=True)
    kinds = message.get_fields_and_field_types()
    for name, value in fields.items():
        if name not in kinds:
            raise ValueError(f"{name}: unknown field; the fields are {', '.join(kinds) or 'none'}")
        before = getattr(message, name)
        if isinstance(before, (bool, int, str)) and type(value) is not type(before):
            raise ValueError(f"{name}: {value!r} is not of type {kinds[name]}")
        try:
            if isinstance(value, str):
                # Raise ValueError for bytes from a shell that are not valid text.
                value.encode()
            if isinstance(value, Mapping):
                setattr(message, name, filled(type(before), value))
            elif isinstance(before, float):
                setattr(message, name, float(value))
            else:
                setattr(message, name, value)
        except (AssertionError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise ValueError(f"{name}: {value!r} is not of type {kinds[name]}") from error
    return message


def _near(name: str, there: Mapping[str, Any] | list[str]) -> str:
    near = difflib.get_close_matches(name, list(there), n=3, cutoff=0.4)
    ends = [one for one in there if name.rpartition("/")[2] and name.rpartition("/")[2] in one][:3]
    found = list(dict.fromkeys([*near, *ends]))
    return f"; did you mean {' or '.join(found)}?" if found else ("; nothing runs here" if not there else "")

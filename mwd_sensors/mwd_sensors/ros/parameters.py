# SPDX-License-Identifier: Apache-2.0
"""Settings as ROS parameters: described, with ranges, and changed all together or not at all."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from mwd_sensors.core import settings
from mwd_sensors.core.settings import Rule, SettingsError

T = TypeVar("T")


_OF_ROS = ("use_sim_time", "start_type_description_service")  # every node of rclpy declares them


def given_at_start(node: Node) -> dict[str, Any]:
    """
    Return the parameters that were given at start, by name, and undeclare them, so that they can be declared again.

    The node must have declared these parameters with the option `automatically_declare_parameters_from_overrides`. The
    parameters that ROS itself reads stay declared and are not returned.
    """
    found = {name: one.value for name, one in node.get_parameters_by_prefix("").items()}
    given = {k: value for k, value in found.items() if k not in _OF_ROS and not k.startswith("qos_overrides.")}
    for name in given:
        node.undeclare_parameter(name)
    return given


class SettingsParameters(Generic[T]):
    """
    The settings of a node, kept equal to its ROS parameters.

    Every field of the dataclass is declared under its dotted name with meaning, unit, range and read-only flag. A
    change is checked as a whole, by the rules of a configuration file and by `check`, which raises ValueError for
    settings that the node cannot work with. A refused change has no effect; after an accepted change `changed` is
    called with the settings in force. `given`: values given at start, see `given_at_start`. `changeable`:
    beginnings of the names that can change at run time; all other names are read-only.

    Raises
    ------
    SettingsError
        A value given at start is not allowed, or a name given at start does not exist (similar names are suggested).
    """

    def __init__(
        self,
        node: Node,
        given: Mapping[str, Any],
        default: T,
        changed: Callable[[T], None],
        changeable: tuple[str, ...],
        check: Callable[[T], None],
    ) -> None:
        self._given = given
        self.value = default
        self._changed, self._accept = changed, check
        self._names = settings.flat(default)
        self._refuse_unknown(node)
        start = {}
        for name, (value, rule) in self._names.items():
            descriptor = describe(name, value, rule, changeable=name.startswith(changeable))
            start[name] = self._declare(node, value, rule, descriptor)
        self.value = settings.changed(default, start)
        try:
            self._accept(self.value)
        except ValueError as error:
            raise SettingsError(str(error)) from error
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _refuse_unknown(self, node: Node) -> None:
        for name in self._given:
            if name not in self._names and not node.has_parameter(name):
                raise SettingsError(settings.unknown_key(name, self._names, ""))

    def _declare(self, node: Node, value: Any, rule: Rule, descriptor: ParameterDescriptor) -> Any:
        name = descriptor.name
        # An empty list has no element type; ROS carries sequences as lists.
        plain = list(value) if isinstance(value, (list, tuple)) else value
        # NaN stands for a number that is not given. The descriptor then has no range, because ROS would refuse NaN; the
        # range of the setting is checked later.
        plain = math.nan if plain is None else plain
        try:
            if plain == []:
                node.declare_parameter(name, self._given.get(name) or [""], descriptor)
                return [item for item in node.get_parameter(name).value if item != ""]
            return node.declare_parameter(name, plain, descriptor).value
        except (InvalidParameterValueException, InvalidParameterTypeException) as error:
            given = self._given[name]
            # If the value breaks the rule of the setting, this raises an error that names the rule.
            settings.changed(self.value, {name: given})
            raise SettingsError(f"{name}: {given!r} is not allowed; {rule.text()}") from error

    def _collect(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in parameters if p.name in self._names}

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            self._accept(settings.changed(self.value, self._collect(parameters)))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        changes = self._collect(parameters)
        if changes:
            self.value = settings.changed(self.value, changes)
            self._changed(self.value)


def describe(name: str, value: Any, rule: Rule, *, changeable: bool) -> ParameterDescriptor:
    """Return the descriptor with meaning, unit and range; a missing bound is the largest float, for integers 2^62."""
    descriptor = ParameterDescriptor(name=name, description=rule.text(), read_only=not changeable)
    if rule.low is None and rule.high is None:
        return descriptor
    if isinstance(value, float):
        low = -sys.float_info.max if rule.low is None else float(rule.low)
        high = sys.float_info.max if rule.high is None else float(rule.high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    elif isinstance(value, int) and not isinstance(value, bool):
        low_int = -(2**62) if rule.low is None else int(rule.low)
        high_int = 2**62 if rule.high is None else int(rule.high)
        descriptor.integer_range = [IntegerRange(from_value=low_int, to_value=high_int, step=1)]
    return descriptor

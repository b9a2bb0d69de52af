# SPDX-License-Identifier: Apache-2.0
"""
No call of a logger can raise: rclpy holds each place in the code to one severity and to one set of filters.

A place that logs with another severity, or another throttle, than it did first raises ValueError in the middle of a
callback. So a severity is a method called by its name, a filter a constant, and no logger is called by other means.
"""

import ast

import pytest

from project import ROOT

SEVERITIES = {"debug", "info", "warn", "warning", "error", "fatal"}
FILTERS = {"throttle_duration_sec", "skip_first", "once", "throttle_time_source_type"}
SOURCES = [
    path for package in ("mwd_sensors", "mwd_estimation", "mwd_surface") for path in (ROOT / package).rglob("*.py")
]


def _is_logger(expression):
    """Whether an expression is a logger: `x.get_logger()`, or a name that says so."""
    if isinstance(expression, ast.Call):
        return isinstance(expression.func, ast.Attribute) and expression.func.attr in ("get_logger", "get_child")
    name = getattr(expression, "attr", getattr(expression, "id", ""))
    return name.strip("_") in ("logger", "log", "ros_logger")


def _constant(value, module):
    """Whether an argument is the same at each call: a literal, or a name in capitals of the module."""
    if isinstance(value, ast.Constant):
        return True
    return isinstance(value, ast.Name) and value.id.isupper() and value.id in module


def faults(text):
    """Lines of a module at which a logger may be called with another severity or filter than before."""
    tree = ast.parse(text)
    module = {
        target.id for one in tree.body if isinstance(one, ast.Assign) for target in one.targets if hasattr(target, "id")
    }
    called = {id(call.func): call for call in ast.walk(tree) if isinstance(call, ast.Call)}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "getattr" and _is_logger(node.args[0]):
            found.append(node.lineno)
        if not isinstance(node, ast.Attribute) or not _is_logger(node.value):
            continue
        call = called.get(id(node))
        if node.attr == "log" or (node.attr in SEVERITIES and call is None):
            found.append(node.lineno)
        elif node.attr in SEVERITIES:
            given = {word.arg: word.value for word in call.keywords}
            # Of unpacked words nobody knows which filters they are.
            if None in given or any(not _constant(given[name], module) for name in FILTERS & given.keys()):
                found.append(node.lineno)
    return found


@pytest.mark.parametrize("path", [path for path in SOURCES if "logger" in path.read_text()], ids=lambda path: path.stem)
def test_each_place_logs_with_one_severity_and_one_filter(path):
    assert faults(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "line",
    [
        "(node.get_logger().error if bad else node.get_logger().info)(text)",
        "say = logger.error if bad else logger.info",
        "self._logger.log(text, severity)",
        "getattr(node.get_logger(), level)(text)",
        "node.get_logger().warning(text, throttle_duration_sec=period)",
        "node.get_logger().warning(text, **filters)",
        "tell(node.get_logger().info)",
    ],
)
def test_other_ways_to_log_are_found(line):
    assert set(faults(line)) == {1}


def test_severities_of_their_own_lines_are_sound():
    first = "EVERY = 10.0\nif bad:\n    node.get_logger().error(text, throttle_duration_sec=EVERY)\n"
    text = f"{first}else:\n    logger.info(text)"
    assert faults(text) == []


def test_rclpy_still_refuses_a_second_severity():
    logging = pytest.importorskip("rclpy.logging")
    logger = logging.get_logger("severities")
    logger.set_level(logging.LoggingSeverity.DEBUG)

    def tell(text, *, bad):
        (logger.error if bad else logger.info)(text)

    tell("first", bad=False)
    with pytest.raises(ValueError, match="severity"):
        tell("second", bad=True)

# SPDX-License-Identifier: Apache-2.0
"""
Launch files without an installed `launch`: what they describe, carried out as far as the processes it would start.

Of upstream's packages `launch` and `launch_ros` (docs.ros.org, Jazzy) the parts that our launch files use, with what
decides here: actions run in order in one context; an included file is no scope, its arguments stay set after it.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from project import ROOT


@dataclasses.dataclass
class Context:
    """Arguments, remappings and environment so far, and the processes described."""

    arguments: dict[str, str]
    remappings: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    environment: dict[str, str] = dataclasses.field(default_factory=dict)
    processes: list[Process] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True)
class Process:
    """A node that a launch file starts: where it is, and the words that follow `--ros-args`."""

    package: str
    executable: str
    namespace: str
    words: tuple[str, ...]
    respawn: bool


Substitution = Callable[[Context], str]
Action = Callable[[Context], None]


def _text(value: Any, context: Context) -> str:
    """Carry out a text, a substitution or a list of them, which are joined."""
    if callable(value):
        return str(value(context))
    return "".join(_text(part, context) for part in value) if isinstance(value, list | tuple) else str(value)


def _configuration(name: str) -> Substitution:
    return lambda context: context.arguments[name]


def _environment(name: str, *, default_value: Any) -> Substitution:
    return lambda context: context.environment.get(name) or os.environ.get(name) or _text(default_value, context)


def _path(parts: list[Any]) -> Substitution:
    return lambda context: str(Path(*(_text(part, context) for part in parts)))


def _equals(left: Any, right: Any) -> Substitution:
    return lambda context: str(_text(left, context) == _text(right, context)).lower()


def _declare(
    name: str, *, default_value: Any, description: str, choices: Iterable[str] | None = None
) -> Callable[[Context], None]:
    def act(context: Context) -> None:
        value = context.arguments.setdefault(name, _text(default_value, context))
        if choices is not None and value not in choices:
            raise RuntimeError(f"argument {name}: {value!r} is none of {', '.join(choices)}")

    assert description
    return act


def _include(file: Any, *, launch_arguments: Iterable[tuple[str, Any]], condition: Substitution) -> Action:
    given = list(launch_arguments)

    def act(context: Context) -> None:
        if condition(context) == "true":
            for name, value in given:
                context.arguments[name] = _text(value, context)
            _run(Path(_text(file, context)), context)

    return act


def _set_environment(name: str, value: Any) -> Action:
    return lambda context: context.environment.__setitem__(name, _text(value, context))


def _remap(name: Any, to: Any) -> Action:
    return lambda context: context.remappings.append((_text(name, context), _text(to, context)))


def _node(
    *,
    package: str,
    executable: str,
    name: str,
    namespace: Any,
    parameters: list[Any],
    ros_arguments: list[Any],
    output: str,
    respawn: Any,
    respawn_delay: float,
    sigkill_timeout: str,
) -> Action:
    def act(context: Context) -> None:
        assert output == "screen"
        assert respawn_delay > 0.0
        assert float(sigkill_timeout) > 0.0
        space = _text(namespace, context)
        words = ["-r", f"__node:={name}", *(["-r", f"__ns:=/{space.strip('/')}"] if space else [])]
        for one in parameters:
            if isinstance(one, dict):
                words += [word for key, value in one.items() for word in ("-p", f"{key}:={_text(value, context)}")]
            else:
                words += ["--params-file", _text(one, context)]
        words += [_text(one, context) for one in ros_arguments]
        words += [word for pair in context.remappings for word in ("-r", ":=".join(pair))]
        again = _text(respawn, context) == "true"
        context.processes.append(Process(package, executable, space, tuple(words), again))

    return act


def _typed(value: Any, *, value_type: type) -> Any:
    assert value_type in (bool, str)
    return value


_MODULES: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": list},
    "launch.actions": {
        "DeclareLaunchArgument": _declare,
        "IncludeLaunchDescription": _include,
        "SetEnvironmentVariable": _set_environment,
    },
    "launch.conditions": {"IfCondition": lambda value: value},
    "launch.substitutions": {
        "EnvironmentVariable": _environment,
        "EqualsSubstitution": _equals,
        "LaunchConfiguration": _configuration,
        "PathJoinSubstitution": _path,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": _node, "SetRemap": _remap},
    "launch_ros.parameter_descriptions": {"ParameterValue": _typed},
    "launch_ros.substitutions": {"FindPackageShare": lambda package: str(ROOT / package)},
}


def _run(file: Path, context: Context) -> None:
    spec = importlib.util.spec_from_file_location(file.name.partition(".")[0] + "_launch", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for action in module.generate_launch_description():
        action(context)


def processes(file: Path, **arguments: str) -> Context:
    """
    Return what a launch file describes with these arguments, for packages as they lie in the source tree.

    Raises
    ------
    RuntimeError
        An argument is none of its choices.
    """
    context, ours = Context(dict(arguments)), "mwd_sensors.ros.launch_files"
    kept = {name: sys.modules.pop(name) for name in (*_MODULES, ours) if name in sys.modules}
    try:
        for name, content in _MODULES.items():
            module = types.ModuleType(name)
            vars(module).update(content)
            sys.modules[name] = module
        _run(file, context)
    finally:
        for name in (*_MODULES, ours):
            sys.modules.pop(name, None)
        sys.modules.update(kept)
    return context

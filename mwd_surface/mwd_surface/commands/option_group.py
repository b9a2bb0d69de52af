# SPDX-License-Identifier: Apache-2.0
"""Groups of options that several commands share; a command gets the values of a group as one argument."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class OptionGroup(NamedTuple):
    """
    Group of options.

    argument: name of the argument with which a command gets the group. make: function that returns this argument from
    the values of all options by name. options: by name of the option, its annotation for typer; without a default, an
    option is None.
    """

    argument: str
    make: Callable[..., Any]
    options: Mapping[str, Any]


def takes(*groups: OptionGroup) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the options of groups to a command, after the command's own options."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        for group in groups:
            # The type of a group is imported only for the type checker.
            del command.__annotations__[group.argument]
        own = inspect.signature(command, eval_str=True)
        arguments = {group.argument for group in groups}
        kept = [parameter for parameter in own.parameters.values() if parameter.name not in arguments]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for group in groups
            for name, annotation in group.options.items()
        ]

        @functools.wraps(command)
        def called(*arguments: Any, **given: Any) -> None:
            made = {
                group.argument: group.make(**{name: given.pop(name, None) for name in group.options})
                for group in groups
            }
            command(*arguments, **given, **made)

        # typer makes the options of the command line from the signature and the annotations.
        called.__signature__ = own.replace(parameters=[*kept, *added])  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in (*kept, *added)}
        return called

    return decorated

# SPDX-License-Identifier: Apache-2.0
"""Commands of the page, and the checks of their arguments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from mwd_sensors.core.foreign_text import not_a_file_name, unprintable
from mwd_surface.page.request_body import json_object

Command = Callable[[str, dict[str, Any]], tuple[bool, str]]
_UINT8, _UINT32 = range(2**8), range(2**32)  # ranges of the integer fields in the requests of the services
# Arguments of each command: type (a range stands for the whole numbers in it), and whether the argument is optional.
COMMANDS: dict[str, dict[str, tuple[type | range, bool]]] = {
    "accept_survey": {
        "sequence": (_UINT32, False),
        "operator_name": (str, False),
        "reason": (str, True),
        "measured_depth": (float, True),
        "replace": (bool, True),
        "value": (_UINT8, True),
    },
    "reject_survey": {"sequence": (_UINT32, False), "operator_name": (str, False), "reason": (str, True)},
    "draft_downlink": {"command": (str, False), "value": (float, True), "operator_name": (str, False)},
    "decide_downlink": {"decision": (_UINT8, False), "operator_name": (str, False), "number": (_UINT32, True)},
    "use_leg": {"leg": (str, False), "kick_off_depth": (float, True), "operator_name": (str, False)},
    "set_depth": {"bit_depth": (float, False), "operator_name": (str, False)},
    "count_rods": {
        "operator_name": (str, False),
        "change": (range(-1, 2), True),
        "count": (_UINT32, True),
        "length": (float, True),
        "reason": (str, True),
    },
    "take_survey": {"duration": (float, True)},
    "acknowledge_alarm": {"id": (str, False), "operator_name": (str, False)},
    "start_recording": {"name": (str, True)},
    "stop_recording": {},
    "split_recording": {},
    "snapshot_recording": {},
    "judge_control": {
        "decision": (_UINT8, False),
        "operator_name": (str, False),
        "reason": (str, True),
        "number": (_UINT32, True),
    },
    "export": {"format": (str, False), "name": (str, True)},
}
# Values of `decision` that return control of the rig or refuse a request; these are never delayed or locked out.
_SAFE: dict[str, tuple[int, ...]] = {"judge_control": (1, 2), "decide_downlink": (2, 3)}
_MAX_TEXT = 500  # largest length of a text argument, characters


def is_safe(command: str, arguments: Mapping[str, Any]) -> bool:
    """Return whether a command denies or aborts, so that an operator with the token can send it at any time."""
    return arguments.get("decision") in _SAFE.get(command, ())


def may_be_safe(command: str) -> bool:
    """Return whether `is_safe` holds for a command with some values of its arguments."""
    return command in _SAFE


def checked_arguments(command: str, body: bytes) -> dict[str, Any]:
    """
    Return the arguments of a command, by name, from the body of a request.

    Raises
    ------
    web.HTTPBadRequest
        The body is not JSON, or a field is missing, unknown, of another type, not finite or too long; the message names
        the field.
    """
    given = json_object(body)
    fields = COMMANDS[command]
    for name in given:
        if name not in fields:
            raise web.HTTPBadRequest(text=f"{name[:60]}: {command} takes {', '.join(fields) or 'no arguments'}")
    arguments: dict[str, Any] = {}
    for name, (kind, optional) in fields.items():
        if name not in given:
            if optional:
                continue
            raise web.HTTPBadRequest(text=f"{name}: must be given")
        arguments[name] = _argument(name, given[name], kind)
    if "operator_name" in fields and not arguments["operator_name"].strip():
        raise web.HTTPBadRequest(text="operator_name: must not be empty: the log records who did it")
    return arguments


def _argument(name: str, value: Any, kind: type | range) -> Any:
    within = kind if isinstance(kind, range) else None
    kind = int if isinstance(kind, range) else kind
    if kind is float and type(value) is int and abs(value) < 2**53:
        value = float(value)
    if type(value) is not kind:
        raise web.HTTPBadRequest(text=f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    if isinstance(value, float) and not math.isfinite(value):
        raise web.HTTPBadRequest(text=f"{name}: must be finite")
    if isinstance(value, str) and (len(value) > _MAX_TEXT or unprintable(value)):
        raise web.HTTPBadRequest(text=f"{name}: {unprintable(value) or f'at most {_MAX_TEXT} characters'}")
    if name == "name" and (wrong := not_a_file_name(str(value))):
        raise web.HTTPBadRequest(text=f"name: {wrong}")
    if within is not None and value not in within:
        raise web.HTTPBadRequest(text=f"{name}: must be within {within[0]} and {within[-1]}")
    return value

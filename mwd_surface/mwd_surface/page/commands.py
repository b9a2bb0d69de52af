# SPDX-License-Identifier: Apache-2.0
"""
Commands from the page: the secret that they need, the body of a request, and the check of its arguments.

The secret comes from a file or the environment, never from a parameter, because every node can read parameters and they
are recorded.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import math
import stat
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from aiohttp import web

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import not_a_file_name, unprintable
from mwd_sensors.core.input_files import load_json, read_text

# Access: one secret, kept as a hash, and a lock-out for addresses that guess.

VARIABLE = "MWD_PAGE_TOKEN"
_SHORTEST = 8  # length of the shortest secret, characters
_MOST_WRONG = 5  # number of wrong secrets in a row from one address after which the address must wait
_WAIT_S = 60.0  # time from the last wrong secret to the end of the wait, s
_REMEMBERED = 1000  # number of addresses that are remembered


def read_token(file: str, environment: Mapping[str, str]) -> str:
    """
    Return the secret of the operator controls: the first line of a file, else the variable MWD_PAGE_TOKEN, else "".

    Raises
    ------
    ValueError
        The file cannot be read or is empty, every user may read it, or the secret is too short.
    """
    token = environment.get(VARIABLE, "")
    if file:
        path = Path(file).expanduser()
        try:
            if path.stat().st_mode & stat.S_IROTH:
                raise ValueError(f"page.token_file: every user of this machine can read {path}; chmod 640 {path}")
            token = read_text(path, budgets.SECRET).partition("\n")[0].strip()
        except OSError as error:
            raise ValueError(f"page.token_file: {path}: {error.strerror}") from error
        if not token:
            raise ValueError(f"page.token_file: {path} is empty")
    if 0 < len(token) < _SHORTEST:
        raise ValueError(f"page.token_file: a secret needs at least {_SHORTEST} characters")
    return token


class SecretAccess:
    """
    Checker of the secrets that come with commands.

    Parameters
    ----------
    clock : callable
        Steady time, s.

    Raises
    ------
    ValueError
        The secret is too short.
    """

    def __init__(self, token: str, clock: Callable[[], float]) -> None:
        if len(token) < _SHORTEST:
            raise ValueError(f"token: a secret needs at least {_SHORTEST} characters")
        self._hash = _hashed(token)
        self._clock = clock
        # Number of wrong secrets in a row by address, and the time of the last one.
        self._wrong: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_s(self, peer: str) -> int:
        """Return the time until the next secret of an address is checked, whole s."""
        count, at = self._wrong.get(peer, (0, 0.0))
        return max(0, math.ceil(at + _WAIT_S - self._clock())) if count >= _MOST_WRONG else 0

    def allows(self, peer: str, given: str, *, forgive: bool = True) -> bool:
        """
        Return whether a secret is right; count wrong secrets by the address that sent them.

        forgive: whether a right secret resets the count of its address.
        """
        if hmac.compare_digest(_hashed(given), self._hash):
            if forgive:
                self._wrong.pop(peer, None)
            return True
        self._wrong[peer] = (self._wrong.pop(peer, (0, 0.0))[0] + 1, self._clock())
        if len(self._wrong) > _REMEMBERED:
            self._wrong.popitem(last=False)
        return False


def _hashed(token: str) -> bytes:
    # A header may hold bytes that are not valid text.
    return hashlib.sha256(token.encode("utf-8", "surrogateescape")).digest()


# Body of a request.


async def read_body(request: web.Request, timeout_s: float) -> bytes:
    """
    Return the body of a request that sends JSON.

    Raises
    ------
    web.HTTPException
        The body has another type, is too large, or did not arrive in time.
    """
    if request.content_type != "application/json":
        # Another site can make a browser send a plain form, but not JSON, without permission.
        raise web.HTTPUnsupportedMediaType(text="send application/json")
    try:
        return await asyncio.wait_for(request.read(), timeout_s)
    except TimeoutError:
        raise web.HTTPRequestTimeout(text="the request did not arrive in time") from None


def json_object(body: bytes) -> dict[str, Any]:
    """
    Return a body parsed as a JSON object; an empty body gives an empty object.

    Raises
    ------
    web.HTTPBadRequest
        The body is not a JSON object, or is nested too deeply.
    """
    try:
        given = load_json(body.decode() or "{}", budgets.PAGE, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise web.HTTPBadRequest(text=f"the body is not JSON: {str(error)[:200]}") from None
    if not isinstance(given, dict):
        raise web.HTTPBadRequest(text="the body must be a JSON object")
    return given


def _refuse_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a number")


# Arguments of a command.

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

# SPDX-License-Identifier: Apache-2.0
"""
Access to commands: one secret, kept as a hash, and a lock-out for addresses that guess.

The secret comes from a file or the environment, never from a parameter, because every node can read parameters and they
are recorded.
"""

from __future__ import annotations

import hashlib
import hmac
import math
import stat
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_text

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
    token : str
        The secret; only its hash is kept.
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

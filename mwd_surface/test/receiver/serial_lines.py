# SPDX-License-Identifier: Apache-2.0
"""Waiting for what another thread or device does, with a bound."""

import time

import numpy as np

_LONGEST_S = 20.0


def until(read, count=None):
    """Call `read` until it is true, or until the arrays that it gives hold `count` values; what it gave in all."""
    end, got = time.monotonic() + _LONGEST_S, []
    while time.monotonic() < end:
        one = read()
        if count is None and one:
            return one
        if count is not None:
            got.append(one)
            if sum(len(part[0]) for part in got) >= count:
                return tuple(np.concatenate(part) for part in zip(*got, strict=True))
        time.sleep(0.01)
    raise TimeoutError(f"not within {_LONGEST_S:g} s")

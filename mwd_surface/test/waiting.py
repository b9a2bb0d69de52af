# SPDX-License-Identifier: Apache-2.0
"""Waiting, with a limit, for what another thread, process or device does."""

import time

import numpy as np


def eventually(condition, timeout=60.0):
    """Wait until something that another thread or process does is true; its value."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        result = condition()
        if result:
            return result
        # A yield to the other side, not a time to wait for.
        time.sleep(0.005)
    raise AssertionError("it did not happen in time")


def samples_of(read, count):
    """Times and samples that `read` of a live source has returned, once there are `count` of them."""
    got = []

    def enough():
        got.append(read())
        return sum(len(times) for times, _ in got) >= count

    eventually(enough)
    return tuple(np.concatenate(part) for part in zip(*got, strict=True))

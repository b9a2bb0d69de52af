# SPDX-License-Identifier: Apache-2.0
"""Samples as the steps of a window of motion, taken half second by half second."""

import numpy as np

from mwd_estimation.health import motion_window
from mwd_estimation.health.motion_window import ROWS, STEP, Samples
from mwd_estimation.health.stream_checks import STREAM


def steps_of(rates, forces, fields, hz=100):
    """Return the steps of these samples, each shape (n, 3), and the record of their stream."""
    n = len(rates)
    stamps = np.arange(n) * (10**9 // hz)
    samples = Samples(stamps, rates, forces, stamps, fields)
    stream, steps = np.zeros(1, STREAM)[0], np.zeros(ROWS, STEP)
    for start in range(0, n, hz // 2):
        stream.first, stream.stop = start, start + hz // 2
        motion_window.add(stream, steps, samples)
        stream.last_ns = stamps[start + hz // 2 - 1]
    return steps[: int(stream.steps)], stream

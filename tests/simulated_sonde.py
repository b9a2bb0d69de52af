# SPDX-License-Identifier: Apache-2.0
"""Samples of a simulated sonde by topic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

__all__ = ["samples_of", "simulated"]


def simulated(name: str, seconds: float = math.inf, **changes: Any) -> tuple[dict[str, NDArray[Any]], Sonde]:
    """Return the samples of a shipped scenario with changes, at least so many seconds of them, and its sonde."""
    sonde = Sonde(scenario.read(SCENARIOS / f"{name}.yaml", changes))
    return samples_of(sonde, seconds), sonde


def samples_of(sonde: Sonde, seconds: float = math.inf, block_s: float = 1.0) -> dict[str, NDArray[Any]]:
    """Return the samples of a sonde by topic, asked for in blocks until at least so many seconds have come."""
    blocks: list[dict[str, NDArray[Any]]] = []
    for block in sonde.blocks(block_s):
        blocks.append(block)
        if len(blocks) * block_s >= seconds:
            break
    return {topic: np.concatenate([block[topic] for block in blocks]) for topic in blocks[0]}

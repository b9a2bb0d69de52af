# SPDX-License-Identifier: Apache-2.0
"""Sonde, estimator and surface of one well in one process."""

from __future__ import annotations

from collections.abc import Sequence

from mwd_estimation.nodes.estimator import EstimatorNode
from mwd_sensors.nodes.sonde import SondeNode
from mwd_sensors.ros.run_node import run_nodes
from mwd_surface.nodes.surface import SurfaceNode


def main(args: Sequence[str] | None = None) -> int:
    """
    Run the three nodes until one of them is stopped; return the exit status of the process.

    Messages between nodes of one process do not go through the network. Only one callback runs at a time, and a crash
    ends all three nodes; separate processes run on several cores and survive the crash of another.
    """
    return run_nodes([SurfaceNode, EstimatorNode, SondeNode], args)

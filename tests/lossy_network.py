# SPDX-License-Identifier: Apache-2.0
"""
A network between the nodes of one machine that loses and reorders datagrams, or is cut off.

The middleware talks by UDP alone, and a library preloaded into every node (lossy_network.c) drops a share of the
datagrams and delays others behind the next few. This needs neither netem in the kernel nor any right.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mwd_surface.runs import launch_plan

SOURCE = Path(__file__).with_name("lossy_network.c")
# The project's own profile, on the loopback alone. The middleware's range LOCALHOST would add shared memory, which goes
# around the network.
PROFILE = launch_plan.MIDDLEWARE.read_text(encoding="utf-8").replace(
    "<type>UDPv4</type>",
    "<type>UDPv4</type><interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>",
)
_MILLION = 1_000_000
_LOSS, _DELAY, _COUNTS = 0, 1, slice(2, 5)


class LossyNetwork:
    """
    The network of the processes that get its environment; its library and its shared numbers are kept in a folder.

    Raises
    ------
    subprocess.CalledProcessError
        The library cannot be compiled.
    """

    def __init__(self, folder: Path) -> None:
        self._library, self._file = folder / "lossy_network.so", folder / "lossy_network"
        self._profile = folder / "lossy_network.xml"
        self._profile.write_text(PROFILE, encoding="utf-8")
        words = ["cc", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", str(self._library), str(SOURCE), "-ldl"]
        subprocess.run(words, check=True)
        self._shared = np.memmap(self._file, "<u8", "w+", shape=(5,))

    def disturb(self, loss: float, delay: float = 0.0) -> None:
        """Lose and delay these shares of the datagrams from now on, 0 to 1; a loss of 1 cuts its processes off."""
        self._shared[_LOSS], self._shared[_DELAY] = round(_MILLION * loss), round(_MILLION * delay)

    def environment(self, environment: Mapping[str, str]) -> dict[str, str]:
        """Variables of nodes that talk over this network."""
        return {
            **environment,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            launch_plan.PROFILES: str(self._profile),
            "LD_PRELOAD": str(self._library),
            "LOSSY_NETWORK": str(self._file),
        }

    def counts(self) -> tuple[int, int, int]:
        """Datagrams that were sent, and those of them that were lost and delayed."""
        sent, lost, delayed = self._shared[_COUNTS]
        return int(sent), int(lost), int(delayed)

# SPDX-License-Identifier: Apache-2.0
"""Innovations: differences between measurements of a source and the values that the estimator expected."""

from __future__ import annotations

import math
from typing import NamedTuple


class Innovation(NamedTuple):
    """Innovations of one source; the fields are those of mwd_msgs/Innovation."""

    source: str  #: name of the source of measurements
    #: Last innovation divided by its 1 sigma; without a gate, the root mean square of these ratios. NaN: none yet.
    innovation: float = math.nan
    gate: float = 0.0  #: number of sigmas beyond which a measurement is rejected; 0: no gate
    #: Numbers of measurements: `used`; `rejected`, because beyond the gate; `disturbed`, left out because the magnetic
    #: field did not match the reference.
    used: int = 0
    rejected: int = 0
    disturbed: int = 0

    @property
    def test_ratio(self) -> float:
        """Squared ratio of innovation to gate (above 1: rejected); without a gate, squared innovation (expected: 1)."""
        return (self.innovation / (self.gate or 1.0)) ** 2


def of_power(source: str, power: float) -> Innovation:
    """Return the record of a source without a gate; power: mean square of innovation / sigma, 0 before the first."""
    return Innovation(source, math.sqrt(power)) if power > 0.0 else Innovation(source)

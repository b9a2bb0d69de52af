# SPDX-License-Identifier: Apache-2.0
"""Differences between what the estimator expected of a source of measurements and what it received."""

from __future__ import annotations

import math
from typing import NamedTuple


class Innovation(NamedTuple):
    """Innovations of one source; the fields are those of mwd_msgs/Innovation."""

    source: str
    #: Last innovation divided by its 1 sigma, or their root mean square if there is no gate; NaN: none yet.
    innovation: float = math.nan
    gate: float = 0.0  #: sigma beyond which a measurement is rejected; 0: no gate
    #: Numbers of measurements: `used`; `rejected`, because beyond the gate; `disturbed`, left out because the magnetic
    #: field did not match the reference.
    used: int = 0
    rejected: int = 0
    disturbed: int = 0

    @property
    def test_ratio(self) -> float:
        """Squared ratio of innovation to gate (above 1: rejected); without a gate, squared innovation (1 expected)."""
        return (self.innovation / (self.gate or 1.0)) ** 2


def of_power(source: str, power: float) -> Innovation:
    """Return the innovations of a source from their mean square (1 expected; 0 if there were none yet)."""
    return Innovation(source, math.sqrt(power)) if power > 0.0 else Innovation(source)

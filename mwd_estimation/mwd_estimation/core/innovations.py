# SPDX-License-Identifier: Apache-2.0
"""What the estimator expected of a source of measurements and what it found."""

from __future__ import annotations

import math
from typing import NamedTuple


class Innovation(NamedTuple):
    """One source; fields as in mwd_msgs/Innovation."""

    source: str
    #: Last one over its 1 sigma, or their root mean square where there is no gate; NaN: none yet.
    innovation: float = math.nan
    gate: float = 0.0  #: sigma beyond which a measurement is rejected; 0: there is none
    #: `used`, `rejected`, `disturbed`: measurements taken in, beyond the gate, and left out because the field was not
    #: the reference's.
    used: int = 0
    rejected: int = 0
    disturbed: int = 0

    @property
    def test_ratio(self) -> float:
        """Square of innovation over gate, above 1 rejected; without a gate that of the innovation, 1 expected."""
        return (self.innovation / (self.gate or 1.0)) ** 2


def of_power(source: str, power: float) -> Innovation:
    """Return the innovations of a source by their mean square, 1 expected; 0: none yet."""
    return Innovation(source, math.sqrt(power)) if power > 0.0 else Innovation(source)

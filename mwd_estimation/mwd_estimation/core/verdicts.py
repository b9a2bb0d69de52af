# SPDX-License-Identifier: Apache-2.0
"""Names of the verdicts on a survey, and the worse of two verdicts."""

from __future__ import annotations

import math

ACCEPT, DOUBTFUL, REJECT = "accept", "doubtful", "reject"
# Verdict on a quantity that is not defined at the attitude of a station, such as the azimuth of a vertical hole.
NOT_DETERMINED = "not_determined"
#: Change of the azimuth, rad, below which a survey does not count as revised.
MOVED = math.radians(0.05)


def worse(a: str, b: str) -> str:
    """Return the worse of two verdicts; "not determined" counts less than any other verdict."""
    order = (NOT_DETERMINED, ACCEPT, DOUBTFUL, REJECT)
    return order[max(order.index(a), order.index(b))]

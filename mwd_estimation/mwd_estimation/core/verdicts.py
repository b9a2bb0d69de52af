# SPDX-License-Identifier: Apache-2.0
"""Words for verdicts, and which of two verdicts is worse."""

from __future__ import annotations

ACCEPT, DOUBTFUL, REJECT = "accept", "doubtful", "reject"
# For one quantity: it is not defined at this attitude.
NOT_DETERMINED = "not_determined"


def worse(a: str, b: str) -> str:
    """Return the worse of two verdicts; "not determined" counts less than any other verdict."""
    order = (NOT_DETERMINED, ACCEPT, DOUBTFUL, REJECT)
    return order[max(order.index(a), order.index(b))]

# SPDX-License-Identifier: Apache-2.0
"""The words of a verdict, and which of two is the graver."""

from __future__ import annotations

ACCEPT, DOUBTFUL, REJECT = "accept", "doubtful", "reject"
# Of one quantity: this attitude does not define it.
NOT_DETERMINED = "not_determined"


def worse(a: str, b: str) -> str:
    """The graver of two verdicts; one that says something goes before one of a quantity that is not determined."""
    order = (NOT_DETERMINED, ACCEPT, DOUBTFUL, REJECT)
    return order[max(order.index(a), order.index(b))]

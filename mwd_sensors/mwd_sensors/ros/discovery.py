# SPDX-License-Identifier: Apache-2.0
"""
Wait for subscribers before the first message.

Discovery finds one subscriber after the other; the last one found would miss the first messages.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# Time without a new subscriber after which discovery counts as complete, s. A reader drops what arrives before it knows
# the writer; on a busy machine it may learn of the writer a second or two after the writer learnt of the reader.
_QUIET_S = 3.0


class SubscriberDiscovery:
    """
    Decides when the subscribers of some publishers have been found.

    Parameters
    ----------
    now : float
        Steady time of the start, s.
    timeout : float
        Longest wait, s.
    """

    def __init__(self, now: float, timeout: float) -> None:
        self._deadline = now + timeout
        self._changed_at = now
        self._count = 0

    def complete(self, publishers: Iterable[Any], now: float) -> bool:
        """Whether to begin: there are subscribers and none was added lately, or the wait has timed out."""
        if now >= self._deadline:
            return True
        count = sum(publisher.get_subscription_count() for publisher in publishers)
        if count != self._count:
            self._count, self._changed_at = count, now
        return count > 0 and now - self._changed_at >= _QUIET_S

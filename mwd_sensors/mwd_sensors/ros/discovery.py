# SPDX-License-Identifier: Apache-2.0
"""
Wait until subscribers are found before the first message is published.

Discovery finds the subscribers one after the other; without waiting, the last one would miss the first messages.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# Discovery counts as complete when no new subscriber appeared for this time, s. A reader drops messages from a writer
# that it has not discovered yet. On a busy machine the reader may discover the writer a second or two later than the
# writer discovers the reader.
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
        """Return True if there are subscribers and none was added for `_QUIET_S`, or if the wait has timed out."""
        if now >= self._deadline:
            return True
        count = sum(publisher.get_subscription_count() for publisher in publishers)
        if count != self._count:
            self._count, self._changed_at = count, now
        return count > 0 and now - self._changed_at >= _QUIET_S

"""Wait until everybody listens: discovery finds one subscriber after the other, and the last would miss the start."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# Without a new listener before all are taken to be there. A reader drops what comes before it knows the writer; on a
# busy machine it may learn of it a second or two after the writer learnt of the reader.
_JOINING_S = 3.0


class Listeners:
    """
    Counts the subscribers of some publishers.

    Parameters
    ----------
    now : float
        Steady time, s, from which on is waited.
    patience : float
        Wait no longer than this, s.
    """

    def __init__(self, now: float, patience: float) -> None:
        self._until = now + patience
        self._joined = now
        self._count = 0

    def complete(self, publishers: Iterable[Any], now: float) -> bool:
        """Whether to begin: somebody listens and nobody joined for a while, or the patience is over."""
        if now >= self._until:
            return True
        count = sum(publisher.get_subscription_count() for publisher in publishers)
        if count != self._count:
            self._count, self._joined = count, now
        return count > 0 and now - self._joined >= _JOINING_S

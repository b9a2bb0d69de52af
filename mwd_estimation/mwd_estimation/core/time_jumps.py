# SPDX-License-Identifier: Apache-2.0
"""
Stamps that go back: a recording that loops or is wound back, a clock that was set; and single stamps that are wrong.

The leading stream (the AHRS) decides. One of its samples more than a second before the last is rejected; when a few in
a row advance from there, time has gone back, and the estimate begins anew with exactly those samples. The other streams
may change their time before or after the leader: samples that are already of the new time wait for the leader, samples
that are still of the old time are dropped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Samples, Stamps

BACK_NS = 1_000_000_000
# Samples in a row that confirm a new time.
CONFIRMED = 3
MOST_AHEAD = 500_000
"""
Samples kept of a stream that runs ahead of the leader; more means that the leader does not follow.

A smoother holds 60 000 samples of the leader back, beside which a stream of seven times its rate is kept whole.
"""
_NONE = np.iinfo(np.int64).min


def advances(stamps: Stamps, newest_ns: int) -> NDArray[np.bool_]:
    """Which samples are later than all before them, shape (n,); newest_ns: the latest stamp before the block."""
    return np.asarray(stamps > np.maximum.accumulate(np.concatenate([[newest_ns], stamps]))[:-1])


class Clocks:
    """
    The time of one leading stream and of those beside it.

    Attributes
    ----------
    dropped : int
        Samples of other streams that were of no time in use.
    went_back : list of (int, int)
        The leader's latest stamp before time went back and its first one after that, ns, each time.
    """

    def __init__(self) -> None:
        self._lead_ns = _NONE
        self._back: list[Samples] = []
        self._last: dict[str, int] = {}
        self._ahead: dict[str, list[Samples]] = {}
        self._behind: set[str] = set()
        self.dropped = 0
        self.went_back: list[tuple[int, int]] = []

    def lead(self, samples: Samples) -> list[tuple[Samples, Samples | None]]:
        """
        Cut a block of the leading stream where time goes back.

        Returns
        -------
        list of (samples, new)
            `samples` belong to the time so far (rejected ones included); where `new` is not None, time goes back behind
            them and begins anew with `new`: their last few, which were rejected until then.
        """
        stamps = samples["stamp_ns"]
        if not len(stamps):
            return [(samples, None)]
        if not self._back and stamps[0] > self._lead_ns - BACK_NS and not (np.diff(stamps) < -BACK_NS).any():
            self._lead_ns = max(self._lead_ns, int(stamps.max()))
            return [(samples, None)]
        pieces: list[tuple[Samples, Samples | None]] = []
        start = 0
        for i, stamp in enumerate(stamps.tolist()):
            if stamp > self._lead_ns - BACK_NS:
                self._back = []
                self._lead_ns = max(self._lead_ns, stamp)
                continue
            if self._back and stamp <= int(self._back[-1]["stamp_ns"][0]):
                self._back = []
            self._back.append(samples[i : i + 1].copy())
            if len(self._back) == CONFIRMED:
                begun = np.concatenate(self._back)
                pieces.append((samples[start : i + 1], begun))
                self.went_back.append((self._lead_ns, int(begun["stamp_ns"][0])))
                self._lead_ns, self._back, start = stamp, [], i + 1
                self._behind = set(self._last) - set(self._ahead)
        pieces.append((samples[start:], None))
        return pieces

    def beside(self, name: str, samples: Samples) -> Samples:
        """Return the samples of another stream that belong to the leader's time; the rest waits or is dropped."""
        stamps = samples["stamp_ns"]
        if not len(stamps):
            return samples
        last = self._last.get(name, _NONE)
        usual = name not in self._ahead and name not in self._behind
        if usual and stamps[0] > last - BACK_NS and not (np.diff(stamps) < -BACK_NS).any():
            self._last[name] = max(last, int(stamps.max()))
            return samples
        keep = np.zeros(len(stamps), dtype=bool)
        for i, stamp in enumerate(stamps.tolist()):
            keep[i] = self._belongs(name, stamp, samples[i : i + 1])
        return samples[keep]

    def _belongs(self, name: str, stamp: int, sample: Samples) -> bool:
        if name in self._behind:
            # Still of the time before; a sample near the leader is of its time, even if it comes after a data gap.
            if stamp > self._lead_ns + BACK_NS and stamp > self._last[name] - BACK_NS:
                self._last[name] = max(self._last[name], stamp)
                self.dropped += 1
                return False
            self._behind.discard(name)
            self._last[name] = stamp
            return True
        last = self._last.get(name, _NONE)
        if stamp > last - BACK_NS and len(self._ahead.get(name, [])) < CONFIRMED:
            # The stamps before were wrong, or nothing has changed.
            self._ahead.pop(name, None)
            self._last[name] = max(last, stamp)
            return True
        held = self._ahead.setdefault(name, [])
        if len(held) < MOST_AHEAD:
            held.append(sample.copy())
        else:
            self.dropped += 1
        return False

    def release(self) -> dict[str, Samples]:
        """Return the samples of each stream that waited for the leader to go back; to be called once it has."""
        waiting = {name: np.concatenate(held) for name, held in self._ahead.items() if held}
        self._ahead = {}
        for name, samples in waiting.items():
            self._last[name] = int(samples["stamp_ns"].max())
        return waiting

# SPDX-License-Identifier: Apache-2.0
"""
Stamps that jump: a data gap, a recording that loops or is wound back, a clock that was set; and single wrong stamps.

A stamp more than a second off the last one, either way, is a new time only when a few in a row advance from there.
The leading stream (the AHRS) decides. After a jump forward it goes on; of the samples that had to confirm the jump all
but the last are rejected. When its time has gone back the estimate begins anew with exactly the samples that showed it.
The other streams may change their time before or after the leader: samples that are already of a new time wait for the
leader to come there, from whichever side, and samples that are still of an old time are dropped. Where a stream returns
to the time it came from before the leader has followed, only its clock was wrong: what waited is dropped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Samples, Stamps

BACK_NS = 1_000_000_000
# Samples in a row that confirm a new time.
CONFIRMED = 3
# A slow stream may step farther than `BACK_NS`: up to this multiple of its last step.
_PACES = 4
MOST_AHEAD = 500_000
"""
Samples kept of a stream that runs ahead of the leader; more means that the leader does not follow.

A smoother holds 60 000 samples of the leader back, beside which a stream of seven times its rate is kept whole.
"""
_NONE = np.iinfo(np.int64).min


def advances(stamps: Stamps, newest_ns: int) -> NDArray[np.bool_]:
    """Which samples are later than all before them, shape (n,); newest_ns: the latest stamp before the block."""
    return np.asarray(stamps > np.maximum.accumulate(np.concatenate([[newest_ns], stamps]))[:-1])


class _Pace:
    """Time of one stream: its latest stamp, and how far a step may go without being confirmed."""

    def __init__(self) -> None:
        self.last_ns = _NONE
        self._step = 0

    def follows(self, stamp: int) -> bool:
        """Whether a stamp is near the latest one."""
        if self.last_ns == _NONE:
            return True
        return -BACK_NS < stamp - self.last_ns <= max(BACK_NS, _PACES * self._step)

    def take(self, stamp: int) -> None:
        """Accept a stamp that is near the latest one."""
        if stamp > self.last_ns:
            self._step = stamp - self.last_ns if self.last_ns != _NONE else 0
            self.last_ns = stamp

    def begin(self, stamp: int, step: int) -> None:
        """Go on from a stamp that was confirmed, after the last step before it."""
        self.last_ns, self._step = stamp, step

    def take_block(self, stamps: Stamps) -> bool:
        """Accept a block of stamps that each follow the one before; return False, and accept none, otherwise."""
        first = int(stamps[0]) if self.last_ns == _NONE else self.last_ns
        latest = np.maximum.accumulate(np.concatenate([[first], stamps]))
        if not ((stamps > latest[:-1] - BACK_NS) & (stamps <= latest[:-1] + BACK_NS)).all():
            return False
        steps = np.diff(latest)
        steps = steps[steps > 0]
        self._step = int(steps[-1]) if len(steps) else self._step
        self.last_ns = int(latest[-1])
        return True


class _Beside:
    """A stream other than the leader: its pace, its waiting samples, and samples that jump away from these."""

    def __init__(self) -> None:
        self.pace = _Pace()
        self.waiting: list[Samples] = []
        self.jump: list[Samples] = []

    @property
    def first_ns(self) -> int:
        """Stamp of the first sample that waits."""
        return int(self.waiting[0]["stamp_ns"][0])

    @property
    def step_ns(self) -> int:
        """Last step between samples that wait."""
        return int(self.waiting[-1]["stamp_ns"][0]) - int(self.waiting[-2]["stamp_ns"][0])

    @property
    def is_ahead(self) -> bool:
        """Whether the waiting samples confirm a new time that the leader has not reached yet."""
        return len(self.waiting) >= CONFIRMED

    def released(self) -> Samples:
        """Remove and return the waiting samples; the stream continues from the last of them."""
        samples, self.waiting, self.jump = np.concatenate(self.waiting), [], []
        stamps = samples["stamp_ns"]
        self.pace.begin(int(stamps.max()), int(stamps[-1] - stamps[-2]) if len(stamps) > 1 else 0)
        return samples


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
        self._lead = _Pace()
        self._pending: list[Samples] = []
        self._others: dict[str, _Beside] = {}
        self._behind: set[str] = set()
        self.dropped = 0
        self.went_back: list[tuple[int, int]] = []

    def lead(self, samples: Samples) -> list[tuple[Samples, Samples | None]]:
        """
        Cut a block of the leading stream where time goes back.

        Returns
        -------
        list of (samples, new)
            `samples` belong to the time so far (rejected ones included; a stamp that jumps ahead unconfirmed is set to
            the latest one, so that nothing behind takes it for the time); where `new` is not None, time goes back
            behind them and begins anew with `new`: their last few, which were rejected until then.
        """
        stamps = samples["stamp_ns"]
        if not len(stamps) or (not self._pending and self._lead.take_block(stamps)):
            return [(samples, None)]
        pieces: list[tuple[Samples, Samples | None]] = []
        start, own = 0, samples
        for i, stamp in enumerate(stamps.tolist()):
            if self._lead.follows(stamp):
                self._pending = []
                self._lead.take(stamp)
                continue
            self._pending = _in_a_row(self._pending, samples[i : i + 1])
            forward = stamp > self._lead.last_ns
            confirmed = len(self._pending) == CONFIRMED
            if confirmed and forward:
                self._lead.begin(stamp, stamp - int(self._pending[-2]["stamp_ns"][0]))
                self._pending = []
            elif confirmed:
                begun = np.concatenate(self._pending)
                pieces.append((own[start : i + 1], begun))
                self.went_back.append((self._lead.last_ns, int(begun["stamp_ns"][0])))
                self._lead.begin(stamp, stamp - int(begun["stamp_ns"][-2]))
                self._pending, start = [], i + 1
                self._behind = {name for name, other in self._others.items() if not other.is_ahead}
            elif forward:
                own = samples.copy() if own is samples else own
                own["stamp_ns"][i] = self._lead.last_ns
        pieces.append((own[start:], None))
        return pieces

    def beside(self, name: str, samples: Samples) -> Samples:
        """Return the samples of another stream that belong to the leader's time; the rest waits or is dropped."""
        stamps = samples["stamp_ns"]
        if not len(stamps):
            return samples
        other = self._others.setdefault(name, _Beside())
        if not other.waiting and name not in self._behind and other.pace.take_block(stamps):
            return samples
        taken = [self._taken(name, other, samples[i : i + 1]) for i in range(len(stamps))]
        return np.concatenate([samples[:0], *taken])

    def _taken(self, name: str, other: _Beside, sample: Samples) -> Samples:
        """Return the samples of a stream that can be used now that this one has come."""
        pace, stamp = other.pace, int(sample["stamp_ns"][0])
        if name in self._behind:
            # Still of the time before; a sample near the leader is of its time, even if it comes after a data gap.
            if stamp > self._lead.last_ns + BACK_NS and stamp > pace.last_ns - BACK_NS:
                pace.take(stamp)
                self.dropped += 1
                return sample[:0]
            self._behind.discard(name)
            other.waiting = []
            pace.begin(stamp, 0)
            return sample
        if not other.is_ahead and pace.follows(stamp):
            # The stamps before were wrong, or nothing has changed.
            self.dropped += len(other.waiting)
            other.waiting = []
            pace.take(stamp)
            return sample
        if not other.is_ahead:
            before = len(other.waiting)
            other.waiting = _in_a_row(other.waiting, sample)
            self.dropped += before + 1 - len(other.waiting)
            return sample[:0]
        if abs(stamp - int(other.waiting[-1]["stamp_ns"][0])) <= max(BACK_NS, _PACES * other.step_ns):
            self.dropped += len(other.jump)
            other.jump = []
            if len(other.waiting) < MOST_AHEAD:
                other.waiting.append(sample.copy())
            else:
                self.dropped += 1
            return sample[:0]
        other.jump = _in_a_row(other.jump, sample)
        if len(other.jump) < CONFIRMED:
            return sample[:0]
        # The stream jumped back to its earlier time, or jumped again to a third time.
        self.dropped += len(other.waiting)
        other.waiting, other.jump = other.jump, []
        returns = pace.last_ns - BACK_NS < other.first_ns <= self._lead.last_ns + BACK_NS
        return other.released() if returns else sample[:0]

    def reached(self, before_ns: int) -> dict[str, Samples]:
        """
        Return the samples of each stream that waited and that the leader has come to; it was at `before_ns`, ns.

        A stream whose clock was ahead and is right again waits no longer than to the leader's next sample.
        """
        found = {}
        for name, other in self._others.items():
            if not other.is_ahead:
                continue
            newest = int(other.waiting[-1]["stamp_ns"][0])
            if before_ns - BACK_NS < newest and other.first_ns <= self._lead.last_ns + BACK_NS:
                found[name] = other.released()
        return found

    @property
    def lead_ns(self) -> int:
        """Latest stamp of the leader, ns; far before any where none came."""
        return self._lead.last_ns

    def release(self) -> dict[str, Samples]:
        """Return the samples of each stream that waited for the leader to go back; to be called once it has."""
        return {name: other.released() for name, other in self._others.items() if other.is_ahead}


def _in_a_row(pending: list[Samples], sample: Samples) -> list[Samples]:
    """Add a sample to those before it; where it does not advance from them it is the first of its own."""
    follows = pending and sample["stamp_ns"][0] > pending[-1]["stamp_ns"][0]
    return [*pending, sample.copy()] if follows else [sample.copy()]

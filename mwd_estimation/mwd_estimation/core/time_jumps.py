# SPDX-License-Identifier: Apache-2.0
"""
Detect jumps in time: a data gap, a recording that loops or is wound back, a clock that was set, or single wrong stamps.

A stamp more than a second before or after the last one counts as a new time only when CONFIRMED stamps in a row advance
from there. One stream, that of the conventional unit, is the leader. If the leader jumps forward, the estimate
continues; the samples that confirm the jump are rejected, except the last. If the leader jumps back, the estimate
restarts with exactly the samples that confirmed the jump, and with the samples of other streams at this time.

The other streams may jump earlier or later than the leader. Their samples of the new time wait until the leader reaches
this time, even across further data gaps. Their samples of the old time are dropped after the leader has jumped. If a
stream returns to its old time before the leader has followed, only the clock of the stream was wrong, and the waiting
samples are dropped.

If the clock is set back by the length of a data gap of the leader, the stamps of the leader go on as if nothing had
happened. Then only another stream shows that time went back: it goes back to the time at which the leader is. The
estimate restarts too, because it does not know how the tool turned during the gap, and with it all streams.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Samples, Stamps
from mwd_sensors.core.compiled import compiled

# Largest step forward or back that needs no confirmation, ns.
BACK_NS = 1_000_000_000
# Number of samples in a row that confirm a new time.
CONFIRMED = 3
# The step of a slow stream may be longer than `BACK_NS`, up to this multiple of its previous step.
_PACES = 4
# Longest first step of a stream other than the leader, ns: a thermometer sends once a second to once a minute, and its
# sample rate is not known at the first step.
_FIRST_STEP_NS = 60_000_000_000
# Smallest step back of a stream, and shortest silence of the leader in the time of this stream, that can show a jump
# which the leader does not show, ns. The silence is longer than a block, because the leader may be a block behind.
_SILENT_NS = 5_000_000_000
MOST_AHEAD = 500_000
"""
Largest number of waiting samples of a stream that is ahead of the leader; later samples are dropped.

A smoother delays 60 000 samples of the leader; in this time a stream with seven times the leader's rate still fits.
"""
_NONE = np.iinfo(np.int64).min


def advances(stamps: Stamps, newest_ns: int) -> NDArray[np.bool_]:
    """
    Return a mask of the samples that are later than all earlier samples, shape (n,).

    stamps: ns, shape (n,); newest_ns: latest stamp before the block.
    """
    return np.asarray(stamps > np.maximum.accumulate(np.concatenate([[newest_ns], stamps]))[:-1])


class _Pace:
    """Clock of one stream: its latest stamp, and its last step, which limits the next step without confirmation."""

    def __init__(self, first_step_ns: int = BACK_NS) -> None:
        self.last_ns = _NONE
        # `follows` accepts a step of `_PACES` times the last step, so the first step may be `first_step_ns`.
        self._step = first_step_ns // _PACES

    def follows(self, stamp: int) -> bool:
        """Return whether a stamp, ns, is near the latest one, so that it needs no confirmation."""
        if self.last_ns == _NONE:
            return True
        return -BACK_NS < stamp - self.last_ns <= max(BACK_NS, _PACES * self._step)

    def take(self, stamp: int) -> None:
        """Accept a stamp that is near the latest one."""
        if stamp > self.last_ns:
            self._step = stamp - self.last_ns if self.last_ns != _NONE else self._step
            self.last_ns = stamp

    def begin(self, stamp: int, step: int | None = None) -> None:
        """Continue from a confirmed stamp; step: step before this stamp, ns; None keeps the last step."""
        self.last_ns, self._step = stamp, self._step if step is None else step

    def take_block(self, stamps: Stamps) -> bool:
        """Accept a block and return True if each stamp is within BACK_NS of the latest one; else only return False."""
        first = int(stamps[0]) if self.last_ns == _NONE else self.last_ns
        near, latest, step = _near(np.ascontiguousarray(stamps), first)
        if near:
            self.last_ns, self._step = latest, step or self._step
        return bool(near)


@compiled
def _near(stamps: Stamps, latest: int) -> tuple[bool, int, int]:
    """Return whether each stamp is within BACK_NS of the latest earlier one, the latest stamp and the last step, ns."""
    step = 0
    for stamp in stamps:
        if not latest - BACK_NS < stamp <= latest + BACK_NS:
            return False, latest, step
        if stamp > latest:
            step, latest = stamp - latest, stamp
    return True, latest, step


class _Beside:
    """Stream other than the leader: clock, waiting samples, and samples whose stamps jump from the waiting ones."""

    def __init__(self) -> None:
        self.pace = _Pace(_FIRST_STEP_NS)
        self.waiting: list[Samples] = []
        self.jump: list[Samples] = []
        # Latest stamp of the stream when the last block of the leader came, ns, before samples that wait.
        self.met_ns = _NONE

    def meet(self) -> None:
        """Record where the stream is when a block of the leader comes."""
        if not self.waiting:
            self.met_ns = self.pace.last_ns

    def lone_ns(self, lead_ns: int) -> int:
        """
        Return the time by which the stream has advanced since it was beside the leader, ns; 0 if it was not.

        lead_ns: latest stamp of the leader, ns.
        """
        if abs(self.met_ns - lead_ns) > _SILENT_NS:
            return 0
        waited = int(self.waiting[-1]["stamp_ns"][0]) - self.first_ns if self.waiting else 0
        return self.pace.last_ns - self.met_ns + waited

    @property
    def first_ns(self) -> int:
        """Stamp of the first waiting sample, ns."""
        return int(self.waiting[0]["stamp_ns"][0])

    @property
    def step_ns(self) -> int:
        """Last step between waiting samples, ns."""
        return int(self.waiting[-1]["stamp_ns"][0]) - int(self.waiting[-2]["stamp_ns"][0])

    @property
    def is_ahead(self) -> bool:
        """Whether the waiting samples confirm a new time that the leader has not reached yet."""
        return len(self.waiting) >= CONFIRMED

    def is_at(self, stamp: int) -> bool:
        """
        Return whether the waiting samples confirm a new time, or are near the leader, whose latest stamp, ns, is given.

        The leader has confirmed its time, so samples near its stamp need no confirmation of their own.
        """
        near = bool(self.waiting) and abs(int(self.waiting[-1]["stamp_ns"][0]) - stamp) <= BACK_NS
        return near or self.is_ahead

    def released(self) -> Samples:
        """
        Remove and return the waiting samples; the stream continues from the last of them.

        Samples whose stamps jump from the waiting ones wait from now on.
        """
        samples, self.waiting, self.jump = np.concatenate(self.waiting), self.jump, []
        stamps = samples["stamp_ns"]
        self.pace.begin(int(stamps.max()), int(stamps[-1] - stamps[-2]) if len(stamps) > 1 else None)
        return samples


class Clocks:
    """Clocks of the leading stream and of all other streams."""

    def __init__(self) -> None:
        self._lead = _Pace()
        self._pending: list[Samples] = []
        self._others: dict[str, _Beside] = {}
        self._behind: set[str] = set()
        #: Number of samples of other streams that were dropped because their stamps do not belong to the leader's time.
        self.dropped = 0
        #: For each jump back, the latest stamp before the jump and the first stamp after the jump, ns: of the leader,
        #: or of the stream that showed a jump which the leader does not show.
        self.went_back: list[tuple[int, int]] = []
        #: Whether another stream has shown such a jump; the caller restarts the estimate and sets it to False.
        self.hidden_jump = False

    def lead(self, samples: Samples) -> list[tuple[Samples, Samples | None]]:
        """
        Cut a block of the leading stream where time jumps back.

        Returns
        -------
        list of (samples, new)
            `samples` belong to the time so far; samples whose jump is not confirmed are among them. An unconfirmed
            stamp far ahead is replaced by one just before the latest stamp, so that later stages do not use the sample.
            If `new` is not None, time jumps back after `samples` and restarts with `new`: the samples that confirmed
            the jump.
        """
        stamps = samples["stamp_ns"]
        if not len(stamps):
            return [(samples, None)]
        for other in self._others.values():
            other.meet()
        if not self._pending and self._lead.take_block(stamps):
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
                self._behind = {name for name, other in self._others.items() if not other.is_at(stamp)}
            elif forward:
                own = samples.copy() if own is samples else own
                own["stamp_ns"][i] = self._lead.last_ns - 1
        pieces.append((own[start:], None))
        return pieces

    def beside(self, name: str, samples: Samples) -> Samples:
        """Return the samples of another stream that belong to the leader's time; other samples wait or are dropped."""
        stamps = samples["stamp_ns"]
        if not len(stamps):
            return samples
        other = self._others.setdefault(name, _Beside())
        if not other.waiting and name not in self._behind and other.pace.take_block(stamps):
            return samples
        taken: list[Samples] = []
        for i in range(len(stamps)):
            before = len(self.went_back)
            found = self._taken(name, other, samples[i : i + 1])
            # Samples before a jump of time do not belong to the estimate after it.
            taken = [found] if len(self.went_back) > before else [*taken, found]
        return np.concatenate([samples[:0], *taken])

    def _taken(self, name: str, other: _Beside, sample: Samples) -> Samples:
        """Process one sample of a stream; return the samples of this stream that can be used now."""
        pace, stamp = other.pace, int(sample["stamp_ns"][0])
        if name in self._behind:
            # The leader has jumped back, but this stream has not: drop its samples of the old time. A sample near the
            # latest stamp of the leader belongs to the new time, even after a data gap.
            if stamp > self._lead.last_ns + BACK_NS and stamp > pace.last_ns - BACK_NS:
                pace.take(stamp)
                self.dropped += 1
                return sample[:0]
            self._behind.discard(name)
            other.waiting = []
            pace.begin(stamp)
            return sample
        follows, at_hand = pace.follows(stamp), abs(stamp - self._lead.last_ns) <= BACK_NS
        # The stream went on while the leader was silent.
        went_on = other.lone_ns(self._lead.last_ns) > _SILENT_NS
        if not other.is_ahead and (follows or (at_hand and not went_on)):
            # There was no jump, or the leader has confirmed it already; so the stamps of waiting samples were wrong.
            self.dropped += len(other.waiting)
            other.waiting = []
            if follows:
                pace.take(stamp)
            else:
                pace.begin(stamp)
            return sample
        if not other.is_ahead:
            before = len(other.waiting)
            other.waiting = _in_a_row(other.waiting, sample)
            self.dropped += before + 1 - len(other.waiting)
            return self._jumped_unseen(name, other) if at_hand and other.is_ahead else sample[:0]
        if abs(stamp - int(other.waiting[-1]["stamp_ns"][0])) <= max(BACK_NS, _PACES * other.step_ns):
            self.dropped += len(other.jump)
            other.jump = []
            if len(other.waiting) < MOST_AHEAD:
                other.waiting.append(sample.copy())
            else:
                self.dropped += 1
            return self._jumped_unseen(name, other) if at_hand else sample[:0]
        other.jump = _in_a_row(other.jump, sample)
        if len(other.jump) < CONFIRMED:
            return sample[:0]
        begins_ns, newest_ns = int(other.jump[0]["stamp_ns"][0]), int(other.waiting[-1]["stamp_ns"][0])
        # Without the jump, the earlier time would have advanced as much as the new time has since then. A jump to about
        # that time is a return to the earlier time. Any other step forward is a data gap of the new time, even if it
        # goes beyond the latest stamp of the earlier time.
        expected_ns = pace.last_ns + (newest_ns - other.first_ns)
        returns = abs(begins_ns - expected_ns) <= max(BACK_NS, _PACES * other.step_ns)
        if not returns and begins_ns > newest_ns:
            # The new time has a data gap.
            other.waiting += other.jump
            other.jump = []
            return sample[:0]
        # The stream returned to its earlier time, or jumped again to a third time.
        self.dropped += len(other.waiting)
        other.waiting, other.jump = other.jump, []
        return other.released() if returns else sample[:0]

    def _jumped_unseen(self, name: str, other: _Beside) -> Samples:
        """
        Return the waiting samples of a stream, which are at the leader's time, if they show a jump back.

        The other streams that went on with it have not jumped back yet.
        """
        latest_ns, first_ns = other.pace.last_ns, other.first_ns
        if first_ns > latest_ns - _SILENT_NS or other.lone_ns(self._lead.last_ns) <= _SILENT_NS:
            return other.waiting[0][:0]
        self.went_back.append((latest_ns, first_ns))
        self.hidden_jump = True
        lead_ns = self._lead.last_ns
        self._behind = {
            one
            for one, stream in self._others.items()
            if one != name and stream.pace.last_ns > lead_ns + BACK_NS and not stream.is_at(lead_ns)
        }
        return other.released()

    def reached(self, before_ns: int) -> dict[str, Samples]:
        """
        Remove and return the waiting samples of each stream whose time the leader has reached, by name of the stream.

        before_ns: latest stamp of the leader before its last block. Thus a stream whose clock was ahead and is
        right again waits only until the next sample of the leader.
        """
        found = {}
        for name, other in self._others.items():
            if not other.is_at(self._lead.last_ns):
                continue
            newest = int(other.waiting[-1]["stamp_ns"][0])
            # If this stream went back, a leader that lags may pass the stamps of the waiting samples while it is still
            # in the old time. Release these samples only when the leader has passed the old time too.
            passed = other.first_ns > other.pace.last_ns or self._lead.last_ns > other.pace.last_ns + BACK_NS
            if passed and before_ns - BACK_NS < newest and other.first_ns <= self._lead.last_ns + BACK_NS:
                found[name] = other.released()
        return found

    @property
    def lead_ns(self) -> int:
        """Latest stamp of the leader, ns; the smallest integer before its first sample."""
        return self._lead.last_ns

    def release(self) -> dict[str, Samples]:
        """Remove and return, by stream, the samples that waited for the leader to jump back; call this after a jump."""
        at_hand = {name: other for name, other in self._others.items() if other.waiting and name not in self._behind}
        return {name: other.released() for name, other in at_hand.items()}


def _in_a_row(pending: list[Samples], sample: Samples) -> list[Samples]:
    """Return the pending samples and this sample if its stamp is later than theirs; otherwise this sample alone."""
    follows = pending and sample["stamp_ns"][0] > pending[-1]["stamp_ns"][0]
    return [*pending, sample.copy()] if follows else [sample.copy()]

# SPDX-License-Identifier: Apache-2.0
"""
Remove copies of samples, as sent by a second publisher on the same topic, in the live estimator and in `mwd process`.

A copy of a sample has the same readings as the sample. A message with the same readings and the same stamp is certainly
a copy. A second publisher with its own stamps is recognised when nearly all readings of the last messages came exactly
twice; the readings of a coarse sensor repeat too, but not exactly twice each. If the time of a topic goes back by more
than two seconds, a recording loops or was wound back; earlier messages are then forgotten, so that samples which are
played again do not count as copies.
The rule uses only a sample and the messages before it, in the order of arrival, so that the result does not depend on
how a stream is cut into blocks. After the first repeated reading, the samples of an IMU are held back until it is known
whether all readings repeat, because copies would disturb the estimate of the sample rate.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

Hashes = NDArray[np.int64]

# Number of messages in which a copy is searched: 5 s of two publishers at 100 Hz.
REMEMBERED = 1024
# Copies with other stamps are removed only if, among the last WATCHED messages, at least COPIES are the second message
# with the same readings and none is the third. If all messages come twice, half of them are second ones. If the
# readings of a coarse sensor repeat by chance, the share of second messages is below 1/e, and some are third (Poisson).
WATCHED, COPIES = 80, 36
# Kinds of samples; and verdicts on why the readings of a topic repeat.
_FRESH, _COPY, _SUSPECT = 0, 1, 2
_UNKNOWN, _BY_CHANCE, _ALL_TWICE = 0, 1, 2
_BUCKETS = 4096  # size of the table of hashes, a power of two
# If a stamp goes back by more than this, ns, time has gone back; a copy from a second publisher is never so late.
_BACK_NS = 2_000_000_000
_MIX = -7046029254386353131  # 2^64 divided by the golden ratio, as a signed number


class RepeatedState:
    """Hashes of the last messages of a topic, in a table with a chain for each bucket."""

    count: int  #: number of messages so far
    last_ns: int  #: stamp of the last message, ns
    numbers: Annotated[Hashes, REMEMBERED]  #: hash of the readings of message k, at index k modulo REMEMBERED
    stamped: Annotated[Hashes, REMEMBERED]  #: hash of the readings and the stamp of message k, at the same index
    before: Annotated[Hashes, REMEMBERED]  #: number (from 1) of the previous message in the same bucket; 0: none
    newest: Annotated[Hashes, _BUCKETS]  #: number of the newest message in a bucket
    #: Number of earlier messages with the same readings, at most 2, for each of the last WATCHED messages.
    copies: Annotated[NDArray[np.int64], WATCHED]
    verdict: int  #: why readings repeat: _ALL_TWICE (second publisher) or _BY_CHANCE; _UNKNOWN at first
    suspected: int  #: number of messages since the first repeated reading
    seconds: int  #: number of the last WATCHED messages that are the second one with the same readings
    thirds: int  #: number of the last WATCHED messages that are the third one, or a later one, with the same readings


STATE = dtype_of(RepeatedState)


class RepeatedSamples:
    """
    Filter that removes the copies among the samples of one topic.

    Parameters
    ----------
    hold : bool
        Hold samples back after the first repeated reading, until it is known whether all readings repeat.
    """

    def __init__(self, *, hold: bool = False) -> None:
        self.count = 0  #: number of samples removed so far
        self._state = np.zeros(1, dtype=STATE)
        self._state["verdict"] = _UNKNOWN if hold else _BY_CHANCE
        self._held: tuple[Stamps, Samples, NDArray[np.int64]] | None = None

    @property
    def first_log_ns(self) -> int | None:
        """Log time of the first sample that is held back, ns; None if no sample is held back."""
        return int(self._held[0][0]) if self._held is not None else None

    def take(self, log_ns: Stamps, samples: Samples, *, stamped: bool = True) -> tuple[Stamps, Samples]:
        """
        Return the log times, ns, and the samples that are not copies.

        Samples that are held back are returned by a later call. log_ns, samples: log times, ns, and samples in the
        order of arrival, with a field `stamp_ns`. stamped: whether equal stamps mean the same measurement.
        """
        if not len(samples):
            return log_ns, samples
        kind = np.zeros(len(samples), dtype=np.int64)
        _judge(self._state[0], _numbers(samples), samples["stamp_ns"].astype(np.int64), stamped, kind)
        if self._held is None and not kind.any():
            return log_ns, samples
        if self._held is not None:
            log_ns, kind = np.concatenate([self._held[0], log_ns]), np.concatenate([self._held[2], kind])
            samples = np.concatenate([self._held[1], samples])
        suspects = np.flatnonzero(kind == _SUSPECT) if self._state["verdict"][0] == _UNKNOWN else kind[:0]
        first = int(suspects[0]) if len(suspects) else len(kind)
        self._held = (log_ns[first:], samples[first:], kind[first:]) if first < len(kind) else None
        return self._kept(log_ns[:first], samples[:first], kind[:first])

    def finish(self) -> tuple[Stamps, Samples] | None:
        """Remove and return log times and samples that are still held back, without copies; None if no sample is."""
        held, self._held = self._held, None
        return None if held is None else self._kept(*held)

    def _kept(self, log_ns: Stamps, samples: Samples, kind: NDArray[np.int64]) -> tuple[Stamps, Samples]:
        all_twice = self._state["verdict"][0] == _ALL_TWICE
        kept = (kind == _FRESH) | ((kind == _SUSPECT) & (not all_twice))
        self.count += int(np.count_nonzero(~kept))
        return log_ns[kept], samples[kept]


def _numbers(samples: Samples) -> Array:
    """Return the readings of samples, shape (n, k), without stamps, covariances and orientation."""
    names = [
        name
        for name in samples.dtype.names or ()
        if name not in ("stamp_ns", "orientation") and not name.endswith("_covariance")
    ]
    columns = [samples[name] if samples[name].ndim == 2 else samples[name][:, None] for name in names]
    return np.concatenate(columns, axis=1, dtype=np.float64)


@compiled
def _judge(s: RepeatedState, numbers: Array, stamp_ns: Stamps, stamped: bool, kind: NDArray[np.int64]) -> None:
    """
    Fill `kind`, shape (n,), with _FRESH, _COPY or _SUSPECT for each sample, and update the state.

    numbers: readings, shape (n, k); stamp_ns: stamps, shape (n,); stamped: whether equal stamps mean the same
    measurement.
    """
    bits = numbers.view(np.int64)
    for k in range(len(bits)):
        if s.count > 0 and stamp_ns[k] < s.last_ns - _BACK_NS:
            _forget(s)
        s.last_ns = stamp_ns[k]
        own = 0
        for c in range(bits.shape[1]):
            own = _mixed(own, bits[k, c])
        timed = _mixed(own, stamp_ns[k])
        bucket = own & (_BUCKETS - 1)
        same, again = 0, False
        at = s.newest[bucket]
        while at > 0 and at > s.count - REMEMBERED and (same < 2 or not again):
            place = at % REMEMBERED
            if s.numbers[place] == own:
                same = min(same + 1, 2)
                again = again or s.stamped[place] == timed
            at = s.before[place]
        s.count += 1
        place = s.count % REMEMBERED
        s.numbers[place], s.stamped[place], s.before[place] = own, timed, s.newest[bucket]
        s.newest[bucket] = s.count
        watched = s.count % WATCHED
        s.seconds += (same == 1) - (s.copies[watched] == 1)
        s.thirds += (same == 2) - (s.copies[watched] == 2)
        s.copies[watched] = same
        all_twice = s.seconds >= COPIES and s.thirds == 0
        if s.verdict == _UNKNOWN:
            s.suspected += int(same > 0 or s.suspected > 0)
            if all_twice:
                s.verdict = _ALL_TWICE
            elif s.thirds > 0 or s.suspected > WATCHED:
                s.verdict = _BY_CHANCE
        if (again and stamped) or (same > 0 and all_twice):
            kind[k] = _COPY
        elif same > 0 and s.verdict == _UNKNOWN:
            kind[k] = _SUSPECT
        else:
            kind[k] = _FRESH


@compiled
def _forget(s: RepeatedState) -> None:
    """Forget all messages; keep the verdict on the topic."""
    s.count = s.suspected = s.seconds = s.thirds = 0
    s.newest[:] = 0
    s.copies[:] = 0


@compiled
def _mixed(found: int, bits: int) -> int:
    """Return the hash `found`, updated with another number."""
    found = (found ^ bits) * _MIX
    return found ^ (found >> 32)

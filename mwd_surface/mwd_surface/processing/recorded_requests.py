# SPDX-License-Identifier: Apache-2.0
"""
Requests to the estimator in a recording, repeated at the same samples so that the same surveys result.

The requests are surveys on request, rotary surveys and north seeks, a given reference field, and a restart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.surveys.recorded_list import EVENT_TYPE, EVENTS

# Longest time, ns, from the log time of a sample to the log time of a request that takes effect at the sample. If the
# stamps of a recording go back, samples from before that event have suitable stamps too; this limit excludes them.
_LATEST_NS = 10 * NANOSECONDS


@dataclasses.dataclass(frozen=True)
class RecordedRequest:
    """Request in a recording; it is repeated after the last sample that came before it."""

    #: `stamp_ns`, `log_ns`: stamp of the last sample before the request, and log time of the request's message
    stamp_ns: int
    log_ns: int
    kind: str
    apply: Callable[[Pipeline], Output | None]  #: action on the pipeline
    begins_anew: bool = False  #: restarts the estimate: later samples of the other sensors are needed again


def _take_survey(pipeline: Pipeline, event: Any) -> None:
    pipeline.request_survey(event.duration)


def _seek_north(pipeline: Pipeline, event: Any) -> None:
    pipeline.request_north(event.duration, event.mode)


def _use_reference(pipeline: Pipeline, event: Any) -> None:
    field = (event.total, event.dip, event.declination, event.convergence)
    pipeline.set_reference(Reference(*field, event.gravity if event.gravity > 0.0 else None, event.source))


# Number of the kind in OperatorEvent.msg -> kind as text, and action.
_KINDS: dict[int, tuple[str, Callable[[Pipeline, Any], Output | None]]] = {
    0: ("survey on request", _take_survey),
    1: ("north seek", _seek_north),
    2: ("end of a north seek", lambda pipeline, _: pipeline.requests.cancel_north()),
    3: ("rotary survey", lambda pipeline, event: pipeline.requests.start_rotary(event.duration)),
    4: ("end of a rotary survey", lambda pipeline, _: pipeline.requests.cancel_rotary()),
    5: ("reference field", _use_reference),
    6: ("restart of the estimate", lambda pipeline, _: pipeline.reset()),
    7: ("survey completed without the gyro", lambda pipeline, _: pipeline.finish()),
}
_FIELD_GIVEN, _RESET = 5, 6


class RecordedRequests:
    """
    The requests of one well in a recording, in order.

    Parameters
    ----------
    namespace : str
        Namespace of the well, with a slash at its end.
    begin_ns : int
        Log time before which requests are ignored.
    with_field : bool
        Whether to use a reference field given in the recording; false if the user asks for another one.
    """

    def __init__(self, bag: Bag, namespace: str, begin_ns: int, *, with_field: bool) -> None:
        self.remarks: list[str] = []  #: sentences on requests that are not repeated
        self._waiting: list[RecordedRequest] = []
        about = bag.topics.get(f"{namespace}{EVENTS}")
        if about is None or about.type_name != EVENT_TYPE:
            return
        for log_ns, _, _, data in bag.messages([about.name]):
            event = bag.decode(about.name, data)
            if event.kind not in _KINDS or not event.success or log_ns < begin_ns:
                continue
            if event.kind == _FIELD_GIVEN and not with_field:
                self.remarks.append(f"the field given live ({event.source}) is not used: the settings give another one")
                continue
            self._waiting.append(_request(log_ns, event))

    def cut(
        self, stamps: NDArray[np.int64], log_ns: NDArray[np.int64]
    ) -> Iterator[tuple[slice, list[RecordedRequest]]]:
        """
        Split samples at the requests, and yield the slice of each part with the requests that are due after the part.

        stamps, log_ns, shape (n,) : stamps and log times of the samples, ns.
        """
        start = 0
        while self._waiting:
            first = self._waiting[0]
            after = (stamps[start:] > first.stamp_ns) & (log_ns[start:] >= first.log_ns - _LATEST_NS)
            if not after.any():
                break
            stop = start + int(np.argmax(after))
            yield slice(start, stop), [self._waiting.pop(0)]
            start = stop
        yield slice(start, len(stamps)), []

    def rest(self) -> list[RecordedRequest]:
        """Remove and return the requests after the last sample."""
        waiting, self._waiting = self._waiting, []
        return waiting


def _request(log_ns: int, event: Any) -> RecordedRequest:
    kind, act = _KINDS[event.kind]
    stamp_ns = stamp_of(event.header.stamp)
    return RecordedRequest(stamp_ns, log_ns, kind, lambda pipeline: act(pipeline, event), event.kind == _RESET)

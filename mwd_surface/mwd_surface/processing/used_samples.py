# SPDX-License-Identifier: Apache-2.0
"""Check whether a recording holds the samples that the live estimator used, by its counters for each topic."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Mapping

from mwd_sensors.core import burst
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.message_record import stamp_of
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing.bag_input import Topics

TOPIC, TYPE = "used_samples", "mwd_msgs/msg/UsedSamples"


@dataclasses.dataclass
class _Count:
    """Sample counts of one run of the estimator on a topic: used live between two stamps, ns, and recorded."""

    first_ns: int
    last_ns: int
    used: int
    recorded: int = 0
    recorded_from_ns: int = 0


class UsedSamples:
    """
    Counts of the samples used live and of the samples in the recording.

    bag : Bag. namespace : namespace of the well, with a slash at its end.
    """

    def __init__(self, bag: Bag, namespace: str) -> None:
        self._counts: dict[str, list[_Count]] = {}
        self._singles = {f"{namespace}{name}": f"{namespace}{single}" for name, single in burst.TOPICS.items()}
        about = bag.topics.get(f"{namespace}{TOPIC}")
        if about is None or about.type_name != TYPE:
            return
        for _, _, _, data in bag.messages([about.name]):
            for one in bag.decode(about.name, data).topics:
                self._take_count(str(one.topic), stamp_of(one.first), stamp_of(one.last), int(one.samples))

    def _take_count(self, topic: str, first_ns: int, last_ns: int, used: int) -> None:
        """
        Add a count.

        A count that restarts at another stamp or with fewer samples belongs to another run of the estimator.
        """
        runs = self._counts.setdefault(topic, [])
        if runs and used >= runs[-1].used and first_ns == runs[-1].first_ns:
            runs[-1] = _Count(first_ns, last_ns, used)
        else:
            runs.append(_Count(first_ns, last_ns, used))

    def take(self, samples: Mapping[str | None, Samples]) -> None:
        """Count samples of the recording, by topic."""
        for topic, part in samples.items():
            stamps = part["stamp_ns"]
            for run in self._counts.get(self._singles.get(topic or "", topic or ""), ()):
                inside = stamps[(stamps >= run.first_ns) & (stamps <= run.last_ns)]
                if len(inside):
                    run.recorded += len(inside)
                    begin = int(inside.min())
                    run.recorded_from_ns = min(run.recorded_from_ns or begin, begin)

    def differences(self, topics: Topics) -> list[str]:
        """Return a sentence for each used topic whose recording differs from the samples used live."""
        found = []
        for topic in topics.all:
            single = self._singles.get(topic, topic)
            for run in self._counts.get(single, ()):
                if run.recorded == run.used:
                    continue
                more = run.recorded - run.used
                words = (
                    f"not the same input as live: the estimator used {run.used} samples of {single} from "
                    f"{_time(run.first_ns)} on, the recording holds {run.recorded} of this time"
                )
                late_s = (run.recorded_from_ns - run.first_ns) * 1e-9
                begins = f", the first {late_s:.3g} s later" if run.recorded and late_s > 0.0 else ""
                found.append(f"{words} ({abs(more)} {'more' if more > 0 else 'fewer'}{begins}): surveys may differ")
        return found


def _time(stamp_ns: int) -> str:
    moment = datetime.datetime.fromtimestamp(0, tz=datetime.UTC) + datetime.timedelta(seconds=stamp_ns * 1e-9)
    return f"{moment:%H:%M:%S}.{stamp_ns // 10**6 % 1000:03d}"

# SPDX-License-Identifier: Apache-2.0
"""The ring of the last samples: what lies around a time, also where the ring has wrapped."""

import numpy as np
import pytest

from mwd_estimation.core import ring


def filled(count, size=8):
    """A ring that has taken so many samples, 10 ns apart from 100 ns on, its head and length; and their stamps."""
    records = np.zeros(size, dtype=[("stamp_ns", np.int64)]).view(np.recarray)
    head, stamps = 0, 100 + 10 * np.arange(count)
    for stamp in stamps:
        records[head].stamp_ns = stamp
        head = ring.next_head(records, head)
    return records, head, min(count, size), stamps[-size:]


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 21])
def test_a_time_lies_between_its_neighbours_and_the_ends_hold(count):
    records, head, length, stamps = filled(count)
    for at in range(int(stamps[0]) - 15, int(stamps[-1]) + 16, 5):
        earlier, later, share = ring.around(records, head, length, at)
        between = (1.0 - share) * records[earlier].stamp_ns + share * records[later].stamp_ns
        assert between == pytest.approx(min(max(at, stamps[0]), stamps[-1]))


@pytest.mark.parametrize("count", [1, 7, 8, 21])
def test_the_first_sample_from_a_time_on_is_found(count):
    records, head, length, stamps = filled(count)
    for at in range(int(stamps[0]) - 10, int(stamps[-1]) + 15, 5):
        assert ring.first_from(records, head, length, at) == np.count_nonzero(stamps >= at)
    assert records[ring.place(records, head, 1)].stamp_ns == stamps[-1]
    assert records[ring.place(records, head, length)].stamp_ns == stamps[0]

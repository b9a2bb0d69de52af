# SPDX-License-Identifier: Apache-2.0
"""The ring of the last samples: what lies around a time, also where the ring has wrapped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
import pytest

from mwd_estimation.core import ring
from mwd_sensors.core.records import dtype_of

SIZE = 8


class Stamp:
    stamp_ns: int


class Stamps(ring.Ring):
    rows: Annotated[Sequence[Stamp], SIZE]


def filled(count):
    """A ring that has taken `count` samples, 10 ns apart from 100 ns on; and the stamps that it still has."""
    made, stamps = np.zeros(1, dtype=dtype_of(Stamps))[0], 100 + 10 * np.arange(count)
    for stamp in stamps:
        made.rows[ring.next_place(made)].stamp_ns = stamp
    return made, stamps[-SIZE:]


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 21])
def test_a_time_lies_between_its_neighbours_and_the_ends_hold(count):
    made, stamps = filled(count)
    for at in range(int(stamps[0]) - 15, int(stamps[-1]) + 16, 5):
        earlier, later, share = ring.around(made, at)
        between = (1.0 - share) * made.rows[earlier].stamp_ns + share * made.rows[later].stamp_ns
        assert between == pytest.approx(min(max(at, stamps[0]), stamps[-1]))


@pytest.mark.parametrize("count", [1, 7, 8, 21])
def test_the_first_sample_from_a_time_on_is_found(count):
    made, stamps = filled(count)
    for at in range(int(stamps[0]) - 10, int(stamps[-1]) + 15, 5):
        assert ring.first_from(made, at) == np.count_nonzero(stamps >= at)
    assert made.rows[ring.place(made, 1)].stamp_ns == stamps[-1]
    assert made.rows[ring.place(made, made.length)].stamp_ns == stamps[0]

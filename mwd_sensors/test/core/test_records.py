# SPDX-License-Identifier: Apache-2.0
"""Record types: a class and its dtype have the same fields, with and without compilation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of


class Sample:
    stamp_ns: int
    down: Annotated[Array, 3]


class State:
    count: int
    known: bool
    status: np.uint32
    age: float
    P: Annotated[Array, 2, 2]
    flag: bool
    last: Sample
    ring: Annotated[Sequence[Sample], 4]


@compiled
def step(s: State, dt: float) -> None:
    s.age += dt
    s.known = True
    s.P[0, 1] = s.age
    sample = s.ring[s.count]
    sample.stamp_ns = 7
    sample.down[2] = 1.0
    s.last.stamp_ns += 1
    s.count += 1


def test_a_dtype_has_the_fields_of_its_class_in_order():
    dtype = dtype_of(State)
    assert dtype.names == ("count", "known", "status", "age", "P", "flag", "last", "ring")
    assert dtype["P"].shape == (2, 2)
    assert dtype["ring"].shape == (4,)
    assert dtype["status"] == np.uint32
    assert dtype.isalignedstruct
    assert dtype.fields["last"][1] % 8 == 0
    assert dtype.itemsize % 8 == 0


def test_a_record_changes_in_place_the_same_with_and_without_compilation():
    one, other = np.zeros(1, dtype_of(State)), np.zeros(1, dtype_of(State))
    for _ in range(2):
        step(one[0], 0.25)
        getattr(step, "py_func", step)(other[0], 0.25)
    assert one.tobytes() == other.tobytes()
    assert one[0].age == 0.5
    assert one[0].last.stamp_ns == 2
    assert one["ring"]["down"][0, :2, 2].tolist() == [1.0, 1.0]

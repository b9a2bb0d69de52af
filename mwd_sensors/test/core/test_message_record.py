# SPDX-License-Identifier: Apache-2.0
"""Records that are messages: a field of floats is sent as floats, whatever kind of number it holds."""

import dataclasses
import math
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from mwd_sensors.core.message_record import MessageRecord


@dataclasses.dataclass(frozen=True, eq=False)
class Part(MessageRecord):
    MESSAGE: ClassVar[str] = "test_msgs/msg/Part"

    value: float = math.nan


@dataclasses.dataclass(frozen=True, eq=False)
class Whole(MessageRecord):
    MESSAGE: ClassVar[str] = "test_msgs/msg/Whole"

    value: float = math.nan
    values: tuple[float, ...] = ()
    count: int = 0
    parts: tuple[Part, ...] = ()


def make(_name, fields):
    return SimpleNamespace(**fields)


@pytest.mark.parametrize("number", [2**36, True, np.int64(-3), np.float32(0.5)])
def test_a_field_of_floats_is_sent_as_floats(number):
    sent = Whole(number, (number, 1), 7, (Part(number),)).to_message(make)
    assert [type(one) for one in (sent.value, *sent.values, sent.parts[0].value)] == [float] * 4
    assert sent.value == sent.values[0] == sent.parts[0].value == number
    assert type(sent.count) is int
    assert Whole.from_message(sent) == Whole(float(number), (float(number), 1.0), 7, (Part(float(number)),))

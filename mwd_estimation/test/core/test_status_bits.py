# SPDX-License-Identifier: Apache-2.0
"""The bits of the kernel and of the message are one list."""

import re

from mwd_estimation.core.status import Status, words
from project import MESSAGES

MESSAGE = MESSAGES / "Attitude.msg"


def test_bits_equal_the_constants_of_the_message():
    constants = dict(re.findall(r"^uint32 (\w+)=(\d+)", MESSAGE.read_text(), flags=re.MULTILINE))
    assert {bit.name: bit.value for bit in Status} == {name: int(value) for name, value in constants.items()}


def test_words_name_every_bit_that_is_set():
    assert words(0) == ""
    assert words(Status.STILL | Status.CORRECTED) == "still|corrected"

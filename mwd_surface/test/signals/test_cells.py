# SPDX-License-Identifier: Apache-2.0
"""Texts of cells."""

import copy
import dataclasses
import json
import pickle

import pytest

from mwd_surface.signals.cells import fixed


@dataclasses.dataclass
class Row:
    text: str


@pytest.mark.parametrize(
    "copied",
    [
        copy.copy,
        copy.deepcopy,
        lambda one: pickle.loads(pickle.dumps(one)),  # noqa: S301
        lambda one: dataclasses.asdict(Row(one))["text"],
    ],
)
def test_a_printed_number_is_copied_with_its_value(copied):
    printed = fixed(12.3456, 2)
    found = copied(printed)
    assert (found, found.number, found.decimals) == ("12.35", 12.3456, 2)
    assert json.loads(json.dumps(found)) == "12.35"

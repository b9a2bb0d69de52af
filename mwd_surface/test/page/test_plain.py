# SPDX-License-Identifier: Apache-2.0
"""Numbers for a page: finite or nothing."""

import json
import math

import pytest

from mwd_surface.page.state_json import number, numbers


@pytest.mark.parametrize("value", [None, math.nan, math.inf, -math.inf])
def test_what_is_no_finite_number_is_nothing(value):
    assert number(value) is None


def test_numbers_survive_json_with_the_digits_people_use():
    assert json.loads(json.dumps(numbers([1 / 3, 5e-5, 0.0]))) == [0.3333333333, 5e-05, 0.0]

# SPDX-License-Identifier: Apache-2.0
"""The chi-square distribution against scipy."""

import pytest
from scipy import stats

from mwd_estimation.core import chi_square


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5, 30, 901, 6000])
@pytest.mark.parametrize("probability", [0.999, 0.5, 0.01, 0.001, 1e-6])
def test_the_distribution_and_its_inverse_are_those_of_scipy(freedom, probability):
    limit = chi_square.limit(probability, freedom)
    assert limit == pytest.approx(stats.chi2.isf(probability, freedom), rel=1e-9)
    assert chi_square.exceeded(limit, freedom) == pytest.approx(probability, rel=1e-9)

# SPDX-License-Identifier: Apache-2.0
"""The axial correction of one station, and where geometry forbids it, in words."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mwd_estimation.core.reason_text import text
from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_estimation.survey.measurement import correction_refusal

DEG = math.pi / 180.0
GOOD = AxialCorrection(
    azimuth=np.array(1.0),
    sigma_azimuth=np.array(0.5 * DEG),
    interference=np.array(1e-6),
    sigma_interference=np.array(1e-7),
    chi_square=np.array(0.5),
    mirror=np.array(False),
    both=np.full(2, np.nan),
)


@pytest.mark.fault_case(30)
@pytest.mark.parametrize(
    ("changes", "inclination", "words"),
    [
        ({}, 40.0, ""),
        ({}, 0.5, "only 0.50 deg from vertical"),
        ({}, 179.5, "only 0.50 deg from vertical"),
        ({"chi_square": np.array(80.0)}, 40.0, "not axial"),
        ({"mirror": np.array(True), "both": np.array([1.0, 2.0])}, 90.0, "two azimuths, 57.3 and 114.6 deg"),
        (
            {"sigma_azimuth": np.array(9.8 * DEG), "azimuth": np.array(88 * DEG)},
            87.0,
            "3 deg from horizontal and 2 deg from magnetic east-west: corrected azimuth accurate only to 9.8 deg",
        ),
    ],
)
def test_a_correction_that_geometry_forbids_is_refused_in_words(changes, inclination, words):
    refused = correction_refusal(replace(GOOD, **changes), inclination * DEG)
    assert (refused is None) if words == "" else words in text(refused)

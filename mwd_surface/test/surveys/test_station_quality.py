# SPDX-License-Identifier: Apache-2.0
"""Totals beside their limits: corrected with corrected, read with read."""

import dataclasses
import math

import example_surveys as example
import numpy as np
import pytest

from mwd_estimation.core.magnetic_geometry import dip
from mwd_surface.surveys.station_quality import totals


def disturbed(**changes):
    """A survey whose axial field is 3000 nT too strong, and the Earth's field at its place."""
    f_t, earth_t = np.array([-9.0, 0.5, 3.8]), np.array([2.0e-5, -1.5e-5, 4.0e-5])
    read_t = earth_t + np.array([3e-6, 0.0, 0.0])
    given = {
        "specific_force": tuple(f_t),
        "magnetic_field": tuple(read_t),
        "b_total": float(np.linalg.norm(read_t)),
        "dip": float(dip(f_t, read_t)),
        "b_reference": float(np.linalg.norm(earth_t)),
        "dip_reference": float(dip(f_t, earth_t)),
        "axial_interference": 3e-6,
        "sigma_axial_interference": 6e-8,
    }
    return example.survey(4, 30.0, 80.0, **{**given, **changes})


def test_a_corrected_azimuth_is_judged_by_the_field_without_the_string():
    _, field, angle = totals(disturbed(azimuth_method="fused"))
    assert field.corrected
    assert field.deviation == pytest.approx(0.0, abs=1e-12)
    assert field.read == disturbed().b_total
    assert angle.deviation == pytest.approx(0.0, abs=1e-12)
    assert (field.light, angle.light) == ("good", "good")


def test_an_azimuth_from_the_field_as_read_is_judged_by_that():
    _, field, angle = totals(disturbed(azimuth_method="raw"))
    assert not field.corrected
    assert field.value == field.read
    assert (field.light, angle.light) == ("reject", "reject")


def test_gravity_is_never_corrected_and_the_survey_brings_its_own_limit():
    gravity, field, _ = totals(disturbed(g_limit=0.01, b_limit=2e-6, azimuth_method="raw", g_total=9.819 + 0.012))
    assert (gravity.corrected, gravity.limit, gravity.light) == (False, 0.01, "doubtful")
    assert (field.limit, field.light) == (2e-6, "good" if abs(field.deviation) <= 2e-6 else "doubtful")


def test_without_magnetometer_or_reference_there_is_no_light():
    bare = dataclasses.replace(disturbed(), b_total=math.nan, dip=math.nan, g_reference=math.nan)
    gravity, field, angle = totals(bare)
    assert [one.light for one in (gravity, field, angle)] == ["no reference", "not measured", "not measured"]
    assert (field.value, field.read, angle.deviation) == (None, None, None)
    assert not math.isnan(gravity.value)


def test_the_deviations_of_the_verdict_count_where_the_survey_brings_them():
    own = {"g_limit": 0.01, "b_limit": 5e-7, "dip_limit": 0.01}
    given = disturbed(azimuth_method="fused", g_deviation=0.004, b_deviation=-6e-7, dip_deviation=0.002, **own)
    found = totals(given)
    assert [one.deviation for one in found] == [0.004, -6e-7, 0.002]
    assert [one.light for one in found] == ["good", "doubtful", "good"]

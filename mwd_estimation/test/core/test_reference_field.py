# SPDX-License-Identifier: Apache-2.0
"""The reference: named norths, propagation of its sigmas, a measurement beforehand, and refusals that teach."""

import math

import numpy as np
import pytest

from mwd_estimation.core.reference_field import Reference, best_north, north_correction, to_north

DEG = math.pi / 180.0


@pytest.mark.fault_case(37)
def test_grid_azimuth_is_magnetic_plus_declination_minus_convergence():
    reference = Reference(declination=-2.21 * DEG, convergence=-0.95 * DEG)
    assert best_north(reference) == "grid"
    assert north_correction(reference, "grid") / DEG == pytest.approx(-1.26)
    assert north_correction(reference, "true") / DEG == pytest.approx(-2.21)
    assert north_correction(reference, "magnetic") == 0.0
    assert to_north(1.0 * DEG, -2.0 * DEG) / DEG == pytest.approx(359.0)


def test_without_declination_only_magnetic_north_is_known():
    assert best_north(None) == "magnetic"
    assert north_correction(None, "true") is None
    assert best_north(Reference(declination=0.1)) == "true"
    assert best_north(Reference(declination=0.1, convergence=0.0)) == "true"
    assert north_correction(Reference(declination=0.1), "grid") is None
    with pytest.raises(ValueError, match="'gird' is not one of magnetic, true, grid"):
        north_correction(None, "gird")


def test_covariance_of_horizontal_and_vertical_matches_drawn_fields():
    reference = Reference(total=50e-6, dip=72 * DEG)
    rng = np.random.default_rng(1)
    total = rng.normal(50e-6, reference.sigma_total, 100_000)
    dip = rng.normal(72 * DEG, reference.sigma_dip, 100_000)
    drawn = np.cov(total * np.cos(dip), total * np.sin(dip))
    assert reference.covariance == pytest.approx(drawn, rel=0.03)
    assert reference.horizontal == pytest.approx(50e-6 * math.cos(72 * DEG))


@pytest.mark.fault_case(31)
def test_declination_is_less_certain_where_the_horizontal_field_is_weak():
    reference = Reference()
    assert math.sqrt(reference.declination_variance(15451e-9)) / DEG == pytest.approx(0.53, abs=0.005)
    assert reference.declination_variance(5e-6) > 4 * reference.declination_variance(2e-5)


@pytest.mark.fault_case(35)
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"total": 50000.0, "dip": 1.2}, "50000 nT would be 5e-05 T"),
        ({"total": 50.0, "dip": 1.2}, "50 uT would be 5e-05 T"),
        ({"total": 5e-5, "dip": 72.0}, "72 deg would be 1.25664 rad"),
        ({"total": 5e-5}, "without dip"),
        ({"dip": 1.0}, "without total"),
        ({"total": math.nan, "dip": 1.0}, "finite"),
        ({"gravity": 1.0}, "m/s\\^2"),
        ({"sigma_dip": -1.0}, "sigma_dip"),
    ],
)
def test_an_impossible_reference_is_refused_with_a_hint(given, words):
    with pytest.raises(ValueError, match=words):
        Reference(**given)


def test_a_reference_without_field_says_so_when_asked_for_it():
    assert not Reference(declination=0.1).has_field
    with pytest.raises(ValueError, match="no field"):
        _ = Reference(declination=0.1).horizontal

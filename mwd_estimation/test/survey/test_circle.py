# SPDX-License-Identifier: Apache-2.0
"""Densities on the circle: mean and sigma of known ones, two modes with their odds, heavy tails."""

import math

import numpy as np
import pytest

from mwd_estimation.survey.posterior import circle
from mwd_sensors.core.frames import wrap_pi

DEG = math.pi / 180.0


def gaussian(angles, mean, sigma):
    return np.exp(-0.5 * (wrap_pi(angles - mean) / sigma) ** 2) / sigma


def of_mixture(*parts):
    """Angles and density of a sum of Gaussians; each part: share, mean and sigma, rad."""

    def density(angles):
        return sum(share * gaussian(angles, mean, sigma) for share, mean, sigma in parts)

    angles = circle.refined(np.log(density(circle.coarse()) + 1e-300))
    return angles, density(angles)


@pytest.mark.parametrize(("mean", "sigma"), [(0.0, 0.2), (359.9, 1.0), (120.0, 5.0), (10.0, 25.0)])
def test_a_gaussian_has_its_mean_and_sigma_also_across_north(mean, sigma):
    found = circle.read(*of_mixture((1.0, mean * DEG, sigma * DEG)))
    assert abs(wrap_pi(found.mean - mean * DEG)) < 0.02 * sigma * DEG
    assert found.sigma == pytest.approx(sigma * DEG, rel=0.06)
    assert found.alternatives == ()
    assert found.share == pytest.approx(1.0)


def test_two_modes_are_named_with_their_probabilities():
    found = circle.read(*of_mixture((0.9, 1.0, 0.02), (0.1, 4.0, 0.05)))
    assert found.mean == pytest.approx(1.0, abs=1e-3)
    assert found.share == pytest.approx(0.9, abs=0.005)
    ((other, odds),) = found.alternatives
    assert (other, odds) == (pytest.approx(4.0, abs=5e-3), pytest.approx(0.1, abs=0.005))


@pytest.mark.parametrize(("apart", "others"), [(3.1, 0), (3.6, 1)])
def test_two_peaks_are_two_azimuths_if_the_density_falls_to_half_between_them(apart, others):
    # Equal peaks 3.1 sigma apart have 60 % of their height between them, and 40 % at 3.6 sigma. At 60 % no azimuth in
    # between is improbable, so one mean with a larger sigma describes both peaks.
    found = circle.read(*of_mixture((0.5, 2.0, 0.02), (0.5, 2.0 + 0.02 * apart, 0.02)))
    assert len(found.alternatives) == others


def test_an_improbable_large_error_widens_sigma_beyond_the_standard_deviation():
    found = circle.read(*of_mixture((0.98, 2.0, 0.01), (0.02, 2.0, 0.1)))
    assert found.sigma > 1.3 * math.sqrt(0.98 * 0.01**2 + 0.02 * 0.1**2)


def test_an_error_less_probable_than_one_in_a_hundred_is_no_part_of_sigma_but_of_the_probability_beyond():
    angles, density = of_mixture((0.997, 2.0, 0.01), (0.003, 2.0, 0.25))
    found = circle.read(angles, density)
    assert found.sigma == pytest.approx(0.01, rel=0.1)
    assert found.spread == pytest.approx(math.sqrt(0.997 * 0.01**2 + 0.003 * 0.25**2), rel=0.05)
    assert circle.beyond(angles, density, 2.0, 0.25) == pytest.approx(0.003 * 0.317, rel=0.05)


@pytest.mark.parametrize("smear", [0.02, 0.1])
def test_an_error_that_the_density_does_not_hold_adds_to_the_probability_beyond(smear):
    found = circle.beyond(*of_mixture((1.0, 2.0, 0.05)), 2.0, 0.12, smear)
    assert found == pytest.approx(math.erfc(0.12 / math.hypot(0.05, smear) / math.sqrt(2.0)), rel=0.03)


def test_nothing_known_is_a_sigma_of_half_a_circle():
    found = circle.read(circle.coarse(), np.ones(180))
    assert found.sigma > 0.9 * math.pi / 3.0

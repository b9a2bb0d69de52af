# SPDX-License-Identifier: Apache-2.0
"""The azimuth on the circle of the latitude: narrow, wide, two-fold, and of several Gaussians."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mwd_estimation.gyrocompass import azimuth_posterior
from mwd_estimation.gyrocompass.azimuth_posterior import Mixture
from mwd_sensors.core.frames import wrap_pi

RATE = 5e-5  # rad/s, horizontal Earth rate


def one(azimuth: float, sigma: float, log_weight: float = 0.0, length: float = 1.0, angle: float = 0.0) -> Mixture:
    """Gaussian whose Earth rate lies at an azimuth, with the same sigma, as a share of the rate, in both directions."""
    earth = length * RATE * np.array([math.cos(azimuth), -math.sin(azimuth)])
    return gaussian(earth, np.eye(2) * (sigma * RATE) ** 2, log_weight, angle)


def gaussian(earth: np.ndarray, S: np.ndarray, log_weight: float = 0.0, angle: float = 0.0) -> Mixture:
    none = np.zeros(1)
    return Mixture(np.array([log_weight]), earth[None], S[None], np.zeros((1, 2)), np.array([angle**2]), none, none)


def several(*each: Mixture) -> Mixture:
    return Mixture(*(np.concatenate(field) for field in zip(*each, strict=True)))


@pytest.mark.parametrize("azimuth", [-3.1, -1.0, 0.0, 2.5, math.pi])
@pytest.mark.parametrize("sigma", [1e-4, 0.01, 0.06])
def test_a_narrow_gaussian_keeps_its_azimuth_and_sigma(azimuth: float, sigma: float) -> None:
    found = azimuth_posterior.posterior(one(azimuth, sigma), RATE)
    assert abs(float(wrap_pi(found.mean - azimuth))) < 1e-3 * sigma
    assert found.sigma == pytest.approx(sigma, rel=0.01)
    assert found.misfit == pytest.approx(0.0, abs=1e-6)
    assert found.several == ()


def test_a_gaussian_wider_than_the_circle_knows_nothing_but_its_side() -> None:
    found = azimuth_posterior.posterior(one(1.0, 3.0), RATE)
    # The spread of an angle of which nothing is known is pi / sqrt(3).
    assert found.sigma == pytest.approx(math.pi / math.sqrt(3.0), rel=0.1)


def test_the_distance_from_the_circle_is_given_in_sigmas() -> None:
    assert azimuth_posterior.posterior(one(1.0, 0.02, length=1.1), RATE).misfit == pytest.approx(25.0, rel=1e-3)


def test_the_angle_that_is_added_brings_its_own_sigma() -> None:
    assert azimuth_posterior.posterior(one(1.0, 0.03, angle=0.04), RATE).sigma == pytest.approx(0.05, rel=0.01)


def test_a_thin_ellipse_across_the_circle_has_two_answers_of_which_the_expected_one_is_taken() -> None:
    S = np.diag([0.01**2, 5.0**2]) * RATE**2
    # Only the north part is known: cos(azimuth) = 0.5, hence 60 or -60 deg.
    ridge = gaussian(np.array([0.5, 0.0]) * RATE, S)
    both = azimuth_posterior.posterior(ridge, RATE)
    assert sorted(both.several) == pytest.approx([-math.pi / 3.0, math.pi / 3.0], abs=0.01)
    assert both.sigma > 0.9
    found = azimuth_posterior.posterior(ridge, RATE, expected=0.8)
    assert found.mean == pytest.approx(math.pi / 3.0, abs=0.01)
    assert found.sigma == pytest.approx(0.01 / math.sin(math.pi / 3.0), rel=0.05)


def test_parts_are_weighed_by_their_evidence_and_by_how_well_they_fit_the_circle() -> None:
    narrow, wide = one(1.0, 0.01), one(1.0, 0.5, log_weight=-5.0)
    mixed = azimuth_posterior.posterior(several(wide, narrow), RATE)
    assert mixed.mean == pytest.approx(1.0, abs=1e-3)
    assert 0.01 < mixed.sigma < 0.1
    # Thirty sigma off the circle the narrow one has no say, whatever its weight was.
    off = azimuth_posterior.posterior(several(wide, one(1.0, 0.01, length=1.3)), RATE)
    assert off.sigma == pytest.approx(azimuth_posterior.posterior(wide, RATE).sigma, rel=0.01)


@pytest.mark.parametrize(("log_odds", "modes"), [(-4.0, 2), (-7.0, 0)])
def test_a_mode_counts_only_if_it_is_probable_enough_to_matter(log_odds: float, modes: int) -> None:
    parts = several(one(1.0, 0.1), one(-2.0, 0.1, log_odds))
    assert len(azimuth_posterior.posterior(parts, RATE).several) == modes


def test_the_misfit_is_that_of_the_part_that_answers_not_of_an_unlikely_one_that_fits() -> None:
    answers, unlikely = one(1.0, 0.1, length=1.5), one(2.5, 1.0, log_weight=-60.0)
    alone = azimuth_posterior.posterior(answers, RATE)
    found = azimuth_posterior.posterior(several(answers, unlikely), RATE)
    assert found.mean == pytest.approx(alone.mean, abs=1e-3)
    assert found.misfit == pytest.approx(alone.misfit, rel=1e-3)
    assert alone.misfit == pytest.approx(25.0, rel=1e-3)


def test_parts_of_like_widths_share_the_angles_that_resolve_them() -> None:
    alike = several(*(one(1.0, 0.01 * 1.01**k) for k in range(48)))
    angle, share, _ = azimuth_posterior.along(alike, RATE)
    assert len(angle) < 1200
    for k, shares in enumerate(share):
        assert math.sqrt(float(shares @ (angle - 1.0) ** 2)) == pytest.approx(0.01 * 1.01**k, rel=1e-3)


def test_the_sigma_of_a_mixture_covers_99_of_a_hundred_of_its_angles() -> None:
    assert azimuth_posterior.sigma_of_mixture(np.array([1.0]), np.zeros(1), [0.01]) == pytest.approx(0.01, rel=1e-9)
    weight, off, sigmas = np.array([0.93, 0.05, 0.02]), np.array([-0.02, 0.3, 0.6]), np.array([0.02, 0.05, 0.01])
    sigma = azimuth_posterior.sigma_of_mixture(weight, off, list(sigmas))
    rng = np.random.default_rng(1)
    drawn = rng.choice(3, 200_000, p=weight)
    angles = off[drawn] + sigmas[drawn] * rng.standard_normal(len(drawn))
    assert np.quantile(np.abs(angles), 0.99) == pytest.approx(2.576 * sigma, rel=0.01)

# SPDX-License-Identifier: Apache-2.0
"""The density of the azimuth: the angle of the field, moved and smeared by the error of the declination."""

import math

import numpy as np
import pytest

from mwd_estimation.survey.posterior import circle, field_model
from mwd_estimation.survey.posterior.declination import Declination, azimuth_density
from mwd_sensors.core.frames import wrap_pi

DEG = math.pi / 180.0
EVERY = np.arange(circle.STEPS) * math.tau / circle.STEPS


def gaussian(angles, mean, sigma):
    return np.exp(-0.5 * (wrap_pi(angles - mean) / sigma) ** 2) / (sigma * math.sqrt(math.tau))


def azimuths(angles, share, gyro, r, S, error):
    """Density of the azimuth per rad and state of the gyro, of points without external field and without drift."""
    whole, of_angles = share.sum(), (field_model.basis(angles), gyro)
    adrift, extra = np.zeros(share.shape[1], dtype=bool), np.array([0.0, 0.0])
    found = azimuth_density(angles, share / whole, adrift, of_angles, (r, S), extra, error)
    return found * circle.STEPS / math.tau


def test_without_a_gyro_each_filter_is_moved_by_the_mean_and_smeared_by_the_variance_of_its_own_error():
    parts = [(0.7, 359.9, 0.5, 0.4, 3.0), (0.3, 115.0, 1.0, -2.0, 0.2)]

    def before(at):
        return np.array([share * gaussian(at, mean * DEG, sigma * DEG) for share, mean, sigma, *_ in parts])

    angles = circle.refined(np.log(before(circle.coarse()).sum(axis=0) + 1e-300))
    share = (before(angles) * circle.widths(angles)).T[:, :, None, None]
    moved, error = (np.array(values) * DEG for values in zip(*(one[3:] for one in parts), strict=True))
    unused = np.zeros((2, 3, 4)), np.zeros((2, 3, 3, 4, 4))
    found = azimuths(angles, share, np.zeros(len(angles)), *unused, Declination(moved, error**2, np.zeros((2, 3, 4))))
    expected = sum(
        share * gaussian(EVERY, (mean + moved) * DEG, math.hypot(sigma, error) * DEG)
        for share, mean, sigma, moved, error in parts
    )
    np.testing.assert_allclose(found[:, 2], expected, rtol=0.0, atol=2e-3 * expected.max())
    assert not found[:, :2].any()


@pytest.mark.parametrize("of_gyro", [0.1, 1.0, 20.0])
@pytest.mark.parametrize("of_error", [0.2, 5.0])
def test_with_a_gyro_the_azimuth_is_the_weighted_mean_of_gyro_and_field(of_gyro, of_error):
    field, gyro, of_field = 100.0, 101.0, 0.7
    angles = np.arange(0.0, 360.0, 0.05) * DEG
    residual, variance = wrap_pi(gyro * DEG - angles), (of_gyro**2 + of_error**2) * DEG**2
    mass = gaussian(angles, field * DEG, of_field * DEG) * gaussian(residual, 0.0, math.sqrt(variance))
    share = np.zeros((len(angles), 1, 1, 3))
    share[:, 0, 0, 0] = mass
    S, slope = np.zeros((1, 3, 3, 4, 4)), np.zeros((1, 3, 4))
    S[0, 0, 0] = np.diag([1.0, 1.0, 1.0, variance])
    slope[0, 0, 3] = (of_error * DEG) ** 2
    error = Declination(np.zeros(1), np.array([(of_error * DEG) ** 2]), slope)
    found = azimuths(angles, share, residual, np.zeros((1, 3, 4)), S, error)[:, 0]
    magnetic = of_field**2 + of_error**2
    mean = (field / magnetic + gyro / of_gyro**2) / (1.0 / magnetic + 1.0 / of_gyro**2)
    expected = gaussian(EVERY, mean * DEG, DEG / math.sqrt(1.0 / magnetic + 1.0 / of_gyro**2))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-2 * expected.max())

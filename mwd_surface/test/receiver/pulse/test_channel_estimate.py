# SPDX-License-Identifier: Apache-2.0
"""A response estimated from pulses whose places are uncertain."""

import numpy as np

from mwd_surface.receiver.pulse.channel_estimate import (
    BEFORE,
    SAMPLES_PER_TU,
    basis,
    normal_equations,
    place_pairs,
    pulse_columns,
    response_length,
    spread,
)


def test_pulses_at_one_place_are_sure_of_their_distance():
    shapes = np.random.default_rng(2).normal(size=(3, 50))
    assert np.array_equal(spread(np.array([0.5, 0.0, 0.0]), shapes), np.zeros((3, 3)))


def test_places_that_the_noise_chose_do_not_enlarge_the_response():
    """At the true response the normal equations have no bias, as they have without the covariance of the columns."""
    random = np.random.default_rng(3)
    shapes = basis(response_length(0.25), 0.25)
    u = random.normal(size=len(shapes))
    u *= 2.5 / np.linalg.norm(u @ shapes)
    length = shapes.shape[1]
    places = np.array([BEFORE, BEFORE + SAMPLES_PER_TU])
    sent = np.zeros((2, length + SAMPLES_PER_TU))
    sent[0, :length] = sent[1, SAMPLES_PER_TU:] = u @ shapes
    weight = np.ones(sent.shape[1])
    chosen, blurred = [], []
    for trial in range(4000):
        pressure = sent[trial % 2] + random.normal(size=sent.shape[1])
        odds = pressure @ (sent[1] - sent[0]) - 0.5 * (sent[1] @ sent[1] - sent[0] @ sent[0])
        chance = np.array([1.0, np.exp(odds)]) / (1.0 + np.exp(odds))
        train = np.zeros(len(weight))
        train[places] = chance
        matrix, right = normal_equations(pulse_columns(train, shapes), pressure, weight)
        pairs = place_pairs(np.column_stack([places, chance, [0.0, 0.0]]), weight)
        chosen.append(u @ (right - matrix @ u))
        blurred.append(u @ spread(pairs, shapes) @ u)
    bias = np.subtract(chosen, blurred)
    noise = np.std(bias) / np.sqrt(len(bias))
    assert abs(np.mean(bias)) < 4.0 * noise
    assert np.mean(chosen) > 10.0 * noise

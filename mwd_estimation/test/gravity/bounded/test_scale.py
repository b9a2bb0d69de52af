# SPDX-License-Identifier: Apache-2.0
"""Covariance scale of the bounded filter: simulated errors against the variances that it states of them."""

import math

import numpy as np
import pytest

from mwd_estimation.gravity.bounded import mechanisation, noise, scale
from mwd_estimation.gravity.bounded.filter import BoundedParams, initial
from mwd_estimation.gravity.bounded.state import ASKEW, BIAS

P = BoundedParams()


def rotating(inclination_deg, speed):
    """A state whose tool rotates steadily, rad/s, at an inclination."""
    state = initial(P)
    s = state.record[0]
    x, y = math.sin(math.radians(inclination_deg)), math.cos(math.radians(inclination_deg))
    # Turned about the level y axis, which takes the tool axis from level to where it points.
    half = 0.5 * math.atan2(-y, x)
    s.q[:] = 0.0, math.sin(half), 0.0, math.cos(half)
    mechanisation.set_matrix(s)
    s.slow_axis[:] = s.C[:2, 0]
    s.turning, s.last_w[0] = abs(speed), speed
    return state


def test_the_pull_of_a_circle_round_a_vertical_axis_tilts_nothing_along_the_hole():
    state = rotating(0.0, 20.0)
    s = state.record[0]
    centred, _ = scale.floors(P, s)
    s.lever[:] = 0.03, -0.02
    off_axis, _ = scale.floors(P, s)
    assert off_axis == pytest.approx(centred)
    level = rotating(90.0, 20.0)
    level.record[0].lever[:] = 0.03, -0.02
    assert scale.floors(P, level.record[0])[0] > 2.0 * centred


@pytest.mark.parametrize(("hertz", "least"), [(0.1, 0.2), (0.225, 0.45), (0.7, 0.05), (3.0, 0.0)])
def test_a_displacement_outside_the_hole_never_shows_more_tilt_than_the_force_that_made_it(hertz, least):
    state = rotating(90.0, 10.0)
    s = state.record[0]
    inside = scale.floors(P, s)[1]
    # A sine of force with this amplitude, rad of tilt, after the three high-passes; mean squares.
    tilt, swing = 1.0, 2.0 * math.pi * hertz * noise.SWING_TIME
    passed = (swing / math.hypot(1.0, swing)) ** 3
    s.motion.across = 0.5 * (tilt * P.gravity / (2.0 * math.pi * hertz) ** 2 * passed) ** 2
    shown = scale.floors(P, s)[1] - inside
    assert least * tilt**2 <= shown <= 0.5 * tilt**2
    s.motion.white = s.motion.across
    assert scale.floors(P, s)[1] == pytest.approx(inside)


@pytest.mark.parametrize("found", [0.0, 0.5, 0.98])
@pytest.mark.parametrize("factor", [0.02, 0.3])
def test_variance_of_the_cone_is_that_of_simulated_tools_whose_cone_is_found_in_part(found, factor):
    speed = 4.0
    state = rotating(90.0, speed)
    s = state.record[0]
    s.innovations.along.power = factor
    rotates = speed**2 / (speed**2 + scale.ROTATING**2)
    # Share k of the rate and bias b of a gyro across the axis look alike: k + b / speed is measured.
    H = np.array([1.0, rotates / speed])
    prior = np.diag([P.misalignment_sigma**2, P.bias_sigma**2])
    noise = float(H @ prior @ H) * (1.0 - found) / max(found, 1e-9)
    gain = prior @ H / (float(H @ prior @ H) + noise)
    after = prior - np.outer(gain, H @ prior)
    for j in range(2):
        index = [ASKEW + j, BIAS + 1 + j]
        s.P[np.ix_(index, index)] = after
    # The tools' errors and the noise of what is measured are smaller than the filter is told, each by its own factor.
    rng = np.random.default_rng(3)
    error = scale.BIAS_SHARE * np.sqrt(np.diag(prior)) * rng.standard_normal((20_000, 2))
    measured = error @ H + math.sqrt(factor * noise) * rng.standard_normal(20_000)
    left = (error - np.outer(measured, gain)) @ H
    along, _ = scale.floors(P, s)
    assert along == pytest.approx(rotates * float(np.mean(left**2)), rel=0.05)


def test_sigma_of_a_slow_filter_does_not_wander_in_its_first_minutes():
    # A tilt that walks and is measured, both with a twentieth of the variances assumed; the filter's own time is 10 s.
    step, own, factor, runs = 0.1, 10.0, 0.05, 60
    growth = 1.0 - math.exp(-step / own)
    before = 1.0
    after = before * (1.0 - growth)
    noise = before * after / (before - after)
    rng = np.random.default_rng(4)
    squares = []
    for _ in range(runs):
        s = initial(P).record[0]
        s.innovations.along.power, s.sums.time, error = 1.0, step, math.sqrt(factor * before) * rng.standard_normal()
        for k in range(1, 801):
            s.settled = k * step
            error += math.sqrt(factor * (before - after)) * rng.standard_normal()
            s.correction[0] = before / (before + noise) * (error + math.sqrt(factor * noise) * rng.standard_normal())
            error -= s.correction[0]
            scale._follow(s, s.innovations.along, before - after, after / (before - after), 1.0, 0.0)
            if s.settled > 30.0:
                squares.append(error**2 / (s.innovations.along.power * after))
    nees = float(np.mean(squares))
    # Of white noises (8) shows three quarters of the variance: 1.33, and more for what the scale wanders.
    assert 1.1 < nees < 1.7

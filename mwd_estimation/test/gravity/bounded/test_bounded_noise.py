"""Whether forces are white: told from vibration that stays in place, early and late, and left out of tilt's lever."""

import numpy as np
import pytest

from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_estimation.gravity.bounded import motion as follow
from mwd_estimation.gravity.bounded import noise as white
from mwd_estimation.gravity.bounded import params as settings
from mwd_sensors.core.constants import STANDARD_GRAVITY

K = settings.constants(settings.Params())
DT, EVERY = 0.01, 4


def followed(force: np.ndarray, circle: float = 0.0, turning: float = 0.0) -> tuple[np.ndarray, float, float]:
    """Verdict after each interval of a level tool, and the last swing and density; force (n, 3) beside gravity."""
    x, P, st = np.zeros(model.NOMINAL), np.zeros((model.ERRORS, model.ERRORS)), np.zeros(follow.STATISTICS)
    x[model.N_LEVER + 1], st[follow.TURNING] = circle, turning
    P[:2, :2] = 1e-6 * np.eye(2)
    st[follow.ALIAS] = st[follow.UNSETTLED] = 1.0
    s, verdicts, swing, density = np.zeros(model.SUMS), [], 0.0, 0.0
    before = force[0]
    for i in range(len(force)):
        # As the filter does: roughness at first over what there is, then over the memory of the swing.
        share = DT / (min(settings.Params().swing_memory, st[follow.SETTLED] + 0.3) + DT)
        st[follow.ROUGH] += share * (np.sum((force[i] - before) ** 2) / 6.0 * DT - st[follow.ROUGH])
        before = force[i]
        follow.follow_swing(K, x, P, st, np.eye(3), DT, *force[i])
        s[model.S_FORCE : model.S_FORCE + 3] += (force[i] - [0.0, 0.0, STANDARD_GRAVITY]) * DT
        s[model.S_TIME] += DT
        if i % EVERY == EVERY - 1:
            swing, density = white.follow_white(K, x, s, st)
            follow.follow_innovations(K, P, st, np.eye(3), EVERY * DT, 1e-7, 0.0, 0.0, 0.0, 0.01)
            s[:] = 0.0
            verdicts.append(st[follow.ALIAS])
    return np.array(verdicts), swing, density


@pytest.mark.parametrize("rms", [2.0, 30.0])
def test_white_forces_count_in_full_and_from_the_start(rms):
    verdicts, densities = [], []
    for seed in range(6):
        force = rms * np.random.default_rng(seed).standard_normal((2000, 3))
        verdict, _, density = followed(force)
        verdicts.append(verdict)
        densities.append(density)
    assert np.mean(np.array(verdicts) > white.WHITE_AT) > 0.9
    assert np.median(densities) == pytest.approx(white.RESERVE * rms**2 * DT, rel=0.2)


def test_vibration_that_stays_in_place_is_known_for_it_within_two_seconds():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        # Means over the interval of a velocity that is bounded: 10 Hz and more.
        speed = 0.1 * rng.standard_normal((1001, 3))
        verdict, _, density = followed(np.diff(speed, axis=0) / DT)
        assert verdict[int(2.0 / (EVERY * DT)) :].max() < white.WHITE_FROM
        assert density < 0.01 * 0.1**2 / DT


def test_a_slow_swing_of_the_hand_is_motion_and_no_noise():
    t = DT * np.arange(1500)[:, None]
    swing = 2.0 * np.sin(2 * np.pi * 0.5 * t + [0.0, 1.0, 2.0])
    verdict, _, _ = followed(swing + 0.3 * np.random.default_rng(3).standard_normal((1500, 3)))
    assert verdict[-1] < white.WHITE_FROM


def test_white_forces_are_seen_in_a_sensor_that_circles_off_the_axis():
    turning, arm = 12.0, 0.04
    t = DT * np.arange(2000)
    force = 2.0 * np.random.default_rng(4).standard_normal((2000, 3))
    # Horizontal circle: the level frame sees its pull turn.
    force[:, 0] += turning**2 * arm * np.cos(turning * t)
    force[:, 1] += turning**2 * arm * np.sin(turning * t)
    known, _, _ = followed(force, circle=arm, turning=turning)
    unknown, _, _ = followed(force)
    assert known[-1] > white.WHITE_AT > unknown[-1]


def test_forces_too_quiet_to_matter_are_not_called_white():
    verdict, _, density = followed(0.1 * np.random.default_rng(5).standard_normal((500, 3)))
    assert verdict[-1] < 0.1
    assert density < white.QUIET


def test_noise_is_left_out_of_the_force_that_tilt_acts_through_and_motion_is_not():
    for density, left in ((9.0, 0.041), (1e-6, 1.0)):
        s = np.zeros(model.SUMS)
        s[model.S_TIME] = 0.04
        s[model.S_FORCE : model.S_FORCE + 3] = [0.6, -0.3, 0.2 - 0.04 * STANDARD_GRAVITY]
        white.leave_out_noise(K, s, density)
        rest = np.array([0.0, 0.0, 0.04 * STANDARD_GRAVITY]) + s[model.S_FORCE : model.S_FORCE + 3]
        assert rest == pytest.approx(left * np.array([0.6, -0.3, 0.2]), rel=0.01)

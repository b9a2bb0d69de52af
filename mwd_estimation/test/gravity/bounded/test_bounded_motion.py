"""What the bounded filter follows of the motion: swing, shocks, clipping, and how far its covariance is believed."""

import numpy as np
import pytest

from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_estimation.gravity.bounded import motion as follow
from mwd_estimation.gravity.bounded import params as settings
from mwd_sensors.core.constants import STANDARD_GRAVITY

K = settings.constants(settings.Params())
DT = 0.01


def blank() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nominal values, covariance, statistics of a filter that knows its tilt."""
    x, P, st = np.zeros(model.NOMINAL), np.zeros((model.ERRORS, model.ERRORS)), np.zeros(follow.STATISTICS)
    x[model.Q + 3] = 1.0
    P[:2, :2] = 1e-6 * np.eye(2)
    st[follow.USUAL] = st[follow.SCALE_ALONG] = st[follow.SCALE_ACROSS] = 1.0
    return x, P, st


def published(x: np.ndarray, P: np.ndarray, st: np.ndarray) -> tuple[float, float]:
    """Sigmas of a horizontal tool along level x."""
    floor, aside = follow.floors(K, x, P, st, np.eye(3))
    return follow.sigmas(
        1.0, 0.0, P[0, 0], P[0, 1], P[1, 1], st[follow.SCALE_ALONG], st[follow.SCALE_ACROSS], floor, aside
    )


def test_swing_is_the_mean_square_of_a_vibration_along_the_axis_and_across_it():
    x, P, st = blank()
    amplitude, omega = 0.02, 2 * np.pi * 2.0
    for i in range(3000):
        st[follow.SETTLED] += DT
        # Along tool x, which is level x here.
        follow.follow_swing(K, x, P, st, np.eye(3), DT, -amplitude * omega**2 * np.sin(omega * i * DT), 0.0, 0.0)
    assert st[follow.SWING_X] == pytest.approx(0.5 * amplitude**2, rel=0.15)
    assert st[follow.SWING_C] == pytest.approx(0.0, abs=1e-12)


def test_a_sensor_that_circles_with_its_lever_arm_does_not_swing():
    x, P, st = blank()
    x[model.N_LEVER + 1] = 0.05
    st[follow.TURNING], omega = 15.0, 15.0
    for i in range(3000):
        st[follow.SETTLED] += DT
        c, s = np.cos(omega * i * DT), np.sin(omega * i * DT)
        mat = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        # The mean of the interval that ends here, as a strapdown sensor gives it.
        half = -0.5 * omega * DT
        a = -0.05 * omega**2 * (np.cos(half) * mat[:, 1] + np.sin(half) * mat[:, 2])
        follow.follow_swing(K, x, P, st, mat, DT, *a)
    assert st[follow.SWING_C] < 0.01 * 0.5 * 0.05**2


def test_a_shock_makes_the_velocity_along_it_uncertain_and_many_open_the_gate():
    _, P, st = blank()
    st[follow.STRONG] = 100.0
    assert follow.jump_gate(K, st) == follow.NEVER
    for _ in range(12):
        for i in range(30):
            a = 60.0 if i == 0 else 5.0
            before = P.copy()
            follow.follow_shocks(K, P, st, DT, a, 0.0, 0.0, a * a, False)
            if i == 0:
                grown = np.diag(P - before)[model.VEL : model.VEL + 3]
                assert grown[0] > (0.5 * a * DT) ** 2
                assert grown[1] < 0.2 * grown[0]
            else:
                assert np.array_equal(P, before)
    assert follow.jump_gate(K, st) == pytest.approx(settings.Params().shock_gate)


def test_a_force_that_a_clipped_sample_would_exceed_is_no_shock():
    _, P, st = blank()
    st[follow.STRONG] = 4.0
    before = P.copy()
    # 30 m/s^2 in 3.5 ms: a sensor of 16 g that clipped for HIDDEN of it would have shown twice that.
    follow.follow_shocks(K, P, st, 0.0035, 30.0, 0.0, 0.0, 900.0, False)
    assert np.array_equal(P, before)


def test_a_clipped_rate_begins_with_its_slope_and_what_was_known_comes_back_after_it():
    x, P, st = blank()
    P[model.BIAS, model.BIAS], P[model.BIAS, 0], P[0, model.BIAS] = 1e-6, 1e-7, 1e-7
    P[:2, :2] = [[4e-6, 1e-6], [1e-6, 9e-6]]
    # Along level x and half down: tilt about level y is inclination.
    mat = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    kept = np.zeros((model.MISSING - model.BIAS, model.MISSING - model.BIAS))
    rate, omega = 25.0, 2 * np.pi * 0.3
    true = rate * (1.0 - np.cos(omega * DT * np.arange(180)))
    limit, missing = settings.Params().gyro_range, []
    st[follow.TURNING] = rate
    for w in true:
        shown = min(w, limit)
        if w < limit and st[follow.CLIPPING] == 0.0:
            follow.follow_slope(st, DT, shown)
        else:
            assert not follow.follow_clipping(K, x, P, st, kept, mat, DT, shown, w >= limit)
        st[follow.LAST_W] = shown
        if w >= limit:
            missing.append(x[model.N_MISSING] - (w - limit))
            assert P[model.BIAS, model.BIAS] == P[1, 1] == P[0, 1] == 0.0
            assert st[follow.CLIP_TILT] == pytest.approx(9e-6)
    assert np.sqrt(np.mean(np.square(missing[: len(missing) // 2]))) < 2.0
    x[model.N_MISSING] = 0.1
    P[0, 0] = 0.01
    assert not follow.follow_clipping(K, x, P, st, kept, mat, DT, 30.0, False)
    assert P[:2, :2] == pytest.approx(np.diag([0.01, 9e-6]))
    assert P[model.BIAS, model.BIAS] == 1e-6
    assert st[follow.CLIP_TILT] == 0.0


@pytest.mark.parametrize("factor", [0.05, 1.0, 4.0])
def test_the_scale_of_the_covariance_is_the_power_of_the_innovations(factor):
    rng = np.random.default_rng(3)
    _, P, st = blank()
    P[:2, :2] = 4e-6 * np.eye(2)
    scales = []
    for _ in range(20000):
        i0, i1 = np.sqrt(factor) * rng.standard_normal(2)
        follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, i0, i1, 0.0, factor)
        scales.append((st[follow.SCALE_ALONG], st[follow.SCALE_ACROSS]))
    assert np.mean(scales[2000:], axis=0) == pytest.approx([factor, factor], rel=0.12)


def test_lean_along_the_hole_is_of_inclination_and_lean_across_it_of_toolface():
    rng = np.random.default_rng(4)
    x, P, st = blank()
    P[:2, :2] = 4e-6 * np.eye(2)
    # A horizontal tool along level x; it rocks along itself more than the filter knows.
    for _ in range(5000):
        i0, i1 = 3.0 * rng.standard_normal(), 0.3 * rng.standard_normal()
        follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, i0, i1, 0.0, 1.0)
    inclination, toolface = published(x, P, st)
    assert inclination > 4.0 * toolface


def test_an_accelerometer_that_shows_too_much_gravity_is_not_believed_across_it_either():
    x, P, st = blank()
    good = published(x, P, st)
    x[model.N_DOWN] = 0.06
    bad = published(x, P, st)
    assert bad[0] == pytest.approx(
        np.sqrt(good[0] ** 2 + (0.06**2 - settings.Params().gravity_sigma ** 2) / STANDARD_GRAVITY**2)
    )
    # What is fixed in a string that turns averages out across it; along it, it does not.
    st[follow.TURNING], st[follow.SLOW_AXIS] = 15.0, 1.0
    turning = published(x, P, st)
    assert turning[0] == pytest.approx(bad[0], rel=0.01)
    assert turning[1] < 0.3 * bad[1]


def fixed_in_a_turning_tool(**learnt: float) -> tuple[float, float]:
    """Sigmas of a horizontal tool at 143 r/min; learnt: variance of the bias across the axis, lever arm across it."""
    x, P, st = blank()
    P[:2, :2] = 0.0
    st[follow.TURNING], st[follow.SLOW_AXIS] = 15.0, 1.0
    P[model.BIAS + 1, model.BIAS + 1] = P[model.BIAS + 2, model.BIAS + 2] = learnt.get("bias", 0.0)
    x[model.N_LEVER + 1] = learnt.get("lever", 0.0)
    return published(x, P, st)


def test_a_bias_across_the_axis_that_turning_hides_is_a_tilt_fixed_in_the_tool():
    known, hidden = fixed_in_a_turning_tool(), fixed_in_a_turning_tool(bias=0.005**2)
    # 20 % of the variance of 5 mrad/s over 15 rad/s.
    expected = follow.BIAS_SHARE * (0.005 / 15.0) ** 2 / (1.0 + (follow.TURNING_FROM / 15.0) ** 2)
    assert hidden[0] ** 2 - known[0] ** 2 == pytest.approx(expected, rel=0.05)
    assert hidden[1] == pytest.approx(known[1])


def test_the_pull_of_the_circle_a_sensor_runs_leans_on_the_axis_by_the_calibration():
    on_axis, off_axis = fixed_in_a_turning_tool(), fixed_in_a_turning_tool(lever=0.05)
    pull = 15.0**2 * 0.05 / STANDARD_GRAVITY
    p = settings.Params()
    turning = p.turning_sigma**2 / (1.0 + (follow.TURNING_FROM / 15.0) ** 2)
    expected = pull**2 * (follow.SQUARE_SHARE * p.calibration_sigma**2 + turning)
    assert off_axis[0] ** 2 - on_axis[0] ** 2 == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("rate", "share"), [(0.002, 1.0), (0.2, 0.01)])
def test_travel_along_a_curve_is_an_acceleration_as_long_as_a_hole_can_turn_that_fast(rate, share):
    x, P, st = blank()
    P[:2, :2] = 0.0
    st[follow.SLOW_AXIS] = 1.0
    straight = published(x, P, st)
    # Turning to the side: the axis is ahead of its slow mean by rate times time, across itself.
    st[follow.SLOW_AXIS + 1] = -rate * follow.CURVE_TIME
    curved = published(x, P, st)
    pushed = settings.Params().travel * rate / STANDARD_GRAVITY
    assert curved[0] == pytest.approx(straight[0], rel=1e-6)
    assert curved[1] ** 2 - straight[1] ** 2 == pytest.approx(share * pushed**2, rel=0.05, abs=0.01 * pushed**2)


def test_a_vertical_that_does_not_stand_still_speaks_against_the_accelerometer():
    rng = np.random.default_rng(5)
    _, P, st = blank()
    P[:2, :2] = 4e-6 * np.eye(2)
    for power, low, high in ((0.05, 0.0, 0.0), (2.0, 0.8, 3.5)):
        excess = []
        for _ in range(10000):
            quiet = 0.1 * rng.standard_normal(2)
            down = np.sqrt(power) * rng.standard_normal()
            follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, quiet[0], quiet[1], down, 1.0)
            excess.append(follow.vertical_excess(st))
        assert low <= np.mean(excess[2000:]) <= high


def test_a_scale_learnt_after_a_start_forgets_the_start_in_its_own_time():
    rng = np.random.default_rng(6)
    _, P, st = blank()
    P[:2, :2] = 4e-6 * np.eye(2)
    for i in range(1000):
        # What a start has to find out goes on for 3 s; then all is 30 times quieter than the noises say.
        i0, i1 = (1.0 if i < 75 else 0.18) * rng.standard_normal(2)
        follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, i0, i1, 0.0, 1.0)
    assert 0.01 < st[follow.SCALE_ALONG] < 0.1


def test_innovations_of_one_sign_for_long_count_for_a_quarter_and_white_ones_in_full():
    shares = []
    for steady, alias in ((1.0, 0.0), (0.0, 0.0), (1.0, 1.0)):
        rng = np.random.default_rng(8)
        _, P, st = blank()
        P[:2, :2] = 4e-6 * np.eye(2)
        st[follow.ALIAS] = alias
        for _ in range(6000):
            i0, i1 = 0.05 * rng.standard_normal(2)
            follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, steady + i0, i1, 0.0, 1.0)
        shares.append(follow.error_shares(st))
    biased, white, aliased = shares
    assert biased[0] == pytest.approx(1.0 - follow.TWICE, abs=0.1)
    assert biased[1] > 0.7
    assert min(white) > 0.7
    assert aliased == (1.0, 1.0)


def test_heave_along_the_hole_that_slows_the_filter_counts_for_less_than_if_it_were_white():
    scales = []
    for swing in (0.0, 0.06):
        rng = np.random.default_rng(7)
        _, P, st = blank()
        # Tilt that answers within 80 s: beyond the longest sum.
        P[:2, :2] = 1e-4 * np.eye(2)
        st[follow.SWING_X] = swing
        for _ in range(5000):
            i0, i1 = rng.standard_normal(2)
            follow.follow_innovations(K, P, st, np.eye(3), 0.04, 1e-7, i0, i1, 0.0, 1.0)
        scales.append((st[follow.SCALE_ALONG], st[follow.SCALE_ACROSS]))
    white, heaving = scales
    assert heaving[0] == pytest.approx(white[0] * (follow.NEAR_MOST / 80.0) ** (1.0 / 3.0))
    assert heaving[1] == white[1]


def test_a_swing_that_no_hole_has_room_for_is_roll_out_of_step():
    x, P, st = blank()
    st[follow.TURNING], st[follow.SLOW_AXIS] = 15.0, 1.0
    st[follow.SWING_C] = follow.HOLE_ROOM**2
    narrow = published(x, P, st)
    st[follow.SWING_C] += 0.04
    wide = published(x, P, st)
    lag = 0.2 / (STANDARD_GRAVITY * settings.Params().swing_time ** 2)
    assert wide[0] == narrow[0]
    assert np.sqrt(wide[1] ** 2 - narrow[1] ** 2) == pytest.approx(lag, rel=0.03)

"""Which toolface a driller steers by, and when it changes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.status import Status
from mwd_sensors import wire
from mwd_surface.page.toolface import GRAVITY, MAGNETIC, ToolfaceSelector, ToolfaceSettings


def attitude(inclination_deg, gravity=1.0, magnetic=2.0, sigma=0.01, status=0):
    samples = wire.ATTITUDE.empty(1)
    samples["stamp_ns"] = 7
    samples["inclination"] = math.radians(inclination_deg)
    samples["gravity_toolface"], samples["magnetic_toolface"] = gravity, magnetic
    for name in ("sigma_inclination", "sigma_gravity_toolface", "sigma_magnetic_toolface"):
        samples[name] = sigma
    samples["status"] = status
    return samples


def test_near_vertical_the_toolface_counts_from_north_and_elsewhere_from_the_high_side():
    low = ToolfaceSelector().update(attitude(3.0))
    assert (low.mode, low.angle, low.stamp_ns) == (MAGNETIC, 2.0, 7)
    high = ToolfaceSelector().update(attitude(30.0))
    assert (high.mode, high.angle) == (GRAVITY, 1.0)


def test_the_mode_holds_between_threshold_and_hysteresis_from_either_side():
    selector = ToolfaceSelector(ToolfaceSettings(magnetic_below_deg=5.0, hysteresis_deg=1.0))
    modes = [selector.update(attitude(i)).mode for i in (4.0, 5.5, 5.9, 6.1, 5.5, 5.1, 4.9, 5.9)]
    assert modes == [MAGNETIC] * 3 + [GRAVITY] * 3 + [MAGNETIC] * 2


@given(st.lists(st.floats(5.01, 5.99), min_size=1, max_size=30))
def test_inclinations_inside_the_hysteresis_never_change_the_mode(inclinations):
    selector = ToolfaceSelector()
    first = selector.update(attitude(inclinations[0])).mode
    assert all(selector.update(attitude(i)).mode == first for i in inclinations)


def test_a_block_of_samples_gives_what_its_samples_give_one_by_one():
    block = np.concatenate([attitude(i) for i in (4.0, 7.0, 5.5)])
    whole, single = ToolfaceSelector(), ToolfaceSelector()
    assert whole.update(block) == [single.update(block[k : k + 1]) for k in range(3)][-1]


def test_an_unknown_inclination_leaves_the_mode_and_an_unknown_toolface_says_so():
    selector = ToolfaceSelector()
    selector.update(attitude(3.0))
    reading = selector.update(attitude(40.0, sigma=-1.0))
    assert (reading.mode, reading.angle, reading.sigma) == (MAGNETIC, 0.0, -1.0)
    bad = attitude(40.0, gravity=math.nan)
    assert selector.update(bad).sigma == -1.0


def test_a_turning_tool_gives_a_snapshot_and_no_samples_give_nothing():
    selector = ToolfaceSelector()
    reading = selector.update(attitude(40.0, status=int(Status.ROTATING)), rotary_speed=12.0)
    assert reading.rotating
    assert reading.rotary_speed == 12.0
    assert selector.update(wire.ATTITUDE.empty(0)) is None


def test_a_hole_that_goes_up_has_a_high_side_until_it_is_vertical_again():
    selector = ToolfaceSelector()
    assert selector.update(attitude(120.0)).mode == GRAVITY
    assert selector.update(attitude(177.0)).mode == MAGNETIC


def test_the_angle_is_within_one_turn():
    assert ToolfaceSelector().update(attitude(40.0, gravity=-0.5)).angle == pytest.approx(math.tau - 0.5)

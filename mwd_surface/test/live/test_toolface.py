# SPDX-License-Identifier: Apache-2.0
"""Which toolface a driller steers by, and when it changes."""

import math

import numpy as np
import pytest

from mwd_estimation.attitude import time_alignment
from mwd_estimation.attitude.sample import SAMPLE
from mwd_estimation.attitude.time_alignment import FieldModel, MagBlock, TimeAlignmentParams, initial
from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.live.toolface import GRAVITY, MAGNETIC, ToolfaceSelector


def attitude(inclination_deg, gravity=1.0, magnetic=2.0, sigma=0.01, status=None):
    if status is None:
        status = int(Status.NEAR_VERTICAL) if min(inclination_deg, 180.0 - inclination_deg) < 4.0 else 0
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


def test_the_mode_is_the_estimators_through_its_hysteresis_and_at_any_inclination_it_chooses():
    # The estimator goes into near vertical below one inclination and leaves it above a greater one; going up, too.
    inclination = np.radians(np.concatenate([np.linspace(1.0, 9.0, 60), np.linspace(9.0, 1.0, 60), [120.0, 178.0]]))
    samples = np.zeros(122, dtype=SAMPLE)
    samples["stamp_ns"] = np.arange(122) * 10**7
    samples["down"][:, 0], samples["down"][:, 2] = np.cos(inclination), np.sin(inclination)
    none = np.zeros(0, dtype=np.int64)
    no_field = MagBlock(none, np.zeros((0, 3)), none)
    params = TimeAlignmentParams(vertical_enter=np.radians(5.0), vertical_leave=np.radians(6.0))
    model = FieldModel((0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
    rows, _, _ = time_alignment.run(params, initial(), model, samples, no_field)
    selector = ToolfaceSelector()
    modes = [
        selector.update(attitude(np.degrees(i), status=s)).mode
        for i, s in zip(inclination, rows["status"], strict=True)
    ]
    changes = [round(float(np.degrees(inclination[k]))) for k in range(1, 122) if modes[k] != modes[k - 1]]
    assert modes[0] == MAGNETIC
    assert changes == [6, 5, 120, 178]


def test_a_block_of_samples_gives_what_its_samples_give_one_by_one():
    block = np.concatenate([attitude(i) for i in (2.0, 7.0, 3.5)])
    whole, single = ToolfaceSelector(), ToolfaceSelector()
    assert whole.update(block) == [single.update(block[k : k + 1]) for k in range(3)][-1]


def test_an_unknown_inclination_leaves_the_mode_and_an_unknown_toolface_says_so():
    selector = ToolfaceSelector()
    selector.update(attitude(3.0))
    reading = selector.update(attitude(40.0, sigma=math.nan))
    assert reading.mode == MAGNETIC
    assert math.isnan(reading.sigma)
    bad = attitude(40.0, gravity=math.nan)
    assert math.isnan(selector.update(bad).sigma)


@pytest.mark.fault_case(21)
def test_a_turning_tool_gives_a_snapshot_and_no_samples_give_nothing():
    selector = ToolfaceSelector()
    reading = selector.update(attitude(40.0, status=int(Status.ROTATING)), rotary_speed=12.0)
    assert reading.rotating
    assert reading.rotary_speed == 12.0
    assert selector.update(wire.ATTITUDE.empty(0)) is None


@pytest.mark.fault_case(29)
def test_a_hole_that_goes_up_has_a_high_side_until_it_is_vertical_again():
    selector = ToolfaceSelector()
    assert selector.update(attitude(120.0)).mode == GRAVITY
    assert selector.update(attitude(177.0)).mode == MAGNETIC


def test_the_angle_is_within_one_turn():
    assert ToolfaceSelector().update(attitude(40.0, gravity=-0.5)).angle == pytest.approx(math.tau - 0.5)

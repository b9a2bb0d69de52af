# SPDX-License-Identifier: Apache-2.0
"""The slide sheet: stretches by how the string turned, moments absorbed, toolface over the metres, motor yield."""

import math

import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch, SlideSheet, yields
from mwd_surface.trajectory.well_path import path_of

S = 10**9
FAST, STILL = 12.0, 0.0


def drilled(sheet, begin, end, speed, toolface=None, start_s=0, step=0.1, **more):
    ended = []
    for k, depth in enumerate(np.arange(begin, end + step / 2, step)):
        stretch = sheet.update((start_s + k) * S, float(depth), speed, toolface, **more)
        ended += [stretch] if stretch is not None else []
    return ended


def test_hole_is_put_to_the_way_it_was_made():
    sheet = SlideSheet()
    drilled(sheet, 100.0, 120.0, FAST)
    (rotated,) = drilled(sheet, 120.1, 126.0, STILL, toolface=1.0, start_s=1000)
    drilled(sheet, 126.1, 130.0, FAST, start_s=2000)
    one, two, three = sheet.stretches
    assert one == rotated
    assert [s.mode for s in (one, two, three)] == [ROTATE, SLIDE, ROTATE]
    assert (one.from_depth, one.to_depth) == pytest.approx((100.0, 120.0))
    assert two.length == pytest.approx(6.0)
    assert two.toolface == pytest.approx(1.0)
    assert two.steadiness == pytest.approx(1.0)
    assert (one.toolface, three.rotary_speed) == (None, pytest.approx(FAST))


def test_the_mean_toolface_goes_round_the_circle_and_counts_metres():
    sheet = SlideSheet()
    sheet.update(0, 100.0, STILL)
    for k in range(1, 31):
        sheet.update(k * S, 100.0 + 0.1 * k, STILL, math.radians(350.0 if k % 2 else 10.0))
    (slide,) = sheet.stretches
    assert math.remainder(slide.toolface, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert slide.steadiness == pytest.approx(math.cos(math.radians(10.0)))


def test_a_moment_of_the_other_way_makes_no_stretch():
    sheet = SlideSheet()
    drilled(sheet, 100.0, 110.0, STILL, 0.5)
    drilled(sheet, 110.1, 110.3, FAST)
    drilled(sheet, 110.4, 115.0, STILL, 0.5)
    (slide,) = sheet.stretches
    assert (slide.mode, slide.length) == (SLIDE, pytest.approx(15.0))
    assert slide.toolface == pytest.approx(0.5)


def test_a_string_that_only_begins_to_turn_is_no_slide():
    sheet = SlideSheet()
    drilled(sheet, 100.0, 100.2, STILL, 0.5)
    assert drilled(sheet, 100.3, 105.0, FAST) == []
    (rotated,) = sheet.stretches
    assert (rotated.mode, rotated.from_depth) == (ROTATE, 100.0)


def test_a_bit_off_bottom_and_a_jump_of_the_rig_make_no_hole():
    sheet = SlideSheet()
    drilled(sheet, 100.0, 105.0, FAST)
    sheet.update(500 * S, 105.0, STILL)
    sheet.update(501 * S, 90.0, STILL)
    assert sum(s.length for s in sheet.stretches) == pytest.approx(5.0)
    ended = sheet.update(502 * S, 900.0, STILL)
    assert ended.to_depth == pytest.approx(105.0)
    drilled(sheet, 900.1, 902.0, FAST)
    assert [round(s.from_depth) for s in sheet.stretches] == [100, 900]
    assert sheet.update(503 * S, math.nan, STILL) is None


def test_a_magnetic_toolface_is_named_so():
    sheet = SlideSheet()
    drilled(sheet, 10.0, 12.0, STILL, 2.0, magnetic=True)
    assert sheet.stretches[0].magnetic


def test_motor_yield_is_the_dogleg_over_the_metres_slid():
    md, inc = np.array([100.0, 130.0, 160.0]), np.radians([0.0, 2.0, 2.0])
    azi = np.zeros(3)
    path = path_of(
        "main", North.GRID, 0.0, (md, inc, azi), mc.path(md, inc, azi), ("tie-on", "survey", "survey"), (0, 1, 2)
    )
    stretches = [DrilledStretch(SLIDE, 100.0, 110.0, 0, 1, 0.0, 1.0), DrilledStretch(ROTATE, 110.0, 150.0, 1, 2)]
    one, two = yields(stretches, path)
    assert (one.slid, one.rotated) == (10.0, 20.0)
    assert one.motor == pytest.approx(math.radians(2.0) / 10.0)
    assert (two.slid, two.rotated, two.motor) == (0.0, 20.0, None)
    assert yields([], path) == ()


def test_a_sheet_goes_on_where_an_earlier_one_ended():
    earlier = (
        DrilledStretch(SLIDE, 1.0, 2.0, 3, 4, 0.5, 0.9),
        DrilledStretch(ROTATE, 2.0, 9.0, 4, 5, rotary_speed=12.0),
    )
    sheet = SlideSheet(earlier=earlier)
    drilled(sheet, 9.0, 12.0, STILL, 0.1)
    assert [(s.mode, s.from_depth) for s in sheet.stretches] == [(SLIDE, 1.0), (ROTATE, 2.0), (SLIDE, 9.0)]


def test_a_sheet_that_is_finished_keeps_what_was_at_hand_and_goes_on_from_there():
    sheet = SlideSheet()
    assert sheet.finish() is None
    drilled(sheet, 100.0, 110.0, STILL, 0.5)
    drilled(sheet, 110.1, 110.3, FAST, start_s=1000)
    ended = sheet.finish()
    assert (ended.mode, ended.to_depth) == (SLIDE, pytest.approx(110.3))
    assert ended.toolface == pytest.approx(0.5)
    assert sheet.finish() is None
    again = SlideSheet(earlier=sheet.stretches)
    drilled(again, 110.4, 112.0, FAST)
    assert sum(s.length for s in again.stretches) == pytest.approx(12.0)

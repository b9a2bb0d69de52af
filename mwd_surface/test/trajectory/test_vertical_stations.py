# SPDX-License-Identifier: Apache-2.0
"""The azimuth of a list at inclination 0 changes no projection, rate, section, offset, advice or comparison."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.advice import AdviceBasis, AdvisorySettings, advise
from mwd_surface.trajectory.dense_trajectory import Continuous, dense_trajectory
from mwd_surface.trajectory.list_comparison import difference
from mwd_surface.trajectory.plan import offset_from, offset_of_end, plan_of, steering_to
from mwd_surface.trajectory.slide_sheet import DrilledStretch
from mwd_surface.trajectory.well_path import path_of, projected

MD = np.arange(0.0, 361.0, 30.0)
BUILT = np.radians(np.interp(MD, [0, 120, 240, 300, 360], [0, 0, 6, 6, 3]))
azimuths = st.floats(0.0, 2.0 * math.pi)
printed_azimuths = st.lists(azimuths, min_size=MD.size, max_size=MD.size)
# Vertical to 150 m, then to 28.6 deg at an azimuth of 2 rad.
PLAN = plan_of([0.0, 150.0, 400.0, 900.0], [0.0, 0.0, 0.5, 0.5], [2.0] * 4)


def path(inclination, azimuth):
    positions = mc.path(MD, inclination, azimuth)
    kind = ("tie-on", *["survey"] * (MD.size - 1))
    return path_of("main", North.GRID, 2.0, (MD, inclination, azimuth), positions, kind, tuple(range(MD.size)))


def both(inclination, printed):
    """Return the same hole with azimuth 2 rad everywhere, and with any azimuth at its vertical stations."""
    plain = np.full(MD.size, 2.0)
    return path(inclination, plain), path(inclination, np.where(inclination == 0.0, printed, plain))


@settings(max_examples=25, deadline=None)
@given(printed=printed_azimuths, end=st.booleans(), how=st.sampled_from(["straight", "curve"]))
def test_positions_rates_section_and_projection_do_not_change(printed, end, how):
    inclination = np.where(MD > 300.0, 0.0, BUILT) if end else BUILT
    one, other = (projected(p, 380.0, how) for p in both(inclination, printed))
    for name in ("positions", "dogleg_severity", "build_rate", "turn_rate", "vertical_section", "inclination"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
    assert other.azimuth[-1] == one.azimuth[-1]


@settings(max_examples=25, deadline=None)
@given(printed=printed_azimuths, magnetic=st.booleans(), low=st.sampled_from([0.0, 0.02]))
def test_offset_from_the_plan_and_advice_do_not_change(printed, magnetic, low):
    """Of a hole that is vertical down to the bit, too: its toolfaces count from north."""
    known = AdviceBasis(sigma_inclination=0.002, sigma_azimuth=0.02, magnetic=magnetic)
    one, other = both(low * np.minimum(MD / 300.0, 1.0), printed)
    if low == 0.0:
        assert offset_of_end(PLAN, one) == offset_of_end(PLAN, other)
        assert advise(AdvisorySettings(), PLAN, one, (), known) == advise(AdvisorySettings(), PLAN, other, (), known)
    turned = plan_of(PLAN.md, PLAN.inclination, [printed[0], printed[1], 2.0, 2.0])
    point = one.positions[3] + [3.0, -1.0, 0.0]
    assert offset_from(turned, point, 0.0, printed[2]) == offset_from(PLAN, point, 0.0, 2.0)
    assert turned.section_azimuth == PLAN.section_azimuth


@settings(max_examples=25, deadline=None)
@given(printed=azimuths)
def test_a_vertical_hole_is_steered_by_directions_from_north(printed):
    target = np.array([0.0, 50.0, 200.0])
    assert steering_to(np.zeros(3), 0.0, printed, target) == steering_to(np.zeros(3), 0.0, 0.0, target)
    known = AdviceBasis(magnetic=True)
    advice = advise(AdvisorySettings(least_slide_m=0.0), PLAN, path(0.0 * MD, np.full(MD.size, printed)), (), known)
    # The plan leads away from the vertical at 2 rad.
    assert abs(math.remainder(advice.toolface - 2.0, math.tau)) < 0.01


@settings(max_examples=6, deadline=None)
@given(printed=printed_azimuths)
def test_the_hole_between_stations_does_not_change(printed):
    sheet = [
        DrilledStretch(mode, low, high, 0, 0)
        for k in range(4, 9)
        for mode, low, high in (("slide", 30.0 * k, 30.0 * k + 12.0), ("rotate", 30.0 * k + 12.0, 30.0 * k + 30.0))
    ]
    found = [dense_trajectory(p, None, sheet, 5.0) for p in both(BUILT, printed)]
    np.testing.assert_array_equal(found[1].positions, found[0].positions)
    at = np.arange(0.0, 360.0, 0.25)
    inclination = np.interp(at, MD, BUILT)
    continuous = Continuous(at, inclination, np.full(at.size, np.nan))
    found = [dense_trajectory(p, continuous, (), 5.0) for p in both(BUILT, printed)]
    np.testing.assert_array_equal(found[1].positions, found[0].positions)


@settings(max_examples=25, deadline=None)
@given(printed=printed_azimuths)
def test_two_surveys_of_a_hole_have_no_difference_of_azimuth_where_it_is_vertical(printed):
    one, other = both(BUILT, printed)
    found = difference(other, one)
    np.testing.assert_array_equal(np.isnan(found.turn[:, 1]), BUILT == 0.0)
    assert not found.position.any()
    assert not found.turn[BUILT > 0.0].any()

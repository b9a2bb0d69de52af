# SPDX-License-Identifier: Apache-2.0
"""Attitude between words: ages, growing sigma, withheld toolfaces, prediction by the top drive."""

import math

import numpy as np
import pytest
from example_words import received
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_surface.receiver.link.link_attitude import AgeRules, LinkAttitude, best
from mwd_surface.receiver.words import ERASED

RULES = AgeRules(toolface_max_age_s=60.0, toolface_rate_deg_s=0.5, toolface_sigma_deg=2.0)
REFERENCE = Reference(50e-6, math.radians(70.0), math.radians(2.0), math.radians(0.5), 9.82, "test")


def word(name, value, start_s, **fields):
    return received(name, value, start_s=start_s, **{"kind": "toolface", "revision": 0, **fields})


def with_toolface(**fields):
    """Return a link that received a toolface of 90 deg at 100 s."""
    attitude = LinkAttitude(RULES)
    attitude.take(word("aTFA", 90.0, 100.0, **fields))
    return attitude


def sample(attitude, now, reference=None):
    return attitude.sample(now, round(now * 1e9), reference)[0]


def degrees(row, name):
    return math.degrees(row[name]), math.degrees(row["sigma_" + name])


def test_the_sigma_of_a_toolface_grows_with_its_age_until_it_is_withheld():
    attitude = with_toolface()
    sigmas = [degrees(sample(attitude, now), "gravity_toolface")[1] for now in (100.0, 120.0, 159.0)]
    step = 360.0 / 64
    assert sigmas[0] == pytest.approx(math.hypot(step / math.sqrt(12.0), 2.0), rel=1e-6)
    assert sigmas[1] == pytest.approx(math.hypot(sigmas[0], 10.0), rel=1e-6)
    assert sigmas[2] > sigmas[1]
    late = sample(attitude, 161.0)
    assert math.isnan(late["gravity_toolface"])
    assert math.isnan(late["sigma_gravity_toolface"])
    assert attitude.toolface_age(161.0) == pytest.approx(61.0)


def test_the_age_counts_from_the_tool_not_from_the_arrival():
    attitude = LinkAttitude(RULES)
    attitude.travel_s = 3.0
    attitude.take(word("aTFA", 90.0, 100.0))
    assert attitude.toolface_age(110.0) == pytest.approx(13.0)


def test_while_the_string_turns_there_is_no_toolface():
    attitude = with_toolface()
    attitude.rotating = True
    row = sample(attitude, 101.0)
    assert np.isnan(row["sigma_gravity_toolface"]).all()
    assert row["status"] & Status.ROTATING


def test_an_erased_word_is_not_used_and_takes_its_provisional_one_back():
    assert math.isnan(with_toolface(status=ERASED).toolface_age(101.0))
    attitude = with_toolface()
    attitude.take(word("aTFA", 90.0, 100.0, status=ERASED, revision=1))
    assert math.isnan(attitude.toolface_age(101.0))


def test_the_toolface_turns_with_the_top_drive():
    attitude = LinkAttitude(RULES)
    for at in range(90, 140):
        attitude.take_quill(float(at), math.radians(30.0) if at >= 110 else 0.0)
    attitude.take(word("aTFA", 90.0, 100.0))
    before, after = (degrees(sample(attitude, now), "gravity_toolface") for now in (105.0, 115.0))
    assert before[0] == pytest.approx(90.0)
    assert after[0] == pytest.approx(120.0, abs=0.1)
    assert after[1] > before[1]


@pytest.mark.fault_case(44)
@given(at=st.floats(-1e9, 1e9).filter(lambda at: not 89.0 <= at <= 121.0), place=st.integers(92, 110))
def test_a_wrong_time_of_the_top_drive_does_not_exclude_the_right_ones_after_it(at, place):
    attitude = LinkAttitude(RULES)
    for second in range(90, 120):
        attitude.take_quill(at if second == place else float(second), math.radians(30.0) if second >= 112 else 0.0)
    attitude.take(word("aTFA", 90.0, 100.0))
    assert degrees(sample(attitude, 116.0), "gravity_toolface")[0] == pytest.approx(120.0, abs=0.1)


def test_a_string_that_slides_along_follows_the_top_drive_over_a_length_of_hole():
    """A turn of 90 deg once 0.3 m are drilled after it: 63 %; without drilling none, but the sigma grows."""
    found = []
    for speed in (0.3 / 20.0, 0.0):
        attitude = LinkAttitude(RULES)
        attitude.speed = speed
        for at in range(90, 140):
            attitude.take_quill(float(at), math.radians(90.0) if at > 100 else 0.0)
        attitude.take(word("aTFA", 90.0, 100.0))
        found.append(degrees(sample(attitude, 120.0), "gravity_toolface"))
    assert found[0][0] == pytest.approx(90.0 + 90.0 * (1.0 - math.exp(-1.0)), abs=0.5)
    assert found[1][0] == pytest.approx(90.0)
    assert found[1][1] > 0.15 * 90.0


def test_the_best_of_two_links_is_the_surer_one_of_each_angle():
    coarse, fine = with_toolface(), LinkAttitude(RULES)
    coarse.take(word("RINC", 31.0, 100.0))
    fine.take(word("aTFA", 95.0, 60.0))
    rows = [one.sample(110.0, 0, None) for one in (coarse, fine)]
    row = best(rows)
    assert row["gravity_toolface"] == rows[0]["gravity_toolface"]
    assert row["inclination"] == rows[0]["inclination"]
    assert np.isnan(row["sigma_azimuth"]).all()
    assert best(rows[1:]).tobytes() == rows[1].tobytes()


def test_near_vertical_the_automatic_toolface_is_from_north():
    attitude = LinkAttitude(RULES)
    attitude.take(word("RINC", 1.0, 99.0))
    attitude.take(word("aTFA", 90.0, 100.0))
    row = sample(attitude, 101.0, REFERENCE)
    assert row["status"] & Status.NEAR_VERTICAL
    assert degrees(row, "magnetic_toolface")[0] == pytest.approx(90.0 + 2.0 - 0.5)
    assert np.isnan(row["sigma_gravity_toolface"]).all()


def test_inclination_and_azimuth_are_the_newest_of_survey_and_continuous_words():
    attitude = LinkAttitude(RULES)
    attitude.take(word("Inc", 30.0, 10.0))
    attitude.take(word("RINC", 31.0, 50.0))
    attitude.take(word("RAZM", 100.0, 60.0))
    row = sample(attitude, 70.0, REFERENCE)
    assert degrees(row, "inclination")[0] == pytest.approx(31.0, abs=0.1)
    assert degrees(row, "azimuth")[0] == pytest.approx(101.5, abs=0.2)
    assert row["north"] == 3


def test_before_any_word_nothing_is_known():
    row = sample(LinkAttitude(RULES), 0.0)
    assert all(np.isnan(row["sigma_" + name]).all() for name in ("inclination", "azimuth", "gravity_toolface"))

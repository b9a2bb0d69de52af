# SPDX-License-Identifier: Apache-2.0
"""Advice on the next interval: it leads back to the plan when it is followed, and says how sure it is."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.advice import AdviceBasis, AdviceMode, AdvisorySettings, advise, motor_yield
from mwd_surface.trajectory.plan import nearest, plan_of
from mwd_surface.trajectory.slide_sheet import Yield

DEG = math.pi / 180.0
PLAN = plan_of([0.0, 500.0, 1100.0, 3000.0], [0.0, 0.0, 60 * DEG, 60 * DEG], [0.7] * 4)
KNOWN = AdviceBasis(survey=7, stamp_ns=9, sigma_inclination=0.1 * DEG, sigma_azimuth=0.5 * DEG)


@dataclasses.dataclass
class Path:
    """As much of a Definitive as an advice is made from: the end of a hole."""

    md: np.ndarray
    inclination: np.ndarray
    azimuth: np.ndarray
    positions: np.ndarray
    assumptions: tuple = ()
    assumed: bool = False


def path_at(md, up=0.0, right=0.0, inclination=None, azimuth=None):
    inc, azi, at = mc.interpolate(PLAN.md, PLAN.inclination, PLAN.azimuth, PLAN.positions, md)
    high = np.array([math.cos(inc) * math.cos(azi), math.cos(inc) * math.sin(azi), -math.sin(inc)])
    end = at + up * high + right * np.array([-math.sin(azi), math.cos(azi), 0.0])
    inc, azi = (float(a) if b is None else b for a, b in ((inc, inclination), (azi, azimuth)))
    return Path(np.array([0.0, md]), np.array([0.0, inc]), np.array([azi, azi]), np.array([[0.0, 0.0, 0.0], end]))


def test_without_plan_or_survey_there_is_none_and_it_says_why():
    assert advise(AdvisorySettings(), None, path_at(1500.0), (), KNOWN).reason.startswith("no plan")
    empty = Path(np.array([0.0]), np.array([0.0]), np.array([0.0]), np.zeros((1, 3)))
    assert advise(AdvisorySettings(), PLAN, empty, (), KNOWN).reason == "no survey is accepted yet"
    assert advise(AdvisorySettings(), PLAN, path_at(3000.0), (), KNOWN).reason == "the plan ends here"


def test_on_a_straight_plan_the_hole_is_rotated():
    advice = advise(AdvisorySettings(), PLAN, path_at(2000.0), (), KNOWN)
    assert advice.mode == AdviceMode.ROTATE
    assert (advice.from_depth, advice.to_depth) == (2000.0, 2028.0)


@pytest.mark.parametrize(("up", "right", "toolface"), [(3, 0, 180), (-3, 0, 0), (0, 3, 270), (0, -3, 90)])
def test_the_toolface_leads_back_to_the_plan(up, right, toolface):
    advice = advise(AdvisorySettings(), PLAN, path_at(2000.0, up, right), (), KNOWN)
    assert advice.mode == AdviceMode.SLIDE
    assert math.degrees(math.remainder(advice.toolface - toolface * DEG, math.tau)) == pytest.approx(0.0, abs=0.1)
    assert advice.survey == 7


@pytest.mark.slow
@given(
    up=st.floats(-4.0, 4.0),
    right=st.floats(-4.0, 4.0),
    off_inclination=st.floats(-1.0, 1.0),
    off_azimuth=st.floats(-1.0, 1.0),
)
def test_the_arc_it_asks_for_ends_on_the_plan(up, right, off_inclination, off_azimuth):
    path = path_at(2000.0, up, right, 60 * DEG + off_inclination * DEG, 0.7 + off_azimuth * DEG)
    settings = AdvisorySettings(interval_m=60.0, least_slide_m=0.0)
    advice = advise(settings, PLAN, path, (), KNOWN)
    assert advice.mode == AdviceMode.SLIDE
    # Slid as advised and rotated straight is, at the end, as near to the plan as one arc of that dogleg all the way.
    length = advice.dogleg_severity
    assert 0.0 <= advice.confidence <= 1.0
    inc, azi = path.inclination[-1], path.azimuth[-1]
    t = mc.tangent(inc, azi)
    high = np.array([math.cos(inc) * math.cos(azi), math.cos(inc) * math.sin(azi), -math.sin(inc)])
    side = np.array([-math.sin(azi), math.cos(azi), 0.0])
    across = math.cos(advice.toolface) * high + math.sin(advice.toolface) * side
    radius = 1.0 / max(length, 1e-9)
    arc = [
        path.positions[-1] + radius * (math.sin(s / radius) * t + (1.0 - math.cos(s / radius)) * across)
        for s in np.linspace(55.0, 65.0, 41)
    ]
    _, _, feet = mc.interpolate(
        PLAN.md, PLAN.inclination, PLAN.azimuth, PLAN.positions, np.array([nearest(PLAN, p) for p in arc])
    )
    assert np.min(np.linalg.norm(np.array(arc) - feet, axis=1)) < 0.05


def test_the_slide_is_as_long_as_the_motor_needs_and_the_sheet_counts():
    specified = advise(AdvisorySettings(), PLAN, path_at(2000.0, -3.0), (), KNOWN)
    weak = [Yield(0.0, 30.0, 10.0, 20.0, 10.0 * 4 * DEG / 30)] * 3
    measured = advise(AdvisorySettings(), PLAN, path_at(2000.0, -3.0), weak, KNOWN)
    slid = [a.slide_to_depth - a.from_depth for a in (specified, measured)]
    assert slid[1] == pytest.approx(2.0 * slid[0])
    assert "as specified" in specified.reason
    assert "as measured" in measured.reason
    far = advise(AdvisorySettings(), PLAN, path_at(2000.0, -30.0), (), KNOWN)
    assert far.slide_to_depth == far.to_depth
    assert "falls behind" in far.reason


def test_the_yield_is_the_median_of_the_last_intervals_that_were_slid():
    made = [Yield(0, 30, 10, 20, v) for v in (9.0, 0.1, 0.2, 0.3)] + [Yield(0, 30, 0.0, 30, 1.0)]
    assert motor_yield(made) == pytest.approx(0.02)
    assert motor_yield(made[-1:]) is None


def test_the_sigma_is_that_of_drawn_surveys():
    """The toolface that is advised for surveys drawn with their sigma scatters as its own sigma says."""
    from consistency import assert_consistent

    rng = np.random.default_rng(5)
    sigma = AdviceBasis(sigma_inclination=0.1 * DEG, sigma_azimuth=0.12 * DEG)
    truth = advise(AdvisorySettings(), PLAN, path_at(2000.0, 2.0, 3.0), (), sigma)
    errors = []
    for _ in range(400):
        inc = 60 * DEG + sigma.sigma_inclination * rng.standard_normal()
        azi = 0.7 + sigma.sigma_azimuth * rng.standard_normal()
        drawn = advise(AdvisorySettings(), PLAN, path_at(2000.0, 2.0, 3.0, inc, azi), (), sigma)
        errors.append(math.remainder(drawn.toolface - truth.toolface, math.tau))
    assert_consistent(np.array(errors), np.full(len(errors), truth.sigma))


def test_a_toolface_set_by_hand_goes_before_the_plan():
    advice = advise(AdvisorySettings(toolface_deg=30.0), PLAN, path_at(2000.0), (), KNOWN)
    assert (advice.mode, advice.source) == (AdviceMode.SLIDE, "directional driller")
    assert math.degrees(advice.toolface) == pytest.approx(30.0)


def test_near_vertical_the_toolface_counts_from_north():
    gravity = advise(AdvisorySettings(), PLAN, path_at(2000.0, -3.0), (), KNOWN)
    magnetic = advise(AdvisorySettings(), PLAN, path_at(2000.0, -3.0), (), dataclasses.replace(KNOWN, magnetic=True))
    assert math.remainder(magnetic.toolface - gravity.toolface - 0.7, math.tau) == pytest.approx(0.0, abs=1e-9)

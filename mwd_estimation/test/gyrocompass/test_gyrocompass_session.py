# SPDX-License-Identifier: Apache-2.0
"""North on request: the time asked for, progress that narrows, either unit's x gyro, and reasons for no answer."""

import dataclasses
import math

import numpy as np
import pytest
from north_signals import measured, motion, steady

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_state import TACTICAL
from mwd_estimation.gyrocompass.session import NorthSession, SessionParams
from mwd_sensors.core.frames import wrap_pi

DEG = math.radians(1.0)
LATITUDE = 50.0
UNIT = dataclasses.replace(
    TACTICAL,
    latitude_deg=LATITUDE,
    gyro_noise_deg_rth=0.02,
    gyro_bias_deg_h=0.02,
    gyro_x_bias_deg_h=0.02,
    gyro_ramp_deg_h2=0.012,
    gyro_walk_deg_h_rth=0.0,
    g_sensitivity_deg_h_g=0.02,
    shortest=20.0,
)
RATE = 50.0


def bins(seconds, rpm=0.0, seed=1, sway_deg=0.0):
    """Half-second bins of both units on a tool at inclination 40, azimuth 100 deg; it sways once in 20 s."""
    inclination = lambda t: (40.0 + sway_deg * np.sin(2.0 * np.pi * t / 20.0)) * DEG  # noqa: E731
    tool = motion(seconds, LATITUDE * DEG, inclination, lambda t: 100.0 * DEG + 0.0 * t, steady(rpm), RATE)
    rng = np.random.default_rng(seed)
    gyro, accel = measured(tool, rng, 0.02, 0.02)
    ahrs = tool.gyro_t.copy()
    values = np.hstack([gyro, accel])
    if rpm:
        limit = math.radians(UNIT.gyro_range_dps)
        values[:, 0] = np.clip(values[:, 0], -limit, limit)
    step = int(RATE / 2)
    for k in range(0, len(values) - step + 1, step):
        part = slice(k, k + step)
        yield 0.5, UnitSamples(tool.stamp_ns[part], values[part]), (tool.stamp_ns[part], ahrs[part])


@pytest.mark.slow
@pytest.mark.parametrize(("rpm", "method"), [(0.0, "still"), (60.0, "rotating")])
def test_north_is_found_in_the_time_asked_for_at_rest_and_turning(rpm, method):
    run = NorthSession(SessionParams(), UNIT, 60.0, "")
    shown = {}
    for count, one in enumerate(bins(90.0, rpm), start=1):
        assert not run.done
        run.add(*one)
        if count in (1, 61):
            shown[count] = (run.elapsed, run.remaining, run.solution())
        if run.done:
            break
    assert count == 120
    assert shown[1][:2] == (0.5, 59.5)
    assert math.isnan(shown[1][2].azimuth)
    found = run.solution()
    assert found.success, found.reason
    assert found.method == method
    assert abs(wrap_pi(found.azimuth - 100.0 * DEG)) < 3.0 * found.sigma < 8.0 * DEG
    assert found.sigma < shown[61][2].sigma


def test_a_flagged_x_rate_that_looks_small_is_that_of_the_conventional_unit():
    # 30 r/min is within the range: only the flag tells that a mean of clipped readings is none.
    plain, flagged = (NorthSession(SessionParams(), UNIT, 40.0, "") for _ in range(2))
    for seconds, precision, ahrs in bins(40.0, 30.0):
        plain.add(seconds, precision, ahrs)
        bits = np.zeros(len(precision.stamps), np.uint8)
        bits[::2] = clip_flags.AXIAL_GYRO
        values = precision.values.copy()
        values[::2, 0] = 0.1
        flagged.add(seconds, UnitSamples(precision.stamps, values, bits), ahrs)
    found, told = plain.solution(), flagged.solution()
    assert told.success, told.reason
    assert abs(wrap_pi(told.azimuth - found.azimuth)) < 0.5 * found.sigma


def test_a_seek_that_begins_again_gets_the_lost_time_and_at_most_as_much_again():
    steady_run, swaying_run = (NorthSession(SessionParams(), UNIT, 40.0, "") for _ in range(2))
    for run, sway_deg in ((steady_run, 0.0), (swaying_run, 0.05)):
        for one in bins(90.0, sway_deg=sway_deg):
            if not run.done:
                run.add(*one)
    assert steady_run.duration == 40.0
    assert 40.0 + 12.0 < swaying_run.duration <= 80.0
    # It ends with a bin of half a second.
    assert 0.0 <= swaying_run.elapsed - swaying_run.duration < 0.5


def test_the_sway_before_a_gap_is_forgotten():
    def after_a_gap(first):
        state = north_seek.initial()
        for k, (_, unit, _) in enumerate((*first, *bins(40.0))):
            stamps = unit.stamps + (0 if k < len(first) else 3_600 * 10**9)
            north_seek.run(UNIT, state, stamps, unit.values[:, :3], unit.values[:, 3:])
        return state

    swayed, alone = after_a_gap(tuple(bins(30.0, sway_deg=0.05))), after_a_gap(())
    np.testing.assert_allclose(swayed.scatter, alone.scatter, rtol=1e-6)
    assert float(swayed.elapsed) == pytest.approx(float(alone.elapsed))


def test_without_a_precision_unit_there_is_a_reason_instead_of_an_azimuth():
    run = NorthSession(SessionParams(duration_s=20.0), UNIT, 0.0, "still")
    nothing = np.zeros(0, dtype=np.int64)
    for _ in range(48):
        assert not run.done
        run.add(0.5, UnitSamples(nothing, np.zeros((0, 6))), (nothing, np.zeros((0, 3))))
    assert run.done
    assert not run.solution().success
    assert run.solution().reason.code is ReasonCode.NO_PRECISION_UNIT
    assert "no samples of the precision unit" in text(run.solution().reason)


def test_the_shortest_seek_that_may_be_asked_for_lasts_until_it_has_an_azimuth() -> None:
    run = NorthSession(SessionParams(), UNIT, UNIT.shortest, "")
    for one in bins(40.0, 0.0):
        if not run.done:
            run.add(*one)
    assert run.done
    assert run.solution().success, run.solution().reason


@pytest.mark.parametrize(
    ("duration", "mode", "words"), [(60.0, "sideways", "mode"), (-1.0, "", "duration"), (5.0, "", "at least 20 s")]
)
def test_what_cannot_be_sought_is_refused_before_it_begins(duration, mode, words):
    with pytest.raises(ValueError, match=words):
        NorthSession(SessionParams(), UNIT, duration, mode)

# SPDX-License-Identifier: Apache-2.0
"""Both seekers of a station behind one face: same north, each its own limits."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from north_signals import measured, motion, steady, still

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_state import SeekParams
from mwd_estimation.gyrocompass.station import NorthSeek, StaticSeek
from mwd_sensors.core.constants import DEG_PER_HOUR
from mwd_sensors.core.frames import wrap_pi

DEG = math.radians(1.0)
PARAMS = SeekParams(
    latitude_deg=44.0,
    gyro_noise_deg_rth=0.01,
    gyro_x_noise_deg_rth=0.01,
    gyro_bias_deg_h=0.02,
    gyro_x_bias_deg_h=0.02,
    gyro_walk_deg_h_rth=0.0,
    scale_x_ppm=300.0,
)


def fed(seeker, seconds: float = 63.5, bias: float = 0.02, roll=still, clipped: int = 0, inclination: float = 1.0):
    clean = motion(seconds, 44.0 * DEG, inclination, 2.2, roll, 50.0)
    gyro, accel = measured(
        clean, np.random.default_rng(1), 0.01, None, 30.0, np.array([0.0, bias, -bias]) * DEG_PER_HOUR
    )
    flags = np.zeros(len(gyro), np.uint8)
    flags[:clipped] = clip_flags.CROSS_GYRO
    for block in np.array_split(np.arange(len(gyro)), 7):
        seeker.run(UnitSamples(clean.stamp_ns[block], np.hstack([gyro[block], accel[block]]), flags[block]))
    return seeker


@pytest.mark.parametrize("kind", [NorthSeek, StaticSeek])
def test_a_still_tool_finds_the_same_north_by_either(kind) -> None:
    seeker = fed(kind(PARAMS))
    found = seeker.solution()
    assert found.success, found.reason
    assert seeker.elapsed == pytest.approx(61.0, abs=3.0)
    assert not seeker.moved
    assert abs(float(wrap_pi(found.azimuth - 2.2))) < 3.0 * found.sigma
    assert found.sigma == pytest.approx(found.limit, rel=0.2)
    assert found.inclination == pytest.approx(1.0, abs=1e-3)
    # The scribe line, 0.4 rad clockwise from high side: its level part along the heading and to the right of it.
    scribe = 2.2 + math.atan2(math.sin(0.4), math.cos(0.4) * math.cos(1.0))
    assert abs(float(wrap_pi(found.toolface - scribe))) < 0.02


def test_only_the_best_takes_a_turn_and_what_an_earlier_seek_found() -> None:
    assert NorthSeek.turns
    assert not StaticSeek.turns
    wide = dataclasses.replace(PARAMS, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0)
    first = NorthSeek(wide)
    fed(first, roll=lambda t: 0.4 + math.pi * np.clip((t - 29.0) / 6.0, 0.0, 1.0), bias=3.0)
    carried = fed(NorthSeek(wide, north_seek.learnt(wide, first.state)), bias=3.0).solution()
    assert carried.success, carried.reason
    assert abs(float(wrap_pi(carried.azimuth - 2.2))) < 3.0 * carried.sigma
    assert not fed(NorthSeek(wide), bias=3.0).solution().success


@pytest.mark.parametrize("kind", [NorthSeek, StaticSeek])
def test_flags_of_clipped_gyros_refuse_north_by_either(kind) -> None:
    assert fed(kind(PARAMS), clipped=2).solution().success
    found = fed(kind(PARAMS), clipped=40).solution()
    assert not found.success
    assert found.reason.code is ReasonCode.GYRO_CLIPPED
    assert found.reason.value == 40.0 if kind is StaticSeek else 39.0


@pytest.mark.fault_case(33)
def test_s1_refuses_what_it_cannot_measure() -> None:
    def reason(seconds: float = 63.5, roll=still, inclination: float = 1.0, **changes: float) -> ReasonCode:
        seeker = StaticSeek(dataclasses.replace(PARAMS, **changes))
        found = fed(seeker, seconds, roll=roll, inclination=inclination).solution()
        assert not found.success
        return found.reason.code

    assert reason(10.0) is ReasonCode.SEEK_TOO_SHORT
    assert reason(latitude_deg=88.0) is ReasonCode.LATITUDE_POLAR
    assert reason(gyro_bias_deg_h=10.0) is ReasonCode.GYRO_BIAS_UNKNOWN_STATIC
    assert reason(roll=steady(1.0)) is ReasonCode.TOOL_MOVED
    assert reason(inclination=0.01) is ReasonCode.VERTICAL_HOLE
    assert StaticSeek(PARAMS).solution().reason.value == 0.0

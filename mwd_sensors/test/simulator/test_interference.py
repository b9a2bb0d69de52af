# SPDX-License-Identifier: Apache-2.0
"""Interference: fields that obey their laws, and the papers' cases come out as printed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.core.frames import mat_nt
from mwd_sensors.simulator import interference, scenario
from mwd_sensors.simulator.interference import Anomaly, CasedWell, Diurnal, Interference, Pole, ToolJoints
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

EARTH = np.array([[20e-6, -2e-6, 45e-6]])


def sensed(item, inclination=0.7, azimuth=1.0, toolface=2.0, position=(0.0, 0.0, 0.0), md=0.0, seed=1):
    made = interference.disturbance(item, 5e-5, np.random.default_rng(seed))
    mat = mat_nt(inclination, azimuth, toolface)[None]
    return made.at(mat, EARTH, np.array([position], dtype=float), np.array([md], dtype=float))[0]


def test_the_string_s_field_turns_with_the_tool():
    item = Interference(axial_nt=2000.0, axial_relative=0.5, cross_nt=(100.0, -50.0))
    for toolface in (0.0, 1.0, 4.0):
        assert_allclose(sensed(item, toolface=toolface), [27e-6, 1e-7, -0.5e-7], atol=1e-18)


def test_s1_s_field_case_turns_the_magnetic_azimuth_as_printed():
    given = scenario.read(SCENARIOS / "s1_field.yaml")
    sonde = Sonde(given)
    reference = sonde.reference
    for md, true_deg, off_deg in ((30.0, 159.42, 22.79), (60.0, 161.53, -17.70), (90.0, 163.17, -22.43)):
        mat = mat_nt(math.radians(70.0), math.radians(true_deg), 0.3)[None]
        disturbed_t = interference.to_tool(mat, reference.field_n) + sonde.interference.at(
            mat, reference.field_n[None], np.zeros((1, 3)), np.array([md])
        )
        b_n = mat[0] @ disturbed_t[0]
        turned = math.degrees(math.atan2(b_n[1], b_n[0]) - reference.declination)
        # A field that is turned east by an angle makes the azimuth read low by the same angle.
        assert turned == pytest.approx(off_deg, abs=0.05)


def test_a_pole_s_field_falls_with_the_square_and_two_make_a_dipole():
    pole = np.array([[0.0, 0.0, 0.0]])
    near, far = (interference.pole_field(np.array([[d, 0.0, 0.0]]), pole, np.array([1e-4]))[0] for d in (2.0, 4.0))
    assert near[0] == pytest.approx(1e-4 / (4.0 * math.pi * 4.0))
    assert near[0] / far[0] == pytest.approx(4.0)
    pair = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]])
    two = [interference.pole_field(np.array([[d, 0.0, 0.0]]), pair, np.array([-1e-4, 1e-4]))[0] for d in (20.0, 40.0)]
    assert two[0][2] / two[1][2] == pytest.approx(8.0, rel=1e-2)
    inside = interference.pole_field(np.zeros((1, 3)), pole, np.array([1e-4]))
    assert np.isfinite(inside).all()


def test_the_poles_of_an_offset_well_sum_to_zero_and_its_field_is_local():
    item = Interference(offset_wells=(CasedWell((0.0, 5.0, 0.0), (0.0, 5.0, 240.0)),))
    made = interference.disturbance(item, 5e-5, np.random.default_rng(3))
    assert made.pole_strength.sum() == pytest.approx(0.0, abs=1e-18)
    assert len(made.pole_strength) == 21
    near = np.linalg.norm(sensed(item, position=(0.0, 0.0, 120.0)))
    assert near > 50 * np.linalg.norm(sensed(item, position=(0.0, 400.0, 120.0)))


def test_soft_iron_is_induced_by_the_field_in_the_tool():
    mat = mat_nt(0.7, 1.0, 2.0)
    rows = ((0.01, 0.0, 0.002), (0.0, -0.005, 0.0), (0.0, 0.0, 0.003))
    assert_allclose(sensed(Interference(soft_iron=rows)), np.array(rows) @ mat.T @ EARTH[0], atol=1e-18)


def test_tool_joints_pass_and_anomalies_are_interpolated():
    item = Interference(tool_joints=ToolJoints(9.0, 1500.0, 0.4))
    assert sensed(item, md=18.0)[0] == pytest.approx(1.5e-6)
    assert sensed(item, md=18.4)[0] == pytest.approx(0.75e-6)
    assert sensed(item, md=22.5)[0] == pytest.approx(0.0, abs=1e-15)
    item = Interference(anomalies=(Anomaly(10.0, (0.0, 0.0, 0.0)), Anomaly(20.0, (1000.0, 0.0, 0.0))))
    mat = mat_nt(0.7, 1.0, 2.0)
    assert_allclose(mat @ sensed(item, md=15.0), [0.5e-6, 0.0, 0.0], atol=1e-18)
    assert_allclose(mat @ sensed(item, md=99.0), [1e-6, 0.0, 0.0], atol=1e-18)


def test_the_day_goes_round():
    made = interference.disturbance(
        Interference(diurnal=Diurnal((30.0, 20.0, 10.0), 12.0)), 5e-5, np.random.default_rng(1)
    )
    day = made.daily(np.array([0.0, 12.0, 18.0, 24.0]) * 3600.0)
    assert_allclose(day[1], [30e-9, 20e-9, 10e-9])
    assert_allclose(day[0], -day[1])
    assert_allclose(day[2], 0.0, atol=1e-20)
    assert_allclose(day[0], day[3])


def test_a_pole_in_the_ground_stays_there_while_the_tool_turns():
    item = Interference(poles=(Pole((0.0, 3.0, 0.0), 200.0),))
    fields = [mat_nt(0.7, 1.0, tf) @ sensed(item, toolface=tf) for tf in (0.0, 2.0)]
    assert_allclose(fields[0], fields[1], atol=1e-18)
    assert fields[0][1] < 0.0

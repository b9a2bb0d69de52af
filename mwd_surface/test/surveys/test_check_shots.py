# SPDX-License-Identifier: Apache-2.0
"""Repeated surveys at one depth: shots of a good tool pass, a bad sensor is found, other tools are compared too."""

import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.core.error_model import SensorErrors
from mwd_sensors.core.frames import mat_nt
from mwd_surface.surveys.check_shots import DOUBTFUL, FAIL, PASS, REPEAT_FIELD, REPEAT_FORCE, check_shots

FIELD_N = 50e-6 * np.array([math.cos(1.25), 0.0, math.sin(1.25)])
ERRORS = SensorErrors()


class Tool:
    """A tool with errors of its own, drawn from the tool code."""

    def __init__(self, rng, errors=ERRORS):
        self.rng = rng
        self.bias_f = errors.accelerometer_bias_mps2 * rng.normal(size=3)
        self.bias_b = errors.magnetometer_bias_nt * 1e-9 * rng.normal(size=3)
        self.scale_f = errors.accelerometer_scale * rng.normal(size=3)
        self.scale_b = errors.magnetometer_scale * rng.normal(size=3)
        self.axial = errors.axial_interference_nt * 1e-9 * rng.normal()
        self.tilt = math.radians(errors.misalignment_deg) * rng.normal(size=2)

    def shot(self, inclination, azimuth, toolface):
        """Readings at an attitude of the hole."""
        mat = mat_nt(inclination, azimuth, toolface)
        tilt = np.array([0.0, *self.tilt])
        down, field = mat.T @ [0.0, 0.0, -9.81], mat.T @ FIELD_N
        down, field = down + np.cross(tilt, down), field + np.cross(tilt, field)
        force = down * (1.0 + self.scale_f) + self.bias_f + REPEAT_FORCE * self.rng.normal(size=3)
        read = field * (1.0 + self.scale_b) + self.bias_b + REPEAT_FIELD * self.rng.normal(size=3)
        return force, read + np.array([self.axial, 0.0, 0.0])

    def shots(self, inclination, azimuth, toolfaces):
        """Readings at several toolfaces, shape (n, 3) each."""
        force, field = zip(*(self.shot(inclination, azimuth, face) for face in toolfaces), strict=True)
        return np.array(force), np.array(field)


FACES = np.radians([10.0, 100.0, 190.0, 280.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tools", "inclination_deg"),
    [
        *((1, 2.0), (1, 60.0), (2, 20.0), (2, 90.0)),
        *(pytest.param(*one, marks=pytest.mark.nightly) for one in ((1, 20.0), (1, 90.0), (2, 2.0), (2, 60.0))),
    ],
)
def test_the_chi_square_of_good_shots_is_that_of_chance(inclination_deg, tools):
    rng = np.random.default_rng(int(10 * inclination_deg) + tools)
    inclination, found = math.radians(inclination_deg), []
    for _ in range(400):
        azimuth = rng.uniform(0.0, math.tau)
        given = [Tool(rng) for _ in range(tools)]
        force, field = (
            np.concatenate(parts)
            for parts in zip(
                *(tool.shots(inclination, azimuth, rng.uniform(0.0, math.tau) + FACES) for tool in given), strict=True
            )
        )
        names = [str(k // 4) for k in range(4 * tools)]
        (one,) = check_shots(np.full(4 * tools, 1000.0), force, field, ERRORS, names)
        found.append(one)
    assert {one.degrees_of_freedom for one in found} == {(4 * tools - 1) * (2 if inclination_deg > 3.0 else 1)}
    # Each chi-square is the square of as many errors over their sigmas.
    normalised = np.sqrt([one.chi_square / one.degrees_of_freedom for one in found])
    degrees = found[0].degrees_of_freedom
    assert_consistent(np.repeat(normalised, degrees), 1.0)
    assert sum(one.verdict == FAIL for one in found) <= 4


def test_the_bias_of_a_sensor_is_found_and_named():
    rng = np.random.default_rng(4)
    tool = Tool(rng, SensorErrors(misalignment_deg=0.0))
    tool.bias_b = np.array([0.0, 0.0, 700e-9])
    tool.bias_f = np.zeros(3)
    (one,) = check_shots(np.full(4, 1000.0), *tool.shots(0.7, 2.0, FACES), ERRORS)
    assert one.verdict != PASS
    excessive = [bias for bias in one.biases if bias.excessive]
    assert [(bias.sensor, bias.axis) for bias in excessive] == [("magnetometer", "z")]
    assert excessive[0].value == pytest.approx(700e-9, abs=3.0 * excessive[0].sigma)


def test_steel_beside_one_of_two_shots_fails():
    rng = np.random.default_rng(6)
    force, field = Tool(rng).shots(0.9, 1.0, FACES[:2])
    field[1] += [0.0, 2e-6, 0.0]
    (one,) = check_shots([500.0, 500.2], force, field, ERRORS)
    assert one.verdict == FAIL
    assert one.biases == ()
    assert one.spread_azimuth > one.expected_azimuth


def test_shots_of_half_a_circle_show_no_bias():
    rng = np.random.default_rng(7)
    (one,) = check_shots(np.full(3, 500.0), *Tool(rng).shots(0.9, 1.0, FACES[:3] * 0.5), ERRORS)
    assert one.biases == ()


def test_only_surveys_at_one_depth_are_compared():
    rng = np.random.default_rng(8)
    force, field = Tool(rng).shots(0.9, 1.0, np.radians([0.0, 90.0, 20.0, 180.0, 50.0]))
    force[4] = np.nan
    found = check_shots([100.0, 130.0, 100.3, 160.0, 130.1], force, field, ERRORS)
    assert [one.rows for one in found] == [(0, 2)]
    assert check_shots([100.0, np.nan, np.nan], force[:3], field[:3], ERRORS) == ()
    with pytest.raises(ValueError, match="shapes"):
        check_shots([100.0], force, field, ERRORS)


def test_a_tool_out_of_its_code_is_doubted_at_least():
    rng = np.random.default_rng(9)
    tool = Tool(rng)
    tool.bias_f = np.array([0.0, 0.05, 0.0])
    (one,) = check_shots(np.full(4, 1000.0), *tool.shots(0.5, 2.0, FACES), ERRORS)
    assert one.verdict in (DOUBTFUL, FAIL)
    assert any(bias.excessive and bias.sensor == "accelerometer" and bias.axis == "y" for bias in one.biases)


@pytest.mark.parametrize("inclination_deg", [20.0, 60.0, 90.0])
@pytest.mark.parametrize("turn", ["up", "right"])
def test_a_good_tool_passes_where_the_hole_curves_between_its_shots(inclination_deg, turn):
    """A dogleg of 4 to 8 deg/30 m over the 40 cm between four shots."""
    rng, failed = np.random.default_rng(36), 0
    for _ in range(60):
        tool, depth, curvature = Tool(rng), rng.uniform(0.0, 0.4, 4), math.radians(rng.uniform(4.0, 8.0)) / 30.0
        bend = (depth - depth.min()) * curvature
        inclination = math.radians(inclination_deg) + (bend if turn == "up" else 0.0 * bend)
        azimuth = 1.0 + (bend / math.sin(math.radians(inclination_deg)) if turn == "right" else 0.0 * bend)
        read = [tool.shot(*attitude) for attitude in zip(inclination, azimuth, FACES, strict=True)]
        force, field = (np.array(part) for part in zip(*read, strict=True))
        (found,) = check_shots(1000.0 + depth, force, field, ERRORS)
        failed += found.verdict == FAIL
    assert failed <= 1


def test_a_bias_is_found_whatever_the_hole_may_curve_between_the_shots():
    rng = np.random.default_rng(37)
    tool = Tool(rng)
    tool.bias_f[1] = 0.05
    force, field = tool.shots(0.5, 1.0, FACES)
    (found,) = check_shots([1000.0, 1000.1, 1000.2, 1000.3], force, field, ERRORS)
    assert any(bias.excessive and bias.axis == "y" for bias in found.biases)
    assert found.verdict != PASS

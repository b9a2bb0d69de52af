# SPDX-License-Identifier: Apache-2.0
"""Locating a sonde by its field: the inverse of the dipole, true sigmas, and what has no meaning changes nothing."""

import dataclasses
import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_sensors.core.dipole import dipole_field
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.receiver.sonde_locate import (
    ReadingErrors,
    SondeFacts,
    SurfaceReadings,
    depth_overhead,
    locate,
    locate_points,
    moment_of,
)

GRID = np.array([[north, east, 0.0] for north in (-4.0, 0.0, 4.0) for east in (-3.0, 0.0, 3.0)])
ERRORS = ReadingErrors(1e-11, 0.02)


@dataclasses.dataclass(frozen=True)
class Truth:
    """A sonde: position, azimuth, pitch, moment."""

    position: np.ndarray
    azimuth: float
    pitch: float
    moment: float = 5.0

    @property
    def axis(self):
        level = math.cos(self.pitch)
        return np.array([level * math.cos(self.azimuth), level * math.sin(self.azimuth), -math.sin(self.pitch)])

    def field(self, points):
        return dipole_field(points - self.position, self.moment * self.axis).real

    def error(self, fix):
        angles = float(wrap_pi(fix.azimuth - self.azimuth)), fix.pitch - self.pitch
        return np.array([*(fix.position - self.position), *angles, math.log(fix.moment / self.moment)])


BORE = Truth(np.array([0.4, -0.7, 3.9]), math.radians(42.0), math.radians(-4.5))


def exact(truth, points=GRID):
    """Readings without errors, with components."""
    return SurfaceReadings(points, truth.field(points), np.full(len(points), np.nan))


def noisy(truth, rng, vector):
    """Readings with the errors of `ERRORS`; components have a sign by chance."""
    field = truth.field(GRID)
    sigma = np.hypot(ERRORS.noise_t, ERRORS.share * np.linalg.norm(field, axis=1))
    if vector:
        signs = rng.choice([-1.0, 1.0], size=(len(field), 1))
        return SurfaceReadings(
            GRID, signs * (field + sigma[:, None] * rng.normal(size=field.shape)), np.full(9, np.nan)
        )
    strength = np.linalg.norm(field, axis=1) + sigma * rng.normal(size=len(field))
    return SurfaceReadings(GRID, np.full(field.shape, np.nan), np.abs(strength))


def known_of(truth, azimuth=True):
    about = truth.azimuth + math.radians(10.0) if azimuth else math.nan
    return SondeFacts(truth.moment, pitch=truth.pitch, azimuth=about)


@pytest.mark.parametrize("vector", [True, False])
def test_a_field_without_errors_gives_the_sonde_back(vector):
    readings = exact(BORE)
    if not vector:
        nothing = np.full(readings.field.shape, np.nan)
        readings = SurfaceReadings(GRID, nothing, np.linalg.norm(readings.field, axis=1))
    fix = locate(readings, SondeFacts(5.0, pitch=BORE.pitch, azimuth=BORE.azimuth), ERRORS)
    assert BORE.error(fix) == pytest.approx(np.zeros(6), abs=1e-5)
    assert fix.doubts == ()


@pytest.mark.slow(6)
@pytest.mark.parametrize("sondes", [25, pytest.param(60, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("vector", [True, False])
def test_errors_are_as_large_as_the_sigmas_over_many_sondes(vector, sondes):
    errors, sigmas = [], []
    for seed in range(sondes):
        rng = np.random.default_rng(seed)
        truth = Truth(
            np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(2.0, 8.0)]),
            rng.uniform(0.0, math.tau),
            math.radians(rng.uniform(-15.0, 15.0)),
            5.0 * math.exp(0.02 * rng.normal()),
        )
        known = SondeFacts(
            5.0,
            pitch=truth.pitch + math.radians(0.3) * rng.normal(),
            azimuth=truth.azimuth + math.radians(30.0) * rng.normal() * 0.5,
        )
        fix = locate(noisy(truth, rng, vector), known, ERRORS)
        errors.append(truth.error(fix))
        sigmas.append(fix.sigma)
    for k, name in enumerate(("north", "east", "depth", "azimuth", "pitch", "moment")):
        assert_consistent(np.array(errors)[:, k], np.array(sigmas)[:, k], name=name)


@pytest.mark.parametrize("vector", [True, False])
def test_the_origin_the_order_of_rows_and_the_sign_of_a_row_have_no_meaning(vector):
    rng = np.random.default_rng(3)
    readings, known = noisy(BORE, rng, vector), known_of(BORE)
    fix = locate(readings, known, ERRORS)
    shift = np.array([4_196_300.0, 544_100.0, -512.5])
    moved = locate(readings._replace(point=readings.point + shift), known, ERRORS)
    assert moved.position - shift == pytest.approx(fix.position, abs=2e-4)
    assert moved.sigma == pytest.approx(fix.sigma, rel=1e-2)
    order = rng.permutation(len(GRID))
    signs = rng.choice([-1.0, 1.0], size=(len(GRID), 1))
    mixed = SurfaceReadings(readings.point[order], (signs * readings.field)[order], readings.strength[order])
    again = locate(mixed, known, ERRORS)
    assert again.position == pytest.approx(fix.position, abs=1e-4)
    assert again.azimuth == pytest.approx(fix.azimuth, abs=1e-4)


def test_turning_the_axes_turns_the_sonde():
    turn = math.radians(70.0)
    c, s = math.cos(turn), math.sin(turn)
    about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    readings, known = noisy(BORE, np.random.default_rng(5), True), known_of(BORE)
    turned = SurfaceReadings(readings.point @ about.T, readings.field @ about.T, readings.strength)
    one = locate(readings, known, ERRORS)
    other = locate(turned, known._replace(azimuth=known.azimuth + turn), ERRORS)
    assert about @ one.position == pytest.approx(other.position, abs=1e-4)
    assert float(wrap_pi(other.azimuth - one.azimuth - turn)) == pytest.approx(0.0, abs=1e-4)


def test_a_level_sonde_without_an_azimuth_points_either_way_and_it_is_said():
    level = dataclasses.replace(BORE, pitch=0.0)
    fix = locate(exact(level), known_of(level, azimuth=False), ERRORS)
    (other,) = fix.others
    assert abs(float(wrap_pi(other.azimuth - fix.azimuth))) == pytest.approx(math.pi, abs=1e-3)
    assert "fit as well" in fix.doubts[0]
    assert locate(exact(level), known_of(level), ERRORS).others == ()


def test_steel_near_a_point_is_found_by_chi_square():
    readings = exact(BORE)
    readings.field[4] *= 1.4
    assert "do not fit one dipole" in locate(readings, known_of(BORE), ERRORS).doubts[0]


def test_points_too_few_or_without_numbers_are_refused():
    one = exact(BORE, GRID[:1])
    with pytest.raises(ValueError, match="more points"):
        locate(SurfaceReadings(one.point, np.full((1, 3), np.nan), np.array([1e-9])), known_of(BORE), ERRORS)
    with pytest.raises(ValueError, match="position and a field"):
        locate(SurfaceReadings(GRID, np.full((9, 3), np.nan), np.full(9, np.nan)), known_of(BORE), ERRORS)


@pytest.mark.parametrize("pitch_deg", [-30.0, -4.5, 0.0, 12.0, 60.0])
def test_the_field_is_vertical_at_the_locate_points_and_its_strength_above_gives_the_depth(pitch_deg):
    truth = Truth(np.array([0.0, 0.0, 3.0]), 0.0, math.radians(pitch_deg))
    for along in locate_points(3.0, truth.pitch):
        field = truth.field(np.array([along, 0.0, 0.0]))
        assert field[:2] == pytest.approx([0.0, 0.0], abs=1e-6 * np.linalg.norm(field))
    above = float(np.linalg.norm(truth.field(np.zeros(3))))
    assert depth_overhead(above, 5.0, truth.pitch) == pytest.approx(3.0, rel=1e-12)


def test_a_calibration_beside_the_sonde_gives_its_moment():
    level = Truth(np.zeros(3), 0.0, 0.0, 4.2)
    assert moment_of(float(np.linalg.norm(level.field(np.array([0.0, 3.0, 0.0])))), 3.0) == pytest.approx(4.2)


@pytest.mark.parametrize("known", [SondeFacts(5.0), SondeFacts(5.0, pitch=BORE.pitch, azimuth=BORE.azimuth)])
def test_readings_of_one_point_again_and_again_do_not_determine_the_sonde(known):
    field = BORE.field(np.tile(GRID[:1], (9, 1)))
    readings = SurfaceReadings(np.tile(GRID[:1], (9, 1)), np.full((9, 3), np.nan), np.linalg.norm(field, axis=1))
    fix = locate(readings, known, ERRORS)
    assert fix.sigma[:2].max() > 100.0
    assert any("hardly determine" in doubt for doubt in fix.doubts)


@pytest.mark.parametrize("errors", [ReadingErrors(math.nan), ReadingErrors(math.inf), ReadingErrors(1e-11, math.nan)])
def test_errors_that_are_no_numbers_are_refused(errors):
    with pytest.raises(ValueError, match="finite numbers"):
        locate(exact(BORE), SondeFacts(5.0), errors)

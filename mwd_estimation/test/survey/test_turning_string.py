# SPDX-License-Identifier: Apache-2.0
"""A turning string of known mounts, collars, lever arms and speeds, and what is found of them."""

import math
import pickle

import numpy as np
import pytest
from scipy.stats import chi2

from consistency import assert_consistent
from mwd_estimation.core.magnetic_geometry import dip
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.run_model import RunModel, Taken
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.turning_string import TurningString
from mwd_estimation.survey.verdict import judged

RATE_HZ, PERIOD_NS = 100, 10_000_000
PER_BIN = BIN_NS // PERIOD_NS
GRAVITY, FIELD = np.array([-8.0, 5.7, 0.0]), np.array([3.0e-5, 2.0e-5, -1.5e-5])


def turned(vector, roll):
    """A vector that stands still, in tool axes that have turned by `roll` about x; shape (n, 3)."""
    across = (vector[1] + 1j * vector[2]) * np.exp(-1j * roll)
    return np.stack([np.full(len(roll), vector[0]), across.real, across.imag], axis=1)


def string(
    seconds,
    rng,
    *,
    mount=(0.0, 0.0),
    whole=(0.0, 0.0),
    across=(0.0, 0.0),
    arm=0.0,
    wobble=0.0,
    scale=1.0,
    late=0,
    noise=1.0,
    speed=12.0,
    every=1,
    bad=None,
    cut=1000,
    standing=0.0,
    overtaken=0,
    bounce=0.0,
    slip=0.0,
):
    """
    Turns of a tool whose accelerometers see the axis of rotation at (1, mount + whole), its magnetometers at whole.

    mount, whole, rad; across: field in the tool, T; arm of the accelerometers, m; wobble of the speed within a turn;
    scale of the gyro; late: samples by which the magnetometer is stamped late; every: distance of the measured samples;
    standing: seconds after each half second of turns; overtaken: samples by which every 37th sample comes late;
    bounce: amplitude along the hole in step with the turns, m; slip: of the speed, goes and comes once in five turns.
    """
    n = int(seconds * RATE_HZ)
    turns = np.arange(n) % int((0.5 + standing) * RATE_HZ) < 0.5 * RATE_HZ
    speeds = speed * (1.0 + slip * np.sin(0.2 * speed * np.arange(n) / RATE_HZ))
    roll = np.cumsum(np.where(turns, speeds / RATE_HZ, 0.0))
    roll = roll + wobble * np.sin(roll - 0.4)
    rate = np.gradient(roll) * RATE_HZ

    def seen(vectors, at):
        axis = np.array([1.0, *at])
        return vectors + np.cross(np.cross([1.0, 0.0, 0.0], axis), vectors)

    force = turned(GRAVITY, roll)
    pull = arm * (1j * np.gradient(rate) * RATE_HZ - rate**2)
    force = seen(
        force + np.stack([-bounce * rate**2 * np.cos(roll), pull.real, pull.imag], axis=1), np.add(mount, whole)
    )
    field = seen(turned(FIELD, np.concatenate([np.zeros(late), roll[: n - late]])), whole) + np.array([0.0, *across])
    force, field = force + rng.normal(0.0, noise, (n, 3)), field + rng.normal(0.0, 1e-7, (n, 3))
    stamps, unsure = np.arange(n) * PERIOD_NS, np.zeros(n, bool) if bad is None else bad(np.arange(n))
    found, order = TurningString(), np.arange(n)
    for at in range(0, n - overtaken, 37) if overtaken else ():
        order[at : at + overtaken + 1] = np.roll(order[at : at + overtaken + 1], -1)
    for start in range(0, n, cut):
        part = order[start : start + cut]
        found.take_mag(stamps[part][::every], field[part][::every])
        found.take_imu(stamps[part], scale * rate[part], force[part], unsure[part])
        for index in range(start // PER_BIN, min(start + cut, n) // PER_BIN):
            found.close(index)
    return found.found


@pytest.mark.slow
def test_mount_and_collar_are_found_and_their_sigmas_hold():
    mount, across = np.radians([1.2, -1.6]), np.array([4e-7, -9e-7])
    off_mount, off_field = [], []
    for seed in range(20):
        found = string(120.0, np.random.default_rng(seed), mount=mount, across=across, noise=4.0)
        off_mount += list((found.mount.value - mount) / found.mount.sigma)
        off_field += list((found.field.value - across) / found.field.sigma)
        assert found.mount.sigma < math.radians(1.0)
    # The floors, for what is alike in every window, are in sigma and not in these strings.
    assert np.mean(np.square(off_mount)) < 1.3
    assert np.mean(np.square(off_field)) < 1.3
    # Where noise is large the floors do not count, and sigma is that of the noise.
    loud = [string(60.0, np.random.default_rng(seed), noise=40.0) for seed in range(30)]
    assert_consistent([part / one.mount.sigma for one in loud for part in one.mount.value], 1.0, name="mount")


@pytest.mark.parametrize(
    "motion",
    [
        {"wobble": 0.05},
        {"scale": 1.005},
        {"late": 3, "wobble": 0.02},
        {"late": 1, "slip": 0.8},
        {"arm": 0.05, "wobble": 0.02},
        {"whole": (0.02, -0.03)},
        {"speed": -9.0},
    ],
    ids="-".join,
)
def test_speeds_that_change_within_a_turn_scales_delays_and_arms_do_no_harm(motion):
    rng = np.random.default_rng(5)
    mount, across = np.radians([0.8, 1.1]), np.array([-5e-7, 3e-7])
    found = string(60.0, rng, mount=mount, across=across, noise=0.3, **motion)
    np.testing.assert_allclose(found.mount.value, mount, atol=math.radians(0.1))
    np.testing.assert_allclose(found.field.value, across, atol=1e-7)


@pytest.mark.parametrize("speed", [3.0, 12.0, 18.0])
def test_a_sound_tool_that_bounces_once_a_turn_is_not_taken_for_a_turned_one(speed):
    found = string(60.0, np.random.default_rng(7), bounce=1e-3, speed=speed, noise=0.3)
    assert np.linalg.norm(found.mount.value) < 3.0 * found.mount.sigma


@pytest.mark.parametrize("overtaken", [0, 1, 5])
def test_any_cut_of_the_samples_gives_the_same_bits(overtaken):
    told = {"mount": (0.02, 0.0), "overtaken": overtaken}
    rows = [string(30.0, np.random.default_rng(2), **told, cut=cut) for cut in (50, 100, 3000)]
    for one in rows[1:]:
        np.testing.assert_array_equal(one.mount.value, rows[0].mount.value)
        np.testing.assert_array_equal(one.field.value, rows[0].field.value)
        assert (one.mount.sigma, one.field.sigma) == (rows[0].mount.sigma, rows[0].field.sigma)


@pytest.mark.parametrize(
    "motion", [{}, {"bounce": 5e-4}, {"late": 1, "slip": 0.8}, {"late": 3}, {"wobble": 0.05}], ids="-".join
)
def test_a_string_that_turned_for_few_seconds_has_a_sigma_of_its_own(motion):
    mount, off = np.radians([1.2, -1.6]), []
    for seed in range(100, 140):
        found = string(7.0, np.random.default_rng(seed), mount=mount, noise=10.0, **motion)
        off += list((found.mount.value - mount) / found.mount.sigma)
    # The floors, for what is alike in every window, make it less.
    assert np.mean(np.square(off)) < chi2.ppf(0.99, len(off)) / len(off)
    assert found.mount.sigma < math.radians(10.0)
    # Longer turns tell more.
    assert string(60.0, np.random.default_rng(1), mount=mount, noise=10.0, **motion).mount.sigma < found.mount.sigma


def test_a_sound_tool_that_bounces_by_two_millimetres_errs_within_its_sigma():
    f_t, b_t = np.array([-4.905, 8.4957, 0.0]), np.array([4.2e-5, -1.2e-5, 2.0e-5])
    settings = StationSettings()
    reference = Reference(float(np.linalg.norm(b_t)), float(dip(f_t, b_t)), 0.0, gravity=9.81)
    one = measured(f_t, b_t, reference, settings)
    for seconds in (7.0, 60.0):
        turning = string(seconds, np.random.default_rng(3), bounce=2e-3)
        finding = RunModel(settings).take(Taken(one, turning=turning))
        station = judged(one, finding, settings)
        assert abs(station.inclination - math.radians(60.0)) < 3.0 * station.sigma_inclination
        assert station.verdicts.azimuth != "reject"


def test_a_string_that_stands_has_just_begun_to_turn_or_whose_sensors_clip_shows_nothing():
    rng = np.random.default_rng(1)
    assert string(60.0, rng, speed=0.0) is None
    assert string(4.5, rng) is None
    assert string(60.0, rng, bad=lambda at: at % 400 == 0) is None


def test_a_string_that_turned_a_little_and_stands_since_is_not_kept_in_mind():
    found, n = TurningString(), 2 * PER_BIN
    for index in range(150):
        stamps = np.arange(index * PER_BIN, (index + 1) * PER_BIN) * PERIOD_NS
        rate = np.full(PER_BIN, 1.5 if index < 2 else 0.0)
        found.take_imu(stamps, rate, np.tile(GRAVITY, (PER_BIN, 1)), np.zeros(PER_BIN, bool))
        found.close(index)
    held = pickle.dumps(found)
    assert len(held) < 30 * 8 * n, f"{len(held)} bytes after a minute at rest"


def test_a_magnetometer_that_is_too_slow_for_the_turns_shows_nothing():
    rng = np.random.default_rng(1)
    assert string(120.0, rng, speed=10.0 * math.pi, every=10) is None
    assert string(120.0, rng, speed=4.0 * math.pi, every=10) is not None
    # Two turns in half a second, and a few readings of them beside many of one toolface at rest.
    assert string(120.0, rng, speed=8.0 * math.pi, every=10, standing=4.5) is None
    assert string(120.0, rng, speed=8.0 * math.pi, every=2, standing=4.5) is not None


def test_without_a_magnetometer_nothing_is_compared():
    found = TurningString()
    stamps = np.arange(3000) * PERIOD_NS
    found.take_imu(stamps, np.full(3000, 12.0), turned(GRAVITY, np.arange(3000) * 0.12), np.zeros(3000, bool))
    for index in range(3000 // PER_BIN):
        found.close(index)
    assert found.found is None
